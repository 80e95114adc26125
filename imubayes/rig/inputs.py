"""What the rig applied, and what the sensor said: the values that leave this package."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.rig.motion import vectors
from imubayes.sensors.imu import COMPONENTS, case_channel, own_channels
from imubayes.sensors.terms import QUANTITY

Number = TypeVar("Number", bound=np.generic)

MOUNT = "mount"
"""Column with the number of each row's plane or mount."""

DWELL, SCATTER = "dwell", "sd"
"""Columns of a table of means: how long each row was averaged, and its standard deviation."""

GAP = 1.5
"""A step of more than so many sampling intervals is a gap."""

ROUNDED = 1e-6
"""Share of an interval that a step may lack by rounding of the time stamps."""

CONSTANT = 1e-3
"""Relative spread of |f| below which it is the same in every row: inputs come with few decimals."""


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Known inputs of a run, in SI.

    Attributes
    ----------
    t : (n,) time in s, strictly increasing.
    channels : (n,) arrays by channel name (``f_i`` ... ``dw_k``, ``T``, ``dT``); an absent channel was not
        excited and counts as zero.
    interval : averaging time of one sample, s.
    mount : (n,) number of each row's plane (tumble) or mount (rate table, centrifuge): between rows of one
        number the case stayed in its fixture; None for one mounting of the whole run.
    averaged : (n,) averaging time of each row, s, where rows are means of samples; None where they are not.
    sampling : interval of those samples, s; 0 where the rows are samples, or those of a table of means.
    """

    t: FloatArray
    channels: Mapping[str, FloatArray]
    interval: float
    mount: NDArray[np.int64] | None = None
    averaged: FloatArray | None = None
    sampling: float = 0.0

    def __len__(self) -> int:
        return len(self.t)

    def kept(self, rows: NDArray[np.bool_ | np.int64] | slice) -> Inputs:
        """Inputs of some of the rows, which a mask (n,), their numbers or a slice tell."""
        channels = {name: frozen(values[rows]) for name, values in self.channels.items()}
        mount, averaged = (None if v is None else frozen(v[rows]) for v in (self.mount, self.averaged))
        return replace(self, t=frozen(self.t[rows]), channels=channels, mount=mount, averaged=averaged)

    def has(self, quantity: str) -> bool:
        """Whether there is a channel of a quantity (f, w, dw)."""
        return any(name.startswith(f"{quantity}_") for name in self.channels)

    def vectors(self, quantity: str) -> FloatArray:
        """Vectors (n, 3) of a quantity (f, w, dw) in case axes, zero where a channel is absent."""
        return vectors(self.channels, quantity, len(self))

    @property
    def mounts(self) -> NDArray[np.int64]:
        """Number (n,) of each row's mount, which is 0 in one mounting of the whole run."""
        return np.zeros(len(self), dtype=np.int64) if self.mount is None else self.mount

    @property
    def durations(self) -> FloatArray:
        """Averaging time (n,) of each row, s."""
        return durations(self.t, self.interval) if self.averaged is None else self.averaged


@dataclass(frozen=True, slots=True)
class Source:
    """Where a run came from, for the report.

    Attributes
    ----------
    file : path as the study gives it, or ``simulated``.
    sha256 : of the file's bytes; empty when simulated.
    columns : (column of the file, channel, unit) of each column that was used.
    notes : what the checks found that does not stop the run (gaps, saturated samples, assumed zeros).
    """

    file: str = "simulated"
    sha256: str = ""
    columns: tuple[tuple[str, str, str], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One recorded or simulated run: what a component said, or all components of a case on one clock.

    Attributes
    ----------
    name : as in the study, unique within the sensor.
    procedure : tumble, centrifuge, rate-table, oscillation, thermal, static, free-tumble, ferraris or other.
    inputs : what was applied; along the case axes (``f_x`` ... ``dw_z``, ``T``, ``dT``) where the output is
        of several components; without channels where the inputs are not known.
    output : (n,) what the component said, SI (m/s^2 or rad/s); (n, 3) ax, ay, az of a triad along the case
        axes x, y, z; (n, 6) these and gx, gy, gz of a whole IMU.
    source : where it came from.
    stream : the file's own rows, where they are too many to be held: inputs and output are then averages over
        blocks of them; None where they are the rows.
    gravity : local gravity, m/s^2, of a run of which only |f| = g is known while it is at rest; 0 where its
        inputs are known.
    sections : the parts of such a run whose inputs are known; none for a free tumble.
    record : the samples of a run of means, where nothing but quantization shows in them; None else.
    stills : (start, stop) rows of each still, where they were looked for already.
    components : of a case, those whose output it is.
    """

    name: str
    procedure: str
    inputs: Inputs
    output: FloatArray
    source: Source = field(default_factory=Source)
    stream: Stream | None = None
    gravity: float = 0.0
    sections: tuple[RunSection, ...] = ()
    record: Run | None = None
    stills: tuple[tuple[int, int], ...] = ()
    components: tuple[str, ...] = COMPONENTS

    def parts(self, purpose: str) -> Iterator[Part]:
        """Read all rows of the record a part at a time, memory being one part."""
        if self.stream:
            return self.stream.read(purpose)
        return iter([Part(replace(self.inputs, averaged=self.inputs.durations), self.output)])

    @property
    def sampling(self) -> float:
        """Averaging time of one sample of the record, held or not, s."""
        return self.stream.interval if self.stream else self.inputs.interval

    @property
    def samples(self) -> int:
        """Rows of the record, held or not."""
        return self.stream.samples if self.stream else len(self.inputs)

    @property
    def extremes(self) -> Mapping[str, FloatArray]:
        """Inputs and ``output`` in rows among which are those with the largest and smallest of each."""
        return self.stream.extremes if self.stream else {**self.inputs.channels, "output": self.output}

    @property
    def of_case(self) -> bool:
        """Whether it is of several components in one case."""
        return self.output.ndim == 2

    @property
    def known(self) -> bool:
        """Whether its inputs are known."""
        return self.gravity == 0.0 and not self.sections

    @property
    def t(self) -> FloatArray:
        """(n,) s."""
        return self.inputs.t

    @property
    def interval(self) -> float:
        """Averaging time of one sample, s."""
        return self.inputs.interval

    @property
    def force(self) -> FloatArray:
        """(n, 3) what the accelerometers of a case said, m/s^2; (n, 0) where there are none."""
        return self.output[:, : 3 * ("ax" in self.components)]

    @property
    def rate(self) -> FloatArray:
        """(n, 3) what the gyroscopes of a case said, rad/s; (n, 0) where there are none."""
        return self.output[:, 3 * ("ax" in self.components) :]

    def triad(self, kind: str) -> FloatArray:
        """(n, 3) what the triad of a kind said, SI."""
        return self.force if kind == "accelerometer" else self.rate

    def component(self, name: str) -> Run:
        """Run of one component of a case, ``ax`` to ``gz``: the inputs are along its own axes (i, j, k)."""
        column = self.components.index(name)
        stream = self.stream and self.stream.component(name, column)
        inputs = own_inputs(self.inputs, name)
        return replace(self, inputs=inputs, output=self.output[:, column], stream=stream)

    def of(self, part: Part) -> Run:
        """Some of its rows, at full rate."""
        return replace(self, inputs=part.inputs, output=part.output, stream=None)

    @property
    def stretch(self) -> Run:
        """Consecutive rows at full rate: all of a record that is held."""
        return self.of(self.stream.stretch) if self.stream else self

    def left(self, kept: NDArray[np.bool_]) -> Run:
        """The rows that are `kept` (n,), samples or averages; its notes say how many samples are not."""
        stream = self.stream and self.stream.left(kept)
        left = replace(self, inputs=self.inputs.kept(kept), output=self.output[kept], stream=stream)
        lost, of = self.samples - left.samples, self.samples
        note = f"{lost:,} of {of:,} samples are left out: their dwells are not trusted"
        return replace(left, source=replace(self.source, notes=(*self.source.notes, note))) if lost else left


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Consecutive rows of a run, with the averaging time of each.

    The number of the `first` in the run counts from 0; so many rows at the ends, `lead` and `tail`, are those
    of its neighbours.
    """

    inputs: Inputs
    output: FloatArray
    first: int = 0
    lead: int = 0
    tail: int = 0

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def t(self) -> FloatArray:
        """(k,) s."""
        return self.inputs.t

    @property
    def own(self) -> range:
        """Numbers of the rows that are none of a neighbour's, among its own."""
        return range(self.lead, len(self) - self.tail)

    def component(self, name: str, column: int) -> Part:
        """Rows of one component of a case, as `Run.component` has them, by its column of the output."""
        return replace(self, inputs=own_inputs(self.inputs, name), output=self.output[:, column])

    def around(self, rows: slice, margin: float) -> Part:
        """Some of the rows, with those within `margin`, s, of them, and `BESIDE` more, as neighbours'."""
        reach = self.t[rows.start] - margin, self.t[rows.stop - 1] + margin
        first, last = np.searchsorted(self.t, reach).tolist()
        first, last = max(first - BESIDE, 0), min(last + BESIDE, len(self))
        return replace(self.some(slice(first, last)), lead=rows.start - first, tail=last - rows.stop)

    def some(self, rows: slice) -> Part:
        """Some of the rows, under the numbers that they have."""
        return Part(self.inputs.kept(rows), self.output[rows], self.first + rows.start)


def joined_parts(parts: Sequence[Part]) -> Part:
    """Parts that follow each other as one."""
    first = parts[0].inputs
    if len(parts) == 1:
        return parts[0]

    def joined(values: Callable[[Inputs], NDArray[Number]]) -> NDArray[Number]:
        return frozen(np.concatenate([values(part.inputs) for part in parts]))

    inputs = replace(
        first,
        t=joined(lambda one: one.t),
        channels={name: joined(lambda one, name=name: one.channels[name]) for name in first.channels},
        mount=None if first.mount is None else joined(lambda one: one.mounts),
        averaged=None if first.averaged is None else joined(lambda one: one.durations),
    )
    return Part(inputs, np.concatenate([part.output for part in parts]), parts[0].first)


def thinned(parts: Iterable[tuple[Part, NDArray[np.bool_]]]) -> Iterator[Part]:
    """Parts with those of their rows (k,) that are kept, numbered anew."""
    first = 0
    for part, kept in parts:
        if kept.any():
            yield Part(part.inputs.kept(kept), part.output[kept], first)
            first += int(kept.sum())


BESIDE = 4
"""Rows beyond a margin that settle the slopes of the inputs at its end."""


def overlapping(parts: Iterator[Part], margin: float) -> Iterator[Part]:
    """Parts with as much of their neighbours as is within `margin`, s, and `BESIDE` rows more."""
    held: list[Part] = []
    ahead: deque[Part] = deque()
    while (part := ahead.popleft() if ahead else next(parts, None)) is not None:
        end = part.t[-1] + margin
        while sum(int(np.count_nonzero(one.t > end)) for one in ahead) < BESIDE:
            if (more := next(parts, None)) is None:
                break
            ahead.append(more)
        before = sum(len(one) for one in held)
        wide = joined_parts([*held, part, *ahead]).around(slice(before, before + len(part)), margin)
        yield wide
        held = [wide.some(slice(0, wide.own.stop))]


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """A run whose rows are too many to be held, and what one pass over them found.

    Attributes
    ----------
    parts : reads the rows, a part at a time; is told what for.
    interval : averaging time of one sample, s.
    counts : (m,) rows of each block that was averaged.
    duration : (m,) s, averaging time of each.
    extremes : rows (inputs and ``output``) with the largest and smallest of each, and of the force.
    stretch : consecutive rows without a gap, at full rate.
    margin : s by which a part is to overlap its neighbours: what a latency reaches for.
    averages : of a library's columns and, last, the response, and of what stands beside them: averages
        (m, k) over the blocks, and largest sizes (k,), once they were asked for.
    """

    parts: Callable[[str], Iterator[Part]]
    interval: float
    counts: NDArray[np.int64]
    duration: FloatArray
    extremes: Mapping[str, FloatArray]
    stretch: Part
    margin: float = 0.0
    averages: dict[object, tuple[FloatArray, FloatArray]] = field(default_factory=dict, init=False)

    @property
    def samples(self) -> int:
        """Number of rows."""
        return int(self.counts.sum())

    def read(self, purpose: str) -> Iterator[Part]:
        """Read the rows, a part at a time, with the margin on both sides of it."""
        parts = self.parts(purpose)
        return overlapping(parts, self.margin) if self.margin else parts

    def component(self, name: str, column: int) -> Stream:
        """Rows of one component of a case, by its column of the output."""
        output = self.extremes["output"][:, column]
        return replace(
            self,
            parts=partial(_of_component, self.parts, name, column),
            extremes={**own_channels(self.extremes, name), "output": output},
            stretch=self.stretch.component(name, column),
        )

    def left(self, kept: NDArray[np.bool_]) -> Stream:
        """The rows of the blocks (m,) that are `kept`; extremes are those of all."""
        return replace(
            self,
            parts=partial(_in_blocks, self.parts, self.counts, kept),
            counts=self.counts[kept],
            duration=self.duration[kept],
            stretch=_longest(self.stretch, self.counts, kept),
        )


Blocks = NDArray[np.int64]
"""Rows (m,) of each block."""


def _in_blocks(
    parts: Callable[[str], Iterator[Part]], counts: Blocks, kept: NDArray[np.bool_], purpose: str
) -> Iterator[Part]:
    """Read those rows that are in blocks (m,) which are kept."""
    return thinned((part, _inside(part, counts, kept)) for part in parts(purpose))


def _inside(part: Part, counts: Blocks, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which rows (k,) of a part are in blocks that are kept."""
    return kept[np.searchsorted(np.cumsum(counts), part.first + np.arange(len(part)), "right")]


def _longest(part: Part, counts: Blocks, kept: NDArray[np.bool_]) -> Part:
    """Longest piece of consecutive rows of which all are kept; the part as it is if there is none."""
    inside, ends = _inside(part, counts, kept), np.cumsum(counts)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])))).reshape(-1, 2)
    a, b = max(edges.tolist(), key=lambda edge: edge[1] - edge[0], default=(0, len(part)))
    block = int(np.searchsorted(ends, part.first + a, "right"))
    begins = part.first + a - int(ends[block] - counts[block]) if kept[block] else 0
    return replace(part.some(slice(a, b)), first=begins + int(counts[:block][kept[:block]].sum()))


def _of_component(
    parts: Callable[[str], Iterator[Part]], name: str, column: int, purpose: str
) -> Iterator[Part]:
    return (part.component(name, column) for part in parts(purpose))


@dataclass(frozen=True, slots=True)
class RunSection:
    """A part of a run whose inputs are known: at rest or turned about the vertical, or at a constant rate.

    Attributes
    ----------
    start, stop : samples [start, stop), counted from 0.
    up : case axis that points up: ``x``, ``-x``, ``y``, ``-y``, ``z`` or ``-z``; empty where no direction is
        known.
    angle : rad, right-handed about `up`; 0 at rest.
    rate : rad/s, of a table about its own axis, which lies in the case in whatever direction.
    """

    start: int
    stop: int
    up: str = ""
    angle: float = 0.0
    rate: float = 0.0

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,) that points up, along the case axes."""
        sign = -1.0 if self.up.startswith("-") else 1.0
        return sign * np.eye(3)["xyz".index(self.up[-1])]


def own_inputs(inputs: Inputs, component: str) -> Inputs:
    """Inputs along the case axes as those of a component, along its axes (i, j, k).

    Examples
    --------
    >>> along_x = Inputs(np.zeros(1), {"f_x": np.array([9.81])}, 1.0)
    >>> list(own_inputs(along_x, "ay").channels), list(own_inputs(along_x, "gz").channels)
    (['f_k'], ['f_j'])
    """
    return replace(inputs, channels=own_channels(inputs.channels, component))


def case_inputs(inputs: Inputs) -> Inputs:
    """Inputs along (i, j, k) as those of a case whose axes x, y, z these are: the inverse for ``ax``."""
    told = {case_channel("ax", channel): values for channel, values in inputs.channels.items()}
    return replace(inputs, channels=told)


def frozen(values: NDArray[Number]) -> NDArray[Number]:
    """Make an array read-only."""
    values.setflags(write=False)
    return values


def between_gaps(t: FloatArray, interval: float) -> tuple[tuple[int, int], ...]:
    """(start, stop) of each part of a record that no gap interrupts.

    Examples
    --------
    >>> between_gaps(np.array([0.0, 1.0, 2.0, 50.0, 51.0]), 1.0)
    ((0, 3), (3, 5))
    """
    breaks = (np.flatnonzero(np.diff(t) > GAP * interval) + 1).tolist()
    return tuple(pairwise((0, *breaks, len(t))))


def durations(t: FloatArray, interval: float) -> FloatArray:
    """Averaging time (n,) of each sample: the interval, or less where a neighbour is closer.

    Examples
    --------
    >>> durations(np.array([0.0, 1.0, 1.5, 9.0]), 1.0).tolist()
    [1.0, 0.5, 0.5, 1.0]
    """
    steps = np.diff(t)
    # steps that are short by rounding are whole: equal durations are cheaper further on
    steps = np.where(steps > (1.0 - ROUNDED) * interval, interval, steps)
    padded = np.concatenate(([interval], steps, [interval]))
    return np.minimum(padded[:-1], padded[1:])


def sampling_interval(t: FloatArray) -> float:
    """Averaging time of one sample: the median step, so that gaps between dwells do not count."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


@dataclass(frozen=True, slots=True)
class Facts:
    """What the inputs of all runs have in common.

    Attributes
    ----------
    kind : accelerometer or gyroscope.
    one_sided : the own input never changes sign.
    force : |f| where it is the same in every row (a test at 1 g), m/s^2; 0 where it is not.
    rate : |w| where it is the same in every row (the Earth's, in a test at rest), rad/s; 0 where it is not.
    still : f and w are the same in every row (a log at rest).
    reference_free : only |f| = g is known, or of gyroscopes alone |w|, and no direction.
    """

    kind: str
    one_sided: bool
    force: float = 0.0
    rate: float = 0.0
    still: bool = False
    reference_free: bool = False


UNKNOWN = Facts("accelerometer", one_sided=False)
"""Of inputs that nothing is known of."""


def facts_of(channels: Sequence[Mapping[str, FloatArray]], kind: str) -> Facts:
    """Return the facts of the inputs of several runs, given as SI channels by name."""
    own = f"{QUANTITY[kind]}_i"
    inputs = [c[own] for c in channels if own in c]
    sides = {side for values in inputs for side in (values.min(), values.max()) if side != 0.0}
    one_sided = bool(sides) and (all(s > 0.0 for s in sides) or all(s < 0.0 for s in sides))
    force, rate = (_constant_length(channels, quantity) for quantity in "fw")
    still = all(_constant(channels, quantity) for quantity in "fw")
    return Facts(kind, one_sided, force, rate, still)


def _constant_length(channels: Sequence[Mapping[str, FloatArray]], quantity: str) -> float:
    """Length of a vector where it is the same in every row; else zero."""
    names = [f"{quantity}_{axis}" for axis in "ijk"]
    size = [np.sqrt(sum(c[name] ** 2 for name in names if name in c)) for c in channels]
    low, high = min(float(np.min(v)) for v in size), max(float(np.max(v)) for v in size)
    return high if high - low <= CONSTANT * high else 0.0


def _constant(channels: Sequence[Mapping[str, FloatArray]], quantity: str) -> bool:
    """Whether a vector is the same in every row."""
    names = [f"{quantity}_{axis}" for axis in "ijk"]
    ends = [
        [fold(c[name]) if name in c else 0.0 for name in names] for c in channels for fold in (np.min, np.max)
    ]
    return bool(np.ptp(ends, axis=0).max() <= CONSTANT * np.abs(ends).max())
