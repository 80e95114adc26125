"""Integrals over g: curves against each model's own integral, stated digits against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpmath import mp as _mp

from imubayes.algebra.factor import Factor
from imubayes.inference.prior import HyperG, ZellnerSiow
from imubayes.inference.summary import Summary
from imubayes.selection import evidence
from imubayes.selection.enumerate import enumerate_models

mp: Any = _mp
P = 9


def _summary(rows: int) -> Summary:
    """Independent columns of unit variance with effects of 3, 1.5 and 0 sd, in turn."""
    R = math.sqrt(rows) * np.eye(P + 1)
    R[:-1, -1] = np.resize([3.0, 1.5, 0.0], P)
    return Summary(Factor(tuple(f"x{j}" for j in range(P)), R, rows))


@pytest.mark.parametrize("rows", [60, 20_000, 1_000_000])
@pytest.mark.parametrize("prior", [HyperG(3.0), ZellnerSiow(1.0)])
def test_curves_keep_the_digits_that_they_state_however_many_the_rows(rows, prior, monkeypatch):
    """With 1e6 rows a model that matters leaves all but 1e-5 of the squares: where curves are steep."""
    s = _summary(rows)
    exact = enumerate_models(s, prior)
    monkeypatch.setattr(evidence, "CURVES", 1)
    found = enumerate_models(s, prior)
    assert found.quadrature < 1e-6
    assert abs(found.log_evidence - exact.log_evidence) <= found.quadrature
    np.testing.assert_allclose(found.inclusion, exact.inclusion, atol=2.0 * found.quadrature)


@pytest.mark.parametrize("a", [2.01, 3.0, 40.0])
@pytest.mark.parametrize(("n", "noise"), [(12, 1.0), (60, 1e-4)])
def test_hyper_g_states_no_more_digits_than_the_hypergeometric_function_bears_out(a, n, noise):
    """Liang et al. (2008): ``BF = (a - 2)/(k + a - 2) 2F1(n/2, 1; (k + a)/2; R^2)``, here of one column."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=n)
    y = x + noise * rng.normal(size=n)
    found = enumerate_models(Summary.from_arrays(x[:, None], y, ("x",)), HyperG(a))
    with mp.workdps(40):
        X, Y = [mp.mpf(v) for v in x.tolist()], [mp.mpf(v) for v in y.tolist()]
        share = mp.fdot(X, Y) ** 2 / (mp.fdot(X, X) * mp.fdot(Y, Y))
        factor = (mp.mpf(a) - 2) / (mp.mpf(a) - 1) * mp.hyp2f1(mp.mpf(n) / 2, 1, (1 + mp.mpf(a)) / 2, share)
        inclusion = float(factor / (1 + factor))
    assert abs(found.inclusion[0] - inclusion) <= 10.0**-found.digits.inclusion
    assert abs(found.inclusion[0] - inclusion) <= 1e-10
