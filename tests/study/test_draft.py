"""Studies that are begun from a recording."""

import re
import tomllib

import numpy as np
import pytest
from run_files import csv_of

RATE = 50.0


def _hand(turns: int = 12) -> np.ndarray:
    """Time and six components of a case that is held still in some directions, in g and deg/s."""
    rng = np.random.default_rng(3)
    still, turn = int(4 * RATE), int(1 * RATE)
    ups, rows = rng.standard_normal((turns, 3)), []
    ups /= np.linalg.norm(ups, axis=1)[:, None]
    for here, there in zip(ups, [*ups[1:], ups[0]], strict=True):
        angle, way = np.arccos(here @ there), np.linspace(0.0, 1.0, turn)[:, None]
        between = (np.sin((1.0 - way) * angle) * here + np.sin(way * angle) * there) / np.sin(angle)
        axis = np.cross(there, here) / np.sin(angle)
        rate = np.repeat(np.rad2deg(angle) * axis[None], turn, axis=0)  # up turns against the case
        rows += [np.c_[np.repeat(here[None], still, 0), np.zeros((still, 3))], np.c_[between, rate]]
    values = np.concatenate(rows)
    values += rng.standard_normal(values.shape) * [2e-3, 2e-3, 2e-3, 0.05, 0.05, 0.05]
    return np.c_[np.arange(len(values)) / RATE, values]


def _begun(command, path) -> dict:
    assert command("init", path, "--force").code == 0
    return tomllib.loads(path.with_suffix(".toml").read_text(encoding="utf-8"))


def test_a_recording_with_units_becomes_a_study_that_is_checked_at_once(command, study, tmp_path):
    assert command("simulate", study, "--out", tmp_path / "lab").code == 0
    begun = command("init", tmp_path / "lab" / "tumble.csv", "--out", tmp_path / "mine.toml")
    assert begun.code == 0 and 'file = "lab/tumble.csv"' in begun.out
    (sensor,) = tomllib.loads((tmp_path / "mine.toml").read_text())["sensor"]
    assert (sensor["kind"], sensor["run"][0]["procedure"]) == ("accelerometer", "tumble")
    checked = command("check", tmp_path / "mine.toml")
    assert checked.code == 0 and "K1" in checked.out


@pytest.mark.parametrize(
    ("header", "sizes", "units"),
    [
        ("timestamp,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z", (1.0, 1.0, 1.0), ("s", "g", "deg/s")),
        (
            "time_ms,imu.accel.x,imu.accel.y,imu.accel.z,wX,wY,wZ",
            (1e3, 9.81, np.pi / 180),
            ("ms", "m/s^2", "rad/s"),
        ),
        (
            "Time (s),AccX [mg],AccY [mg],AccZ [mg],GyroX [dps],GyroY [dps],GyroZ [dps]",
            (1, 1e3, 1),
            ("s", "mg", "dps"),
        ),
    ],
)
def test_channels_and_units_are_guessed_from_names_and_numbers(command, tmp_path, header, sizes, units):
    path = csv_of(tmp_path, header, _hand() * np.repeat(sizes, (1, 3, 3)), "hand.csv")
    (sensor,) = _begun(command, path)["sensor"]
    columns, names = sensor["run"][0]["columns"], header.split(",")
    assert [columns[c]["column"] for c in ("t", "ax", "ay", "az", "gx", "gy", "gz")] == names
    assert (columns["t"]["unit"], columns["ay"]["unit"], columns["gz"]["unit"]) == units
    assert (sensor["kind"], sensor["run"][0]["procedure"]) == ("imu", "free-tumble")
    text = path.with_suffix(".toml").read_text()
    assert "in 12 stills" in text
    path.with_suffix(".toml").write_text(text.replace('class = "?"', 'class = "mems_consumer"'))
    assert command("check", path.with_suffix(".toml")).code == 0


def test_what_is_asked_for_is_listed_until_it_is_filled_in(command, tmp_path):
    path = csv_of(tmp_path, "n_samples,acc_x,acc_y,acc_z", np.round(_hand()[:, :4] * 1e4), "counts.csv")
    assert command("init", path).code == 0
    checked = command("check", tmp_path / "counts.toml")
    asked = "sensor[0].class, sensor[0].run[0].columns.t.rate, " + ", ".join(
        f"sensor[0].run[0].columns.{c}.scale" for c in ("ax", "ay", "az")
    )
    assert checked.code == 2 and f'still to be filled in, in place of "?": {asked}' in checked.err


def test_a_clock_whose_steps_suit_two_units_is_asked_for(command, tmp_path):
    t = 500 * np.arange(400)
    path = csv_of(tmp_path, "timestamp,acc_z [g]", np.c_[t, 1.0 + 1e-3 * np.sin(t)], "log.csv")
    (sensor,) = _begun(command, path)["sensor"]
    assert sensor["run"][0]["columns"]["t"]["unit"] == "?"
    assert sensor["run"][0]["columns"]["output"]["offset"] == "1 g"
    assert "2 Hz in ms, 2,000 Hz in us" in path.with_suffix(".toml").read_text()


def test_a_file_that_is_there_is_not_written_over(command, tmp_path):
    path = csv_of(tmp_path, "t,acc_x,acc_y,acc_z", _hand()[:, :4], "hand.csv")
    before = path.read_bytes()
    assert command("init", path, "--out", path, "--force").code == 2
    assert command("init", path).code == 0
    assert command("init", path).code == 2
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("file", "kinds", "asked"),
    [
        ("xio_fusion/sensor_data.csv", ["imu"], {"class"}),
        ("broad/21_undisturbed_fast_combined.mat", ["imu"], {"class", "rate"}),
        ("imucal_ferraris/example_ferraris_session.csv", ["imu"], {"class", "rate"}),
        ("imu_tk_xsens/xsens_acc.mat", ["accelerometer"], {"class", "scale"}),
        ("imu_tk_xsens/xsens_gyro.mat", ["gyroscope"], {"class", "scale", "sections"}),
        ("tofupilot_thermal/imu_raw_data.csv", ["accelerometer"] * 3 + ["gyroscope"] * 3, {"unit"}),
        ("mimu4444/exp_1.npz", [], set()),
        ("inertialnav/TestLog2.mat", [], set()),
    ],
)
def test_public_recordings(command, recordings, tmp_path, file, kinds, asked):
    """What a person would have to say of them, and no more."""
    ended = command("init", recordings / file, "--out", tmp_path / "a.toml")
    if not kinds:
        assert ended.code == 2 and "no column is known by its name" in ended.err
        return
    assert [one["kind"] for one in tomllib.loads((tmp_path / "a.toml").read_text())["sensor"]] == kinds
    checked = command("check", tmp_path / "a.toml")
    assert checked.code == 2
    assert set(re.findall(r"\.(\w+)(?:,|$)", checked.err, re.M)) == asked
