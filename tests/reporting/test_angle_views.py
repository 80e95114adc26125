"""Angles of a case as they are printed, and the errors of the bench that a component lists."""

from types import SimpleNamespace

import pytest

from imubayes.reporting.angle_views import angle_table
from imubayes.reporting.chain_views import own_errors

RELATIVE = "gyroscopes against accelerometers"


def component(misalignment, angles):
    terms = [SimpleNamespace(name="m_j", full_sd=misalignment), SimpleNamespace(name="b0", full_sd=9.0)]
    selection = SimpleNamespace(terms=terms)
    return SimpleNamespace(kind="accelerometer", selection=selection, calibration={"angles": angles})


def angle(name, of, mean, sd):
    return {"name": name, "of": of, "mean": mean, "sd": sd}


ANGLES = [
    angle("rotation_x", "accelerometer", 1.234e-4, 1.6e-4),
    angle("nonorthogonality_xy", "accelerometer", -4.7895e-4, 1.61e-5),
    angle("rotation_x", RELATIVE, 1e-6, 2e-6),
]


def test_angles_are_rounded_by_their_own_sd_and_stand_where_they_belong():
    table = angle_table([component(1.65e-4, ANGLES)])
    assert table is not None
    assert table.heads == ("accelerometers", "gyroscopes less accelerometers")
    (rotation, (own, against)), (between, (angle_cell, nothing)) = table.rows
    assert (rotation, between) == ("rotation about x", "non-orthogonality of x and y")
    assert [str(own), str(angle_cell)] == ["120 +- 160 urad", "-479 +- 16 urad"]
    assert str(against) == "1.0 +- 2.0 urad"
    assert nothing is None


@pytest.mark.parametrize(
    ("misalignment", "said"),
    [
        (1.65e-4, "how the case as a whole lay in its fixture is known no better"),
        (1.1e-5, "is known about as well"),
    ],
)
def test_the_sentence_says_whether_a_rotation_is_hidden(misalignment, said):
    table = angle_table([component(misalignment, ANGLES)])
    assert table is not None
    (sentence,) = table.sentences
    assert said in sentence
    assert "are known to 16 urad" in sentence


def test_without_known_directions_there_is_no_table():
    assert angle_table([SimpleNamespace(calibration={"scale": 1.0})]) is None
    assert angle_table([SimpleNamespace(calibration=None)]) is None


@pytest.mark.parametrize(("id", "listed"), [("imu.ay", ["gravity", "tilt_j.ay"]), ("alone", None)])
def test_a_component_lists_the_bench_and_its_own_errors(id, listed):
    names = ["gravity", "tilt_j.ax", "tilt_j.ay", "turn_on.log.gz"]
    extras = [SimpleNamespace(extra=SimpleNamespace(name=name)) for name in names]
    found = own_errors(SimpleNamespace(id=id, extras=extras))
    assert [entry.extra.name for entry in found] == (listed or names)
