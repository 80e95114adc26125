"""Paths of pysindy's optimizers: the supports that each goes through, by threshold or by number of terms.

Each runs on ``A = R`` and ``b = z`` of a triangular factor, which has the residuals of the rows but for a
constant, so that what it gives is what it gives on the rows themselves. Only SSR's and FROLS's own picks look
at that constant or at single terms' shares; they choose badly, and are not used: the path is taken, and the
evidence chooses on it. Two facts make a whole path one fit:

- STLSQ scales: with ``b/t`` and threshold 1 it does what it does with b and threshold t, so that every
  threshold is one of several responses.
- SR3 takes a weight for each coefficient of each response.

pysindy's step of unbiasing is left out: it runs through a least squares that cuts singular values at 1e-6,
and the supports are refitted with the factor anyway.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from pysindy.optimizers import BaseOptimizer

Path = Callable[[FloatArray, FloatArray, FloatArray], BoolArray]

RIDGE = {"solver": "svd", "check_input": False}
"""Of scikit-learn's ridge regression: never X'X; checking inputs costs more than solving twenty columns."""

RELAXATION = 1.0
"""SR3's nu, pysindy's default: in effects the columns of an orthogonal design have length one."""

SETTLED = 1e-3
"""Change in effects below which SR3 has converged."""

MOST_STEPS = 500
"""Steps of SR3: the way to its limit shrinks by p/(p + 1) a step where columns are as alike as can be."""


def stlsq(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sequentially thresholded least squares: supports (m, p) at thresholds (m,) in effects."""
    from pysindy.optimizers import STLSQ

    steps = A.shape[1] + 1
    optimizer = STLSQ(threshold=1.0, alpha=0.0, max_iter=steps, ridge_kw=RIDGE, unbias=False)
    return _fitted(optimizer, A, b[:, None] / strength).coef_ != 0.0


def sr3(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sparse relaxed regularized regression with the L0 penalty: supports (m, p) at thresholds (m,)."""
    from pysindy.optimizers import SR3

    weight: Any = np.repeat(strength[:, None] ** 2 / (2.0 * RELAXATION), A.shape[1], axis=1)
    optimizer = SR3(
        reg_weight_lam=weight,
        regularizer="weighted_l0",
        relax_coeff_nu=RELAXATION,
        tol=SETTLED,
        max_iter=MOST_STEPS,
    )
    return _fitted(optimizer, A, np.repeat(b[:, None], len(strength), axis=1)).coef_ != 0.0


def ssr(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Stepwise sparse regression: supports (m, p) with numbers of terms (m,), from all terms downwards."""
    from pysindy.optimizers import SSR

    p = A.shape[1]
    optimizer = SSR(alpha=0.0, max_iter=max(1, p - int(strength.min())), ridge_kw=RIDGE, unbias=False)
    # the first entry of the history is overwritten by the last in pysindy 2.1; it is the full library
    return _by_size((c[0] != 0.0 for c in _fitted(optimizer, A, b).history_[1:]), p, strength)


def frols(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Forward orthogonal least squares: supports (m, p) with numbers of terms (m,), from none upwards."""
    from pysindy.optimizers import FROLS

    p = A.shape[1]
    optimizer = FROLS(alpha=0.0, max_iter=max(1, int(strength.max())), ridge_kw=RIDGE, unbias=False)
    return _by_size((c[0] != 0.0 for c in _fitted(optimizer, A, b).history_), p, strength)


PATHS: Mapping[str, Path] = {"stlsq": stlsq, "sr3": sr3, "ssr": ssr, "frols": frols}
"""The optimizers, by the name that a report gives them."""

BY_THRESHOLD = frozenset({"stlsq", "sr3"})
"""Optimizers that go over thresholds; the others go over numbers of terms."""


def _fitted(optimizer: BaseOptimizer, A: FloatArray, b: FloatArray) -> BaseOptimizer:
    """Fit without pysindy's warnings: that a threshold leaves nothing is one end of a path.

    Nor are parameters checked again at each of the thousand small regressions, which takes half of the time.
    """
    from sklearn import config_context

    with warnings.catch_warnings(), config_context(skip_parameter_validation=True, assume_finite=True):
        warnings.simplefilter("ignore")
        return optimizer.fit(A, b)


def _by_size(visited: Iterable[BoolArray], p: int, strength: FloatArray) -> BoolArray:
    """Supports of the sizes asked for; none and all terms need no optimizer.

    An optimizer that stops short of a size, with nothing left to explain, has its largest one below.
    """
    by_size = {int(support.sum()): support for support in visited}
    by_size |= {0: np.zeros(p, dtype=np.bool_), p: np.ones(p, dtype=np.bool_)}
    return np.array([by_size[max(n for n in by_size if n <= k)] for k in strength.astype(int).tolist()])
