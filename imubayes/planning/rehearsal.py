"""A plan carried out on simulated units, sample by sample, to see whether errors come out as predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import solve_triangular
from imubayes.inference.linear import Rows
from imubayes.inference.whiten import whiten, whitener
from imubayes.planning.candidates import Menu, Problem, Step, runs_of, starts
from imubayes.rig.simulate import synthesise

INTERVAL = 5.0
"""s; averaging time of a simulated sample."""

FEWEST = 8
"""Samples in a dwell, at least."""


def rehearsed(problem: Problem, steps: Sequence[Step], units: int, rng: np.random.Generator) -> FloatArray:
    """Errors (units, c) of the estimates, in units of the prior.

    Units and benches are drawn from the prior. Every noise process of every run is drawn sample by sample;
    samples, and not the means of dwells that a plan is weighed by, are whitened and fitted. What was known
    before counts as drawn with the prior.

    Parameters
    ----------
    problem, steps : plan.
    units : how many.
    rng : draws units, benches and noise.
    """
    c = len(problem.start)
    known = problem.start
    truth = solve_triangular(known, rng.standard_normal((c, units)))
    tables = [np.column_stack((known, np.zeros((c, units))))]
    for k, part in runs_of(steps):
        tables.append(_run(problem.menus[k], part, truth, rng))
    R = np.asarray(np.linalg.qr(np.concatenate(tables), mode="r"))
    return (solve_triangular(R[:c, :c], R[:c, c:]) - truth).T


def _run(menu: Menu, steps: Sequence[Step], truth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Whitened rows ``[X y ...]`` of a run, with a response for each unit."""
    interval = min(INTERVAL, min(step.dwell for step in steps) / FEWEST)
    counts = [int(step.dwell / interval) for step in steps]
    begin = starts([menu], [replace(step, menu=0) for step in steps]).tolist()
    within = [start + interval * (0.5 + np.arange(n)) for start, n in zip(begin, counts, strict=True)]
    t = np.concatenate(within)
    X = menu.X[np.repeat([step.setting for step in steps], counts)]
    noise = np.column_stack([synthesise(menu.noise, t, interval, rng) for _ in range(truth.shape[1])])
    rows = Rows(t, np.full(len(t), interval))
    return whiten(whitener(menu.noise, rows), np.ascontiguousarray(np.column_stack((X, X @ truth + noise))))
