"""A file becomes a run: units, zeros, times, and the round trip."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_files import csv_of, same

from imubayes.rig.checks import SATURATED
from imubayes.rig.columns import ColumnSpec
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import RunSpec, temperature_rate, write_run
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.runs import read_run
from imubayes.rig.simulate import simulate, simulate_runs
from imubayes.rig.tumbles import tumble
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library

G = 9.80665


def _rows(columns: int, n: int = 50) -> np.ndarray:
    rows = np.random.default_rng(2).standard_normal((n, columns))
    rows[:, 0] = 0.5 * np.arange(n)
    return rows


@pytest.mark.parametrize(
    ("kind", "plan"),
    [
        ("accelerometer", tumble(angles=5, planes=2, dwell=1.0)),
        ("accelerometer", centrifuge([1, 7], mounts=3, dwell=1.0, ramp=True)),
        ("gyroscope", rate_table([-1.0, 0.3], mounts=3, dwell=1.0, radius=0.1)),
    ],
    ids=["tumble", "centrifuge", "rate table"],
)
def test_written_run_reads_back_to_the_last_bit(kind, plan, tmp_path):
    (run,) = simulate(sensor("mems_tactical", kind=kind), [plan], seed=3)
    write_run(run, tmp_path / "run.csv", kind=kind)
    back = read_run(RunSpec(run.name, run.procedure, tmp_path / "run.csv"), kind)
    np.testing.assert_array_equal(back.output, run.output)
    np.testing.assert_array_equal(back.inputs.t, run.inputs.t)
    same(back.inputs, run.inputs)
    assert not any("Earth's rate" in note for note in back.source.notes)
    # the median of differences of times of some 100 s
    assert back.inputs.interval == pytest.approx(run.inputs.interval, rel=1e-11)


def test_mounts_are_found_under_the_name_that_the_study_gives(tmp_path):
    rows = _rows(3)
    rows[:, 2] = np.arange(50) // 20 - 1
    path = csv_of(tmp_path, "t [s],output [g],plane", rows)
    columns = {"mount": ColumnSpec("plane")}
    run = read_run(RunSpec("a", "tumble", path, columns=columns), "accelerometer")
    np.testing.assert_array_equal(run.inputs.mount, np.arange(50) // 20 - 1)
    assert run.inputs.mount.dtype == np.int64 and not run.inputs.mount.flags.writeable
    assert set(run.inputs.channels) == set()


def test_units_of_the_header_become_si(tmp_path):
    rows = _rows(5)
    path = csv_of(tmp_path, "t [ms],output [mg],f_i [g],w_j [deg/s],T [degC]", rows)
    run = read_run(RunSpec("a", "other", path), "accelerometer")
    np.testing.assert_allclose(run.inputs.t, rows[:, 0] * 1e-3, rtol=1e-15)
    np.testing.assert_allclose(run.output, rows[:, 1] * G * 1e-3, rtol=1e-15)
    np.testing.assert_allclose(run.inputs.channels["f_i"], rows[:, 2] * G, rtol=1e-15)
    np.testing.assert_allclose(run.inputs.channels["w_j"], np.deg2rad(rows[:, 3]), rtol=1e-15)
    np.testing.assert_allclose(run.inputs.channels["T"], rows[:, 4] + 273.15, rtol=1e-15)
    T = run.inputs.channels["T"]
    np.testing.assert_array_equal(run.inputs.channels["dT"], temperature_rate(run.inputs.t, T))
    assert "dT/dt is the smoothed derivative of the recorded temperature" in run.source.notes
    assert "not in the file, taken as zero: f_j, f_k, w_i, w_k, dw_i, dw_j, dw_k" in run.source.notes
    path = csv_of(tmp_path, "t [s],output [g],T [degC],dT [degC/min],f_i [g]", rows)
    run = read_run(RunSpec("a", "thermal", path), "accelerometer")
    np.testing.assert_allclose(run.inputs.channels["dT"], rows[:, 3] / 60.0, rtol=1e-15)
    assert not any("dT/dt" in note for note in run.source.notes)


def test_study_says_what_counts_are(tmp_path):
    rows = _rows(2)
    path = csv_of(tmp_path, "clock,adc", rows)
    columns = {"t": ColumnSpec("clock", "s"), "output": ColumnSpec(1, "count", 2.4e-3, 100.0)}
    run = read_run(RunSpec("a", "static", path, columns=columns), "gyroscope")
    np.testing.assert_allclose(run.output, (rows[:, 1] - 100.0) * 2.4e-3, rtol=1e-15)
    assert run.source.columns == (("clock", "t", "s"), ("adc", "output", "count"))


def test_study_overrides_the_channel_that_the_file_calls_by_its_name(tmp_path):
    rows = _rows(3)
    path = csv_of(tmp_path, "t [s],output [m/s^2],spare [g]", rows)
    spec = RunSpec("a", "static", path, "bench/run.csv", columns={"output": ColumnSpec("spare")})
    run = read_run(spec, "accelerometer")
    np.testing.assert_allclose(run.output, rows[:, 2] * G, rtol=1e-15)
    assert run.source.file == "bench/run.csv"
    assert run.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("unit", "start", "step", "dtype"),
    [("ns", 1_700_000_000_123_456_789, 10_000_000, np.uint64), ("s", 1.7e9, 0.0078125, np.float64)],
)
def test_clock_that_counts_from_an_epoch_loses_no_resolution(unit, start, step, dtype, tmp_path):
    n = 64
    clock = np.array([start + k * step for k in range(n)], dtype=dtype)
    np.savez(tmp_path / "run.npz", t=clock, output=_rows(2, n)[:, 1])
    columns = {"t": ColumnSpec(unit=unit), "output": ColumnSpec(unit="rad/s")}
    run = read_run(RunSpec("a", "static", tmp_path / "run.npz", columns=columns), "gyroscope")
    seconds = step * (1e-9 if unit == "ns" else 1.0)
    np.testing.assert_allclose(run.inputs.t, np.arange(n) * seconds, rtol=1e-14)
    assert "time is counted from the first sample" in run.source.notes


@pytest.mark.parametrize(
    ("file", "time", "axes", "samples"),
    [
        ("imu_tk_xsens/xsens_acc.mat", ColumnSpec(0, "s"), [1, 2, 3], 51175),
        ("inertialnav/TestLog2.mat", ColumnSpec("IMU[:,1]", "ms"), [f"IMU[:,{k}]" for k in (5, 6, 7)], 30650),
        ("xio_fusion/sensor_data.csv", ColumnSpec("Time"), [f"Accelerometer {a}" for a in "XYZ"], 13514),
        ("imucal_ferraris/example_ferraris_session.csv", ColumnSpec("n_samples", "count", 1.0 / 102.4),
         ["acc_x", "acc_y", "acc_z"], 10376),
    ],
)  # fmt: skip
def test_public_recordings_are_read(file, time, axes, samples, recordings):
    unit = None if "xio" in file else "m/s^2"
    columns = {"t": time, **{f"a{x}": ColumnSpec(axis, unit) for x, axis in zip("xyz", axes, strict=True)}}
    spec = RunSpec("a", "free-tumble", recordings / file, columns=columns, gravity=9.81)
    run = read_run(spec, "accelerometer")
    assert run.output.shape == (samples, 3)


def test_free_tumble_is_a_triad_with_gravity(tmp_path):
    rows = _rows(4)
    path = csv_of(tmp_path, "t [s],ax [g],ay [g],az [g]", rows)
    run = read_run(RunSpec("a", "free-tumble", path, gravity=9.81), "accelerometer")
    np.testing.assert_allclose(run.output, rows[:, 1:] * G, rtol=1e-15)
    assert (run.gravity, run.interval) == (9.81, 0.5)


def test_simulated_runs_are_of_one_unit_and_say_which():
    entry = sensor("mems_tactical", kind="accelerometer")
    lib = library("accelerometer", powers=1, asymmetry=-1)
    specs = [RunSpec(name, "tumble", simulate={"profile": "tumble", "angles": 3}) for name in "ab"]
    drawn = [
        simulate_runs(specs, entry, lib, truth={}, rng=np.random.default_rng(seed)) for seed in (1, 1, 2)
    ]
    assert drawn[0][1] == drawn[1][1] != drawn[2][1]
    assert drawn[0][1].keys() == set(lib.names)
    np.testing.assert_array_equal(drawn[0][0][1].output, drawn[1][0][1].output)
    given = simulate_runs(specs, entry, lib, truth={"b0": 0.5}, rng=np.random.default_rng(1))
    assert given[1] == {"b0": 0.5}


def clipped(folder: Path, at: float, *, step: float = 0.0) -> tuple[RunSpec, Run, Run]:
    """A centrifuge to 20 g as it was simulated and as it is read, clipped at so many g."""
    plan = centrifuge([1, 5, 20], mounts=4, dwell=10.0)
    (run,) = simulate(sensor("mems_tactical", kind="accelerometer"), [plan], seed=3)
    output = np.round(run.output / step) * step if step else run.output
    write_run(replace(run, output=np.clip(output, -at * G, at * G)), folder / "run.csv", kind="accelerometer")
    spec = RunSpec("arm", "centrifuge", folder / "run.csv", "run.csv")
    return spec, run, read_run(spec, "accelerometer")


def test_saturated_samples_are_left_out_with_their_rows_and_number(tmp_path):
    _, run, read = clipped(tmp_path, 18.0)
    kept = np.abs(run.output) < 18.0 * G
    np.testing.assert_array_equal(read.output, run.output[kept])
    np.testing.assert_array_equal(read.inputs.channels["f_i"], run.inputs.channels["f_i"][kept])
    np.testing.assert_array_equal(read.inputs.mount, run.inputs.mount[kept])
    (note,) = [note for note in read.source.notes if SATURATED in note]
    first, lost = int(np.argmin(kept)), int(np.sum(~kept))
    assert note.startswith(f"output is saturated at -176.52 m/s^2 and 176.52 m/s^2: {lost} of {len(kept):,} ")
    assert f"rows {first} to " in note
    assert not read.output.flags.writeable and not read.inputs.t.flags.writeable


@pytest.mark.parametrize(("latitude", "told"), [(0.7, 0), (None, 1)])
def test_a_recorded_rate_table_says_that_the_earths_rate_across_its_axis_is_not_in_the_inputs(
    latitude, told, tmp_path
):
    plan = rate_table([-1.0, 0.0, 0.3], mounts=9, dwell=1.0, latitude=latitude)
    (run,) = simulate(sensor("mems_tactical", kind="gyroscope"), [plan], seed=3)
    write_run(run, tmp_path / "run.csv", kind="gyroscope")
    back = read_run(RunSpec(run.name, run.procedure, tmp_path / "run.csv"), "gyroscope")
    assert sum("Earth's rate across" in note for note in back.source.notes) == told


def test_a_second_thermometer_is_read_above_the_first_and_written_as_it_was(tmp_path):
    rows = _rows(4)
    path = csv_of(tmp_path, "t [s],output [g],T [degC],T_2 [degC]", rows)
    run = read_run(RunSpec("a", "thermal", path), "accelerometer")
    np.testing.assert_allclose(run.inputs.channels["gT"], rows[:, 3] - rows[:, 2], atol=1e-12)
    assert "T_2" not in run.inputs.channels
    write_run(run, tmp_path / "again.csv", kind="accelerometer")
    again = read_run(RunSpec("a", "thermal", tmp_path / "again.csv"), "accelerometer")
    np.testing.assert_allclose(again.inputs.channels["gT"], run.inputs.channels["gT"], atol=1e-12)
