"""Fitted coefficients in the symbols and units of the standards that speak of a sensor's technology."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from imubayes.algebra.factor import reorder
from imubayes.campaign import SensorResult, Study
from imubayes.errors import TermError
from imubayes.reporting import rounding
from imubayes.reporting.blocks import Prose, Section, Table, Text, quiet, verdict
from imubayes.reporting.result import AbsorbedTerms, Standard, Symbol, published
from imubayes.sensors.equations import in_standard, standard, standards_for
from imubayes.sensors.equations.mapping import absorbing
from imubayes.sensors.terms import Library
from imubayes.study.findings import component_library
from imubayes.units import counted


def standards(study: Study, sensor: SensorResult) -> dict[str, Standard]:
    """Component in every standard of its class's technology, the basic triad last; none without correlations.

    The values are those of the full library, all terms at once: a standard has its parameters whether a term
    is needed or not. What terms without a symbol there do over the test's inputs, the parameters take over as
    well as they can. Their sds are carried through projection and mapping with the posterior's correlations.
    """
    if sensor.correlation is None:
        return {}
    by_id = {spec.id: spec for spec in study.sensors}
    spec = by_id.get(sensor.id) or by_id[sensor.id.rpartition(".")[0]]
    technology = spec.sensor_class.technology if spec.sensor_class else ""
    lib = component_library(spec, sensor)
    return {name: _in_symbols(name, lib, sensor) for name in standards_for(sensor.kind, technology)}


def standard_section(name: str, standard: Standard, sensor: SensorResult) -> Section:
    """Component in the symbols of one standard."""
    block = Prose(standard["trouble"])
    if not standard["trouble"]:
        head = ("symbol", "value", "unit", "from", "verdict", "convention")
        rows: list[tuple[Text, ...]] = []
        for row in standard["values"]:
            printed = row["printed_unit"]
            size = rounding.signed(
                rounding.measured(row["value"], row["sd"], printed, rounding.per_unit(printed, row["unit"]))
            )
            told = size if row["verdict"] == "needed" else quiet(size)
            told_by = row["term"], verdict(row["verdict"]), row["note"]
            rows.append((rounding.minus(row["symbol"]), told, rounding.pretty(printed), *told_by))
        block = Table(f"{sensor.id} in the symbols of {name}", head, rows, "tntttw")
    note = " ".join(_notes(standard, sensor))
    return Section(f"In the symbols of {standard['title']}", [block, Prose(note, "note")], folded=True)


def _notes(standard: Standard, sensor: SensorResult) -> Iterator[str]:
    if standard["values"]:
        yield "All terms at once, needed or not, with their correlations."
    yield f"Equation and library: {standard['exact']}."
    for what, symbols in (
        ("Not tested", standard["untested"]),
        ("Not in the library", standard["absent"]),
        ("Without a term here", standard["standard_only"]),
    ):
        if symbols:
            yield f"{what}: {rounding.minus(', '.join(symbols))}."
    if others := standard["general_only"]:
        needed = [t.name for t in sensor.selection.terms if t.name in others and t.verdict == "needed"]
        of_these = f"; of these {', '.join(needed)} {'is' if len(needed) == 1 else 'are'} needed"
        yield f"Without a symbol there: {', '.join(others)}{of_these if needed else ''}."
    if absorbed := standard["absorbed"]:
        terms = absorbed["terms"]
        size, left = (
            rounding.in_unit(rounding.on_output(absorbed[key], sensor.kind)) for key in ("rms", "left")
        )
        yield (
            f"What {', '.join(terms)} {'does' if len(terms) == 1 else 'do'} in this test,"
            f" {size} rms, the values above take over as well as they can, by least squares over"
            f" {rounding.minus(rounding.pretty(absorbed['inputs']))}: {left} rms are left."
        )


def _in_symbols(name: str, lib: Library, sensor: SensorResult) -> Standard:
    """One standard's parameters; of the terms that the test excites with their values."""
    known, verdicts = standard(name, kind=lib.kind), {t.name: t.verdict for t in sensor.selection.terms}
    terms = [row.term for row in known.symbols if row.term in lib.names]
    order = [[term.name for term in sensor.selection.terms].index(term) for term in lib.names]
    full = [(sensor.selection.terms[k].full_mean, sensor.selection.terms[k].full_sd) for k in order]
    mean, sd = np.array(full).T
    cov = np.asarray(sensor.correlation)[np.ix_(order, order)] * np.outer(sd, sd)
    others = known.general_only(lib)
    trouble, rows, (move, absorbed) = "", [], _projected(lib, terms, others, mean, sensor)
    try:
        for symbol, *size in zip(*in_standard(name, lib, move @ mean, move @ cov @ move.T), strict=True):
            told = {"printed_unit": symbol.printed, "verdict": verdicts[symbol.term]}
            rows.append(published(Symbol, symbol, value=float(size[0]), sd=float(size[1]), **told))
    except TermError as error:
        trouble = str(error)
    return published(
        Standard,
        known,
        values=tuple(row for row in rows if row["verdict"] != "untested"),
        untested=tuple(row["symbol"] for row in rows if row["verdict"] == "untested"),
        absent=tuple(row.symbol for row in known.symbols if row.term and row.term not in lib.names),
        general_only=others,
        absorbed=absorbed if rows else None,
        trouble=trouble,
    )


def _projected(
    lib: Library, kept: list[str], others: tuple[str, ...], mean: np.ndarray, sensor: SensorResult
) -> tuple[np.ndarray, AbsorbedTerms | None]:
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
    alone = np.where(np.isin(np.arange(len(mean)), outside), mean, 0.0)
    sizes = [float(np.linalg.norm(X @ v) / np.sqrt(f.n)) for v in (alone, mean - move @ mean)]
    return move, AbsorbedTerms(
        terms=tuple(lib.names[k] for k in excited),
        inputs=_over(sensor, lib, f.n),
        rms=sizes[0],
        left=sizes[1],
        printed_unit=rounding.OUTPUT_UNIT[lib.kind],
    )


def _over(sensor: SensorResult, lib: Library, samples: int) -> str:
    """The inputs of the test in words: samples, runs, and the range of the own input where runs tell it."""
    text = f"the {counted(samples, 'sample')} of {', '.join(run.name for run in sensor.runs)}"
    ends = [end for run in sensor.runs for end in run.ranges.get(lib.own, ())]
    if not ends:
        return text
    unit = rounding.CHANNEL_UNIT[lib.own[0]]
    size = rounding.per_unit(unit, rounding.OUTPUT_SI[lib.kind])
    return f"{text}, {lib.own} from {min(ends) / size:.3g} to {max(ends) / size:.3g} {unit}"
