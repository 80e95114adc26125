"""A triad in the hand: simulated ones of known truth, and the recording that imu_tk published figures of."""

from __future__ import annotations

from dataclasses import replace

import hands
import numpy as np
import pytest
from scipy.linalg import rq

from imubayes.algebra.factor import posterior
from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.inference.free_tumble import solve_free_tumble, trusted_stills
from imubayes.inference.linear import Extra
from imubayes.inference.stills import find_stills, left_by
from imubayes.inference.triad import Triad, calibration, triad_of
from imubayes.selection.decision import select
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.imu import ACCELEROMETERS as COMPONENTS
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library

INDUSTRIAL = sensor("mems_industrial", kind="accelerometer")
LIBRARY = library("accelerometer", powers=3, asymmetry=1)
LINEAR = ("b0", "b1", "m_j", "m_k")
NINE = library("accelerometer", powers=1, asymmetry=-1)
"""Bias, scale factor and misalignments alone."""

# raw outputs come before any factory calibration: 100 mg, 10000 ppm, 20 mrad
RAW = {"b0": 0.980665, "b1": 1e-2, "m_j": 2e-2, "m_k": 2e-2}

BIAS = np.array([0.5, -0.8, 0.3])
GAIN = np.array([[1.004, 3e-3, -9e-3], [0.0, 0.997, 2e-2], [0.0, 0.0, 1.002]])
K2 = np.array([16e-6, -12e-6, 20e-6])  # m/s^2 per (m/s^2)^2: one to two and a half times the class's typical


def asked(lib=LIBRARY, noise=None, *, raw=RAW, entry=INDUSTRIAL):
    sds = {term.name: prior_sd(entry, term)[0] for term in lib.terms} | raw
    return hands.asked(lib, sds, noise, sensor=entry)


def solve(run, lib=LIBRARY, noise=None):
    return solve_free_tumble([run], asked(lib, noise))


def named(found, values):
    return dict(zip(found.triads[0].names, values.tolist(), strict=True))


def output_error(gain=GAIN, bias=BIAS, quadratic=0.0):
    """Output minus input of a triad, in matrix form: y = gain f + bias + K2 f^2."""
    return lambda f: f @ (gain - np.eye(3)).T + bias + quadratic * f**2


TRUTH = {
    **{f"{c}.b0": b for c, b in zip(COMPONENTS, BIAS, strict=True)},
    **{f"{c}.b1": GAIN[k, k] - 1.0 for k, c in enumerate(COMPONENTS)},
    **{f"{c}.b2": value for c, value in zip(COMPONENTS, K2, strict=True)},
    # (i, j, k) is (x, y, z) for ax and (y, z, x) for ay
    "ax.m_j": GAIN[0, 1],
    "ax.m_k": GAIN[0, 2],
    "ay.m_j": GAIN[1, 2],
}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_known_triad_is_recovered_within_its_error_bars(hand_tumble, seed):
    found = solve(hand_tumble(output_error(quadratic=K2), stills=36, seed=seed).run)
    spread = posterior(found.summary.factor, asked().prior.sd)[1]
    sd, mean = named(found, spread), named(found, found.triads[0].theta)
    for name in mean:
        assert abs(mean[name] - TRUTH.get(name, 0.0)) < 4.0 * sd[name], name
    assert all(sd[name] < 0.05 * RAW[name.partition(".")[2]] for name in TRUTH if name[3:] in LINEAR)


def test_a_rotation_of_the_case_is_taken_out(hand_tumble):
    """Of any gain matrix A only U of A = U Q can be seen: Q turns the unknown directions."""
    turn = np.array([[0.0, -2e-2, 1e-2], [2e-2, 0.0, -3e-2], [-1e-2, 3e-2, 0.0]])
    gain = GAIN @ (np.eye(3) + turn + 0.5 * turn @ turn)
    upper, _ = rq(gain)
    upper = upper * np.sign(np.diag(upper))
    quiet = Noise(1e-7, 0.0, 0.0)
    run = hand_tumble(output_error(gain=gain), noise=quiet).run
    found = solve(run, NINE, quiet)
    np.testing.assert_allclose(found.triads[0].gain(), upper, rtol=0.0, atol=1e-6)
    biases = [value for name, value in named(found, found.triads[0].theta).items() if name.endswith(".b0")]
    np.testing.assert_allclose(biases, BIAS, rtol=0.0, atol=1e-6)


def test_compensation_of_nonsense_does_not_settle():
    triad = triad_of(LIBRARY)
    wild = np.array([3.0 if name.endswith(".b1") else 0.0 for name in triad.names])
    with pytest.raises(ConvergenceError, match="scale and offset") as caught:
        Triad(triad.libraries, wild).compensate(np.ones((1, 3)))
    assert np.shape(caught.value.estimate) == (1, 3)


def test_calibration_undoes_the_output(hand_tumble):
    """f = T K (raw - bias), with the published names of its entries, gives the force back."""
    triad = hands.with_truth(NINE, TRUTH)
    nominal = ((2.42e-3, 32768.0), (2.4e-3, 32000.0), (2.5e-3, 33000.0))
    rows = calibration(triad, nominal)
    K, T = np.diag([row["scale"] for row in rows]), np.eye(3)
    T[0, 1], T[0, 2] = rows[0]["nonorthogonality"]["m_j"], rows[0]["nonorthogonality"]["m_k"]
    T[1, 2] = rows[1]["nonorthogonality"]["m_j"]
    f = 9.81 * np.random.default_rng(3).normal(size=(20, 3))
    scale, offset = np.array(nominal).T
    raw = (f @ GAIN.T + BIAS) / scale + offset
    np.testing.assert_allclose((raw - [row["bias"] for row in rows]) @ (T @ K).T, f, rtol=0.0, atol=1e-9)


def test_fewer_than_nine_stills_are_refused(hand_tumble):
    with pytest.raises(UnobservableError, match="8 stills are too few"):
        solve(hand_tumble(stills=8).run)


@pytest.fixture(scope="module")
def recorded(xsens):
    return solve(replace(xsens, output=xsens.force))


def test_xsens_recording_has_the_published_calibration(recorded):
    """Figures of imu_tk on its own recording (threshold multiplier 6), in its signs."""
    rows = calibration(recorded.triads[0], [(2.42e-3, 32768.0)] * 3)
    np.testing.assert_allclose(
        [row["scale"] for row in rows], [2.41278e-3, 2.42712e-3, 2.41168e-3], rtol=5e-4, atol=0.0
    )
    np.testing.assert_allclose([row["bias"] for row in rows], [33124.2, 33275.2, 32364.4], rtol=0.0, atol=2.0)
    entries = [value for row in rows for value in row["nonorthogonality"].values()]
    np.testing.assert_allclose(entries, [-0.0033593, -0.00890639, -0.0213341], rtol=0.0, atol=5e-4)
    stills = recorded.summary.runs[0].stills
    assert len(stills) == 38 and stills[0][1] - stills[0][0] > 45.0  # s; it begins with a rest of 50 s


def test_stills_of_the_xsens_recording_tell_the_linear_terms_and_no_other(recorded):
    (triad,) = recorded.triads
    chosen = select(recorded.summary, asked().prior, triad.libraries[0], component="ax")
    assert {term.name for term in chosen.terms if term.verdict == "needed"} == {*LINEAR}
    others = {term.verdict for term in chosen.terms if term.name not in LINEAR}
    assert others <= {"unresolved", "inseparable", "untested"}


def test_unknown_gravity_leaves_the_common_scale_to_its_prior(hand_tumble):
    """Gravity stated 300 ppm too low: every scale factor looks as much too large."""
    hand = hand_tumble()
    wrong = replace(hand.run, gravity=hand.run.gravity / (1.0 + 3e-4))
    gravity, scales = Extra("gravity", "gravity", 5e-3, "m/s^2", "ug", "local gravity"), []
    one = asked(NINE, raw={}, entry=sensor("mems_tactical", kind="accelerometer"))
    for extras in ((), (gravity,)):
        case = solve_free_tumble([wrong], one, extras=extras)
        mean, sd = posterior(case.summary.factor, hands.prior_of([one], case))
        j = case.summary.names.index("ax.b1")
        scales.append((mean[j], sd[j]))
    (sure, narrow), (unsure, wide) = scales
    assert abs(sure) > 10.0 * narrow
    assert abs(unsure) < 4.0 * wide
    assert case.summary.names[-1] == "gravity"
    # one gravity for three axes: their scale factors share its error
    assert wide > 5.0 * narrow


@pytest.fixture(scope="module")
def touched():
    """A record, and the same with one of its 24 stills off by 0.15 m/s^2 along x and y."""
    none = library("gyroscope", powers=1, asymmetry=-1)
    run = hands.in_the_hand(
        hands.with_truth(NINE, {"ax.b0": 0.05, "ay.b1": 2e-3}),
        hands.with_truth(none, {}, referenced=True),
        stills=24,
    )
    run = replace(run, output=run.force)
    stills = find_stills(run)
    start, stop = stills[7]
    output = run.output.copy()
    output[start - 30 : stop + 30, :2] += 0.15
    return run, replace(run, output=output), stills


DELIVERED = asked(NINE, raw={})
"""What is asked of a triad after its factory calibration."""


def test_a_still_that_was_touched_is_found_and_the_others_say_what_they_said(touched):
    clean, spoilt, stills = touched
    runs, distrusted, case = trusted_stills([spoilt], DELIVERED, rng=np.random.default_rng(1))
    assert len(distrusted) == 1
    t = spoilt.t[stills[7][0]], spoilt.t[stills[7][1] - 1]
    assert distrusted[0].start <= t[1] and distrusted[0].stop >= t[0]
    assert len(find_stills(runs[0])) == len(stills) - 1
    without = replace(clean, stills=find_stills(runs[0]))
    expected, found, pulled = (
        solve_free_tumble([run], DELIVERED).theta for run in (without, runs[0], spoilt)
    )
    np.testing.assert_array_equal(case.theta, found)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.abs(pulled - expected).max() > 10.0 * np.abs(found - expected).max() + 1e-3


def test_of_two_records_one_whose_stills_were_all_touched_is_left_out_and_named(touched):
    clean, _, stills = touched
    output, rng = clean.output.copy(), np.random.default_rng(5)
    for start, stop in stills:
        output[start - 30 : stop + 30] += 0.4 * rng.normal(size=3)
    spoilt = replace(clean, name="spoilt", output=output)
    runs, _, case = trusted_stills([clean, spoilt], DELIVERED, rng=np.random.default_rng(1))
    assert [run.name for run in runs] == ["hand"]
    assert "run 'spoilt' is left out: most of its dwells contradict" in runs[0].source.notes[-1]
    expected = solve_free_tumble([clean], DELIVERED)
    np.testing.assert_allclose(case.theta, expected.theta, rtol=1e-9, atol=1e-12)


def test_nothing_is_left_out_where_nobody_touched_anything(touched):
    clean, _, stills = touched
    runs, distrusted, _ = trusted_stills([clean], DELIVERED, rng=np.random.default_rng(1))
    assert distrusted == () and find_stills(runs[0]) == stills


def test_a_spoilt_piece_of_a_long_rest_leaves_the_rest(touched):
    run, _, _ = touched
    span = float(run.t[400]) - 1e-6, float(run.t[500]) - 1e-6
    assert left_by(run, ((0, 1000), (1200, 1500)), [span]) == ((0, 400), (500, 1000), (1200, 1500))
