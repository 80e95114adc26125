"""Minimum of smooth costs against a simplex that sees no gradient, within ends and at them."""

import numpy as np
import pytest
from scipy.optimize import minimize

from imubayes.inference.minimum import minimum

WIDTH = np.array([0.6, 0.9, 1.2])


def valley(x):
    """Steep along one logarithm and flat along another, where the cost bends down before it rises."""
    u, v, w = x
    level = 200.0 * (np.cosh(u - v) - 1.0) + 3.0 * (np.log1p(np.exp(v)) - 0.6 * v) + 0.5 * w**2
    bent = 0.7 * np.exp(-((w - 1.0) ** 2))
    steep, rise = 200.0 * np.sinh(u - v), 3.0 * (1.0 / (1.0 + np.exp(-v)) - 0.6)
    return level - bent, np.array([steep, rise - steep, w + 2.0 * bent * (w - 1.0)])


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (2.0, -3.0, 4.0), (-4.0, 4.0, -4.0)], ids=str)
def test_minimum_is_that_of_a_simplex_and_its_covariance_the_inverse_curvature(start):
    ends = np.full(3, -5.0), np.full(3, 5.0)
    best, covariance = minimum(valley, np.array(start), np.full(3, 50.0), ends)
    to_rounding = {"xatol": 1e-8, "fatol": 1e-14, "maxiter": 5000, "maxfev": 5000}
    simplex = minimize(lambda x: valley(x)[0], best + 0.1, method="Nelder-Mead", options=to_rounding)
    np.testing.assert_allclose(best, simplex.x, atol=1e-5)
    steps = 1e-5 * np.eye(3)
    H = np.array([valley(best + step)[1] - valley(best - step)[1] for step in steps]) / 2e-5
    # differences over 1e-4 are off by half of that times the third derivative
    np.testing.assert_allclose(covariance, np.linalg.inv(H), rtol=3e-4, atol=3e-4)


def test_minimum_beyond_an_end_is_at_the_end_and_the_others_are_found_along_it():
    ends = np.array([-5.0, 1.0, -5.0]), np.full(3, 5.0)
    best, _ = minimum(valley, np.zeros(3), WIDTH, ends)
    assert best[1] == 1.0  # by itself it is at ln 1.5
    np.testing.assert_allclose(best[0], 1.0, atol=1e-6)
    np.testing.assert_allclose(valley(best)[1][2], 0.0, atol=1e-4)


def test_covariance_is_nowhere_wider_than_the_prior():
    flat = lambda x: (float(1e-3 * x @ x), 2e-3 * x)  # noqa: E731
    _, covariance = minimum(flat, np.ones(3), WIDTH, (np.full(3, -5.0), np.full(3, 5.0)))
    np.testing.assert_allclose(covariance, np.diag(WIDTH**2), rtol=1e-12)


def test_of_several_starts_the_lowest_minimum_is_taken():
    wells = lambda x: (float((x @ x - 1.0) ** 2 + 0.1 * x.sum()), 4.0 * (x @ x - 1.0) * x + 0.1)  # noqa: E731
    ends = np.full(1, -2.0), np.full(1, 2.0)
    for starts in ([[1.5], [-1.5]], [[-1.5], [1.5]]):
        best, _ = minimum(wells, np.array(starts), np.full(1, 9.0), ends)
        assert best[0] == pytest.approx(-1.0122, abs=1e-3)
    assert minimum(wells, np.array([1.5]), np.full(1, 9.0), ends)[0][0] > 0.9


def test_a_step_to_where_the_cost_is_beyond_a_double_is_taken_back():
    def cost(x):
        return float(np.exp(x[0] ** 2)), 2.0 * x * np.exp(x**2)

    far = np.array([[1e6]])
    best, covariance = minimum(
        cost, np.array([0.1]), np.ones(1), (np.full(1, -np.inf), np.full(1, np.inf)), far
    )
    assert best == pytest.approx(0.0, abs=1e-6)
    assert covariance == pytest.approx(0.5, rel=1e-3)
