"""What a rig with errors applies, held against the profile of a rig that is built that way; latency."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from imubayes.rig.bench import KINDS, bench_of, delayed, errors_of, true_inputs
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import EARTH_RATE, Plan
from imubayes.rig.rotations import centrifuge, rate_table, vibration
from imubayes.rig.tumbles import static, tumble

SHORT = {"dwell": 2.0, "rate": 2.0}
RAMPED = centrifuge([1, 5, 20], ramp=True, settle=4.0, **SHORT)
TABLE = rate_table([-2.0, 0.0, 3.0], mounts=9, radius=0.2, latitude=None, **SHORT)
SHAKER = vibration([0.0, 2.0, 20.0], dwell=0.5)
PLANS = {
    "tumble": tumble(angles=24, **SHORT),
    "tumble on the Earth": tumble(angles=24, latitude=0.8, **SHORT),
    "centrifuge": RAMPED,
    "rate-table": TABLE,
    "vibration": SHAKER,
}
ROUNDING = 1e-11
"""Of components of some 200 m/s^2."""


def same(found: Inputs, plan: Plan) -> None:
    """Check that the inputs are those of a plan; an absent channel is zero."""
    zero = np.zeros(len(found))
    for name in found.channels.keys() | plan.inputs.channels.keys():
        np.testing.assert_allclose(
            found.channels.get(name, zero), plan.inputs.channels.get(name, zero), atol=ROUNDING, err_msg=name
        )


@pytest.mark.parametrize("mounts", [[0], [0, 1, 2]])
def test_a_table_that_turns_the_other_way_has_its_zero_the_other_way(mounts):
    plan = tumble(angles=24, planes=len(mounts), **SHORT)
    channels = {name: values[::-1].copy() for name, values in plan.inputs.channels.items()}
    back = replace(plan, inputs=replace(plan.inputs, channels=channels, mount=plan.inputs.mount[::-1].copy()))
    forth, other = (true_inputs(p, {"table_zero": 0.2}).vectors("f") for p in (plan, back))
    reversed_sense = true_inputs(plan, {"table_zero": -0.2}).vectors("f")
    np.testing.assert_allclose(other[::-1], reversed_sense, atol=ROUNDING)
    assert not np.allclose(forth, reversed_sense)


@pytest.mark.parametrize(
    ("plan", "errors", "built"),
    [
        (tumble(**SHORT), {"gravity": 0.02}, tumble(gravity=9.82665, **SHORT)),
        (static(9.0, 1.0, up=(1, 2, 3)), {"gravity": 0.02}, static(9.0, 1.0, up=(1, 2, 3), gravity=9.82665)),
        (RAMPED, {"radius": 0.01}, centrifuge([1.01, 5.05, 20.2], arm=1.01, ramp=True, settle=4.0, **SHORT)),
        (
            RAMPED,
            {"rate_scale.centrifuge": 0.1},
            centrifuge(np.array([1, 5, 20]) * 1.1**2, ramp=True, settle=4.0, **SHORT),
        ),
        (
            TABLE,
            {"rate_scale.rate-table": 0.1},
            rate_table(np.array([-2.2, 0.0, 3.3]), mounts=9, radius=0.2, latitude=None, **SHORT),
        ),
    ],
    ids=["gravity-tumble", "gravity-static", "radius", "rate-centrifuge", "rate-table"],
)
def test_an_error_makes_the_rig_that_is_built_that_way(plan, errors, built):
    same(true_inputs(plan, errors), built)


@pytest.mark.parametrize("size", [0.1, 2.0, 40.0])
def test_gravity_acts_upwards_however_hard_a_case_is_shaken_across(size):
    t = np.arange(400.0) / 400.0
    shaken = {"f_i": size * 9.80665 * np.sin(20.0 * np.pi * t), "f_k": np.full(400, 9.80665)}
    moved = true_inputs(Plan("shaker", "other", Inputs(t, shaken, 1 / 400)), {"gravity": 0.02}).vectors("f")
    np.testing.assert_allclose(moved, np.stack([shaken["f_i"], 0.0 * t, shaken["f_k"] + 0.02], axis=1),
                               atol=ROUNDING)  # fmt: skip


def test_gravity_acts_along_the_vertical_of_each_mount_of_a_shaker():
    at_rest = vibration([0.0], dwell=0.5).inputs.vectors("f")[::500]
    np.testing.assert_allclose(np.linalg.norm(at_rest, axis=1), 9.80665, rtol=1e-15)
    moved = true_inputs(SHAKER, {"gravity": 0.02}).vectors("f") - SHAKER.inputs.vectors("f")
    np.testing.assert_allclose(moved, 0.02 * at_rest[SHAKER.inputs.mount] / 9.80665, atol=ROUNDING)


def test_gravity_follows_the_momentary_force_where_the_mean_one_is_not_one_g():
    t = np.arange(200.0)
    swung = 9.80665 * (1.0 + 0.1 * np.sin(t))
    channels = {"f_i": swung * np.cos(0.1 * t), "f_j": swung * np.sin(0.1 * t)}
    moved = true_inputs(Plan("carried", "other", Inputs(t, channels, 1.0)), {"gravity": 0.02})
    np.testing.assert_allclose(
        np.hypot(moved.channels["f_i"], moved.channels["f_j"]), swung + 0.02, rtol=1e-13
    )


def test_gravity_across_the_axis_is_left_alone_rather_than_given_a_direction_by_rounding():
    channels = {"f_j": np.array([9.8, 10.8]), "f_k": np.full(2, 1e-15), "w_k": np.ones(2)}
    across = Inputs(np.arange(2.0), channels, 1.0)
    moved = true_inputs(Plan("swing", "oscillation", across), {"gravity": 1.0})
    np.testing.assert_array_equal(moved.vectors("f"), across.vectors("f"))


def test_the_zero_of_a_table_turns_the_earths_rate_with_gravity():
    plan, latitude, zero = tumble(angles=24, planes=1, latitude=0.8, **SHORT), 0.8, 0.3
    moved = true_inputs(plan, {"plane_zero.tumble.0": zero})
    angle = np.repeat(2.0 * np.pi * np.arange(24) / 24, 4) + zero
    up = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    np.testing.assert_allclose(moved.vectors("f"), 9.80665 * up, atol=ROUNDING)
    w = EARTH_RATE * (np.sin(latitude) * up + np.cos(latitude) * np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(moved.vectors("w"), w, atol=1e-14 * EARTH_RATE)


@pytest.mark.parametrize("plan", PLANS.values(), ids=PLANS)
def test_a_fixture_turns_all_vectors_of_its_mount_and_of_no_other(plan):
    rho, there = np.array([0.1, -0.2, 0.3]), plan.inputs.mount == 1
    moved = true_inputs(plan, {f"fixture_{a}.{plan.name}.1": r for a, r in zip("ijk", rho, strict=True)})
    for quantity in ("f", "w"):
        v, seen = plan.inputs.vectors(quantity), moved.vectors(quantity)
        expected = Rotation.from_rotvec(-rho).apply(v[there])
        np.testing.assert_allclose(seen[there], expected, atol=1e-14 * np.abs(v).max())
        np.testing.assert_array_equal(seen[~there], v[~there])


def test_an_arm_is_longer_by_its_level():
    plan, stretch = centrifuge([1, 5, 20], mounts=1, **SHORT), 1e-6
    f = true_inputs(plan, {"arm_stretch": stretch}).vectors("f")
    level = np.repeat(np.array([1, 5, 20]) * 9.80665, 4)
    np.testing.assert_allclose(f[:, 0], -level * (1.0 + stretch * level), rtol=1e-14)
    np.testing.assert_allclose(f[:, 1], 9.80665, rtol=1e-14)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_a_part_of_the_rows_is_what_the_whole_has_there(seed):
    rng = np.random.default_rng(seed)
    plan = [*PLANS.values()][int(rng.integers(len(PLANS)))]
    kinds = [name for name, kind in KINDS.items() if plan.procedure in kind.procedures]
    errors = errors_of([plan], kinds)
    bench = bench_of(plan, kinds)
    sizes = bench.sizes(errors, 1e-3 * rng.normal(size=len(errors)))
    start = int(rng.integers(0, len(plan.inputs) - 1))
    stop = int(rng.integers(start + 1, len(plan.inputs) + 1))
    whole, part = bench.channels(sizes), bench.channels(sizes, start, stop)
    for name, values in whole.items():
        np.testing.assert_allclose(part[name], values[start:stop], atol=ROUNDING, err_msg=name)


def test_errors_of_other_runs_are_passed_over():
    plan = PLANS["tumble"]
    found = true_inputs(plan, {"radius": 1.0, "fixture_i.elsewhere.0": 1.0, "plane_zero.tumble.9": 1.0})
    same(found, plan)


def sampled(function, t, interval):
    return Inputs(t, {"w_i": function(t), "f_j": 0.0 * t + 9.8}, interval)


@given(st.floats(-3.0, 3.0), st.integers(0, 2**32 - 1))
def test_a_line_is_shifted_exactly_between_samples_and_beyond_the_ends(latency, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.8, 1.2, 12))
    inputs = sampled(lambda t: 3.0 - 2.0 * t, t, 1.0)
    moved = delayed(inputs, latency, 0, 12)
    np.testing.assert_allclose(moved["w_i"], 3.0 - 2.0 * (t - latency), atol=1e-12)
    np.testing.assert_allclose(moved["f_j"], 9.8, rtol=1e-14)


def test_error_on_a_curve_falls_with_the_fourth_power_of_the_step():
    errors = []
    for n in (100, 200):
        t = np.linspace(0.0, 10.0, n + 1)
        moved = delayed(sampled(np.sin, t, 10.0 / n), 0.37 * 10.0 / n, 0, n + 1)["w_i"]
        errors.append(np.abs(moved - np.sin(t - 0.37 * 10.0 / n))[3:-3].max())
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)


def test_a_small_latency_of_a_sine_of_fifty_samples_is_right_to_a_ten_thousandth():
    """Plain central slopes are off by (omega h)^2 / 6, 0.26 %."""
    h, omega, latency = 0.01, 2.0 * np.pi * 2.0, 1e-3
    t = h * np.arange(500)
    moved = delayed(sampled(lambda t: np.sin(omega * t), t, h), latency, 0, 500)["w_i"]
    both = moved, np.sin(omega * (t - latency))
    found, true = (values[3:-3] - np.sin(omega * t)[3:-3] for values in both)
    assert np.linalg.norm(found - true) < 1e-4 * np.linalg.norm(true)


@given(st.floats(-2.5, 2.5), st.integers(0, 2**32 - 1))
def test_a_latency_in_a_part_of_the_rows_is_what_the_whole_has_there(latency, seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(1.0 + 4.0 * (rng.random(30) < 0.2))
    inputs = Inputs(t, {"w_i": rng.normal(size=30)}, 1.0)
    start = int(rng.integers(0, 29))
    stop = int(rng.integers(start + 1, 31))
    whole, part = delayed(inputs, latency, 0, 30)["w_i"], delayed(inputs, latency, start, stop)["w_i"]
    np.testing.assert_allclose(part, whole[start:stop], atol=1e-13)


def test_nothing_comes_across_a_gap():
    t = np.concatenate([np.arange(5.0), 100.0 + np.arange(5.0), [300.0]])
    u = np.concatenate([np.zeros(5), np.ones(5), [7.0]])
    moved = delayed(Inputs(t, {"w_i": u}, 1.0), 0.9, 0, 11)["w_i"]
    np.testing.assert_array_equal(moved, u)


def test_a_jump_moves_by_the_latency_as_sample_averages_do():
    """The sum over the samples, which is the integral of the input, shifts by jump times latency."""
    u = np.repeat([0.0, 5.0], 10)
    moved = delayed(Inputs(np.arange(20.0), {"w_i": u}, 1.0), 0.125, 0, 20)["w_i"]
    assert np.sum(u - moved) == pytest.approx(5.0 * 0.125, rel=1e-12)
