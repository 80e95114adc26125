"""What a class needs, of itself and in a scene: the rules for all that is said, drawn and counted of it.

*Needed* is what the tests of the units show, and *not needed* too. Where the tests of most units leave a term
open, the class has no answer, *cannot tell*, unless all units together show it: their estimates then scatter
more than their errors do (`pooled`).

Of drawn units, and of a fleet, there is one verdict each, and half of the units decide
(`PopulationTerm.answer`). What an open term takes of a scene's budget is then what the catalogue says of its
size; where that counts, it *would matter* (`MissionTerm.answer`). Recorded units have one in every session: a
unit's answer is what its sessions say where they do not contradict each other, and the class's that of its
units, beside what all show together (`class_need`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.inference import Share, frequency
from imubayes.population import Record
from imubayes.population.pooled import Pooled, over_lots
from imubayes.scenes.relevance import MATTERS
from imubayes.selection import verdicts
from imubayes.sensors import SensorClass
from imubayes.units import counted

NEEDED, NOT_NEEDED, UNTOLD, WOULD_MATTER = "needed", "not needed", "cannot tell", "would matter"

VERDICTS = ("needed", "not needed", "undecided", *verdicts.UNSEEN)
"""Verdicts of a unit in the order in which they are counted."""

SURE, CANNOT_TELL = frozenset(VERDICTS[:2]), frozenset(verdicts.UNSEEN)
"""Verdicts by which a test has an answer, and by which it has none."""

OPEN = CANNOT_TELL | {"undecided"}
"""Verdicts of a unit that leave a term open."""

HALF = 0.5
"""Share of the units from which a class is said to be as they are."""

TIE = 1e-9
"""Rounding of shares that are sums of counts over units."""


@dataclass(frozen=True, slots=True)
class InLot:
    """One term over the units of a lot, SI: how many need it, and how many leave it open.

    Mean and spread of the population are a hierarchical posterior over the units; the true ones, of the lot
    that was simulated, are NaN for recorded units.
    """

    needed: int
    open: int
    mean: Share
    spread: Share
    true_mean: float = math.nan
    true_spread: float = math.nan


@dataclass(frozen=True, slots=True)
class PopulationTerm:
    """One term over the units of a class, SI: so many of each lot, lot by lot, and `pooled` over all.

    `needed` and `hidden` are shares of the units: in which it is needed, and whose test cannot tell or leaves
    it undecided; `open` is the latter without its interval. Mean and spread, also the true ones, are those of
    a lot; of several the middle one's, and with it the lowest and the highest.
    """

    name: str
    units: int
    lots: tuple[InLot, ...]
    pooled: Pooled

    @property
    def answer(self) -> str:
        """Whether the class needs it: what most of those units say whose tests tell.

        Where half of the tests or more leave it open, all units together may still show that most have it.
        """
        if self.open >= HALF:
            return NEEDED if most_have_it(self.pooled) else UNTOLD
        return NEEDED if self.needed.value + TIE >= HALF * (1.0 - self.open) else NOT_NEEDED

    @property
    def needed_by_lot(self) -> tuple[float, ...]:
        """Share of the units of each lot in which it is needed."""
        return tuple(lot.needed / self.units for lot in self.lots)

    @property
    def needed(self) -> Share:  # noqa: D102 - above
        return over_lots(tuple(lot.needed for lot in self.lots), self.units)

    @property
    def hidden(self) -> Share:  # noqa: D102 - above
        return over_lots(tuple(lot.open for lot in self.lots), self.units)

    @property
    def open(self) -> float:  # noqa: D102 - above
        return self.hidden.value

    @property
    def mean(self) -> Share:  # noqa: D102 - above
        return _middle([lot.mean for lot in self.lots])

    @property
    def spread(self) -> Share:  # noqa: D102 - above
        return _middle([lot.spread for lot in self.lots])

    @property
    def true_mean(self) -> float:  # noqa: D102 - above
        return float(np.median([lot.true_mean for lot in self.lots]))

    @property
    def true_spread(self) -> float:  # noqa: D102 - above
        return float(np.median([lot.true_spread for lot in self.lots]))


@dataclass(frozen=True, slots=True)
class MissionTerm:
    """One term of a class in one scene.

    Attributes
    ----------
    known : what the class's units say of it.
    rms : median over units of its rms effect on the output, SI.
    share : median over units of its share of the budget, and the 5 % and 95 % quantiles over units.
    required : share of the units whose smallest model for the scene has it, shown by the test or not.
    true_share : median over units of the share of the budget that the simulated truth takes, when the scene
        is flown with it and without it (`scenes.navigator`).
    most_of_budget : at the size that a further unit stays below with 95 % (`pooled.Pooled`).
    linear_share : of the same truth as `true_share`, by the linear propagation that the other shares are by.
    held : units whose own 90 % interval of their share holds what the navigator makes of their truth, and
        what the linear propagation does.
    seen : units whose test leaves less than `lots.SEEN` open, and of these the ones whose interval holds what
        the linear propagation makes of their truth.
    """

    known: PopulationTerm
    rms: float
    share: Share
    required: float
    true_share: float
    most_of_budget: float = math.nan
    linear_share: float = math.nan
    held: tuple[int, int] = (0, 0)
    seen: tuple[int, int] = (0, 0)

    @property
    def name(self) -> str:
        """Of the term."""
        return self.known.name

    @property
    def answer(self) -> str:
        """Whether the scene requires it of the class.

        It is needed where the class needs it and the smallest model of half of the units or more has it. A
        term that the tests do not show would matter if these models have it all the same, or if it takes
        `relevance.MATTERS` of the budget or more: by the sizes that the catalogue gives it. If it would not,
        they cannot tell.
        """
        told, wanted = self.known.answer, self.required >= HALF
        if told == NEEDED:
            return NEEDED if wanted else NOT_NEEDED
        if wanted or (told == UNTOLD and self.share.value >= MATTERS):
            return WOULD_MATTER
        return told


@dataclass(frozen=True, slots=True, eq=False)
class MissionFound:
    """A class in one scene.

    `order` is the number of terms that a unit's own smallest model has, median and 90 % range over units,
    `tested_order` the same where the terms kept take up the others over the inputs of the unit's test.
    `within` is the share of the units for which a model within the budget was found; `noise_share` and
    `basic_share` are median shares of the budget that noise takes, and that a triad of twelve parameters
    leaves (NaN where not asked). `beyond` is where the linear propagation ends (`lots.linear_end`).
    """

    name: str
    terms: tuple[MissionTerm, ...]
    order: Share
    tested_order: Share
    within: float
    noise_share: float
    basic_share: float
    beyond: tuple[float, float] = (math.inf, math.inf)

    def answered(self, answer: str) -> tuple[str, ...]:
        """Terms of which the class has this answer in the scene."""
        return tuple(term.name for term in self.terms if term.answer == answer)


@dataclass(frozen=True, slots=True, eq=False)
class ClassFound:
    """What the drawn units of a class say of it: one by one, by term, and by scene.

    `order` is the number of needed terms of a unit, median and 90 % range over units.
    """

    sensor_class: SensorClass
    units: tuple[Record, ...]
    terms: tuple[PopulationTerm, ...]
    order: Share
    missions: tuple[MissionFound, ...]

    def answered(self, answer: str) -> tuple[str, ...]:
        """Terms of which the class has this answer."""
        return tuple(term.name for term in self.terms if term.answer == answer)


def most_have_it(pooled: Pooled) -> bool:
    """Whether all units together show that most of them have a term."""
    return pooled.inclusion >= verdicts.NEEDED and pooled.share.value >= HALF


def _middle(lots: Sequence[Share]) -> Share:
    """Of several lots the middle value, the lowest and the highest; one lot's own interval."""
    values = [share.value for share in lots]
    return Share(float(np.median(values)), min(values), max(values)) if len(lots) > 1 else lots[0]


def could_change(term: PopulationTerm) -> bool:
    """Whether the answer of a class could be another one with other units, or lots where there are several.

    It could where the 90 % interval of a share of units that it rests on reaches across one half.
    """
    if term.answer == UNTOLD:
        return term.hidden.low < HALF
    if term.open >= HALF:
        return term.pooled.share.low < HALF
    # of the units that tell, what most of them say
    told, needed = [term.units - lot.open for lot in term.lots], [lot.needed for lot in term.lots]
    most = needed if term.answer == NEEDED else [n - k for n, k in zip(told, needed, strict=True)]
    return term.hidden.high >= HALF or over_lots(tuple(most), tuple(told)).low < HALF


@dataclass(frozen=True, slots=True)
class Need:
    """Whether a class needs a term: the verdict, and its reason in words, made from the numbers.

    `answers` counts the units that gave each answer; `share` is of the units that answer those that need the
    term, and its interval reaches as far as those that do not answer may be either. `pooled` is what all
    units and sessions say together; None where too few tell of it.
    """

    verdict: str
    reason: str
    answers: Mapping[str, int]
    share: Share
    pooled: Pooled | None


def unit_answer(told: Sequence[str]) -> str:
    """Answer of one unit from the verdicts of its sessions.

    Examples
    --------
    >>> unit_answer(["needed", "unresolved", "needed"]), unit_answer(["needed", "not needed"])
    ('needed', 'undecided')
    >>> unit_answer(["inseparable", "inseparable", "unresolved"])
    'inseparable'
    """
    sure = sorted(SURE.intersection(told))
    if len(sure) == 1:
        return sure[0]
    if sure or "undecided" in told:
        return "undecided"
    return Counter(told).most_common(1)[0][0]


def class_need(answers: Sequence[str], pooled: Pooled | None) -> Need:
    """Put the answers of the units of a class together (`Need`).

    Examples
    --------
    >>> need = class_need(["needed"] * 7 + ["inseparable"], None)
    >>> need.verdict, need.share.value, round(need.share.low, 2), need.share.high
    ('needed', 1.0, 0.6, 1.0)
    """
    counts = Counter(answers)
    n, needed, not_needed = len(answers), counts["needed"], counts["not needed"]
    sure = needed + not_needed
    value = needed / sure if sure else math.nan
    share = Share(value, frequency(needed, n).low, frequency(n - not_needed, n).high)
    verdict, reason = _decided(counts, n, pooled)
    return Need(verdict, reason, dict(counts.most_common()), share, pooled)


def _decided(counts: Mapping[str, int], n: int, pooled: Pooled | None) -> tuple[str, str]:
    needed, not_needed = counts.get("needed", 0), counts.get("not needed", 0)
    silent = sum(counts.get(word, 0) for word in CANNOT_TELL)
    if silent > HALF * n:
        if pooled and most_have_it(pooled):
            return "needed", f"all units together show it: probability {pooled.inclusion:.3f}"
        most = max(sorted(CANNOT_TELL), key=lambda word: counts.get(word, 0))
        return (
            "cannot tell",
            f"{most} in {counts[most]} of {counted(n, 'unit')}, and all together do not show it",
        )
    said = f"{needed} of {counted(n, 'unit')} need{'s' if needed == 1 else ''} it, {not_needed} do not"
    said += f"; the class has it with {pooled.inclusion:.3f}" if pooled else ""
    if needed > HALF * n:
        return "needed", said
    if not_needed > HALF * n and not needed and (pooled is None or pooled.inclusion <= verdicts.LIKELY):
        return "not needed", said
    if needed and not_needed:
        return "some need it", said
    return "undecided", said
