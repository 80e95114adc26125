"""Simulation-based calibration: the truth's rank among posterior draws is uniform.

Talts, Betancourt, Simpson, Vehtari and Gelman (2018): whatever is drawn from the model and analysed under the
same model has, averaged over many campaigns, a uniform rank. The noise is therefore the model's own, averaged
over each row, and not the simulator's, which takes flicker at points: 240 campaigns with that noise put N of
the tumble 0.17 sd high. Writes the figure ``reports/ranks/ranks.svg``.
"""

from __future__ import annotations

import json
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from celerite2 import driver

import imubayes as ib
from imubayes.inference.linear import linear_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import sample
from imubayes.inference.whiten import Rows, whitener
from imubayes.rig.inputs import Run, durations
from imubayes.sensors.catalogue import noise_prior
from imubayes.sensors.noise import Noise

CAMPAIGNS = 200
BINS = 10
DRAWS = 20 * BINS - 1
"""Draws that the truth is ranked among: DRAWS + 1 ranks fall into BINS alike bins."""

SENSOR = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer", powers=2, asymmetry=-1)
COEFFICIENTS = ("b0", "b1", "b2", "m_j")
NOISES = ("N.tumble", "K.tumble", "N.centrifuge", "K.centrifuge")
OUT = Path(__file__).parents[2] / "reports" / "ranks"


def ranks_of(seed: int) -> dict[str, int]:
    """Ranks of one campaign's coefficients and noise parameters."""
    rng = np.random.default_rng([13, seed])
    sd = ib.prior(SENSOR, LIBRARY).sd
    theta = sd * rng.standard_normal(len(sd))
    plans = (
        ib.tumble(angles=12, dwell=6.0, rate=5.0),
        ib.centrifuge([1, 5, 10], mounts=12, dwell=6.0, rate=5.0),
    )
    unit = dict(zip(LIBRARY.names, theta.tolist(), strict=True))
    truth, runs = dict(unit), []
    for plan in plans:
        values = [math.exp(math.log(m) + s * rng.standard_normal()) for m, s in noise_prior(SENSOR)]
        runs += [
            _noisy(run, Noise(*values), rng)
            for run in ib.simulate(SENSOR, [plan], seed=rng, truth=unit, noise=Noise(0.0, 0.0, 0.0))
        ]
        truth |= {f"{name}.{plan.name}": value for name, value in zip("NBK", values, strict=True)}
    summary = ib.summarize(runs, LIBRARY, sensor=SENSOR)
    rows = [linear_of(run, LIBRARY) for run in runs]
    chains = sample(summary, rows, sd, limits=Limits(seed=seed)).chains
    columns = {name: chains.theta[..., k].ravel() for k, name in enumerate(LIBRARY.names)}
    for k, run in enumerate(chains.runs):
        columns |= {f"{name}.{run}": chains.noise[..., k, j].ravel() for j, name in enumerate("NBK")}
    # the chains' draws are correlated by a few steps: thinned evenly they are not
    few = np.linspace(0, chains.theta[..., 0].size - 1, DRAWS).astype(int)
    return {name: int(np.sum(columns[name][few] < truth[name])) for name in (*COEFFICIENTS, *NOISES)}


def _noisy(run: Run, noise: Noise, rng: np.random.Generator) -> Run:
    """The run with noise drawn from the model: independent normals, coloured by its factor L sqrt(D)."""
    rows = Rows(run.inputs.t, durations(run.inputs.t, run.inputs.interval))
    w = whitener(noise, rows)
    drawn = (np.sqrt(w.d) * rng.standard_normal(len(rows.t)))[:, None]
    if w.U.shape[1]:
        drawn += driver.matmul_lower(w.t, w.c, w.U, w.W, drawn, np.zeros_like(drawn))
    return replace(run, output=run.output + drawn[:, 0])


def uniform_p(ranks: np.ndarray) -> float:
    """p-value of a chi-square test that ranks 0 ... DRAWS are uniform."""
    from scipy.stats import chisquare

    counts = np.bincount(ranks * BINS // (DRAWS + 1), minlength=BINS)
    return float(chisquare(counts).pvalue)


@pytest.fixture(scope="module")
def ranks() -> dict[str, np.ndarray]:
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(ranks_of, range(CAMPAIGNS), chunksize=4))
    table = {name: np.array([one[name] for one in found]) for name in found[0]}
    _write(table)
    return table


@pytest.mark.slow
@pytest.mark.parametrize("name", (*COEFFICIENTS, *NOISES))
def test_rank_of_the_truth_is_uniform(ranks, name):
    assert uniform_p(ranks[name]) > 0.01


def test_ranks_of_an_overconfident_posterior_are_refused():
    rng = np.random.default_rng(1)
    truth, draws = rng.standard_normal(CAMPAIGNS), 0.7 * rng.standard_normal((CAMPAIGNS, DRAWS))
    center = truth + rng.standard_normal(CAMPAIGNS)
    assert uniform_p(np.sum(draws < (truth - center)[:, None], axis=1)) < 0.01


def _write(table: dict[str, np.ndarray]) -> None:
    """Figure and figures of the ranks, for the reader of the reports."""
    OUT.mkdir(parents=True, exist_ok=True)
    counts = {name: np.bincount(r * BINS // (DRAWS + 1), minlength=BINS) for name, r in table.items()}
    p_values = {name: round(uniform_p(r), 4) for name, r in table.items()}
    _draw(counts, p_values)
    values = {
        "campaigns": CAMPAIGNS,
        "command": "pytest -m slow tests/calibration/test_ranks.py",
        "p_values": p_values,
        "counts": {name: c.tolist() for name, c in counts.items()},
    }
    (OUT / "ranks.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def _draw(counts: dict[str, np.ndarray], p_values: dict[str, float]) -> None:
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from scipy.stats import binom

    low, high = (float(binom.ppf(q, CAMPAIGNS, 1.0 / BINS)) for q in (0.005, 0.995))
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    axes = figure.subplots(2, 4, sharex=True, sharey=True)
    for ax, (name, count) in zip(axes.flat, counts.items(), strict=True):
        ax.axhspan(low, high, color="0.88", lw=0)
        ax.axhline(CAMPAIGNS / BINS, color="0.5", lw=0.8)
        ax.bar((np.arange(BINS) + 0.5) / BINS, count, width=0.9 / BINS, color="#0072B2")
        ax.set_title(f"{name}: p = {p_values[name]:.2f}", fontsize=10)
        ax.spines[["top", "right"]].set_visible(False)
    figure.supxlabel(
        "rank of the truth among the posterior's draws (0: below all, 1: above all)", fontsize=10
    )
    figure.supylabel("campaigns", fontsize=10)
    figure.suptitle(
        f"Ranks of the truth over {CAMPAIGNS} simulated campaigns; grey: 99 % of what chance gives",
        fontsize=11,
    )
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ranks"}):
        figure.savefig(OUT / "ranks.svg", metadata={"Date": None})
