"""Simulation-based calibration: the truth's rank among posterior draws is uniform.

Talts, Betancourt, Simpson, Vehtari and Gelman (2018): whatever is drawn from the model and analysed under the
same model has, averaged over many campaigns, a uniform rank. The noise is therefore the model's own, averaged
over each row, and not the simulator's, which takes flicker at points: 240 campaigns with that noise put N of
the tumble 0.17 sd high.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from celerite2 import driver  # pyright: ignore[reportAttributeAccessIssue]: a compiled module without stubs
from numpy.typing import NDArray
from scipy.stats import chisquare

import imubayes as ib
from imubayes.inference.linear import Rows, linear_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import sample
from imubayes.inference.whiten import marginal_variance, processes
from imubayes.rig.inputs import Run, durations
from imubayes.sensors.noise import Noise, noise_prior
from imubayes.work import Progress, shared, silent

SENSOR = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer", powers=2, asymmetry=-1)
COEFFICIENTS = ("b0", "b1", "b2", "m_j")
NOISES = ("N.tumble", "K.tumble", "N.centrifuge", "K.centrifuge")

RANKS_A_BIN = 20
"""Ranks that fall into a bin."""


@dataclass(frozen=True, slots=True)
class RanksStudy:
    """What is measured: `bins` of ranks over so many simulated `campaigns`, by so many `processes`."""

    seed: int = 13
    campaigns: int = 200
    bins: int = 10
    processes: int = 2
    command: str = "python -m studies.ranks"

    @property
    def draws(self) -> int:
        """Draws that the truth is ranked among: draws + 1 ranks fall into bins alike."""
        return RANKS_A_BIN * self.bins - 1


SMALL = RanksStudy(campaigns=3, bins=5, processes=1)
"""Less than a minute."""


@dataclass(frozen=True, slots=True, eq=False)
class Ranks:
    """What the `ranks` of the truth are: (campaigns,) of each quantity, from 0 to the number of draws."""

    study: RanksStudy
    ranks: Mapping[str, NDArray[np.int64]]
    seconds: float

    def counts(self, name: str) -> NDArray[np.int64]:
        """How many ranks of a quantity fall into each bin."""
        return np.bincount(self.ranks[name] // RANKS_A_BIN, minlength=self.study.bins)

    def p_value(self, name: str) -> float:
        """Chi-square test that the ranks of a quantity are uniform."""
        return float(chisquare(self.counts(name)).pvalue)


def measure(study: RanksStudy, *, progress: Progress = silent) -> Ranks:
    """Rank the truth of every campaign among the draws of its posterior."""
    start = time.perf_counter()
    jobs = [(study, number) for number in range(study.campaigns)]
    found = shared(ranks_of, jobs, study.processes, things="campaigns", progress=progress)
    ranks = {name: np.array([one[name] for one in found]) for name in (*COEFFICIENTS, *NOISES)}
    return Ranks(study, ranks, time.perf_counter() - start)


def ranks_of(study: RanksStudy, number: int) -> dict[str, int]:
    """Ranks of one campaign's coefficients and noise parameters."""
    rng = np.random.default_rng([study.seed, number])
    sd = ib.prior(SENSOR, LIBRARY).sd
    theta = sd * rng.standard_normal(len(sd))
    plans = (
        ib.tumble(angles=12, dwell=6.0, rate=5.0),
        ib.centrifuge([1, 5, 10], mounts=12, dwell=6.0, rate=5.0),
    )
    unit = dict(zip(LIBRARY.names, theta.tolist(), strict=True))
    truth, runs = dict(unit), []
    for plan in plans:
        values = [math.exp(math.log(m) + s * rng.standard_normal()) for m, s in noise_prior(SENSOR).values()]
        runs += [
            _noisy(run, Noise(*values), rng)
            for run in ib.simulate(SENSOR, [plan], seed=rng, truth=unit, noise=Noise(0.0, 0.0, 0.0))
        ]
        truth |= {f"{name}.{plan.name}": value for name, value in zip("NBK", values, strict=True)}
    summary = ib.summarize(runs, LIBRARY, sensor=SENSOR)
    rows = [linear_of(run, LIBRARY) for run in runs]
    chains = sample(summary, rows, sd, limits=Limits(seed=number)).chains
    columns = {name: chains.theta[..., k].ravel() for k, name in enumerate(LIBRARY.names)}
    for k, run in enumerate(chains.runs):
        columns |= {f"{name}.{run}": chains.noise[..., k, j].ravel() for j, name in enumerate("NBK")}
    # the chains' draws are correlated by a few steps: thinned evenly they are not
    few = np.linspace(0, chains.theta[..., 0].size - 1, study.draws).astype(int)
    return {name: int(np.sum(columns[name][few] < truth[name])) for name in (*COEFFICIENTS, *NOISES)}


def _noisy(run: Run, noise: Noise, rng: np.random.Generator) -> Run:
    """The run with noise drawn from the model: independent normals, coloured by its factor L sqrt(D)."""
    rows = Rows(run.inputs.t, durations(run.inputs.t, run.inputs.interval))
    parts, n = processes(rows, noise), len(rows.t)
    x, t = rows.duration[:, None] / parts.tau, rows.t - rows.t[0]
    averaging, walked = 2.0 * np.sinh(0.5 * x) / x, t + 0.5 * rows.duration[0]
    c = np.append(1.0 / parts.tau, 0.0)
    U = np.column_stack((averaging, np.ones(n)))
    V = np.column_stack((averaging * noise.B**2 * parts.variance, noise.K**2 * walked))
    d, W = driver.factor(t, c, marginal_variance(noise, rows), U, V, np.empty(n), V)
    drawn = (np.sqrt(d) * rng.standard_normal(n))[:, None]
    drawn += driver.matmul_lower(t, c, U, W, drawn, np.zeros_like(drawn))
    return replace(run, output=run.output + drawn[:, 0])
