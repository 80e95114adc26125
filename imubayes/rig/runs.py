"""Runs of a study, read from their files: of one component, of a triad, or of a whole IMU."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.errors import DataError
from imubayes.rig.checks import SATURATED, Stretches
from imubayes.rig.filtering import as_means
from imubayes.rig.formats import Table, bare
from imubayes.rig.inputs import DWELL, MOUNT, SCATTER, Run, Section
from imubayes.rig.recordings import CASES, INPUTS, OUTPUT_UNIT, TRIADS, RunSpec, existing
from imubayes.rig.stream_survey import read_rows
from imubayes.rig.streams import RunFile, abreast, opened
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES
from imubayes.sensors.terms import Kind
from imubayes.work import Progress, silent


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
        return _partly_known(spec, opened(path, spec, ("t", *TRIADS[kind]), (DWELL,), tell=tell))
    optional, unit = (*INPUTS, MOUNT, DWELL, SCATTER), OUTPUT_UNIT[kind]
    return _known(spec, opened(path, spec, ("t", "output"), optional, unit=unit, tell=tell), kind)


def read_imu_run(spec: RunSpec, *, tell: Progress = silent) -> Run:
    """Read and check the file of a run of a whole IMU, or the two files.

    It is a `DataError` as in `read_run`; if two files do not have the same time stamps, a section is not in
    the file, or a reference is not along the axes of the case.
    """
    path, known = _path(spec), spec.procedure not in CASES
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
        other = existing(spec.gyroscope_file, spec.gyroscope_shown, spec.origin)
        file = abreast(file, opened(other, own, ("t", *GYROSCOPES), tell=tell))
    return _known(spec, file) if known else _partly_known(spec, file)


def _path(spec: RunSpec) -> Path:
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    if spec.procedure in CASES and spec.gravity is None and not spec.turntable:
        example = 'gravity = "9.81 m/s^2"'
        raise DataError(f"run '{spec.name}': a {spec.procedure} run needs gravity, for example {example}")
    return existing(spec.file, spec.shown, spec.origin)


def _known(spec: RunSpec, file: RunFile, kind: Kind | None = None) -> Run:
    """Run with known inputs: of a component of a kind, of an IMU without one."""
    run, _ = read_rows(spec, file, kind)
    return run if run.inputs.averaged is not None else as_means(run, kind or "accelerometer")


def _partly_known(spec: RunSpec, file: RunFile) -> Run:
    """Run of which gravity is known and perhaps sections."""
    run, lost = read_rows(spec, file, None)
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
