"""Gyroscopes by their turns between stills: derivatives, exact turns, known truths, imu_tk's recording."""

import tracemalloc
from dataclasses import replace
from functools import cache

import hands
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from imubayes.algebra.factor import posterior
from imubayes.errors import UnobservableError
from imubayes.inference import stills as stills_of
from imubayes.inference.between_stills import directions, turn_rows
from imubayes.inference.free_tumble import solve_imu_tumble
from imubayes.inference.linear import Extra
from imubayes.inference.prior import ScalePrior
from imubayes.inference.stills import condensed, find_stills, resting
from imubayes.inference.triad import calibration, triad_of
from imubayes.rig.motion import onward
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.noise import Noise

CLASS = {kind: sensor("mems_industrial", kind=kind) for kind in ("accelerometer", "gyroscope")}
RAW = {
    "accelerometer": {"b0": 1.0, "b1": 1e-2, "m_j": 2e-2, "m_k": 2e-2},
    "gyroscope": {"b0": 0.1, "b1": 2e-2, "m_j": 5e-2, "m_k": 5e-2, "g_i": 3e-4, "g_j": 3e-4, "g_k": 3e-4},
}
"""Prior sds before any factory calibration, SI; others are the class's."""

LINEAR, OF_REST = ("b0", "b1", "m_j", "m_k"), ("b0", "g_i", "g_j", "g_k")


OF_FORCE = hands.only("accelerometer", LINEAR)
OF_RATE = hands.only("gyroscope", (*LINEAR, "b2", *OF_REST))

TRUTH = {
    "ax.b0": 0.3, "ay.b0": -0.2, "az.b0": 0.1, "ax.b1": 4e-3, "ay.b1": -3e-3, "az.b1": 2e-3,
    "ax.m_j": 3e-3, "ax.m_k": -9e-3, "ay.m_j": 2e-2,
    "gx.b0": 2e-2, "gy.b0": -3e-2, "gz.b0": 1e-2, "gx.b1": 5e-3, "gy.b1": -8e-3, "gz.b1": 1e-2,
    "gx.m_j": 1e-2, "gx.m_k": -2e-2, "gy.m_j": 3e-2, "gy.m_k": 5e-3, "gz.m_j": -1e-2, "gz.m_k": 2e-2,
    "gx.g_k": 2e-4, "gy.g_i": -1e-4,
}  # fmt: skip


def asked(lib, noise=None):
    entry = CLASS[lib.kind]
    sds = {term.name: prior_sd(entry, term)[0] for term in lib.terms} | RAW[lib.kind]
    return hands.asked(lib, sds, noise, sensor=entry)


@cache
def simulated(seed, stills=24):
    return hands.in_the_hand(
        hands.with_truth(OF_FORCE, TRUTH), hands.with_truth(OF_RATE, TRUTH), seed=seed, stills=stills
    )


def solved(run, extras=()):
    both = [asked(lib, noise) for lib, noise in zip((OF_FORCE, OF_RATE), hands.NOISES, strict=True)]
    case = solve_imu_tumble([run], *both, extras=extras)
    return case, *posterior(case.summary.factor, hands.prior_of(both, case))


def test_rows_are_the_derivatives_of_the_turned_directions():
    """Coefficients moved one by one, and every turn integrated anew; of biases turns say nothing."""
    # without g-sensitivity: what accelerometers move of it, a product of two errors, is left out of the rows
    linear = {name: value for name, value in TRUTH.items() if ".g_" not in name}
    force, rate = hands.with_truth(OF_FORCE, TRUTH), hands.with_truth(OF_RATE, linear)
    run = resting(hands.in_the_hand(force, rate, stills=8))

    def left(triads):
        rows = turn_rows(directions(triads[0], run), triads[1], noises=hands.NOISES)
        X = rows.columns(0, len(rows))
        return rows.y - X @ np.concatenate([t.theta for t in triads]), X

    base, X = left((force, rate))
    moved = [(0, k) for k in range(len(force.theta))] + [(1, k) for k in range(len(rate.theta))]
    told = np.array([not name.endswith(".b0") for name in (*force.names, *rate.names)])
    assert not X[:, ~told].any()
    for column, (which, k) in enumerate(moved):
        if not told[column]:
            continue
        step = 1e-5
        shifted = [force, rate]
        theta = shifted[which].theta.copy()
        theta[k] += step
        shifted[which] = replace(shifted[which], theta=theta)
        slope = -(left(shifted)[0] - base) / step
        # second order of the step, and of the rotation within a sample: (3 rad/s 0.01 s)^2 / 12
        scale = np.abs(X[:, column]).max()
        np.testing.assert_allclose(slope, X[:, column], rtol=0.0, atol=2e-3 * scale)


def test_known_imu_is_recovered_within_its_error_bars():
    pulls = []
    for seed in range(1, 7):
        case, mean, sd = solved(simulated(seed))
        truth = np.array([TRUTH.get(name, 0.0) for name in case.summary.names])
        # what turns tell, and rest does not
        turned = np.array([name[:1] == "g" and name[3:] not in OF_REST for name in case.summary.names])
        pulls.append(((mean - truth) / sd)[turned])
    every = np.concatenate(pulls)
    assert np.abs(every).max() < 4.0
    # mean square of n independent normal pulls is 1 with sd sqrt(2/n)
    assert np.mean(every**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(every)))


def test_error_of_gravity_is_no_error_of_the_gyroscopes():
    """Directions do not depend on the size of g."""
    run = simulated(1)
    gravity = Extra("gravity", "gravity", 1e-2, "m/s^2", "ug", "error of local gravity")
    plain, (case, mean, _) = solved(run), solved(run, (gravity,))
    assert case.summary.names[-1] == "gravity"
    names = np.array([name.startswith("g") and name != "gravity" for name in case.summary.names])
    shift = np.abs(mean[names] - plain[1][names[:-1]]) / plain[2][names[:-1]]
    assert shift.max() < 0.2


def test_slow_drift_moves_a_bias_by_what_its_error_bar_says():
    """Rest and turns see the same drift.

    Told by both, biases would be off by 1.2 error bars of gyroscopes, and by 1.8 of accelerometers, whose
    directions are what turns are held against.
    """
    truths = [hands.with_truth(lib, TRUTH) for lib in (OF_FORCE, OF_RATE)]
    noises = (Noise(6e-4, 6e-4, 0.0), Noise(1e-5, 4e-5, 0.0))
    both = [asked(lib, noise) for lib, noise in zip((OF_FORCE, OF_RATE), noises, strict=True)]
    pulls = []
    for seed in range(24):
        case = solve_imu_tumble([hands.in_the_hand(*truths, noises=noises, seed=seed)], *both)
        names, bars = case.summary.names, posterior(case.summary.factor, hands.prior_of(both, case))
        pulls.append([(m - TRUTH[n]) / sd for n, m, sd in zip(names, *bars, strict=True) if n[3:] == "b0"])
    of_force, of_rate = np.sqrt(np.mean(np.square(pulls), axis=0).reshape(2, 3).mean(axis=1))
    assert 0.7 < of_force < 1.1
    assert 0.7 < of_rate < 1.1


def test_too_few_turns_are_refused():
    run = resting(simulated(1))
    seen = directions(hands.with_truth(OF_FORCE, TRUTH), replace(run, stills=run.stills[:5]))
    with pytest.raises(UnobservableError, match="has 4 turns without a gap between its 5 stills"):
        turn_rows(seen, triad_of(OF_RATE, referenced=True), noises=hands.NOISES)


def test_turn_with_a_gap_is_left_out():
    run = resting(simulated(1))
    seen = directions(hands.with_truth(OF_FORCE, TRUTH), run)
    whole = turn_rows(seen, triad_of(OF_RATE, referenced=True), noises=hands.NOISES)
    late = np.arange(len(run.t)) > run.stills[3][1] + 20
    broken = replace(run, inputs=replace(run.inputs, t=run.t + 1.0 * late))
    rows = turn_rows(replace(seen, run=broken), triad_of(OF_RATE, referenced=True), noises=hands.NOISES)
    assert len(rows) == len(whole) - 2


T = np.linspace(0.0, 2.0, 201)


def tumbling(t):
    """A rate whose direction moves as fast as its size, rad/s."""
    return np.stack((2.0 * np.sin(3.0 * t), 1.5 * np.cos(2.0 * t), 1.0 + np.sin(t)), axis=-1)


def test_a_turn_about_a_fixed_axis_is_exact_at_any_rate_of_sampling():
    axis, t = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.7, 1.0, 2.5])
    carried = onward(t, np.tile(1.3 * axis, (4, 1)))[0]
    expected = Rotation.from_rotvec(-1.3 * 2.5 * axis).as_matrix()
    np.testing.assert_allclose(carried, expected, rtol=0.0, atol=1e-14)


def test_direction_follows_its_differential_equation_to_the_fourth_order():
    start = np.array([0.6, -0.64, 0.48])
    exact = solve_ivp(lambda t, u: -np.cross(tumbling(t), u), (0.0, 2.0), start, rtol=1e-12, atol=1e-13).y[
        :, -1
    ]
    coarse, fine = (np.linalg.norm(onward(t, tumbling(t))[0] @ start - exact) for t in (T[::4], T[::2]))
    # rates between two samples are taken as linear: what they curve shifts the steps by the second order
    assert fine < coarse / 3.5
    assert fine < 2.0 * 0.02**2


PUBLISHED = ((32777.1, 2.09295e-4), (32459.8, 2.09899e-4), (32511.8, 2.09483e-4))
"""imu_tk's bias in counts and scale in (rad/s)/count of gx, gy, gz."""

SCALE = 2.1e-4
"""Nominal scale of `xsens`, (rad/s)/count."""


def test_xsens_rests_at_the_biases_that_imu_tk_published(xsens):
    """imu_tk's bias is the output in the first still, z up: bias and g-sensitivity, within a count."""
    case = solve_imu_tumble([xsens], asked(OF_FORCE), asked(hands.only("gyroscope", (*LINEAR, *OF_REST))))
    first = directions(case.triads[0], replace(xsens, stills=find_stills(xsens)[:1])).f
    at_rest = hands.deviation(case.triads[1], np.zeros((1, 3)), first)[0] / SCALE + 32768.0
    np.testing.assert_allclose(at_rest, [bias for bias, _ in PUBLISHED], rtol=0.0, atol=1.0)
    # bias alone is 7 counts off: g-sensitivity is needed
    assert abs(case.triads[1].parts()[0][0] / SCALE + 32768.0 - PUBLISHED[0][0]) > 5.0


def test_xsens_has_the_scale_factors_that_imu_tk_published(xsens, monkeypatch):
    """In imu_tk's own setting: the first still's bias held, no g-sensitivity, every turn's angle alike.

    Their sd in that setting is 8e-4 and more; the published figures have six digits.
    """

    def alike(noise, _ends, whole, _held):
        return noise.N**2 / (noise.N**2 / whole + 1e-3 / whole**2)

    monkeypatch.setattr("imubayes.inference.between_stills.counting_time", alike)
    published = (np.array([bias for bias, _ in PUBLISHED]) - 32768.0) * SCALE
    run = replace(xsens, output=np.hstack((xsens.force, xsens.rate - published)))
    lib = hands.only("gyroscope", LINEAR)
    rate = asked(lib)
    held = [
        1e-7 if name.endswith("b0") else sd
        for name, sd in zip(triad_of(lib, referenced=True).names, rate.prior.sd, strict=True)
    ]
    case = solve_imu_tumble([run], asked(OF_FORCE), replace(rate, prior=ScalePrior(held)))
    for row, (_, scale) in zip(calibration(case.triads[1], [(SCALE, 32768.0)] * 3), PUBLISHED, strict=True):
        assert row["scale"] == pytest.approx(scale, rel=2e-4)


def test_an_imu_in_the_hand_is_the_same_whatever_the_parts_that_its_file_is_read_in(tmp_path, monkeypatch):
    run = simulated(3)
    stills, (held, mean, sd) = find_stills(run), solved(run)
    cases = []
    for rows in (577, len(run.t)):
        read = hands.from_a_long_file(run, tmp_path, monkeypatch, rows)
        assert find_stills(read) == stills
        means = condensed(read)
        assert len(means.t) < len(run.t) and means.inputs.durations.sum() == pytest.approx(len(run.t) * 0.01)
        cases.append(solved(means))
    assert np.max(np.abs(cases[0][1] - cases[1][1]) / sd) < 1e-9
    # means of 0.06 s at rest tell what their samples do, but for how large the noise is
    assert np.max(np.abs(cases[0][1] - mean) / sd) < 0.05
    np.testing.assert_allclose(cases[0][2], sd, rtol=0.01)
    assert [r.samples for r in cases[0][0].summary.runs] == [r.samples for r in held.summary.runs]


def test_memory_for_stills_does_not_grow_with_how_long_they_are(tmp_path, monkeypatch):
    peaks = []
    for hold in (3.0, 24.0):
        monkeypatch.setattr(hands, "HOLD", hold)
        monkeypatch.setattr(stills_of, "BLOCKS", 200)
        read = hands.from_a_long_file(
            hands.in_the_hand(hands.with_truth(OF_FORCE, TRUTH), hands.with_truth(OF_RATE, TRUTH), stills=10),
            tmp_path,
            monkeypatch,
            577,
        )
        tracemalloc.start()
        condensed(read)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]
