"""Figures on the choice of terms, the posterior, what compensation recovers, and a scene."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting import rows
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    VERDICT_COLOURS,
    WARNING,
    Axes,
    Panel,
    areas,
    draw,
    few_ticks,
    log_scale,
    rows_of,
    time_unit,
)
from imubayes.reporting.rounding import per_unit, percent, pretty, share
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, UNSEEN, listed
from imubayes.units import STANDARD_GRAVITY, counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.known_quantities import Recovered
    from imubayes.scenes.record import History
    from imubayes.scenes.relevance import Relevance
    from imubayes.selection.verdicts import TermVerdict


ROW = 19
"""px between the rows of a panel that has a row a term."""

SHAPES = {
    "needed": ("o", "full"),
    "not needed": ("o", "none"),
    "undecided": ("o", "left"),
    "inseparable": ("^", "full"),
    "unresolved": ("^", "none"),
    "untested": ("x", "full"),
}
"""Marker and fill of each verdict, the same shapes as in the tables."""

NARROWED = 0.1
"""Posterior over prior sd from which a term is counted as known by the test."""

DEEP = 40.0
"""nats below the best size that the evidence panel shows."""

MOST_NAMED = 5
"""Terms that a title names."""

KNOWN = {
    "gravity": ("|f| − g", "still", ("mg", "m/s^2")),
    "rate": ("|w| − table", "section", ("deg/s", "rad/s")),
    "rest": ("rate", "still", ("deg/s", "rad/s")),
    "closure": ("error of up", "turn", ("deg", "rad")),
    "turn": ("error of the turn", "turn", ("deg", "rad")),
}
"""Of each known quantity its name, what is counted, and its printed and SI unit."""


def inclusion(sensor: SensorResult, key: str) -> Panel:
    """Inclusion of every term with its range over prior widths, marked by verdict."""
    terms = sensor.selection.terms
    needed = sum(term.verdict == "needed" for term in terms)
    tested = [term for term in terms if term.verdict != "untested"] or terms
    widest = max(tested, key=lambda term: term.inclusion_range[1] - term.inclusion_range[0])
    low, high = (f"{end:.2f}" for end in widest.inclusion_range)
    most = "for none" if low == high else f"most for {widest.name} ({low} to {high})"
    title = f"{needed} of {counted(len(terms), 'term')} needed; the prior's width matters {most}"
    values = ", ".join(f"{term.name} {term.inclusion:.2f} {term.verdict}" for term in terms)
    return draw(
        lambda axes: _paint_inclusion(axes, terms),
        title=title,
        alt=f"Inclusion probability by term: {values}",
        key=key,
        height=ROW * len(terms) + 44,
        left=54,
        right=12,
    )


def _paint_inclusion(axes: Axes, terms: tuple[TermVerdict, ...]) -> None:
    seen = [(row, term) for row, term in enumerate(terms) if term.verdict not in UNSEEN]
    areas(axes, [(0.0, term.inclusion, row - 0.28, row + 0.28) for row, term in seen], PALE)
    for level in (0.05, 0.5, 0.95):
        axes.axvline(level, color=PALE, linewidth=0.8, zorder=0)
    _whiskers(axes, np.array([term.inclusion_range for term in terms]), INK)
    for row, term in enumerate(terms):
        marker, fill = SHAPES.get(term.verdict, ("s", "none"))
        colour = VERDICT_COLOURS.get(term.verdict, GREY)
        axes.plot(term.inclusion, row, marker, fillstyle=fill, color=colour, markersize=7, clip_on=False)
    axes.set(xlim=(0.0, 1.0), xlabel="probability that the term is in the model")
    axes.set_xticks([0.05, 0.5, 0.95], ["0.05", "0.5", "0.95"])
    rows_of(axes, tuple(term.name for term in terms))


def model_size(sensor: SensorResult, key: str) -> Panel:
    """Evidence against model size."""
    by_size = np.asarray(sensor.selection.models.by_size, dtype=float)
    top = float(np.max(by_size[np.isfinite(by_size)]))
    chance = np.exp(by_size - top)
    chance /= chance.sum()
    best = int(np.argmax(chance))

    def paint(axes: Axes) -> None:
        size, relative = np.arange(len(by_size)), by_size - top
        shown = relative > -DEEP
        axes.plot(size[shown], relative[shown], "o-", color=GREY, markersize=4, linewidth=1.0)
        axes.plot(best, relative[best], "o", color=ACCENT, markersize=8)
        axes.set(xlabel="number of terms in the model", ylabel="ln evidence below best (nats)")
        axes.set_ylim(min(float(relative[shown].min()), -3.0) * 1.08, 1.5)
        axes.set_xlim(-0.5, len(relative) - 0.5)
        few_ticks(axes, 8, 5, counts=True)

    return draw(
        paint,
        title=f"Most likely {counted(best, 'term')} ({chance[best]:.0%})",
        alt="Log evidence by number of terms, relative to the best: "
        + ", ".join(f"{k}: {value - top:.1f}" for k, value in enumerate(by_size) if value - top > -DEEP),
        key=key,
        height=220,
    )


def best_models(sensor: SensorResult, key: str) -> Panel:
    """Draw the ten most probable models as an image: terms down, models across, width by probability.

    A term that but improbable ones of them have, or lack, is none that they disagree on.
    """
    names, best = rows.candidates(sensor.selection), rows.best_models(sensor.selection)
    total = sum(p for _, p in best)
    held = {name: sum(p for model, p in best if name in model) / total for name in names}
    varies = [name for name in names if NOT_NEEDED < held[name] < NEEDED]
    few = "no term by more than 5 %"
    if varies:
        few = listed(varies) if len(varies) <= MOST_NAMED else counted(len(varies), "term")
    title = (
        f"The best model holds {percent(best[0][1])} of the probability"
        if best[0][1] >= NEEDED
        else f"The best {len(best)} models hold {percent(total)} and disagree on {few}"
    )
    models = "; ".join(f"{p:.3f}: {' '.join(model)}" for model, p in best)
    return draw(
        lambda axes: _paint_models(axes, names, best, set(varies)),
        title=title,
        alt=f"Best models with their probabilities: {models}",
        key=key,
        height=ROW * len(names) + 44,
        left=54,
        right=12,
    )


def _paint_models(
    axes: Axes, names: tuple[str, ...], best: tuple[tuple[tuple[str, ...], float], ...], varies: set[str]
) -> None:
    edges = np.concatenate([[0.0], np.cumsum([p for _, p in best])])
    present = [
        (name in varies, (edges[m], edges[m + 1], row - 0.42, row + 0.42))
        for row, name in enumerate(names)
        for m, (model, _) in enumerate(best)
        if name in model
    ]
    areas(axes, [box for some, box in present if not some], GREY)
    areas(axes, [box for some, box in present if some], ACCENT)
    for edge in edges[1:-1]:
        axes.axvline(edge, color="white", linewidth=1.0)
    axes.set(xlim=(0.0, edges[-1]), xlabel="probability, models side by side")
    few_ticks(axes, 5)
    rows_of(axes, names)


def posterior(sensor: SensorResult, key: str) -> Panel | None:
    """Posterior of each kept term beside its prior, in prior sds; None where no term is kept."""
    model = sensor.selection.model
    kept = [
        t
        for t in sensor.selection.terms
        if t.name in model and 0.0 < t.sd < math.inf and math.isfinite(t.mean) and 0.0 < t.prior_sd < math.inf
    ]
    if not kept:
        return None
    mean, sd = (np.array([getattr(t, key) / t.prior_sd for t in kept]) for key in ("mean", "sd"))
    places, narrow = zip(kept, mean, sd, strict=True), int((sd <= NARROWED).sum())
    are = "is" if narrow == 1 else "are"

    def paint(axes: Axes) -> None:
        axes.axvspan(-2.0, 2.0, color=PALE, alpha=0.45, linewidth=0.0)
        axes.axvline(0.0, color=GREY, linewidth=0.8, zorder=0)
        _whiskers(axes, np.column_stack([mean - 2.0 * sd, mean + 2.0 * sd]), ACCENT)
        axes.plot(mean, np.arange(len(kept)), "o", color=ACCENT, markersize=4.5)
        reach = max(2.2, 1.1 * float(np.max(np.abs(mean) + 2.0 * sd)))
        axes.set(xlim=(-reach, reach), xlabel="prior sd")
        few_ticks(axes, 6)
        rows_of(axes, tuple(t.name for t in kept))

    return draw(
        paint,
        title=f"{narrow} of {counted(len(kept), 'kept term')} {are} known ten times as well as before",
        alt="Posterior in prior sd: " + ", ".join(f"{t.name} {m:.3g} ± {s:.2g}" for t, m, s in places),
        key=key,
        height=ROW * len(kept) + 44,
        left=54,
        right=12,
    )


def _whiskers(axes: Axes, ends: FloatArray, color: str) -> None:
    """Draw a horizontal line a row between its ends (m, 2)."""
    line = np.column_stack([ends, np.full(len(ends), np.nan)])
    axes.plot(line.ravel(), np.repeat(np.arange(len(ends)), 3), color=color, linewidth=1.2)


def recovered(one: Recovered, key: str) -> Panel:
    """Draw the error of each still or turn with the band of ± 2 sd that is predicted."""
    held = f"{one.inside} of {one.after.size} within 2 sd"
    name, place, (unit, si) = KNOWN[one.what]
    after, expected = (values / per_unit(unit, si) for values in (one.after, one.expected))

    def paint(axes: Axes) -> None:
        count, width = after.shape
        number = np.arange(1, count + 1, dtype=float)
        band = 2.0 * expected.max(axis=1)
        axes.fill_between(number, -band, band, color=PALE, linewidth=0.0, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for c, marker in enumerate("os^"[:width]):
            axes.plot(number, after[:, c], marker, color=SERIES[c], markersize=3.5)
        axes.set(xlim=(0.4, count + 0.6), xlabel=place, ylabel=f"{name}, {pretty(unit)}")
        few_ticks(axes, 5, 4)
        axes.set_xticks(np.unique(np.linspace(1, count, min(count, 6)).round().astype(int)))

    return draw(
        paint,
        title=f"{name} after compensation: {held}",
        alt=f"{name} by {place}, {len(one.after)} of them, with the predicted ± 2 sd: {held}",
        key=key,
        height=170,
        left=54,
    )


def scene_path(found: Relevance, unit: str, size: float, key: str) -> Panel:
    """Bound of the error against the number of terms, each step without the term that costs least."""
    count = np.array([step[0] for step in found.path], dtype=float)
    error = np.array([step[2] for step in found.path]) / size
    kept, least = len(found.model), share(error.min() * size / found.budget.limit)
    title = (
        f"{kept} {'term stays' if kept == 1 else 'terms stay'} within the budget"
        if found.met
        else f"No model stays within the budget: {least} is left at least"
    )
    limit = found.budget.limit / size

    def paint(axes: Axes) -> None:
        drawn = np.maximum(error, 1e-3 * limit)
        axes.plot(count, drawn, "o-", color=GREY, markersize=4, linewidth=1.0)
        axes.plot(kept, drawn[count == kept], "o", color=ACCENT, markersize=8)
        axes.axhline(limit, color=WARNING, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.set_ylim(0.6 * min(float(drawn.min()), limit), 1.6 * max(float(drawn.max()), limit))
        axes.set(xlabel="number of terms in the model", ylabel=f"error with 95 %, {pretty(unit)}")
        few_ticks(axes, 6, counts=True)
        log_scale(axes, "y", 5)

    return draw(
        paint,
        title=title,
        alt=f"Bound of the error with 95 %, {unit}, by number of terms: "
        + ", ".join(f"{n:.0f}: {value:.3g}" for n, value in zip(count, error, strict=True)),
        key=key,
        height=220,
        left=66,
    )


def scene_histories(found: History, key: str) -> tuple[Panel, ...]:
    """Force, rate and attitude of a scene over its record; bands reach from lowest to highest."""
    last = float(found.t[0] + found.t[-1])  # both ends lie half a cell beyond
    unit, size = time_unit(last)
    t, deg = found.t / size, math.radians(1.0)
    told = (
        ("force", "Specific force, g", found.force / STANDARD_GRAVITY),
        ("rate", "Rate, deg/s", found.rate / deg),
        ("tilt", "Tilt (band) and heading (line), deg", found.tilt / deg),
    )

    def paint(axes: Axes, name: str, band: FloatArray) -> None:
        axes.fill_between(t, band[:, 0], band[:, 1], color=ACCENT, linewidth=0.6, alpha=0.5)
        if name == "tilt":
            axes.plot(t, found.heading / deg, color=INK, linewidth=0.8)
        axes.set_xlabel(f"time, {unit}")
        few_ticks(axes, 5, 3)
        axes.ticklabel_format(style="plain")

    return tuple(
        draw(
            lambda axes, name=name, band=band: paint(axes, name, band),
            title=pretty(title),
            alt=f"{title}, over one record of the scene: from lowest to highest in each part of it",
            key=f"{key}{name}",
            height=120,
            left=58,
        )
        for name, title, band in told
    )
