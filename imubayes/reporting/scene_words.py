"""What a scene requires of a component: in words, as its section of the report, and as it is published."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
from markupsafe import Markup

from imubayes.algebra import FloatArray
from imubayes.campaign import Mission
from imubayes.reporting import canvas, rounding
from imubayes.reporting.blocks import Figure, Prose, Section, Table, quiet
from imubayes.reporting.result import published
from imubayes.reporting.result.entries import Scene
from imubayes.scenes import History, history
from imubayes.scenes.relevance import QUADRANTS, CaseRelevance, Relevance, TermRelevance
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind
from imubayes.units import STANDARD_GRAVITY, counted

MOST_NAMES = 6
"""Terms that a sentence names."""

MOST_CULPRITS = 3
"""Terms that are named for what the calibration does not know of them."""

_named = partial(listed, most=MOST_NAMES)

UNITS = {"attitude": "deg", "velocity": "m/s", "position": "m"}
"""Unit in which each budget is printed, but the output's, which the kind decides."""

SIGNS: dict[str, str] = dict(zip(QUADRANTS, "●○▲×", strict=True))
"""Shape of each quadrant of inclusion and relevance."""

ASSUMED = (
    "errors are fixed in the case and turn with it; of velocity and position the horizontal error counts, of"
    " attitude and in free flight that of all three axes, at its largest over the mission; the terms kept are"
    " compensated with their posterior means, and take up what they can of the others over the scene"
)

HISTORY_NOTE = (
    "Over time is drawn what the case meets in one record of the scene, from lowest to highest: size of the"
    " specific force without vibration, and of the rate; angle of the case's z axis to the vertical. The line"
    " is the heading of its x axis, from north towards west."
)

HEAD = (
    "term", "symbol", "inclusion", "rms effect", "error", "of the budget", "90 % interval", "could take",
    "model", "inclusion and relevance",
)  # fmt: skip


def printed_unit(relevance: Relevance | CaseRelevance) -> tuple[str, float]:
    """Unit of a relevance's budget as people use it, and its size in SI."""
    return budget_unit(relevance.budget.quantity, relevance.kind)


def budget_unit(quantity: str, kind: Kind | None) -> tuple[str, float]:
    """Unit of a budget as people use it, and its size in SI; the kind decides on that of the output."""
    if quantity == "output" and kind is not None:
        return rounding.output_unit(kind)
    unit = UNITS[quantity]
    return unit, math.radians(1.0) if unit == "deg" else 1.0


def amount(relevance: Relevance | CaseRelevance, value: float) -> str:
    """Size of an error in the unit of the budget, two digits; of no rotation beyond half a turn."""
    if relevance.budget.quantity == "attitude" and value > math.pi:
        return "over 180°"
    return str(rounding.measured(value, 0.0, *printed_unit(relevance)))


def limit(relevance: Relevance | CaseRelevance, value: float) -> str:
    """Upper limit of an error in the unit of the budget, rounded up."""
    return str(rounding.below(value, *printed_unit(relevance)))


def scene_sentences(relevance: Relevance, sensor: str) -> tuple[str, ...]:
    """Say what a scene requires: the model, what is left, what could still matter."""
    ranked = sorted(relevance.terms, key=lambda term: -term.share_unknown)
    half = 0.5 * ranked[0].share_unknown
    worst = [term.name for term in ranked if term.share_unknown >= half]
    count, of = len(relevance.model), counted(len(relevance.terms), "term")
    enough, costs = "no term needs to be modelled", None
    if count:
        enough = f"{count} of {of}, {_named(relevance.model)}, {_are(count)} enough"
        rest = len(relevance.terms) - count
        costs = (
            f"leaving out the other {rest} costs {amount(relevance, relevance.left_out[0])}, " if rest else ""
        )
    first = _opening(relevance, sensor, enough, f", most of it in {listed(worst[:MOST_CULPRITS])}")
    return (first, *_tested(relevance), _left(relevance, costs), *_others(relevance), *_noise(relevance))


def case_sentences(relevance: CaseRelevance, name: str) -> tuple[str, ...]:
    """Say what a scene requires of all components of a case together."""
    kept = [
        f"{column.rpartition('.')[2]}: {_named(terms)}" for column, terms in relevance.models.items() if terms
    ]
    count = sum(map(len, relevance.models.values()))
    enough = "no term needs to be modelled"
    if kept:
        enough = (
            f"{count} of {counted(relevance.candidates, 'term')} {_are(count)} enough ({'; '.join(kept)})"
        )
    first = _opening(relevance, f"{name}, its {len(relevance.models)} components together,", enough, "")
    return (first, _left(relevance, ""), *_noise(relevance))


def _are(count: int) -> str:
    return "is" if count == 1 else "are"


def _opening(relevance: Relevance | CaseRelevance, sensor: str, enough: str, most: str) -> str:
    what = "rms error of the output" if relevance.budget.quantity == "output" else relevance.budget.quantity
    where = (
        f"{sensor} in {relevance.scene} ({rounding.duration(relevance.duration)}, budget"
        f" {amount(relevance, relevance.budget.limit)} of {what})"
    )
    if relevance.within_budget:
        return f"{where}: {enough}."
    return (
        f"{where}: no model of this library stays within the budget with 95 %, for the calibration leaves up"
        f" to {limit(relevance, relevance.calibrated[1])} with every term kept{most}. What is left out would"
        f" stay within it: {enough}. Calibrate better, or with a test that sees more."
    )


def _tested(relevance: Relevance) -> Iterator[str]:
    """What is enough where the test's inputs decide what the terms that are kept take up of the others."""
    if relevance.tested_model is not None:
        names, enough = relevance.tested_model, "none is needed"
        if set(names) == set(relevance.model):
            enough = "the same are enough" if names else "none is needed either"
        elif names:
            enough = f"{counted(len(names), 'term')}, {_named(names)}, {_are(len(names))} enough"
        yield f"With a calibration over the inputs of this test, {enough}."


def _left(relevance: Relevance | CaseRelevance, costs: str | None) -> str:
    """What is left, and beside what leaving terms out costs, what leaving out all of them would."""
    left = f"What is left stays below {limit(relevance, relevance.left[1])} with 95 %"
    if costs is None:
        return f"{left}."
    bare = amount(relevance, relevance.uncompensated[0])
    return f"{left}; {costs}without any compensation it would be {bare}."


def _others(relevance: Relevance) -> Iterator[str]:
    """Terms that are there and do little, and those that could do more, but are not shown."""
    if idle := [term for term in relevance.terms if term.quadrant == QUADRANTS[1]]:
        most, takes = (
            rounding.share(max(term.share_q95 for term in idle)),
            "takes" if len(idle) == 1 else "each take",
        )
        text, are = most if most.startswith("below") else f"up to {most}", _are(len(idle))
        yield f"{_named(term.name for term in idle)} {are} there and {takes} {text} of the budget."
    if could := sorted(
        (t for t in relevance.terms if t.quadrant == QUADRANTS[2]), key=lambda t: -t.share_at_limit95
    ):
        worst, are = could[0], _are(len(could))
        each = "it could" if len(could) == 1 else f"the worst, {worst.name}, could"
        of = " the" if worst.share_at_limit95 >= rounding.TIMES else " of the"
        yield (
            f"{_named(t.name for t in could)} {are} not shown to be there, nor to be small enough:"
            f" {each} take {rounding.share(worst.share_at_limit95)}{of} budget."
        )


def _noise(relevance: Relevance | CaseRelevance) -> Iterator[str]:
    if total := math.hypot(*relevance.noise):
        more = ", more than the whole budget, whatever is modelled" if total > relevance.budget.limit else ""
        yield f"Noise comes to {amount(relevance, total)} (one sd){more}."


def scene_section(relevance: Relevance, sensor: str, symbols: Mapping[str, str], key: str) -> Section:
    """What a scene requires of a component."""
    ranked = sorted(
        relevance.terms, key=lambda term: (-max(term.share_of_budget, term.share_at_limit95), term.name)
    )
    rows = [_row(relevance, term, symbols.get(term.name, "-")) for term in ranked]
    table = Table(f"{sensor} in {relevance.scene}", HEAD, rows, "ttnnnnnntt", _note(relevance), brief=False)
    said = Prose(" ".join(scene_sentences(relevance, sensor)))
    panel = scene_path(relevance, *printed_unit(relevance), key)
    return Section(relevance.scene, [said, table, Figure([panel])], brief=True)


def _note(relevance: Relevance) -> str:
    n, b, k = (amount(relevance, value) for value in relevance.noise)
    assumed = ASSUMED if relevance.budget.quantity != "output" else "rms over the rows of the scene"
    notes = f" The scene: {'; '.join(relevance.notes)}." if relevance.notes else ""
    return (
        f"With every term kept at most {limit(relevance, relevance.calibrated[1])} is left (95 %). Noise (one"
        f" sd): N {n}, B {b}, K {k}. Assumed: {assumed}.{notes} “Could take”: at the size that the term, were"
        " it there, stays below with 95 %. What takes a tenth of the budget or more matters. ▲ and × with an"
        " inclusion above one half are terms that the test cannot tell: their inclusion is the prior's."
    )


def _row(relevance: Relevance, term: TermRelevance, symbol: str) -> tuple[str, ...]:
    low, half, high = map(rounding.share, (term.share_q05, term.share_of_budget, term.share_q95))
    return (
        term.name,
        "" if symbol == "-" else rounding.minus(symbol),
        f"{term.inclusion:.3f}",
        rounding.in_unit(rounding.on_output(term.rms, relevance.kind)),
        rounding.in_unit(rounding.measured(term.effect, 0.0, *printed_unit(relevance))),
        half,
        quiet(low if low == high else f"{low} to {high}"),
        quiet(rounding.share(term.share_at_limit95)),
        "✓ kept" if term.kept else "left out",
        Markup('<span aria-hidden="true">{}</span> {}').format(SIGNS[term.quadrant], term.quadrant),
    )


def history_figure(mission: Mission, key: str) -> Figure:
    """What the case meets in a scene."""
    return Figure(scene_histories(history(mission.scene), key))


def published_scene(relevance: Relevance, sensor: str) -> Scene:
    """Publish what a scene requires of a component."""
    return published(Scene, relevance, name=relevance.scene, sensor=sensor)


def scene_path(relevance: Relevance, unit: str, size: float, key: str) -> canvas.Drawing:
    """Bound of the error against the number of terms, each step without the term that costs least."""
    count = np.array([step[0] for step in relevance.path], dtype=float)
    error = np.array([step[2] for step in relevance.path]) / size
    kept, least = len(relevance.model), rounding.share(error.min() * size / relevance.budget.limit)
    title = (
        f"{kept} {'term stays' if kept == 1 else 'terms stay'} within the budget"
        if relevance.within_budget
        else f"No model stays within the budget: {least} is left at least"
    )
    limit = relevance.budget.limit / size

    def paint(axes: canvas.Axes) -> None:
        drawn = np.maximum(error, 1e-3 * limit)
        axes.plot(count, drawn, "o-", color=canvas.GREY, markersize=4, linewidth=1.0)
        axes.plot(kept, drawn[count == kept], "o", color=canvas.ACCENT, markersize=8)
        axes.axhline(limit, color=canvas.WARNING, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.set_ylim(0.6 * min(float(drawn.min()), limit), 1.6 * max(float(drawn.max()), limit))
        axes.set(xlabel="number of terms in the model", ylabel=f"error with 95 %, {rounding.pretty(unit)}")
        canvas.few_ticks(axes, 6, counts=True)
        canvas.log_scale(axes, "y", 5)

    return canvas.draw(
        paint,
        title=title,
        alt=f"Bound of the error with 95 %, {unit}, by number of terms: "
        + ", ".join(f"{n:.0f}: {value:.3g}" for n, value in zip(count, error, strict=True)),
        key=key,
        room=canvas.Room(height=220, left=66),
    )


def scene_histories(history: History, key: str) -> tuple[canvas.Drawing, ...]:
    """Force, rate and attitude of a scene over its record; bands reach from lowest to highest."""
    last = float(history.t[0] + history.t[-1])  # both ends lie half a cell beyond
    unit, size = canvas.time_unit(last)
    t, deg = history.t / size, math.radians(1.0)
    told = (
        ("force", "Specific force, g", history.force / STANDARD_GRAVITY),
        ("rate", "Rate, deg/s", history.rate / deg),
        ("tilt", "Tilt (band) and heading (line), deg", history.tilt / deg),
    )

    def paint(axes: canvas.Axes, name: str, band: FloatArray) -> None:
        axes.fill_between(t, band[:, 0], band[:, 1], color=canvas.ACCENT, linewidth=0.6, alpha=0.5)
        if name == "tilt":
            axes.plot(t, history.heading / deg, color=canvas.INK, linewidth=0.8)
        axes.set_xlabel(f"time, {unit}")
        canvas.few_ticks(axes, 5, 3)
        axes.ticklabel_format(style="plain")

    return tuple(
        canvas.draw(
            lambda axes, name=name, band=band: paint(axes, name, band),
            title=rounding.pretty(title),
            alt=f"{title}, over one record of the scene: from lowest to highest in each part of it",
            key=f"{key}{name}",
            room=canvas.Room(height=120, left=58),
        )
        for name, title, band in told
    )
