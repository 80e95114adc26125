"""Scenes from logs and arrays. Attitude of a log: by angles, a quaternion or the rate, with the level frame
up whatever the log's axes."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from recorded_scenes import recorded
from run_files import csv_of
from scipy.spatial.transform import Rotation

from imubayes.errors import Place
from imubayes.rig.columns import ColumnSpec
from imubayes.rig.inputs import Inputs
from imubayes.scenes import at_rest, followed, in_case, levelled, read_scene
from imubayes.study.schema.scene_tables import scenes_of
from imubayes.units import STANDARD_GRAVITY

FUSION = {
    "t": ColumnSpec("Time (s)"),
    **{f"f_{a}": ColumnSpec(f"Accelerometer {b} (g)") for a, b in zip("ijk", "XYZ", strict=True)},
    **{f"w_{a}": ColumnSpec(f"Gyroscope {b} (deg/s)") for a, b in zip("ijk", "XYZ", strict=True)},
}
AUTOPILOT = {
    "t": ColumnSpec("IMU[:,1]", unit="ms", scale=1e-3),
    **{f"w_{a}": ColumnSpec(f"IMU[:,{c}]", unit="rad/s") for c, a in enumerate("ijk", 2)},
    **{f"f_{a}": ColumnSpec(f"IMU[:,{c}]", unit="m/s^2") for c, a in enumerate("ijk", 5)},
}


def force(scene):
    return np.array([scene.inputs.channels[f"f_{axis}"] for axis in "ijk"])


def test_hand_held_log_is_read_in_its_units_with_gravity_upwards_at_rest(recordings) -> None:
    scene = read_scene(recordings / "xio_fusion" / "sensor_data.csv", columns=FUSION)
    start = force(scene)[:, :200].mean(axis=1)
    assert start[2] == pytest.approx(STANDARD_GRAVITY, rel=0.01) and np.abs(start[:2]).max() < 0.3
    raw = np.loadtxt(recordings / "xio_fusion" / "sensor_data.csv", delimiter=",", skiprows=1)
    assert scene.inputs.channels["w_j"] == pytest.approx(np.radians(raw[:, 2]), rel=1e-12)
    assert scene.duration == pytest.approx(raw[-1, 0] - raw[0, 0], abs=0.02)


def test_autopilot_log_in_north_east_down_has_minus_g_along_z_at_rest(recordings) -> None:
    scene = read_scene(recordings / "inertialnav" / "TestLog2.mat", columns=AUTOPILOT, name="flight")
    start = force(scene)[:, :100].mean(axis=1)
    assert start[2] == pytest.approx(-9.8, abs=0.3)
    assert scene.name == "flight" and 600.0 < scene.duration < 620.0
    assert any("dw_k is the derivative of w_k" in note for note in scene.notes)


def test_case_axes_of_every_component_are_a_right_handed_turn_of_x_y_z() -> None:
    one = Inputs(np.zeros(1), {f"f_{a}": np.array([float(c)]) for c, a in enumerate("ijk")}, 1.0)
    for axis, along in {"x": "xyz", "y": "yzx", "z": "zxy"}.items():
        turned = in_case(one, axis).channels
        order = [int(turned[f"f_{letter}"][0]) for letter in "ijk"]
        assert "".join("xyz"[k] for k in order) == along
        assert np.linalg.det(np.eye(3)[order]) == pytest.approx(1.0)


def test_log_with_angular_acceleration_keeps_it(tmp_path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text("t [s],w_i [deg/s],dw_i [rad/s^2],T [degC]\n0,1,7,20\n1,2,8,21\n2,4,9,22\n")
    channels = read_scene(path).inputs.channels
    assert channels["dw_i"].tolist() == [7.0, 8.0, 9.0] and channels["dT"] == pytest.approx([1.0, 1.0, 1.0])
    assert channels["w_i"] == pytest.approx(np.radians([1.0, 2.0, 4.0])) and "f_i" not in channels


def test_temperature_of_a_log_counts_from_its_start_and_stays_after_its_end() -> None:
    t, three = 100.0 + np.arange(4.0), np.zeros((4, 3))
    warm = recorded("log", t, three, three, temperature=np.array([290.0, 292.0, 294.0, 296.0]), duration=60.0)
    heat = warm.temperature.at(np.array([0.0, 1.5, 3.0, 3.1, 50.0]))
    assert heat["T"].tolist() == [290.0, 293.0, 296.0, 296.0, 296.0]
    assert heat["dT"].tolist() == [2.0, 2.0, 2.0, 0.0, 0.0]
    assert not recorded("cold", t, three, three).temperature.at(t)


DOCS = Path(__file__).parents[2] / "docs" / "study.md"
LOGS = {
    "log_sensor_combined_0.csv": (
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_clipping",
        lambda k: (112_233_445 + 10_000 * k, 0.0, 0.0, 0.1, 4000, 0, 0.0, 0.0, -9.8, 0),
    ),
    "data.csv": (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
        lambda k: (1_403_636_579_758_555_392 + 10_000_000 * k, 0.1, 0.0, 0.0, 9.8, 0.0, 0.0),
    ),
    "drive.csv": (
        "ax,ay,az,gx,gy,gz,roll,pitch,yaw",
        lambda k: (0.0, 0.0, 9.8 / STANDARD_GRAVITY, 0.0, 0.0, math.degrees(0.1), 0.0, 0.0, 90.0),
    ),
}


def test_logs_of_autopilot_and_data_set_and_a_plain_one_are_read_as_the_documentation_says(tmp_path) -> None:
    """Each turns about the vertical at 0.1 rad/s, a hundred rows a second."""
    examples = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    tables = tomllib.loads(next(block for block in examples if block.startswith("[[scene]]")))["scene"]
    assert {table["file"] for table in tables} == set(LOGS)
    for table in tables:
        header, row = LOGS[table["file"]]
        lines = [",".join(map(str, row(k))) for k in range(300)]
        (tmp_path / table["file"]).write_text("\n".join((header, *lines)), encoding="utf-8")
    for mission in scenes_of(tables, Place(tmp_path / "study.toml").at("scene"), 0, ()):
        scene = mission.scene
        assert scene.duration == pytest.approx(3.0, rel=1e-6)
        up = np.einsum("nij,jn->ni", scene.attitude, force(scene))
        assert up == pytest.approx(np.tile([0.0, 0.0, 9.8], (300, 1)), abs=1e-6)
        rate = np.linalg.norm([scene.inputs.channels[f"w_{axis}"] for axis in "ijk"], axis=0)
        assert rate == pytest.approx(0.1, rel=1e-6)


G, OVER = 9.80665, np.diag([1.0, -1.0, -1.0])


def written(tmp_path, *, down, columns):
    """Log of a case that turns and leans, in axes with z up or down, and its attitude to north, west, up."""
    t = 0.01 * np.arange(500)
    angles = np.column_stack((0.4 * t, 0.2 * np.sin(t), 0.3 * np.sin(1.3 * t)))
    turned = Rotation.from_euler("ZYX", angles)
    level = OVER if down else np.eye(3)
    force = turned.inv().apply(level @ [0.0, 0.0, G])
    step = (turned[:-1].inv() * turned[1:]).as_rotvec() / 0.01
    rate = np.vstack((step[:1], 0.5 * (step[1:] + step[:-1]), step[-1:]))
    x, y, z, w = turned.as_quat().T
    every = {
        "t [s]": t,
        **{f"f_{a} [m/s^2]": force[:, k] for k, a in enumerate("ijk")},
        **{f"w_{a} [rad/s]": rate[:, k] for k, a in enumerate("ijk")},
        "yaw [deg]": np.degrees(angles[:, 0]), "pitch [deg]": np.degrees(angles[:, 1]),
        "roll [deg]": np.degrees(angles[:, 2]), "q_w": w, "q_x": x, "q_y": y, "q_z": z,
    }  # fmt: skip
    given = {
        name: values for name, values in every.items() if name[0] in "tfw" or name.split(" ")[0] in columns
    }
    path = csv_of(tmp_path, ",".join(given), np.column_stack(list(given.values())), "log.csv")
    return read_scene(path), level @ turned.as_matrix()


@pytest.mark.parametrize("columns", [("roll", "pitch", "yaw"), ("q_w", "q_x", "q_y", "q_z")])
@pytest.mark.parametrize("down", [True, False])
def test_attitude_of_a_log_is_that_of_its_angles_or_its_quaternion(tmp_path, down, columns) -> None:
    scene, truth = written(tmp_path, down=down, columns=columns)
    assert scene.attitude == pytest.approx(truth, abs=1e-9)
    assert not any("followed" in note for note in scene.notes)


@pytest.mark.parametrize("down", [True, False])
def test_attitude_without_either_is_followed_from_the_rate_and_said_to_be(tmp_path, down) -> None:
    """Rates by differences of a record at 100 Hz leave 2e-5 of it; the heading begins at north."""
    scene, truth = written(tmp_path, down=down, columns=())
    assert scene.attitude[:, 2] == pytest.approx(truth[:, 2], abs=3e-5)
    turns = scene.attitude[0].T @ scene.attitude
    assert turns == pytest.approx(truth[0].T @ truth, abs=3e-5)
    assert any("followed from the rate" in note for note in scene.notes)


def test_case_at_rest_tells_how_well_force_and_attitude_agree() -> None:
    up = np.tile([0.0, 0.0, G], (5, 1))
    lean = Rotation.from_euler("x", 0.02).as_matrix()
    assert at_rest(np.tile(lean, (5, 1, 1)), up, 0.0 * up) == pytest.approx(0.02, rel=1e-6)
    assert len(at_rest(np.tile(lean, (5, 1, 1)), up, 1.0 + up)) == 0


def test_case_is_levelled_by_its_force_however_it_lies() -> None:
    for f in np.random.default_rng(1).normal(size=(20, 3)):
        C = levelled(np.tile(f, (3, 1)))
        assert C @ f == pytest.approx([0.0, 0.0, np.linalg.norm(f)], abs=1e-12)
        assert np.abs(C @ C.T - np.eye(3)).max() < 1e-12 and np.linalg.det(C) == pytest.approx(1.0)
    t = np.linspace(0.0, 3.0, 301)
    rate = np.random.default_rng(2).normal(size=3)
    found = followed(t, np.tile(rate, (301, 1)), np.tile([0.0, 0.0, G], (301, 1)))
    turned = Rotation.from_rotvec(3.0 * rate).as_matrix()
    assert found[0].T @ found[-1] == pytest.approx(turned, abs=1e-12)
