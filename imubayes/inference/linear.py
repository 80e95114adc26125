"""A run as rows of a linear model, ``y = X theta + noise``, with columns made a part of the run at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor
from imubayes.rig.bench import Kind
from imubayes.rig.inputs import Part, Run, Stream, between_gaps
from imubayes.rig.runs import averaged_parts, fill
from imubayes.sensors.terms import Library, columns

BLOCKS = 1500
"""Blocks that a run is averaged to: N is then known to 2 %, and an evaluation takes milliseconds."""

FAINT = 1e-6
"""Share of a component in a row below which the row says nothing of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """When n rows were taken: centres t, increasing, and averaging times, s.

    In a row of several alike and independent components these have the weights `axes` (n, a). `finest` is the
    averaging time, s, of the samples that the rows were averaged from, where these have flicker noise of
    their own to account for; None where the rows are what there is.
    """

    t: FloatArray
    duration: FloatArray
    axes: FloatArray | None = None
    finest: float | None = None

    @property
    def span(self) -> float:
        """Time from the start of the first row to the end of the last, s."""
        return float(self.t[-1] - self.t[0] + 0.5 * (self.duration[-1] + self.duration[0]))


Fill = Callable[[Part, slice, FloatArray], None]


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Rows of a linear model, of a run.

    Attributes
    ----------
    names : the p columns: terms of the library, then what else moves the output.
    t, duration : (n,) centres of the rows, and their averaging times, s.
    interval : averaging time of one sample, s.
    y : (n,) response, SI.
    columns : gives the columns (stop - start, p) of the rows from start to stop.
    axes : (n, a) as `Rows` has them.
    stream : the rows behind these, which are averages over blocks of them; None where these are all.
    fill : writes columns and, last, the response of some rows of a part of the stream into a table.
    reach : (p,) largest size of each column over the stream.
    finest : averaging time, s, of the samples behind averages of several lengths; None for rows of one.
    kept : what was made of these rows and is asked for again (see `once`).
    """

    name: str
    procedure: str
    names: tuple[str, ...]
    t: FloatArray
    duration: FloatArray
    interval: float
    y: FloatArray
    columns: Callable[[int, int], FloatArray]
    axes: FloatArray | None = None
    stream: Stream | None = None
    fill: Fill | None = None
    reach: FloatArray | None = None
    finest: float | None = None
    kept: dict[object, object] = field(default_factory=dict, init=False)

    def __len__(self) -> int:
        return len(self.y)

    def filled(self, inside: slice, table: FloatArray) -> None:
        """Write columns and response of some rows into a table."""
        p = len(self.names)
        table[:, :p], table[:, p] = self.columns(inside.start, inside.stop), self.y[inside]

    @property
    def samples(self) -> int:
        """Rows of the run, held or not."""
        return self.stream.samples if self.stream else len(self)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Samples (n,) behind each row."""
        return self.stream.counts if self.stream else np.ones(len(self), dtype=np.int64)

    @property
    def sampling(self) -> float:
        """Averaging time of one sample of the run, held or not, s."""
        return self.stream.interval if self.stream else self.interval

    @property
    def X(self) -> FloatArray:  # noqa: N802 - the letter of the algebra
        """All columns (n, p)."""
        return self.columns(0, len(self))

    @property
    def rows(self) -> Rows:
        """When the rows were taken."""
        return Rows(self.t, self.duration, self.axes, self.stream.interval if self.stream else self.finest)


@dataclass(frozen=True, slots=True)
class Extra:
    """A column that is no term of the sensor: an error of the reference.

    It is in every model, under its own normal prior with mean zero and of this sd, SI. Its name is unique
    among the columns, such as ``fixture_j.tumble.2``, its kind what it is an instance of: ``fixture``. It has
    an SI unit, and a `printed` one that people use. One that is `held` is linearised at this size, its mean,
    wherever it is found.
    """

    name: str
    kind: str
    sd: float
    unit: str
    printed: str
    text: str
    held: float | None = None

    @classmethod
    def of(cls, name: str, kind: Kind, sd: float, text: str, held: float | None = None) -> Extra:
        """Column of an error of the bench."""
        return cls(name, kind.name, sd, kind.unit, kind.printed, text, held)


def linear_of(run: Run, lib: Library) -> Linear:
    """Rows of a run with known inputs: output minus own input on the columns of the library.

    Of a run that is read a part at a time, averages over its blocks.
    """
    if run.stream:
        return streamed(run, run.stream, lib.names, _library_averages(run.stream, lib), partial(fill, lib))

    def library_rows(start: int, stop: int) -> FloatArray:
        part = run.inputs.kept(slice(start, stop))
        return columns(lib, part.channels, len(part))

    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=lib.names,
        t=run.inputs.t,
        duration=run.inputs.durations,
        interval=run.inputs.interval,
        y=deviation(run, lib),
        columns=library_rows,
    )


def averages_of(stream: Stream, key: object, write: Fill, width: int) -> tuple[FloatArray, FloatArray]:
    """Averages (m, width) over the blocks of what is written, and largest sizes (width,): one pass by key."""
    if key not in stream.averages:
        stream.averages[key] = averaged_parts(stream, write, width)
    return stream.averages[key]


def _library_averages(stream: Stream, lib: Library) -> tuple[FloatArray, FloatArray]:
    return averages_of(stream, lib, partial(fill, lib), len(lib.names) + 1)


def streamed(
    run: Run, stream: Stream, names: tuple[str, ...], averages: tuple[FloatArray, FloatArray], fill: Fill
) -> Linear:
    """Rows that are `averages` (m, p + 1) of columns and response over blocks; with them largest sizes."""
    means, reach = averages
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=names,
        t=run.inputs.t,
        duration=stream.duration,
        interval=run.inputs.interval,
        y=means[:, -1],
        columns=lambda start, stop: means[start:stop, :-1],
        stream=stream,
        fill=fill,
        reach=reach[:-1],
    )


def stretch_of(rows: Linear) -> Linear:
    """Rows at full rate, of the same model: of a stream its stretch, else the rows themselves."""
    if (stream := rows.stream) is None or rows.fill is None:
        return rows
    part, table = stream.stretch, np.empty((len(stream.stretch), len(rows.names) + 1))
    rows.fill(part, slice(0, len(part)), table)
    fine = replace(rows, t=part.t, duration=part.inputs.durations, interval=stream.interval, stream=None)
    return with_columns(fine, table[:, :-1], table[:, -1])


def deviation(run: Run, lib: Library) -> FloatArray:
    """Output minus own input, (n,), SI."""
    return run.output - run.inputs.channels.get(lib.own, 0.0)


def swing_of(run: Run, lib: Library) -> float:
    """Largest size of output minus own input, SI."""
    if run.stream is not None:
        return float(_library_averages(run.stream, lib)[1][-1])
    return float(np.max(np.abs(deviation(run, lib))))


def residuals(rows: Linear, theta: FloatArray) -> FloatArray:
    """Response minus what the coefficients `theta` (p,) explain: (n,)."""
    left = rows.y.copy()
    for a, b in algebra.row_blocks(len(rows)):
        left[a:b] -= rows.columns(a, b) @ theta
    return left


Made = TypeVar("Made")


def once(rows: Linear, key: object, make: Callable[[], Made]) -> Made:
    """Make something of rows, or give what was made of them before."""
    if key not in rows.kept:
        rows.kept[key] = make()
    return rows.kept[key]  # pyright: ignore[reportReturnType]: a key stands for one kind of thing


def reach_of(rows: Linear) -> FloatArray:
    """Largest size (p,) of each column."""
    if rows.stream is not None and rows.reach is not None:
        return rows.reach
    parts = (rows.columns(a, b) for a, b in algebra.row_blocks(len(rows)))
    return once(rows, "reach", lambda: np.max([np.abs(part).max(axis=0) for part in parts], axis=0))


def averages(rows: Linear, edges: NDArray[np.int64]) -> Linear:
    """Averages over the m parts of a run that begin at the rows `edges` (m,), as rows of the same model."""

    def mean(values: FloatArray) -> FloatArray:
        return means_of(rows, edges, lambda start, stop: values[start:stop])

    X = means_of(rows, edges, rows.columns)
    return replace(
        rows,
        t=mean(rows.t),
        duration=np.add.reduceat(rows.duration, edges),
        y=mean(rows.y),
        columns=lambda start, stop: X[start:stop],
        axes=None if rows.axes is None else mean(rows.axes),
    )


def means_of(rows: Linear, edges: NDArray[np.int64], values: Callable[[int, int], FloatArray]) -> FloatArray:
    """Averages (m, ...) as in `averages` of `values` (stop - start, ...), of the rows from start to stop."""
    ends, sums = np.append(edges, len(rows)), []
    at_once = max(1, algebra.ROWS_AT_ONCE // int(np.diff(ends).max()))
    for k in range(0, len(edges), at_once):  # whole parts, of which about so many rows are held
        inside = ends[k : k + at_once + 1]
        a, b = int(inside[0]), int(inside[-1])
        part = values(a, b)
        if rows.stream is not None:  # an average stands for all of its samples
            part = (part.T * rows.counts[a:b]).T
        sums.append(np.add.reduceat(part, inside[:-1] - a, axis=0))
    counts = np.diff(ends) if rows.stream is None else np.add.reduceat(rows.counts, edges)
    return (np.concatenate(sums).T / counts).T


def with_columns(rows: Linear, X: FloatArray, y: FloatArray | None = None) -> Linear:
    """The same rows with columns X (n, q), and with another response (n,) where it is given."""
    return replace(rows, columns=lambda start, stop: X[start:stop], y=rows.y if y is None else y)


def blocks_of(rows: Linear, blocks: int = BLOCKS) -> Linear:
    """Averages over about so many short blocks that never reach across a gap."""
    return once(rows, blocks, lambda: averages(rows, block_edges(rows.t, rows.interval, blocks)))


def averaged(rows: Linear) -> Linear:
    """Blocks of `blocks_of` as a record of their own: they tell of the coefficients what the rows do."""
    taken = blocks_of(rows)
    return replace(taken, interval=float(np.median(taken.duration)))


def block_edges(t: FloatArray, interval: float, blocks: int = BLOCKS) -> NDArray[np.int64]:
    """Start indices of blocks of nearly equal length that never reach across a gap.

    Examples
    --------
    >>> block_edges(np.array([0.0, 1.0, 2.0, 3.0, 50.0, 51.0]), 1.0, blocks=3).tolist()
    [0, 2, 4]
    """
    longest = max(1, math.ceil(len(t) / blocks))
    return np.concatenate([evenly(a, b, longest) for a, b in between_gaps(t, interval)])


def evenly(start: int, stop: int, longest: int) -> NDArray[np.int64]:
    """First rows of pieces of nearly equal length, of at most `longest` rows, from start to stop."""
    pieces = math.ceil((stop - start) / longest)
    return np.linspace(start, stop, pieces, endpoint=False).astype(np.int64)


def drive(rows: Sequence[Linear], columns: Sequence[str], names: Sequence[str]) -> Factor:
    """Factor of a component's columns over the samples of its runs: what the test's inputs were to it.

    Every sample counts alike, whatever its noise, and the response is zero. Where a row has a share of each
    component of a case (a free tumble), the share is that of the constant column, and is taken out. The rows
    name by `columns` the terms `names`; ``b0`` is among them.
    """
    R, n = np.zeros((len(names) + 1,) * 2), 0
    for part in rows:
        own = [part.names.index(name) for name in columns]
        for a, b in algebra.row_blocks(len(part)):
            X = part.columns(a, b)[:, own]
            share, counts = X[:, list(names).index("b0")], part.counts[a:b]
            here = np.abs(share) > FAINT
            X = X[here] * (np.sqrt(counts[here]) / share[here])[:, None]
            R = algebra.triangular((R, np.pad(X, ((0, 0), (0, 1)))), len(names) + 1)
            n += int(counts[here].sum())
    return Factor(tuple(names), R, n)


def among(rows: Linear, names: Sequence[str]) -> Linear:
    """Rows with the columns `names` alone: those that they do not have are zero."""
    if tuple(names) == rows.names:
        return rows
    places = [k for k, name in enumerate(names) if name in rows.names]
    taken = [rows.names.index(names[k]) for k in places]

    def placed(values: FloatArray) -> FloatArray:
        if len(taken) == len(names):
            return values[:, taken]
        whole = np.zeros((len(values), len(names)))
        whole[:, places] = values[:, taken]
        return whole

    def columns(start: int, stop: int) -> FloatArray:
        return placed(rows.columns(start, stop))

    made = replace(rows, names=tuple(names), columns=columns)
    if rows.fill is None or rows.reach is None:
        return made
    first, p = rows.fill, len(rows.names)

    def fill(part: Part, inside: slice, table: FloatArray) -> None:
        own = np.empty((len(table), p + 1))
        first(part, inside, own)
        table[:, : len(names)], table[:, len(names)] = placed(own), own[:, p]

    return replace(made, fill=fill, reach=placed(rows.reach[None])[0])


def widened_factor(f: Factor, names: Sequence[str]) -> Factor:
    """Factor of the same rows among the columns `names`: those that it does not have are zero.

    Examples
    --------
    >>> f = Factor(("b",), np.array([[2.0, 6.0], [0.0, 1.0]]), 5)
    >>> R = widened_factor(f, ("a", "b")).R
    >>> (R.T @ R).tolist()
    [[0.0, 0.0, 0.0], [0.0, 4.0, 12.0], [0.0, 12.0, 37.0]]
    """
    where = [list(names).index(name) for name in f.names]
    rows = np.zeros((f.p + 1, len(names) + 1))
    rows[:, [*where, len(names)]] = f.R
    R = algebra.triangular((rows,), len(names) + 1)
    return Factor(tuple(names), R, f.n, f.log_det)
