"""Runs of a study, read from their files: of one component, of a triad, or of a whole IMU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.progress import Progress, silent
from imubayes.rig.checks import (
    SATURATED,
    Stretches,
    check_output,
    earth_left_out,
    refuse_stuck,
    stretches_of,
    within_range,
)
from imubayes.rig.filtering import as_means
from imubayes.rig.formats import Table, bare
from imubayes.rig.inputs import (
    DWELL,
    MOUNT,
    SCATTER,
    Inputs,
    Part,
    Run,
    Section,
    sampling_interval,
    taken,
)
from imubayes.rig.recordings import (
    CASES,
    INPUTS,
    OUTPUT_UNIT,
    TRIADS,
    RunSpec,
    assumed,
    existing,
    frozen,
    notes_of,
    with_gradient,
)
from imubayes.rig.stream_survey import read_long_run
from imubayes.rig.streams import RunFile, abreast, any_table, opened
from imubayes.rig.thermal import temperature_rate
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.terms import QUANTITY, Kind

MEANS = {DWELL, SCATTER}
"""Columns that only a table of means has."""

ALMOST = 0.01
"""Share of a dwell by which times that were written down may lie too close."""


def read_run(spec: RunSpec, kind: Kind, *, tell: Progress = silent) -> Run:
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
    if spec.procedure in CASES:
        return _partly_known(spec, _opened(spec, path, ("t", *TRIADS[kind]), (DWELL,), tell=tell))
    optional, unit = (*INPUTS, MOUNT, DWELL, SCATTER), OUTPUT_UNIT[kind]
    file = _opened(spec, path, ("t", "output"), optional, unit=unit, tell=tell)
    return _known(spec, file, kind)


def read_imu_run(spec: RunSpec, *, tell: Progress = silent) -> Run:
    """Read and check the file of a run of a whole IMU, or the two files.

    Raises
    ------
    DataError : as `read_run` does; if two files do not have the same time stamps; if a section is not in the
        file; if a reference is not along the axes of the case.
    """
    path, known = _path(spec), spec.procedure not in CASES
    inputs = (*CASE_CHANNELS, MOUNT, DWELL) if known else (DWELL,)
    check = _refuse_component_axes if known else any_table
    here = COMPONENTS if spec.gyroscope_file is None else ACCELEROMETERS
    file = _opened(spec, path, ("t", *here), inputs, tell=tell, check=check)
    if known:
        _check_references(file)
    elif spec.dwell or DWELL in file.columns:
        raise DataError(
            f"{file.shown}: a table of means does not hold the turns between them: expected all samples of an"
            " IMU, or its accelerometers alone as a free tumble"
        )
    if spec.gyroscope_file is not None:
        other = existing(spec.gyroscope_file, _shown(spec, spec.gyroscope_file), spec.origin)
        file = abreast(file, _opened(spec, other, ("t", *GYROSCOPES), tell=tell))
    return _known(spec, file) if known else _partly_known(spec, file)


def _path(spec: RunSpec) -> Path:
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    if spec.procedure in CASES and spec.gravity is None and not spec.turntable:
        example = 'gravity = "9.81 m/s^2"'
        raise DataError(f"run '{spec.name}': a {spec.procedure} run needs gravity, for example {example}")
    return existing(spec.file, _shown(spec, spec.file), spec.origin)


def _shown(spec: RunSpec, file: Path) -> str:
    return (spec.shown if file == spec.file else spec.gyroscope_shown) or str(file)


def _opened(
    spec: RunSpec,
    path: Path,
    required: tuple[str, ...],
    optional: tuple[str, ...] = (),
    *,
    unit: str = "",
    tell: Progress = silent,
    check: Callable[[Table], None] = any_table,
) -> RunFile:
    return opened(
        path,
        _shown(spec, path),
        spec.columns,
        required=required,
        optional=optional,
        output_unit=unit,
        ignore=spec.ignore,
        tell=tell,
        check=check,
        cut=not spec.sections,  # these count the rows of the file
        dwell=spec.dwell,
    )


def _known(spec: RunSpec, file: RunFile, kind: Kind | None = None) -> Run:
    """Run with known inputs: of a component of a kind, of an IMU without one."""
    if file.held is None and not (spec.dwell or MEANS & file.columns.keys()):
        return as_means(read_long_run(spec, file, kind)[0], kind or "accelerometer")
    rows, kept, found = _outputs(file)
    inputs, derived = _inputs(spec, file, rows)
    if kind and (own := f"{QUANTITY[kind]}_i") in file.columns:
        refuse_stuck(file.shown, file.columns["output"], rows.output, inputs.channels[own])
    axes = "ijk" if kind else "xyz"
    lost = earth_left_out(spec.procedure, inputs, axes) if kind != "accelerometer" else ()
    notes = (*found, *lost, *assumed(kind or "accelerometer", file.columns, axes), *derived)
    source = file.source(notes)
    output = taken(rows.output, kept)
    run = Run(spec.name, spec.procedure, inputs.kept(kept), output, source)
    return run if inputs.averaged is not None else as_means(run, kind or "accelerometer")


def _inputs(spec: RunSpec, file: RunFile, rows: Part) -> tuple[Inputs, tuple[str, ...]]:
    """Known inputs of a run, and what was derived for them."""
    lasting, notes = _lasting(spec, file, rows)
    known = {name: v for name, v in rows.channels.items() if name not in MEANS}
    channels = with_gradient(known, file.shown)
    if "T" in channels and "dT" not in channels:
        channels["dT"] = frozen(temperature_rate(rows.t, channels["T"]))
        notes = (*notes, "dT/dt is the smoothed derivative of the recorded temperature")
    interval = sampling_interval(rows.t) if lasting is None else float(np.median(lasting))
    return Inputs(rows.t, channels, interval, rows.mount, averaged=lasting), notes


def _lasting(spec: RunSpec, file: RunFile, rows: Part) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Averaging time (n,) of each row of a table of means, s, and a note; None where rows are samples.

    With standard deviations of the means, a row counts as one over a time as short as these say.
    """
    dwell, sd = rows.channels.get(DWELL), rows.channels.get(SCATTER)
    if dwell is None and sd is None and not spec.dwell:
        return None, ()
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
    if sd is None:
        return frozen(dwell), ("rows are means, each weighted by its averaging time",)
    # none counts as longer than it is: rows that overlap would not be independent
    return frozen(np.min(dwell * sd**2) / sd**2), ("rows are means, weighted by one over sd squared",)


def _outputs(file: RunFile) -> tuple[Part, BoolArray, tuple[str, ...]]:
    """All rows of a file, which of them (n,) are within the range of every output, and notes."""
    rows, clock = file.whole()
    outputs = dict(zip(file.outputs, np.atleast_2d(rows.output.T), strict=True))
    for name, output in outputs.items():
        check_output(file.shown, file.columns[name], output)
    kept, lost = within_range(file.shown, rows.t, outputs, file.columns)
    return rows, kept, (*clock, *notes_of(rows.t), *lost)


def _partly_known(spec: RunSpec, file: RunFile) -> Run:
    """Run of which gravity is known and perhaps sections."""
    if file.held is None and not (spec.dwell or MEANS & file.columns.keys()):
        run, lost = read_long_run(spec, file, None)
    else:
        rows, kept, notes = _outputs(file)
        lasting, means = _lasting(spec, file, rows)
        interval = sampling_interval(rows.t) if lasting is None else float(np.median(lasting))
        inputs = Inputs(rows.t, {}, interval, averaged=lasting).kept(kept)
        output, source = taken(rows.output, kept), file.source((*notes, *means))
        run, lost = Run(spec.name, spec.procedure, inputs, output, source), stretches_of(~kept)
    sections = tuple(_among(section, lost, run) for section in spec.sections)
    return replace(run, gravity=spec.gravity or 0.0, sections=sections, components=file.outputs)


def _among(section: Section, lost: Stretches, run: Run) -> Section:
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


def _refuse_component_axes(table: Table) -> None:
    """Refuse inputs along i, j, k: these are other axes for each component of a case."""
    strange = [name for name in table.columns if bare(name) in INPUTS and bare(name) not in CASE_CHANNELS]
    if strange:
        raise DataError(
            f"{table.file}: column '{strange[0]}' is along an axis of a component, and the six components of"
            " a case have different ones: expected the inputs along the axes of the case, f_x f_y f_z,"
            " w_x w_y w_z, dw_x dw_y dw_z; rename the column"
        )


def _check_references(file: RunFile) -> None:
    """Refuse a run of which no input is known."""
    if not any(name.startswith(("f_", "w_")) for name in file.columns):
        raise DataError(
            f"{file.shown}: has no column with an input: expected some of f_x f_y f_z (specific force, +1 g"
            " up at rest), w_x w_y w_z (rate) along the axes of the case, each with its unit, 'f_x [m/s^2]'"
        )
