"""Importance draws and bridge sampling against integrals that are known."""

import math

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import norm

from imubayes.inference.importance import BATCH, MOST, Student, drawn_until, log_integral

HUMPS = [Student(np.zeros(2), wide * np.eye(2)) for wide in (1.0, 3.0)]


def drawn(target, begin=HUMPS, enough=200.0, dear=None):
    return drawn_until(target, begin, np.ones(2), np.random.default_rng(1), enough=enough, dear=dear)


def bent(x):
    return (-0.5 * (x[0] / 2.0) ** 2 - 0.5 * ((x[1] - x[0] ** 2) / 0.5) ** 2,)


def two(x):
    """Humps of weights 0.3 and 0.7, five sds apart."""
    apart = np.array([5.0, 0.0])
    near, far = (-0.5 * float(np.sum((x - at) ** 2)) for at in (0.0, apart))
    return (float(np.logaddexp(math.log(0.3) + near, math.log(0.7) + far)),)


def test_integral_and_moments_of_a_bent_density_are_found():
    found = drawn(bent)
    assert found.effective >= 200.0
    assert found.log_integral == pytest.approx(math.log(2.0 * math.pi), abs=4.0 / math.sqrt(found.effective))
    for value, sd, k in ((0.0, 2.0, 0), (4.0, 4.0 * math.sqrt(2.0), 1)):
        mean = float(found.weights @ found.draws[:, k])
        assert mean == pytest.approx(value, abs=4.0 * sd / math.sqrt(found.effective))


@pytest.mark.parametrize("dear", [None, (24, 200)])
def test_a_second_hump_is_found_from_the_first_and_has_its_share(dear):
    found = drawn(two, HUMPS[: 1 if dear else 2], dear=dear)
    assert found.effective >= 200.0
    share = float(found.weights[found.draws[:, 0] > 2.5].sum())
    assert share == pytest.approx(0.7, abs=4.0 * math.sqrt(0.21 / found.effective))
    assert found.log_integral == pytest.approx(math.log(2.0 * math.pi), abs=4.0 / math.sqrt(found.effective))


def test_draws_that_are_gone_on_from_are_kept_and_no_point_is_asked_twice():
    asked = []
    few = drawn(lambda x: asked.append(x) or bent(x), enough=40.0)
    assert few.effective < 400.0
    found = drawn(lambda x: asked.append(x) or bent(x), few, enough=400.0)
    assert found.effective >= 400.0
    np.testing.assert_array_equal(found.draws, asked)
    np.testing.assert_array_equal(found.told[:, 0], [bent(x)[0] for x in asked])
    assert found.log_integral == pytest.approx(math.log(2.0 * math.pi), abs=4.0 / math.sqrt(found.effective))


@pytest.mark.parametrize(("dear", "most"), [(None, BATCH * MOST), ((24, 4), 96)])
def test_draws_end_at_the_most_humps(dear, most):
    """A needle that no draw meets: what there is comes back, and says how little it is."""
    needle = lambda x: (-1e12 * float((x - 0.3) @ (x - 0.3)),)  # noqa: E731
    found = drawn(needle, enough=1e9, dear=dear)
    assert len(found.draws) == most and found.effective < most


def test_even_draws_have_one_in_every_slice_of_a_normal_coordinate():
    """With many degrees of freedom the draws are all but normal: one in each 24th of its probability."""
    even = Student(np.zeros(3), np.eye(3), freedom=1e12).draw_evenly(24, np.random.default_rng(2))
    slices = np.sort((24.0 * norm.cdf(even)).astype(int), axis=0)
    np.testing.assert_array_equal(slices, np.tile(np.arange(24)[:, None], 3))


SIZE = 6000


def correlated_normal(d, seed):
    """Unnormalised normal density with a random covariance, its draws and the log of its integral."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((d, d)) + 2.0 * np.eye(d)
    precision = np.linalg.inv(A @ A.T)
    integral = 0.5 * d * math.log(2.0 * math.pi) + float(np.log(abs(np.linalg.det(A)))) + 1e5

    def density(x):
        return 1e5 - 0.5 * np.einsum("mi,ij,mj->m", x, precision, x)

    return density, rng.standard_normal((SIZE, d)) @ A.T, integral


@pytest.mark.parametrize("d", [1, 6, 26])
def test_evidence_of_a_normal_density_is_its_integral(d):
    density, x, expected = correlated_normal(d, d)
    value, error = log_integral(x, density(x), density, tau=1.0, rng=np.random.default_rng(1))
    assert error < 0.05
    assert abs(value - expected) < 4.0 * error + 1e-6


def test_evidence_of_a_heavy_tailed_density_is_its_integral():
    rng, nu, d = np.random.default_rng(2), 5.0, 3
    x = rng.standard_normal((SIZE, d)) / np.sqrt(rng.chisquare(nu, (SIZE, 1)) / nu)

    def density(x):
        return -0.5 * (nu + d) * np.log1p((x**2).sum(axis=1) / nu)

    expected = gammaln(0.5 * nu) - gammaln(0.5 * (nu + d)) + 0.5 * d * math.log(nu * math.pi)
    value, error = log_integral(x, density(x), density, tau=1.0, rng=np.random.default_rng(1))
    assert abs(value - expected) < 4.0 * error


def test_stated_error_is_the_scatter_over_repeats():
    density, _, expected = correlated_normal(4, 9)
    L = np.linalg.cholesky(np.cov(correlated_normal(4, 9)[1].T))
    found = []
    for seed in range(40):
        x = np.random.default_rng([3, seed]).standard_normal((800, 4)) @ L.T
        # a target a little off the normal one, so that there is an error at all
        skewed = lambda x: density(x) + 0.3 * np.tanh(x[:, 0])  # noqa: E731
        found.append(log_integral(x, skewed(x), skewed, tau=1.0, rng=np.random.default_rng([4, seed])))
    values, errors = np.array(found).T
    assert 0.5 < values.std() / errors.mean() < 2.0
    assert abs(values.mean() - expected) < 0.3
