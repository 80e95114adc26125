"""How often each method is wrong, and how well its strengths foretell the truth, with intervals over sensors.

Terms of one sensor share its noise, so intervals are bootstrapped over sensors (2.5 % to 97.5 %). Where few
errors were seen, a bootstrap knows too little: the interval of a rate holds Clopper and Pearson's too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from imubayes.errors import InputError
from imubayes.quality.trials import DECISION, STRONG, SURE, Trial
from imubayes.selection.verdicts import ODDS, Costs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

EDGES = (0.0, 1.0, 2.0, 4.0, STRONG, np.inf)
"""Bins of effect over noise."""

BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)
"""Bins of inclusion, for its calibration."""

RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 19.0)
"""Costs of a false keep over that of a false drop that the methods are compared at."""

CLIP = 1e-3
"""A strength counts as if it were at least this far from 0 and 1 in the log score: nobody is that sure."""

OPEN = 1.0 / (1.0 + ODDS)
"""Cost of leaving a term open over that of a wrong choice: the one at which the thresholds of the verdicts,
0.95 and 0.05, cost least (the reject option of Chow, 1970)."""

DRAWS = 2000
"""Bootstrap samples of the sensors."""

JOINT = "+"
"""Between the names of terms that are asked for together."""

LEVELS = (2.5, 97.5)
"""Percentages between which an interval lies."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; NaN where there is nothing to measure.

    Attributes
    ----------
    value, low, high : of the quantity.
    events, of : for a rate, how often it happened and out of how many; 0 for what is no rate.
    """

    value: float
    low: float
    high: float
    events: int = 0
    of: int = 0


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
    group_keeps : share of the groups without a true term from which it keeps one.
    group_drops : share of the groups with a true term from which it keeps none, where together they have an
        effect above `STRONG`.
    group_cost : as `cost`, but with a group as one question: is any of its terms there?
    weighed : its cost at each of `RATIOS`, a false drop costing 1. The decision then has the threshold that
        follows from the ratio; the others know of no costs.
    weighed_excess : that cost minus the decision's.
    """

    method: str
    false_keeps: Interval
    false_drops: tuple[Interval, ...]
    cost: Interval
    excess: Interval
    brier: Interval
    log: Interval
    group_keeps: Interval
    group_drops: Interval
    group_cost: Interval
    weighed: tuple[Interval, ...]
    weighed_excess: tuple[Interval, ...]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Of the terms that the decision includes with a probability in a bin, the share that is true."""

    low: float
    high: float
    inclusion: float
    true: Interval


@dataclass(frozen=True, slots=True)
class Careful:
    """The decision where a false keep costs `ratio` times a false drop.

    Attributes
    ----------
    ratio, threshold : of the costs, and the inclusion from which a term is kept.
    false_keeps, false_drops : as in `MethodScore`, the drops above `STRONG`.
    """

    ratio: float
    threshold: float
    false_keeps: Interval
    false_drops: Interval


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts needed and not needed, where a term may be left open.

    Attributes
    ----------
    false_keeps : share of the zero terms that are called needed.
    false_drops : share of the terms above `STRONG` that are called not needed.
    left, left_strong : share of all terms, and of those above `STRONG`, that are left open.
    cost : for each sensor: a wrong verdict costs 1, a term left open `OPEN`.
    rival, lead : the method that costs least beside it, and how much more it costs.
    price : of a term left open, at which the two would cost the same.
    """

    false_keeps: Interval
    false_drops: Interval
    left: Interval
    left_strong: Interval
    cost: Interval
    rival: str
    lead: Interval
    price: float


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of every method under one treatment.

    Attributes
    ----------
    treatment : of the sensors.
    kind : of the sensors; empty for both.
    sensors, zero, true, groups : how many sensors, zero terms, true terms and groups of inseparable ones.
    methods : scores, the decision first.
    calibration : of the decision's inclusion.
    careful : the decision at each of `RATIOS`.
    verdicts : the decision where it may leave a term open.
    """

    treatment: str
    kind: str
    sensors: int
    zero: int
    true: int
    groups: int
    methods: tuple[MethodScore, ...]
    calibration: tuple[Calibration, ...]
    careful: tuple[Careful, ...]
    verdicts: Verdicts

    def of(self, method: str) -> MethodScore:
        """Score of one method."""
        return next(score for score in self.methods if score.method == method)


@dataclass(frozen=True, slots=True, eq=False)
class _Questions:
    """What was asked: whether a term (or any of a group) is there.

    Attributes
    ----------
    sensor : (n,) index of the sensor of each question.
    weights : (draws, sensors) how often each sensor is in a bootstrap sample.
    true : (n,) the truth.
    effect : (n,) over noise.
    several : (n,) whether it is a group that was asked for.
    keeps, strength : (m, n) of each method.
    verdict : (n,) 1 for needed, 0 for not needed, NaN for left open.
    """

    sensor: NDArray[np.int64]
    weights: FloatArray
    true: BoolArray
    effect: FloatArray
    several: BoolArray
    keeps: FloatArray
    strength: FloatArray
    verdict: FloatArray

    def errs(self, keeps: FloatArray) -> FloatArray:
        """Where keeping `keeps` (n,) is wrong: (n,) of 0 and 1."""
        return np.where(self.true, 1.0 - keeps, keeps)

    def wrong(self, k: int) -> FloatArray:
        """Where method `k` errs: (n,) of 0 and 1."""
        return self.errs(self.keeps[k])

    def decided(self, ratio: float) -> FloatArray:
        """What the decision, in row 0, keeps where a false keep costs `ratio` times a false drop."""
        return (self.strength[0] >= Costs(ratio, 1.0).keep).astype(float)

    def weighed(self, k: int, ratio: float) -> FloatArray:
        """Cost (n,) of what method `k` keeps, a false drop costing 1."""
        wrong = self.errs(self.decided(ratio) if k == 0 else self.keeps[k])
        return np.where(self.true, 1.0, ratio) * wrong

    def share(self, wrong: FloatArray, of: BoolArray) -> Interval:
        """Rate of `wrong` (n,) among the questions `of` (n,), with its interval."""
        mean = self.mean(wrong, of)
        events, total = int(np.sum(wrong[of])), int(np.sum(of))
        low, high = _clopper_pearson(events, total)
        return Interval(mean.value, min(mean.low, low), max(mean.high, high), events, total)

    def mean(self, value: FloatArray, of: BoolArray) -> Interval:
        """Mean of `value` (n,) over the questions `of` (n,), with its interval."""
        top, bottom = self._by_sensor(np.where(of, value, 0.0)), self._by_sensor(of.astype(float))
        return _ratio(top, bottom, self.weights)

    def each(self, value: FloatArray) -> Interval:
        """Sum of `value` (n,) for each sensor, with its interval."""
        return _ratio(self._by_sensor(value), np.ones(self.weights.shape[1]), self.weights)

    def _by_sensor(self, value: FloatArray) -> FloatArray:
        return np.bincount(self.sensor, weights=value, minlength=self.weights.shape[1]).astype(float)


def scores(trials: Sequence[Trial], treatment: str, kind: str = "", *, rng: np.random.Generator) -> Scores:
    """Score every method on the sensors of one treatment.

    Parameters
    ----------
    trials : of any treatments.
    treatment : to score.
    kind : of sensors to take; empty for both.
    rng : of the bootstrap.

    Raises
    ------
    InputError : if there is no such trial.
    """
    taken = [t for t in trials if t.treatment == treatment and kind in ("", t.kind)]
    if not taken:
        raise InputError(f"no {kind or 'sensor'} was tried under '{treatment}': nothing can be scored")
    weights = rng.multinomial(len(taken), np.full(len(taken), 1.0 / len(taken)), DRAWS).astype(float)
    single, grouped = _questions(taken, weights), _questions([_with_groups(t) for t in taken], weights)
    return Scores(
        treatment=treatment,
        kind=kind,
        sensors=len(taken),
        zero=int(np.sum(~single.true)),
        true=int(np.sum(single.true)),
        groups=sum(len(t.groups) for t in taken),
        methods=tuple(_score(name, k, single, grouped) for k, name in enumerate(taken[0].methods)),
        calibration=_calibration(single),
        careful=tuple(_careful(single, ratio) for ratio in RATIOS),
        verdicts=_verdicts(single, taken[0].methods),
    )


def _questions(taken: Sequence[Trial], weights: FloatArray) -> _Questions:
    """Every term as a question of its own."""
    return _Questions(
        sensor=np.repeat(np.arange(len(taken)), [len(t.terms) for t in taken]),
        weights=weights,
        true=np.concatenate([t.truth != 0.0 for t in taken]),
        effect=np.concatenate([t.effect for t in taken]),
        several=np.array([JOINT in name for t in taken for name in t.terms]),
        keeps=np.hstack([t.keeps for t in taken]),
        strength=np.hstack([t.strength for t in taken]),
        verdict=np.concatenate([t.verdict for t in taken]),
    )


def _with_groups(t: Trial) -> Trial:
    """Trial in which each group is one term: kept where any is, true where any is."""
    inside = {k for group in t.groups for k in group}
    alone = [k for k in range(len(t.terms)) if k not in inside]
    where = [*([k] for k in alone), *(list(group) for group in t.groups)]
    return replace(
        t,
        terms=tuple(JOINT.join(t.terms[k] for k in group) for group in where),
        truth=np.array([np.abs(t.truth[group]).max() for group in where]),
        effect=np.concatenate((t.effect[alone], t.group_effect)),
        keeps=np.array([t.keeps[:, group].max(axis=1) for group in where]).T,
        strength=np.array([t.strength[:, group].max(axis=1) for group in where]).T,
        verdict=np.array([t.verdict[group].max() for group in where]),
    )


def _score(name: str, k: int, single: _Questions, grouped: _Questions) -> MethodScore:
    """Score of the method in row `k`; the decision is in row 0."""
    wrong, wrong_group = single.wrong(k), grouped.wrong(k)
    strength, said = single.strength[k], ~np.isnan(single.strength[k])
    sure = np.clip(np.where(single.true, strength, 1.0 - strength), CLIP, 1.0 - CLIP)
    bins = [single.true & (single.effect >= a) & (single.effect < b) for a, b in pairwise(EDGES)]
    strong = grouped.several & grouped.true & (grouped.effect >= STRONG)
    return MethodScore(
        method=name,
        false_keeps=single.share(wrong, ~single.true),
        false_drops=tuple(single.share(wrong, inside) for inside in bins),
        cost=single.each(wrong),
        excess=single.each(wrong - single.wrong(0)),
        brier=single.mean((strength - single.true) ** 2, said),
        log=single.mean(-np.log(sure), said),
        group_keeps=grouped.share(wrong_group, grouped.several & ~grouped.true),
        group_drops=grouped.share(wrong_group, strong),
        group_cost=grouped.each(wrong_group),
        weighed=tuple(single.each(single.weighed(k, r)) for r in RATIOS),
        weighed_excess=tuple(single.each(single.weighed(k, r) - single.weighed(0, r)) for r in RATIOS),
    )


def _careful(asked: _Questions, ratio: float) -> Careful:
    """Return the decision, in row 0, at a ratio of costs."""
    wrong = asked.errs(asked.decided(ratio))
    strong = asked.true & (asked.effect >= STRONG)
    threshold = Costs(ratio, 1.0).keep
    return Careful(ratio, threshold, asked.share(wrong, ~asked.true), asked.share(wrong, strong))


def _verdicts(asked: _Questions, methods: Sequence[str]) -> Verdicts:
    """Return the decision's verdicts against the best of the methods that leave nothing open."""
    left = np.isnan(asked.verdict)
    wrong = np.where(left, 0.0, asked.errs(asked.verdict))
    strong, every = asked.true & (asked.effect >= STRONG), np.ones(len(asked.true), dtype=bool)
    rivals = [k for k, name in enumerate(methods) if name not in (DECISION, SURE)]
    best = min(rivals, key=lambda k: float(asked.wrong(k).sum()))
    own = wrong + OPEN * left
    return Verdicts(
        false_keeps=asked.share(wrong, ~asked.true),
        false_drops=asked.share(wrong, strong),
        left=asked.share(left.astype(float), every),
        left_strong=asked.share(left.astype(float), strong),
        cost=asked.each(own),
        rival=methods[best],
        lead=asked.each(asked.wrong(best) - own),
        price=float((asked.wrong(best) - wrong).sum() / left.sum()) if left.any() else math.inf,
    )


def _calibration(asked: _Questions) -> tuple[Calibration, ...]:
    """Inclusion by the decision, in row 0, against the truth."""
    inclusion = asked.strength[0]
    told = []
    for low, high in pairwise(BINS):
        inside = (inclusion >= low) & ((inclusion < high) | (high == BINS[-1]))
        if inside.any():
            true = asked.share(asked.true.astype(float), inside)
            told.append(Calibration(low, high, float(inclusion[inside].mean()), true))
    return tuple(told)


def _ratio(top: FloatArray, bottom: FloatArray, weights: FloatArray) -> Interval:
    """Sum of `top` over the sum of `bottom` (sensors,), with the interval of its bootstrap samples."""
    if not bottom.any():
        return Interval(math.nan, math.nan, math.nan)
    drawn = weights @ bottom
    samples = (weights @ top)[drawn > 0.0] / drawn[drawn > 0.0]
    low, high = np.percentile(samples, LEVELS)
    return Interval(float(top.sum() / bottom.sum()), float(low), float(high))


def _clopper_pearson(events: int, total: int) -> tuple[float, float]:
    """Interval of a rate from independent trials, exact at any number of events.

    Examples
    --------
    >>> low, high = _clopper_pearson(0, 100)
    >>> low, round(high, 4)
    (0.0, 0.0362)
    """
    if total == 0:
        return math.nan, math.nan
    first, last = (level / 100.0 for level in LEVELS)
    low = float(beta.ppf(first, events, total - events + 1)) if events else 0.0
    high = float(beta.ppf(last, events + 1, total - events)) if events < total else 1.0
    return low, high
