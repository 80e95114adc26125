"""Fitted coefficients in the symbols and units of the standards that speak of a sensor's technology."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.errors import TermError
from imubayes.missions import component_library
from imubayes.reporting.rounding import Measured, measured, per_unit
from imubayes.sensors.equations.standards import StandardValue, in_standard, standard, standards_for

if TYPE_CHECKING:
    from imubayes.campaign import SensorResult, SensorSpec, Study
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
    trouble: str = ""


def standard_views(study: Study, sensor: SensorResult) -> tuple[StandardView, ...]:
    """Component in every standard of its class's technology, the basic triad last; none without correlations.

    The values are those of the full library, all terms at once: a standard has its parameters whether a term
    is needed or not. Their sds are carried through the mapping with the correlations of the posterior.
    """
    if sensor.correlation is None:
        return ()
    spec = _spec_of(study, sensor)
    technology = spec.sensor_class.technology if spec.sensor_class else ""
    lib = component_library(spec, sensor)
    return tuple(_view(name, lib, sensor) for name in standards_for(sensor.kind, technology))


def standards_record(study: Study, sensor: SensorResult) -> dict[str, Any]:
    """Entry ``standards`` of a component in ``result.json``, SI."""
    return {
        view.id: {
            "title": view.title,
            "values": [_value_record(row) for row in view.rows],
            "untested": list(view.untested),
            "absent": list(view.absent),
            "exact": view.exact,
            "standard_only": list(view.standard_only),
            "general_only": list(view.general_only),
            "trouble": view.trouble,
        }
        for view in standard_views(study, sensor)
    }


def _value_record(row: StandardRow) -> dict[str, Any]:
    return {
        "symbol": row.found.symbol,
        "value": row.found.value,
        "sd": row.found.sd,
        "unit": row.found.unit,
        "printed_unit": row.found.printed,
        "term": row.term,
        "verdict": row.verdict,
        "note": row.found.note,
    }


def _spec_of(study: Study, sensor: SensorResult) -> SensorSpec:
    """Sensor of the study that a component belongs to."""
    by_id = {spec.id: spec for spec in study.sensors}
    return by_id.get(sensor.id) or by_id[sensor.id.rpartition(".")[0]]


def _view(name: str, lib: Library, sensor: SensorResult) -> StandardView:
    known, verdicts = standard(name, kind=lib.kind), {term.name: term for term in sensor.selection.terms}
    terms = [row.term for row in known.symbols if row.term in lib.names]
    trouble, rows = "", []
    try:
        found = in_standard(name, lib, *_moments(lib, sensor))
        rows = list(_rows(found, terms, verdicts))
    except TermError as error:
        trouble = str(error)
    others = known.general_only(lib)
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
        trouble=trouble,
    )


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
