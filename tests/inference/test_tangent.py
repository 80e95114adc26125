"""Linearised rows, held against the simulated output of a rig that has the errors."""

import numpy as np
import pytest
from benches import QUIET, measured, nominal

import imubayes as ib
from imubayes.inference import nuisances as module
from imubayes.inference.linear import linear_of
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import Plan
from imubayes.rig.reference import KINDS
from imubayes.sensors.catalogue import draw_unit

SHORT = {"dwell": 1.0, "rate": 2.0}
T = np.arange(400) / 20.0
SWING = Plan(
    "swing",
    "oscillation",
    Inputs(
        T,
        {
            "w_i": 2.0 * np.sin(3.0 * T),
            "dw_i": 6.0 * np.cos(3.0 * T),
            "f_i": np.full(400, 9.8),
            "f_j": -0.4 * np.sin(3.0 * T) ** 2,
            "f_k": 0.6 * np.cos(3.0 * T),
        },
        0.05,
    ),
)
PLANS = {
    "accelerometer": (
        ib.tumble(angles=24, **SHORT),
        ib.centrifuge([1, 5, 20], ramp=True, settle=2.0, **SHORT),
    ),
    "gyroscope": (ib.rate_table([-3.0, -1.0, 2.0], radius=0.1, **SHORT), SWING),
}
CLASS = {"accelerometer": "mems_industrial", "gyroscope": "mems_tactical"}
SIZE = {
    "latency": 2e-3, "gravity": 2e-2, "rate_scale": 2e-3, "radius": 2e-3, "arm_stretch": 2e-5,
    "table_zero": 2e-3, "plane_zero": 2e-3, "fixture_common": 2e-3, "fixture": 2e-3, "turn_on": 1e-2,
}  # fmt: skip
ROUNDING = 1e-9
"""Of outputs of some 200 m/s^2, after a difference over a ten-thousandth."""

CASES = [
    (sensor, kind)
    for sensor, plans in PLANS.items()
    for kind in KINDS
    if {plan.procedure for plan in plans} & set(KINDS[kind].procedures)
]


def campaign(sensor, **options):
    entry = ib.sensor(CLASS[sensor], kind=sensor)
    lib = ib.library(sensor, set="extended", **options)
    return entry, lib, draw_unit(entry, lib, np.random.default_rng(4))


@pytest.mark.parametrize(("sensor", "kind"), CASES)
def test_rows_are_the_tangent_of_the_simulated_output(sensor, kind):
    """The distance from the tangent falls with the square of the step: four times for half of it."""
    entry, lib, truth = campaign(sensor, asymmetry=-1)
    runs = nominal(PLANS[sensor])
    extras = extras_for(runs, {kind: SIZE[kind]}, sensor=sensor)
    rng = np.random.default_rng(5)
    theta = np.array([truth[name] for name in lib.names])
    at, way = (SIZE[kind] * rng.normal(size=len(extras)) for _ in range(2))
    rows = rows_with(runs, lib, extras, theta, at)

    def distance(step):
        """Largest distance of the simulated output from the tangent, a step along the way."""
        nu = at + step * way
        errors = {extra.name: value for extra, value in zip(extras, nu.tolist(), strict=True)}
        outputs = measured(entry, PLANS[sensor], truth, errors, rng, noise=QUIET)
        off = (
            run.output + part.y - part.columns(0, len(part)) @ np.concatenate((theta, nu))
            for run, part in zip(outputs, rows, strict=True)
        )
        return max(float(np.abs(part).max()) for part in off)

    moved = max(np.abs(part.columns(0, len(part))[:, len(theta) :] @ way).max() for part in rows)
    assert moved > 0.0 and distance(0.0) < ROUNDING
    whole, half = distance(1.0), distance(0.5)
    assert whole < 0.05 * moved
    assert half < ROUNDING or whole / half == pytest.approx(4.0, rel=0.1)


def test_without_errors_the_rows_are_those_of_the_library():
    _, lib, truth = campaign("accelerometer")
    runs = nominal(PLANS["accelerometer"])
    theta = np.array([truth[name] for name in lib.names])
    for part, run in zip(rows_with(runs, lib, (), theta, np.zeros(0)), runs, strict=True):
        plain = linear_of(run, lib)
        np.testing.assert_array_equal(part.columns(0, len(part)), plain.columns(0, len(part)))
        np.testing.assert_array_equal(part.y, plain.y)


@pytest.mark.parametrize("held", [0, 10**9])
@pytest.mark.parametrize("sensor", PLANS)
def test_columns_of_a_part_are_those_of_the_whole_however_they_are_made(sensor, held, monkeypatch):
    """A latency of 30 ms, of a gyroscope, reaches across the borders of parts."""
    _, lib, truth = campaign(sensor)
    runs = nominal(PLANS[sensor])
    kinds = {kind: size for kind, size in SIZE.items() if kind != "latency"}
    extras = extras_for(runs, {"latency": 3e-2} if sensor == "gyroscope" else kinds, sensor=sensor)
    nu = np.array([extra.sd for extra in extras])
    theta = np.array([truth[name] for name in lib.names])
    whole = rows_with(runs, lib, extras, theta, nu)
    monkeypatch.setattr(module, "MOST_HELD", held)
    monkeypatch.setattr(module, "CHUNK", 50)
    for first, again in zip(whole, rows_with(runs, lib, extras, theta, nu), strict=True):
        X, size = first.columns(0, len(first)), np.abs(first.columns(0, len(first))).max(axis=0)
        for a, b in ((0, 1), (7, 14), (14, 50), (len(first) - 3, len(first))):
            np.testing.assert_allclose(again.columns(a, b), X[a:b], atol=1e-9 * size.max())
        np.testing.assert_allclose(again.y, first.y, atol=1e-10)


def test_where_the_input_axis_is_horizontal_an_asymmetry_stays_on_its_jump():
    lib = ib.library("accelerometer")
    runs = nominal([ib.tumble(angles=4, planes=1, **SHORT)])
    theta = np.array([1.0 if name == "b0p" else 0.0 for name in lib.names])
    extras = extras_for(runs, {"table_zero": 1e-5})
    for zero in (0.0, 1e-3, -1e-3):
        (rows,) = rows_with(runs, lib, extras, theta, np.array([zero]))
        X = rows.columns(0, len(rows))
        assert X[:, lib.names.index("b0p")].tolist() == [1.0, 1.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0]
        np.testing.assert_allclose(
            X[:, -1], -9.80665 * np.repeat(np.sin(np.arange(4) * np.pi / 2 + zero), 2), atol=1e-7
        )


def test_a_tilt_turns_what_the_coefficients_see_and_not_the_input():
    """To first order, whatever the tilt is: it is an allowance, not a correction."""
    entry, lib, truth = campaign("accelerometer", asymmetry=-1)
    plans = PLANS["accelerometer"]
    extras = extras_for(nominal(plans), {"tilt": 1e-3})
    theta, rng, step = np.array([truth[name] for name in lib.names]), np.random.default_rng(0), 1e-4
    rows = rows_with(nominal(plans), lib, extras, theta, np.array([5e-3, -5e-3]))
    for column, axis in ((-2, "j"), (-1, "k")):
        ends = []
        for angle in (step, -step):
            errors = {f"fixture_common_{axis}": angle}
            whole, input_alone = (measured(entry, plans, t, errors, rng, noise=QUIET) for t in (truth, {}))
            ends.append([a.output - b.output for a, b in zip(whole, input_alone, strict=True)])
        for part, up, down in zip(rows, *ends, strict=True):
            slope = part.columns(0, len(part))[:, column]
            np.testing.assert_allclose(slope, (up - down) / (2.0 * step), atol=1e-8)
            assert np.abs(slope).max() > 1e-4
