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


def printed_unit(found: Relevance | CaseRelevance) -> tuple[str, float]:
    """Unit of a relevance's budget as people use it, and its size in SI."""
    return budget_unit(found.budget.quantity, found.kind)


def budget_unit(quantity: str, kind: Kind | None) -> tuple[str, float]:
    """Unit of a budget as people use it, and its size in SI; the kind decides on that of the output."""
    if quantity == "output" and kind is not None:
        return rounding.output_unit(kind)
    unit = UNITS[quantity]
    return unit, math.radians(1.0) if unit == "deg" else 1.0


def amount(found: Relevance | CaseRelevance, value: float) -> str:
    """Size of an error in the unit of the budget, two digits; of no rotation beyond half a turn."""
    if found.budget.quantity == "attitude" and value > math.pi:
        return "over 180°"
    return str(rounding.measured(value, 0.0, *printed_unit(found)))


def limit(found: Relevance | CaseRelevance, value: float) -> str:
    """Upper limit of an error in the unit of the budget, rounded up."""
    return str(rounding.below(value, *printed_unit(found)))


def scene_sentences(found: Relevance, sensor: str) -> tuple[str, ...]:
    """Say what a scene requires: the model, what is left, what could still matter."""
    ranked = sorted(found.terms, key=lambda term: -term.share_unknown)
    half = 0.5 * ranked[0].share_unknown
    worst = [term.name for term in ranked if term.share_unknown >= half]
    count, of = len(found.model), counted(len(found.terms), "term")
    enough, costs = "no term needs to be modelled", None
    if count:
        enough = f"{count} of {of}, {_named(found.model)}, {_are(count)} enough"
        rest = len(found.terms) - count
        costs = f"leaving out the other {rest} costs {amount(found, found.left_out[0])}, " if rest else ""
    first = _opening(found, sensor, enough, f", most of it in {listed(worst[:MOST_CULPRITS])}")
    return (first, *_tested(found), _left(found, costs), *_others(found), *_noise(found))


def case_sentences(found: CaseRelevance, name: str) -> tuple[str, ...]:
    """Say what a scene requires of all components of a case together."""
    kept = [f"{one.rpartition('.')[2]}: {_named(terms)}" for one, terms in found.models.items() if terms]
    count = sum(map(len, found.models.values()))
    enough = "no term needs to be modelled"
    if kept:
        enough = f"{count} of {counted(found.candidates, 'term')} {_are(count)} enough ({'; '.join(kept)})"
    first = _opening(found, f"{name}, its {len(found.models)} components together,", enough, "")
    return (first, _left(found, ""), *_noise(found))


def _are(count: int) -> str:
    return "is" if count == 1 else "are"


def _opening(found: Relevance | CaseRelevance, sensor: str, enough: str, most: str) -> str:
    what = "rms error of the output" if found.budget.quantity == "output" else found.budget.quantity
    where = (
        f"{sensor} in {found.scene} ({rounding.duration(found.duration)}, budget"
        f" {amount(found, found.budget.limit)} of {what})"
    )
    if found.within_budget:
        return f"{where}: {enough}."
    return (
        f"{where}: no model of this library stays within the budget with 95 %, for the calibration leaves up"
        f" to {limit(found, found.calibrated[1])} with every term kept{most}. What is left out would stay"
        f" within it: {enough}. Calibrate better, or with a test that sees more."
    )


def _tested(found: Relevance) -> Iterator[str]:
    """What is enough where the test's inputs decide what the terms that are kept take up of the others."""
    if found.tested_model is not None:
        names, enough = found.tested_model, "none is needed"
        if set(names) == set(found.model):
            enough = "the same are enough" if names else "none is needed either"
        elif names:
            enough = f"{counted(len(names), 'term')}, {_named(names)}, {_are(len(names))} enough"
        yield f"With a calibration over the inputs of this test, {enough}."


def _left(found: Relevance | CaseRelevance, costs: str | None) -> str:
    """What is left, and beside what leaving terms out costs, what leaving out all of them would."""
    left = f"What is left stays below {limit(found, found.left[1])} with 95 %"
    if costs is None:
        return f"{left}."
    return f"{left}; {costs}without any compensation it would be {amount(found, found.uncompensated[0])}."


def _others(found: Relevance) -> Iterator[str]:
    """Terms that are there and do little, and those that could do more, but are not shown."""
    if idle := [term for term in found.terms if term.quadrant == QUADRANTS[1]]:
        most, takes = (
            rounding.share(max(term.share_q95 for term in idle)),
            "takes" if len(idle) == 1 else "each take",
        )
        text, are = most if most.startswith("below") else f"up to {most}", _are(len(idle))
        yield f"{_named(term.name for term in idle)} {are} there and {takes} {text} of the budget."
    if could := sorted(
        (t for t in found.terms if t.quadrant == QUADRANTS[2]), key=lambda t: -t.share_at_limit95
    ):
        worst, are = could[0], _are(len(could))
        each = "it could" if len(could) == 1 else f"the worst, {worst.name}, could"
        of = " the" if worst.share_at_limit95 >= rounding.TIMES else " of the"
        yield (
            f"{_named(t.name for t in could)} {are} not shown to be there, nor to be small enough:"
            f" {each} take {rounding.share(worst.share_at_limit95)}{of} budget."
        )


def _noise(found: Relevance | CaseRelevance) -> Iterator[str]:
    if total := math.hypot(*found.noise):
        more = ", more than the whole budget, whatever is modelled" if total > found.budget.limit else ""
        yield f"Noise comes to {amount(found, total)} (one sd){more}."


def scene_section(found: Relevance, sensor: str, symbols: Mapping[str, str], key: str) -> Section:
    """What a scene requires of a component."""
    ranked = sorted(
        found.terms, key=lambda term: (-max(term.share_of_budget, term.share_at_limit95), term.name)
    )
    rows = [_row(found, term, symbols.get(term.name, "-")) for term in ranked]
    table = Table(f"{sensor} in {found.scene}", HEAD, rows, "ttnnnnnntt", _note(found), brief=False)
    said = Prose(" ".join(scene_sentences(found, sensor)))
    panel = scene_path(found, *printed_unit(found), key)
    return Section(found.scene, [said, table, Figure([panel])], brief=True)


def _note(found: Relevance) -> str:
    n, b, k = (amount(found, value) for value in found.noise)
    assumed = ASSUMED if found.budget.quantity != "output" else "rms over the rows of the scene"
    notes = f" The scene: {'; '.join(found.notes)}." if found.notes else ""
    return (
        f"With every term kept at most {limit(found, found.calibrated[1])} is left (95 %). Noise (one sd): N"
        f" {n}, B {b}, K {k}. Assumed: {assumed}.{notes} “Could take”: at the size that the term, were it"
        " there, stays below with 95 %. What takes a tenth of the budget or more matters. ▲ and × with an"
        " inclusion above one half are terms that the test cannot tell: their inclusion is the prior's."
    )


def _row(found: Relevance, term: TermRelevance, symbol: str) -> tuple[str, ...]:
    low, half, high = map(rounding.share, (term.share_q05, term.share_of_budget, term.share_q95))
    return (
        term.name,
        "" if symbol == "-" else rounding.minus(symbol),
        f"{term.inclusion:.3f}",
        rounding.in_unit(rounding.on_output(term.rms, found.kind)),
        rounding.in_unit(rounding.measured(term.effect, 0.0, *printed_unit(found))),
        half,
        quiet(low if low == high else f"{low} to {high}"),
        quiet(rounding.share(term.share_at_limit95)),
        "✓ kept" if term.kept else "left out",
        Markup('<span aria-hidden="true">{}</span> {}').format(SIGNS[term.quadrant], term.quadrant),
    )


def history_figure(mission: Mission, key: str) -> Figure:
    """What the case meets in a scene."""
    return Figure(scene_histories(history(mission.scene), key))


def published_scene(found: Relevance, sensor: str) -> Scene:
    """Publish what a scene requires of a component."""
    return published(Scene, found, name=found.scene, sensor=sensor)


def scene_path(found: Relevance, unit: str, size: float, key: str) -> canvas.Drawing:
    """Bound of the error against the number of terms, each step without the term that costs least."""
    count = np.array([step[0] for step in found.path], dtype=float)
    error = np.array([step[2] for step in found.path]) / size
    kept, least = len(found.model), rounding.share(error.min() * size / found.budget.limit)
    title = (
        f"{kept} {'term stays' if kept == 1 else 'terms stay'} within the budget"
        if found.within_budget
        else f"No model stays within the budget: {least} is left at least"
    )
    limit = found.budget.limit / size

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


def scene_histories(found: History, key: str) -> tuple[canvas.Drawing, ...]:
    """Force, rate and attitude of a scene over its record; bands reach from lowest to highest."""
    last = float(found.t[0] + found.t[-1])  # both ends lie half a cell beyond
    unit, size = canvas.time_unit(last)
    t, deg = found.t / size, math.radians(1.0)
    told = (
        ("force", "Specific force, g", found.force / STANDARD_GRAVITY),
        ("rate", "Rate, deg/s", found.rate / deg),
        ("tilt", "Tilt (band) and heading (line), deg", found.tilt / deg),
    )

    def paint(axes: canvas.Axes, name: str, band: FloatArray) -> None:
        axes.fill_between(t, band[:, 0], band[:, 1], color=canvas.ACCENT, linewidth=0.6, alpha=0.5)
        if name == "tilt":
            axes.plot(t, found.heading / deg, color=canvas.INK, linewidth=0.8)
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
