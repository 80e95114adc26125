"""What a class needs, of itself and in a scene: the rules for all that is said, drawn and counted of it.

*Needed* is what the tests of the units show, and *not needed* too. Where the tests of most units leave a term
open, the class has no answer, *cannot tell*, unless all units together show it: their estimates then scatter
more than their errors do (`pooled`).

Of drawn units, and of a fleet, there is one verdict each, and half of the units decide (`of_class`). What an
open term takes of a scene's budget is then what the catalogue says of its size; where that counts, it *would
matter*. Recorded units have one in every session: a unit's answer is what its sessions say where they do not
contradict each other, and the class's that of its units, beside what all show together (`class_need`).

Published statements on classes come with the catalogue (``[[statement]]`` in ``grades.toml``), and are held
against these answers (`judged`). The units of a study are drawn from the same catalogue, so that a statement
is confirmed for sensors of its sizes, by the tests and in the scenes of the study.

Other methods share the decision on simulated units or don't (`agreements`): they are held against it where it
is sure, needed or not needed. By the truth, of all terms that the test excites, a term kept is *false* where
the posterior sd of the test is larger than the true coefficient, and one left out is *missed* where that sd
is far smaller; what is between may be either.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.inference import Share, frequency
from imubayes.population import Record
from imubayes.population.pooled import Pooled, over_lots
from imubayes.scenes.relevance import MATTERS
from imubayes.selection import verdicts
from imubayes.sensors.catalogue_file import Table, packaged_tables
from imubayes.sensors.terms import Kind
from imubayes.units import counted, factor

if TYPE_CHECKING:
    from imubayes.population.lots import MissionFound, MissionTerm
    from imubayes.population.spreads import PopulationTerm
    from imubayes.sensors import SensorClass

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


def of_class(term: PopulationTerm) -> str:
    """Whether a class needs a term: what most of those units say whose tests tell.

    Where half of the tests or more leave it open, all units together may still show that most have it.
    """
    if term.open >= HALF:
        return NEEDED if most_have_it(term.pooled) else UNTOLD
    return NEEDED if term.needed.value + TIE >= HALF * (1.0 - term.open) else NOT_NEEDED


def most_have_it(pooled: Pooled) -> bool:
    """Whether all units together show that most of them have a term."""
    return pooled.inclusion >= verdicts.NEEDED and pooled.share.value >= HALF


def in_scene(term: MissionTerm) -> str:
    """Whether a scene requires a term of a class.

    It is needed where the class needs it and the smallest model of half of the units or more has it. A term
    that the tests do not show would matter if these models have it all the same, or if it takes
    `relevance.MATTERS` of the budget or more: by the sizes that the catalogue gives it. If it would not, they
    cannot tell.
    """
    told, wanted = term.known.answer, term.required >= HALF
    if told == NEEDED:
        return NEEDED if wanted else NOT_NEEDED
    if wanted or (told == UNTOLD and term.share.value >= MATTERS):
        return WOULD_MATTER
    return told


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


CONFIRMED, CONTRADICTED, BEYOND = "confirmed", "contradicted", "beyond the test"


@dataclass(frozen=True, slots=True)
class Judged:
    """A published statement, and what a study makes of it.

    Attributes
    ----------
    text, source : of the statement, in our words, and where it stands.
    claims : ``needed``, ``small``, ``size`` or ``open``.
    verdict : `CONTRADICTED` if it is for any class, else `CONFIRMED` if it is for any, else `BEYOND`.
    classes : verdict by id of each class that the statement is about and the study has.
    sizes : by id, for ``small`` the largest share of a scene's budget in the median unit, and the one that
        further units stay below with 95 %; for ``size`` lowest and highest, in `unit`.
    unit : of these sizes, "1" for shares.
    why : no study can tell; empty where one can.
    """

    text: str
    source: str
    claims: str
    verdict: str
    classes: dict[str, str]
    sizes: dict[str, tuple[float, float]]
    unit: str = "1"
    why: str = ""


def judged(kind: Kind, classes: Sequence[ClassFound]) -> tuple[Judged, ...]:
    """Hold the statements on sensors of a kind, and on classes of a study, against what it found of these."""
    known = {one.sensor_class.id: one for one in classes}
    return tuple(
        _judged(table, [known[name] for name in table["classes"] if name in known])
        for table in packaged_tables()["statement"]
        if table["kind"] == kind and set(table["classes"]) & set(known)
    )


def _judged(table: Table, classes: Sequence[ClassFound]) -> Judged:
    told: dict[str, str] = {}
    sizes: dict[str, tuple[float, float]] = {}
    for one in classes:
        name = one.sensor_class.id
        terms = [k for k, term in enumerate(one.terms) if term.name in table["terms"]]
        if not terms or (table["claims"] == "small" and not one.missions):
            told[name] = BEYOND
        elif table["claims"] == "needed":
            told[name] = _needed([one.terms[k].answer for k in terms])
        elif table["claims"] == "small":
            told[name], sizes[name] = _small(one, terms)
        else:
            told[name], sizes[name] = _size(one.terms[terms[0]], table["range"])
    why = table.get("why", "")
    if not (why or any(term.name in table["terms"] for one in classes for term in one.terms)):
        why = "no such term is in the study"
    verdict = next((word for word in (CONTRADICTED, CONFIRMED) if word in told.values()), BEYOND)
    unit = table["range"][-1] if table["claims"] == "size" else "1"
    return Judged(table["text"], table["source"], table["claims"], verdict, told, sizes, unit, why)


def _needed(answers: Sequence[str]) -> str:
    """Whether a class needs one of some terms, by its answers."""
    if NEEDED in answers:
        return CONFIRMED
    return CONTRADICTED if set(answers) == {NOT_NEEDED} else BEYOND


def _small(one: ClassFound, terms: Sequence[int]) -> tuple[str, tuple[float, float]]:
    """Whether each of some terms takes less than `MATTERS` of every scene's budget, and their largest."""
    cells = [scene.terms[k] for scene in one.missions for k in terms]
    shown = [cell.share.value for cell in cells if cell.known.answer == NEEDED]
    half, most = max(cell.share.value for cell in cells), max(cell.most_of_budget for cell in cells)
    if max(shown, default=0.0) >= MATTERS:
        return CONTRADICTED, (half, most)
    return CONFIRMED if most < MATTERS else BEYOND, (half, most)


def _size(term: PopulationTerm, stated: Sequence[object]) -> tuple[str, tuple[float, float]]:
    """Whether units of a class can have a size that is stated, and their sizes in its unit.

    They reach from the spread of a lot at the low end of its interval to mean and spread at their high ends.
    """
    low, high, unit = stated
    scale = factor(str(unit), like=str(unit))
    farthest = max(abs(term.mean.low), abs(term.mean.high))
    sizes = term.spread.low / scale, math.hypot(farthest, term.spread.high) / scale
    if term.answer == UNTOLD:
        return BEYOND, sizes
    return CONFIRMED if sizes[0] <= float(str(high)) and sizes[1] >= float(str(low)) else CONTRADICTED, sizes


SMALL = 1.0
"""Posterior sd below which a coefficient is too small for the test, so that 'needed' is a false alarm."""

LARGE = 8.0
"""Posterior sd above which no method should leave a term out."""

DECISION = "evidence"
"""Method that is the decision itself."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """One method over some units.

    Attributes
    ----------
    method : its name; that of the decision is `DECISION`.
    units : how many it was asked about.
    of : terms of units on which it has an answer, and the decision is sure.
    share : of these, those on which they agree.
    keeps, drops : how often it keeps what the decision drops, and drops what that keeps, by term.
    false, missed : how many terms it keeps that are in truth below `SMALL` sd of the test, and leaves out
        that are above `LARGE`; and how many such terms there are.
    """

    method: str
    units: int
    of: int
    share: Share
    keeps: Mapping[str, int]
    drops: Mapping[str, int]
    false: tuple[int, int]
    missed: tuple[int, int]


def agreements(units: Sequence[Record], names: tuple[str, ...]) -> tuple[Agreement, ...]:
    """Hold every method against the decision and the truth, over the units of simulated lots that have votes.

    `names` are the library's terms; without votes there is nothing.
    """
    asked = [unit for unit in units if unit.votes is not None]
    methods = dict.fromkeys(method for unit in asked if unit.votes for method in unit.votes.methods)
    size = np.array([np.abs(unit.truth) / unit.full_sd for unit in asked]).reshape(-1, len(names))
    # whether each keeps each term of each unit (n, p): 1 or 0, NaN where it says nothing
    told = {method: np.full((len(asked), len(names)), np.nan) for method in methods}
    for k, votes in enumerate(unit.votes for unit in asked if unit.votes):
        for method, keeps in zip(votes.methods, votes.keeps, strict=True):
            told[method][k, [names.index(term) for term in votes.terms]] = keeps
    verdicts = np.array([unit.verdicts for unit in asked]).reshape(-1, len(names))
    decided = np.where(verdicts == NEEDED, 1.0, np.where(verdicts == NOT_NEEDED, 0.0, np.nan))
    told[DECISION] = decided
    size[verdicts == "untested"] = np.nan
    return tuple(
        _agreement(method, names, answers, decided, size)
        for method, answers in told.items()
        if not np.isnan(answers).all()
    )


def _agreement(
    method: str, names: tuple[str, ...], answers: FloatArray, decided: FloatArray, size: FloatArray
) -> Agreement:
    both = ~np.isnan(answers) & ~np.isnan(decided)
    kept, same = answers == 1.0, both & (answers == decided)
    small, large = size < SMALL, size > LARGE
    of, alike = int(both.sum()), int(same.sum())
    return Agreement(
        method=method,
        units=int((~np.isnan(answers)).any(axis=1).sum()),
        of=of,
        share=frequency(alike, of),
        keeps=_by_term(both & ~same & kept, names),
        drops=_by_term(both & ~same & ~kept, names),
        false=(int((small & kept).sum()), int(small.sum())),
        missed=(int((large & (answers == 0.0)).sum()), int(large.sum())),
    )


def _by_term(where: BoolArray, names: tuple[str, ...]) -> dict[str, int]:
    counts = Counter(dict(zip(names, where.sum(axis=0).tolist(), strict=True)))
    return {name: count for name, count in counts.most_common() if count}
