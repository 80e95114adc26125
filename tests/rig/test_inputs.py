"""What the inputs of runs have in common."""

import numpy as np
import pytest

from imubayes.rig.inputs import facts_of
from imubayes.rig.plans import EARTH_RATE
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.tumbles import positions, static, tumble

RATES = [-1.0, -0.3, 0.3, 1.0]


def facts(kind, *plans):
    return facts_of([plan.inputs.channels for plan in plans], kind)


@pytest.mark.parametrize(
    ("kind", "plans", "constant", "one_sided"),
    [
        ("accelerometer", [tumble(angles=24, rate=1.0)], True, False),
        ("accelerometer", [static(60.0, 1.0)], True, True),
        ("accelerometer", [static(60.0, 1.0), static(60.0, 1.0, up=(-1.0, 0.0, 0.0))], True, False),
        ("accelerometer", [centrifuge([1, 5], mounts=1, rate=1.0)], False, True),
        ("accelerometer", [centrifuge([1, 5], rate=1.0)], False, False),
        ("accelerometer", [tumble(angles=24, rate=1.0), centrifuge([5], rate=1.0)], False, False),
        ("accelerometer", [static(60.0, 1.0), static(60.0, 1.0, gravity=9.7803)], False, True),
        ("gyroscope", [rate_table(RATES, rate=1.0)], True, False),
        ("gyroscope", [rate_table(RATES[2:], mounts=1, rate=1.0)], True, True),
        ("gyroscope", [rate_table([0.0], rate=1.0, latitude=None)], True, False),
    ],
)
def test_facts_are_those_of_the_procedure(kind, plans, constant, one_sided):
    found = facts(kind, *plans)
    assert (found.force > 0.0, found.one_sided) == (constant, one_sided)
    assert found.kind == kind and not found.reference_free


def test_a_case_at_rest_has_the_earths_rate_in_every_position_and_a_log_the_same_inputs_in_every_row():
    found = facts("gyroscope", positions(24, rate=0.1, latitude=0.4))
    assert found.rate == pytest.approx(EARTH_RATE, rel=1e-12) and not found.still
    assert facts("gyroscope", static(60.0, 1.0, latitude=0.4)).still
    assert facts("gyroscope", rate_table(RATES, rate=1.0)).rate == 0.0


def test_a_run_without_the_own_input_takes_no_side():
    assert not facts_of([{"f_j": np.array([9.8, 9.8])}], "accelerometer").one_sided
