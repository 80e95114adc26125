"""Columns that are in every model, by another route: enumeration of dense regressions at one noise scale."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np
import pytest

from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import average

NAMES = ("s", "t", "a", "b", "c")
SD = np.array([2.0, 0.5, 1.0, 0.3, 1.5])


def _rows(seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(25, 5)) + rng.normal(size=(25, 1))
    return X, X @ [1.0, 0.1, 0.4, 0.0, 0.0] + rng.normal(size=25)


def _dense(scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sd of all columns over the 2^3 models that hold s and t."""
    X, y = _rows()
    logs, means, seconds = [], [], []
    for k in range(4):
        for chosen in combinations(range(2, 5), k):
            inside = [0, 1, *chosen]
            A, D = X[:, inside], np.diag(SD[inside] ** 2)
            V = scale**2 * np.eye(len(y)) + A @ D @ A.T
            gain = D @ A.T @ np.linalg.inv(V)
            mean, covariance = gain @ y, D - gain @ A @ D
            log_density = -0.5 * (y @ np.linalg.solve(V, y) + np.linalg.slogdet(V)[1])
            logs.append(log_density - np.log(4.0 * comb(3, k)))
            full = np.zeros((2, 5))
            full[:, inside] = mean, np.diag(covariance) + mean**2
            means.append(full[0])
            seconds.append(full[1])
    weight = np.exp(np.array(logs) - max(logs))
    weight /= weight.sum()
    mean = weight @ means
    return mean, np.sqrt(weight @ seconds - mean**2)


@pytest.mark.parametrize("scale", [0.8, 1.3])
def test_columns_in_every_model_have_the_moments_of_dense_regressions(scale):
    summary = Summary.from_arrays(*_rows(), NAMES)
    found = enumerate_models(summary, ScalePrior(SD), always=("s", "t"), scale=scale)
    mean, sd = _dense(scale)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-10)
    np.testing.assert_allclose(found.sd, sd, rtol=1e-10)


def test_columns_in_every_model_average_over_noises_like_the_others():
    summary = Summary.from_arrays(*_rows(), NAMES)
    each = [enumerate_models(summary, ScalePrior(SD), always=("s", "t"), scale=s) for s in (0.8, 1.3)]
    both = average(each, np.array([0.0, 1.0]))
    share = [weight for weight, _ in both.parts]
    mean = share @ np.array([m.mean for m in each])
    second = share @ np.array([m.mean**2 + m.sd**2 for m in each])
    np.testing.assert_allclose(both.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(both.sd, np.sqrt(second - mean**2), rtol=1e-10)
