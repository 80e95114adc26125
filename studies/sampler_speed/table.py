"""Effective samples a second of the worst parameter, against the peers on the likelihood of every row.

This writes the table that the report of ``studies/sampler_speed.toml`` shows; it needs the extra
``benchmark`` and a quarter of an hour: ``OMP_NUM_THREADS=1 python -m studies.sampler_speed.table``.
"""

from __future__ import annotations

import csv
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.mcmc import Chains
from imubayes.inference.mcmc.density import density_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import sample
from imubayes.inference.prior import class_sd
from imubayes.inference.summary import Summary, summarize
from imubayes.sensors.noise import NoiseRule, noise_prior
from imubayes.study.schema import read_runs, read_study
from studies.sampler_speed.full_data import (
    FreeNoise,
    GivenNoise,
    OnFactor,
    free_noise,
    given_noise,
    in_prior_scale,
    on_factor,
)
from studies.sampler_speed.peers import Sampled, nuts, nuts_ess, stretch, stretch_ess

STUDY = Path(__file__).parents[2] / "studies" / "sampler_speed.toml"
TABLE = STUDY.with_suffix(".csv")
HEADER = ("noise", "sampler", "likelihood", "seconds", "least ESS", "least ESS/s", "ours is ahead", "remark")
SEED = 3
LONG_RUN, SHORT_RUN = 120.0, 60.0
"""Seconds of the stretch move: for fifty autocorrelation times, and for the time of a step."""
TUNE, DRAWS = 400, {"given": 3000, "free": 600}
"""nutpie's usual warm-up; draws enough to make it a small part where a draw is cheap."""
WALKERS = 256
"""Of ours: a step then costs its arithmetic, not Python's; a peer's costs its rows anyhow."""
LEAST_ESS = {"given": 100_000.0, "free": 10_000.0}
OURS, STRETCH, NUTS = "imubayes, full", "emcee, stretch move", "nutpie, NUTS"


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """The campaign with the noise given or free, for us and for the peers."""

    summary: Summary
    rows: tuple[Linear, ...]
    sd: NDArray[np.float64]
    density: GivenNoise | FreeNoise


@dataclass(frozen=True, slots=True, eq=False)
class Timed:
    """A sampler's draws (m, d) of coefficients and ln N, ln B, ln K, their effective sizes (d,), its time."""

    sampler: str
    likelihood: str
    seconds: float
    ess: NDArray[np.float64]
    draws: NDArray[np.float64]
    remark: str

    @property
    def rate(self) -> float:
        """Effective samples a second of the worst parameter."""
        return float(self.ess.min()) / self.seconds


def problems() -> dict[str, Problem]:
    """The campaign of the study, with its noise given and free."""
    (spec,), runs = read_study(STUDY).sensors, read_runs(STUDY)
    assert spec.sensor_class is not None
    assert len(spec.library.terms) == 21
    free = summarize(runs, spec.library, sensor=spec.sensor_class)
    noise = [run.noise for run in free.runs]
    rules = {run.name: NoiseRule("fixed", run.noise) for run in free.runs}
    given = summarize(runs, spec.library, sensor=spec.sensor_class, rules=rules)
    rows, sd = tuple(linear_of(run, spec.library) for run in runs), class_sd(spec.sensor_class, spec.library)
    density = given_noise(rows, noise, sd)
    spreads = [run.found.sd for run in free.runs]
    wide = free_noise(rows, density, noise, spreads, noise_prior(spec.sensor_class))
    return {"given": Problem(given, rows, sd, density), "free": Problem(free, rows, sd, wide)}


def _all(noise: str, problem: Problem) -> list[Timed]:
    density, tuned = problem.density, partial(nuts, tune=TUNE, draws=DRAWS[noise], seed=SEED, low_rank=True)
    timed = [_ours(problem, LEAST_ESS[noise])]
    if isinstance(density, GivenNoise):
        timed.append(_of_stretch(stretch(density, LONG_RUN, SEED)))
        scaled = tuned(in_prior_scale(density))
        timed.append(_of_nuts(scaled, f"{NUTS}, prior scale", "parameters over their prior's sd"))
    else:
        ours = density_of(problem.summary, problem.rows, problem.sd, np.random.default_rng(SEED))
        timed.append(_of_short_stretch(stretch(density, SHORT_RUN, SEED), on_factor(density, ours)))
    return [*timed, _of_nuts(tuned(density), NUTS, "parameters whitened by the posterior")]


def _ours(problem: Problem, least: float) -> Timed:
    """Time from the summary to the end of the chains, whose end is the last that progress is told of."""
    told = [time.perf_counter()]
    chains = sample(
        problem.summary,
        problem.rows,
        problem.sd,
        method="full",
        limits=Limits(ess=least, seed=SEED, walkers=WALKERS),
        progress=lambda *_: told.append(time.perf_counter()),
    ).chains
    found = chains.diagnostics
    remark = f"{found.ensembles} ensembles, {found.acceptance:.0%} accepted, R-hat {found.rhat.max():.4f}"
    return Timed(OURS, "factor", told[-1] - told[0], found.ess, _draws(chains), remark)


def _draws(chains: Chains) -> NDArray[np.float64]:
    draws = chains.theta.shape[0] * chains.theta.shape[1]
    sampled = len(chains.diagnostics.parameters) > len(chains.names)
    logs = np.log(chains.noise.reshape(draws, -1)) if sampled else np.empty((draws, 0))
    return np.column_stack((chains.theta.reshape(draws, -1), logs))


def _of_stretch(sampled: Sampled) -> Timed:
    ess, tau = stretch_ess(sampled)
    remark = f"autocorrelation time {tau.max():.0f} steps, {_reach(sampled, tau):.0f} of them"
    return Timed(STRETCH, "all rows", sampled.seconds, ess, _flat(sampled), remark)


def _of_short_stretch(sampled: Sampled, same: OnFactor) -> Timed:
    """Time of a step on all rows, with the autocorrelation time of a long chain on the factor."""
    long = stretch(same, LONG_RUN, SEED)
    _, tau = stretch_ess(long)
    remark = (
        f"autocorrelation time {tau.max():.0f} steps: {_reach(long, tau):.0f} of them in a chain on the"
        f" factor, {_reach(sampled, tau):.2g} on all rows"
    )
    ess = len(_flat(sampled)) / tau
    return Timed(STRETCH, "all rows", sampled.seconds, ess, _flat(sampled), remark)


def _reach(sampled: Sampled, tau: NDArray[np.float64]) -> float:
    """Length of a chain in autocorrelation times; of fewer than 50 the time itself cannot be told."""
    return sampled.draws.shape[1] / float(tau.max())


def _of_nuts(sampled: Sampled, name: str, remark: str) -> Timed:
    return Timed(name, "all rows", sampled.seconds, nuts_ess(sampled), _flat(sampled), remark)


def _flat(sampled: Sampled) -> NDArray[np.float64]:
    return sampled.draws.reshape(-1, sampled.draws.shape[-1])


def _write(path: Path, found: dict[str, dict[str, Timed]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(HEADER)
        for noise, timed in found.items():
            table.writerows(_line(noise, one, timed[OURS].rate / one.rate) for one in timed.values())


def _line(noise: str, one: Timed, ahead: float) -> tuple[str, ...]:
    ratio = "" if one.sampler == OURS else f"{ahead:.3g} times"
    speed = f"{one.rate:.3g}" if one.rate < 1000.0 else f"{one.rate:,.0f}"
    return (
        noise,
        one.sampler,
        one.likelihood,
        f"{one.seconds:.1f}",
        f"{one.ess.min():,.0f}",
        speed,
        ratio,
        one.remark,
    )


if __name__ == "__main__":
    _write(TABLE, {noise: {one.sampler: one for one in _all(noise, p)} for noise, p in problems().items()})
