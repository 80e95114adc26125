"""Published statements on classes, held against what a study found of these.

They come with the catalogue (``[[statement]]`` in ``grades.toml``). The units of a study are drawn from the
same catalogue, so that a statement is confirmed for sensors of its sizes, by the tests and in the scenes of
the study.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from imubayes.population.needs import NEEDED, NOT_NEEDED, UNTOLD, ClassFound, PopulationTerm
from imubayes.scenes.relevance import MATTERS
from imubayes.sensors.catalogue_file import Table, packaged_tables
from imubayes.sensors.terms import Kind
from imubayes.units import factor

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
    known = {grade.sensor_class.id: grade for grade in classes}
    return tuple(
        _judged(table, [known[name] for name in table["classes"] if name in known])
        for table in packaged_tables()["statement"]
        if table["kind"] == kind and set(table["classes"]) & set(known)
    )


def _judged(table: Table, classes: Sequence[ClassFound]) -> Judged:
    told: dict[str, str] = {}
    sizes: dict[str, tuple[float, float]] = {}
    for grade in classes:
        name = grade.sensor_class.id
        terms = [k for k, term in enumerate(grade.terms) if term.name in table["terms"]]
        if not terms or (table["claims"] == "small" and not grade.missions):
            told[name] = BEYOND
        elif table["claims"] == "needed":
            told[name] = _needed([grade.terms[k].answer for k in terms])
        elif table["claims"] == "small":
            told[name], sizes[name] = _small(grade, terms)
        else:
            told[name], sizes[name] = _size(grade.terms[terms[0]], table["range"])
    why = table.get("why", "")
    if not (why or any(term.name in table["terms"] for grade in classes for term in grade.terms)):
        why = "no such term is in the study"
    verdict = next((word for word in (CONTRADICTED, CONFIRMED) if word in told.values()), BEYOND)
    unit = table["range"][-1] if table["claims"] == "size" else "1"
    return Judged(table["text"], table["source"], table["claims"], verdict, told, sizes, unit, why)


def _needed(answers: Sequence[str]) -> str:
    """Whether a class needs one of some terms, by its answers."""
    if NEEDED in answers:
        return CONFIRMED
    return CONTRADICTED if set(answers) == {NOT_NEEDED} else BEYOND


def _small(grade: ClassFound, terms: Sequence[int]) -> tuple[str, tuple[float, float]]:
    """Whether each of some terms takes less than `MATTERS` of every scene's budget, and their largest."""
    cells = [scene.terms[k] for scene in grade.missions for k in terms]
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
