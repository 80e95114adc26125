"""Which terms a class needs: the answers of its units, put together.

Every session of a unit has its verdict on a term. The unit's answer is what its sessions say where they do
not contradict each other; the class's is that of its units, beside the inclusion in one model for all of them
(`pooled`). Where most units' tests cannot tell, more units of the same test cannot tell either: what each of
them leaves to the prior adds up to the prior's width, not to knowledge. That is an answer of its own.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.intervals import Share, frequency
from imubayes.inference.populations import Spreads
from imubayes.inference.sessions import Parameter
from imubayes.selection.verdicts import LIKELY, NEEDED
from imubayes.sensors.terms import Kind
from imubayes.units import counted

CANNOT_TELL = frozenset({"inseparable", "unresolved", "untested"})
"""Verdicts by which a test has no answer."""

SURE = frozenset({"needed", "not needed"})
"""Verdicts by which it has one."""

HALF = 0.5
"""Share of the units from which most of them say so."""


@dataclass(frozen=True, slots=True)
class Need:
    """Whether a class needs a term.

    Attributes
    ----------
    verdict : ``needed``, ``some need it``, ``not needed``, ``undecided`` or ``cannot tell``.
    reason : in words, made from the numbers.
    answers : how many units gave each answer.
    share : of the units that answer, those that need the term; its interval reaches as far as those that do
        not answer may be either.
    pooled : inclusion in one model for all units and sessions; None where it was not weighed.
    """

    verdict: str
    reason: str
    answers: Mapping[str, int]
    share: Share
    pooled: float | None


@dataclass(frozen=True, slots=True, eq=False)
class TermInClass:
    """One term of the units of a class.

    Attributes
    ----------
    parameter : its name, with the component of a triad (``ax.b0``) or for all of its axes together (``b0``).
    term, component : the two parts of that; the component is empty for all together.
    size : that the class gives the coefficient, SI: the prior's sd.
    spreads : mean and spreads of the population.
    units : (u,) names; of all axes together with their component.
    sessions : (s,) names.
    value, error : (u, s) each session's estimate without the prior, and its sd, SI; NaN where a unit lacks a
        session or a session cannot tell.
    need : whether the class needs the term.
    """

    parameter: Parameter
    term: str
    component: str
    size: float
    spreads: Spreads
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    value: FloatArray
    error: FloatArray
    need: Need

    @property
    def told(self) -> bool:
        """Whether enough units tell of the term for the population to be known."""
        return not math.isnan(self.spreads.unit.value)


@dataclass(frozen=True, slots=True, eq=False)
class ClassInCommon:
    """What the units of a class have in common.

    Attributes
    ----------
    class_id, kind : of the units.
    units, sessions : names.
    components : of a triad; one empty name for single components.
    terms : each term for all axes of a triad together, then for each of them.
    """

    class_id: str
    kind: Kind
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    components: tuple[str, ...]
    terms: tuple[TermInClass, ...]


def unit_answer(verdicts: Sequence[str]) -> str:
    """Answer of one unit from the verdicts of its sessions.

    Examples
    --------
    >>> unit_answer(["needed", "unresolved", "needed"]), unit_answer(["needed", "not needed"])
    ('needed', 'undecided')
    >>> unit_answer(["inseparable", "inseparable", "unresolved"])
    'inseparable'
    """
    sure = sorted(SURE.intersection(verdicts))
    if len(sure) == 1:
        return sure[0]
    if sure or "undecided" in verdicts:
        return "undecided"
    return Counter(verdicts).most_common(1)[0][0]


def class_need(answers: Sequence[str], pooled: float | None) -> Need:
    """Put the answers of the units of a class together.

    Parameters
    ----------
    answers : of each unit.
    pooled : inclusion in one model for all units; None where it was not weighed.

    Examples
    --------
    >>> need = class_need(["needed"] * 7 + ["inseparable"], 1.0)
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


def _decided(counts: Mapping[str, int], n: int, pooled: float | None) -> tuple[str, str]:
    needed, not_needed = counts.get("needed", 0), counts.get("not needed", 0)
    silent = sum(counts.get(word, 0) for word in CANNOT_TELL)
    if silent > HALF * n:
        most = max(sorted(CANNOT_TELL), key=lambda word: counts.get(word, 0))
        return (
            "cannot tell",
            f"{most} in {counts[most]} of {counted(n, 'unit')}: more units of this test do not tell it",
        )
    said = f"{needed} of {counted(n, 'unit')} need{'s' if needed == 1 else ''} it, {not_needed} do not"
    said += "" if pooled is None else f"; inclusion in one model for all {pooled:.3f}"
    if needed > HALF * n and (pooled is None or pooled >= NEEDED):
        return "needed", said
    if not_needed > HALF * n and not needed and (pooled is None or pooled <= LIKELY):
        return "not needed", said
    if needed and not_needed:
        return "some need it", said
    return "undecided", said
