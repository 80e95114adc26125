"""pysindy's optimizers on a triangular factor: the supports on the path of each, by threshold or by size.

STLSQ, SR3 and SSR are pysindy's own; of FROLS the selection is written out.

Each runs on ``A = R`` and ``b = z`` of the factor, which has the residuals of the rows but for a constant, so
that what it gives is what it gives on the rows themselves. Only SSR's and FROLS's own picks look at that
constant or at single terms' shares; they choose badly, and are not used. Two facts make a whole path one fit:

- STLSQ scales: with ``b/t`` and threshold 1 it does what it does with b and threshold t, so that every
  threshold is one of several responses.
- SR3 takes a weight for each coefficient of each response.

pysindy's step of unbiasing is left out: it runs through a least squares that cuts singular values at 1e-6,
and the supports are refitted with the factor anyway. So are all checks of what is fitted, which would take
most of the time of a thousand fits of twenty columns: these are finite and independent.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from pysindy import optimizers
from scipy.linalg import get_lapack_funcs

from imubayes.algebra import BoolArray, FloatArray

gels, potrs = get_lapack_funcs(("gels", "potrs"))

RELAXATION = 1.0
"""SR3's nu, pysindy's default: in effects the columns of an orthogonal design have length one."""

SETTLED = 1e-3
"""Change in effects below which SR3 has converged."""

MOST_STEPS = 500
"""Steps of SR3: the way to its limit shrinks by p/(p + 1) a step where columns are as alike as can be."""

NOTHING = 1e-28
"""Share of the response's square below which a column explains rounding."""


def stlsq(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sequentially thresholded least squares: supports (m, p) at thresholds (m,) in effects."""
    optimizer = STLSQ(threshold=1.0, alpha=0.0, max_iter=A.shape[1] + 1)
    return optimizer.fit(A, b[:, None] / strength).coef_ != 0.0


def sr3(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sparse relaxed regularized regression with the L0 penalty: supports (m, p) at thresholds (m,)."""
    weight: Any = np.repeat(strength[:, None] ** 2 / (2.0 * RELAXATION), A.shape[1], axis=1)
    optimizer = SR3(
        reg_weight_lam=weight,
        regularizer="weighted_l0",
        relax_coeff_nu=RELAXATION,
        tol=SETTLED,
        max_iter=MOST_STEPS,
    )
    return optimizer.fit(A, np.repeat(b[:, None], len(strength), axis=1)).coef_ != 0.0


def ssr(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Stepwise sparse regression: supports (m, p) with numbers of terms (m,), from all terms downwards."""
    p = A.shape[1]
    optimizer = SSR(alpha=0.0, max_iter=max(1, p - int(strength.min())))
    return _by_size((c[0] != 0.0 for c in optimizer.fit(A, b[:, None]).history_), p, strength)


def frols(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Forward orthogonal least squares: supports (m, p) with numbers of terms (m,), from none upwards.

    It selects what pysindy's does, without a regression at each step for coefficients that nobody asks for.
    """
    left, columns, chosen = A, np.arange(A.shape[1]), np.zeros(A.shape[1], dtype=np.bool_)
    visited = list[BoolArray]()
    while len(columns) and len(visited) < strength.max():
        square = np.einsum("ij,ij->j", left, left)
        if not (square > 0.0).all():
            raise ValueError("columns are linearly dependent")
        share = (b @ left) ** 2 / square
        best = int(np.argmax(share))
        if not share[best] > NOTHING * (b @ b):
            break
        chosen[columns[best]] = True
        visited.append(chosen.copy())
        others = np.arange(len(columns)) != best
        taken, left, columns = left[:, best], left[:, others], columns[others]
        left = left - np.outer(taken, taken @ left / square[best])
    return _by_size(visited, A.shape[1], strength)


PATHS: Mapping[str, Callable[[FloatArray, FloatArray, FloatArray], BoolArray]] = {
    "stlsq": stlsq,
    "sr3": sr3,
    "ssr": ssr,
    "frols": frols,
}
"""The optimizers, by the name that a report gives them."""


def _by_size(visited: Iterable[BoolArray], p: int, strength: FloatArray) -> BoolArray:
    """Supports of the sizes asked for; none and all terms need no optimizer.

    An optimizer that stops short of a size, with nothing left to explain, has its largest one below.
    """
    by_size = {int(support.sum()): support for support in visited}
    by_size |= {0: np.zeros(p, dtype=np.bool_), p: np.ones(p, dtype=np.bool_)}
    return np.array([by_size[max(n for n in by_size if n <= k)] for k in strength.astype(int).tolist()])


class Unchecked(optimizers.BaseOptimizer):
    """Optimizer on finite independent columns, without a ridge and without warnings.

    That a threshold leaves nothing is one end of a path.
    """

    def fit(self: Any, x_: FloatArray, y: FloatArray) -> Any:
        """Begin with least squares on all columns (n, p), of each of the responses (n, q)."""
        self.coef_ = least_squares(x_, y).T
        self.ind_, self.history_ = np.ones(self.coef_.shape, dtype=bool), [self.coef_]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._reduce(x_, y)
        return self

    def _regress(self, x: FloatArray, y: FloatArray, *_: object) -> FloatArray:
        return least_squares(x, y).T


def least_squares(X: FloatArray, y: FloatArray) -> FloatArray:
    """Coefficients (p,) or (p, q) of independent columns X (n, p), by QR."""
    return gels(X, y)[1][: X.shape[1]]


class STLSQ(Unchecked, optimizers.STLSQ):
    """Sequentially thresholded least squares."""


class SSR(Unchecked, optimizers.SSR):
    """Stepwise sparse regression; where no effect is left, its path has ended."""

    def _reduce(self: Any, x: Any, y: Any) -> None:
        whole = self.coef_
        super()._reduce(x, y)
        self.history_[0] = whole  # which pysindy 2.1 overwrites by the last

    def _coefficient_value(self, coef: FloatArray) -> tuple[FloatArray, int]:
        return super()._coefficient_value(coef) if coef.any() else (coef, 0)


class SR3(Unchecked, optimizers.SR3):
    """Sparse relaxed regularized regression, of which nobody asks how its objective falls."""

    def _objective(self, *_: object) -> float:
        return 0.0

    def _update_full_coef(self, cho: Any, x_transpose_y: FloatArray, coef_sparse: FloatArray) -> FloatArray:
        root, lower = cho
        return potrs(root, x_transpose_y + coef_sparse / self.relax_coeff_nu, lower=lower)[0]
