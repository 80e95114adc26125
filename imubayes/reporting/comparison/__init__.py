"""Results of any studies side by side: which comparison their kinds allow.

A unit against a class-level study is compared here: is it typical of its class? Its coefficient is estimated
as t with sd s under the full library; the population has the mean mu and the spread tau, each with an
interval. A typical unit has ``t ~ N(mu, s^2 + var(mu) + E[tau^2])``, tau log-normal. Noise is compared by its
logarithm against that of the lot's units. One test a term: the largest of them all is beyond what a typical
unit shows in 5 % of cases at most (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from imubayes.errors import InputError
from imubayes.reporting.blocks import Both, Page, Prose, Row, Section, verdict
from imubayes.reporting.comparison import page
from imubayes.reporting.comparison.differences import (
    LETTERS,
    Comparison,
    Entry,
    Group,
    comparison,
    differing,
    largest,
    log_spread,
    normal_of,
)
from imubayes.reporting.comparison.lots import LOTS, Population, population_of, population_texts
from imubayes.reporting.comparison.sensors import SENSORS, noise_of, term_value
from imubayes.reporting.result.entries import Sensor, SensorsResult, Term
from imubayes.reporting.result.file import Written, no_result, read, written
from imubayes.reporting.result.many import Class, LotsResult
from imubayes.reporting.rounding import measured, noise_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind
from imubayes.units import counted

HEAD = ("term", "value", "class mean", "class spread", Both("needed in", None), "verdict", page.DIFFERENCE)
NOISE_HEAD = ("noise", "value", "median of the class", page.DIFFERENCE)


def units_compared(files: Sequence[Written], results: Sequence[SensorsResult | LotsResult]) -> Comparison:
    """Set units beside the class that one of the results is of."""
    labelled = list(zip(LETTERS, results, strict=False))
    lots = [
        (file, label, result["lots"])
        for file, (label, result) in zip(files, labelled, strict=False)
        if "lots" in result
    ]
    if len(lots) != 1 or len(results) > len(LETTERS):
        raise InputError(
            f"units are compared with one class-level result, came {len(lots)} among {len(results)} results:"
            " compare the class-level results with each other first"
        )
    ((file, lot_label, lot),) = lots
    known = {entry["id"]: entry for entry in lot["classes"]}
    components = [(label, c) for label, result in labelled if "sensors" in result for c in result["sensors"]]
    typical = [(label, c) for label, c in components if c["kind"] == lot["kind"] and c["class"] in known]
    if not typical:
        came = ", ".join(f"{c['id']}: {c['kind']} of class {c['class'] or 'none'}" for _, c in components)
        raise InputError(
            f"{file.path}: has {lot['kind']}s of the classes {', '.join(known)}, and the units are"
            f" others ({came}): expected the class in both studies"
        )
    groups = [_unit(c, known[c["class"] or ""], (label, lot_label)) for label, c in typical]
    alone = [(label, c["id"], c["class"] or "") for label, c in components if (label, c) not in typical]
    return comparison(files, results, groups, alone)


def _unit(sensor: Sensor, of: Class, pair: tuple[str, str]) -> Group:
    population = {term["name"]: population_of(term, of) for term in of["terms"]}
    terms = {
        term["name"]: _term(term, known, sensor["kind"], pair)
        for term in sensor["terms"]
        if (known := population.get(term["name"]))
    }
    record = {
        "result": pair[0],
        "id": sensor["id"],
        "class": of["id"],
        "typical": None,  # known when everything is compared
        **dict.fromkeys(("terms", "noise"), ()),
        "missing": [term["name"] for term in sensor["terms"] if term["name"] not in terms],
    }
    noise = dict(_noise(sensor, of, pair))
    return Group(sensor["id"], sensor["kind"], (sensor, of), terms, record, noise, labels=pair)


def _term(unit: Term, population: Population, kind: Kind, pair: tuple[str, str]) -> Entry:
    keys = ("name", "unit", "full_mean", "full_sd", "verdict")
    record = {**{key: unit[key] for key in keys}, "population": population}
    silent = not population["tested"] or unit["verdict"] == "untested"
    both = ((unit["full_mean"], unit["full_sd"]), (population["mean"]["value"], scatter(population)))
    pulls, known = {"": None if silent else largest(both, labels=pair)}, ("not tested", "", "")
    if population["tested"]:
        share, mean, spread = population_texts(population, unit["name"], kind)
        known = (mean, spread, share)
    cells = (term_value(unit), *known, verdict(unit["verdict"]))
    return Entry(unit["name"], [cells], record, pulls, silent=silent)


def scatter(population: Population) -> float:
    """Standard deviation of typical units about the population's mean, which is known to its interval."""
    log_tau, log_sd = log_spread(population["spread"])
    mean = population["mean"]
    return math.hypot(normal_of(mean["low"], mean["high"]), math.exp(log_tau + log_sd**2))


def _noise(sensor: Sensor, of: Class, pair: tuple[str, str]) -> Iterator[tuple[tuple[str, str], Entry]]:
    """N, B and K: mean of the unit's runs, median of the class, and the sd of the class's logarithms."""
    runs = noise_of(sensor)
    for letter in ("N", "B", "K"):
        own = [estimate for (_, which), estimate in runs.items() if which == letter and estimate[0] > 0.0]
        logs = [math.log(unit["noise"][letter]) for unit in of["units"] if unit["noise"][letter] > 0.0]
        if not own or len(logs) < 2:
            continue
        value, error = fmean(size for size, _ in own), max(log_sd for _, log_sd in own)
        median, spread = math.exp(fmean(logs)), stdev(logs)
        both = ((math.log(value), error), (fmean(logs), spread * math.sqrt(1.0 + 1.0 / len(logs))))
        record = {"name": letter, "value": value, "class_median": median, "class_log_sd": spread}
        unit = noise_unit(letter, sensor["kind"])
        sizes = (measured(value, 0.0, *unit), measured(median, median * spread, *unit))
        cells = [tuple(map(str, sizes))]
        yield ("", letter), Entry(letter, cells, record, {"": largest(both, labels=pair)}, f"noise {letter}")


def _answer(compared: Comparison) -> Iterator[str]:
    for group in compared.groups:
        far, lot = differing(group.entries), f"the lot of class {group.members[1]['id']}"
        if far:
            yield f"{group.name} is not typical of {lot}: {far[0][0]} is {far[0][1].size:.1f} sd from it."
        else:
            yield f"{group.name} is typical of {lot}."


def _section(k: int, group: Group, compared: Comparison) -> Section:
    label, lot_label = group.labels
    terms, noise = (
        [
            Row(
                (each.name, *each.cells[0], page.difference(each, 2)),
                strong=each.beyond,
                brief=not each.silent,
            )
            for each in entries.values()
        ]
        for entries in (group.terms, group.noise)
    )
    return Section(
        group.name,
        (
            Prose(" ".join(_sentences(group))),
            page.titled("The terms", group.name, HEAD, terms, "ttffttn"),
            page.titled("Noise", group.name, NOISE_HEAD, noise, "tttn"),
        ),
        f"u{k + 1}",
        f"{group.kind} of {label}, beside the {group.members[1]['id']} of {lot_label}",
        brief=True,
    )


def _sentences(group: Group) -> Iterator[str]:
    far = [f"{name} ({pull.size:.1f} sd)" for name, pull in differing(group.entries)]
    count = sum(entry.pull is not None for entry in group.entries)
    yield (
        f"Beyond what a typical unit shows: {listed(far)}."
        if far
        else f"None of {counted(count, 'value')} is beyond what a typical unit shows."
    )
    silent = [name for name, term in group.terms.items() if term.pull is None]
    if silent:
        yield f"Not tested in the unit or the class: {listed(silent)}."
    if missing := group.record["missing"]:
        yield f"The class-level study does not have {listed(missing)}."


UNITS = page.Comparing(
    units_compared,
    "Is this unit typical of its class? Its terms and noise beside the population of a simulated lot.",
    _answer,
    "A term's sd is that of the unit's estimate (under the full library), of the population's mean, and the"
    " population's spread together; noise is compared by its logarithm with that of the lot's units. The lot"
    " is one batch of its class: another may be wider.",
    _section,
    alone="Their class is not in the class-level study",
    item="{1} ({0}, class {2})",
    keys=("units", "id", "class"),
)


def side_by_side(paths: Sequence[Path]) -> tuple[Page, Mapping[str, Any]]:
    """Compare results of studies: as a page, and as the values of its ``result.json``."""
    files = [written(path) for path in paths]
    for file in files:
        if not {"lots", "sensors"} & file.raw.keys():
            raise no_result(file.path, "it holds no sensors or classes")
    results = [
        read(file, LotsResult, "classes") if "lots" in file.raw else read(file, SensorsResult, "sensors")
        for file in files
    ]
    kinds = frozenset("lots" if "lots" in result else "sensors" for result in results)
    kind = {frozenset({"sensors"}): SENSORS, frozenset({"lots"}): LOTS}.get(kinds, UNITS)
    compared = kind.compared(files, results)
    return page.comparison_page(compared, kind), page.comparison_record(compared, kind)
