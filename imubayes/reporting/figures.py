"""Figures on the choice of terms and on the posterior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting import rows
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    VERDICT_COLOURS,
    Axes,
    Margins,
    Panel,
    areas,
    draw,
    few_ticks,
    no_ticks,
)
from imubayes.reporting.rounding import measured, per_unit, percent, pretty
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
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

WIDE = 8.0
"""Prior sd over posterior sd above which the panel shows the posterior's own range only."""

DEEP = 40.0
"""nats below the best size that the evidence panel shows."""

MOST_NAMED = 5
"""Terms that a title names."""

STRONGEST = 8
"""Pairs in the correlation panel."""


def inclusion(sensor: SensorResult, key: str) -> Panel:
    """Inclusion of every term with its range over prior widths, marked by verdict."""
    terms = sensor.selection.terms
    needed = sum(term.verdict == "needed" for term in terms)
    title = f"{needed} of {counted(len(terms), 'term')} needed; {_matters(terms)}"
    values = ", ".join(f"{term.name} {term.inclusion:.2f} {term.verdict}" for term in terms)
    return draw(
        lambda axes: _paint_inclusion(axes, terms),
        title=title,
        alt=f"Inclusion probability by term: {values}",
        key=key,
        height=ROW * len(terms) + 44,
        margins=Margins(left=54, right=12),
    )


def _matters(terms: Sequence[TermVerdict]) -> str:
    """Say for which tested term the prior's width matters most, if it does for any as far as is printed."""
    tested = [term for term in terms if term.verdict != "untested"] or terms
    widest = max(tested, key=lambda term: term.inclusion_range[1] - term.inclusion_range[0])
    low, high = (f"{end:.2f}" for end in widest.inclusion_range)
    if low == high:
        return "the prior's width matters for none"
    return f"the prior's width matters most for {widest.name} ({low} to {high})"


def _paint_inclusion(axes: Axes, terms: tuple[TermVerdict, ...]) -> None:
    down = np.arange(len(terms))
    areas(axes, [(0.0, term.inclusion, row - 0.28, row + 0.28) for row, term in enumerate(terms)], PALE)
    for level in (0.05, 0.5, 0.95):
        axes.axvline(level, color=PALE, linewidth=0.8, zorder=0)
    ends = np.array([term.inclusion_range for term in terms])
    breaks = np.full(len(terms), np.nan)
    axes.plot(np.column_stack([ends, breaks]).ravel(), np.repeat(down, 3), color=INK, linewidth=1.2)
    for row, term in enumerate(terms):
        marker, fill = SHAPES.get(term.verdict, ("s", "none"))
        colour = VERDICT_COLOURS.get(term.verdict, GREY)
        axes.plot(term.inclusion, row, marker, fillstyle=fill, color=colour, markersize=7, clip_on=False)
    axes.set(
        xlim=(0.0, 1.0), ylim=(len(terms) - 0.4, -0.6), xlabel="probability that the term is in the model"
    )
    axes.set_xticks([0.05, 0.5, 0.95], ["0.05", "0.5", "0.95"])
    _term_ticks(axes, tuple(term.name for term in terms))


def model_size(sensor: SensorResult, key: str) -> Panel:
    """Evidence against model size."""
    by_size = np.asarray(sensor.selection.models.by_size, dtype=float)
    top = float(np.max(by_size[np.isfinite(by_size)]))
    share = np.exp(by_size - top)
    share /= share.sum()
    best = int(np.argmax(share))
    return draw(
        lambda axes: _paint_sizes(axes, by_size - top, best),
        title=f"Most likely {counted(best, 'term')} ({share[best]:.0%})",
        alt="Log evidence by number of terms, relative to the best: "
        + ", ".join(f"{k}: {value - top:.1f}" for k, value in enumerate(by_size) if value - top > -DEEP),
        key=key,
        height=220,
    )


def _paint_sizes(axes: Axes, relative: FloatArray, best: int) -> None:
    size = np.arange(len(relative))
    shown = relative > -DEEP
    axes.plot(size[shown], relative[shown], "o-", color=GREY, markersize=4, linewidth=1.0)
    axes.plot(best, relative[best], "o", color=ACCENT, markersize=8)
    axes.set(xlabel="number of terms in the model", ylabel="ln evidence below best (nats)")
    axes.set_ylim(min(float(relative[shown].min()), -3.0) * 1.08, 1.5)
    axes.set_xlim(-0.5, len(relative) - 0.5)
    few_ticks(axes, 8, 5, counts=True)


def best_models(sensor: SensorResult, key: str) -> Panel:
    """Draw the ten most probable models as an image: terms down, models across, width by probability.

    A term that but improbable ones of them have, or lack, is none that they disagree on.
    """
    names, best = rows.candidates(sensor.selection), rows.best_models(sensor.selection)
    total = sum(p for _, p in best)
    share = {name: sum(p for model, p in best if name in model) / total for name in names}
    varies = [name for name in names if NOT_NEEDED < share[name] < NEEDED]
    title = (
        f"The best model holds {percent(best[0][1])} of the probability"
        if best[0][1] >= NEEDED
        else f"The best {len(best)} models hold {percent(total)} and " + _disagreement(varies)
    )
    models = "; ".join(f"{p:.3f}: {' '.join(model)}" for model, p in best)
    return draw(
        lambda axes: _paint_models(axes, names, best, set(varies)),
        title=title,
        alt=f"Best models with their probabilities: {models}",
        key=key,
        height=ROW * len(names) + 44,
        margins=Margins(left=54, right=12),
    )


def _disagreement(names: Sequence[str]) -> str:
    if not names:
        return "disagree on no term by more than 5 %"
    return f"disagree on {listed(names) if len(names) <= MOST_NAMED else counted(len(names), 'term')}"


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
    axes.set(xlim=(0.0, edges[-1]), ylim=(len(names) - 0.4, -0.6), xlabel="probability, models side by side")
    few_ticks(axes, 5)
    _term_ticks(axes, names)


def posteriors(sensor: SensorResult, key: str) -> list[Panel]:
    """Prior against posterior of each term that is kept."""
    kept = [j for j, term in enumerate(sensor.selection.terms) if _is_kept(term, sensor.selection.model)]
    return [_posterior(sensor, j, f"{key}t{j}") for j in kept]


def _is_kept(term: TermVerdict, model: tuple[str, ...]) -> bool:
    return term.name in model and 0.0 < term.sd < math.inf and math.isfinite(term.mean)


def _posterior(sensor: SensorResult, j: int, key: str) -> Panel:
    term = sensor.selection.terms[j]
    unit = per_unit(term.printed, term.unit)
    size = measured(term.mean / unit, term.sd / unit, pretty(term.printed))
    narrowing = term.prior_sd / term.sd
    sure = f"{abs(term.mean) / term.sd:.0f} sd from zero" if term.verdict == "needed" else term.verdict
    title = f"{term.name} = {size}".replace("+-", "±").replace("-", "−") + f", {sure}"
    inside = sensor.draws[:, j][sensor.draws[:, j] != 0.0] / unit
    return draw(
        lambda axes: _paint_posterior(axes, term, inside, unit),
        title=title,
        alt=f"Posterior of {term.name}, {size}, {narrowing:.3g} times narrower than its prior",
        key=key,
        height=130,
        margins=Margins(left=10, right=10),
    )


def _paint_posterior(axes: Axes, term: TermVerdict, inside: FloatArray, unit: float) -> None:
    mean, sd, prior_sd = term.mean / unit, term.sd / unit, term.prior_sd / unit
    zoomed = prior_sd > WIDE * sd
    low, high = (mean - 5.0 * sd, mean + 5.0 * sd) if zoomed else _both_ranges(mean, sd, prior_sd)
    x = np.linspace(low, high, 81)
    if len(inside) >= 50:
        height, edges = np.histogram(inside, bins=np.linspace(low, high, 41), density=True)
        axes.stairs(height * term.inclusion, edges, fill=True, color=ACCENT, alpha=0.35)
    axes.plot(x, term.inclusion * _normal(x, mean, sd), color=ACCENT)
    axes.plot(x, _normal(x, 0.0, prior_sd), color=GREY, linestyle=(0, (4, 2)))
    note = f"prior sd {prior_sd / sd:.0f}× wider" if zoomed else f"prior sd {prior_sd / sd:.1f}× wider"
    axes.text(0.99, 0.96, note, transform=axes.transAxes, ha="right", va="top", color=GREY)
    axes.set(xlim=(low, high), xlabel=f"{term.name}, {pretty(term.printed)}")
    axes.set_ylim(bottom=0.0)
    few_ticks(axes, 3)
    no_ticks(axes)
    axes.spines["left"].set_visible(False)


def _both_ranges(mean: float, sd: float, prior_sd: float) -> tuple[float, float]:
    return min(mean - 4.0 * sd, -3.0 * prior_sd), max(mean + 4.0 * sd, 3.0 * prior_sd)


def _normal(x: FloatArray, mean: float, sd: float) -> FloatArray:
    return np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * math.sqrt(2.0 * math.pi))


def correlations(sensor: SensorResult, key: str) -> Panel | None:
    """Draw the strongest posterior correlations; None where no two terms vary."""
    pairs = strongest_pairs(sensor)
    if not pairs:
        return None
    a, b, r = pairs[0]
    return draw(
        lambda axes: _paint_pairs(axes, pairs),
        title=f"{a} and {b} are tied most closely: correlation {r:.2f}".replace("-", "−"),
        alt="Strongest posterior correlations: " + ", ".join(f"{a} and {b} {r:.2f}" for a, b, r in pairs),
        key=key,
        height=ROW * len(pairs) + 44,
        margins=Margins(left=104, right=12),
    )


def strongest_pairs(sensor: SensorResult) -> list[tuple[str, str, float]]:
    """Pairs of terms with the largest correlation of the posterior draws, strongest first."""
    tied = dict(sensor.selection.ties)
    varying = [
        j
        for j, term in enumerate(sensor.selection.terms)
        if term.verdict != "untested"
        and term.name not in tied
        and np.any(sensor.draws[:, j] != sensor.draws[0, j])
    ]
    if len(varying) < 2 or len(sensor.draws) < 3:
        return []
    r = np.atleast_2d(np.corrcoef(sensor.draws[:, varying], rowvar=False))
    first, second = np.triu_indices(len(varying), 1)
    order = np.argsort(-np.abs(r[first, second]), kind="stable")[:STRONGEST]
    names = [sensor.selection.terms[j].name for j in varying]
    return [(names[first[k]], names[second[k]], float(r[first[k], second[k]])) for k in order]


def _paint_pairs(axes: Axes, pairs: list[tuple[str, str, float]]) -> None:
    boxes = [(min(r, 0.0), max(r, 0.0), row - 0.3, row + 0.3) for row, (_, _, r) in enumerate(pairs)]
    areas(axes, boxes, ACCENT)
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set(xlim=(-1.0, 1.0), ylim=(len(pairs) - 0.4, -0.6), xlabel="posterior correlation")
    few_ticks(axes, 4)
    _term_ticks(axes, tuple(f"{a}, {b}" for a, b, _ in pairs))


def _term_ticks(axes: Axes, names: tuple[str, ...]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
