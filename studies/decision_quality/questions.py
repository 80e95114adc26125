"""What is asked of a method: of each term, whether it is there.

Terms of one sensor share its noise, so intervals are bootstrapped over sensors (2.5 % to 97.5 %). Where few
errors were seen, a bootstrap knows too little: the interval of a rate holds Clopper and Pearson's too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from imubayes.algebra import BoolArray, FloatArray
from imubayes.selection.verdicts import ODDS, Costs
from studies.decision_quality.trials import Trial

OPEN = 1.0 / (1.0 + ODDS)
"""Cost of leaving a term open over that of a wrong choice: the one at which the thresholds of the verdicts,
0.95 and 0.05, cost least (the reject option of Chow, 1970)."""

LEVELS = (2.5, 97.5)
"""Percentages between which an interval lies."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval, NaN where nothing is measured; of a rate also its counts."""

    value: float
    low: float
    high: float
    events: int = 0
    of: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Questions:
    """What was asked: whether each of n terms is there.

    `sensor` (n,) is the index of the sensor of each question, `weights` (draws, sensors) how often each is in
    a bootstrap sample. Truth and effect over noise are (n,); `keeps`, `strength`, `said` and `pull` (m, n)
    are of each method, as in `Trial`.
    """

    methods: tuple[str, ...]
    sensor: NDArray[np.int64]
    weights: FloatArray
    true: BoolArray
    effect: FloatArray
    keeps: FloatArray
    strength: FloatArray
    said: FloatArray
    pull: FloatArray

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

    def opened(self, k: int) -> FloatArray:
        """Cost (n,) of method `k` where it may leave a term open: 1 for an error, `OPEN` for an open term."""
        return np.where(np.isnan(self.said[k]), OPEN, self.errs(self.said[k]))

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


def questions(taken: Sequence[Trial], weights: FloatArray) -> Questions:
    """Every term as a question of its own."""
    return Questions(
        methods=taken[0].methods,
        sensor=np.repeat(np.arange(len(taken)), [len(t.terms) for t in taken]),
        weights=weights,
        true=np.concatenate([t.truth != 0.0 for t in taken]),
        effect=np.concatenate([t.effect for t in taken]),
        keeps=np.hstack([t.keeps for t in taken]),
        strength=np.hstack([t.strength for t in taken]),
        said=np.hstack([t.said for t in taken]),
        pull=np.hstack([t.pull for t in taken]),
    )


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
