"""How often each method is wrong, and how well its strengths foretell the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from imubayes.errors import InputError
from studies.decision_quality.questions import OPEN, Interval, Questions, questions
from studies.decision_quality.trials import STRONG, Trial

EDGES = (0.0, 1.0, 2.0, 4.0, STRONG, np.inf)
"""Bins of effect over noise."""

BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)
"""Bins of inclusion, for its calibration."""

RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 19.0)
"""Costs of a false keep over that of a false drop that the methods are compared at."""

CLIP = 1e-3
"""A strength counts as if it were at least this far from 0 and 1 in the log score: nobody is that sure."""

DRAWS = 2000
"""Bootstrap samples of the sensors."""


@dataclass(frozen=True, slots=True)
class MethodScore:
    """How good a method is.

    Attributes
    ----------
    method : its name.
    false_keeps : share of the zero terms that it keeps.
    false_drops : share of the true terms that it drops, in each bin of `EDGES`.
    cost : false keeps and false drops for each sensor, at equal costs.
    excess : its cost minus the decision's, sensor by sensor.
    brier, log : mean squared error, and mean of -ln, of the strength given the truth; lower is better.
    weighed : its cost at each of `RATIOS`, a false drop costing 1. The decision then has the threshold that
        follows from the ratio; the others know of no costs.
    weighed_excess : that cost minus the decision's.
    opened : its cost where a term may be left open at `OPEN` of an error: the decision's by its verdicts, the
        others' between the same thresholds of their strengths.
    opened_excess : that cost minus the decision's.
    """

    method: str
    false_keeps: Interval
    false_drops: tuple[Interval, ...]
    cost: Interval
    excess: Interval
    brier: Interval
    log: Interval
    weighed: tuple[Interval, ...]
    weighed_excess: tuple[Interval, ...]
    opened: Interval
    opened_excess: Interval


@dataclass(frozen=True, slots=True)
class Calibration:
    """Of the terms that the decision includes with a probability in a bin, the share that is true."""

    low: float
    high: float
    inclusion: float
    true: Interval


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts needed and not needed of a method, which may leave a term open.

    Those of a method that has none but a strength are at the same thresholds of that.

    Attributes
    ----------
    false_keeps : share of the zero terms that are called needed.
    false_drops : share of the terms above `STRONG` that are called not needed.
    missed : share of all true terms that are.
    left, left_strong : share of all terms, and of those above `STRONG`, that are left open.
    rms, largest : pull of so many (`pulls`) that have a verdict, sd; NaN for a method without coefficients.
    """

    method: str
    false_keeps: Interval
    false_drops: Interval
    missed: Interval
    left: Interval
    left_strong: Interval
    rms: float
    largest: float
    pulls: int


@dataclass(frozen=True, slots=True)
class Treated:
    """Verdicts of every method under one treatment: of so many sensors, zero terms and true ones.

    `refused` says why the analysis refused sensors, whose terms then are all left open.
    """

    treatment: str
    sensors: int
    zero: int
    true: int
    refused: tuple[str, ...]
    verdicts: tuple[Verdicts, ...]

    def of(self, method: str) -> Verdicts:
        """Verdicts of one method."""
        return next(one for one in self.verdicts if one.method == method)


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of every method under one treatment, the decision first.

    There were so many sensors, zero terms and true ones. Calibration is that of the decision's inclusion,
    verdicts are the decision's; `nothing` is the cost for each sensor of leaving every term open.
    """

    treatment: str
    sensors: int
    zero: int
    true: int
    methods: tuple[MethodScore, ...]
    calibration: tuple[Calibration, ...]
    verdicts: Verdicts
    nothing: Interval

    def of(self, method: str) -> MethodScore:
        """Score of one method."""
        return next(score for score in self.methods if score.method == method)


def scores(trials: Sequence[Trial], treatment: str, *, rng: np.random.Generator) -> Scores:
    """Score every method on the sensors of one treatment; `rng` is for the bootstrap."""
    asked = _asked(trials, treatment, rng)
    return Scores(
        **_counts(treatment, asked),
        methods=tuple(_score(name, k, asked) for k, name in enumerate(asked.methods)),
        calibration=_calibration(asked),
        verdicts=_verdicts(0, asked),
        nothing=asked.each(np.full(len(asked.true), OPEN)),
    )


def treated(trials: Sequence[Trial], treatment: str, *, rng: np.random.Generator) -> Treated:
    """What the verdicts of every method are worth under one treatment."""
    asked = _asked(trials, treatment, rng)
    return Treated(
        **_counts(treatment, asked),
        refused=tuple(t.refused for t in trials if t.treatment == treatment and t.refused),
        verdicts=tuple(_verdicts(k, asked) for k in range(len(asked.methods))),
    )


def _asked(trials: Sequence[Trial], treatment: str, rng: np.random.Generator) -> Questions:
    taken = [t for t in trials if t.treatment == treatment]
    if not taken:
        raise InputError(f"no sensor was tried under '{treatment}': nothing can be scored")
    weights = rng.multinomial(len(taken), np.full(len(taken), 1.0 / len(taken)), DRAWS).astype(float)
    return questions(taken, weights)


def _counts(treatment: str, asked: Questions) -> dict[str, Any]:
    """Treatment, and how many sensors, zero terms and true terms were asked about."""
    true = int(np.sum(asked.true))
    counts = {"sensors": asked.weights.shape[1], "zero": len(asked.true) - true, "true": true}
    return {"treatment": treatment, **counts}


def _score(name: str, k: int, asked: Questions) -> MethodScore:
    """Score of the method in row `k`; the decision is in row 0."""
    wrong = asked.wrong(k)
    strength, said = asked.strength[k], ~np.isnan(asked.strength[k])
    sure = np.clip(np.where(asked.true, strength, 1.0 - strength), CLIP, 1.0 - CLIP)
    bins = [asked.true & (asked.effect >= a) & (asked.effect < b) for a, b in pairwise(EDGES)]
    return MethodScore(
        method=name,
        false_keeps=asked.share(wrong, ~asked.true),
        false_drops=tuple(asked.share(wrong, inside) for inside in bins),
        cost=asked.each(wrong),
        excess=asked.each(wrong - asked.wrong(0)),
        brier=asked.mean((strength - asked.true) ** 2, said),
        log=asked.mean(-np.log(sure), said),
        weighed=tuple(asked.each(asked.weighed(k, r)) for r in RATIOS),
        weighed_excess=tuple(asked.each(asked.weighed(k, r) - asked.weighed(0, r)) for r in RATIOS),
        opened=asked.each(asked.opened(k)),
        opened_excess=asked.each(asked.opened(k) - asked.opened(0)),
    )


def _verdicts(k: int, asked: Questions) -> Verdicts:
    """What the method in row `k` calls needed, not needed, and leaves open."""
    left = np.isnan(asked.said[k])
    wrong = np.where(left, 0.0, asked.errs(asked.said[k]))
    strong, every = asked.true & (asked.effect >= STRONG), np.ones(len(asked.true), dtype=bool)
    pull = asked.pull[k][~np.isnan(asked.pull[k])]
    return Verdicts(
        method=asked.methods[k],
        false_keeps=asked.share(wrong, ~asked.true),
        false_drops=asked.share(wrong, strong),
        missed=asked.share(wrong, asked.true),
        left=asked.share(left.astype(float), every),
        left_strong=asked.share(left.astype(float), strong),
        rms=math.sqrt(np.mean(pull**2)) if len(pull) else math.nan,
        largest=float(np.abs(pull).max(initial=math.nan if not len(pull) else 0.0)),
        pulls=len(pull),
    )


def _calibration(asked: Questions) -> tuple[Calibration, ...]:
    """Inclusion by the decision, in row 0, against the truth."""
    inclusion = asked.strength[0]
    told = []
    for low, high in pairwise(BINS):
        inside = (inclusion >= low) & ((inclusion < high) | (high == BINS[-1]))
        if inside.any():
            true = asked.share(asked.true.astype(float), inside)
            told.append(Calibration(low, high, float(inclusion[inside].mean()), true))
    return tuple(told)
