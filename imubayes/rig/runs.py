"""Runs of a study, read from their files or simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from imubayes.errors import DataError, InputError, StudyError
from imubayes.rig.checks import check_output, earth_left_out
from imubayes.rig.columns import resolve
from imubayes.rig.formats import Table, read_table
from imubayes.rig.inputs import Inputs, Run, sampling_interval, taken
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import (
    FREE_TUMBLE,
    INPUTS,
    MOUNT,
    OUTPUT_UNIT,
    TRIAD,
    RunSpec,
    assumed,
    existing,
    inputs_of,
    notes_of,
    outputs_of,
    sha256_of,
    source_of,
    time_of,
    values_of,
)
from imubayes.rig.rotations import centrifuge, oscillation, rate_table
from imubayes.rig.saturation import refuse_stuck, within_range
from imubayes.rig.sequences import planned
from imubayes.rig.shaking import vibration
from imubayes.rig.simulate import drawn_errors, simulate_on_bench
from imubayes.rig.stream_survey import read_long_run
from imubayes.rig.streams import is_long, refuse_whole
from imubayes.rig.thermal import thermal
from imubayes.rig.tumbles import positions, static, tumble
from imubayes.sensors.catalogue import SensorClass, draw_unit
from imubayes.sensors.terms import Kind, Library

PROFILES = {
    "static": static,
    "tumble": tumble,
    "positions": positions,
    "rate-table": rate_table,
    "oscillation": oscillation,
    "centrifuge": centrifuge,
    "vibration": vibration,
    "thermal": thermal,
}
"""Functions that plan what can be simulated, by the profile's name."""


def read_run(
    spec: RunSpec,
    kind: Kind,
    lib: Library | None = None,
    *,
    tell: Callable[[str], None] = lambda message: None,
) -> Run:
    """Read and check the file of a run.

    Parameters
    ----------
    spec : of the run, with a file.
    kind : of the sensor; it says what unit the output has.
    lib : its terms, with which a long file (see `imubayes.rig.streams.STREAMED`) is read a part at a time;
        None reads every file as a whole.
    tell : is told of the progress of that.

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
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    if spec.procedure == FREE_TUMBLE:
        return _triad_run(spec, spec.file)
    shown = spec.shown or str(spec.file)
    path = existing(spec.file, shown, spec.origin)
    if long := _long_run(spec, path, kind, lib, tell):
        return long
    table = read_table(path, shown)
    return _run(spec, kind, table, sha256_of(spec.file))


def _long_run(
    spec: RunSpec, path: Path, kind: Kind, lib: Library | None, tell: Callable[[str], None]
) -> Run | None:
    """Read a long file a part at a time; None for a file that is read as a whole."""
    if lib is None:
        refuse_whole(path, spec.shown or str(path))
    if lib is None or not is_long(path):
        return None
    return read_long_run(spec, path, kind, lib, sha256=sha256_of(path), tell=tell)


def plan_run(spec: RunSpec) -> Plan:
    """Plan of a simulated run, under the run's own name.

    Raises
    ------
    StudyError : if the run is not simulated, or its options make no run; names the run.
    """
    if spec.simulate is None:
        raise StudyError(f"run '{spec.name}' is recorded: it has no profile to simulate")
    options = {key: value for key, value in spec.simulate.items() if key != "profile"}
    try:
        plan = planned(PROFILES[str(spec.simulate["profile"])], options)
    except InputError as error:
        raise StudyError(f"run '{spec.name}': {error}") from None
    return replace(plan, name=spec.name)


def simulate_runs(
    specs: Iterable[RunSpec],
    sensor_class: SensorClass,
    lib: Library,
    *,
    truth: Mapping[str, float],
    rng: np.random.Generator,
    bench: Mapping[str, float] | None = None,
) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of one sensor.

    Parameters
    ----------
    specs : runs with ``simulate``.
    sensor_class : gives the noise, and the coefficients where `truth` is empty.
    lib : terms of a unit drawn from the class.
    truth : coefficients in SI by name; empty draws a unit from the class over `lib`.
    rng : the source of randomness.
    bench : sd in SI of each kind of error of the bench; one draw is made, and the runs say nothing of it.

    Returns
    -------
    (runs, truth) : with the coefficients that were used, and the errors of the bench by name.

    Raises
    ------
    StudyError : if the options of a run make no run.
    """
    plans = [plan_run(spec) for spec in specs]
    unit = truth or draw_unit(sensor_class, lib, rng)
    errors = drawn_errors(plans, bench or {}, rng)
    return simulate_on_bench(sensor_class, plans, errors, seed=rng, truth=unit), {**unit, **errors}


def _run(spec: RunSpec, kind: Kind, table: Table, sha256: str) -> Run:
    columns = resolve(
        table,
        spec.columns,
        required=("t", "output"),
        optional=(*INPUTS, MOUNT),
        output_unit=OUTPUT_UNIT[kind],
        ignore=spec.ignore,
    )
    t, epoch = time_of(table, columns["t"])
    output = values_of(table, columns["output"], len(t))
    check_output(table, columns["output"])
    inputs, derived = inputs_of(table, {name: columns[name] for name in columns if name != "output"}, t)
    if (own := "f_i" if kind == "accelerometer" else "w_i") in columns:
        refuse_stuck(table.file, columns["output"], output, inputs.channels[own])
    kept, lost = within_range(table.file, {"output": output}, columns)
    lost = (*lost, *(earth_left_out(spec.procedure, inputs) if kind == "gyroscope" else ()))
    notes = (*epoch, *notes_of(t), *lost, *assumed(kind, columns), *derived)
    source = source_of(table.file, sha256, columns, notes)
    return Run(spec.name, spec.procedure, inputs.kept(kept), taken(output, kept), source)


def _triad_run(spec: RunSpec, file: Path) -> Run:
    if spec.gravity is None:
        raise DataError(
            f"run '{spec.name}': a free tumble needs gravity, for example gravity = \"9.81 m/s^2\""
        )
    t, output, kept, source = outputs_of(spec, file, TRIAD)
    inputs = Inputs(taken(t, kept), {}, sampling_interval(t))
    return Run(spec.name, spec.procedure, inputs, taken(output, kept), source, gravity=spec.gravity)
