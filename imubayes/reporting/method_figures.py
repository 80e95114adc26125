"""Figures on the other methods: threshold paths, prior widths, the reduced model, what the library misses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.misfit import TIME
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    WARNING,
    Axes,
    Margins,
    Panel,
    draw,
    few_ticks,
    log_scale,
    sticks,
)
from imubayes.reporting.fit_figures import time_unit
from imubayes.reporting.method_words import FEW, branches, called, channel_of, dependence_words, difference
from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    measured,
    per_unit,
    pretty,
    probability,
)
from imubayes.reporting.rows import channel_unit
from imubayes.selection.verdicts import listed
from imubayes.units import counted, factor, offset

if TYPE_CHECKING:
    from imubayes.inference.misfit import Dependence
    from imubayes.selection.reduced import Reduced
    from imubayes.selection.sensitivity import Sensitivity
    from imubayes.selection.sindy import Sparse
    from imubayes.selection.verdicts import Costs
    from imubayes.sensors.terms import Kind


LINE = 13
"""px between labels that stand below each other."""

SHORTEST = 200
"""px: height of a panel with few labels."""

MARGIN = 62
"""px beside a panel that labels its lines at their ends."""

BEYOND = 4
"""Terms that the path of the reduced model shows beyond those that it keeps."""

ROW = 19
"""px of a row of that path."""


def threshold_path(found: Sparse, decided: Sequence[str], own: Mapping[str, str], key: str) -> Panel:
    """Draw coefficients against the threshold, both in detectable effects: what drops out when.

    Parameters
    ----------
    decided : terms of the decision's model, in print.
    own : names of the terms in print, by the names that `found` has.
    """
    names = [own.get(name, name) for name in found.names]
    chosen = [own.get(name, name) for name in found.model]
    told = [j for j, name in enumerate(names) if name in chosen or name in decided]
    threshold = float(found.strength[found.chosen])
    return draw(
        lambda axes: _paint_path(axes, found, names, (told, chosen)),
        title=f"{called(found.optimizer)}, at {threshold:.2g} detectable effects, keeps "
        f"{_kept(chosen, decided)}",
        alt=f"Coefficients of {called(found.optimizer)} against its threshold, in detectable effects; at "
        f"{threshold:.2g} it keeps {' '.join(chosen) or 'nothing'}",
        key=key,
        height=max(SHORTEST, LINE * (len(told) + 1) + 48),
        margins=Margins(right=MARGIN),
    )


def _kept(chosen: Sequence[str], decided: Sequence[str]) -> str:
    count = counted(len(chosen), "term")
    apart = difference(chosen, decided)
    if apart == "as decided":
        return f"the decision's {count}"
    more, less = len(set(chosen) - set(decided)), len(set(decided) - set(chosen))
    return (
        f"{count}: {apart.replace('- ', '− ')}"
        if more + less <= FEW
        else f"{count}: {more} more, {less} fewer"
    )


def _paint_path(
    axes: Axes, found: Sparse, names: Sequence[str], terms: tuple[Sequence[int], Sequence[str]]
) -> None:
    told, chosen = terms
    order = np.argsort(found.strength, kind="stable")
    x, size = found.strength[order], np.abs(found.path[order])
    size[size == 0.0] = np.nan
    colours = [PALE if j not in told else ACCENT if names[j] in chosen else INK for j in range(len(names))]
    for j in sorted(range(len(names)), key=lambda j: j in told):
        axes.plot(x, size[:, j], color=colours[j], linewidth=1.3 if j in told else 1.0)
    axes.axvline(found.strength[found.chosen], color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set(xlabel="threshold, detectable effects", ylabel="coefficient, detectable effects")
    axes.set_xlim(float(x[0]), float(x[-1]))
    log_scale(axes, "x", 6)
    log_scale(axes, "y", 6)
    label_ends(axes, [(names[j], colours[j], *_last(x, size[:, j])) for j in told])


def _last(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Where a line ends that may break off; NaN where it never was."""
    known = np.flatnonzero(np.isfinite(y))
    return (float(x[known[-1]]), float(y[known[-1]])) if len(known) else (float("nan"), float("nan"))


def label_ends(axes: Axes, lines: Sequence[tuple[str, str, float, float]]) -> None:
    """Write names at the right of the axes beside the ends of their lines, spread apart.

    Parameters
    ----------
    lines : (name, colour, x, y of the line's end); names of lines without an end are left out.
    """
    ending = [line for line in lines if np.isfinite(line[3])]
    if not ending:
        return
    to_axes = axes.transData + axes.transAxes.inverted()
    ends = np.asarray(to_axes.transform([(x, y) for _, _, x, y in ending]))
    places = spread(ends[:, 1], LINE / float(axes.get_window_extent().height))
    for (name, colour, _, _), (x, y), place in zip(ending, ends.tolist(), places.tolist(), strict=True):
        axes.plot(
            [x, max(x, 1.0), 1.03], [y, y, place], color=PALE, linewidth=0.8, transform=axes.transAxes,
            clip_on=False, zorder=0,
        )  # fmt: skip
        axes.text(1.045, place, name, color=colour, ha="left", va="center", transform=axes.transAxes)


def spread(wanted: FloatArray, gap: float) -> FloatArray:
    """Move places apart by at least `gap`, as little as that takes, inside 0 to 1 where they fit.

    Neighbours that are too close are put together into blocks around their mean place (isotonic regression).

    Examples
    --------
    >>> spread(np.array([0.5, 0.5, 0.9]), 0.2).round(3).tolist()
    [0.4, 0.6, 0.9]
    """
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []
    for place in (wanted[order] - steps).tolist():
        mean, count = place, 1
        while blocks and blocks[-1][0] > mean:
            before, many = blocks.pop()
            mean, count = (before * many + mean * count) / (many + count), many + count
        blocks.append((mean, count))
    level = np.repeat([mean for mean, _ in blocks], [count for _, count in blocks])
    inside = np.maximum(np.minimum(level, 1.0 - steps[-1]), 0.0)
    places = np.empty(len(wanted))
    places[order] = inside + steps
    return places


def prior_widths(
    found: Sensitivity, shown: Sequence[int], costs: Costs, own: Mapping[str, str], key: str
) -> Panel:
    """Draw inclusion over prior widths, of some of the candidates, and under the g-prior beside it.

    Parameters
    ----------
    shown : indices of the candidates.
    costs : of the decision, which give its thresholds.
    own : names of the terms in print, by the names that `found` has.
    """
    names = [own.get(found.names[j], found.names[j]) for j in shown]
    swing = [own.get(name, name) for name in found.swing]
    moved = listed(swing) if 0 < len(swing) <= FEW else counted(len(swing), "term")
    title = (
        f"The prior's width moves {moved} across a threshold"
        if swing
        else f"{listed(names)}: the prior's width settles nothing"
    )
    ends = [
        f"{name} {found.inclusion[:, j].min():.2f} to {found.inclusion[:, j].max():.2f}"
        for name, j in zip(names, shown, strict=True)
    ]
    return draw(
        lambda axes: _paint_widths(axes, found, shown, names, costs),
        title=title,
        alt=f"Inclusion over prior widths: {', '.join(ends)}",
        key=key,
        height=SHORTEST + 20,
        margins=Margins(right=MARGIN),
    )


def _paint_widths(
    axes: Axes, found: Sensitivity, shown: Sequence[int], names: Sequence[str], costs: Costs
) -> None:
    order = np.argsort(found.widths, kind="stable")
    width = found.widths[order]
    beyond = float(width[-1]) * (float(width[-1]) / float(width[0])) ** 0.12
    levels = (costs.not_needed, costs.keep, costs.needed)
    for level in levels:
        axes.axhline(level, color=PALE, linewidth=0.8, zorder=0)
    axes.axvline(1.0, color=PALE, linewidth=0.8, zorder=0)
    lines: list[tuple[str, str, float, float]] = []
    for number, (j, name) in enumerate(zip(shown, names, strict=True)):
        colour = SERIES[number % len(SERIES)]
        inclusion = found.inclusion[order, j]
        axes.plot(width, inclusion, color=colour)
        axes.plot(beyond, found.g_prior[j], "D", color=colour, markersize=6, clip_on=False)
        lines.append((name, colour, float(width[-1]), float(inclusion[-1])))
    axes.set(xscale="log", ylim=(0.0, 1.0), xlabel="prior width over the class's; ◆ hyper-g prior")
    axes.set_xlim(float(width[0]), beyond * 1.15)
    ticks = [float(w) for w in (width[0], 1.0 / 3.0, 1.0, 3.0, width[-1]) if width[0] <= w <= width[-1]]
    axes.set_xticks(list(dict.fromkeys(ticks)), [_width(w) for w in dict.fromkeys(ticks)])
    axes.minorticks_off()
    axes.set_yticks(levels, [f"{level:.2g}" for level in levels])
    axes.set_ylabel("inclusion")
    label_ends(axes, lines)


def _width(width: float) -> str:
    return f"1/{1.0 / width:.3g}" if width < 1.0 else f"{width:.3g}"


def reduced_path(found: Reduced, kind: Kind, key: str) -> Panel:
    """Draw what is lost with 0, 1, ... terms, the strongest first, and what may be lost."""
    unit = OUTPUT_UNIT[kind]
    scale = per_unit(unit, OUTPUT_SI[kind])
    path = found.path[: len(found.terms) + BEYOND + 1]
    lost = np.array([rms for _, rms in path]) / scale
    labels = _added([terms for terms, _ in path])
    count = "1 term predicts" if len(found.terms) == 1 else f"{len(found.terms)} terms predict"
    within = pretty(str(measured(found.budget / scale, 0.0, unit)))
    return draw(
        lambda axes: _paint_reduced(axes, lost, labels, (found.budget / scale, len(found.terms)), unit),
        title=f"{count} within {within} of the whole posterior",
        alt="Rms lost by number of terms: "
        + ", ".join(f"{label} {rms:.3g}" for label, rms in zip(labels, lost, strict=True)),
        key=key,
        height=ROW * len(path) + 44,
        margins=Margins(left=max(46, 7 * max(map(len, labels))), right=14),
    )


def _added(models: Sequence[tuple[str, ...]]) -> list[str]:
    """Name what each model has more than the one before it; its size, where it also drops terms."""
    labels = [", ".join(models[0]) or "none"]
    for before, after in pairwise(models):
        new = [name for name in after if name not in before]
        labels.append(f"+ {new[0]}" if len(new) == 1 else f"best {len(after)}")
    return labels


def _paint_reduced(
    axes: Axes, lost: FloatArray, labels: Sequence[str], mark: tuple[float, int], unit: str
) -> None:
    budget, kept = mark
    row = np.arange(len(lost))
    shown = np.where(lost > 0.0, lost, np.nan)
    axes.plot(shown, row, color=PALE, linewidth=1.2)
    axes.plot(shown[kept + 1 :], row[kept + 1 :], "o", color=GREY, markersize=5, fillstyle="none")
    axes.plot(shown[: kept + 1], row[: kept + 1], "o", color=ACCENT, markersize=6)
    if budget > 0.0:
        axes.axvline(budget, color=WARNING, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.text(
            budget, 0.0, "budget ", color=WARNING, ha="right", va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    axes.set(ylim=(len(lost) - 0.4, -0.6), xlabel=f"rms lost, {pretty(unit)}")
    log_scale(axes, "x", 6)
    axes.set_yticks(row.tolist(), labels)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def dependence(one: Dependence, kind: Kind, key: str) -> Panel:
    """Draw the mean residual against an input, by branch where the way up differs from the way down."""
    size = pretty(
        str(measured(one.size / per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind]), 0.0, OUTPUT_UNIT[kind]))
    )
    found = f"{size} rms, {one.share:.0%} of the residual, p {probability(one.p)}"
    where = dependence_words(one)
    return draw(
        lambda axes: _paint_dependence(axes, one, kind),
        title=f"{where}: {found}",
        alt=f"What the residuals hold beyond the library, with ± 2 sd, against {where}: {found}",
        key=key,
        height=SHORTEST,
        margins=Margins(left=54, right=MARGIN if np.any(one.branch) else 10),
    )


def _paint_dependence(axes: Axes, one: Dependence, kind: Kind) -> None:
    name, x = _input(one, kind)
    unit = per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    mean, sd = one.mean / unit, one.sd / unit
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    lines: list[tuple[str, str, float, float]] = []
    for sign, word, colour, shape in (
        (0.0, "", ACCENT, "o"),
        (1.0, branches(one)[0], SERIES[1], "^"),
        (-1.0, branches(one)[1], ACCENT, "v"),
    ):
        part = np.flatnonzero(np.sign(one.branch) == sign)
        part = part[np.argsort(x[part], kind="stable")]
        if len(part):
            sticks(axes, x[part], mean[part] - 2.0 * sd[part], mean[part] + 2.0 * sd[part], colour)
            axes.plot(x[part], mean[part], f"{shape}-", color=colour, markersize=4.5, linewidth=0.9)
            lines.append((word, colour, float(x[part[-1]]), float(mean[part[-1]])))
    axes.set(xlabel=name, ylabel=f"residual, {pretty(OUTPUT_UNIT[kind])}")
    few_ticks(axes, 5, 4)
    axes.set_ylim(*axes.get_ylim())
    label_ends(axes, [line for line in lines if line[0]])


def _input(one: Dependence, kind: Kind) -> tuple[str, FloatArray]:
    """Label of the axis and values of the input in the unit that people use."""
    channel = channel_of(one)
    if channel == TIME:
        unit, scale = time_unit(float(np.ptp(one.x)))
        return f"time, {unit}", one.x / scale
    unit, si = channel_unit(channel, kind)
    return f"{channel}, {pretty(unit)}", (one.x - offset(unit, si)) / factor(unit, like=si)
