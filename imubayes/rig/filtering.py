"""Samples that a filter or quantization has coloured enter as means; steps and bad stretches are noted.

White noise, bias instability and random walk make T times the Allan variance at the averaging time T
``N^2 + b T + k T^2`` (`imubayes.sensors.noise`). A low-pass filter with the correlation time c takes
``3 c N^2 / (2 T)`` from it, a quantized angle adds ``3 Q^2 / T``. Where the sum is not enough from single
samples on, its fourth part is fitted, and samples are averaged over so long that what is left of it changes N
by less than half its error bar.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.rig.checks import RESTLESS, STEPS, stretches_of
from imubayes.rig.inputs import Inputs, Part, Run, between_gaps, frozen, joined_parts
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.terms import CHANNEL_UNITS, QUANTITY, Kind

OCTAVES = 7
"""Averaging times, each twice the one before, over which the sum is to hold."""

FEWEST = 5
"""Averaging times without which nothing is said: the sum has three parts."""

PAIRS = 12
"""Pairs of neighbouring means from which an Allan variance is taken into account."""

UNLIKELY = 0.01
"""Probability of a misfit by chance below which a sum does not hold."""

SHARE = 0.5
"""Of the error bar of N^2 that filter or quantization may still change it by."""

MEANS = "samples enter as means of"
"""How the note of a run goes on whose rows are means."""

ROWS = 100
"""Means that are left at least: fewer tell nothing of bias instability."""

LONG = 8
"""A part between gaps that is longer than one in so many rows of its run is a log, not a dwell: it is cut."""

PIECES = 200
"""Pieces that a run without gaps is cut to."""

MOST = 262_144
"""Rows of a dwell that are held at a time: twice an eighth of the longest run that is held whole."""

FEWEST_DWELLS = 12
"""Dwells of a run from which they are looked at as such."""

STEADY = 0.01
"""Change of an input within a mean, as a share of its largest size: its square is then right to 1e-4."""


def colour_of(
    parts: Sequence[FloatArray], interval: float, longest: int, samples: int
) -> tuple[int, str, bool]:
    """Look for a filter or quantization in what is said at constant inputs.

    The parts are samples (n,) of each stretch without a gap or a change of inputs, which come at an interval
    in s. A mean has `longest` of them at most; the run has `samples`, of which these may be a part.

    Returns
    -------
    (samples, words, quantized) : how many samples a mean has that neither shows in, 1 where single samples
    do not show them either; what was found and done; whether quantization is all that is wrong, from single
    samples on.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> white = rng.standard_normal(100_001)
    >>> colour_of([white], 0.01, 1000, 100_001)
    (1, '', False)
    >>> colour_of([white[1:] + 0.5 * white[:-1]], 0.01, 1000, 100_000)[1]
    'filtered above about 20 Hz: samples enter as means of 0.45 s'
    """
    levels = _levels(parts)
    if len(levels) < FEWEST or _sum_of(levels[:OCTAVES], fourth=False)[1] > UNLIKELY:
        return 1, "", False
    for first in range(len(levels) - FEWEST + 1):
        (white, more, less), likely = _sum_of(levels[first : first + OCTAVES], fourth=True)
        if likely > UNLIKELY and white > 0.0:
            ratio = (more - less) / white
            needed = (abs(ratio) / SHARE) ** (2.0 / 3.0) * (0.5 * samples) ** (1.0 / 3.0)
            held = min(math.ceil(needed), longest)
            if held <= 1:
                break
            means = f"{_cause(-ratio / 1.5, interval)}: {MEANS} {held * interval:.2g} s"
            return held, means, first == 0 and ratio > 0.0
    return 1, "", False


def _cause(share: float, interval: float) -> str:
    """What gives white noise a correlation time that is a `share` of the interval, s, in words.

    A filter of first order has it for its time constant; quantization makes neighbours take turns.
    """
    if share < 0.0:
        return "neighbouring samples take turns, as quantization makes them"
    rate = -math.log((math.sqrt(1.0 + share**2) - 1.0) / share) / (2.0 * math.pi * interval)
    return f"filtered above about {float(f'{rate:.1g}'):g} Hz"


def _levels(parts: Sequence[FloatArray]) -> FloatArray:
    """Length in samples, that times the Allan variance, and number of pairs, of every octave (m, 3)."""
    means, length, found = list(parts), 1.0, []
    while True:
        means = [part[: len(part) // 2 * 2].reshape(-1, 2) for part in means if len(part) > 1]
        pairs = sum(len(part) for part in means)
        if pairs < PAIRS:
            return np.array(found).reshape(-1, 3)
        square = sum(float(np.sum((part[:, 1] - part[:, 0]) ** 2)) for part in means)
        found.append((length, 0.5 * length * square / pairs, pairs))
        means, length = [part.mean(axis=1) for part in means], 2.0 * length


def _sum_of(levels: FloatArray, *, fourth: bool) -> tuple[tuple[float, float, float], float]:
    """White noise, what falls and what rises as 1/T, in samples, and how likely their misfit is."""
    from scipy.optimize import nnls
    from scipy.special import gammaincc

    length, found, pairs = levels.T
    if not found.min() > 0.0:
        return (0.0, 0.0, 0.0), 0.0
    basis = np.column_stack((np.ones_like(length), length, length**2))
    if fourth:
        basis = np.column_stack((basis, 1.0 / length, -1.0 / length))
    expected = found
    for _ in range(3):  # errors are a share of what is expected, not of what was found
        weight = np.sqrt(0.5 * pairs) / expected
        sizes, left = nnls(basis * weight[:, None], found * weight)
        expected = np.maximum(basis @ sizes, 0.1 * found)
    free = len(length) - int(np.count_nonzero(sizes))
    more, less = sizes[3:].tolist() if fourth else (0.0, 0.0)
    return (float(sizes[0]), more, less), float(gammaincc(0.5 * max(free, 1), 0.5 * left**2))


def as_means(run: Run, kind: Kind = "accelerometer") -> Run:
    """Run whose noise no filter shows in: as it is, or as means; its notes say which, and how long these are.

    It is of a component of a kind, or of all those of a case, with known inputs. Rows between which an input
    jumps stay apart. Of a run that is read a part at a time the stretch at full rate is looked at, and its
    means are held.
    """
    held = run.stretch
    edges, inputs = steady_edges(held.inputs, _steady(run)), held.inputs
    left = [one for _, _, one in _errors(held, kind)]
    most = max(1, min(run.samples // ROWS, int(np.median(np.diff(edges)))))
    found = [colour_of(np.split(values, edges[1:-1]), inputs.interval, most, run.samples) for values in left]
    samples, told, quantized = max(found, key=lambda colour: colour[0])
    if samples == 1:
        return run
    means = _means(run, samples)
    note = f"{told}, {len(means):,} of {run.samples:,} samples"
    made = _of_means(run, means, samples * inputs.interval)
    source = replace(run.source, notes=(*run.source.notes, note))
    return replace(made, source=source, record=run if quantized else None)


def _errors(run: Run, kind: Kind) -> Iterator[tuple[str, str, FloatArray]]:
    """Name and quantity of each output of a run, and what it says beside its own input."""
    for name in COMPONENTS if run.of_case else ("output",):
        one, of = (run.component(name), kind_of(name)) if run.of_case else (run, kind)
        yield name, QUANTITY[of], one.output - one.inputs.channels.get(f"{QUANTITY[of]}_i", 0.0)


def dwell_means(run: Run) -> Run:
    """Run of a mean over each dwell at constant inputs; the run as it is where it has too few, or no dwells.

    A dwell of more than an eighth of the run (a static log), or more than `MOST`, is cut to two-hundredths.
    """
    if run.of_case or not run.known:
        return run
    means = _means(run, run.samples)
    lasting = means.inputs.durations
    if float(lasting.max()) > min(float(lasting.sum()) / LONG, MOST * run.sampling):
        means = _means(run, math.ceil(run.samples / PIECES))
    told = FEWEST_DWELLS <= len(means) <= run.samples // 3 and np.ptp(means.output) > 0.0
    if not told:
        return run
    made = _of_means(run, means, float(np.median(means.inputs.durations)))
    return replace(made, record=run.record or run)


def _means(run: Run, samples: int) -> Part:
    """Means of all rows of a run, each over so many samples at most."""
    allowed = _steady(run)
    return joined_parts([_averaged(*dwells, samples, allowed) for dwells in _dwells(run, allowed)])


def _dwells(run: Run, allowed: Mapping[str, float]) -> Iterator[tuple[Run, NDArray[np.int64]]]:
    """Rows of a run in parts that end where dwells do, or after `MOST` rows of one, with their edges."""
    left: list[Part] = []
    for part in run.parts("means"):
        rows = joined_parts([*left, part])
        edges = steady_edges(rows.inputs, allowed)
        ends = edges if len(edges) == 2 and len(rows) > MOST else edges[:-1]
        if last := int(ends[-1]):
            yield run.of(rows.some(slice(0, last))), ends
        left = [rows.some(slice(last, None))] if last < len(rows) else []
    for rows in left:
        yield run.of(rows), np.array([0, len(rows)])


def _of_means(run: Run, means: Part, lasting: float) -> Run:
    """Run whose rows are means, of about so many seconds, of what the run has."""
    inputs = replace(means.inputs, interval=lasting, sampling=run.inputs.sampling or run.sampling)
    return replace(run, inputs=inputs, output=frozen(means.output), stream=None)


def steady_edges(inputs: Inputs, allowed: Mapping[str, float]) -> NDArray[np.int64]:
    """First row of each stretch without a gap, a new mount or a jump of an input, and the number of rows."""
    new = np.zeros(len(inputs) + 1, dtype=bool)
    new[[a for a, _ in between_gaps(inputs.t, inputs.interval)]] = new[-1] = True
    if inputs.mount is not None:
        new[1:-1] |= np.diff(inputs.mount) != 0
    for name, most in allowed.items():
        new[1:-1] |= np.abs(np.diff(inputs.channels[name])) > most
    return np.flatnonzero(new)


def _steady(run: Run) -> dict[str, float]:
    """How much each force and rate may change within a mean, SI."""
    allowed: dict[str, float] = {}
    for quantity in ("f_", "w_"):
        moved = {name: values for name, values in run.extremes.items() if name.startswith(quantity)}
        most = max((float(np.max(np.abs(values))) for values in moved.values()), default=0.0)
        allowed |= dict.fromkeys(moved, STEADY * most)
    return allowed


def _pieces(
    inputs: Inputs, edges: NDArray[np.int64], samples: int, allowed: Mapping[str, float]
) -> NDArray[np.int64]:
    """First rows of the means, of so many samples at most, and halved where inputs change too much within."""
    cut: list[NDArray[np.int64]] = []
    for a, b in pairwise(edges.tolist()):
        cut.append(np.linspace(a, b, math.ceil((b - a) / samples), endpoint=False).astype(np.int64))
    first = np.concatenate(cut)
    for name, most in allowed.items():
        values = inputs.channels[name]
        while True:
            change = np.maximum.reduceat(values, first) - np.minimum.reduceat(values, first)
            lengths = np.diff(first, append=len(values))
            wide = (change > most) & (lengths > 1)
            if not wide.any():
                break
            first = np.sort(np.concatenate((first, first[wide] + lengths[wide] // 2)))
    return first


def _averaged(run: Run, edges: NDArray[np.int64], samples: int, allowed: Mapping[str, float]) -> Part:
    """Means of rows over so many samples at most, with the averaging time of each."""
    inputs, first = run.inputs, _pieces(run.inputs, edges, samples, allowed)
    counts = np.diff(first, append=len(inputs))

    def means(values: FloatArray) -> FloatArray:
        return frozen((np.add.reduceat(values, first, axis=0).T / counts).T)

    of_rows = replace(
        inputs.kept(first),
        t=means(inputs.t),
        channels={name: means(values) for name, values in inputs.channels.items()},
        averaged=frozen(np.add.reduceat(inputs.durations, first)),
    )
    return Part(of_rows, means(run.output))


LEAST_ROWS, BLOCKS = 16, 400
"""Rows of a block at least, and blocks of a record, about."""

ENOUGH = 20
"""Blocks that tell what is usual."""

LOUDER = 3.0
"""Scatter of a bad stretch over the usual one: noise does it in one block of 1e15."""

RARE = 0.1
"""Share of the blocks above which a larger scatter is not a disturbance, but how the sensor is."""

HIGHER = 10.0
"""Change of level over that which is usual from block to block."""

LEVEL = 5
"""Blocks that a level is taken from."""


class _Blocks(NamedTuple):
    """Start and end (m,) of blocks of rows at constant inputs, s, mean and variance, and their stretch."""

    start: FloatArray
    stop: FloatArray
    mean: FloatArray
    variance: FloatArray
    stretch: NDArray[np.int64]


def with_disturbances(run: Run, kind: Kind) -> Run:
    """Run with known inputs, whose notes say at what time which output is disturbed."""
    if not run.known:
        return run
    edges, notes = steady_edges(run.inputs, _steady(run)), list[str]()
    for name, quantity, left in _errors(run, kind):
        notes += _of_output(name, _blocks(run.t, left, edges), CHANNEL_UNITS[quantity])
    return replace(run, source=replace(run.source, notes=(*run.source.notes, *notes))) if notes else run


def _blocks(t: FloatArray, y: FloatArray, edges: NDArray[np.int64]) -> _Blocks:
    width = max(LEAST_ROWS, len(t) // BLOCKS)
    long = np.flatnonzero(np.diff(edges) >= width)
    whole = [np.arange(edges[k], edges[k + 1] - width + 1, width) for k in long]
    first = np.concatenate([np.zeros(0, dtype=np.int64), *whole])
    values = y[first[:, None] + np.arange(width)]
    stretch = np.repeat(long, [len(one) for one in whole])
    return _Blocks(t[first], t[first + width - 1], values.mean(axis=1), values.var(axis=1), stretch)


def _of_output(name: str, blocks: _Blocks, unit: str) -> Iterator[str]:
    """Say at what time an output is disturbed."""
    if len(blocks.mean) < ENOUGH:
        return
    usual = float(np.median(blocks.variance))
    loud = (blocks.variance > LOUDER**2 * usual) & (usual > 0.0)
    if 0 < np.count_nonzero(loud) <= RARE * len(loud):
        parts = stretches_of(loud).tolist()
        a, b = max(parts, key=lambda part: blocks.variance[part[0] : part[1]].max())
        ratio = float(np.sqrt(blocks.variance[a:b].max() / usual))
        more = f", and at {len(parts) - 1} other times" if len(parts) > 1 else ""
        yield (
            f"{name} {RESTLESS} from t = {blocks.start[a]:.6g} s to {blocks.stop[b - 1]:.6g} s{more}: its"
            f" scatter there is {ratio:.2g} times the usual"
        )
    yield from _steps(name, blocks, loud, unit)


def _steps(name: str, blocks: _Blocks, loud: BoolArray, unit: str) -> Iterator[str]:
    """Say where the level of an output changes for good."""
    quiet = np.flatnonzero(~loud)
    mean, stretch = blocks.mean[quiet], blocks.stretch[quiet]
    change = np.where(np.diff(stretch) == 0, np.diff(mean), np.nan)
    known = change[np.isfinite(change)]
    if len(known) < ENOUGH:
        return
    usual = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    found = [
        (k, size)
        for k in np.flatnonzero(np.abs(np.nan_to_num(change)) > HIGHER * usual).tolist()
        if (size := _size(mean, stretch, k)) and abs(size) > HIGHER * usual > 0.0
    ]
    if found:
        k, size = max(found, key=lambda one: abs(one[1]))
        more = f", and {len(found) - 1} times more" if len(found) > 1 else ""
        yield f"{name} {STEPS} {size:.3g} {unit} at t = {blocks.start[quiet[k + 1]]:.6g} s{more}"


def _size(mean: FloatArray, stretch: NDArray[np.int64], k: int) -> float:
    """Change of level after block k, by the medians of blocks before and after in the same stretch."""
    here = np.flatnonzero(stretch == stretch[k])
    before, after = here[here <= k][-LEVEL:], here[here > k][:LEVEL]
    return float(np.median(mean[after]) - np.median(mean[before]))
