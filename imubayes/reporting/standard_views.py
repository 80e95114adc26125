"""Fitted coefficients in the symbols and units of the standards that speak of a sensor's technology."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.factor import reorder
from imubayes.errors import TermError
from imubayes.reporting.blocks import Block, Prose, Section, Table, Text, quiet, verdict
from imubayes.reporting.result.entries import AbsorbedTerms, Standard, Symbol
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import (
    CHANNEL_UNIT,
    OUTPUT_SI,
    OUTPUT_UNIT,
    Measured,
    in_unit,
    measured,
    minus,
    per_unit,
    pretty,
    signed,
)
from imubayes.sensors.equations.mapping import absorbing
from imubayes.sensors.equations.standards import StandardValue, in_standard, standard, standards_for
from imubayes.study.scenes import component_library
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult, SensorSpec, Study
    from imubayes.selection.verdicts import TermVerdict
    from imubayes.sensors.terms import Library


@dataclass(frozen=True, slots=True)
class StandardRow:
    """One parameter of a standard.

    Attributes
    ----------
    found : value and sd in SI.
    size : both in the unit that people use.
    term : generalized term that determines it.
    verdict : of this term.
    """

    found: StandardValue
    size: Measured
    term: str
    verdict: str


@dataclass(frozen=True, slots=True)
class Absorbed:
    """What terms without a symbol do over a test, and what a standard's own parameters cannot take over.

    Attributes
    ----------
    terms : that the test excites and the standard has no symbol for.
    inputs : what it is over, in words.
    rms, left : of what they do, before and after, SI; over every sample of the test.
    said : both, in the unit that people use.
    """

    terms: tuple[str, ...]
    inputs: str
    rms: float
    left: float
    said: tuple[Measured, Measured]


@dataclass(frozen=True, slots=True)
class StandardView:
    """A component in the symbols of one standard.

    Attributes
    ----------
    id, title : of the standard.
    rows : its parameters, of the terms that the test excites.
    untested : symbols of those that it does not.
    absent : symbols whose terms are not in the library.
    exact : where its equation and the library give the same output.
    standard_only : what the standard has and the library cannot say.
    general_only : terms that the standard has no symbol for, and which of them are needed.
    needed_only : those of `general_only` that are needed.
    absorbed : what the parameters take over of what `general_only` do in the test; None if there is nothing.
    trouble : why there are no rows; empty where there are.
    """

    id: str
    title: str
    rows: tuple[StandardRow, ...]
    untested: tuple[str, ...]
    absent: tuple[str, ...]
    exact: str
    standard_only: tuple[str, ...]
    general_only: tuple[str, ...]
    needed_only: tuple[str, ...]
    absorbed: Absorbed | None = None
    trouble: str = ""


def standard_views(study: Study, sensor: SensorResult) -> tuple[StandardView, ...]:
    """Component in every standard of its class's technology, the basic triad last; none without correlations.

    The values are those of the full library, all terms at once: a standard has its parameters whether a term
    is needed or not. What terms without a symbol there do over the test's inputs, the parameters take over as
    well as they can. Their sds are carried through projection and mapping with the posterior's correlations.
    """
    if sensor.correlation is None:
        return ()
    spec = _spec_of(study, sensor)
    technology = spec.sensor_class.technology if spec.sensor_class else ""
    lib = component_library(spec, sensor)
    return tuple(_view(name, lib, sensor) for name in standards_for(sensor.kind, technology))


def standard_section(view: StandardView, sensor: str) -> Section:
    """Component in the symbols of one standard."""
    blocks: list[Block] = []
    if view.trouble:
        blocks.append(Prose(view.trouble))
    else:
        head = ("symbol", "value", "unit", "from", "verdict", "convention")
        rows = [_cells(row) for row in view.rows]
        blocks.append(Table(f"{sensor} in the symbols of {view.id}", head, rows, "tntttw"))
    note = " ".join(_standard_notes(view))
    return Section(f"In the symbols of {view.title}", [*blocks, Prose(note, "note")])


def _cells(row: StandardRow) -> tuple[Text, ...]:
    size = signed(row.size) if row.verdict == "needed" else quiet(signed(row.size))
    return (
        minus(row.found.symbol), size, pretty(row.size.unit), row.term, verdict(row.verdict), row.found.note,
    )  # fmt: skip


def _standard_notes(view: StandardView) -> Iterator[str]:
    """What the symbols rest on, and what has none."""
    if view.rows:
        yield "All terms at once, needed or not, with their correlations."
    yield f"Equation and library: {view.exact}."
    for what, symbols in (
        ("Not tested", view.untested),
        ("Not in the library", view.absent),
        ("Without a term here", view.standard_only),
    ):
        if symbols:
            yield f"{what}: {minus(', '.join(symbols))}."
    if view.general_only:
        needed = view.needed_only
        of_these = f"; of these {', '.join(needed)} {'is' if len(needed) == 1 else 'are'} needed"
        yield f"Without a symbol there: {', '.join(view.general_only)}{of_these if needed else ''}."
    if view.absorbed:
        absorbed = view.absorbed
        size, left = map(in_unit, absorbed.said)
        yield (
            f"What {', '.join(absorbed.terms)} {'does' if len(absorbed.terms) == 1 else 'do'} in this test,"
            f" {size} rms, the values above take over as well as they can, by least squares over"
            f" {minus(pretty(absorbed.inputs))}: {left} rms are left."
        )


def published_standards(study: Study, sensor: SensorResult) -> dict[str, Standard]:
    """Publish a component in the terms of each standard."""
    return {
        view.id: published(
            Standard,
            view,
            values=tuple(
                published(
                    Symbol, row.found, printed_unit=row.found.printed, term=row.term, verdict=row.verdict
                )
                for row in view.rows
            ),
            absorbed=view.absorbed
            and published(AbsorbedTerms, view.absorbed, printed_unit=view.absorbed.said[0].unit),
        )
        for view in standard_views(study, sensor)
    }


def _spec_of(study: Study, sensor: SensorResult) -> SensorSpec:
    """Sensor of the study that a component belongs to."""
    by_id = {spec.id: spec for spec in study.sensors}
    return by_id.get(sensor.id) or by_id[sensor.id.rpartition(".")[0]]


def _view(name: str, lib: Library, sensor: SensorResult) -> StandardView:
    known, verdicts = standard(name, kind=lib.kind), {term.name: term for term in sensor.selection.terms}
    terms = [row.term for row in known.symbols if row.term in lib.names]
    others, (mean, cov) = known.general_only(lib), _moments(lib, sensor)
    trouble, rows, (move, absorbed) = "", [], _projected(lib, terms, others, mean, sensor)
    try:
        found = in_standard(name, lib, move @ mean, move @ cov @ move.T)
        rows = list(_rows(found, terms, verdicts))
    except TermError as error:
        trouble = str(error)
    return StandardView(
        id=name,
        title=known.title,
        rows=tuple(row for row in rows if row.verdict != "untested"),
        untested=tuple(row.found.symbol for row in rows if row.verdict == "untested"),
        absent=tuple(row.symbol for row in known.symbols if row.term and row.term not in lib.names),
        exact=known.exact,
        standard_only=known.standard_only,
        general_only=others,
        needed_only=tuple(other for other in others if verdicts[other].verdict == "needed"),
        absorbed=absorbed if rows else None,
        trouble=trouble,
    )


def _projected(
    lib: Library, kept: list[str], others: tuple[str, ...], mean: np.ndarray, sensor: SensorResult
) -> tuple[np.ndarray, Absorbed | None]:
    """Matrix (p, p) that lets kept coefficients take over what others do in the test, and what it leaves."""
    move = np.eye(len(mean))
    if sensor.drive is None:
        return move, None
    f = reorder(sensor.drive, lib.names)
    X, driven = f.R[:-1, :-1], f.column_norms > 0.0
    inside, outside = ([lib.names.index(name) for name in names] for names in (kept, others))
    move[np.ix_(inside, outside)] = absorbing(X, inside, outside)
    move[outside, outside] = 0.0
    excited = [k for k in outside if driven[k]]
    if not excited:
        return move, None
    sizes = [float(np.linalg.norm(X @ v) / np.sqrt(f.n)) for v in (_only(mean, outside), mean - move @ mean)]
    unit = OUTPUT_UNIT[lib.kind]
    said = [measured(size / per_unit(unit, OUTPUT_SI[lib.kind]), 0.0, unit) for size in sizes]
    terms = tuple(lib.names[k] for k in excited)
    return move, Absorbed(terms, _over(sensor, lib, f.n), sizes[0], sizes[1], (said[0], said[1]))


def _only(values: np.ndarray, where: list[int]) -> np.ndarray:
    return np.where(np.isin(np.arange(len(values)), where), values, 0.0)


def _over(sensor: SensorResult, lib: Library, samples: int) -> str:
    """The inputs of the test in words: samples, runs, and the range of the own input where runs tell it."""
    ends = [run.ranges[lib.own] for run in sensor.runs if lib.own in run.ranges]
    names = ", ".join(run.name for run in sensor.runs)
    text = f"the {counted(samples, 'sample')} of {names}"
    if not ends:
        return text
    unit = CHANNEL_UNIT[lib.own[0]]
    size = per_unit(unit, OUTPUT_SI[lib.kind])
    low, high = (end / size for end in (min(e[0] for e in ends), max(e[1] for e in ends)))
    return f"{text}, {lib.own} from {low:.3g} to {high:.3g} {unit}"


def _moments(lib: Library, sensor: SensorResult) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of the coefficients under the full library, in its order."""
    terms = sensor.selection.terms
    order = [[term.name for term in terms].index(name) for name in lib.names]
    mean, sd = (np.array([getattr(terms[k], key) for k in order]) for key in ("full_mean", "full_sd"))
    return mean, np.asarray(sensor.correlation)[np.ix_(order, order)] * np.outer(sd, sd)


def _rows(
    found: tuple[StandardValue, ...], terms: list[str], verdicts: dict[str, TermVerdict]
) -> Iterator[StandardRow]:
    for value, term in zip(found, terms, strict=True):
        scale = per_unit(value.printed, value.unit)
        size = measured(value.value / scale, value.sd / scale, value.printed)
        yield StandardRow(value, size, term, verdicts[term].verdict)
