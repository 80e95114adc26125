"""The catalogue in a terminal: its classes at a glance, and one class with every figure and prior."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from imubayes.reporting.blocks import indented, printable
from imubayes.reporting.rounding import NOISE
from imubayes.sensors.catalogue import figure_symbols, prior_sd, reference_errors, terms_of
from imubayes.sensors.catalogue_file import campaign_of, origins_of, packaged_tables
from imubayes.sensors.equations.standards import symbols
from imubayes.sensors.noise import FLOOR
from imubayes.sensors.sensor_class import (
    COEFFICIENT_KEYS,
    NOISE_KEYS,
    PLACES,
    SOURCE_KINDS,
    Key,
    Origins,
    Range,
    SensorClass,
)
from imubayes.sensors.terms import Kind, library
from imubayes.units import ZERO_CELSIUS, factor

_GLANCE: dict[Kind, tuple[tuple[str, str, str], ...]] = {
    "accelerometer": (("bias", "K0", "ug"), ("scale", "s", "ppm")),
    "gyroscope": (("bias", "b0", "deg/h"), ("scale", "s", "ppm")),
}
"""Heading, key and printed unit of the coefficients that tell a grade."""

_LETTERS = {"datasheet": "d", "second_hand": "s", "order_of_magnitude": "o"}
"""Source kinds as one letter a number; the words stand below the table."""

_OTHER = {"B": "floor", "floor": "B"}
"""Of the bias instability a class states one figure; the other follows."""

_LEGEND = "source of low, typical, high: " + ", ".join(
    f"{_LETTERS[kind]} {kind.replace('_', ' ')}" for kind in SOURCE_KINDS
)


def class_list(entries: Iterable[SensorClass]) -> Group:
    """Classes at a glance, a table a kind: technology, grade, products, typical bias, scale and noise.

    It fits 80 columns; without a terminal it is plain text.
    """
    parts: list[RenderableType] = []
    for kind, members in groupby(sorted(entries, key=_kind), key=_kind):
        parts += [Text(f"{kind}s, typical figures", style="bold"), _glance_table(kind, list(members)), Text()]
    return Group(*parts)


def class_page(entry: SensorClass) -> Group:
    """One class: every figure with its unit and source kind, and the priors that are made of them."""
    lowest, highest = (f"{kelvin - ZERO_CELSIUS:.4g}" for kelvin in entry.temperature)
    unit = entry.units["full_scale"]
    scale = f"{_printed(entry.full_scale, unit, digits=6)} {unit}"
    told = [entry.technology, entry.grade, scale, f"{entry.bandwidth:.3g} Hz", f"{lowest} to {highest} degC"]
    return Group(
        Text(printable(f"{entry.id}  {entry.kind}"), style="bold"),
        indented(", ".join(told)),
        *([indented(f"such as {', '.join(entry.examples)}", "dim")] if entry.examples else []),
        Text(),
        _figure_table(entry),
        indented(_LEGEND, "dim"),
        Text(),
        _prior_table(entry),
        Text(),
        *(indented(text) for text in (entry.note, entry.source, *_campaign(entry)) if text),
    )


def _campaign(entry: SensorClass) -> Iterator[str]:
    """The test that fits a class, its bench, and where both come from."""
    if entry.campaign:
        fits = campaign_of(entry)
        bench = ", ".join(f"{name} {size}" for name, size in fits["reference"].items())
        said = "; ".join(f"{kind.replace('_', ' ')}: {text}" for kind, text in fits["source"].items())
        yield f'test that fits it (campaign = "class"): {fits["text"]}; bench: {bench} ({said})'


def bench_list() -> Group:
    """Errors of test equipment that the catalogue holds, one sigma."""
    written = packaged_tables()["reference"]
    origins = origins_of(written["quoted"], written["figures"])
    table = _plain_table("error", *PLACES, "unit", "source", numbers=PLACES)
    for key, values in reference_errors().items():
        unit = written["figures"][key][-1]
        table.add_row(key, *_numbers(values, unit), unit, _letters(origins[key]))
    return Group(Text("errors of test equipment, one sigma", style="bold"), table, indented(_LEGEND, "dim"))


def _kind(entry: SensorClass) -> Kind:
    return entry.kind


def _glance_table(kind: Kind, entries: Sequence[SensorClass]) -> Table:
    told = [(f"{heading}\n{unit}", unit) for heading, _, unit in _GLANCE[kind]]
    told += [(f"{name}\n{unit}", unit) for name in "NB" for unit in NOISE[kind][name][:1]]
    headings = [heading for heading, _ in told]
    table = _plain_table("class", "technology, grade, products", *headings, numbers=headings)
    keys = [key for _, key, _ in _GLANCE[kind]]
    for entry in entries:
        figures = [entry.coefficients[key] for key in keys] + [entry.noise[name] for name in "NB"]
        sizes = [_printed(figure[1], unit) for figure, (_, unit) in zip(figures, told, strict=True)]
        words = "; ".join(filter(None, (entry.technology, entry.grade, ", ".join(entry.examples[:3]))))
        table.add_row(printable(entry.id), Text(printable(words)), *sizes)
    return table


def _figure_table(entry: SensorClass) -> Table:
    table = _plain_table("key", "symbol", "term", *PLACES, "unit", "source", numbers=PLACES)
    for key, meaning, values in _figures(entry):
        stated = key if key in entry.units else _OTHER[key]
        unit = entry.units[stated]
        terms = _shortened(terms_of(entry.kind, key)) or meaning.text
        origins = _letters(entry.origins[stated]) if stated == key else f"by {stated}"
        spelt = _shortened(figure_symbols(entry, key))
        numbers = _numbers(values, unit, digits=6 if stated == key else 3)
        table.add_row(key, spelt, terms, *numbers, Text(printable(unit)), origins)
    return table


def _figures(entry: SensorClass) -> Iterator[tuple[str, Key, Range]]:
    """Figures in the order of their keys; of the bias instability the coefficient and the floor."""
    low, typical, high = entry.noise["B"]
    floor = {"floor": (FLOOR * low, FLOOR * typical, FLOOR * high)}
    for keys, figures in (
        (COEFFICIENT_KEYS[entry.kind], entry.coefficients),
        (NOISE_KEYS[entry.kind], {**entry.noise, **floor}),
    ):
        yield from ((key, meaning, figures[key]) for key, meaning in keys.items() if key in figures)


def _prior_table(entry: SensorClass) -> Table:
    """Prior sd of every term of the extended library, and the noise, in the units that people use."""
    table = _plain_table("term", "symbol", "prior sd", "unit", "from", numbers=("prior sd",))
    lib = library(entry.kind, set="extended", temperature=1, technology=entry.technology)
    spelt = symbols(lib)
    for term in lib.terms:
        sd, origin = prior_sd(entry, term)
        table.add_row(
            term.name, spelt[term.name], _printed(sd, term.printed, term.unit), term.printed, origin
        )
    for name in "NBK":
        unit, si = NOISE[entry.kind][name]
        low, typical, high = (_printed(value, unit, si) for value in entry.noise[name])
        table.add_row(name, "noise", typical, unit, f"typical of {low} to {high}")
    return table


def _numbers(values: Range, unit: str, *, digits: int = 6) -> tuple[str, ...]:
    """Figure as it is written: six digits hide the rounding of its unit's factor."""
    return tuple(_printed(value, unit, digits=digits) for value in values)


def _printed(value: float, unit: str, si: str = "", *, digits: int = 3) -> str:
    """SI value in its unit; an ordinary number where it is a large one."""
    text = f"{value / factor(unit, like=si or unit):.{digits}g}"
    return f"{float(text):g}" if "e+" in text else text


def _letters(origins: Origins) -> str:
    return " ".join(_LETTERS[kind] for kind in origins)


def _shortened(names: Sequence[str]) -> str:
    """Names of terms, a common beginning once: ``c_ij ik jk``."""
    families = [
        (head, [name.partition("_")[2] for name in family])
        for head, family in groupby(names, key=lambda name: name.partition("_")[0])
    ]
    return ", ".join(f"{head}_{' '.join(tails)}" if any(tails) else head for head, tails in families)


def _plain_table(*headings: str, numbers: Sequence[str] = ()) -> Table:
    """Table without lines; its first column, its numbers and their units are never broken or cut."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="dim", show_edge=False)
    whole = (headings[0], "unit", "source", *numbers)
    for heading in headings:
        justify = "right" if heading in numbers else "left"
        table.add_column(heading, justify=justify, no_wrap=heading in whole, overflow="fold")
    return table
