"""What the inputs of runs have in common."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


@given(st.integers(0, 2**32 - 1))
def test_order_of_runs_and_rotation_about_the_input_axis_change_no_fact(seed):
    rng = np.random.default_rng(seed)
    plans = [tumble(angles=6, rate=0.1), centrifuge([2, 4], rate=0.1), static(30.0, 0.1)]
    chosen = [plans[k] for k in rng.permutation(3)[: rng.integers(1, 4)]]
    angle = rng.uniform(0.0, 2.0 * np.pi)
    turned = []
    for plan in chosen:
        zero = np.zeros(len(plan.inputs))
        f_j, f_k = (plan.inputs.channels.get(name, zero) for name in ("f_j", "f_k"))
        turned.append(
            {
                **plan.inputs.channels,
                "f_j": np.cos(angle) * f_j - np.sin(angle) * f_k,
                "f_k": np.sin(angle) * f_j + np.cos(angle) * f_k,
            }
        )
    plain = facts("accelerometer", *chosen)
    plain = replace(plain, force=pytest.approx(plain.force, rel=1e-14))
    assert facts("accelerometer", *reversed(chosen)) == plain
    assert facts_of(turned, "accelerometer") == plain


def test_a_case_at_rest_has_the_earths_rate_in_every_position_and_a_log_the_same_inputs_in_every_row():
    found = facts("gyroscope", positions(24, rate=0.1, latitude=0.4))
    assert found.rate == pytest.approx(EARTH_RATE, rel=1e-12) and not found.still
    assert facts("gyroscope", static(60.0, 1.0, latitude=0.4)).still
    assert facts("gyroscope", rate_table(RATES, rate=1.0)).rate == 0.0


def test_a_run_without_the_own_input_takes_no_side():
    assert not facts_of([{"f_j": np.array([9.8, 9.8])}], "accelerometer").one_sided
