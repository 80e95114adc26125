"""Runs of a whole IMU: read from files, or simulated."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.errors import DataError
from imubayes.rig.bench import true_inputs
from imubayes.rig.checks import check_output, earth_left_out
from imubayes.rig.columns import resolve
from imubayes.rig.formats import Table, bare, read_table
from imubayes.rig.inputs import (
    Inputs,
    Run,
    Section,
    Source,
    case_inputs,
    own_inputs,
    sampling_interval,
    taken,
)
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import (
    CASES,
    INPUTS,
    MOUNT,
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
from imubayes.rig.reference import OFFSET
from imubayes.rig.runs import plan_run
from imubayes.rig.saturation import SATURATED, within_range
from imubayes.rig.simulate import drawn_errors, simulate
from imubayes.rig.stream_files import rows_in
from imubayes.rig.streams import MOST_WHOLE
from imubayes.sensors.catalogue import SensorClass, draw_unit
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, COMPONENTS, GYROSCOPES, kind_of
from imubayes.sensors.terms import Kind, Library

SAME_TIME = 0.01
"""Share of the interval by which time stamps of two files of one run may differ."""


def read_imu_run(spec: RunSpec) -> Run:
    """Read and check the file of a run of a whole IMU, or the two files.

    Raises
    ------
    DataError : as `imubayes.rig.runs.read_run` does; if two files do not have the same time stamps; if a
        section is not in the file; if a reference is not along the axes of the case.
    """
    if spec.file is None:
        raise DataError(f"run '{spec.name}' is simulated: it has no file to read")
    return _partly_known(spec, spec.file) if spec.procedure in CASES else _known(spec, spec.file)


def _partly_known(spec: RunSpec, file: Path) -> Run:
    if spec.gravity is None:
        raise DataError(f"run '{spec.name}': a {spec.procedure} run needs gravity = \"9.81 m/s^2\"")
    t, force, within, source = outputs_of(spec, file, ACCELEROMETERS)
    rate, within_too, other = _rates(spec, spec.gyroscope_file or file, t, source)
    kept = within & within_too
    for section in spec.sections:
        if not 0 <= section.start < section.stop <= len(t):
            raise DataError(
                f"run '{spec.name}': rows {section.start} to {section.stop} are no section of a file of"
                f" {len(t)} rows: expected first and last of them, counted from 0"
            )
    whole, interval = _both(source, other, spec), sampling_interval(t)
    sections = tuple(_among(section, kept, spec.name, whole) for section in spec.sections)
    inputs, output = Inputs(taken(t, kept), {}, interval), taken(np.hstack((force, rate)), kept)
    return Run(spec.name, spec.procedure, inputs, output, whole, gravity=spec.gravity, sections=sections)


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


def _rates(spec: RunSpec, file: Path, t: FloatArray, source: Source) -> tuple[FloatArray, BoolArray, Source]:
    """Outputs (n, 3) of the gyroscopes, taken at times t (n,), which rows are within range, source."""
    t_too, rate, kept, other = outputs_of(spec, file, GYROSCOPES)
    if len(t) != len(t_too) or np.max(np.abs(t - t_too)) > SAME_TIME * sampling_interval(t):
        raise DataError(
            f"{source.file} and {other.file}: expected the same time stamps in both, for accelerometers and"
            f" gyroscopes of one run; came {len(t)} and {len(t_too)} rows"
        )
    return rate, kept, other


def _both(source: Source, other: Source, spec: RunSpec) -> Source:
    """Source of a run whose gyroscopes may have a file of their own."""
    columns = tuple(dict.fromkeys((*source.columns, *other.columns)))
    notes = tuple(dict.fromkeys((*source.notes, *other.notes)))
    if spec.gyroscope_file is None:
        return Source(source.file, source.sha256, columns, notes)
    files, digests = f"{source.file}, {other.file}", f"{source.sha256}, {other.sha256}"
    return Source(files, digests, columns, notes)


def _known(spec: RunSpec, file: Path) -> Run:
    shown = spec.shown or str(file)
    path = existing(file, shown, spec.origin)
    _refuse_long(path, shown)
    table = read_table(path, shown)
    _refuse_component_axes(table)
    here = COMPONENTS if spec.gyroscope_file is None else ACCELEROMETERS
    columns = resolve(
        table,
        spec.columns,
        required=("t", *here),
        optional=(*CASE_CHANNELS, MOUNT),
        output_unit="",
        ignore=spec.ignore,
    )
    t, epoch = time_of(table, columns["t"])
    outputs = {name: values_of(table, columns[name], len(t)) for name in here}
    for name in here:
        check_output(table, columns[name])
    references = {name: column for name, column in columns.items() if name not in here}
    _check_references(table, references)
    inputs, derived = inputs_of(table, references, t)
    kept, lost = within_range(table.file, outputs, columns)
    lost = (*lost, *earth_left_out(spec.procedure, inputs, "xyz"))
    notes = (*epoch, *notes_of(t), *lost, *assumed("accelerometer", columns, "xyz"), *derived)
    source, said = source_of(table.file, sha256_of(path), columns, notes), list(outputs.values())
    if spec.gyroscope_file is not None:
        rate, within, other = _rates(spec, spec.gyroscope_file, t, source)
        source, said, kept = _both(source, other, spec), [*said, *rate.T], kept & within
    output = taken(np.column_stack(said), kept)
    return Run(spec.name, spec.procedure, inputs.kept(kept), output, source)


def _refuse_long(path: Path, shown: str) -> None:
    """Refuse a file with more rows than are held at a time."""
    rows = rows_in(path)
    if rows > MOST_WHOLE:
        raise DataError(
            f"{shown}: has about {rows:,} rows: a run of a whole IMU is read as a whole, and has at most"
            f" {MOST_WHOLE:,}; average the file, or list the components as sensors of their own"
        )


def _refuse_component_axes(table: Table) -> None:
    """Refuse inputs along i, j, k: these are other axes for each component of a case."""
    strange = [name for name in table.columns if bare(name) in INPUTS and bare(name) not in CASE_CHANNELS]
    if strange:
        raise DataError(
            f"{table.file}: column '{strange[0]}' is along an axis of a component, and the six components of"
            " a case have different ones: expected the inputs along the axes of the case, f_x f_y f_z,"
            " w_x w_y w_z, dw_x dw_y dw_z; rename the column"
        )


def _check_references(table: Table, references: Mapping[str, object]) -> None:
    """Refuse a run of which no input is known."""
    if not any(name.startswith(("f_", "w_")) for name in references):
        raise DataError(
            f"{table.file}: has no column with an input: expected some of f_x f_y f_z (specific force, +1 g"
            " up at rest), w_x w_y w_z (rate) along the axes of the case, each with its unit, 'f_x [m/s^2]'"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """What a simulated IMU is made of.

    Attributes
    ----------
    classes, libraries : of the components of each kind.
    truth : coefficients in SI by component and term (``ax.b0``), those not named being zero; empty draws the
        six units from their classes.
    bench : sd in SI of each kind of error of the bench, of accelerometers and of gyroscopes (they differ in
        ``turn_on``), of which one draw is made; empty for a bench without errors.
    """

    classes: Mapping[Kind, SensorClass]
    libraries: Mapping[Kind, Library]
    truth: Mapping[str, float]
    bench: Mapping[Kind, Mapping[str, float]] = field(default_factory=dict)


def simulate_imu(
    specs: Iterable[RunSpec], made: Made, rng: np.random.Generator
) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of a whole IMU: the axes i, j, k of a plan are x, y, z of the case.

    All six components see the same motion, errors of the bench included, each along its own axes; their noise
    is independent.

    Parameters
    ----------
    specs : runs with ``simulate``.
    made : what the IMU is made of.
    rng : the source of randomness: units, then the bench, then the noise of each component.

    Returns
    -------
    (runs, truth) : with the coefficients by component and term, and the errors of the bench by name, SI.

    Raises
    ------
    StudyError : if the options of a run make no run.
    """
    plans = [plan_run(spec) for spec in specs]
    truth = made.truth or _units(made, rng)
    errors = dict(_bench(plans, made.bench, rng))
    moved = [replace(plan, inputs=case_inputs(true_inputs(plan, errors))) for plan in plans]
    said = [_component(name, moved, made, truth, errors, rng) for name in COMPONENTS]
    source = Source(notes=(_note(made),))
    runs = tuple(
        Run(plan.name, plan.procedure, case_inputs(plan.inputs), np.column_stack(outputs), source)
        for plan, outputs in zip(plans, zip(*said, strict=True), strict=True)
    )
    return runs, {**truth, **errors}


def _units(made: Made, rng: np.random.Generator) -> dict[str, float]:
    """Six units, drawn from the classes of their kinds."""
    drawn = {
        name: draw_unit(made.classes[kind_of(name)], made.libraries[kind_of(name)], rng)
        for name in COMPONENTS
    }
    return {f"{name}.{term}": value for name, unit in drawn.items() for term, value in unit.items()}


def _bench(
    plans: list[Plan], bench: Mapping[Kind, Mapping[str, float]], rng: np.random.Generator
) -> Iterator[tuple[str, float]]:
    """One draw of the errors of the bench, by name; an offset of the output is each component's own."""
    shared = {name: sd for sds in bench.values() for name, sd in sds.items() if name != OFFSET}
    yield from drawn_errors(plans, shared, rng).items()
    for name in COMPONENTS:
        sd = bench.get(kind_of(name), {}).get(OFFSET, 0.0)
        yield from ((offset_name(plan.name, name), rng.normal(0.0, sd)) for plan in plans if sd)


def offset_name(run: str, component: str) -> str:
    """Name of the offset of a component's bias in a run."""
    return f"{OFFSET}.{run}.{component}"


def _component(
    name: str,
    moved: list[Plan],
    made: Made,
    truth: Mapping[str, float],
    errors: Mapping[str, float],
    rng: np.random.Generator,
) -> list[FloatArray]:
    """What a component says in each run, when the case is moved so."""
    own = {key.partition(".")[2]: value for key, value in truth.items() if key.partition(".")[0] == name}
    plans = [replace(plan, inputs=own_inputs(plan.inputs, name)) for plan in moved]
    runs: tuple[Run, ...] = simulate(made.classes[kind_of(name)], plans, seed=rng, truth=own)
    return [run.output + errors.get(offset_name(run.name, name), 0.0) for run in runs]


def _note(made: Made) -> str:
    """What was simulated, in words."""
    a, g = (made.classes[kind].id for kind in ("accelerometer", "gyroscope"))
    return (
        f"simulated: IMU of class {a}" if a == g else f"simulated: accelerometers of {a}, gyroscopes of {g}"
    )
