"""Error kernels against closed forms, against the error equations, and noise against Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from imubayes.errors import InputError, StudyError
from imubayes.rig.gravity import SEMI_MAJOR_AXIS
from imubayes.rig.inputs import Inputs
from imubayes.rig.simulate import synthesise
from imubayes.scenes.propagation import (
    CELLS,
    STATES,
    Budget,
    budget_unit,
    constant_response,
    functionals,
    noise_growth,
    propagation,
    running_functionals,
    transition,
)
from imubayes.sensors.noise import Noise

G, R = 9.80665, SEMI_MAJOR_AXIS
KINDS = ("accelerometer", "gyroscope")
SCHULER = math.sqrt(G / R)
UG, DPH = 1e-6 * G, math.radians(1.0) / 3600.0


def one(kind, quantity, time, schuler=True):
    return float(constant_response(kind, np.array([time]), schuler=schuler)[STATES.index(quantity), 0])


def record(n, interval=1.0):
    return Inputs(interval * np.arange(float(n)), {}, interval)


def errors(kind, X, inputs, times, schuler=True, load=G):
    return functionals(propagation(kind, inputs, schuler=schuler, load=load), X, times)


def error_equations(schuler, load=G):
    """d/dt of (attitude, velocity, position) under the drives (accelerometer, gyroscope)."""
    back = -1.0 / R if schuler else 0.0
    A = np.array([[0.0, back, 0.0], [load, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return A, {"accelerometer": np.array([0.0, 1.0, 0.0]), "gyroscope": np.array([1.0, 0.0, 0.0])}


def test_constant_errors_grow_as_the_short_term_formulas_say() -> None:
    t = 70.0
    assert one("accelerometer", "position", t, False) == pytest.approx(0.5 * t**2, rel=1e-15)
    assert one("gyroscope", "position", t, False) == pytest.approx(G * t**3 / 6.0, rel=1e-15)
    assert one("gyroscope", "velocity", t, False) == pytest.approx(0.5 * G * t**2, rel=1e-15)


def test_schuler_formulas_tend_to_the_short_term_ones_with_the_square_of_time() -> None:
    """1 - cos x = x^2/2 (1 - x^2/12), x - sin x = x^3/6 (1 - x^2/20)."""
    for t in (1.0, 30.0, 200.0):
        x2 = (SCHULER * t) ** 2
        assert one("accelerometer", "position", t) == pytest.approx(0.5 * t**2 * (1 - x2 / 12), rel=x2**2)
        third = G * t**3 / 6 * (1 - x2 / 20)
        assert one("gyroscope", "position", t) == pytest.approx(third, rel=x2**2 + 1e-13)


def test_long_missions_have_the_published_magnitudes() -> None:
    """100 ug oscillate with 1.28 km peak; 0.01 deg/h on a level axis make 0.6 nautical miles an hour."""
    half = math.pi / SCHULER
    assert 100.0 * UG * one("accelerometer", "position", half) == pytest.approx(1280.0, rel=0.01)
    hours = np.array([1.0, 25.0]) * 2.0 * half
    first, last = constant_response("gyroscope", hours)[2] * 0.01 * DPH
    per_hour = (last - first) / (hours[1] - hours[0]) * 3600.0
    assert per_hour / 1852.0 == pytest.approx(0.6, rel=0.01)
    assert 2.0 * half / 60.0 == pytest.approx(84.4, abs=0.1)


@pytest.mark.parametrize("schuler", [True, False])
@pytest.mark.parametrize(
    ("load", "time"), [(G, 5.0), (G, 900.0), (G, 40_000.0), (0.0, 900.0), (-3.0 * G, 2e3)]
)
def test_responses_solve_the_error_equations(schuler, load, time) -> None:
    """Matrix exponential of the equations with the drive as a fourth state that stays constant."""
    A, drives = error_equations(schuler, load)
    scale = np.diag([1.0, G * time, G * time**2])  # the states in comparable units
    found = transition(time, schuler=schuler, load=load)
    assert found == pytest.approx(expm(A * time), rel=1e-9, abs=1e-15)
    for kind, drive in drives.items():
        whole = np.zeros((4, 4))
        whole[:3, :3], whole[:3, 3] = A, drive
        found = constant_response(kind, np.array([time]), schuler=schuler, load=load)[:, 0]
        error = np.linalg.solve(scale, found - expm(whole * time)[:3, 3])
        assert np.abs(error).max() < 1e-10 * np.abs(np.linalg.solve(scale, found)).max()


@pytest.mark.parametrize("schuler", [True, False])
def test_errors_carried_on_twice_are_carried_on_by_the_sum(schuler) -> None:
    a, b = 800.0, 4700.0
    both = transition(b, schuler=schuler) @ transition(a, schuler=schuler)
    assert both == pytest.approx(transition(a + b, schuler=schuler), rel=1e-10, abs=1e-12)
    for kind in KINDS:
        answer = constant_response(kind, np.array([a, b, a + b]), schuler=schuler)
        later = transition(b, schuler=schuler) @ answer[:, 0] + answer[:, 1]
        assert later == pytest.approx(answer[:, 2], rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("schuler", [True, False])
def test_functional_is_the_integration_of_the_error_row_by_row(kind, schuler) -> None:
    """Rows of uneven length, each held: one exact step of the error equations after the other."""
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.5, 9.0, 300))
    X, inputs = rng.normal(size=(300, 4)), Inputs(t, {}, 2.0)
    A, drives = error_equations(schuler)
    state = np.zeros((3, 4))
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3] = A, drives[kind]
    for row, step in zip(X, np.append(np.diff(t), 2.0), strict=True):
        move = expm(whole * step)
        state = move[:3, :3] @ state + np.outer(move[:3, 3], row)
    end = t[-1] - t[0] + 2.0
    found = errors(kind, X, inputs, [end], schuler)[0]
    assert np.abs(found - state).max(axis=1) == pytest.approx(np.zeros(3), abs=1e-9 * np.abs(state).max())
    assert np.allclose(found, state, rtol=1e-7, atol=0.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("schuler", [True, False])
def test_repeated_record_is_the_record_written_out(kind, schuler) -> None:
    X = np.random.default_rng(2).normal(size=(50, 3)) + 1.0
    times = [30.0, 50.0, 120.0, 2500.0, 2512.5]
    for load in (G, G * np.random.default_rng(3).uniform(-1.0, 5.0, 50)):
        written_load = np.tile(load, 51) if np.ndim(load) else load
        repeated = errors(kind, X, record(50), times, schuler, load)
        written = errors(kind, np.tile(X, (51, 1)), record(50 * 51), times, schuler, written_load)
        assert repeated == pytest.approx(written, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("schuler", [True, False])
def test_course_of_a_load_of_one_g_is_the_level_channel(kind, schuler) -> None:
    """Of columns of one sign, so that nothing cancels; two hours and a part of a record of 40 minutes."""
    rng = np.random.default_rng(4)
    n, times = 2400, [100.0, 2400.0, 7200.0, 7912.5]
    X = rng.uniform(0.5, 1.5, (n, 3))
    level, course = (errors(kind, X, record(n), times, schuler, load) for load in (G, np.full(n, G)))
    size = np.abs(level).max(axis=(0, 2), keepdims=True)
    assert (np.abs(course - level) <= 1e-12 * size).all()


@pytest.mark.parametrize("schuler", [True, False])
def test_gyroscope_under_a_course_of_load_is_the_numerical_solution_of_its_equations(schuler) -> None:
    """A boost from 1 to 9 g and a dive at -1 g, twice over, by an integrator of order 8 from row to row."""
    rng = np.random.default_rng(5)
    rows, step = 40, 30.0
    load = G * np.where(np.arange(rows) < 30, np.linspace(1.0, 9.0, rows), -1.0)
    X = rng.normal(size=(rows, 2)) + 0.5
    back = 1.0 / R if schuler else 0.0
    state = np.zeros((3, 2))
    for k in range(2 * rows):
        f, e = load[k % rows], X[k % rows]

        def slope(_, y, f=f, e=e):
            phi, v, _ = y.reshape(3, 2)
            return np.concatenate((e - back * v, f * phi, v))

        solved = solve_ivp(slope, (0.0, step), state.ravel(), method="DOP853", rtol=1e-11, atol=1e-9)
        state = solved.y[:, -1].reshape(3, 2)
    found = errors("gyroscope", X, record(rows, step), [2 * rows * step], schuler, load)[0]
    assert np.allclose(found, state, rtol=1e-6, atol=0.0)


def test_columns_that_change_with_each_record_are_the_columns_written_out() -> None:
    rng = np.random.default_rng(6)
    X, load = rng.normal(size=(4, 30, 2)), G * rng.uniform(0.0, 3.0, 30)
    propagated = propagation("gyroscope", record(30), load=load)
    times = [12.0, 30.0, 95.0, 120.0]
    found = running_functionals(propagated, lambda number: X[min(number, 3)], times)
    written = errors("gyroscope", X.reshape(-1, 2), record(120), times, True, np.tile(load, 4))
    assert found == pytest.approx(written, rel=1e-9, abs=1e-12 * np.abs(written).max())


def test_record_that_would_be_repeated_too_often_is_refused() -> None:
    with pytest.raises(InputError, match="expected 10,000 at most"):
        errors("accelerometer", np.ones((2, 1)), record(2), [30_000.0])


def test_mission_shorter_than_the_record_ends_within_it() -> None:
    X = np.arange(10.0)[:, None]
    velocity = errors("accelerometer", X, record(10), [4.0], False)[0, 1, 0]
    assert velocity == pytest.approx(0.0 + 1.0 + 2.0 + 3.0)


def test_white_noise_grows_as_random_walk_formulas_say() -> None:
    t, N = 600.0, 2.5e-4

    def of(kind, quantity):
        return noise_growth(kind, Noise(N, 0.0, 0.0), quantity, t, schuler=False)[0]

    # the mission in 2000 held steps: the integral of the square is short by 1/(2 n) and less
    assert of("accelerometer", "velocity") == pytest.approx(N * t**0.5, rel=1e-12)
    assert of("accelerometer", "position") == pytest.approx(N * t**1.5 / 3**0.5, rel=1e-6)
    assert of("gyroscope", "attitude") == pytest.approx(N * t**0.5, rel=1e-12)
    assert of("gyroscope", "position") == pytest.approx(G * N * t**2.5 / 20**0.5, rel=1e-6)


def test_random_walk_grows_as_its_formulas_say() -> None:
    t, K = 600.0, 3e-6

    def of(kind, quantity):
        return noise_growth(kind, Noise(0.0, 0.0, K), quantity, t, schuler=False)[2]

    assert of("accelerometer", "position") == pytest.approx(K * t**2.5 / 20**0.5, rel=1e-5)
    assert of("gyroscope", "position") == pytest.approx(G * K * t**3.5 / 252**0.5, rel=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("which", [0, 1, 2])
def test_noise_growth_is_the_spread_of_simulated_missions(kind, which) -> None:
    """A third of a Schuler period in 400 steps: the sd of 500 missions, to 4 standard errors."""
    n, step, missions = 400, 4.0, 500
    noise = Noise(*(1e-4 if k == which else 0.0 for k in range(3)))
    rng = np.random.default_rng(10 + which)
    t = step * np.arange(n)
    X = np.column_stack([synthesise(noise, t, step, rng) for _ in range(missions)])
    last = errors(kind, X, Inputs(t, {}, step), [n * step])[0]
    for state, quantity in enumerate(STATES):
        expected = noise_growth(kind, noise, quantity, n * step)[which]
        # time constants of the flicker lie elsewhere there: 3 % beside the chance of 500 draws
        assert last[state].std() == pytest.approx(expected, rel=4.0 / math.sqrt(2.0 * missions) + 0.03)


@pytest.mark.parametrize("schuler", [True, False])
def test_noise_under_a_course_of_load_is_the_sum_over_its_samples(schuler) -> None:
    """A sample a cell: white noise adds in squares, a random walk is the sum of what each step goes on to."""
    time, noise = 1800.0, Noise(2e-6, 0.0, 3e-8)
    step, load = time / CELLS, G * np.linspace(1.0, 6.0, CELLS) ** 2
    propagated = propagation("gyroscope", record(CELLS, step), schuler=schuler, load=load)
    started = np.tri(CELLS, CELLS)  # column k: an error that begins with sample k and stays
    for state, quantity in enumerate(STATES):
        white, _, walk = noise_growth("gyroscope", noise, quantity, time, schuler=schuler, load=load)
        single = functionals(propagated, np.eye(CELLS), [time])[0, state]
        steps = functionals(propagated, started, [time])[0, state]
        assert white == pytest.approx(noise.N / math.sqrt(step) * np.linalg.norm(single), rel=1e-9)
        # the walk steps at the start of each cell here, and all the way through it there: half a cell
        assert walk == pytest.approx(noise.K * math.sqrt(step) * np.linalg.norm(steps), rel=3.0 / CELLS)


def test_noise_of_the_output_is_what_a_second_holds() -> None:
    found = noise_growth("gyroscope", Noise(3.0, 2.0, 0.5), "output", 8.0)
    assert found == pytest.approx((3.0, 0.6643 * 2.0, 1.0), rel=1e-3)


def test_budget_that_leaves_nothing_or_that_nobody_knows_is_refused() -> None:
    with pytest.raises(StudyError, match="leaves nothing out"):
        Budget("position", 0.0)
    with pytest.raises(StudyError, match="expected output, attitude, velocity, position"):
        Budget("altitude", 1.0)
    assert budget_unit("accelerometer", "output") == "m/s^2" and budget_unit("gyroscope", "attitude") == "rad"
