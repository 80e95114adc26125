"""Figures on the chains: do the ensembles agree, and which coefficients are tied to each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    Axes,
    Panel,
    areas,
    draw,
    draw_triangle,
    few_ticks,
    log_scale,
    no_ticks,
)
from imubayes.reporting.rounding import NOISE_SI, NOISE_UNITS, per_unit, pretty

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.mcmc.chains import Chains


TRACED = 80
"""Draws of each ensemble that a trace shows: more are not seen in 300 px."""

COEFFICIENTS = 2
"""Coefficients with the fewest effective draws that are watched."""

BINS = 12
"""Bins of the ranks of each ensemble."""

CORNER = 5
"""Columns in the corner figure."""

TIED = 0.3
"""Correlation from which two columns are in the corner figure, beyond the first two."""

GRID = 28
"""Cells along each side of the square on which a pair's density is counted."""

HELD = (0.9, 0.5)
"""Probabilities inside the contours."""

LINE = 17
"""Letters along the side of a cell of the corner figure."""

UNEVEN = 3.5
"""Sd by which one of some fifty bins of ranks is off by chance once in fifty figures."""

DECADE = 10.0
"""Ratio of largest to smallest from which a positive quantity gets a log axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """A sampled quantity.

    Attributes
    ----------
    name : as it is said: ``b2``, ``N of tumble``, ``error of local gravity``.
    short : as it stands at an axis.
    unit : printed, with the real signs.
    draws : (chains, draws) in that unit.
    """

    name: str
    short: str
    unit: str
    draws: FloatArray

    @property
    def label(self) -> str:
        """Short name and unit, in lines that fit a small axis."""
        return fill(f"{self.short.replace('.', ' ')}, {self.unit}", LINE)

    @property
    def apart(self) -> float:
        """Largest distance of an ensemble's mean from that of all, in posterior sd."""
        return float(np.max(np.abs(self.draws.mean(axis=1) - self.draws.mean())) / self.draws.std())


def column(sensor: SensorResult, chains: Chains, j: int) -> Watched:
    """Column `j` of the chains in printed units."""
    extras = {entry.extra.name: entry.extra for entry in sensor.extras}
    own = dict(zip(sensor.selection.columns, sensor.selection.terms, strict=True))
    name, unit = chains.names[j], chains.units[j]
    said, short, shown = name, name, unit
    if name in own:
        said, short, shown = own[name].name, own[name].name, own[name].printed
    elif name in extras:
        said, shown = extras[name].text, extras[name].printed
    draws = chains.theta[:, :, j] / per_unit(shown, unit)
    return Watched(said, short, pretty(shown), draws)


def watched(sensor: SensorResult, chains: Chains, most_noises: int) -> tuple[Watched, ...]:
    """Pick the noise parameters whose ensembles are farthest apart, and the coefficients that mix worst."""
    noises = sorted(_noises(sensor, chains), key=lambda one: -one.apart)[:most_noises]
    return (*noises, *(column(sensor, chains, j) for j in _slowest(chains)))


def _noises(sensor: SensorResult, chains: Chains) -> Iterator[Watched]:
    """Noise parameters that were sampled, once where runs share them."""
    sampled = set(chains.diagnostics.parameters)
    scales = [per_unit(u, si) for u, si in zip(NOISE_UNITS[sensor.kind], NOISE_SI[sensor.kind], strict=True)]
    for g, run in enumerate(chains.runs):
        for k, letter in enumerate("NBK"):
            draws = chains.noise[:, :, g, k]
            if f"{letter}.{run}" in sampled and np.ptp(draws) > 0.0:
                name, unit = f"{letter} of {run}", pretty(NOISE_UNITS[sensor.kind][k])
                yield Watched(name, name, unit, draws / scales[k])


def _slowest(chains: Chains) -> list[int]:
    place = {name: j for j, name in enumerate(chains.names)}
    ranked = np.argsort(chains.diagnostics.ess, kind="stable")
    found = [place[name] for name in (chains.diagnostics.parameters[k] for k in ranked) if name in place]
    return [j for j in found if np.ptp(chains.theta[:, :, j]) > 0.0][:COEFFICIENTS]


def trace(one: Watched, key: str) -> Panel:
    """Draws by ensemble, in the order of the steps."""
    return draw(
        lambda axes: _paint_trace(axes, one),
        title=f"{one.name}: means of the ensembles within {one.apart:.2f} sd",
        alt=f"Trace of {one.name}; the ensembles' means are within {one.apart:.2f} sd of the common one",
        key=key,
        height=130,
    )


def _paint_trace(axes: Axes, one: Watched) -> None:
    length = one.draws.shape[1]
    kept = np.unique(np.linspace(0, length - 1, min(length, TRACED)).round().astype(np.int64))
    for number, draws in enumerate(one.draws):
        axes.plot(kept, draws[kept], color=SERIES[number % len(SERIES)], linewidth=0.8, alpha=0.8)
    axes.set(xlabel="draw", ylabel=one.unit, xlim=(0, length - 1))
    few_ticks(axes, 4, 3)
    if one.draws.min() > 0.0 and one.draws.max() > DECADE * one.draws.min():
        log_scale(axes, "y", 4)


def ranks(one: Watched, key: str) -> Panel:
    """Histogram of each ensemble's ranks among all draws (Vehtari et al., Bayesian Analysis 2021)."""
    share, by_chance = rank_shares(one.draws), rank_sd(one.draws.shape[1])
    k, b = (int(place) for place in np.unravel_index(int(np.argmax(np.abs(share - 1.0))), share.shape))
    found = (
        "ranks are even, within chance"
        if abs(share[k, b] - 1.0) <= UNEVEN * by_chance
        else f"ensemble {k + 1} has {share[k, b]:.1f} times its share of one rank bin"
    )
    return draw(
        lambda axes: _paint_ranks(axes, share, by_chance),
        title=f"{one.name}: {found}",
        alt=f"Rank histograms of {one.name} by ensemble: {found}",
        key=key,
        height=130,
    )


def rank_sd(draws: int) -> float:
    """Sd by chance of the shares of `rank_shares`, of ensembles that agree and independent draws of each."""
    return float(np.sqrt((BINS - 1.0) / draws))


def rank_shares(draws: FloatArray) -> FloatArray:
    """Count the ranks of each ensemble among all draws in `BINS` bins, relative to an even share.

    Parameters
    ----------
    draws : (chains, draws).

    Returns
    -------
    (chains, BINS), 1 where the ensemble holds its even share of these ranks.

    Examples
    --------
    >>> rank_shares(np.arange(24.0).reshape(12, 2).T).min().tolist()
    1.0
    """
    order = np.empty(draws.size)
    order[np.argsort(draws, axis=None, kind="stable")] = np.arange(draws.size)
    bins = (order * BINS / draws.size).astype(np.int64).reshape(draws.shape)
    counts = np.array([np.bincount(part, minlength=BINS) for part in bins], dtype=float)
    return counts / (draws.shape[1] / BINS)


def _paint_ranks(axes: Axes, share: FloatArray, by_chance: float) -> None:
    axes.axhspan(max(0.0, 1.0 - 2.0 * by_chance), 1.0 + 2.0 * by_chance, color=PALE, alpha=0.6, linewidth=0.0)
    step = 1.0 / (BINS + 2)
    for number, heights in enumerate(share):
        edges = number + step * np.arange(BINS + 1)
        boxes = [(a, b, 0.0, top) for a, b, top in zip(edges[:-1], edges[1:], heights.tolist(), strict=True)]
        areas(axes, boxes, SERIES[number % len(SERIES)])
    axes.axhline(1.0, color=INK, linewidth=0.8)
    middle = 0.5 * step * BINS
    axes.set_xticks(
        [number + middle for number in range(len(share))], [f"{k + 1}" for k in range(len(share))]
    )
    axes.tick_params(axis="x", length=0)
    axes.set(xlabel="ranks by ensemble", ylabel="of even share", ylim=(0.0, max(2.0, 1.05 * share.max())))
    axes.set_yticks([0.0, 1.0, 2.0])


def corner(sensor: SensorResult, chains: Chains, key: str, most: int = CORNER) -> Panel | None:
    """Draw the columns that are most strongly tied, each against each; None where nothing varies."""
    pairs = tied_pairs(sensor, chains)
    if not pairs:
        return None
    chosen = _chosen(pairs, most)
    shown = [column(sensor, chains, j) for j in chosen]
    (a, b, r), *_ = pairs
    first, second = (column(sensor, chains, j).name for j in (a, b))
    return draw_triangle(
        lambda axes, row, across: _paint_cell(axes, shown, row, across),
        len(shown),
        title=f"{first} and {second} are tied most closely: correlation {r:.2f}".replace("-", "−"),
        alt="Posterior under the full library, each against each: "
        + ", ".join(f"{column(sensor, chains, i).name} and {column(sensor, chains, j).name} {value:.2f}"
                    for i, j, value in pairs if i in chosen and j in chosen),
        key=key,
    )  # fmt: skip


def tied_pairs(sensor: SensorResult, chains: Chains) -> list[tuple[int, int, float]]:
    """Pairs of columns that the test excites with their correlation, strongest first."""
    one = sensor.selection
    own = zip(one.columns, one.carriers, one.terms, strict=True)
    untested = {name for name, carrier, term in own if term.verdict == "untested" or carrier != name}
    theta = chains.theta.reshape(-1, len(chains.names))
    varying = [j for j, name in enumerate(chains.names) if name not in untested and np.ptp(theta[:, j]) > 0.0]
    if len(varying) < 2:
        return []
    r = np.asarray(np.corrcoef(theta[:, varying], rowvar=False))
    first, second = np.triu_indices(len(varying), 1)
    order = np.argsort(-np.abs(r[first, second]), kind="stable")
    return [(varying[first[k]], varying[second[k]], float(r[first[k], second[k]])) for k in order]


def _chosen(pairs: list[tuple[int, int, float]], most: int) -> list[int]:
    """Columns of the strongest pairs, at most so many, in the order of the model equation."""
    chosen: list[int] = []
    for number, (a, b, r) in enumerate(pairs):
        new = [j for j in (a, b) if j not in chosen]
        if number and abs(r) < TIED:
            break
        if len(chosen) + len(new) <= most:
            chosen += new
    return sorted(chosen)


def _paint_cell(axes: Axes, shown: list[Watched], row: int, across: int) -> None:
    x, y = shown[across].draws.ravel(), shown[row].draws.ravel()
    if row == across:
        height, edges = np.histogram(x, bins=GRID, range=_range(x))
        axes.stairs(height, edges, fill=True, color=ACCENT, alpha=0.5)
        axes.set_xlim(_range(x))
        no_ticks(axes)
        axes.spines["left"].set_visible(False)
    else:
        _paint_density(axes, x, y)
    _label_cell(axes, shown, row, across)


def _label_cell(axes: Axes, shown: list[Watched], row: int, across: int) -> None:
    """Numbers and names along the left and the lower edge of the triangle only."""
    few_ticks(axes, 3, 3, inside=True)
    if row == across:
        no_ticks(axes)
    last = row == len(shown) - 1
    axes.tick_params(labelbottom=last, labelleft=across == 0 and row > 0)
    if last:
        axes.set_xlabel(shown[across].label)
    if across == 0 and row > 0:
        axes.set_ylabel(shown[row].label)


def _range(x: FloatArray) -> tuple[float, float]:
    """Limits of what is shown: all but the outermost in a thousand, and a margin."""
    low, high = np.quantile(x, (0.001, 0.999)).tolist()
    margin = 0.08 * (high - low)
    return low - margin, high + margin


def _paint_density(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Contours that hold half and nine tenths of the draws."""
    limits = (_range(x), _range(y))
    counts, *edges = np.histogram2d(x, y, bins=GRID, range=limits)
    density = _smooth(_smooth(counts).T).T
    levels = held_levels(density)
    centres = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    top = float(density.max())
    axes.contourf(*centres, density.T, levels=[*levels, top], colors=[PALE, ACCENT], alpha=0.7)
    axes.contour(*centres, density.T, levels=levels[:1], colors=[GREY], linewidths=0.8)
    axes.set(xlim=limits[0], ylim=limits[1])


def held_levels(density: FloatArray) -> list[float]:
    """Heights of a density above which its cells hold the probabilities `HELD`.

    Examples
    --------
    >>> held_levels(np.array([[8.0, 5.0], [4.0, 3.0]]))
    [3.0, 5.0]
    """
    ordered = np.sort(density, axis=None)[::-1]
    share = np.cumsum(ordered) / ordered.sum()
    return [float(ordered[int(np.searchsorted(share, held))]) for held in HELD]


def _smooth(counts: FloatArray) -> FloatArray:
    """Average along the columns with the weights of a normal density of 1.2 cells."""
    reach = np.arange(-4, 5)
    weight = np.exp(-0.5 * (reach / 1.2) ** 2)
    weight /= weight.sum()
    return np.array([np.convolve(line, weight, mode="same") for line in counts])
