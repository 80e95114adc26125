"""Known quantities before and after compensation: errors of simulated IMUs against what is predicted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import hands
import numpy as np
import pytest

from imubayes.algebra.factor import with_prior_rows
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.free_tumble import solve_imu_tumble
from imubayes.inference.known_quantities import recover
from imubayes.inference.stills import resting, times_of
from imubayes.inference.triad import triad_of
from imubayes.inference.whiten import whiten
from imubayes.sensors.noise import Noise, NoiseRule

KINDS = ("accelerometer", "gyroscope")
SDS = {"b0": (0.5, 5e-2), "b1": (1e-2, 1e-2), "m_j": (2e-2, 2e-2), "m_k": (2e-2, 2e-2)}
SEEDS = range(1, 5)


def asked(which, run, *, referenced=False):
    sds = {name: sd[which] for name, sd in SDS.items()}
    return hands.asked(
        hands.only(KINDS[which], SDS), sds, hands.NOISES[which], run=run, referenced=referenced
    )


def drawn(both, seed, *, referenced=False):
    """Triads whose coefficients are drawn from the prior."""
    rng = np.random.default_rng([seed, 7])
    return [
        replace(
            triad_of(one.library, referenced=referenced or one.library.kind == "gyroscope"),
            theta=one.prior.sd * rng.normal(size=len(one.prior.sd)),
        )
        for one in both
    ]


@cache
def tumbled(seed):
    both = [asked(k, "hand") for k in (0, 1)]
    truth = drawn(both, seed)
    run = hands.in_the_hand(*truth, seed=seed)
    case, sd = solve_imu_tumble([run], *both), np.concatenate([one.prior.sd for one in both])
    return recover(case, [run], sd, hands.theta_of(case)), case, truth, sd


@cache
def placed(seed):
    both = [asked(k, "bench", referenced=True) for k in (0, 1)]
    truth = drawn(both, seed, referenced=True)
    run = hands.on_a_table(truth, seed=seed)
    case, sd = solve_ferraris([run], *both), np.concatenate([one.prior.sd for one in both])
    return recover(case, [run], sd, hands.theta_of(case)), case, truth, sd


@cache
def again(made, seed):
    """Another recording of the same IMU, compensated by what was found first."""
    _, case, truth, sd = made(seed)
    run = (
        hands.in_the_hand(*truth, seed=100 + seed)
        if made is tumbled
        else hands.on_a_table(truth, seed=100 + seed)
    )
    return recover(case, [run], sd, hands.theta_of(case))


def by_name(found):
    return {one.what: one for one in found}


def test_sections_whose_faces_are_off_are_recovered_but_for_what_their_tilts_hide():
    both, off = [asked(k, "bench", referenced=True) for k in (0, 1)], 0.02
    found = []
    for seed in SEEDS[:4]:
        run = hands.on_a_table(drawn(both, seed, referenced=True), seed=seed, faces=off)
        case = solve_ferraris([run], *both, fixture=off)
        found.append(by_name(recover(case, [run], hands.prior_of(both, case), hands.theta_of(case))))
    for what in ("gravity", "turn"):
        of = sum(one[what].after.size for one in found)
        assert sum(one[what].inside for one in found) >= 0.9 * of


@pytest.mark.parametrize(("made", "what"), [
    (tumbled, "gravity"), (tumbled, "rest"), (tumbled, "closure"), (placed, "gravity"), (placed, "rest"),
])  # fmt: skip
def test_errors_after_compensation_have_the_size_that_is_predicted(made, what):
    pulls = [by_name(made(seed)[0])[what] for seed in SEEDS]
    squares = np.concatenate([((one.after / one.fitted) ** 2).ravel() for one in pulls])
    # flicker makes neighbouring stills alike: half of them count
    assert abs(squares.mean() - 1.0) < 4.0 * np.sqrt(2.0 / (0.5 * len(squares))) + 0.05


def test_sds_of_stills_are_of_the_covariance_that_rows_were_whitened_by_however_loud_the_flicker():
    noises = (Noise(8e-4, 2e-3, 1e-5), hands.NOISES[1])
    both = [
        replace(asked(k, "hand"), rules={"hand": NoiseRule("fixed", noise)}) for k, noise in enumerate(noises)
    ]
    run = hands.in_the_hand(*drawn(both, 3), seed=3, noises=noises)
    case = solve_imu_tumble([run], *both)
    sd = hands.prior_of(both, case)
    one = by_name(recover(case, [run], sd, hands.theta_of(case)))["gravity"]
    rows, f = case.rows[0], case.summary.factor
    W, _ = whiten(case.summary.runs[0].noise, rows.rows, np.eye(len(rows)))
    root = np.linalg.inv(with_prior_rows(f.R, 1.0 / sd)[:-1, :-1])
    known = rows.X @ root
    left = np.linalg.inv(W.T @ W) - known @ known.T
    times = times_of(resting(run), resting(run).stills)
    for found, (start, stop) in zip(one.fitted[:, 0], times, strict=True):
        mean = np.where((rows.t >= start) & (rows.t <= stop), rows.duration, 0.0)
        mean /= mean.sum()
        assert found == pytest.approx(np.sqrt(mean @ left @ mean), rel=1e-4)


@pytest.mark.parametrize(
    ("made", "what"), [(tumbled, "gravity"), (tumbled, "rest"), (tumbled, "closure"), (placed, "turn")]
)
def test_new_data_are_off_by_what_is_predicted_for_them(made, what):
    squares = []
    for seed in SEEDS:
        one = by_name(again(made, seed))[what]
        squares.append(np.mean(one.after**2) / np.mean(one.fresh**2))
    # one error of a coefficient moves all stills of a seed: a chi-square of some nine of them a seed
    assert abs(np.mean(squares) - 1.0) < 4.0 * np.sqrt(2.0 / 9.0 / len(SEEDS)) + 0.05


def test_the_raw_output_is_off_by_what_the_coefficients_are():
    found, _, truth, _ = placed(1)
    before = by_name(found)["rest"].before
    at_rest = truth[1].parts()
    np.testing.assert_allclose(before, np.tile([part[0] for part in at_rest], (6, 1)), atol=3e-4)
    turned = by_name(found)["turn"].before[:, 0]
    gain, bias = np.diag(truth[1].gain()), np.array([part[0] for part in at_rest])
    np.testing.assert_allclose(turned, (gain - 1.0) * hands.FULL_TURN + 3.0 * bias, atol=2e-3)


def test_where_each_turn_has_a_coefficient_its_error_is_judged_by_that_of_new_ones():
    found = by_name(placed(1)[0])
    assert found["turn"].saturated and not found["rest"].saturated
    np.testing.assert_array_equal(found["turn"].expected, found["turn"].fresh)
    assert found["turn"].inside == 3 and np.abs(found["turn"].after).max() < 0.1 * found["turn"].fresh.min()


def test_compensation_by_kept_terms_is_that_with_the_others_zero():
    _, case, _, sd = placed(1)
    theta = hands.theta_of(case)
    names = [name for triad in case.triads for name in triad.names]
    without = np.where([name == "gx.b0" for name in names], 0.0, theta)
    run = hands.on_a_table(placed(1)[2])
    rest = by_name(recover(case, [run], sd, without))["rest"]
    np.testing.assert_allclose(rest.flown[:, 1:], rest.after[:, 1:], atol=1e-3)
    assert rest.flown[:, 0] == pytest.approx(
        rest.after[:, 0] + theta[names.index("gx.b0")], rel=0.03, abs=1e-3
    )
