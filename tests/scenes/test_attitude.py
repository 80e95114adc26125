"""Attitude of a log: by angles, a quaternion or the rate, with the level frame up whatever the log's axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.errors import DataError
from imubayes.scenes import at_rest, followed, levelled, read_scene

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
    path = tmp_path / "log.csv"
    rows = "\n".join(",".join(f"{v:.17g}" for v in row) for row in np.column_stack(list(given.values())))
    path.write_text(",".join(given) + "\n" + rows + "\n")
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


def test_part_of_an_attitude_is_refused(tmp_path) -> None:
    with pytest.raises(DataError, match="column roll alone is no attitude: expected roll, pitch and yaw"):
        written(tmp_path, down=False, columns=("roll",))


def test_quaternion_of_zeros_is_refused_with_its_time(tmp_path) -> None:
    path = tmp_path / "log.csv"
    rows = ("7,1,1,0,0,0", "8,1,0,0,0,0", "9,1,1,0,0,0")
    path.write_text("\n".join(("t [s],f_k [g],q_w,q_x,q_y,q_z", *rows)))
    with pytest.raises(DataError, match=r"log\.csv: q_w, .* are all zero 1 s from its start.*\(ignore\)"):
        read_scene(path)
    assert read_scene(path, ignore=("q_w", "q_x", "q_y", "q_z")).attitude is not None


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
