"""Effects in a scene by its factor against direct integration in time, on real logs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.linalg import expm

from imubayes.rig.gravity import SEMI_MAJOR_AXIS
from imubayes.rig.inputs import Inputs
from imubayes.scenes.effects import TIMES, budget_effects, cell_loads, output_effects, turned_force
from imubayes.scenes.propagation import Budget
from imubayes.scenes.ranges import scene_named
from imubayes.scenes.record import AXES, Course, Scene, recorded
from imubayes.scenes.trajectories import generated
from imubayes.sensors.catalogue import coupled, draw_unit, sensor
from imubayes.sensors.terms import library

G, T0 = 9.80665, 298.15
KINDS = ("accelerometer", "gyroscope")


@pytest.fixture(scope="module")
def flight(recordings):
    log = loadmat(recordings / "inertialnav" / "TestLog2.mat")["IMU"]
    return recorded("flight", 1e-3 * (log[:, 1] - log[0, 1]), log[:, 5:8], log[:, 2:5])


@pytest.fixture(scope="module")
def hand(recordings):
    log = loadmat(recordings / "broad" / "21_undisturbed_fast_combined.mat")
    t = np.arange(len(log["imu_acc"])) / float(log["sampling_rate"].item())
    return recorded("hand", t, log["imu_acc"], log["imu_gyr"])


@pytest.fixture(params=["flight", "hand"])
def log(request):
    return request.getfixturevalue(request.param)


def error_in_time(scene, lib, unit, axis):
    """Error of the output written out term by term from the body's vectors: no column, no factor."""
    c = scene.inputs.channels
    order = ["ijk"["xyz".index(along)] for along in AXES[axis]]
    f, w, dw = (
        {new: c[f"{q}_{letter}"] for new, letter in zip("ijk", order, strict=True)} for q in ("f", "w", "dw")
    )
    own, other = (f, w) if lib.kind == "accelerometer" else (w, f)
    total = np.zeros(len(scene.inputs))
    for name, theta in unit.items():
        head, _, tail = name.partition("_")
        if head[0] == "b":
            signed = name.endswith("p")
            power = int(name[1:].removesuffix("p"))
            column = own["i"] ** power * (np.sign(own["i"]) if signed else 1.0)
        elif head in ("c", "S"):
            family = own if head == "c" else other
            column = family[tail[0]] * family[tail[1]]
        else:
            column = {"m": own, "g": other, "s": dw}[head][tail]
        total = total + theta * column
    return total


def across(scene, axis):
    """Force (n,) that lies across a case axis: what a turn about it moves."""
    c = scene.mean_motion.channels
    unit = np.eye(3)["xyz".index(axis)]
    return np.linalg.norm(np.cross(unit, np.column_stack([c[f"f_{letter}"] for letter in "ijk"])), axis=1)


def integrated(scene, drive, schuler, times):
    """Attitude, velocity and position at given times, each row held, by small steps of the equations.

    drive : errors of accelerometer and gyroscope, and the load, (n,) each.
    """
    edges = np.append(scene.inputs.t - scene.inputs.t[0], np.inf)
    back = 1.0 / SEMI_MAJOR_AXIS if schuler else 0.0
    phi = v = x = now = 0.0
    row, out = 0, []
    for time in times:
        while now < time:
            end = min(edges[row + 1], time)
            (e_a, e_g, f), step = (float(values[row]) for values in drive), end - now
            d1 = np.array([e_g - back * v, e_a + f * phi, v])
            d2 = np.array([-back * d1[1], f * d1[0], d1[1]])
            d3 = np.array([-back * d2[1], f * d2[0], d2[1]])
            phi, v, x = np.array([phi, v, x]) + step * (d1 + step / 2.0 * (d2 + step / 3.0 * d3))
            now, row = end, row + (end == edges[row + 1])
        out.append((phi, v, x))
    return np.array(out)


def a_unit(kind, seed=1):
    lib = library(kind, set="extended")
    return lib, draw_unit(sensor("mems_tactical", kind=kind), lib, np.random.default_rng(seed))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rms_by_the_factor_is_the_rms_of_the_error_in_time(log, kind, axis) -> None:
    lib, unit = a_unit(kind)
    effects, theta = output_effects(log, lib, axis), np.array(list(unit.values()))
    rng = np.random.default_rng(2)
    for inside in (np.ones(len(theta), dtype=bool), *(rng.random((4, len(theta))) < 0.5)):
        kept = {name: value for (name, value), there in zip(unit.items(), inside, strict=True) if there}
        direct = np.sqrt(np.mean(error_in_time(log, lib, kept, axis) ** 2))
        assert effects.size(theta * inside) == pytest.approx(direct, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("quantity", "state"), [("attitude", 0), ("velocity", 1), ("position", 2)])
@pytest.mark.parametrize("schuler", [True, False])
def test_effect_on_a_budget_is_the_integrated_error(log, kind, quantity, state, schuler) -> None:
    lib, unit = a_unit(kind)
    few = Scene(log.name, _thinned(log.inputs), log.duration)
    effects = budget_effects(few, lib, Budget(quantity, 1.0, schuler), "z")
    times = few.duration * np.arange(1, TIMES + 1) / TIMES
    error = error_in_time(few, lib, unit, "z")
    zero = np.zeros_like(error)
    drive = (error, zero, zero + G) if kind == "accelerometer" else (zero, error, across(few, "z"))
    direct = integrated(few, drive, schuler, times)[:, state]
    found = effects.rows @ np.array(list(unit.values()))
    assert np.abs(found - direct).max() <= 1e-6 * np.abs(direct).max()
    assert effects.size(np.array(list(unit.values()))) == pytest.approx(np.abs(direct).max(), rel=1e-6)


def _thinned(inputs, every=20):
    """Every 20th row: the loop over rows is slow in Python."""
    channels = {name: values[::every] for name, values in inputs.channels.items()}
    return Inputs(inputs.t[::every], channels, inputs.interval * every)


def test_bias_and_scale_in_a_steady_turn_are_the_formulas_of_a_budget() -> None:
    """0.5 b t^2, 0.5 s a t^2, 0.5 K2 a^2 t^2, 0.5 S w^2 t^2 for constant a and w."""
    n, a, w = 100, 30.0, 0.4
    force, rate = np.tile([a, 0.0, G], (n, 1)), np.tile([0.0, w, 0.0], (n, 1))
    turn = recorded("turn", np.arange(float(n)), force, rate)
    lib = library("accelerometer", set="extended")
    effects = budget_effects(turn, lib, Budget("position", 1.0, schuler=False))
    single = dict(zip(lib.names, effects.single(np.ones(len(lib.names))), strict=True))
    for name, value in {"b0": 1.0, "b1": a, "b2": a**2, "m_k": G, "c_ik": a * G, "S_jj": w**2}.items():
        assert single[name] == pytest.approx(0.5 * value * n**2, rel=1e-12)
    assert single["m_j"] == 0.0 and single["s_j"] == 0.0


def unrolled(scene, records):
    """Motion of every repetition (3, n), and the temperature and its rate at the same times, written out."""
    c, n = scene.mean_motion.channels, len(scene.mean_motion)
    f, w = (np.tile([c[f"{q}_{axis}"] for axis in "ijk"], records) for q in ("f", "w"))
    t = scene.mean_motion.interval * np.arange(records * n)
    inside = t <= scene.course.t[-1]
    heat, rate = (np.interp(t, scene.course.t, scene.course.channels[name]) for name in ("T", "dT"))
    return f, w, heat - T0, np.where(inside, rate, 0.0)


def exactly_integrated(columns, load, step, kind):
    """State (3, p) after rows of equal length, by the matrix exponential of equations with their drive."""
    state = np.zeros((3, columns.shape[1]))
    drive = [0.0, 1.0, 0.0] if kind == "accelerometer" else [1.0, 0.0, 0.0]
    for row, f in zip(columns, load, strict=True):
        whole = np.zeros((4, 4))
        whole[:3, :3] = [[0.0, -1.0 / SEMI_MAJOR_AXIS, 0.0], [f, 0.0, 0.0], [0.0, 1.0, 0.0]]
        whole[:3, 3] = drive
        move = expm(whole * step)
        state = move[:3, :3] @ state + np.outer(move[:3, 3], row)
    return state


def repeated_flight(ends):
    """Forty rows of 20 s that are flown six times, while the case warms up in three ramps until `ends`."""
    rng, n = np.random.default_rng(8), 40
    force, rate = rng.normal([1.0, 2.0, G], 4.0, (n, 3)), rng.normal(0.1, 0.3, (n, 3))
    scene = recorded("flight", 20.0 * np.arange(n), force, rate, duration=6 * n * 20.0)
    knots = np.array([0.0, 130.0, 900.0, ends])
    heat = {"T": np.array([260.0, 281.0, 306.0, 333.0]), "dT": np.array([0.2, 0.1, 0.01, 0.02])}
    return Scene(scene.name, scene.inputs, scene.duration, course=Course(knots, heat))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ends", [1900.0, 4800.0])
def test_temperature_runs_on_while_the_motion_repeats(kind, ends) -> None:
    """Every product of T and motion against the whole mission written out, row by row."""
    scene = repeated_flight(ends)
    lib = library(kind, temperature=2, temperature_of=("b0", "b1", "m_k", "c_jk"), rate_of=("b0", "b1"))
    f, w, T, dT = unrolled(scene, 6)
    own = f if kind == "accelerometer" else w
    motion = {"b0": np.ones_like(T), "b1": own[0], "m_k": own[2], "c_jk": own[1] * own[2]}
    wanted = {f"{name}*T": values * T for name, values in motion.items()}
    wanted |= {f"{name}*T2": values * T**2 for name, values in motion.items()}
    wanted |= {f"{name}*dT": motion[name] * dT for name in ("b0", "b1")} | motion
    load = np.full(len(T), G) if kind == "accelerometer" else np.hypot(f[1], f[2])
    direct = exactly_integrated(np.column_stack(list(wanted.values())), load, 20.0, kind)
    for state, quantity in enumerate(("attitude", "velocity", "position")):
        effects = budget_effects(scene, lib, Budget(quantity, 1.0))
        found = effects.rows[-1, [lib.names.index(name) for name in wanted]]
        assert found == pytest.approx(direct[state], rel=1e-9)


def test_temperature_of_a_log_is_held_from_its_end_on() -> None:
    """A still bench that warms up by 12 K in a minute, and then stays: the mean of T over ten minutes."""
    n, records = 60, 10
    force = np.tile([0.0, 0.0, G], (n, 1))
    warm = T0 + 0.2 * np.arange(n)
    scene = recorded("bench", np.arange(60.0), force, 0.0 * force, temperature=warm, duration=600.0)
    lib = library("accelerometer", temperature=1)
    last = budget_effects(scene, lib, Budget("velocity", 1.0, schuler=False)).rows[-1]
    by_name = dict(zip(lib.names, last, strict=True))
    assert by_name["b0*T"] == pytest.approx(0.2 * (n - 1) * (n / 2 + (records - 1) * n), rel=1e-12)
    assert by_name["b0*dT"] == pytest.approx(0.2 * n, rel=1e-12)


def test_scene_without_temperature_drives_no_term_of_it() -> None:
    still = recorded("desk", np.arange(9.0), np.tile([0.0, 0.0, G], (9, 1)), np.zeros((9, 3)), duration=90.0)
    lib = library("gyroscope", temperature=1)
    rows = budget_effects(still, lib, Budget("attitude", 1.0)).rows
    heated = ["*" in name for name in lib.names]
    assert sum(heated) == 3 and not rows[:, heated].any() and rows[:, 0].all()


def test_generated_temperature_does_not_jump_back_when_the_motion_repeats() -> None:
    """Attitude by b0*T is the integral of the scene's own sine, whatever the record: five times repeated."""
    ranges = scene_named("planing_craft")
    scene = generated(ranges, np.random.default_rng(1), duration=1800.0)
    lib = library("gyroscope", temperature=2)
    effects = budget_effects(scene, lib, Budget("attitude", 1.0, schuler=False))
    low, high = ranges.temperature
    half, p, t = 0.5 * (high - low), 2.0 * ranges.warming / (high - low), scene.duration
    offset = 0.5 * (high + low) - T0
    first = offset * t + half * (1.0 - np.cos(p * t)) / p
    second = offset**2 * t + 2.0 * offset * half * (1.0 - np.cos(p * t)) / p
    second += half**2 * (t / 2.0 - np.sin(2.0 * p * t) / (4.0 * p))
    by_name = dict(zip(lib.names, effects.rows[-1], strict=True))
    # rows of 11 ms are held, and the sine is linear between knots
    assert by_name["b0*T"] == pytest.approx(first, rel=1e-4)
    assert by_name["b0*T2"] == pytest.approx(second, rel=1e-4)


def test_force_across_an_axis_is_what_a_small_turn_about_it_moves() -> None:
    """Rotation of f by a small angle about i, divided by the angle; on a level bench it is g."""
    f, angle = np.random.default_rng(9).normal(0.0, 20.0, (5, 3)), 1e-6
    inputs = Inputs(np.arange(5.0), {f"f_{axis}": f[:, c] for c, axis in enumerate("ijk")}, 1.0)
    turn = expm(angle * np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    moved = np.linalg.norm(f @ turn.T - f, axis=1) / angle
    assert turned_force("gyroscope", inputs) == pytest.approx(moved, rel=1e-6)
    level = Inputs(np.zeros(1), {"f_k": np.array([G])}, 1.0)
    assert turned_force("gyroscope", level) == turned_force("accelerometer", inputs) == G


def test_gyroscope_without_a_known_force_is_level_at_one_g() -> None:
    assert turned_force("gyroscope", Inputs(np.zeros(1), {"w_i": np.ones(1)}, 1.0)) == G


def test_cells_of_a_repeated_load_hold_its_impulse() -> None:
    """Rows of uneven length, flown 3.5 times: the sum over the cells is the integral over the mission."""
    t = np.cumsum(np.random.default_rng(10).uniform(0.5, 2.0, 30))
    inputs, load = Inputs(t, {}, 1.0), np.random.default_rng(11).uniform(0.0, 50.0, 30)
    steps = np.append(np.diff(t), 1.0)
    once, half = float(load @ steps), 0.5 * steps.sum()
    passed = np.clip(half - np.append(0.0, np.cumsum(steps)[:-1]), 0.0, steps)
    cells = cell_loads(load, inputs, 3.5 * steps.sum())
    assert cells.mean() * 3.5 * steps.sum() == pytest.approx(3.0 * once + load @ passed, rel=1e-12)
    room = 1e-9 * load.max()  # of a cell as a difference of sums
    assert load.min() - room <= cells.min() and cells.max() <= load.max() + room
    assert cell_loads(G, inputs, 9.0) == G


def test_vibration_drives_k2_and_not_the_scale_factor_in_position() -> None:
    """Only the rectified mean integrates: K2 sees f^2 + s^2, the scale factor sees f."""
    quadrotor = generated(scene_named("quadrotor"), np.random.default_rng(1))
    still = Scene("slow", quadrotor.mean_motion, quadrotor.duration)
    lib, budget = library("accelerometer"), Budget("position", 1.0, schuler=False)
    shaken, slow = (budget_effects(scene, lib, budget, "z").rows[-1] for scene in (quadrotor, still))
    added = dict(zip(lib.names, shaken - slow, strict=True))
    bias = shaken[0]
    assert added["b2"] == pytest.approx(quadrotor.vibration**2 * bias, rel=1e-9)
    assert abs(added["b1"]) < 1e-9 * abs(shaken[1]) and added["c_jj"] == pytest.approx(added["b2"], rel=1e-9)


def test_vibration_counts_in_the_rms_of_the_output() -> None:
    """The rms of b1 f over the rows of a level bench that shakes: sqrt(s^2) along a horizontal axis."""
    bench = generated(scene_named("automotive"), np.random.default_rng(1))
    lib = library("accelerometer")
    rms = output_effects(bench, lib, "x").single(np.ones(len(lib.names)))[1]
    slow = bench.mean_motion.channels["f_i"]
    n = len(slow)
    assert rms**2 == pytest.approx(np.mean(slow**2) + bench.vibration**2, rel=4.0 * np.sqrt(2.0 / n) + 0.02)


@pytest.mark.parametrize("quantity", ["output", "velocity"])
def test_what_a_lever_arm_ties_counts_once_whether_its_column_is_one_or_two(hand, quantity):
    entry = sensor("mems_tactical", kind="accelerometer")
    apart = library("accelerometer", set="extended")
    lib = coupled(apart, entry)
    theta = np.array(list(draw_unit(entry, lib, np.random.default_rng(3)).values()))
    one, two = (budget_effects(hand, each, Budget(quantity, 1.0), "x") for each in (lib, apart))
    assert one.size(theta) == pytest.approx(two.size(theta), rel=1e-9)
    single = dict(zip(lib.names, one.single(np.ones(len(theta))), strict=True))
    assert single["s_j"] == single["S_kk"] == 0.0 < single["S_ik"]
