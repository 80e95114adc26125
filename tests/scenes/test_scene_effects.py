"""Effects in a scene against the error in time of a real log; vibration by its moments."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_scenes import recorded
from scipy.integrate import quad
from scipy.io import loadmat
from scipy.stats import norm

from imubayes.rig.inputs import Inputs
from imubayes.scenes import Course, Scene, in_case
from imubayes.scenes.effects import budget_effects, mean_columns, output_effects
from imubayes.scenes.propagation import Budget, propagation
from imubayes.scenes.trajectories import generated, scene_named
from imubayes.sensors.catalogue import coupled, draw_unit, sensor
from imubayes.sensors.terms import columns, library

G, T0 = 9.80665, 298.15
KINDS = ("accelerometer", "gyroscope")


@pytest.fixture(scope="module")
def hand(recordings):
    log = loadmat(recordings / "broad" / "21_undisturbed_fast_combined.mat")
    t = np.arange(len(log["imu_acc"])) / float(log["sampling_rate"].item())
    return recorded("hand", t, log["imu_acc"], log["imu_gyr"])


def a_unit(kind, seed=1):
    lib = library(kind, set="extended")
    return lib, draw_unit(sensor("mems_tactical", kind=kind), lib, np.random.default_rng(seed))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rms_by_the_factor_is_the_rms_of_the_error_in_time(hand, kind, axis) -> None:
    lib, unit = a_unit(kind)
    effects, theta = output_effects(hand, lib, axis), np.array(list(unit.values()))
    X, rng = columns(lib, in_case(hand.inputs, axis).channels, len(hand.inputs)), np.random.default_rng(2)
    for inside in (np.ones(len(theta), dtype=bool), *(rng.random((4, len(theta))) < 0.5)):
        direct = np.sqrt(np.mean((X @ (theta * inside)) ** 2))
        assert effects.size(theta * inside) == pytest.approx(direct, rel=1e-9)


def unrolled(scene, records):
    """Motion of every repetition (3, n), and the temperature and its rate at the same times, written out."""
    c, n = scene.mean_motion.channels, len(scene.mean_motion)
    f, w = (np.tile([c[f"{q}_{axis}"] for axis in "ijk"], records) for q in ("f", "w"))
    t = scene.mean_motion.interval * np.arange(records * n)
    inside = t <= scene.course.t[-1]
    heat, rate = (np.interp(t, scene.course.t, scene.course.channels[name]) for name in ("T", "dT"))
    return f, w, heat - T0, np.where(inside, rate, 0.0)


def repeated_flight(ends):
    """Forty rows of 20 s that are flown six times, while the case warms up in three ramps until `ends`."""
    rng, n = np.random.default_rng(8), 40
    force, rate = rng.normal([1.0, 2.0, G], 4.0, (n, 3)), rng.normal(0.002, 0.006, (n, 3))
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
    f, w, T, dT = unrolled(scene, 7)
    own = f if kind == "accelerometer" else w
    motion = {"b0": np.ones_like(T), "b1": own[0], "m_k": own[2], "c_jk": own[1] * own[2]}
    wanted = {f"{name}*T": values * T for name, values in motion.items()}
    wanted |= {f"{name}*T2": values * T**2 for name, values in motion.items()}
    wanted |= {f"{name}*dT": motion[name] * dT for name in ("b0", "b1")} | motion
    X = np.column_stack(list(wanted.values()))
    passed = propagation(kind, scene, [scene.duration])
    direct = passed.errors("x", lambda k, rows: X[40 * k : 40 * (k + 1)][rows], repeated=False)[0]
    for quantity in ("attitude", "velocity", "position"):
        rows, read = budget_effects(scene, lib, Budget(quantity, 1.0)).rows, passed.read(quantity)
        found = rows[-len(read) :, [lib.names.index(name) for name in wanted]]
        assert found == pytest.approx(read @ direct, rel=1e-9, abs=1e-9 * np.abs(read @ direct).max())


def test_temperature_of_a_log_is_held_from_its_end_on() -> None:
    """A still bench that warms up by 12 K in a minute, and then stays: the mean of T over ten minutes."""
    n, records = 60, 10
    force = np.tile([0.0, 0.0, G], (n, 1))
    warm = T0 + 0.2 * np.arange(n)
    scene = recorded("bench", np.arange(60.0), force, 0.0 * force, temperature=warm, duration=600.0)
    lib = library("accelerometer", temperature=1)
    last = budget_effects(scene, lib, Budget("velocity", 1.0, schuler=False)).rows[-3]
    by_name = dict(zip(lib.names, last, strict=True))
    assert by_name["b0*T"] == pytest.approx(0.2 * (n - 1) * ((n + 1) / 2 + (records - 1) * n), rel=1e-9)
    assert by_name["b0*dT"] == pytest.approx(0.2 * n, rel=1e-9)


def test_scene_without_temperature_drives_no_term_of_it() -> None:
    still = recorded("desk", np.arange(9.0), np.tile([0.0, 0.0, G], (9, 1)), np.zeros((9, 3)), duration=90.0)
    lib = library("gyroscope", temperature=1)
    rows = budget_effects(still, lib, Budget("attitude", 1.0)).rows
    heated = ["*" in name for name in lib.names]
    assert sum(heated) == 3 and not rows[:, heated].any() and rows[::3, 0].all()


def test_vibration_drives_k2_and_not_the_scale_factor_in_position() -> None:
    """Only the rectified mean integrates: K2 sees f^2 + s^2, the scale factor sees f."""
    quadrotor = generated(scene_named("quadrotor"), np.random.default_rng(1))
    still = replace(quadrotor, inputs=quadrotor.mean_motion, slow=None)
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


LEVELS = {"f_i": 3.0, "f_j": -1.0, "f_k": 9.8, "w_i": 0.2, "w_j": 0.5, "w_k": -0.3}


def still(n=1):
    return Inputs(np.arange(float(n)), {name: np.full(n, value) for name, value in LEVELS.items()}, 1.0)


@pytest.mark.parametrize("level", [-7.0, 0.0, 0.4, 30.0])
def test_mean_of_every_power_is_the_integral_over_the_normal_density(level) -> None:
    rms, lib = 2.5, library("accelerometer", powers=6, asymmetry=5)
    found = mean_columns(lib, Inputs(np.zeros(1), {"f_i": np.array([level])}, 1.0), rms)[0]
    for name, value in zip(lib.names, found.tolist(), strict=True):
        if name[0] == "b":
            power, signed = int(name[1]), name.endswith("p")
            integrand = lambda x, n=power, s=signed: (  # noqa: E731
                (np.sign(x) if s else 1.0) * x**n * norm.pdf(x, level, rms)
            )
            ends = (level - 12.0 * rms, level + 12.0 * rms)
            places = [0.0] if ends[0] < 0.0 < ends[1] else None
            direct = quad(integrand, *ends, points=places, epsabs=1e-9, epsrel=1e-11)[0]
            assert value == pytest.approx(direct, rel=1e-8, abs=1e-8)


def burst(rms, band, seconds, rng):
    """Channels of a still case whose force vibrates, flat within the band and nothing outside."""
    n, step = round(4.0 * band[1] * seconds), 0.25 / band[1]
    frequency = np.fft.rfftfreq(n, step)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    # white noise of n rows keeps the share of its variance that lies within the band
    gain = rms * np.sqrt((n // 2 + 1) / inside.sum())
    added = {
        f"f_{axis}": gain * np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * inside, n) for axis in "ijk"
    }
    return {name: value + added.get(name, np.zeros(n)) for name, value in LEVELS.items()}


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_mean_over_a_sampled_burst_is_the_mean_by_moments(kind) -> None:
    """A flat band of W Hz gives 2 W T independent values to the mean of a square, more to other powers."""
    lib, seconds, band, rms = library(kind, powers=4, asymmetry=3, set="extended"), 60.0, (50.0, 400.0), 5.0
    shaken = burst(rms, band, seconds, np.random.default_rng(3))
    X = columns(lib, shaken, len(shaken["f_i"]))
    error = X.std(axis=0) / np.sqrt(2.0 * (band[1] - band[0]) * seconds)
    expected = mean_columns(lib, still(), rms)[0]
    assert (np.abs(X.mean(axis=0) - expected) <= 4.0 * error + 1e-9 * np.abs(expected)).all()
