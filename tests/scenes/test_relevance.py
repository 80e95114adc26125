"""What a scene requires: the smallest model, what is left, and the four quadrants."""

from dataclasses import replace
from itertools import combinations

import flights
import numpy as np
import pytest
from recorded_scenes import recorded

from imubayes.rig.inputs import Inputs
from imubayes.scenes import Scene, in_case
from imubayes.scenes.effects import (
    ComponentInScene,
    Knowledge,
    SceneEffects,
    budget_effects,
    output_effects,
    smallest_model,
)
from imubayes.scenes.propagation import Budget
from imubayes.scenes.relevance import QUADRANTS, exposure, weigh, weigh_case
from imubayes.scenes.trajectories import drawn, generated, scene_named
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns, library

LIB = library("accelerometer")
P = len(LIB.names)


def relevance(scene, lib, knowledge, budget, axis="x", noise=None):
    return weigh(exposure(scene, lib, budget, axis=axis), knowledge, noise=noise)


def desk(n=50, a=20.0):
    force = np.tile([a, 0.0, 9.80665], (n, 1))
    return Scene("desk", recorded("desk", np.arange(float(n)), force, np.zeros((n, 3))).inputs, float(n))


def certain(theta):
    """Coefficients that are known exactly."""
    return Knowledge(theta[None, :], np.ones(len(theta)), np.abs(theta))


def known_normal(mean, covariance, inclusion, rng, size=2000):
    """Knowledge of coefficients that are normal."""
    draws = rng.multivariate_normal(mean, covariance, size=size, method="eigh")
    return Knowledge(draws, inclusion, np.quantile(np.abs(draws), 0.95, axis=0))


def coefficients(**known_ones):
    return np.array([known_ones.get(name, 0.0) for name in LIB.names])


@pytest.fixture(scope="module")
def flown():
    """A drone with a calibrated sensor: relevance, and what it was made of."""
    scene = generated(scene_named("quadrotor"), np.random.default_rng(1))
    rng = np.random.default_rng(3)
    mean = coefficients(b0=2e-3, b1=3e-4, b2=3e-6, m_k=4e-4, c_jj=1e-6, b3=1e-9)
    sd = 0.02 * np.abs(mean) + coefficients(b0=1e-5, b1p=1e-6, c_jk=1e-7)
    knowledge = known_normal(mean, np.diag(sd**2), (mean != 0.0).astype(float), rng)
    budget = Budget("position", 60.0)
    return relevance(scene, LIB, knowledge, budget), scene, knowledge, budget


NONE = SceneEffects(("a", "b"), np.zeros((1, 2)))
"""Effects on an output over which no term takes up another."""


def test_errors_of_the_terms_left_out_add_as_vectors() -> None:
    """Two like terms of 0.75 of the budget: one has to stay. Two across each other add in squares."""
    alike, across = np.ones((1, 2)), np.eye(2)
    for rows, components, theta, kept in (
        (alike, 1, [0.75, 0.75], 1),
        (alike, 1, [0.75, -0.75], 0),
        (across, 2, [0.75, 0.75], 1),
        (across, 2, [0.75, -0.6], 0),
        (across, 1, [0.75, 0.9], 0),
    ):
        effects = SceneEffects(("a", "b"), rows, components)
        (keep,), _ = smallest_model([ComponentInScene(effects, NONE, certain(np.array(theta)))], 1.0, 0.0)
        assert keep.sum() == kept


@pytest.mark.parametrize("rounding", [-1e-12, 0.0, 1e-12])
def test_of_terms_that_cost_the_same_and_are_as_likely_the_first_stays(rounding) -> None:
    effects = SceneEffects(("a", "b"), np.ones((1, 2)))
    known = certain(np.array([0.75, 0.75 + rounding]))
    known = replace(known, inclusion=np.array([0.9, 0.9 - rounding]))
    (keep,), _ = smallest_model([ComponentInScene(effects, NONE, known)], 1.0, 0.0)
    assert keep.tolist() == [True, False]


def test_smallest_model_is_that_of_an_exhaustive_search_where_effects_do_not_interact() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        theta, limit = rng.exponential(size=7), 1.2
        effects = SceneEffects(tuple("abcdefg"), np.diag(rng.uniform(0.5, 2.0, 7)))
        (keep,), _ = smallest_model([ComponentInScene(effects, effects, certain(theta))], limit, 0.0)
        sizes = [
            k
            for k in range(8)
            for kept in combinations(range(7), k)
            if effects.size(np.where(np.isin(np.arange(7), kept), 0.0, theta)) <= limit
        ]
        assert keep.sum() == min(sizes) and effects.size(theta * ~keep) <= limit


def test_what_is_left_is_what_draws_leave_after_compensation_with_the_means(flown) -> None:
    found, scene, knowledge, budget = flown
    effects = budget_effects(scene, LIB, budget)
    keep = np.isin(LIB.names, found.model)
    mean = knowledge.draws.mean(axis=0)
    output = output_effects(scene, LIB)
    R = output.rows
    taken = np.linalg.lstsq(R[:, keep], R[:, ~keep], rcond=None)[0]
    fitted = np.where(keep, mean, 0.0)
    fitted[keep] += taken @ mean[~keep]
    left = np.array([effects.rows @ (draw - fitted) for draw in knowledge.draws])
    sizes = np.linalg.norm(left.reshape(len(left), -1, 2), axis=-1).max(axis=1)
    assert found.left == pytest.approx(tuple(np.quantile(sizes, (0.5, 0.95))), rel=1e-6)
    assert found.within_budget and sizes[sizes <= budget.limit].size >= 0.95 * len(sizes)
    whole = np.linalg.norm(((knowledge.draws - mean) @ effects.rows.T).reshape(len(left), -1, 2), axis=-1)
    assert found.calibrated == pytest.approx(tuple(np.quantile(whole.max(axis=1), (0.5, 0.95))), rel=1e-9)
    rest = R[:, ~keep] - R[:, keep] @ taken
    left_out = [np.sum((rest @ draw[~keep]) ** 2) for draw in knowledge.draws]
    assert found.left_out_rms == pytest.approx(np.sqrt(np.mean(left_out)), rel=1e-6)


def test_calibration_that_cannot_meet_the_budget_still_names_the_terms_to_model() -> None:
    theta = coefficients(b0=0.05, b1=1e-6)
    sd = coefficients(c_kk=1e-3)
    knowledge = known_normal(theta, np.diag(sd**2), np.ones(P), np.random.default_rng(1))
    found = relevance(desk(), LIB, knowledge, Budget("position", 10.0, schuler=False))
    assert not found.within_budget and "b0" in found.model and found.calibrated[1] > 10.0
    assert set(found.model) <= {"b0", "c_kk"}


def test_share_is_averaged_over_models() -> None:
    """A term that is there in 30 % of the draws: the median share is zero, the upper end is its own."""
    draws = np.zeros((100, P))
    draws[:30, 0] = 0.01
    knowledge = Knowledge(draws, (draws != 0.0).mean(axis=0), np.full(P, 0.01))
    found = relevance(desk(), LIB, knowledge, Budget("position", 25.0))
    first = found.terms[0]
    low, half, high = first.share_q05, first.share_of_budget, first.share_q95
    assert low == half == 0.0 and high == pytest.approx(0.5, rel=0.01)
    assert first.quadrant == QUADRANTS[2]
    assert first.rms == pytest.approx(0.01 * np.sqrt(0.3))


GYRO = library("gyroscope", temperature=1)
IDLE = Knowledge(np.zeros((2, len(GYRO.names))), np.zeros(len(GYRO.names)), np.zeros(len(GYRO.names)))


def notes_of(scene, budget, axis="y"):
    return " ".join(relevance(scene, GYRO, IDLE, budget, axis=axis).notes)


def test_noise_of_a_gyroscope_in_a_boost_grows_with_the_load_of_the_boost() -> None:
    """Position by N and K: f N t^2.5/sqrt(20), f K t^3.5/sqrt(252); of the thrust counts what lies across."""
    t, f, noise = 50.0, 200.0, Noise(1e-5, 3e-6, 2e-6)
    boost = recorded("boost", np.arange(t), np.tile([f, 0.0, 20.0], (50, 1)), np.zeros((50, 3)))
    budget = Budget("position", 1.0, schuler=False)
    for axis, across in (("y", np.hypot(f, 20.0)), ("x", 20.0), ("z", f)):
        weighed = [
            relevance(boost, GYRO, IDLE, budget, axis=axis, noise=one)
            for one in (noise, Noise(0.0, 1.0, 0.0), None)
        ]
        (white, flicker, walk), (_, unit, _), none = (found.noise for found in weighed)
        assert flicker == pytest.approx(unit * noise.B, rel=1e-12) and unit > 0.0 and not any(none)
        assert white == pytest.approx(across * noise.N * t**2.5 / 20.0**0.5, rel=0.03)
        assert walk == pytest.approx(across * noise.K * t**3.5 / 252.0**0.5, rel=0.05)


def test_scene_without_a_force_is_said_to_have_been_given_one_g() -> None:
    log = Scene("rates", Inputs(np.arange(60.0), {"w_i": np.full(60, 0.5)}, 1.0), 60.0)
    assert "1 g is taken to act upwards" in notes_of(log, Budget("velocity", 1.0))


def test_log_that_is_shorter_than_its_mission_is_said_to_hold_its_temperature() -> None:
    force = np.tile([0.0, 0.0, 9.80665], (60, 1))
    for duration, said in ((600.0, True), (60.0, False)):
        warm = np.linspace(290.0, 300.0, 60)
        log = recorded("log", np.arange(60.0), force, 0.0 * force, temperature=warm, duration=duration)
        assert ("temperature stays as it is there" in notes_of(log, Budget("attitude", 1.0))) is said
    ship = generated(scene_named("marine"), np.random.default_rng(1))
    assert "temperature stays" not in notes_of(ship, Budget("attitude", 1.0))


QUIET = Noise(0.0, 0.0, 0.0)


def test_case_errs_as_a_full_navigator_with_the_errors_of_all_its_sensors_does() -> None:
    """The vector sum of six sensors, each along its own axis; 5 %, which the square of an error may take."""
    t = 0.1 * np.arange(3001)
    truth = flights.flight(t, *flights.path("turns", t), level=True)
    scene = recorded("turns", t, truth.force, truth.rate, attitude=truth.attitude)
    budget, rng = Budget("position", 10.0), np.random.default_rng(4)
    exposed, knowledge, drive = {}, {}, []
    for kind, size in (("accelerometer", 1e-4), ("gyroscope", 1e-6)):
        lib = library(kind, powers=2, asymmetry=-1)
        for axis in "xyz":
            name = f"{kind[0]}{axis}"
            exposed[name] = exposure(scene, lib, budget, axis=axis)
            X = columns(lib, in_case(scene.inputs, axis).channels, len(t))
            theta = size * rng.normal(size=len(lib.names)) / np.maximum(np.abs(X).max(axis=0), 1e-12)
            knowledge[name] = certain(theta)
            drive.append(X @ theta)
    found = weigh_case(exposed, knowledge, dict.fromkeys(exposed, QUIET))
    d_force, d_rate = (np.column_stack(part)[:, None] for part in (drive[:3], drive[3:]))
    _, largest = flights.errors(truth, d_force, d_rate)
    assert found.uncompensated[0] == pytest.approx(largest[0, 2], rel=0.05)
    assert found.within_budget and found.left[1] <= 10.0 < found.uncompensated[0]
    assert found.candidates == sum(len(known.inclusion) for known in knowledge.values())
    assert 0 < sum(map(len, found.models.values())) < found.candidates


def test_errors_over_several_draws_of_a_scene_are_the_largest_of_each() -> None:
    seeds = [(1, 5), (1, 6), (1, 7)]
    scene = drawn(scene_named("quadrotor"), seeds, duration=60.0)
    apart = [generated(scene_named("quadrotor"), np.random.default_rng(s), duration=60.0) for s in seeds]
    unit, budget = np.ones(P), Budget("position", 1.0)
    each = [budget_effects(one, LIB, budget).single(unit) for one in apart]
    np.testing.assert_allclose(budget_effects(scene, LIB, budget).single(unit), np.max(each, axis=0))
    squares = [output_effects(one, LIB).single(unit) ** 2 * len(one.inputs) for one in apart]
    rms = np.sqrt(np.sum(squares, axis=0) / sum(len(one.inputs) for one in apart))
    np.testing.assert_allclose(output_effects(scene, LIB).single(unit), rms, rtol=1e-9, atol=1e-12)
    assert np.ptp(each, axis=0).max() > 0.0


def test_what_a_calibration_over_the_test_leaves_is_what_its_least_squares_leave() -> None:
    """b0 in place of b2: over the scene it is the whole of it, over -2 g to 2 g the mean of the squares."""
    swept, theta = np.linspace(-20.0, 20.0, 81), coefficients(b0=0.01, b2=1e-5)
    tested = SceneEffects(LIB.names, columns(LIB, {"f_i": swept}, len(swept)))
    seen = exposure(desk(), LIB, Budget("position", 4.0, schuler=False))
    found = weigh(seen, certain(theta), tested=tested)
    assert found.model == found.tested_model == ("b0",)
    assert found.left_out[1] == pytest.approx(0.0, abs=1e-9)
    left = 0.5 * 50.0**2 * 1e-5 * (400.0 - np.mean(swept**2))
    assert found.tested_left_out == pytest.approx((left, left))
    closer = weigh(
        exposure(desk(), LIB, Budget("position", 3.0, schuler=False)), certain(theta), tested=tested
    )
    assert closer.model == ("b0",) and set(closer.tested_model or ()) == {"b0", "b2"}
