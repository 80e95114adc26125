"""What components share for being in one case: known quantities recovered, and terms that the kind needs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from imubayes.reporting.angle_views import AngleTable, angle_table
from imubayes.reporting.blocks import LEGEND, Figure, Prose, Section, Table, bar, quiet, shape, verdict
from imubayes.reporting.case_figures import recovered_panel
from imubayes.reporting.case_words import (
    QUANTITIES,
    UNITS,
    case_answer,
    pooled_sentence,
    recovered_sentence,
)
from imubayes.reporting.result.entries import Case, Pooled, RecoveredErrors
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import Measured, measured, per_unit, pretty, signed
from imubayes.selection.verdicts import EQUAL, Costs

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult, StudyResult
    from imubayes.inference.recovered import Recovered
    from imubayes.reporting.canvas import Panel

BLIND = ("inseparable", "unresolved", "untested")
"""Verdicts of a test that cannot tell: where all components have one of them, pooling tells no more."""

CANNOT = "cannot tell"

MOST_DRAWN = 3
"""Cases of a study whose errors are drawn."""


RECOVERED = (
    "error, rms", "run", "of", "raw", "compensated", "by the kept terms", "predicted", "for new ones", "",
    "within 2 sd",
)  # fmt: skip

MANY_NOTE = (
    "Compensated: under the full library. Predicted: from the joint posterior of a unit's components and"
    " the noise over each still, for the data that the coefficients were fitted to; new stills at the"
    " same inputs have the uncertainty of the coefficients on top. What the components of each unit need"
    " together is in result.json."
)

RECOVERED_NOTE = (
    "Compensated: under the full library. Predicted: from the joint posterior of all components and the"
    " noise over each still or turn, for the data that the coefficients were fitted to; the grey band is"
    " ± 2 sd of it. A dash: the fit has a coefficient for each; the band is then that of new ones. New"
    " stills and turns at the same inputs have the uncertainty of the coefficients on top."
)

AXES_NOTE = Markup(
    ' Marks: <span aria-hidden="true">●</span> x, or the first of two directions across up; <span'
    ' aria-hidden="true">■</span> y, or the second; <span aria-hidden="true">▲</span> z.'
)

ANGLES_NOTE = (
    "From the joint posterior of all components under the full library, ± one standard deviation."
    " Non-orthogonality is by how much the angle between two input axes is short of 90 deg. A rotation is"
    " right-handed, from the axes of the case to those of the triad; a rotation of the case in its"
    " fixture adds to it, the same to both triads, and changes neither an angle between axes nor the"
    " rotation of one triad against the other."
)

POOLED_NOTE = (
    "Components of one kind with one model: its evidence is the product of theirs, each with coefficients"
    f" of its own. Shapes are each component's own verdict: {LEGEND}. Terms that not all components have"
    " are not asked."
)


@dataclass(frozen=True, slots=True)
class RecoveredRow:
    """Errors of one known quantity as they are printed: root mean squares over stills or turns.

    Attributes
    ----------
    kind, what, run : quantity as its key and in words, and the run.
    count : of stills or turns.
    before, after, flown : of the raw output, compensated by the full library and by the kept terms.
    fitted, fresh : what the posterior predicts for `after` (None where there is a coefficient for each), and
        for new stills and turns.
    inside, of : how many errors lie within 2 sd of what is predicted, of how many.
    """

    kind: str
    what: str
    run: str
    count: int
    before: Measured
    after: Measured
    flown: Measured
    fitted: Measured | None
    fresh: Measured
    inside: int
    of: int


@dataclass(frozen=True, slots=True)
class PooledRow:
    """One term of a kind.

    Attributes
    ----------
    term : its name.
    verdicts : of each component; empty where it has no such term.
    inclusion : in one model for all of them.
    verdict : ``needed``, ``not needed``, ``undecided``, or ``cannot tell`` where no component's test can.
    """

    term: str
    verdicts: tuple[str, ...]
    inclusion: float
    verdict: str


@dataclass(frozen=True, slots=True)
class PooledTable:
    """Terms that a kind of component needs: its components, rows, and the finding in words.

    Attributes
    ----------
    also : names of the components that need further terms, by these terms.
    """

    kind: str
    components: tuple[str, ...]
    rows: tuple[PooledRow, ...]
    sentence: str
    also: Mapping[tuple[str, ...], Sequence[str]]


@dataclass(frozen=True, slots=True)
class CaseView:
    """A case of several components.

    Attributes
    ----------
    id, anchor : of the sensor, and of its section.
    answer : first paragraph, by sentence.
    sentences : of the length of gravity, a run each.
    rows : the same in numbers.
    panels : error of each still or turn after compensation, with what is predicted.
    pooled : a table a kind.
    angles : how the axes lie; None where directions were not known.
    """

    id: str
    anchor: str
    answer: tuple[str, ...]
    sentences: tuple[str, ...]
    rows: tuple[RecoveredRow, ...]
    panels: tuple[Panel, ...]
    pooled: tuple[PooledTable, ...]
    angles: AngleTable | None


def case_views(result: StudyResult) -> tuple[CaseView, ...]:
    """Prepare every case of a study."""
    cases = _cases(result)
    drawn = len(cases) <= MOST_DRAWN
    return tuple(
        _view(name, f"case{k + 1}", sensors, result.study.costs, drawn=drawn)
        for k, (name, sensors) in enumerate(cases.items())
    )


def cases_section(views: Sequence[CaseView]) -> Section:
    """Known quantities of many cases in one table."""
    rows = [(view.id, *_recovered_cells(row)) for view in views for row in view.rows]
    label = "Known quantities before and after compensation"
    table = Table(label, ("unit", *RECOVERED), rows, "twtnnnnnntn", MANY_NOTE)
    return Section("Raw and compensated", [table], "cases")


def case_section(view: CaseView) -> Section:
    """One case: its known quantities, how its axes lie, and what each kind needs."""
    parts = [_recovered_section(view)] if view.rows else []
    if view.angles:
        label = f"Rotation and non-orthogonality of {view.id}"
        rows = [(text, *map(signed, cells)) for text, cells in view.angles.rows]
        head = (f"angle, {pretty('urad')}", *view.angles.heads)
        table = Table(label, head, rows, note=ANGLES_NOTE)
        parts.append(Section("How the axes lie", [Prose([*map(pretty, view.angles.sentences)]), table]))
    parts += [_pooled_section(view, table) for table in view.pooled]
    last = [Prose(POOLED_NOTE, "note")] if view.pooled else []
    return Section(f"{view.id} as a whole", [*parts, *last], view.anchor)


def _recovered_section(view: CaseView) -> Section:
    label = f"Known quantities of {view.id} before and after compensation"
    rows = [_recovered_cells(row) for row in view.rows]
    table = Table(label, RECOVERED, rows, "wtnnnnnntn")
    note = Markup("{}{}").format(RECOVERED_NOTE, AXES_NOTE if len(rows) > 1 else "")
    return Section("Raw and compensated", [Prose(view.sentences), table, Figure(view.panels, note)])


def _recovered_cells(row: RecoveredRow) -> tuple[str, ...]:
    fitted = signed(row.fitted) or "–"
    sizes = (signed(row.before), signed(row.after), signed(row.flown), fitted, signed(row.fresh))
    return (row.what, row.run, str(row.count), *sizes, pretty(row.after.unit), f"{row.inside} of {row.of}")


def _pooled_section(view: CaseView, table: PooledTable) -> Section:
    rows = []
    for row in table.rows:
        told = (bar(row.inclusion), verdict(row.verdict))
        if row.verdict == CANNOT:
            told = (quiet("as the prior"), verdict(CANNOT, like="unresolved"))
        rows.append((row.term, *map(shape, row.verdicts), *told))
    label = f"Terms that the {table.kind}s of {view.id} need"
    head = ("term", *table.components, "in one model", "verdict")
    found = Table(label, head, rows, "t" * (1 + len(table.components)) + "nt")
    return Section(f"Does this kind need it: {table.kind}s", [Prose(table.sentence), found])


def published_cases(result: StudyResult) -> Iterator[Case]:
    """Publish the cases of a study: errors in SI, verdicts of each kind."""
    for name, sensors in _cases(result).items():
        pooled = {
            kind: {row.term: published(Pooled, row) for row in rows}
            for kind, rows in _pooled(sensors, result.study.costs).items()
        }
        yield Case(id=name, recovered=tuple(map(_published, sensors[0].recovered)), pooled=pooled)


def _cases(result: StudyResult) -> dict[str, list[SensorResult]]:
    """Components that were found together, by the id of their sensor."""
    cases: dict[str, list[SensorResult]] = {}
    for sensor in result.sensors:
        if sensor.pooled or sensor.recovered or (sensor.calibration or {}).get("angles"):
            cases.setdefault(sensor.id.rpartition(".")[0], []).append(sensor)
    return cases


def _view(name: str, anchor: str, sensors: Sequence[SensorResult], costs: Costs, *, drawn: bool) -> CaseView:
    recovered = sensors[0].recovered
    rows, tables = tuple(map(_row, recovered)), tuple(_tables(sensors, costs))
    return CaseView(
        id=name,
        anchor=anchor,
        answer=case_answer(name, rows, tables),
        sentences=tuple(recovered_sentence(row) for row in rows if row.kind == "gravity"),
        rows=rows,
        panels=tuple(recovered_panel(one, f"{anchor}p{k}") for k, one in enumerate(recovered))
        if drawn
        else (),
        pooled=tables,
        angles=angle_table(sensors),
    )


def _row(one: Recovered) -> RecoveredRow:
    unit, si = UNITS[one.what]
    scale = per_unit(unit, si)

    def rms(errors: np.ndarray) -> Measured:
        return measured(root_mean_square(errors, one.what) / scale, 0.0, unit)

    return RecoveredRow(
        kind=one.what,
        what=QUANTITIES[one.what],
        run=one.run,
        count=len(one.after),
        before=rms(one.before),
        after=rms(one.after),
        flown=rms(one.flown),
        fitted=None if one.saturated else rms(one.fitted),
        fresh=rms(one.fresh),
        inside=one.inside,
        of=one.after.size,
    )


def root_mean_square(errors: np.ndarray, what: str) -> float:
    """Rms of errors (m, c); the two directions of a closure are one angle."""
    squares = np.asarray(errors) ** 2
    return float(np.sqrt(squares.sum(axis=1).mean() if what == "closure" else squares.mean()))


def _published(one: Recovered) -> RecoveredErrors:
    sizes = ("before", "after", "flown", "fitted", "fresh")
    return published(
        RecoveredErrors,
        one,
        unit=UNITS[one.what][1],
        count=len(one.after),
        rms={size: root_mean_square(getattr(one, size), one.what) for size in sizes},
        within_2_sd=one.inside,
        of=one.after.size,
        errors=one.after,
        sd=one.expected,
    )


def _tables(sensors: Sequence[SensorResult], costs: Costs) -> Iterator[PooledTable]:
    for kind, rows in _pooled(sensors, costs).items():
        alike = [sensor for sensor in sensors if sensor.kind == kind]
        names = tuple(sensor.id for sensor in alike)
        also = _also(alike, {row.term for row in rows if row.verdict == "needed"})
        yield PooledTable(kind, names, rows, pooled_sentence(kind, names, rows), also)


def _also(sensors: Sequence[SensorResult], shared: Collection[str]) -> Mapping[tuple[str, ...], list[str]]:
    """Components by what they need beyond the terms that their kind does: not all have every term."""
    found: dict[tuple[str, ...], list[str]] = {}
    for sensor in sensors:
        own = (term.name for term in sensor.selection.terms if term.verdict == "needed")
        if more := tuple(name for name in own if name not in shared):
            found.setdefault(more, []).append(sensor.id.rpartition(".")[2])
    return found


def _pooled(sensors: Sequence[SensorResult], costs: Costs) -> Mapping[str, tuple[PooledRow, ...]]:
    """Rows by kind."""
    kinds = dict.fromkeys(sensor.kind for sensor in sensors if sensor.pooled)
    return {kind: tuple(_pooled_rows([s for s in sensors if s.kind == kind], costs)) for kind in kinds}


def _pooled_rows(sensors: Sequence[SensorResult], costs: Costs) -> Iterator[PooledRow]:
    found = [{term.name: term.verdict for term in sensor.selection.terms} for sensor in sensors]
    for name, inclusion in sensors[0].pooled.items():
        verdicts = tuple(one.get(name, "") for one in found)
        yield PooledRow(name, verdicts, inclusion, pooled_verdict(inclusion, verdicts, costs))


def pooled_verdict(inclusion: float, verdicts: Sequence[str], costs: Costs = EQUAL) -> str:
    """What the kind needs, of one term: never what each component that tells is against.

    Examples
    --------
    >>> pooled_verdict(0.99, ("undecided", "undecided")), pooled_verdict(0.9, ("untested", "inseparable"))
    ('needed', 'cannot tell')
    >>> pooled_verdict(0.97, ("not needed", "not needed"))  # hints of what is there and small add up
    'undecided'
    """
    told = {verdict for verdict in verdicts if verdict and verdict not in BLIND}
    if not told:
        return CANNOT
    if inclusion >= costs.needed and told != {"not needed"}:
        return "needed"
    return "not needed" if inclusion <= costs.not_needed and "needed" not in told else "undecided"
