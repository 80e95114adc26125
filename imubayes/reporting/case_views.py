"""What components share for being in one case: known quantities recovered, and terms that the kind needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from imubayes.campaign import SensorResult
from imubayes.inference.known_quantities import Recovered
from imubayes.reporting import blocks
from imubayes.reporting.canvas import GREY, PALE, SERIES, Axes, Drawing, Room, draw, few_ticks
from imubayes.reporting.fit_views import held
from imubayes.reporting.rounding import Rounded, in_unit, measured, per_unit, pretty, signed
from imubayes.reporting.scene_words import case_sentences
from imubayes.scenes.relevance import CaseRelevance
from imubayes.selection.verdicts import EQUAL, UNSEEN, Costs, listed
from imubayes.study import StudyResult

Cases = Mapping[str, Sequence["SensorResult"]]
"""Components that were found together, by the id of their sensor."""

PooledRow = tuple[str, tuple[str, ...], float, str]
"""A term of a kind: name, verdict of each component (empty where it has no such term), inclusion in one model
for all, and verdict: ``needed``, ``not needed``, ``undecided``, or ``cannot tell`` where no test can."""

CANNOT = "cannot tell"
"""Of a term of which no component's test tells: pooling tells no more."""

MOST_DRAWN = 3
"""Cases of a study whose errors are drawn."""


class QuantityWords(NamedTuple):
    """A known quantity: in a row, at the start of a sentence, on an axis; what is counted; and its units."""

    row: str
    sentence: str
    name: str
    place: str
    printed: str
    si: str


KNOWN = {
    "gravity": QuantityWords(
        "length of the force in a still, from local g",
        "Length of the force in the stills, from local g", "|f| − g", "still", "mg", "m/s^2"),
    "rate": QuantityWords(
        "length of the rate in a section, from the table's",
        "Length of the rate in the sections, from the table's", "|w| − table", "section", "deg/s", "rad/s"),
    "rest": QuantityWords("rate in a still", "Rates in the stills", "rate", "still", "deg/s", "rad/s"),
    "closure": QuantityWords(
        "up carried through a turn, from up in the next still",
        "Up carried through the turns", "error of up", "turn", "deg", "rad"),
    "turn": QuantityWords(
        "angle of a known turn", "Angles of the known turns", "error of the turn", "turn", "deg", "rad"),
}  # fmt: skip
"""Known quantities by what `imubayes.inference.known_quantities` calls them."""

UNIT = "urad"

HIDDEN = 2.0
"""A misalignment that is so much less certain than the angles between axes has something else in it: two
misalignments that are each known make an angle that is known less well than either."""

HEADS = {
    "accelerometer": "accelerometers",
    "gyroscope": "gyroscopes",
    "gyroscopes against accelerometers": "gyroscopes less accelerometers",
}
"""Columns of the table of angles, by what an angle is of."""

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
    "Components of one kind with one model: all have a term or none, each with a coefficient of its own, by"
    " their estimates under all terms. Shapes are each component's own verdict:"
    f" {blocks.LEGEND}. Terms that not all components have are not asked."
)


def cases_of(result: StudyResult) -> Cases:
    """Cases of a study."""
    cases: dict[str, list[SensorResult]] = {}
    for sensor in result.sensors:
        if sensor.pooled or sensor.recovered or (sensor.calibration or {}).get("angles"):
            cases.setdefault(sensor.id.rpartition(".")[0], []).append(sensor)
    return cases


def case_answer(name: str, sensors: Sequence[SensorResult], costs: Costs) -> tuple[str, ...]:
    """First paragraph on a case by sentence: what its kinds need, and what compensation recovers."""
    kinds = pooled_rows(sensors, costs)
    needs = [text for kind, rows in kinds.items() if (text := _need(kind, rows, sensors))]
    said = [f"{name} as a whole: {'; '.join(needs)}." if needs else f"{name} as a whole."]
    for quantity in sensors[0].recovered:
        where = _of_several(quantity, sensors[0].recovered)
        sizes = ("before", "after", "fresh" if quantity.saturated else "fitted")
        before, after, predicted = (in_unit(_rms(quantity, size)) for size in sizes)
        said.append(
            f"{KNOWN[quantity.what].sentence}{where}: {before} rms raw, {after} compensated;"
            f" the posterior predicts {predicted}{' for new ones' if quantity.saturated else ''}."
        )
    return tuple(said)


def _need(kind: str, rows: Sequence[PooledRow], sensors: Sequence[SensorResult]) -> str:
    """Say what all components of a kind need, and what some need beside it: not all have every term."""
    needed = [term for term, _, _, word in rows if word == "needed"]
    also: dict[tuple[str, ...], list[str]] = {}
    for sensor in sensors:
        own = (term.name for term in sensor.selection.terms if term.verdict == "needed")
        if sensor.kind == kind and (more := tuple(name for name in own if name not in needed)):
            also.setdefault(more, []).append(sensor.id.rpartition(".")[2])
    said = [f"its {kind}s need {listed(needed)}"] if needed else []
    beside = " also" if needed else ""
    for terms, names in also.items():
        said.append(f"{listed(names)} {'needs' if len(names) == 1 else 'need'}{beside} {listed(terms)}")
    return "; ".join(said)


def cases_section(cases: Cases) -> blocks.Section:
    """Known quantities of many cases, and how many errors lie within 2 sd of what is predicted."""
    every = [(name, quantity) for name, sensors in cases.items() for quantity in sensors[0].recovered]
    told = []
    for what in dict.fromkeys(quantity.what for _, quantity in every):
        alike = [quantity for _, quantity in every if quantity.what == what]
        inside, of = (
            sum(quantity.inside for quantity in alike),
            sum(quantity.after.size for quantity in alike),
        )
        told.append(
            f"{KNOWN[what].sentence}: {inside} of {of} lie within 2 sd of what is predicted"
            f"{held(inside, of) or ', as many as there should be'}."
        )
    rows = [(name, *_cells(quantity)) for name, quantity in every]
    label = "Known quantities before and after compensation"
    table = blocks.Table(label, ("unit", *RECOVERED), rows, "twtnnnnnntn", MANY_NOTE)
    return blocks.Section("Raw and compensated", [blocks.Prose(" ".join(told)), table], "cases")


def case_section(
    name: str, key: str, sensors: Sequence[SensorResult], costs: Costs, scenes: Sequence[CaseRelevance] = ()
) -> blocks.Section:
    """One case: its known quantities, how its axes lie, what each kind and each scene needs."""
    parts: list[blocks.Section] = []
    if quantities := sensors[0].recovered:
        label = f"Known quantities of {name} before and after compensation"
        table = blocks.Table(label, RECOVERED, [_cells(quantity) for quantity in quantities], "wtnnnnnntn")
        note = Markup("{}{}").format(RECOVERED_NOTE, AXES_NOTE if len(quantities) > 1 else "")
        panels = [
            recovered(quantity, f"{key}p{k}", _of_several(quantity, quantities))
            for k, quantity in enumerate(quantities)
        ]
        parts.append(blocks.Section("Raw and compensated", [table, blocks.Figure(panels, note)]))
    parts += angle_sections(name, sensors)
    kinds = pooled_rows(sensors, costs)
    parts += [_pooled_section(name, kind, rows, sensors) for kind, rows in kinds.items()]
    last: list[blocks.Block] = [blocks.Prose(blocks.Both(POOLED_NOTE, None), "note")] if kinds else []
    if scenes:
        told = blocks.Prose([" ".join(case_sentences(relevance, name)) for relevance in scenes], "list")
        last.append(blocks.Section("What the scenes require of all components together", [told], brief=True))
    said = blocks.answer(case_answer(name, sensors, costs))
    return blocks.Section(f"{name} as a whole", [said, *parts, *last], key, brief=True)


def _of_several(quantity: Recovered, every: Sequence[Recovered]) -> str:
    """Which run it is of, where they are of several."""
    return f", in run {quantity.run}" if any(other.run != quantity.run for other in every) else ""


def recovered(quantity: Recovered, key: str, where: str = "") -> Drawing:
    """Draw the error of each still or turn with the band of ± 2 sd that is predicted."""
    held = f"{quantity.inside} of {quantity.after.size} within 2 sd"
    known = KNOWN[quantity.what]
    after, expected = (x / per_unit(known.printed, known.si) for x in (quantity.after, quantity.expected))

    def paint(axes: Axes) -> None:
        count, width = after.shape
        number = np.arange(1, count + 1, dtype=float)
        band = 2.0 * expected.max(axis=1)
        axes.fill_between(number, -band, band, color=PALE, linewidth=0.0, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for c, marker in enumerate("os^"[:width]):
            axes.plot(number, after[:, c], marker, color=SERIES[c], markersize=3.5)
        axes.set(xlim=(0.4, count + 0.6), xlabel=known.place, ylabel=f"{known.name}, {pretty(known.printed)}")
        few_ticks(axes, 5, 4)
        axes.set_xticks(np.unique(np.linspace(1, count, min(count, 6)).round().astype(int)))

    return draw(
        paint,
        title=f"{known.name} after compensation{where}: {held}",
        alt=f"{known.name} by {known.place}{where}, {len(quantity.after)} of them, with the predicted ± 2 sd:"
        f" {held}",
        key=key,
        room=Room(height=170, left=54),
    )


def _cells(quantity: Recovered) -> tuple[str, ...]:
    sizes = [signed(_rms(quantity, size)) for size in ("before", "after", "flown")]
    sizes += [
        "–" if quantity.saturated else signed(_rms(quantity, "fitted")),
        signed(_rms(quantity, "fresh")),
    ]
    known, inside = KNOWN[quantity.what], f"{quantity.inside} of {quantity.after.size}"
    return (known.row, quantity.run, str(len(quantity.after)), *sizes, pretty(known.printed), inside)


def _rms(quantity: Recovered, size: str) -> Rounded:
    known = KNOWN[quantity.what]
    value = root_mean_square(getattr(quantity, size), quantity.what)
    return measured(value, 0.0, known.printed, per_unit(known.printed, known.si))


def root_mean_square(errors: np.ndarray, what: str) -> float:
    """Rms of errors (m, c); the two directions of a closure are one angle."""
    squares = np.asarray(errors) ** 2
    return float(np.sqrt(squares.sum(axis=1).mean() if what == "closure" else squares.mean()))


def angle_sections(name: str, sensors: Sequence[SensorResult]) -> Iterator[blocks.Section]:
    """Rotations and non-orthogonality of a case's triads; nothing where directions were not known."""
    calibration: Mapping[str, Any] = sensors[0].calibration or {}
    angles = calibration.get("angles", [])
    if not angles:
        return
    columns = list(dict.fromkeys(angle["of"] for angle in angles))
    told = {(angle["name"], angle["of"]): signed(_angle(angle["mean"], angle["sd"])) for angle in angles}
    names = dict.fromkeys(angle["name"] for angle in angles)
    rows = []
    for angle in names:
        what, _, axes = angle.partition("_")
        between = f"non-orthogonality of {axes[0]} and {axes[-1]}"
        words = f"rotation about {axes}" if what == "rotation" else between
        rows.append((words, *(told.get((angle, of), "") for of in columns)))
    head = (f"angle, {pretty(UNIT)}", *(HEADS[of] for of in columns))
    table = blocks.Table(f"Rotation and non-orthogonality of {name}", head, rows, note=ANGLES_NOTE)
    yield blocks.Section(
        "How the axes lie", [blocks.Prose([*map(pretty, _angle_sentences(sensors, angles))]), table]
    )


def _angle(mean: float, sd: float) -> Rounded:
    return measured(mean, sd, UNIT, per_unit(UNIT, "rad"))


def _angle_sentences(sensors: Sequence[SensorResult], angles: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Say of each kind whether the rotation of its triad is known as well as the angles between its axes."""
    for kind in dict.fromkeys(sensor.kind for sensor in sensors):
        known = [a["sd"] for a in angles if a["of"] == kind and a["name"].startswith("nonorthogonality")]
        terms = [t for sensor in sensors if sensor.kind == kind for t in sensor.selection.terms]
        single = [term.full_sd for term in terms if term.name in ("m_j", "m_k")]
        if not known or not single:
            continue
        between, alone = (_angle(size, 0.0).value for size in (max(known), max(single)))
        less = ", their", "how the case as a whole lay in its fixture is known no better"
        well = ", and their", "their rotation as a whole is known about as well"
        their, rotation = less if max(single) > HIDDEN * max(known) else well
        yield (
            f"The angles between the axes of the {kind}s are known to {between} {UNIT}{their} misalignments"
            f" against the case to {alone} {UNIT}: {rotation}."
        )


def _pooled_section(
    name: str, kind: str, rows: Sequence[PooledRow], sensors: Sequence[SensorResult]
) -> blocks.Section:
    names = [sensor.id for sensor in sensors if sensor.kind == kind]
    cells: list[tuple[blocks.Text, ...]] = []
    for term, verdicts, inclusion, word in rows:
        told = (blocks.bar(inclusion), blocks.verdict(word))
        if word == CANNOT:
            told = (blocks.quiet("as the prior"), blocks.verdict(CANNOT, like="unresolved"))
        cells.append((term, *map(blocks.shape, verdicts), *told))
    label, head = f"Terms that the {kind}s of {name} need", ("term", *names, "in one model", "verdict")
    table = blocks.Table(label, head, cells, f"t{'m' * len(names)}nt")
    alone = [term for term, verdicts, _, word in rows if word == "needed" and set(verdicts) != {"needed"}]
    said = f"Not every {kind} shows {listed(alone)} by itself." if alone else ""
    return blocks.Section(f"Does this kind need it: {kind}s", [blocks.Prose(said), table])


def pooled_rows(sensors: Sequence[SensorResult], costs: Costs) -> dict[str, list[PooledRow]]:
    """Terms that each kind of component of a case needs, of those that all of its components have."""
    kinds: dict[str, list[PooledRow]] = {}
    for kind in dict.fromkeys(sensor.kind for sensor in sensors if sensor.pooled):
        alike = [sensor for sensor in sensors if sensor.kind == kind]
        by_term = [{term.name: term.verdict for term in sensor.selection.terms} for sensor in alike]
        for name, inclusion in alike[0].pooled.items():
            verdicts = tuple(verdict_of.get(name, "") for verdict_of in by_term)
            row = (name, verdicts, inclusion, pooled_verdict(inclusion, verdicts, costs))
            kinds.setdefault(kind, []).append(row)
    return kinds


def pooled_verdict(inclusion: float, verdicts: Sequence[str], costs: Costs = EQUAL) -> str:
    """What the kind needs, of one term: never what each component that tells is against.

    >>> pooled_verdict(0.99, ("undecided", "undecided")), pooled_verdict(0.9, ("untested", "inseparable"))
    ('needed', 'cannot tell')
    >>> pooled_verdict(0.97, ("not needed", "not needed"))  # hints of what is there and small add up
    'undecided'
    """
    told = {verdict for verdict in verdicts if verdict and verdict not in UNSEEN}
    if not told:
        return CANNOT
    if inclusion >= costs.needed and told != {"not needed"}:
        return "needed"
    return "not needed" if inclusion <= costs.not_needed and "needed" not in told else "undecided"
