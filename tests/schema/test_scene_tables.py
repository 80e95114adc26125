"""Scenes of a study, and its own catalogue."""

import numpy as np
import pytest
from small_studies import RUN, SENSOR, study_of

from imubayes.scenes.trajectories import MANNERS

G = 9.80665
BESIDE = SENSOR + RUN
GYROSCOPE = BESIDE.replace("accelerometer", "gyroscope").replace('"A"', '"G"')
SCENE = '[[scene]]\nname = "quadrotor"\nbudget = { position = "100 m" }\n'
LOG = "t [s],up [mg],w_i [deg/s]\n0,1000,0\n1,1000,90\n2,1000,180\n"


def _scenes(folder, text, head=""):
    return study_of(folder, head + BESIDE + text).scenes


def test_scene_of_the_catalogue_has_the_defaults_of_the_design(tmp_path):
    (found,) = _scenes(tmp_path, SCENE)
    assert (found.name, found.axis, found.kind) == ("quadrotor", "x", None)
    assert (found.budget.quantity, found.budget.limit, found.budget.schuler) == ("position", 100.0, True)
    assert found.scene.duration > 0.0 and len(found.scene.inputs) > 1000
    (short,) = _scenes(tmp_path, SCENE + 'duration = "2 min"\naxis = "z"\n')
    assert (short.scene.duration, short.axis) == (120.0, "z")


def test_trajectory_depends_on_the_seed_and_its_own_name_only(tmp_path):
    (alone,) = _scenes(tmp_path, SCENE)
    *_, last = _scenes(tmp_path, SCENE.replace("quadrotor", "marine") + SCENE)
    (other,) = _scenes(tmp_path, SCENE, "[study]\nseed = 2\n")
    w = [one.scene.inputs.channels["w_i"] for one in (alone, last, other)]
    assert np.array_equal(w[0], w[1]) and not np.array_equal(w[0], w[2][: len(w[0])])


def test_scene_of_the_catalogue_is_drawn_three_times_or_as_the_study_says_and_a_log_once(tmp_path):
    (usual,) = _scenes(tmp_path, SCENE)
    (once,) = _scenes(tmp_path, SCENE + "draws = 1\n")
    assert (len(usual.scene.draws), len(once.scene.draws)) == (3, 1)
    w = [one.inputs.channels["w_i"] for one in (once.scene, *usual.scene.draws)]
    assert np.array_equal(w[0], w[1]) and not np.array_equal(w[1][:99], w[2][:99])
    (tmp_path / "flight.csv").write_text(LOG)
    text = '[[scene]]\nfile = "flight.csv"\nbudget = { attitude = "1 deg" }\n'
    assert len(_scenes(tmp_path, text)[0].scene.draws) == 1


def test_log_is_read_through_its_columns_in_si(tmp_path):
    (tmp_path / "flight.csv").write_text(LOG)
    text = (
        '[[scene]]\nfile = "flight.csv"\nbudget = { velocity = "2 km/h" }\n[scene.columns]\nf_k = "up [mg]"\n'
    )
    (found,) = _scenes(tmp_path, text)
    assert (found.name, found.scene.duration, found.budget.quantity) == ("flight", 3.0, "velocity")
    assert found.budget.limit == pytest.approx(2.0 / 3.6, rel=1e-14)
    channels = found.scene.inputs.channels
    assert channels["f_k"] == pytest.approx(np.full(3, G), rel=1e-14)
    assert channels["w_i"] == pytest.approx([0.0, np.pi / 2, np.pi], rel=1e-14)


def test_budget_of_the_output_is_for_the_kind_that_its_unit_is_of(tmp_path):
    rates = SCENE.replace('position = "100 m"', 'output = "1 deg/h"')
    forces = SCENE.replace('position = "100 m"', 'output = "1 mg"')
    found = _scenes(tmp_path, GYROSCOPE + rates + forces)
    assert [one.kind for one in found] == ["gyroscope", "accelerometer"]
    assert found[0].budget.limit == pytest.approx(np.radians(1.0) / 3600.0, rel=1e-14)


@pytest.mark.parametrize("name", MANNERS)
def test_free_flight_is_that_of_scenes_without_weight_unless_the_study_says_so(name, tmp_path):
    text = SCENE.replace("quadrotor", name.replace("_", "-")) + 'duration = "30 s"\n'
    (found,) = _scenes(tmp_path, text)
    assert found.budget.schuler == (name not in ("gun_projectile", "reentry_spin", "spacecraft"))
    (said,) = _scenes(tmp_path, f"{text}free_flight = {str(found.budget.schuler).lower()}\n")
    assert said.budget.schuler != found.budget.schuler
