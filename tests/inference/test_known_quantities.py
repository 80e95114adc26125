"""Known quantities before and after compensation: errors of simulated IMUs against what is predicted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import hands
import numpy as np
import pytest

from imubayes.inference.case import Asked
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.free_tumble import solve_imu_tumble
from imubayes.inference.known_quantities import recover
from imubayes.inference.prior import ScalePrior
from imubayes.inference.triad import triad_of
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library, library

KINDS = ("accelerometer", "gyroscope")
SDS = {"b0": (0.5, 5e-2), "b1": (1e-2, 1e-2), "m_j": (2e-2, 2e-2), "m_k": (2e-2, 2e-2)}
SEEDS = range(1, 5)


def asked(which, run, names=tuple(SDS), *, referenced=False):
    every = library(KINDS[which], powers=1, asymmetry=-1)
    lib = Library(KINDS[which], tuple(term for term in every.terms if term.name in names))
    libraries = triad_of(lib, referenced=referenced or which == 1).libraries
    sd = [SDS[name][which] for one in libraries for name in one.names]
    return Asked(lib, ScalePrior(sd), None, {run: NoiseRule("fixed", hands.NOISES[which])})


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
    theta = np.concatenate([triad.theta for triad in case.triads])
    return recover(case, [run], sd, theta), case, truth, sd


@cache
def placed(seed):
    both = [asked(k, "bench", referenced=True) for k in (0, 1)]
    truth = drawn(both, seed, referenced=True)
    run = hands.on_a_table(truth, seed=seed)
    case, sd = solve_ferraris([run], *both), np.concatenate([one.prior.sd for one in both])
    theta = np.concatenate([triad.theta for triad in case.triads])
    return recover(case, [run], sd, theta), case, truth, sd


def by_name(found):
    return {one.what: one for one in found}


@pytest.mark.parametrize(("made", "what"), [
    (tumbled, "gravity"), (tumbled, "rest"), (tumbled, "closure"), (placed, "gravity"), (placed, "rest"),
])  # fmt: skip
def test_errors_after_compensation_have_the_size_that_is_predicted(made, what):
    pulls = [by_name(made(seed)[0])[what] for seed in SEEDS]
    squares = np.concatenate([((one.after / one.fitted) ** 2).ravel() for one in pulls])
    # flicker makes neighbouring stills alike: half of them count
    assert abs(squares.mean() - 1.0) < 4.0 * np.sqrt(2.0 / (0.5 * len(squares))) + 0.05


@pytest.mark.parametrize(
    ("made", "what"), [(tumbled, "gravity"), (tumbled, "rest"), (tumbled, "closure"), (placed, "turn")]
)
def test_new_data_are_off_by_what_is_predicted_for_them(made, what):
    """Another recording of the same IMU, of as many stills and turns, compensated by what was found first."""
    squares = []
    for seed in SEEDS:
        _, case, truth, sd = made(seed)
        again = hands.on_a_table(truth, seed=100 + seed)
        if made is tumbled:
            again = hands.in_the_hand(*truth, seed=100 + seed)
        theta = np.concatenate([triad.theta for triad in case.triads])
        one = by_name(recover(case, [again], sd, theta))[what]
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
    theta = np.concatenate([triad.theta for triad in case.triads])
    names = [name for triad in case.triads for name in triad.names]
    without = np.where([name == "gx.b0" for name in names], 0.0, theta)
    run = hands.on_a_table(placed(1)[2])
    rest = by_name(recover(case, [run], sd, without))["rest"]
    np.testing.assert_allclose(rest.flown[:, 1:], rest.after[:, 1:], atol=1e-3)
    assert rest.flown[:, 0] == pytest.approx(
        rest.after[:, 0] + theta[names.index("gx.b0")], rel=0.03, abs=1e-3
    )
