"""What a terminal alone shows: what a test can tell of each term, and the catalogue of sensor classes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from operator import attrgetter

from rich.console import Group

from imubayes.campaign import SensorCheck
from imubayes.inference.linear import Extra
from imubayes.inference.observability import Observability
from imubayes.reporting.blocks import Block, Both, Prose, Section, Table
from imubayes.reporting.rounding import NOISE
from imubayes.reporting.rows import confounded_sentences, renamed, shortened
from imubayes.selection.verdicts import listed
from imubayes.sensors import COEFFICIENT_KEYS, NOISE_KEYS, PLACES, SOURCE_KINDS, Origins, Range, SensorClass
from imubayes.sensors.catalogue import figure_symbols, prior_sd, reference_errors, terms_of
from imubayes.sensors.catalogue_file import campaign_of, origins_of, packaged_tables
from imubayes.sensors.equations import symbols
from imubayes.sensors.noise import FLOOR
from imubayes.sensors.terms import Kind, Library, library
from imubayes.units import ZERO_CELSIUS, counted, factor

_GLANCE: dict[Kind, tuple[tuple[str, str, str], ...]] = {
    "accelerometer": (("bias", "K0", "ug"), ("scale", "s", "ppm")),
    "gyroscope": (("bias", "b0", "deg/h"), ("scale", "s", "ppm")),
}
"""Heading, key and printed unit of the coefficients that tell a grade."""

INFINITE = 1e12
"""Inflation of a variance from which it is rounding's: the terms are one."""

_LETTERS = {"datasheet": "d", "second_hand": "s", "order_of_magnitude": "o"}
"""Source kinds as one letter a number; the words stand below the table."""

_OTHER = {"B": "floor", "floor": "B"}
"""Of the bias instability a class states one figure; the other follows."""

_LEGEND = Prose(
    "source of low, typical, high: "
    + ", ".join(f"{_LETTERS[kind]} {kind.replace('_', ' ')}" for kind in SOURCE_KINDS),
    "note",
)


def terminal_check(check: SensorCheck) -> Section:
    """Say what the test can tell of each term before anything is fitted, for a rich console.

    The last part of the id names the component where the observability is a triad's (``ax.b0``, ...).
    """
    lib, component = check.library, check.id.rpartition(".")[2]
    seen = renamed(check.observability, {f"{component}.{name}": name for name in lib.names})
    kinds, spelt = {extra.name: extra.kind.replace("_", " ") for extra in check.extras}, symbols(lib)
    place = {name: j for j, name in enumerate(seen.names)}
    rows = []
    for term in lib.terms:
        j, others = place[term.name], (kinds.get(name, name) for name in seen.partners(term.name))
        rows.append(
            (
                term.name,
                spelt[term.name],
                "yes" if seen.tested[j] else Both("", "no", "bold magenta"),
                _ratio(seen.ratio[j]),
                _ratio(seen.alone[j]),
                _inflation(float(seen.vif[j])),
                shortened(tuple(dict.fromkeys(others))),
            )
        )
    head = ("term", "symbol", "excited", "sd / prior sd", "if alone", "inflation", "confounded with")
    words = Prose([*_check_words(seen, lib, check.extras), *check.notes])
    sub = f"{lib.kind}: what this test tells of {counted(len(lib.terms), 'term')}"
    return Section(check.id, [Table("", head, rows, "fffnnnf"), words], sub=sub, brief=True)


def _check_words(seen: Observability, lib: Library, extras: Sequence[Extra]) -> Iterator[str]:
    tested = dict(zip(seen.names, seen.tested, strict=True))
    untested = [name for name in lib.names if not tested[name]]
    groups = [group for group in seen.groups if not {*lib.names}.isdisjoint(group.terms)]
    if untested:
        yield f"No run excites {listed(untested)}."
    yield from confounded_sentences(groups, (), extras)
    if not untested and not groups:
        yield "Every term is excited and separable."


def _ratio(ratio: float) -> str:
    return "-" if not math.isfinite(ratio) else f"{ratio:.3f}" if ratio >= 0.0005 else "<0.001"


def _inflation(vif: float) -> str:
    if math.isnan(vif):
        return "-"
    if vif >= INFINITE:
        return "inf"
    return f"{vif:.1f}" if vif < 1000.0 else f"{vif:.0e}".replace("e+0", "e").replace("e+", "e")


def class_list(entries: Iterable[SensorClass]) -> Group:
    """Classes at a glance, a table a kind: technology, grade, products, typical bias, scale and noise."""
    sections = []
    for kind, several in groupby(sorted(entries, key=attrgetter("kind")), key=attrgetter("kind")):
        told = [(heading, unit) for heading, _, unit in _GLANCE[kind]]
        told += [(name, NOISE[kind][name][0]) for name in "NB"]
        rows = []
        for entry in several:
            figures = [entry.coefficients[key] for _, key, _ in _GLANCE[kind]]
            figures += [entry.noise[name] for name in "NB"]
            sizes = [_printed(figure[1], unit) for figure, (_, unit) in zip(figures, told, strict=True)]
            words = filter(None, (entry.technology, entry.grade, ", ".join(entry.examples[:3])))
            rows.append((entry.id, "; ".join(words), *sizes))
        heads = (f"{heading} {unit}" for heading, unit in told)
        table = Table("", ("class", "technology, grade, products", *heads), rows, "twn")
        sections.append(Section(f"{kind}s, typical figures", [table], brief=True))
    return Group(*sections)


def class_page(entry: SensorClass) -> Section:
    """One class: every figure with its unit and source kind, and the priors that are made of them."""
    lowest, highest = (f"{kelvin - ZERO_CELSIUS:.4g}" for kelvin in entry.temperature)
    unit = entry.units["full_scale"]
    scale = f"{_printed(entry.full_scale, unit, digits=6)} {unit}"
    told = [entry.technology, entry.grade, scale, f"{entry.bandwidth:.3g} Hz", f"{lowest} to {highest} degC"]
    campaign = ""  # the test that fits it, its bench, and where both come from
    if entry.campaign:
        fits = campaign_of(entry)
        bench = ", ".join(f"{name} {size}" for name, size in fits["reference"].items())
        said = "; ".join(f"{kind.replace('_', ' ')}: {text}" for kind, text in fits["source"].items())
        campaign = f'test that fits it (campaign = "class"): {fits["text"]}; bench: {bench} ({said})'
    blocks: list[Block] = [
        Prose(", ".join(told)),
        Prose(f"such as {', '.join(entry.examples)}" if entry.examples else "", "note"),
        _figure_table(entry),
        _LEGEND,
        _prior_table(entry),
        Prose([entry.note, entry.source, campaign]),
    ]
    return Section(entry.id, blocks, sub=entry.kind, brief=True)


def bench_list() -> Section:
    """Errors of test equipment that the catalogue holds, one sigma."""
    written = packaged_tables()["reference"]
    origins = origins_of(written["quoted"], written["figures"])
    rows = []
    for key, values in reference_errors().items():
        unit = written["figures"][key][-1]
        rows.append((key, *_numbers(values, unit), unit, _letters(origins[key])))
    table = Table("", ("error", *PLACES, "unit", "source"), rows, "tnnntt")
    return Section("errors of test equipment, one sigma", [table, _LEGEND], brief=True)


def _figure_table(entry: SensorClass) -> Table:
    """Figures in the order of their keys; of the bias instability the coefficient and the floor."""
    low, typical, high = entry.noise["B"]
    figures = {**entry.coefficients, **entry.noise, "floor": (FLOOR * low, FLOOR * typical, FLOOR * high)}
    rows = []
    for key, meaning in {**COEFFICIENT_KEYS[entry.kind], **NOISE_KEYS[entry.kind]}.items():
        if key not in figures:
            continue
        stated = key if key in entry.units else _OTHER[key]
        unit = entry.units[stated]
        terms = _by_family(terms_of(entry.kind, key)) or meaning.text
        origins = _letters(entry.origins[stated]) if stated == key else f"by {stated}"
        spelt = _by_family(figure_symbols(entry, key))
        numbers = _numbers(figures[key], unit, digits=6 if stated == key else 3)
        rows.append((key, spelt, terms, *numbers, unit, origins))
    return Table("", ("key", "symbol", "term", *PLACES, "unit", "source"), rows, "tffnnntt")


def _prior_table(entry: SensorClass) -> Table:
    """Prior sd of every term of the extended library, and the noise, in the units that people use."""
    lib = library(entry.kind, set="extended", temperature=1, technology=entry.technology)
    spelt, rows = symbols(lib), []
    for term in lib.terms:
        sd, origin = prior_sd(entry, term)
        size = _printed(sd, term.printed, term.unit)
        rows.append((term.name, spelt[term.name], size, term.printed, origin))
    for name in "NBK":
        unit, si = NOISE[entry.kind][name]
        low, typical, high = (_printed(value, unit, si) for value in entry.noise[name])
        rows.append((name, "noise", typical, unit, f"typical of {low} to {high}"))
    return Table("", ("term", "symbol", "prior sd", "unit", "from"), rows, "tfntf")


def _numbers(values: Range, unit: str, *, digits: int = 6) -> tuple[str, ...]:
    """Figure as it is written: six digits hide the rounding of its unit's factor."""
    return tuple(_printed(value, unit, digits=digits) for value in values)


def _printed(value: float, unit: str, si: str = "", *, digits: int = 3) -> str:
    """SI value in its unit; an ordinary number where it is a large one."""
    text = f"{value / factor(unit, like=si or unit):.{digits}g}"
    return f"{float(text):g}" if "e+" in text else text


def _letters(origins: Origins) -> str:
    return " ".join(_LETTERS[kind] for kind in origins)


def _by_family(names: Sequence[str]) -> str:
    """Names of terms, a common beginning once: ``c_ij ik jk``."""
    families = [
        (head, [name.partition("_")[2] for name in family])
        for head, family in groupby(names, key=lambda name: name.partition("_")[0])
    ]
    return ", ".join(f"{head}_{' '.join(tails)}" if any(tails) else head for head, tails in families)
