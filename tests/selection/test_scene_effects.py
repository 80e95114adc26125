"""Effects in a scene by its factor against direct integration in time, on real logs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import loadmat

from imubayes.rig.inputs import Inputs
from imubayes.rig.scene_ranges import scene_named
from imubayes.rig.scenes import AXES, Scene, recorded
from imubayes.rig.trajectories import generated
from imubayes.selection.kernels import SCHULER, Budget
from imubayes.selection.scene_effects import TIMES, budget_effects, output_effects
from imubayes.sensors.catalogue import draw_unit, sensor
from imubayes.sensors.terms import library

G = 9.80665
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


def integrated(scene, error, kind, schuler, times):
    """Attitude, velocity and position at given times, each row held, by small steps of the equations."""
    edges = np.append(scene.inputs.t - scene.inputs.t[0], np.inf)
    back = SCHULER**2 / G if schuler else 0.0
    phi = v = x = now = 0.0
    row, out = 0, []
    for time in times:
        while now < time:
            end = min(edges[row + 1], time)
            e, step = float(error[row]), end - now
            e_a, e_g = (e, 0.0) if kind == "accelerometer" else (0.0, e)
            d1 = np.array([e_g - back * v, e_a + G * phi, v])
            d2 = np.array([-back * d1[1], G * d1[0], d1[1]])
            d3 = np.array([-back * d2[1], G * d2[0], d2[1]])
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
    direct = integrated(few, error, kind, schuler, times)[:, state]
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
