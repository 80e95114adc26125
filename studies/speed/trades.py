"""Error against time of every rung and of what others would use, from a thousand rows of a MEMS on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorSpec
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import RungName, rungs_for
from imubayes.ladder.costs import foreseen, known_law
from imubayes.ladder.problem import Answer, Problem, change, ground_of, problem_of, size_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.measurement import RESOLVED
from imubayes.reporting.lots_words import capitalised, class_name
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate_runs
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.lots import draw_lot
from imubayes.sensors.terms import library
from imubayes.work import silent
from studies.speed import peers
from studies.speed.campaigns import stacked
from studies.speed.contests import Contest, Entrant, Self

CLASSES = ("mems_consumer", "mems_tactical", "fog_tactical", "rlg_tactical", "fog_navigation")
"""Gyroscopes, one of each decade of rows from a thousand on."""

LIBRARY = library("gyroscope", powers=3, asymmetry=1)

RATES = tuple(np.radians((-100.0, -50.0, -20.0, 20.0, 50.0, 100.0)).tolist())
"""rad/s of a rate table, in nine mounts."""

MOUNTS = 9

LEAST, AT_REST = 1_000, 0.4
"""Rows of the smallest campaign, at 1 Hz, and share of its time at rest; larger ones last longer."""

PATIENCE = 90.0
"""s; a rung that takes longer by its law is left out."""

FEW = 100_000
"""Rows up to which a sampler of others is given every row."""

MANY = 1_000_000
"""Rows up to which others are given them at once: a table of 1e7 rows, and its copies, fill the memory."""


def problem(n: int, seed: int) -> Problem:
    """Problem of a gyroscope after a campaign of about n rows."""
    entry, rng = _class_of(n), np.random.default_rng([seed, 7, n])
    rate = math.sqrt(n / LEAST)
    log = {"profile": "static", "duration": AT_REST * n / rate, "rate": rate}
    dwell = (1.0 - AT_REST) * n / rate / (len(RATES) * MOUNTS)
    table = {"profile": "rate-table", "rates": RATES, "mounts": MOUNTS, "dwell": dwell, "rate": rate}
    plans = (
        RunSpec("still", "static", simulate=log),
        RunSpec("table", "rate-table", simulate={**table, "settle": 0.0}),
    )
    lot = draw_lot(entry, LIBRARY, 1, rng)
    runs, _ = simulate_runs(plans, entry, LIBRARY, truth=lot.truth(0), rng=rng, noise=lot.noise[0])
    spec = SensorSpec(entry.id, "gyroscope", entry, LIBRARY, plans, lot.truth(0), bench_stated=True)
    return problem_of(spec, runs)


def _class_of(n: int) -> SensorClass:
    decade = round(math.log10(n / LEAST))
    return sensor(CLASSES[min(max(decade, 0), len(CLASSES) - 1)], kind="gyroscope")


def trade(n: int, seed: int) -> Contest:
    """Every rung that ends within `PATIENCE`, and others, on a campaign of about n rows."""
    asked = problem(n, seed)
    size, law = size_of(asked), known_law()
    rungs: list[RungName] = [
        one for one in rungs_for(size) if one != "raw" and foreseen(one, size, law) < PATIENCE
    ]
    answers: dict[RungName, Answer] = {}

    def by(rung: RungName) -> Callable[[], Answer]:
        def solve() -> Answer:
            ground = ground_of(asked, np.random.default_rng([seed, 8]), silent, Limits(seed=seed))
            answers[rung] = stand(rung, ground)
            return answers[rung]

        return solve

    def off(theta: FloatArray) -> float:
        best = answers[rungs[-1]]
        told = np.array([term.verdict in RESOLVED for term in best.selection.terms])
        return float(np.max(np.abs(theta - best.full_mean)[told] / best.full_sd[told]))

    ours = (
        Entrant(rung, by(rung), lambda found: change(found, answers[rungs[-1]])[0], ours=True)
        for rung in rungs[::-1]
    )
    return Contest(
        "trade",
        n,
        f"{capitalised(class_name(_class_of(n)))}, {sum(run.samples for run in asked.runs):,} rows",
        f"largest difference of a coefficient that the test tells from that of {rungs[-1]}, in its sd",
        "the way from rows to coefficients, of ours to the decision",
        (*ours, *_others(asked, n, seed, off)),
    )


def _others(asked: Problem, n: int, seed: int, off: Callable[[FloatArray], float]) -> Iterator[Entrant]:
    def rows() -> list[Linear]:
        return [linear_of(run, LIBRARY) for run in asked.runs]

    def means() -> FloatArray:
        return peers.numpy_lstsq(*stacked([dwells_of(one).means for one in rows()]))

    def ordinary() -> FloatArray:
        return peers.statsmodels_ols(*stacked(rows()))

    def sampled() -> Self:
        return _by_nuts(*stacked(rows()), seed)

    yield Entrant("lstsq", means, off, remark="numpy, on dwell means")
    if n <= MANY:
        yield Entrant("OLS", ordinary, off, ("statsmodels",), remark="statsmodels, on every row")
    if n <= FEW:
        yield Entrant("NUTS", sampled, off, ("nutpie", "arviz"), remark="nutpie, on every row")


def _by_nuts(X: FloatArray, y: FloatArray, seed: int) -> Self:
    """Means by NUTS under a flat prior with white noise of the size that least squares leaves.

    Coordinates are those of the triangular factor, so that the sampler has a standard problem.
    """
    moved = np.linalg.norm(X, axis=0) > 0.0
    Q, R = np.linalg.qr(X[:, moved])
    sd = np.linalg.norm(y - Q @ (Q.T @ y)) / np.sqrt(len(y) - R.shape[1])
    found: Any = peers.nuts(Q, y / sd, seed)
    theta = np.zeros(X.shape[1])
    theta[moved] = np.linalg.lstsq(R, sd * found.answer.mean(axis=0), rcond=None)[0]
    return Self(theta, found.seconds)
