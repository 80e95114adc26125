"""The report of a fleet: one page, and its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from markupsafe import Markup

from imubayes.algebra import FloatArray
from imubayes.population import Record
from imubayes.population.fleet import FleetResult, Pull
from imubayes.population.needs import NEEDED, UNTOLD, VERDICTS
from imubayes.reporting import canvas
from imubayes.reporting.blocks import (
    Both,
    Figure,
    Page,
    Prose,
    Section,
    Table,
    Text,
    answer,
    bar,
    header,
    link,
    parted,
    repeat,
    swatch,
    verdict,
)
from imubayes.reporting.lots_figures import LETTER
from imubayes.reporting.lots_words import class_name, plain, population_cells
from imubayes.reporting.result import published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.many import Fleet, FleetTerm
from imubayes.reporting.result.many import FleetResult as Published
from imubayes.reporting.rounding import half_up, measured, minus, noise_unit, pretty, ranged, unit_of
from imubayes.selection.verdicts import UNSEEN, listed
from imubayes.sensors.equations import symbols
from imubayes.sensors.terms import Library
from imubayes.units import counted

LINE = 17
"""px of a row of a panel."""

SHOWN = (
    (("needed",), canvas.ACCENT),
    (("undecided",), canvas.VERDICT_COLOURS["undecided"]),
    (UNSEEN, canvas.VERDICT_COLOURS["inseparable"]),
    (("not needed",), canvas.PALE),
)
"""Verdicts that share a colour, in the order of a bar from the left."""

HALF_BAR = 0.36
"""Half height of a bar, in rows."""

NAMED = 5
"""Units that a sentence names before it counts."""

KEY = Markup(
    "From the left: {}units in which the term is needed, {}undecided, {}units whose test cannot tell"
    " (inseparable, unresolved, untested), {}not needed."
).format(*map(swatch, ("#0072B2", "#E69F00", "#CC79A7", "#d5d9df")))

DATASET = Markup(
    "The folder <code>units</code> beside this page is a Parquet dataset with a row for each unit and term:"
    " model-averaged and full-library mean and sd, inclusion, verdict, N, B, K, and a row of the unit's"
    " triangular factor, from which every model of the unit can be weighed again without its runs."
)

PULLS = (
    "Dots: distance from the population's mean, over the sd that its spread and the unit's own error give; of"
    " N that of its logarithm. Beyond the grey band one fleet in a hundred has any unit."
)

UNIT_HEAD = ("term", "symbol", "value", "unit", "inclusion", "verdict", "others", "pull, sd")

UNIT_NOTE = (
    "Value: averaged over the models, with its sd. Others: mean of the population with its 90 % interval."
    " Pull: distance from it over the sd that the population's spread and the unit's own error give, under"
    " the full library."
)


def fleet_page(result: FleetResult) -> Page:
    """Page of a fleet."""
    study = result.study
    how = "simulated" if study.simulated else "recorded"
    kind = f"{class_name(study.sensor_class)} {study.spec.kind}s"
    rows = [
        (name, *(f"{count:,}" if count else "" for count in own))
        for name, own in zip(study.spec.library.names, result.counts.T.tolist(), strict=True)
    ]
    counts = Table("Units with each verdict", ("term", *VERDICTS), rows, "tn", "Number of units.")
    noise = []
    for name, share in zip("NBK", result.noise, strict=True):
        unit, size = noise_unit(name, study.spec.kind)
        value, low, high = (plain(x / size) for x in (share.value, share.low, share.high))
        noise.append((name, f"{value} ({low} to {high}) {pretty(unit)}"))
    over = Table("Noise over the units", ("noise", "median (90 % of the units)"), noise)
    kept = f"{counted(result.resumed, 'unit')} {'was' if result.resumed == 1 else 'were'} there already"
    done = f"{result.engine}, {result.seconds:.0f} s{f'; {kept}' if result.resumed else ''}"
    first, rest = parted(fleet_answer(result))
    said = Prose([" ".join(rest), f"Done by {done}."])
    units = [_unit_page(result, k, how) for k in range(len(result.worst))]
    return Page(
        study.title,
        f"{len(study.units):,} {how} {kind}, each through the same test and decided on its own;"
        f" {result.samples:,} samples.",
        first=[answer(first), Figure([verdict_panel(result, "v")], KEY)],
        counts=_counts(result.counts.sum(axis=1).tolist())
        + f" ({counted(len(study.spec.library.names), 'term')} of {counted(result.units, 'unit')})",
        data=how,
        blocks=[
            Section("The population", [said, _population(result)], "population", brief=True),
            Section("Verdicts", [counts], "verdicts"),
            Section("Units that stand out", [_worst(result), *units], "worst"),
            Section("Noise", [over], "noise"),
            *_broken(result),
            repeat(f"imubayes run {study.path}", study.text, f"Seed {study.seed}.", DATASET),
        ],
    )


def _population(result: FleetResult) -> Table:
    simulated = result.study.simulated
    true = (Both("true", None),) if simulated else ()
    told = " True: of the lot that was simulated." if simulated else ""
    return Table(
        "Population of the units",
        ("term", Both("symbol", None), "mean", *true, "spread", *true, "unit", "needed", Both("open", None)),
        [*population_cells(result.terms, result.study.spec.library, true=simulated)],
        "ttn",
        "Mean and spread of the units: a hierarchical posterior with 90 % intervals, which does not take"
        f" the error of each unit's test for the spread of the units.{told} Needed, open (undecided, or"
        " the test cannot tell): shares of the units. Of a term that the test does not excite mean and"
        " spread are those of the catalogue.",
    )


def verdict_panel(result: FleetResult, key: str) -> canvas.Drawing:
    """Share of the units with each verdict, a bar for each term."""
    names = result.study.spec.library.names
    counts: dict[str, np.ndarray] = dict(zip(VERDICTS, result.counts, strict=True))
    mostly = sum(term.answer == NEEDED for term in result.terms)

    def paint(axes: canvas.Axes) -> None:
        left = np.zeros(len(names))
        for verdicts, colour in SHOWN:
            right = left + 100.0 * np.sum([counts[verdict] for verdict in verdicts], axis=0) / result.units
            rows = enumerate(zip(left.tolist(), right.tolist(), strict=True))
            canvas.areas(
                axes, [(a, b, row - HALF_BAR, row + HALF_BAR) for row, (a, b) in rows if b > a], colour
            )
            left = right
        canvas.few_ticks(axes, 4, len(names))
        axes.set(xlabel="units, %", xlim=(0.0, 100.0))
        canvas.rows_of(axes, names)

    alt = "Units in which each term is needed: " + "; ".join(
        f"{term.name} {100.0 * term.needed.value:.0f} %" for term in result.terms
    )
    title = f"{mostly} of {len(names)} terms are needed by most units"
    left = int(14 + LETTER * max(map(len, names)))
    return canvas.draw(
        paint, title=title, alt=alt, key=key, room=canvas.Room(height=LINE * len(names) + 50, left=left)
    )


def _worst(result: FleetResult) -> Table:
    lib, rows = result.study.spec.library, []
    for k, pull in enumerate(result.worst, 1):
        unit, stands = link(pull.unit, f"unit-{k}"), "yes" if pull.outlier else ""
        rows.append((unit, pull.term, pull_value(pull, lib), _pull(pull.pull), stands))
    return Table(
        "Units farthest from the population",
        ("unit", "term", "value", "pull, sd", "stands out"),
        rows,
        "ttn",
        "The units that are farthest from the population, each in the term in which it is farthest:"
        " distance from the mean over the sd that the population's spread and the unit's own error give;"
        " for N, of its logarithm from the median. Of units that are alike, one fleet in a hundred has"
        f" any beyond {result.limit:.1f} sd. A unit beyond is not one of the population that the"
        " others are of: look at its test, then at the unit.",
    )


def _unit_page(result: FleetResult, k: int, how: str) -> Page:
    """Page of the k-th of the units that are farthest from the population."""
    farthest, lib = result.worst[k], result.study.spec.library
    unit, pulls = result.farthest[k]
    anchor, said = f"unit-{k + 1}", dict(zip(lib.names, unit.verdicts, strict=True))
    needs = [name for name, word in said.items() if word == NEEDED]
    unseen = [name for name, word in said.items() if word in UNSEEN]
    told = [
        f"{unit.name} needs {listed(needs or ['none'])} of {counted(len(lib.names), 'term')}.",
        f"It is farthest from the others in {farthest.term}: {pull_value(farthest, lib)}, {_sd(farthest)}.",
    ]
    first, rest = parted([*told, f"Of {listed(unseen)} its test cannot tell."] if unseen else told)
    table = Table(f"Terms of {unit.name}", UNIT_HEAD, _unit_rows(result, unit, pulls), "ttntntnn", UNIT_NOTE)
    levels = []
    for name, level in zip("NBK", unit.noise, strict=True):
        printed, size = noise_unit(name, lib.kind)
        levels.append(f"{name} {plain(level / size, printed)}")
    return Page(
        unit.name,
        "Which terms does this unit need, and how far is it from the others?",
        first=[answer(first), Figure([pull_panel(result, unit.name, pulls, f"pull{k + 1}")], PULLS)],
        counts=_counts(map(unit.verdicts.count, VERDICTS)),
        data=how,
        blocks=[
            Section("The terms", [Prose(rest), table], f"{anchor}-terms"),
            Section("The noise", [Prose(f"Over its runs: {listed(levels)}.")], f"{anchor}-noise"),
        ],
        anchor=anchor,
    )


def _unit_rows(result: FleetResult, unit: Record, pulls: FloatArray) -> list[tuple[Text, ...]]:
    lib, rows = result.study.spec.library, []
    spelt = symbols(lib)
    for j, (term, known) in enumerate(zip(lib.terms, result.terms, strict=True)):
        (_, size), word = unit_of(term), unit.verdicts[j]
        text = str(measured(unit.mean[j], unit.sd[j], size=size))
        inclusion = bar(unit.inclusion[j], seen=word not in UNSEEN)
        cells = (spelt[term.name], text, pretty(term.printed), inclusion, verdict(word))
        rows.append((term.name, *cells, ranged(known.mean, size=size), _pull(pulls[j])))
    return rows


def pull_panel(result: FleetResult, name: str, pulls: FloatArray, key: str) -> canvas.Drawing:
    """How far a unit is from the population in each term and in N."""
    rows, limit = [*result.study.spec.library.names, "N"], result.limit
    beyond = [row for row, pull in zip(rows, pulls.tolist(), strict=True) if abs(pull) > limit]

    def paint(axes: canvas.Axes) -> None:
        axes.axvspan(-limit, limit, color=canvas.PALE, linewidth=0.0)
        axes.axvline(0.0, color=canvas.GREY, linewidth=0.8)
        canvas.dots(axes, pulls, np.arange(len(rows), dtype=float), canvas.ACCENT, 6.0)
        canvas.rows_of(axes, rows)
        reach = 1.1 * max(limit, float(np.max(np.abs(pulls))))
        axes.set(xlabel="distance from the population, sd", xlim=(-reach, reach))

    alt = "; ".join(f"{row} {pull:+.1f}" for row, pull in zip(rows, pulls.tolist(), strict=True))
    title = f"{name} is beyond the others in {listed(beyond)}" if beyond else f"{name} is like the others"
    left = int(14 + LETTER * max(map(len, rows)))
    return canvas.draw(
        paint,
        title=title,
        alt=f"Pulls: {alt}",
        key=key,
        room=canvas.Room(height=LINE * len(rows) + 50, left=left),
    )


def _broken(result: FleetResult) -> Iterator[Section]:
    if broken := result.broken:
        title, rows = "Units that could not be read", [(unit.name, unit.error) for unit in broken]
        note = (
            "They are in no number of this page. With their files mended, the same command with --resume"
            " reads them and leaves the others as they are."
        )
        yield Section(title, [Table(title, (), rows, "tw", note)], "broken")


def fleet_json(result: FleetResult) -> str:
    """Text of ``result.json`` of a fleet."""
    study, library = result.study, result.study.spec.library
    spelt, counts = symbols(library), result.counts.T.tolist()
    terms = [
        published(
            FleetTerm, known, term, symbol=spelt[term.name], verdicts=dict(zip(VERDICTS, own, strict=True))
        )
        for term, known, own in zip(library.terms, result.terms, counts, strict=True)
    ]
    about = {"kind": study.spec.kind, "class": study.sensor_class.id, "units": len(study.units)}
    fleet = published(Fleet, result, **about, read=result.units, terms=terms)
    head = header(study, f"imubayes run {study.path}")
    return result_text(published(Published, result, **head, answer=fleet_answer(result), fleet=fleet))


def fleet_answer(result: FleetResult) -> tuple[str, ...]:
    """The answer in sentences: how large a unit's model is, what stands out, what could not be read."""
    spec = result.study.spec
    mostly = [term.name for term in result.terms if term.answer == NEEDED]
    untold = [term.name for term in result.terms if term.answer == UNTOLD]
    kind = f"{spec.kind}s" if result.units != 1 else spec.kind
    sentences = [
        f"{result.units:,} {class_name(result.study.sensor_class)} {kind}: the median unit needs "
        f"{half_up(result.order.value):.0f} of {counted(len(result.terms), 'term')} (90 % of the units: "
        f"{half_up(result.order.low):.0f} to {half_up(result.order.high):.0f}).",
        f"Needed in half of the units or more: {', '.join(mostly) or 'none'}.",
    ]
    if untold:
        sentences.append(f"The test leaves open in half of the units or more: {', '.join(untold)}.")
    sentences.append(standing_out(result))
    if broken := result.broken:
        named = "; ".join(f"{unit.name}: {unit.error}" for unit in broken[:NAMED])
        more = f"; and {len(broken) - NAMED} more" if len(broken) > NAMED else ""
        of = f"{counted(len(broken), 'unit')} of {len(result.study.units):,}"
        sentences.append(f"{of} could not be read: {named}{more}.")
    return tuple(sentences)


def standing_out(result: FleetResult) -> str:
    """Which units are farther from the population than is expected of any."""
    lib = result.study.spec.library
    expected = f"beyond {result.limit:.1f} sd, where one fleet in a hundred has any unit"
    if not result.outliers:
        return (
            f"No unit stands out from the population ({expected}; the farthest is at {_sd(result.worst[0])})."
        )
    named = [pull for pull in result.worst if pull.outlier][:NAMED]
    texts = [f"{pull.unit} in {pull.term} ({_sd(pull)}, {pull_value(pull, lib)})" for pull in named]
    more = f" and {result.outliers - len(named)} more" if result.outliers > len(named) else ""
    stand = f"{counted(result.outliers, 'unit')} stand{'s' if result.outliers == 1 else ''}"
    return f"{stand} out from the population ({expected}): {', '.join(texts)}{more}."


def _sd(pull: Pull) -> str:
    return f"{_pull(pull.pull)} sd"


def _pull(size: float) -> str:
    return minus(f"{size:+.1f}")


def _counts(counts: Iterable[int]) -> str:
    """How many there are of each verdict."""
    told = zip(VERDICTS, counts, strict=True)
    return " · ".join(f"{count:,} {word}" for word, count in told if count)


def pull_value(pull: Pull, lib: Library) -> str:
    """Value of a unit's term that stands out, in the unit people use."""
    terms = {term.name: unit_of(term) for term in lib.terms}
    printed, size = terms.get(pull.term) or noise_unit("N", lib.kind)
    return plain(pull.value / size, pretty(printed))
