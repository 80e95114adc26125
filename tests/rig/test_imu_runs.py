"""Runs of a whole IMU with known inputs: files, and six components that saw the same motion."""

from dataclasses import replace

import numpy as np
import pytest
from run_files import csv_of, same

from imubayes.errors import DataError
from imubayes.rig.inputs import RunSection
from imubayes.rig.recordings import RunSpec, write_run
from imubayes.rig.runs import read_imu_run
from imubayes.rig.simulate import plan_run, simulate_imu
from imubayes.sensors.catalogue import sensor, typical_noise
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library

KINDS = ("accelerometer", "gyroscope")
CLASSES = {kind: sensor("mems_tactical", kind=kind) for kind in KINDS}
LIBRARIES = {kind: library(kind, powers=1, asymmetry=-1) for kind in KINDS}
TABLE = RunSpec(
    "table", "rate-table", simulate={"profile": "rate-table", "rates": (-1.0, 2.0), "dwell": 5.0, "rate": 2.0}
)
OUTPUTS = "ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"


def made(spec, seed, bench=None):
    """The run of an IMU, and what is behind it."""
    rng = np.random.default_rng(seed)
    (run,), truth = simulate_imu([spec], CLASSES, LIBRARIES, truth={"ax.b0": 0.0}, bench=bench, rng=rng)
    return run, truth


def file_of(folder, header, n=30):
    values = np.random.default_rng(1).normal(size=(n, header.count(",")))
    table = np.column_stack((0.1 * np.arange(n), values))
    return RunSpec("run", "tumble", csv_of(folder, header, table), "run.csv"), table


def test_each_kind_has_the_noise_that_its_run_states_or_else_that_of_its_class():
    quiet = {"gyroscope": [Noise(1e-9, 0.0, 0.0)]}
    seeds = (np.random.default_rng(1) for _ in range(2))
    told = {"truth": {"ax.b0": 0.0}, "noises": quiet}
    (run,), _ = simulate_imu([TABLE], CLASSES, LIBRARIES, rng=next(seeds), **told)
    (usual,), _ = simulate_imu([TABLE], CLASSES, LIBRARIES, rng=next(seeds), truth={"ax.b0": 0.0})
    ours, theirs = (float(np.std(one.output[:10, 3])) for one in (run, usual))
    assert ours < 1e-8 < 1e-6 < theirs
    np.testing.assert_array_equal(run.output[:, :3], usual.output[:, :3])


def test_a_written_run_is_read_to_the_last_bit(tmp_path):
    run, _ = made(TABLE, 1)
    write_run(run, tmp_path / "run.csv", kind="accelerometer")
    again = read_imu_run(RunSpec("table", "rate-table", tmp_path / "run.csv", "run.csv"))
    np.testing.assert_array_equal(again.output, run.output)
    np.testing.assert_array_equal(again.inputs.t, run.inputs.t)
    same(again.inputs, run.inputs)


def test_gyroscopes_may_have_a_file_of_their_own(tmp_path):
    (tmp_path / "apart").mkdir()
    spec, table = file_of(tmp_path, f"t [s],f_x [m/s^2],{OUTPUTS[: OUTPUTS.index(',gx')]}")
    other, rates = file_of(tmp_path / "apart", "t [s],gx [rad/s],gy [rad/s],gz [rad/s]")
    run = read_imu_run(RunSpec("run", "tumble", spec.file, "run.csv", gyroscope_file=other.file))
    np.testing.assert_array_equal(run.output, np.column_stack((table[:, 2:], rates[:, 1:])))


def test_components_have_independent_noise_of_their_class():
    run, _ = made(TABLE, 3)
    inputs = np.column_stack(
        [run.inputs.channels.get(f"{q}_{axis}", np.zeros(len(run.inputs))) for q in "fw" for axis in "xyz"]
    )
    left = run.output - inputs
    n = len(left)
    steps = np.diff(left, axis=0)
    off = np.corrcoef(steps.T) - np.eye(6)
    # neighbouring differences of white noise: an effective number of two thirds
    assert np.abs(off).max() < 4.5 / np.sqrt(2.0 * n / 3.0)
    for kind, part in zip(KINDS, (steps[:, :3], steps[:, 3:]), strict=True):
        white = typical_noise(CLASSES[kind]).N * np.sqrt(2.0)
        sd = white / np.sqrt(0.5)
        assert part.std() == pytest.approx(sd, rel=4.5 / np.sqrt(2.0 * 3.0 * n * 2.0 / 3.0) + 0.02)


def test_all_components_see_one_draw_of_the_bench():
    """The noise is drawn after the bench, so that its difference is what the bench does."""
    bench = {kind: {"fixture_common": 1e-3, "gravity": 1e-3} for kind in KINDS}
    moved, truth = made(TABLE, 5, bench)
    f, w = (
        np.column_stack([moved.inputs.channels.get(f"{q}_{axis}", 0.0 * moved.inputs.t) for axis in "xyz"])
        for q in "fw"
    )
    rho = np.array([truth[f"fixture_common_{axis}"] for axis in "ijk"])
    up = f / np.linalg.norm(f, axis=1, keepdims=True)
    force, rate = moved.output[:, :3], moved.output[:, 3:]
    shifted = -np.cross(rho, f) + truth["gravity"] * up
    # what is left is noise and the square of the rotation
    noise = [typical_noise(CLASSES[kind]) for kind in KINDS]
    for said, known, one in ((force, f + shifted, noise[0]), (rate, w - np.cross(rho, w), noise[1])):
        square = float(np.sum(rho**2)) * np.abs(known).max()
        assert np.abs((said - known).mean(axis=0)).max() < square + 5.0 * (
            one.N / np.sqrt(len(said) / 2.0) + one.B
        )


@pytest.mark.parametrize(
    ("procedure", "options"),
    [
        ("oscillation", {"frequencies": (1.0,), "latitude": 0.8, "mounts": 2, "dwell": 2.0, "rate": 10.0}),
        ("vibration", {"levels": (0.0, 2.0), "mounts": 2, "dwell": 1.0, "rate": 400.0}),
        ("thermal", {"temperatures": (280.0, 320.0), "positions": 2, "rate": 0.1}),
    ],
)
def test_axes_of_a_plan_are_those_of_the_case_whatever_is_applied(procedure, options):
    spec = RunSpec("run", "other", simulate={"profile": procedure, **options})
    run, _ = made(spec, 1)
    plan = plan_run(spec).inputs
    assert run.component("ax").inputs.channels.keys() == plan.channels.keys()
    for channel, values in plan.channels.items():
        np.testing.assert_array_equal(run.component("ax").inputs.channels[channel], values)
        # y of the case is i of ay, and k of az (z, x, y)
        if channel.endswith("_j"):
            quantity = channel.partition("_")[0]
            np.testing.assert_array_equal(run.component("ay").inputs.channels[f"{quantity}_i"], values)
            np.testing.assert_array_equal(run.component("gz").inputs.channels[f"{quantity}_k"], values)
    # accelerometers and gyroscopes without errors say what is along them, but for their noise
    for kind, name, own in zip(KINDS, ("ax", "gx"), ("f_i", "w_i"), strict=True):
        one, noise = run.component(name), typical_noise(CLASSES[kind])
        white = noise.N / np.sqrt(run.inputs.interval)
        wander = 5.0 * (noise.B + noise.K * np.sqrt(run.inputs.t[-1]))
        assert np.abs(one.output - one.inputs.channels.get(own, 0.0)).max() < 6.0 * white + wander


def test_rows_in_which_one_of_six_is_saturated_are_left_out(tmp_path):
    header = f"t [s],f_x [m/s^2],{OUTPUTS}"
    spec, table = file_of(tmp_path, header, n=300)
    table[:, 6] = np.clip(table[:, 6], -0.8, 5.0)
    csv_of(tmp_path, header, table)
    run = read_imu_run(spec)
    assert len(run.inputs) == len(run.output) < 300
    assert run.output[:, 4].min() > -0.8
    assert "gy is saturated at -0.8 rad/s" in " ".join(run.source.notes)


def test_sections_count_the_rows_that_remain_and_hold_no_saturated_sample(tmp_path):
    header = f"t [s],{OUTPUTS}"
    spec, table = file_of(tmp_path, header, n=300)
    table[100:140, 1] = table[:, 1].max() + 1.0
    csv_of(tmp_path, header, table)
    sections = (RunSection(0, 90, "x"), RunSection(150, 300, "y", 6.0))
    spec = replace(spec, procedure="ferraris", gravity=9.81, sections=sections)
    run = read_imu_run(spec)
    assert "ax is saturated at" in " ".join(run.source.notes)
    assert [(one.start, one.stop) for one in run.sections] == [(0, 90), (110, 260)]
    np.testing.assert_array_equal(run.force[110:260], table[150:300, 1:4])
    with pytest.raises(DataError, match=r"rows 120 to 300 hold saturated samples \(ax is"):
        read_imu_run(replace(spec, sections=(RunSection(120, 300, "y", 6.0),)))
