"""What the rig applies, held against mechanics, and what each procedure can separate."""

import numpy as np
import pytest

from imubayes.rig.plans import Plan
from imubayes.rig.rotations import centrifuge, oscillation, rate_table, vibration
from imubayes.rig.tumbles import free_tumble, positions, static, tumble
from imubayes.sensors.terms import Library, columns, library

G = 9.80665
SHORT = {"dwell": 1.0, "rate": 1.0}
"""One sample a dwell."""


def _rank(lib: Library, *plans: Plan, without: tuple[str, ...] = ()) -> int:
    """Rank of the stacked, column-scaled design; a column that was not excited does not count."""
    X = np.vstack([columns(lib, plan.inputs.channels, len(plan.inputs)) for plan in plans])
    X = X[:, [name[0] not in without for name in lib.names]]
    size = np.linalg.norm(X, axis=0)
    values = np.linalg.svd(X[:, size > 0.0] / size[size > 0.0], compute_uv=False)
    return int(np.sum(values > 1e-8 * values[0]))


EVERY_PLAN = [
    static(20.0, 10.0, up=(1.0, 2.0, -2.0)),
    tumble(angles=5, planes=2),
    tumble(angles=24, settle=0.0),
    static(20.0, 10.0, up=(1.0, 2.0, -2.0), latitude=-0.5),
    free_tumble(attitudes=18, dwell=1.3, settle=0.9, rate=40.0),
    *(positions(number, latitude=0.5) for number in (4, 6, 12, 24, 26)),
    oscillation([0.5, 5.0], radius=0.1),
    oscillation([2.0, 4.0], mounts=3, dwell=0.7, settle=0.0),
    vibration([0.0, 3.0], dwell=2.0),
    vibration([1.0], mounts=2, dwell=0.7, settle=0.0, rate=400.0),
    rate_table([-1.0, 0.0, 2.0], mounts=9, dwell=0.25),
    centrifuge([0.5, 1, 5], mounts=12),
    centrifuge([1, 20], mounts=12, ramp=True),
    centrifuge([1, 20], mounts=3, ramp=True, dwell=0.7, settle=0.3, rate=4.0),
]
every_plan = pytest.mark.parametrize("plan", EVERY_PLAN, ids=lambda plan: f"{plan.name}-{len(plan.inputs)}")


@every_plan
def test_time_runs_forward_by_a_sample_or_more(plan):
    assert np.diff(plan.inputs.t).min() > plan.inputs.interval * (1.0 - 1e-9)


def test_a_tumble_numbers_its_planes_and_a_log_is_one_mounting():
    plan = tumble(angles=8, planes=3, **SHORT)
    f = plan.inputs.vectors("f")
    for mount, normal in enumerate(([0, 0, 1], [0, 1, 0], [1, 0, 0])):
        rows = f[plan.inputs.mount == mount]
        assert len(rows) == 8
        assert not (rows @ normal).any()
    assert static(9.0, 1.0).inputs.mount is None


@pytest.mark.parametrize(
    "plan", [rate_table([-1.0, 2.0], mounts=9, latitude=None), centrifuge([1, 20], mounts=12, ramp=True)]
)
def test_in_one_mount_the_axis_stands_still_in_the_case_and_no_two_mounts_are_alike(plan):
    w, mount = plan.inputs.vectors("w"), plan.inputs.mount
    assert mount.tolist() == sorted(mount)
    for number in np.unique(mount):
        rows = w[mount == number]
        assert np.linalg.matrix_rank(rows, tol=1e-12 * np.abs(rows).max()) == 1
    first = [int(np.argmax(mount == number)) for number in np.unique(mount)]
    last = np.append(first[1:], len(mount)) - 1
    states = np.hstack([plan.inputs.vectors("f"), w])[last]
    assert len(np.unique(states.round(9), axis=0)) == len(first)


@every_plan
def test_nominally_zero_component_is_exactly_zero(plan):
    for name, values in plan.inputs.channels.items():
        assert np.min(np.abs(values), where=values != 0.0, initial=np.inf) > 1e-11, name


def test_dwells_are_apart_by_the_settling_time():
    inputs = tumble(angles=3, planes=1, dwell=2.0, rate=10.0, settle=7.0).inputs
    assert len(inputs) == 60
    np.testing.assert_allclose(inputs.t[[0, 19, 20, 40]], [0.0, 1.9, 9.0, 18.0], rtol=1e-15)
    assert inputs.interval == 0.1


def test_rank_of_tumbles_is_what_trigonometry_allows():
    # 15 terms of f: b0..b3, b0p..b3p, m_j, m_k and five of C; S and s need rotation
    lib = library("accelerometer", powers=3, asymmetry=3)
    assert len([name for name in lib.names if name[0] not in "Ss"]) == 15
    ranks = [
        _rank(lib, tumble(angles=angles, planes=planes, **SHORT), without=("S", "s"))
        for angles, planes in ((4, 1), (12, 1), (24, 2), (24, 3))
    ]
    assert ranks == [4, 9, 13, 14]


def test_centrifuge_level_is_the_specific_force_along_the_arm():
    plan = centrifuge([0.5, 1, 20], arm=2.5, **SHORT)
    f, w = plan.inputs.vectors("f") / G, plan.inputs.vectors("w")
    up = w / np.linalg.norm(w, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sum(f * up, axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(np.cross(f, up), axis=1), np.tile([0.5, 1, 20], 12), rtol=1e-13)
    np.testing.assert_allclose(
        np.linalg.norm(w, axis=1) ** 2 * 2.5 / G, np.tile([0.5, 1, 20], 12), rtol=1e-13
    )


@pytest.mark.parametrize(
    ("plan", "radius"),
    [
        (centrifuge([1, 5], arm=0.8, ramp=True, dwell=2.0, settle=2.0), 0.8),
        (oscillation([0.5, 2.0], amplitude=1.0, dwell=4.0, rate=200.0, radius=0.07, latitude=None), 0.07),
    ],
    ids=["centrifuge", "oscillation"],
)
def test_force_off_the_axis_is_gravity_and_the_acceleration_of_a_point_of_a_rigid_body(plan, radius):
    f, w, dw = (plan.inputs.vectors(quantity) for quantity in ("f", "w", "dw"))
    for mount in np.unique(plan.inputs.mount):
        here = np.flatnonzero(plan.inputs.mount == mount)
        steady = here[np.argmin(dw[here].any(axis=1))]
        up = w[steady] / np.linalg.norm(w[steady])
        r = -(f[steady] - G * up) / (w[steady] @ w[steady])
        assert np.linalg.norm(r) == pytest.approx(radius, rel=1e-12)
        expected = G * up + np.cross(dw[here], r) + np.cross(w[here], np.cross(w[here], r))
        np.testing.assert_allclose(f[here], expected, atol=1e-12 * np.abs(f).max())


def test_ramp_is_the_integral_of_its_angular_acceleration_from_rest_to_rest():
    plan = centrifuge([1, 5], mounts=1, ramp=True, dwell=2.0, settle=2.0, rate=10.0)
    t, w, dw = plan.inputs.t, plan.inputs.channels["w_j"], plan.inputs.channels["dw_j"]
    assert w[0] == 0.0
    np.testing.assert_allclose(np.diff(w), dw[:-1] * np.diff(t), atol=1e-12)
    # the last ramp ends one sample after the last row
    assert w[-1] + dw[-1] * plan.inputs.interval == pytest.approx(0.0, abs=1e-12)
