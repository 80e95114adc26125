"""Stills of a hand tumble: found where the output hardly moves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.linear import BLOCKS, Extra, Linear
from imubayes.rig.bench import EARTH
from imubayes.rig.checks import stretches_of
from imubayes.rig.inputs import Inputs, Part, Run, durations
from imubayes.rig.runs import averaged_parts

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

CALMER = 0.75
"""Share of the stretches at rest whose rates vary by no more than is usual."""

TREMOR = 1.0
"""m/s^2: a tenth of g, beyond which a threshold is none between hands that hold still and that turn."""

LISTED = 60
"""Stills that a note lists."""

STILLS = "stills:"
"""How the note begins that lists them."""

STILLEST = 1e-8
"""Share of the largest variance below which rest is rest: coarse counts that do not change have none."""

BINS = 256
"""Bins of the histogram that the threshold, and the medians on either side of it, are taken from."""


def find_stills(run: Run) -> Stills:
    """(start, stop) sample indices of each still; each row of a table of means is one, and each section.

    Of a record of which gravity is known, or the rates of gyroscopes alone, they are searched for. It is an
    `UnobservableError` if it has no rest, or nothing but rest.
    """
    if run.stills or run.sections:
        return run.stills or tuple(sorted((s.start, s.stop) for s in run.sections))
    if run.inputs.averaged is not None:
        return tuple((k, k + 1) for k in range(len(run.t)))
    return searched(run, WINDOW, 0.0)[0]


def resting(run: Run) -> Run:
    """Run with its stills."""
    return replace(run, stills=find_stills(run))


def with_stills(run: Run, window: float, threshold: float) -> Run:
    """Run in the hand with its stills, and notes on them and on what was no still."""
    if run.known or run.sections or run.stills or run.inputs.averaged is not None:
        return run
    stills, left, highest = searched(run, window, threshold)
    begin, step = float(run.t[0]), run.sampling

    def listed(spans: Sequence[tuple[int, int]]) -> str:
        times = [f"{begin + a * step:.1f} to {begin + b * step:.1f} s" for a, b in spans]
        return ", ".join(times[:LISTED]) + (f" and {len(times) - LISTED} more" if len(times) > LISTED else "")

    notes = [
        f"{STILLS} {len(stills)} where the force varies by less than {highest:.2g} m/s^2 within {window:g} s:"
        f" {listed(stills)}"
    ]
    notes += [f"no stills, because {why}: {listed(spans)}" for why, spans in left.items() if spans]
    source = replace(run.source, notes=(*run.source.notes, *notes))
    return replace(run, stills=stills, source=source)


def searched(run: Run, window: float, threshold: float) -> tuple[Stills, Mapping[str, Stills], float]:
    """Stills of a run, what was left out and why, and the threshold, m/s^2.

    Rest is told from motion over a `window`, s: below a `threshold` of the root of the summed variance of the
    forces, which 0 takes from the record.

    The variance over a sliding window is a few times the sensor's own at rest and thousands of times in
    motion, so its logarithm has two humps; the threshold is where Otsu's criterion parts them, and the ends
    of each still are trimmed by half a window, so that the result hardly depends on it. A long rest on a
    table is a third hump, and the first cut may be between it and the hand: a second one, of what is above,
    is taken where it finds more stills and is no more than a hand's tremor. A slow turn, or one about the
    direction of gravity, hardly changes the force: gyroscopes see it.
    """
    interval = run.sampling
    width = max(FEWEST_IN_WINDOW, round(window / interval))
    if run.samples < 3 * width:
        raise UnobservableError(
            f"run '{run.name}' lasts {run.t[-1] - run.t[0]:.1f} s: too short to tell stills from motion"
        )
    least = math.ceil(SHORTEST / interval)
    level, largest = _level(run, width, least, threshold)
    held = _stretches(force < level for force, _ in _windows(run, width))
    long = [one for one in held if one[1] - one[0] >= least]
    kept = long
    if run.output.shape[1] > 3:
        usual = max(_restlessness(run, width, long), STILLEST * largest)
        kept = _stretches((f < level) & (rate < RESTLESS * usual) for f, rate in _windows(run, width))

    # a quiet window that starts at s covers s ... s + width - 1; half a window is trimmed at both ends
    def trimmed(spans: Iterable[tuple[int, int]]) -> Stills:
        return tuple((a + width // 2, b + width // 2) for a, b in spans)

    stills = [one for one in kept if one[1] - one[0] >= least]
    if not stills:
        raise UnobservableError(
            f"run '{run.name}' has no stills of {SHORTEST:g} s: hold each position for longer"
        )
    turned = [one for one in long if not any(a < one[1] and one[0] < b for a, b in stills)]
    left = {
        f"shorter than {SHORTEST:g} s": trimmed(one for one in held if 0 < one[1] - one[0] < least),
        "the rates vary more than at rest": trimmed(turned),
    }
    return trimmed(stills), left, math.sqrt(level)


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
    starts, longest = _condensing(resting, turned, run.samples)
    counts = np.diff(starts, append=run.samples)

    def measured(part: Part, inside: slice, table: FloatArray) -> None:
        rows = part.some(inside)
        table[:, 0], table[:, 1], table[:, 2:] = rows.t, rows.inputs.durations, rows.output

    means, _ = averaged_parts(replace(run.stream, counts=counts), measured, 2 + run.output.shape[1])

    interval = run.stream.interval
    note = (
        f"{run.samples:,} rows are read a part at a time: what is said at rest enters as means of up to"
        f" {longest * interval:.2g} s, turns row by row"
    )

    def placed(spans: Sequence[tuple[int, int]]) -> list[list[int]]:
        return np.searchsorted(starts, spans).tolist()

    ends = placed([(s.start, s.stop) for s in run.sections])
    return replace(
        run,
        inputs=Inputs(means[:, 0], {}, interval, None, means[:, 1] * counts, interval),
        output=means[:, 2:],
        source=replace(run.source, notes=(*run.source.notes, note)),
        stream=None,
        sections=tuple(replace(s, start=a, stop=b) for s, (a, b) in zip(run.sections, ends, strict=True)),
        stills=() if run.sections else tuple((a, b) for a, b in placed(resting)),
    )


def _condensing(
    resting: Sequence[tuple[int, int]], turned: Sequence[tuple[int, int]], samples: int
) -> tuple[NDArray[np.int64], int]:
    """First sample of each row that a run is condensed to, and how many samples a row at rest has at most."""
    # no more rows than a run is averaged to further on: those of different lengths are then never mixed
    blocks = max(BLOCKS - 4 * len(resting) - len(turned), BLOCKS // 4)
    longest = math.ceil(sum(b - a for a, b in resting) / blocks)
    cuts = [np.linspace(a + 1, b - 1, 1 + math.ceil((b - a) / longest)).astype(np.int64) for a, b in resting]
    single = [np.arange(a, b + 1) for a, b in turned]
    starts = np.unique(np.concatenate([[0], *resting, *cuts, *single]))
    return starts[starts < samples], longest


def left_by(run: Run, stills: Stills, spoilt: Sequence[tuple[float, float]]) -> Stills:
    """What is left of a run's stills without some spans of time, s, in parts that are long enough."""
    kept = np.ones(len(run.t), dtype=bool)
    for start, stop in spoilt:
        kept[(run.t > start) & (run.t < stop)] = False
    least = 1 if run.inputs.averaged is not None else math.ceil(SHORTEST / run.interval)
    parts = [first + stretches_of(kept[first:last]) for first, last in stills]
    return tuple((a, b) for part in parts for a, b in part.tolist() if b - a >= least)


def rows_of(stills: Stills) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples (n,) of all stills in their order, and which still each of them belongs to."""
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    return index, np.repeat(np.arange(len(stills)), [b - a for a, b in stills])


def still_rows(
    run: Run, stills: Stills, component: str, names: tuple[str, ...], said: FloatArray, X: FloatArray
) -> Linear:
    """All samples of the stills of a component, ``ax`` to ``gz``, as rows of a linear model.

    X (k, p) is what the columns `names` are in each still, `said` (n,) the output of the component, SI.
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


def samples_in(run: Run, stills: Stills) -> int:
    """Samples behind the rows of some stills."""
    averaged, sampling = run.inputs.averaged, run.inputs.sampling
    if averaged is None or not sampling:
        return sum(b - a for a, b in stills)
    return sum(round(float(averaged[a:b].sum()) / sampling) for a, b in stills)


def means_of(run: Run, values: FloatArray, stills: Stills) -> FloatArray:
    """Means (k, a) of values (n, a) of a run's rows over each still."""
    weights = run.inputs.averaged
    if weights is None:
        return np.array([values[a:b].mean(axis=0) for a, b in stills])
    return np.array([np.average(values[a:b], axis=0, weights=weights[a:b]) for a, b in stills])


def _rates(run: Run) -> FloatArray:
    """Rate (k,) of the table in each of the stills of gyroscopes alone, rad/s: its sign is the sense."""
    return np.array([next(s.rate for s in run.sections if s.start <= a < s.stop) for a, _ in run.stills])


def lengths_of(run: Run) -> FloatArray:
    """Length (k,) of what a triad senses in each still, where that is all that is known of it, SI."""
    return np.abs(_rates(run)) if run.sections else np.full(len(run.stills), run.gravity)


def shifts_of(run: Run, extras: tuple[Extra, ...]) -> FloatArray:
    """What a unit of each error adds to the length of the input in each still: (k, e)."""
    if not run.sections:  # gravity: every length is off by as much
        return np.ones((len(run.stills), len(extras)))
    rate = _rates(run)
    by_kind = {EARTH: np.sign(rate), "rate_scale": np.abs(rate)}
    return np.array([by_kind[extra.kind] for extra in extras]).reshape(-1, len(rate)).T


def times_of(run: Run, stills: Stills) -> tuple[tuple[float, float], ...]:
    """(start, stop) of each still, s."""
    t, half = run.t, np.zeros(len(run.t)) if run.inputs.averaged is None else 0.5 * run.inputs.averaged
    return tuple((float(t[a] - half[a]), float(t[b - 1] + half[b - 1])) for a, b in stills)


def _level(run: Run, width: int, least: int, threshold: float) -> tuple[float, float]:
    """Summed variance of the forces below which a window is at rest; largest variance of the rates."""
    seen = partial(_windows, run, width)
    ends = np.array([[(v.min(), v.max()) for v in part if v.size] for part in seen()])
    smallest, largest = ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)
    if threshold:
        return threshold**2, float(largest[-1])
    floor = max(STILLEST * float(largest[0]), np.finfo(float).tiny)
    extent = np.log([max(float(smallest[0]), floor), max(float(largest[0]), floor)])

    def spread() -> Iterator[FloatArray]:
        return (np.log(np.maximum(force, np.finfo(float).tiny)).clip(*extent) for force, _ in seen())

    def stills(cut: float) -> int:
        return sum(b - a >= least for a, b in _stretches(values < cut for values in spread()))

    cuts = _thresholds(spread(), extent)

    cut, rest, motion = cuts[0]
    if len(cuts) > 1 and math.exp(cuts[1][0]) < TREMOR**2 and stills(cuts[1][0]) > stills(cut):
        cut, rest, motion = cuts[1]
    if motion - rest < math.log(CONTRAST):
        raise UnobservableError(
            f"run '{run.name}' has no stills that differ from motion: hold the triad still in one direction"
            " after the other, and turn it between them"
        )
    return math.exp(cut), float(largest[-1])


def _stretches(parts: Iterable[NDArray[np.bool_]]) -> list[tuple[int, int]]:
    """(start, stop) of each stretch of windows that are quiet, in parts."""
    edges, first, before = list[int](), 0, False
    for quiet in parts:
        edges += (first + np.flatnonzero(np.diff(quiet, prepend=before))).tolist()
        first, before = first + len(quiet), bool(quiet[-1])
    edges += [first] if before else []
    return list(zip(edges[::2], edges[1::2], strict=True))


def _restlessness(run: Run, width: int, held: Sequence[tuple[int, int]]) -> float:
    """Variance of the rates that is usual where the force is at rest: each stretch counts once, however long.

    A case in the hand trembles as one on the table does not: three of four stretches are below it.
    """
    if not held:
        return math.inf
    edges, first = np.array(held, dtype=np.int64).reshape(-1), 0
    sums = np.zeros(len(edges))
    for _, rate in _windows(run, width):
        log = np.concatenate(([0.0], np.cumsum(np.log(np.maximum(rate, np.finfo(float).tiny)))))
        sums += log[np.clip(edges - first, 0, len(rate))]
        first += len(rate)
    means = (sums[1::2] - sums[::2]) / (edges[1::2] - edges[::2])
    return math.exp(float(np.quantile(means, CALMER)))


def _windows(run: Run, width: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Summed variances of the forces, and of the rates where there are some, over windows, in parts."""
    held = np.zeros((0, run.output.shape[1]))
    for part in run.parts("stills"):
        rows = np.concatenate((held, part.output))
        held = rows[1 - width :]
        if len(rows) >= width:
            rate = _rolling_variance(rows[:, 3:], width) if rows.shape[1] > 3 else np.zeros(0)
            yield _rolling_variance(rows[:, :3], width), rate


def _rolling_variance(values: FloatArray, width: int) -> FloatArray:
    """Summed variance of the columns over each window: (n - width + 1,)."""
    centred = values - values.mean(axis=0)
    first = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred)), axis=0)
    second = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred**2)), axis=0)
    mean = (first[width:] - first[:-width]) / width
    return np.maximum((second[width:] - second[:-width]) / width - mean**2, 0.0).sum(axis=1)


def _thresholds(parts: Iterable[FloatArray], extent: FloatArray) -> list[tuple[float, float, float]]:
    """Otsu's threshold of values in parts, and that of the values above it, if there is one.

    It is the cut with the largest variance between the two sides; inf where all are equal. With each come the
    medians of the values below and above it, to a bin.
    """
    if np.ptp(extent) == 0.0:
        return [(math.inf, extent[0], extent[0])]
    edges = np.histogram_bin_edges(extent, BINS)
    counts = np.sum([np.histogram(values, edges)[0] for values in parts], axis=0)
    middles = 0.5 * (edges[1:] + edges[:-1])
    first = _cut(counts, middles)
    above = np.where(np.arange(BINS) < first, 0, counts)
    cuts = [first, _cut(above, middles)] if np.count_nonzero(above) > 1 else [first]

    def median(few: NDArray[np.int64], middles: FloatArray) -> float:
        return float(middles[np.searchsorted(np.cumsum(few), 0.5 * few.sum())])

    sides = ((median(counts[:k], middles[:k]), median(counts[k:], middles[k:])) for k in cuts)
    return [(float(edges[cut]), *side) for cut, side in zip(cuts, sides, strict=True)]


def _cut(counts: NDArray[np.int64], middles: FloatArray) -> int:
    """Bins below Otsu's cut."""
    below, total = np.cumsum(counts)[:-1], counts.sum()
    first = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (first[-1] * below / total - first[:-1]) ** 2 / (below * (total - below))
    return 1 + int(np.nanargmax(between))
