"""Runs of a study, read from their files: of one component, of a triad, or of a whole IMU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.rig.checks import SATURATED, check_output, earth_left_out, refuse_stuck, within_range
from imubayes.rig.filtering import as_means
from imubayes.rig.formats import Table, bare
from imubayes.rig.inputs import MOUNT, Inputs, Run, Section, Source, sampling_interval, taken
from imubayes.rig.recordings import (
    CASES,
    INPUTS,
    OUTPUT_UNIT,
    RunSpec,
    assumed,
    existing,
    frozen,
    notes_of,
    sha256_of,
    source_of,
)
from imubayes.rig.stream_survey import read_long_run
from imubayes.rig.streams import Rows, RunFile, Tell, opened, refuse_long, silent
from imubayes.rig.thermal import temperature_rate
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.terms import Kind, Library

SAME_TIME = 0.01
"""Share of the interval by which time stamps of two files of one run may differ."""

BENCH_WHOLE = (
    "with a latency of the sensor (reference) a run",
    "leave it out of the study, or average the file",
)
IMU_WHOLE = "a run of a whole IMU", "average the file, or list the components as sensors of their own"
"""What is read as a whole, and what to do instead."""


def read_run(spec: RunSpec, kind: Kind, lib: Library | None = None, *, tell: Tell = silent) -> Run:
    """Read and check the file of a run of one component, or of a triad in a free tumble.

    Parameters
    ----------
    spec : of the run, with a file.
    kind : of the sensor; it says what unit the output has.
    lib : its terms, of which averages are held of a long file (see `imubayes.rig.streams.STREAMED`); None
        holds all rows of every file.
    tell : is told of the progress of a long one.

    Returns
    -------
    the run. Where the file has a temperature and no ``dT``, that channel is the rate of the recorded
    temperature (see `temperature_rate`). Input channels that the file does not have are absent (zero), and
    the source's notes say so; without a column ``mount`` the whole run is one mounting.

    Raises
    ------
    DataError : if the file cannot be read, lacks a column or a unit, or holds what no run can hold. The
        message names the file and the line or the column, what was expected and what to do.
    """
    path = _path(spec)
    if spec.procedure in CASES:
        t, output, kept, source = _outputs(spec, path, ACCELEROMETERS)
        return _partly_known(spec, (t, output, kept), source)
    optional, unit = (*INPUTS, MOUNT), OUTPUT_UNIT[kind]
    file = _opened(spec, path, ("t", "output"), optional, unit=unit, tell=tell)
    if file.held is None and lib is not None:
        return as_means(read_long_run(spec, file, kind, lib, sha256=sha256_of(path)), kind)
    refuse_long(file, *BENCH_WHOLE)
    return _known(spec, file, ("output",), kind=kind)


def read_imu_run(spec: RunSpec) -> Run:
    """Read and check the file of a run of a whole IMU, or the two files.

    Raises
    ------
    DataError : as `read_run` does; if two files do not have the same time stamps; if a section is not in the
        file; if a reference is not along the axes of the case.
    """
    path = _path(spec)
    if spec.procedure in CASES:
        t, force, within, source = _outputs(spec, path, ACCELEROMETERS)
        rate, kept, whole = _rates(spec, spec.gyroscope_file or path, (t, within), source)
        return _partly_known(spec, (t, np.hstack((force, rate)), kept), whole)
    here = COMPONENTS if spec.gyroscope_file is None else ACCELEROMETERS
    file = _opened(spec, path, ("t", *here), (*CASE_CHANNELS, MOUNT), check=_refuse_component_axes)
    _check_references(file)
    refuse_long(file, *IMU_WHOLE)
    return _known(spec, file, here)


def _path(spec: RunSpec) -> Path:
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    if spec.procedure in CASES and spec.gravity is None:
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
    tell: Tell = silent,
    check: Callable[[Table], None] = lambda table: None,
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
    )


def _known(spec: RunSpec, file: RunFile, here: tuple[str, ...], *, kind: Kind | None = None) -> Run:
    """Run with known inputs of the outputs `here`: of a component of a kind, of an IMU without one."""
    rows, clock = file.whole()
    outputs, axes = {name: rows.values.pop(name) for name in here}, "ijk" if kind else "xyz"
    for name, output in outputs.items():
        check_output(file.shown, file.columns[name], output)
    inputs, derived = _inputs(rows)
    if kind and (own := "f_i" if kind == "accelerometer" else "w_i") in file.columns:
        refuse_stuck(file.shown, file.columns["output"], outputs["output"], inputs.channels[own])
    kept, lost = within_range(file.shown, outputs, file.columns)
    lost = (*lost, *(earth_left_out(spec.procedure, inputs, axes) if kind != "accelerometer" else ()))
    zeros = assumed(kind or "accelerometer", file.columns, axes)
    notes = (*clock, *notes_of(rows.t), *lost, *zeros, *derived)
    source = source_of(file.shown, sha256_of(file.path), file.columns, notes)
    output = outputs["output"] if kind else np.column_stack(list(outputs.values()))
    if spec.gyroscope_file is not None:
        rate, kept, source = _rates(spec, spec.gyroscope_file, (rows.t, kept), source)
        output = np.hstack((output, rate))
    run = Run(spec.name, spec.procedure, inputs.kept(kept), taken(output, kept), source)
    return as_means(run, kind or "accelerometer")


def _inputs(rows: Rows) -> tuple[Inputs, tuple[str, ...]]:
    """Known inputs of a run, and what was derived for them."""
    channels, notes = dict(rows.values), ()
    if "T" in channels and "dT" not in channels:
        channels["dT"] = frozen(temperature_rate(rows.t, channels["T"]))
        notes = ("dT/dt is the smoothed derivative of the recorded temperature",)
    return Inputs(rows.t, channels, sampling_interval(rows.t), rows.mount), notes


def _outputs(
    spec: RunSpec, path: Path, components: tuple[str, ...]
) -> tuple[FloatArray, FloatArray, BoolArray, Source]:
    """Time (n,), outputs (n, 3), which of them are within range (n,), and source of components in a file."""
    file = _opened(spec, existing(path, _shown(spec, path), spec.origin), ("t", *components))
    rows, clock = file.whole()
    for name in components:
        check_output(file.shown, file.columns[name], rows.values[name])
    kept, lost = within_range(file.shown, rows.values, file.columns)
    source = source_of(file.shown, sha256_of(path), file.columns, (*clock, *notes_of(rows.t), *lost))
    return rows.t, np.column_stack([rows.values[name] for name in components]), kept, source


def _partly_known(spec: RunSpec, within: tuple[FloatArray, FloatArray, BoolArray], source: Source) -> Run:
    """Run of which gravity is known and perhaps sections: time, outputs, and the rows `within` range."""
    t, output, kept = within
    for section in spec.sections:
        if not 0 <= section.start < section.stop <= len(t):
            raise DataError(
                f"run '{spec.name}': rows {section.start} to {section.stop} are no section of a file of"
                f" {len(t)} rows: expected first and last of them, counted from 0"
            )
    sections = tuple(_among(section, kept, spec.name, source) for section in spec.sections)
    return Run(
        spec.name,
        spec.procedure,
        Inputs(taken(t, kept), {}, sampling_interval(t)),
        taken(output, kept),
        source,
        gravity=spec.gravity or 0.0,
        sections=sections,
    )


def _among(section: Section, kept: BoolArray, run: str, source: Source) -> Section:
    """Section of a run of which the rows `kept` (n,) remain; each of its own must."""
    if not kept[section.start : section.stop].all():
        lost = "; ".join(note for note in source.notes if SATURATED in note)
        raise DataError(
            f"run '{run}': section rows {section.start} to {section.stop} hold saturated samples ({lost}),"
            " and a turn needs them all: turn more slowly, or leave the section out"
        )
    before = int(np.count_nonzero(~kept[: section.start]))
    return replace(section, start=section.start - before, stop=section.stop - before)


def _rates(
    spec: RunSpec, path: Path, beside: tuple[FloatArray, BoolArray], source: Source
) -> tuple[FloatArray, BoolArray, Source]:
    """Outputs (n, 3) of the gyroscopes `beside` time and rows (n,) within range; rows and source of both."""
    (t, within), (t_too, rate, kept, other) = beside, _outputs(spec, path, GYROSCOPES)
    if len(t) != len(t_too) or np.max(np.abs(t - t_too)) > SAME_TIME * sampling_interval(t):
        raise DataError(
            f"{source.file} and {other.file}: expected the same time stamps in both, for accelerometers and"
            f" gyroscopes of one run; came {len(t)} and {len(t_too)} rows"
        )
    return rate, within & kept, _both(source, other, spec)


def _both(source: Source, other: Source, spec: RunSpec) -> Source:
    """Source of a run whose gyroscopes may have a file of their own."""
    columns = tuple(dict.fromkeys((*source.columns, *other.columns)))
    notes = tuple(dict.fromkeys((*source.notes, *other.notes)))
    if spec.gyroscope_file is None:
        return Source(source.file, source.sha256, columns, notes)
    files, digests = f"{source.file}, {other.file}", f"{source.sha256}, {other.sha256}"
    return Source(files, digests, columns, notes)


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
