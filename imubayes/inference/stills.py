"""Stills of a hand tumble: found where the output hardly moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.linear import BLOCKS, Linear
from imubayes.rig.inputs import Inputs, Part, Run, durations
from imubayes.rig.stream_survey import averaged_parts

Stills = tuple[tuple[int, int], ...]
"""(start, stop) sample indices of each still."""

WINDOW = 1.0
"""s: length of the window whose variance tells rest from motion."""

FEWEST_IN_WINDOW = 8
"""Samples that a window holds at least, at low rates."""

SHORTEST = 1.0
"""s: a still that is shorter, once its ends are trimmed, is left out."""

CONTRAST = 10.0
"""Variance in motion over that at rest (medians) from which a record has both: hands give 1e2 to 1e5."""

RESTLESS = 3.0
"""Variance of the rates over a window, beside the usual one at rest, from which a case turns slowly: noise
makes two windows in a million that restless, if they hold as few as 24 numbers."""

STILLEST = 1e-8
"""Share of the largest variance below which rest is rest: coarse counts that do not change have none."""

BINS = 256
"""Bins of the histogram that the threshold is taken from."""

FINE = 65_536
"""Bins of a histogram that a median is looked for in."""


def find_stills(run: Run) -> Stills:
    """(start, stop) sample indices of each still.

    The variance over a sliding window is a few times the sensor's own at rest and thousands of times in
    motion, so its logarithm has two humps; the threshold is where Otsu's criterion parts them, and the ends
    of each still are trimmed by half a window, so that the result hardly depends on it. A slow turn, or one
    about the direction of gravity, hardly changes the force: gyroscopes in the case see it.

    Each row of a table of means is one.

    Raises
    ------
    UnobservableError : if the record has no rest, or nothing but rest.
    """
    if run.stills:
        return run.stills
    if run.inputs.averaged is not None:
        return tuple((k, k + 1) for k in range(len(run.t)))
    interval = run.sampling
    width = max(FEWEST_IN_WINDOW, round(WINDOW / interval))
    if run.samples < 3 * width:
        raise UnobservableError(
            f"run '{run.name}' lasts {run.t[-1] - run.t[0]:.1f} s: too short to tell stills from motion"
        )
    edges, first, before = [], 0, False
    for quiet in _quiet(run, width):
        changes = np.flatnonzero(np.diff(quiet, prepend=before))
        edges += (first + changes).tolist()
        first, before = first + len(quiet), quiet[-1]
    edges += [first] if before else []
    # a quiet window that starts at s covers s ... s + width - 1; half a window is trimmed at both ends
    found = [(a + width // 2, b + width // 2) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    stills = tuple((a, b) for a, b in found if (b - a) * interval >= SHORTEST)
    if not stills:
        raise UnobservableError(
            f"run '{run.name}' has no stills of {SHORTEST:g} s: hold each position for longer"
        )
    return stills


def condensed(run: Run) -> Run:
    """Run of a case of which gravity is known, so that it can be held: rest as means, and turns as they are.

    The mean of a stretch at rest tells of the coefficients what its samples do, for nothing but the noise
    changes there. The first and last sample of a still, where a turn ends and begins, stay by themselves.
    """
    if run.stream is None or run.known:
        return run
    turned = [(s.start, s.stop) for s in run.sections if s.angle]
    resting = [(s.start, s.stop) for s in run.sections if not s.angle]
    if not run.sections:
        resting = list(find_stills(run))
        turned = [(a[1] - 1, b[0] + 1) for a, b in pairwise(resting)]
    # no more rows than a run is averaged to further on: those of different lengths are then never mixed
    blocks = max(BLOCKS - 4 * len(resting) - len(turned), BLOCKS // 4)
    longest = math.ceil(sum(b - a for a, b in resting) / blocks)
    cuts = [np.linspace(a + 1, b - 1, 1 + math.ceil((b - a) / longest)).astype(np.int64) for a, b in resting]
    single = [np.arange(a, b + 1) for a, b in turned]
    starts = np.unique(np.concatenate([[0], *resting, *cuts, *single]))
    starts = starts[starts < run.samples]
    counts = np.diff(starts, append=run.samples)
    means, _ = averaged_parts(replace(run.stream, counts=counts), _measured, 2 + run.output.shape[1])

    def placed(a: int, b: int) -> tuple[int, int]:
        return int(np.searchsorted(starts, a)), int(np.searchsorted(starts, b))

    interval = run.stream.interval
    note = (
        f"{run.samples:,} rows are read a part at a time: what is said at rest enters as means of up to"
        f" {longest * interval:.2g} s, turns row by row"
    )
    ends = [placed(section.start, section.stop) for section in run.sections]
    return replace(
        run,
        inputs=Inputs(means[:, 0], {}, interval, None, means[:, 1] * counts, interval),
        output=means[:, 2:],
        source=replace(run.source, notes=(*run.source.notes, note)),
        stream=None,
        sections=tuple(replace(s, start=a, stop=b) for s, (a, b) in zip(run.sections, ends, strict=True)),
        stills=() if run.sections else tuple(placed(a, b) for a, b in resting),
    )


def _measured(part: Part, inside: slice, table: FloatArray) -> None:
    """Write time, averaging time and outputs of some rows of a part."""
    table[:, 0], table[:, 1], table[:, 2:] = part.t[inside], part.duration[inside], part.output[inside]


def rows_of(stills: Stills) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples (n,) of all stills in their order, and which still each of them belongs to."""
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    return index, np.repeat(np.arange(len(stills)), [b - a for a, b in stills])


def still_rows(
    run: Run,
    stills: Stills,
    component: str,
    names: tuple[str, ...],
    said: FloatArray,
    X: FloatArray,
) -> Linear:
    """All samples of the stills of one component as rows of a linear model.

    Parameters
    ----------
    run, stills : where it is at rest.
    component : ``ax`` to ``gz``.
    names, X : the p columns, and what they are (k, p) in each still.
    said : (n,) output of the component in the run, SI.
    """
    index, still = rows_of(stills)
    lasting, interval = lasting_of(run, index)
    return Linear(
        name=f"{run.name} ({component} at rest)",
        procedure=run.procedure,
        names=names,
        t=run.t[index],
        duration=lasting,
        interval=interval,
        y=said[index],
        columns=lambda start, stop: X[still[start:stop]],
    )


def lasting_of(run: Run, index: NDArray[np.int64]) -> tuple[FloatArray, float]:
    """Averaging time (m,) of some rows at rest, and that of one of them, s."""
    if run.inputs.averaged is None:
        return durations(run.t[index], run.interval), run.interval
    lasting = run.inputs.averaged[index]
    return lasting, float(np.median(lasting))


def samples_in(run: Run, start: int, stop: int) -> int:
    """Samples behind the rows from start to stop."""
    averaged, sampling = run.inputs.averaged, run.inputs.sampling
    if averaged is None or not sampling:
        return stop - start
    return round(float(averaged[start:stop].sum()) / sampling)


def means_of(run: Run, values: FloatArray, stills: Stills) -> FloatArray:
    """Means (k, a) of values (n, a) of a run's rows over each still."""
    weights = run.inputs.averaged
    if weights is None:
        return np.array([values[a:b].mean(axis=0) for a, b in stills])
    return np.array([np.average(values[a:b], axis=0, weights=weights[a:b]) for a, b in stills])


def times_of(run: Run, stills: Stills) -> tuple[tuple[float, float], ...]:
    """(start, stop) of each still, s."""
    t, half = run.t, np.zeros(len(run.t)) if run.inputs.averaged is None else 0.5 * run.inputs.averaged
    return tuple((float(t[a] - half[a]), float(t[b - 1] + half[b - 1])) for a, b in stills)


def _quiet(run: Run, width: int) -> Iterator[NDArray[np.bool_]]:
    """Windows at rest, (n - width + 1,) in parts; four passes before the one that tells."""
    seen = partial(_windows, run, width)
    ends = np.array([[(v.min(), v.max()) for v in part if v.size] for part in seen()])
    smallest, largest = ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)
    least = np.maximum(STILLEST * largest, np.finfo(float).tiny)
    extents = np.log([np.maximum(smallest, least), largest.clip(least)]).T
    threshold = _threshold((_spread(part[0], extents[0]) for part in seen()), extents[0])

    def medians_among() -> Iterator[list[FloatArray]]:
        for force, rate in seen():
            quiet = _spread(force, extents[0]) < threshold
            yield [force[quiet], force[~quiet], *([rate[quiet]] if rate.size else [])]

    rest = motion = least[0]
    turning: list[float] = []
    if not math.isinf(threshold):
        rest, motion, *turning = _medians(medians_among, [extents[0], *extents])
    if max(motion, least[0]) < CONTRAST * max(rest, least[0]):
        raise UnobservableError(
            f"run '{run.name}' has no stills that differ from motion: hold the triad still in one direction"
            " after the other, and turn it between them"
        )
    # windows in which the rates do not vary by more than noise, which is that of the quiet windows
    usual = max(turning[0], STILLEST * float(largest[1])) if turning else math.inf
    for force, rate in seen():
        quiet = _spread(force, extents[0]) < threshold
        yield quiet & (rate < RESTLESS * usual) if rate.size else quiet


def _windows(run: Run, width: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Summed variances of the forces, and of the rates where there are some, over windows, in parts."""
    held = np.zeros((0, run.output.shape[1]))
    for part in run.parts("stills"):
        rows = np.concatenate((held, part.output))
        held = rows[1 - width :]
        if len(rows) >= width:
            rate = _rolling_variance(rows[:, 3:], width) if rows.shape[1] > 3 else np.zeros(0)
            yield _rolling_variance(rows[:, :3], width), rate


def _spread(variance: FloatArray, extent: FloatArray) -> FloatArray:
    """Logarithms of variances (n,) within an extent."""
    return np.log(np.maximum(variance, np.finfo(float).tiny)).clip(*extent)


def _medians(
    parts: Callable[[], Iterator[Sequence[FloatArray]]], extents: Sequence[FloatArray]
) -> list[float]:
    """Medians of q variances that come in parts, whose logarithms lie within q extents: two passes.

    Values are counted in fine bins, and those of the bins in the middle are put in order.
    """

    def bins(values: FloatArray, extent: FloatArray) -> NDArray[np.int64]:
        share = (_spread(values, extent) - extent[0]) / max(float(np.ptp(extent)), np.finfo(float).tiny)
        return np.minimum(share * FINE, FINE - 1).astype(np.int64)

    counts = np.zeros((len(extents), FINE), dtype=np.int64)
    for part in parts():
        for k, values in enumerate(part):
            counts[k] += np.bincount(bins(values, extents[k]), minlength=FINE)
    below = np.cumsum(counts, axis=1)
    ranks = [((total - 1) // 2, total // 2) for total in below[:, -1].tolist()]
    middle = [np.searchsorted(row, pair, side="right") for row, pair in zip(below, ranks, strict=False)]
    held: list[list[FloatArray]] = [[] for _ in ranks]
    for part in parts():
        for k, values in enumerate(part):
            where = bins(values, extents[k])
            held[k].append(values[(where >= middle[k][0]) & (where <= middle[k][1])])
    found = []
    for k, values in enumerate(held):
        before = below[k, middle[k][0]] - counts[k, middle[k][0]]
        found.append(float(np.sort(np.concatenate(values))[[r - before for r in ranks[k]]].mean()))
    return found


def _rolling_variance(values: FloatArray, width: int) -> FloatArray:
    """Summed variance of the columns over each window: (n - width + 1,)."""
    centred = values - values.mean(axis=0)
    first = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred)), axis=0)
    second = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred**2)), axis=0)
    mean = (first[width:] - first[:-width]) / width
    return np.maximum((second[width:] - second[:-width]) / width - mean**2, 0.0).sum(axis=1)


def _threshold(parts: Iterable[FloatArray], extent: FloatArray) -> float:
    """Otsu's threshold of values in parts: the cut with the largest variance between the two sides.

    It is inf where all are equal.
    """
    if np.ptp(extent) == 0.0:
        return math.inf
    edges = np.histogram_bin_edges(extent, BINS)
    counts = np.sum([np.histogram(values, edges)[0] for values in parts], axis=0)
    middles = 0.5 * (edges[1:] + edges[:-1])
    below, total = np.cumsum(counts)[:-1], counts.sum()
    first = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (first[-1] * below / total - first[:-1]) ** 2 / (below * (total - below))
    return float(edges[1 + int(np.nanargmax(between))])
