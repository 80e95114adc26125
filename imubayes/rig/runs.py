"""Runs of a study, read from their files: of one component, of a triad, or of a whole IMU.

A pass over the rows of a file makes them a run: checks; of a long one block averages, extremes, and a stretch
at full rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import DataError
from imubayes.rig import checks, recordings
from imubayes.rig.checks import SATURATED, OutputLevels, Stretches, Timing, united
from imubayes.rig.filtering import as_means
from imubayes.rig.formats import FileTable, bare
from imubayes.rig.inputs import (
    DWELL,
    GAP,
    MOUNT,
    SCATTER,
    Inputs,
    Part,
    Run,
    RunSection,
    Stream,
    between_gaps,
    frozen,
    joined_parts,
    sampling_interval,
)
from imubayes.rig.streams import Clock, Lost, Reader, RunFile, abreast, opened
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.terms import QUANTITY, Kind, Library, columns
from imubayes.work import Progress, silent

BLOCKS = 1500
"""Blocks that a run is averaged to, about: as many as the noise of a run in memory is judged by."""

STRETCH = 65_536
"""Rows at full rate that are kept: the noise within a block is judged by them."""

APART = 0.1
"""Share of a block that a gap lasts at least to end it: averages may reach across a few lost samples."""

STEADY = 0.01
"""Relative error of the first table's sampling interval that asks for a second look at the run."""

TILE = 8192
"""Rows whose columns are made at a time: they fit the cache."""


def read_run(spec: recordings.RunSpec, kind: Kind, *, tell: Progress = silent) -> Run:
    """Read and check the file of a run of one component, or of a triad whose inputs are known in part.

    Parameters
    ----------
    spec : of the run, with a file.
    kind : of the sensor; it says what unit the output has.
    tell : is told of the progress of a long file (see `imubayes.rig.streams.STREAMED`).

    Returns
    -------
    the run. Where the file has a temperature and no ``dT``, that channel is the rate of the recorded
    temperature (see `temperature_rate`); of a second thermometer ``T_2`` it has ``gT``. Input channels that
    the file does not have are absent (zero), and the source's notes say so; without a column ``mount`` the
    whole run is one mounting.

    Raises
    ------
    DataError : if the file cannot be read, lacks a column or a unit, or holds what no run can hold. The
        message names the file and the line or the column, what was expected and what to do.
    """
    path = _path(spec)
    if spec.procedure in recordings.CASES:
        return _partly_known(spec, opened(path, spec, ("t", *recordings.TRIADS[kind]), (DWELL,), tell=tell))
    optional, unit = (*recordings.INPUTS, MOUNT, DWELL, SCATTER), recordings.OUTPUT_UNIT[kind]
    return _known(spec, opened(path, spec, ("t", "output"), optional, unit=unit, tell=tell), kind)


def read_imu_run(spec: recordings.RunSpec, *, tell: Progress = silent) -> Run:
    """Read and check the file of a run of a whole IMU, or the two files.

    It is a `DataError` as in `read_run`; if two files do not have the same time stamps, a section is not in
    the file, or a reference is not along the axes of the case.
    """
    path, known = _path(spec), spec.procedure not in recordings.CASES
    inputs = (*CASE_CHANNELS, MOUNT, DWELL) if known else (DWELL,)
    check = _refuse_component_axes if known else None
    here = COMPONENTS if spec.gyroscope_file is None else ACCELEROMETERS
    file = opened(path, spec, ("t", *here), inputs, tell=tell, check=check)
    if known and not any(name.startswith(("f_", "w_")) for name in file.columns):
        raise DataError(
            f"{file.shown}: has no column with an input: expected some of f_x f_y f_z (specific force, +1 g"
            " up at rest), w_x w_y w_z (rate) along the axes of the case, each with its unit, 'f_x [m/s^2]'"
        )
    if not known and (spec.dwell or DWELL in file.columns):
        raise DataError(
            f"{file.shown}: a table of means does not hold the turns between them: expected all samples of an"
            " IMU, or its accelerometers alone as a free tumble"
        )
    if spec.gyroscope_file is not None:
        own = replace(spec, shown=spec.gyroscope_shown)
        file = abreast(file, opened(recordings.files_of(spec)[1], own, ("t", *GYROSCOPES), tell=tell))
    return _known(spec, file) if known else _partly_known(spec, file)


def _path(spec: recordings.RunSpec) -> Path:
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    if spec.procedure in recordings.CASES and spec.gravity is None and not spec.turntable:
        example = 'gravity = "9.81 m/s^2"'
        raise DataError(f"run '{spec.name}': a {spec.procedure} run needs gravity, for example {example}")
    return recordings.files_of(spec)[0]


def _known(spec: recordings.RunSpec, file: RunFile, kind: Kind | None = None) -> Run:
    """Run with known inputs: of a component of a kind, of an IMU without one."""
    run, _ = _read_rows(spec, file, kind)
    return run if run.inputs.averaged is not None else as_means(run, kind or "accelerometer")


def _partly_known(spec: recordings.RunSpec, file: RunFile) -> Run:
    """Run of which gravity is known and perhaps sections."""
    run, lost = _read_rows(spec, file, None)
    sections = tuple(_among(section, lost, run) for section in spec.sections)
    return replace(run, gravity=spec.gravity or 0.0, sections=sections, components=file.outputs)


def _among(section: RunSection, lost: Stretches, run: Run) -> RunSection:
    """Section of the rows of a file, in a run without those that are `lost`, of which none may be in it."""
    starts, stops = lost.T
    total = run.samples + int(np.sum(stops - starts))
    if not 0 <= section.start < section.stop <= total:
        raise DataError(
            f"run '{run.name}': rows {section.start} to {section.stop} are no section of a file of"
            f" {total} rows: expected first and last of them, counted from 0"
        )
    if np.any((starts < section.stop) & (stops > section.start)):
        said = "; ".join(note for note in run.source.notes if SATURATED in note)
        raise DataError(
            f"run '{run.name}': section rows {section.start} to {section.stop} hold saturated samples"
            f" ({said}), and a turn needs them all: turn more slowly, or leave the section out"
        )
    before = int(np.sum((stops - starts)[stops <= section.start]))
    return replace(section, start=section.start - before, stop=section.stop - before)


def _refuse_component_axes(table: FileTable) -> None:
    """Refuse inputs along i, j, k: these are other axes for each component of a case."""
    strange = [
        name for name in table.columns if bare(name) in recordings.INPUTS and bare(name) not in CASE_CHANNELS
    ]
    if strange:
        raise DataError(
            f"{table.file}: column '{strange[0]}' is along an axis of a component, and the six components of"
            " a case have different ones: expected the inputs along the axes of the case, f_x f_y f_z,"
            " w_x w_y w_z, dw_x dw_y dw_z; rename the column"
        )


def _read_rows(spec: recordings.RunSpec, file: RunFile, kind: Kind | None) -> tuple[Run, Stretches]:
    """Read the rows of a file as a run of a component of a kind, or of a case; with them which are left out.

    Of a short file, and of a table of means, they are held; of a long one what fits is kept.
    """
    file, means = _with_lasting(spec, file)
    interval, rate = sampling_interval(next(file.values(Clock())).t), None
    survey = _surveyed(Reader(file, interval))
    for name, levels in zip(file.outputs, survey.levels, strict=True):
        checks.check_output(file.shown, file.columns[name], levels.distinct)
    if kind and (own := f"{QUANTITY[kind]}_i") in file.columns:
        checks.refuse_stuck(
            file.shown, file.columns["output"], survey.levels[0].distinct, survey.extremes[own]
        )
    if "T" in file.columns and "dT" not in file.columns:
        rows = survey.rows
        rate = rows.t, recordings.temperature_rate(rows.t, rows.inputs.channels["T"])
    usual = float(np.median([part.interval for part in survey.pace]))
    if rate is not None or abs(usual - interval) > STEADY * interval:
        survey = _surveyed(Reader(file, usual, rate), survey.levels)
    if any(rails := tuple(levels.rails() for levels in survey.levels)):
        survey = _without(replace(survey.reader, rails=rails), survey)
    return _run(spec, kind, survey, means), survey.lost


def _without(reader: Reader, survey: _Survey) -> _Survey:
    """Pass over a run again, without the samples at the ends of an output's range."""
    file, of = reader.file, survey.samples
    lost: list[list[Lost]] = [[] for _ in file.outputs]
    again = _surveyed(reader, survey.levels, lost)
    every = [united(np.concatenate([rows for rows, _ in parts])) for parts in lost]
    again.saturated = tuple(
        checks.saturation_note(file.columns[name], rails, rows, of, np.concatenate([t for _, t in parts])[0])
        for name, rails, rows, parts in zip(file.outputs, reader.rails, every, lost, strict=True)
        if rails
    )
    checks.check_left(file.shown, of - again.samples, of, again.saturated)
    again.pace, again.lost = survey.pace, united(np.concatenate(every))
    return again


@dataclass(slots=True, eq=False)
class _Survey:
    """What a pass over a run gathers. Sums (m, q) are of time, duration, channels `names`, and outputs.

    Of a file whose rows are held nothing is summed: the one part that is `kept` is all of it.
    """

    reader: Reader
    clock: Clock
    levels: tuple[OutputLevels, ...]
    names: tuple[str, ...] = ()
    samples: int = 0
    pace: list[Timing] = field(default_factory=list)
    kept: list[Part] = field(default_factory=list)
    sums: list[FloatArray] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    mounts: list[int] = field(default_factory=list)
    outermost: list[FloatArray] = field(default_factory=list)
    saturated: tuple[str, ...] = ()
    lost: Stretches = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    @property
    def held(self) -> bool:
        """Whether all rows are kept."""
        return self.reader.file.held is not None

    @property
    def rows(self) -> Part:
        """Averages over the blocks, with the averaging time of each; all rows of a file that is held."""
        if self.held:
            return self.kept[0]
        sums = np.stack(self.sums, axis=1)
        t, _, *means = frozen(sums / self.counts)
        channels = dict(zip(self.names, means, strict=False))
        mount = np.array(self.mounts) if self.mounts else None
        inputs = Inputs(t, channels, float(np.median(sums[1])), mount, frozen(sums[1]))
        return Part(inputs, _as_output(np.stack(means[len(channels) :], axis=1)))

    @property
    def extremes(self) -> Mapping[str, FloatArray]:
        """Rows (r,) that hold the extremes of each channel, by their names."""
        return self.kept[0].inputs.channels if self.held else _named(self.names, self.outermost[0])


def _as_output(values: FloatArray) -> FloatArray:
    """Outputs (n, c) as a run has them: (n,) of a single component."""
    return values[:, 0] if values.shape[1] == 1 else values


def _named(names: Sequence[str], rows: FloatArray) -> dict[str, FloatArray]:
    """Rows (r, q) of channels and, after them, outputs."""
    return dict(zip(names, rows.T, strict=False)) | {"output": _as_output(rows[:, len(names) :])}


def _surveyed(
    reader: Reader, levels: tuple[OutputLevels, ...] = (), lost: list[list[Lost]] | None = None
) -> _Survey:
    """Pass over a run, whose `levels` may be known; `lost` gets the rows that the reader leaves out."""
    survey = _Survey(reader, Clock(), levels or tuple(OutputLevels() for _ in reader.file.outputs))
    before = np.zeros(0)
    for part in reader("reading", lost, survey.clock):
        if sum(len(one) for one in survey.kept) < STRETCH:
            survey.kept.append(part)
        survey.names, survey.samples = tuple(part.inputs.channels), survey.samples + len(part)
        if not reader.rails:
            survey.pace.append(checks.pace_of(np.append(before, part.t), reader.interval))
        if not levels:
            for level, output in zip(survey.levels, np.atleast_2d(part.output.T), strict=True):
                level.add(output)
        if not survey.held:
            rows = _held(part)
            _average(survey, part, rows, np.diff(part.t, prepend=before if survey.counts else np.nan))
            survey.outermost = [_outermost(np.concatenate([*survey.outermost, rows]), survey.names)]
        before = part.t[-1:]
    return survey


def _average(survey: _Survey, part: Part, rows: FloatArray, steps: FloatArray) -> None:
    """Add the rows (k, q) of a part, and the steps (k,) of time to them, to the averages over the blocks."""
    starts = _block_starts(survey, part, steps)
    table = np.column_stack((part.t, part.inputs.durations, rows))
    opening = bool(starts) and starts[0] == 0
    first = starts if opening else [0, *starts]
    sums = np.add.reduceat(table, first, axis=0)
    counts = np.diff([*first, len(part)]).tolist()
    if not opening:
        survey.sums[-1] = survey.sums[-1] + sums[0]
        survey.counts[-1] += counts[0]
    survey.sums += list(sums if opening else sums[1:])
    survey.counts += counts if opening else counts[1:]
    if part.inputs.mount is not None:
        survey.mounts += part.inputs.mount[starts].tolist()


def _block_starts(survey: _Survey, part: Part, steps: FloatArray) -> list[int]:
    """First rows of the blocks that begin in a part of a run; the step to the first row of all is NaN."""
    longest, mount = max(1, math.ceil(survey.reader.file.rows / BLOCKS)), part.inputs.mount
    breaks = ~(steps <= max(APART * longest, GAP) * survey.reader.interval)
    if mount is not None:
        breaks |= np.diff(mount, prepend=survey.mounts[-1:] or mount[:1]) != 0
    count = survey.counts[-1] if survey.counts else 0
    starts: list[int] = []
    for a, b in pairwise(sorted({0, *np.flatnonzero(breaks).tolist(), len(part)})):
        if breaks[a]:
            starts.append(a)
            count = 0
        more = list(range(a + longest - count, b, longest))
        starts += more
        count = b - more[-1] if more else count + b - a
    return starts


def fill(lib: Library, part: Part, inside: slice, table: FloatArray) -> None:
    """Write columns of a library and, beside them, the response of some rows of a part into a table."""
    p = len(lib.names)
    channels = part.inputs.kept(inside).channels
    columns(lib, channels, len(table), out=table[:, :p])
    table[:, p] = part.output[inside] - channels.get(lib.own, 0.0)


def averaged_parts(
    stream: Stream, filled: Callable[[Part, slice, FloatArray], None], width: int
) -> tuple[FloatArray, FloatArray]:
    """Averages (m, width) over the blocks of a run of what is `filled` in, and the largest size (width,)."""
    ends = np.cumsum(stream.counts)
    sums, reach = np.zeros((len(ends), width)), np.zeros(width)
    for part in stream.read("averages"):
        for a in part.own[::TILE]:
            inside = slice(a, min(a + TILE, part.own.stop))
            table = np.empty((inside.stop - a, width))
            filled(part, inside, table)
            start = part.first + a
            first, last = np.searchsorted(ends, (start, start + len(table) - 1), "right")
            sums[first : last + 1] += np.add.reduceat(table, [0, *(ends[first:last] - start)], axis=0)
            reach = np.maximum(reach, np.abs(table).max(axis=0))
    return sums / stream.counts[:, None], reach


def renewed(run: Run) -> Run:
    """Run of which rows are left out, with the extremes of those that remain: one pass."""
    if (stream := run.stream) is None:
        return run
    names = [name for name in stream.extremes if name != "output"]
    outermost: list[FloatArray] = []
    for part in stream.parts("extremes of what is left"):
        outermost = [_outermost(np.concatenate([*outermost, _held(part)]), names)]
    return replace(run, stream=replace(stream, extremes=_named(names, outermost[0])))


def _held(part: Part) -> FloatArray:
    return np.column_stack((*part.inputs.channels.values(), part.output))


def _outermost(rows: FloatArray, names: Sequence[str]) -> FloatArray:
    """Rows that hold the smallest and largest of every quantity, and of the force."""
    force = [k for k, name in enumerate(names) if name.startswith("f_")]
    size = np.linalg.norm(rows[:, force], axis=1)
    every = rows.argmin(axis=0), rows.argmax(axis=0), (size.argmin(), size.argmax())
    return rows[np.unique(np.concatenate(every))]


def _run(spec: recordings.RunSpec, kind: Kind | None, survey: _Survey, means: tuple[str, ...]) -> Run:
    """Run of what a survey found; `means` says how the rows of a table of means count."""
    file, axes = survey.reader.file, "ijk" if kind else "xyz"
    rows, stream = survey.rows, None if survey.held else _stream(survey)
    inputs = rows.inputs if means else replace(rows.inputs, averaged=None)
    notes = [
        *file.notes,
        *survey.clock.notes,
        *checks.pace_notes(survey.pace, survey.reader.interval),
        *survey.saturated,
    ]
    if spec.procedure not in recordings.CASES:
        notes += checks.earth_left_out(spec.procedure, inputs, axes) if kind != "accelerometer" else ()
        notes += recordings.assumed(kind or "accelerometer", inputs.channels, axes)
    notes += means
    if survey.reader.rate is not None:
        notes.append("dT/dt is the smoothed derivative of the recorded temperature")
    if stream and spec.procedure not in recordings.CASES:
        notes.append(
            f"{stream.samples:,} rows are read a part at a time: every row counts in the coefficients, while"
            f" figures and tests have averages over {len(stream.counts):,} blocks, and"
            f" {len(stream.stretch):,} rows at full rate from t = {stream.stretch.t[0]:.6g} s on"
        )
    return Run(spec.name, spec.procedure, inputs, frozen(rows.output), file.source(tuple(notes)), stream)


def _stream(survey: _Survey) -> Stream:
    """The rows behind the averages over the blocks."""
    first = joined_parts(survey.kept)
    # the longest part of the first rows that no gap interrupts
    a, b = max(between_gaps(first.t, survey.reader.interval), key=lambda part: part[1] - part[0])
    return Stream(
        parts=survey.reader,
        interval=survey.reader.interval,
        counts=np.array(survey.counts),
        duration=survey.rows.inputs.durations,
        extremes=survey.extremes,
        stretch=first.some(slice(a, b)),
    )


ALMOST = 0.01
"""Share of a dwell by which times that were written down may lie too close."""


def _with_lasting(spec: recordings.RunSpec, file: RunFile) -> tuple[RunFile, tuple[str, ...]]:
    """Hold a table of means, with the averaging time of each row, s, and a note; samples stay as they are.

    With standard deviations of the means, a row counts as one over a time as short as these say. It is a
    `DataError` if means overlap, or one has no time or no scatter.
    """
    if not (spec.dwell or {DWELL, SCATTER} & file.columns.keys()):
        return file, ()
    rows, clock = file.whole()
    channels = dict(rows.inputs.channels)
    dwell, sd = channels.pop(DWELL, None), channels.pop(SCATTER, None)
    for name, values in ((DWELL, dwell), (SCATTER, sd)):
        if values is not None and not values.min() > 0.0:
            raise DataError(f"{file.shown}: column '{file.columns[name].address}': expected more than zero")
    if dwell is None:
        dwell = np.full(len(rows.t), spec.dwell or sampling_interval(rows.t))
    middles = 0.5 * (dwell[1:] + dwell[:-1])
    late = np.diff(rows.t) >= (1.0 - ALMOST) * middles
    if not late.all():
        row = int(np.argmin(late))
        step, over = rows.t[row + 1] - rows.t[row], f"{dwell[row]:.4g} s and {dwell[row + 1]:.4g} s"
        raise DataError(
            f"{file.shown}: row {row + 1} counted from 0 is {step:.4g} s after the one before, and means over"
            f" {over} overlap: expected t at their middles; correct 'dwell', or leave the time out:"
            " the rows then follow each other"
        )
    note = "rows are means, each weighted by its averaging time"
    if sd is not None:
        # none counts as longer than it is: rows that overlap would not be independent
        dwell, note = np.min(dwell * sd**2) / sd**2, "rows are means, weighted by one over sd squared"
    interval, averaged = float(np.median(dwell)), frozen(dwell)
    inputs = replace(rows.inputs, channels=channels, interval=interval, averaged=averaged)
    return replace(file, held=replace(rows, inputs=inputs), notes=clock), (note,)
