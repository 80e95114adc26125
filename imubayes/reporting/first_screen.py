"""The first screen of a study of sensors: its answer in at most 60 words, its status, its picture."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from imubayes.campaign import SensorResult
from imubayes.reporting import canvas
from imubayes.reporting.blocks import GOOD, printable
from imubayes.reporting.case_views import pooled_rows
from imubayes.reporting.chain_views import strain_sentence, unconverged_sentence
from imubayes.reporting.lots_words import short
from imubayes.reporting.noise_views import NAMES, about_noise, decided_sizes, size_text
from imubayes.reporting.population_views import class_needs
from imubayes.reporting.rounding import Rounded, minus, pretty
from imubayes.reporting.rows import fit_scale, term_size
from imubayes.selection.noise_choice import NoiseChoice
from imubayes.selection.verdicts import UNSEEN, by_verdict, listed
from imubayes.study import StudyResult
from imubayes.units import counted

Told = tuple[str, tuple[str, ...]]
"""Verdict, and what its tile holds: the first text that there is room for."""

Column = tuple[str, Mapping[str, Told]]
"""Name of a component or run, and what is told of each term or process."""

FEW = 3
"""Components that a sentence names."""

ROOM, LEFT, KEY, TALL, WIDEST = 440, 64, 30, 44.0, 440
"""px for the rows of a picture, for the names of the terms, for the key below, and of the largest tile."""

MOST_SAID = 700
"""Tiles that say their values where a pointer rests."""

MARK = 12
"""px of the narrowest tile that has a heading."""

STYLES = {
    "needed": ({"facecolor": canvas.ACCENT}, "white"),
    "not needed": ({"facecolor": canvas.SHADES[0]}, canvas.INK),
    "undecided": ({"facecolor": "#f8dfae"}, canvas.INK),
    **dict.fromkeys(UNSEEN, ({"facecolor": "white", "edgecolor": canvas.GREY, "linewidth": 0.6}, canvas.INK)),
}
"""Tile of each verdict, and the colour of its text."""

NOISE_KEY = (
    "Blue: shown, with its size; grey: not there; yellow: undecided; white: the run cannot tell. The same"
    " picture is beside this report, as slide.svg and slide.png."
)

TILES = (
    "Blue: needed, with the value to use; grey: not needed, with the limit that it stays below with 95 %;"
    " yellow: undecided; white: the test cannot tell (? inseparable or unresolved, × not tested)."
)

PICTURE_KEY = f"{TILES} The same picture is beside this report, as slide.svg and slide.png."
"""Of a page whose picture is a slide."""


def first_answer(result: StudyResult) -> str:
    """Answer the page's question by naming terms, in at most 60 words."""
    sensors = result.sensors
    if result.classes:
        return short([text for grade in result.classes for text in class_needs(grade)])
    if all(about_noise(component) for component in sensors):
        return short(_of_noise(sensors))
    said = [text for kind in dict.fromkeys(s.kind for s in sensors) for text in _of_kind(result, kind)]
    doubtful = [sensor.id for sensor in sensors if sensor.conditional]
    last, untold = "", [term.name for term in sensors[0].selection.terms if term.verdict in UNSEEN]
    if untold and len(sensors) == 1:
        others = listed(untold) if len(untold) <= 2 * FEW else f"{len(untold)} others"
        last = f"Of {others} its test cannot tell."
    if len(doubtful) == len(sensors):
        first = (
            f"{said[0][:1].lower()}{said[0][1:]}" if said[0].startswith(("All ", "In ", "No ")) else said[0]
        )
        said[0] = f"If the model held, which the data reject: {first}"
    elif doubtful:
        of = listed(doubtful) if len(doubtful) <= FEW else f"{len(doubtful)} of {len(sensors)} components"
        last = f"The data of {of} reject the model; verdicts there are conditional."
    return short(said, last)


def _of_kind(result: StudyResult, kind: str) -> Iterator[str]:
    """What all components of a kind need, then what some of them need beside it."""
    alike = [component for component in result.sensors if component.kind == kind]
    needs = {
        component.id: [t.name for t in component.selection.terms if t.verdict == "needed"]
        for component in alike
    }
    if len(alike) == 1:
        (name, terms), count = next(iter(needs.items())), len(alike[0].selection.terms)
        yield f"{name} needs {listed(terms or ['none'])} of {counted(count, 'term')}."
        return
    pooled = set[str]()
    if len({component.id.rpartition(".")[0] for component in alike}) == 1:  # which are in one case
        rows = pooled_rows(alike, result.study.costs).get(kind, [])
        pooled = {term for term, _, _, word in rows if word == "needed"}
    names = dict.fromkeys(term.name for sensor in alike for term in sensor.selection.terms)
    every = [t for t in names if t in pooled or all(t in own for own in needs.values())]
    none = f"No term is needed by every {kind}."
    together = any(t not in own for t in every for own in needs.values())
    who = f"{'In one model all' if together else 'All'} {len(alike)} {kind}s"
    yield f"{who} need {listed(every)}." if every else none
    some = Counter(t for own in needs.values() for t in own if t not in every)
    if some:
        having = Counter(term.name for sensor in alike for term in sensor.selection.terms)
        told = [f"{term} ({count} of {having[term]})" for term, count in some.most_common()]
        yield f"Some need{' also' if every else ''} {listed(told)}."


def _of_noise(sensors: Sequence[SensorResult]) -> Iterator[str]:
    """Which processes the runs show: those of one component with sizes."""
    runs = [(component, noise) for component in sensors for noise in component.processes]
    if len(runs) == 1:
        sensor, noise = runs[0]
        told = dict(_processes(sensor, noise))
        sizes = (f"{NAMES[name]} {name} = {told[name][1][0]}" for name in _shown(noise))
        yield f"{sensor.id} shows {listed(list(sizes))}."
        return
    owners = {name: [s.id for s, noise in runs if name in _shown(noise)] for name in NAMES}
    for name, ids in owners.items():
        if ids:
            who = f"All {len(runs)}" if len(ids) == len(runs) else f"{len(ids)} of {len(runs)}"
            who = listed(ids) if len(ids) <= FEW and len(ids) < len(runs) else who
            yield f"{who} show{'s' if len(ids) == 1 else ''} {NAMES[name]} {name}."


def _shown(noise: NoiseChoice) -> list[str]:
    return [name for name in NAMES if name in ("N", *noise.identified)]


def _processes(sensor: SensorResult, noise: NoiseChoice) -> Iterator[tuple[str, Told]]:
    for name, size in decided_sizes(noise, sensor).items():
        if name in NAMES:
            yield name, (size.verdict, _texts(size_text(size, sensor.kind), limit=False))


def _texts(size: Rounded, *, limit: bool) -> tuple[str, ...]:
    """Value with sd and unit, with its unit, and alone."""
    unit, value = pretty(size.unit), f"{'< ' if limit else ''}{size.value}"
    value += f"e{size.exponent}" if size.exponent else ""
    whole = () if limit else (str(size),)
    return tuple(map(minus, (*whole, f"{value} {unit}".rstrip(), value)))


def fit_status(sensors: Sequence[SensorResult]) -> str:
    """Say whether the model fits, or what is wrong."""
    wrong = {
        "data and prior disagree": [s for s in sensors if strain_sentence(s)],
        "chains have not converged": [s for s in sensors if unconverged_sentence(s)],
        "the data reject the model": [s for s in sensors if s.conditional],
        "fit not checked": [s for s in sensors if math.isnan(fit_scale(s)) and not s.conditional],
    }
    of = f" (%d of {counted(len(sensors), 'component')})" if len(sensors) > 1 else ""
    return "; ".join(f"{text}{of % len(s) if of else ''}" for text, s in wrong.items() if s) or GOOD


def counts_of(sensors: Sequence[SensorResult]) -> str:
    """How many terms have each verdict, of all components."""
    counts = Counter(term.verdict for sensor in sensors for term in sensor.selection.terms)
    words = dict.fromkeys(("needed", "not needed", "undecided", *UNSEEN))
    of = f" ({counted(len(sensors), 'component')})" if len(sensors) > 1 else ""
    return " · ".join(f"{counts[word]} {word}" for word in words if counts[word]) + of


def data_of(sensors: Sequence[SensorResult]) -> str:
    """Whether the runs are recorded or simulated."""
    how = {"simulated" if r.source.file == "simulated" else "recorded" for s in sensors for r in s.runs}
    return " and ".join(sorted(how))


def first_panel(sensors: Sequence[SensorResult], key: str) -> canvas.Drawing:
    """Every term of every component, with value and verdict; processes, where noise is all that was asked."""
    if all(map(about_noise, sensors)):
        columns = [
            (s.id if len(s.processes) == 1 else f"{s.id}, {noise.run}", dict(_processes(s, noise)))
            for s in sensors
            for noise in s.processes
        ]
        return _panel(columns, ("process", "shown", "run"), key)
    columns = []
    for sensor in sensors:
        rows = [(term, term_size(term), term.verdict == "not needed") for term in sensor.selection.terms]
        told = {t.name: (t.verdict, _texts(size, limit=limit) if size else ()) for t, size, limit in rows}
        columns.append((sensor.id, told))
    return _panel(columns, ("term", "needed", "component"), key)


def _panel(columns: Sequence[Column], words: tuple[str, str, str], key: str) -> canvas.Drawing:
    """Tiles with a row for each name, in two blocks where there is one column; `words` are for the title."""
    names = list(dict.fromkeys(name for _, told in columns for name in told))
    needed = sum(any(told.get(name, ("",))[0] == "needed" for _, told in columns) for name in names)
    of, is_so, owner = words
    by = f" by some {owner}" if len(columns) > 1 else ""
    blocks = 2 if len(columns) == 1 and len(names) > FEW else 1
    rows, wide = -(-len(names) // blocks), min(WIDEST, (canvas.SLIDE[0] / blocks - LEFT) / len(columns))
    longest = 7.4 * max(len(name) for name, _ in columns)
    stands = len(columns) > 1 and longest > wide
    head = 8.0 if len(columns) == 1 or wide < MARK else min(longest, 130.0) + 8.0 if stands else 24.0
    high = min(TALL, ROOM / rows)
    height = round(head + high * rows + KEY)
    lefts = [LEFT + (j // rows) * canvas.SLIDE[0] / blocks for j in range(len(names))]
    cells = [
        ((lefts[j] + wide * k, head + high * (j % rows), wide, high), f"{column}, {name}", *told[name])
        for j, name in enumerate(names)
        for k, (column, told) in enumerate(columns)
        if name in told
    ]
    said = [(box, f"{where}: {', '.join((word, *texts[:1]))}") for box, where, word, texts in cells]

    def paint(axes: canvas.Axes) -> None:
        axes.set(xlim=(0, canvas.SLIDE[0]), ylim=(height, 0))
        axes.axis("off")
        for k, (name, _) in enumerate(columns if head > 8.0 else ()):
            x, turn = LEFT + wide * (k + 0.5), 90 if stands else 0
            axes.text(x, head - 6, printable(name), ha="center", va="bottom", size=12, rotation=turn)
        for j, name in enumerate(names):
            y = head + high * (j % rows + 0.5)
            axes.text(lefts[j] - 8, y, printable(name), ha="right", va="center", size=12)
        for box, _, word, texts in cells:
            _cell(axes, box, word, texts)
        limits = len(columns) == 1 or wide > MARK
        not_needed = "not needed, and its limit" if is_so == "needed" and limits else f"not {is_so}"
        _key(axes, height - KEY + 6.0, (is_so, not_needed))

    return canvas.draw(
        paint,
        title=f"{needed} of {counted(len(names), of)} {'is' if needed == 1 else 'are'} {is_so}{by}",
        alt="; ".join(
            f"{name}: {by_verdict((term, word) for term, (word, _) in told.items())}"
            for name, told in columns
        ),
        key=key,
        said=said if len(said) <= MOST_SAID else (),
        room=canvas.Room(canvas.SLIDE[0], height, 0, 0, 0, 0),
    )


def _cell(axes: canvas.Axes, box: canvas.Box, word: str, texts: Sequence[str]) -> None:
    style, ink = STYLES.get(word, STYLES["untested"])
    size = min(14.0, 0.62 * box[3])
    marks = ["×" if word == "untested" else "?"] if word in UNSEEN else texts
    told = next(
        (text for text in marks if 0.6 * size * len(text) < box[2] - (2.0 if len(text) == 1 else 6.0)), ""
    )
    canvas.tile(axes, box, told, ink=ink, size=size, **style)


def _key(axes: canvas.Axes, y: float, words: tuple[str, str]) -> None:
    told = [("needed", "", words[0]), ("not needed", "", words[1])]
    told += [("undecided", "", "undecided"), ("unresolved", "?", "cannot tell")]
    told += [("untested", "×", "not tested")]
    for k, (word, mark, text) in enumerate(told):
        style, ink = STYLES[word]
        canvas.tile(axes, (LEFT + 205.0 * k, y, 22, 20), mark, ink=ink, **style)
        axes.text(LEFT + 205.0 * k + 28, y + 10, text, va="center", size=12)
