"""A sparse-regression problem in detectable effects: the units in which one threshold suits every term.

The *detectable effect* of a term is the posterior sd of its coefficient under the full library, with the
physical prior of every coefficient. It is what the noise leaves unknown of the term when nothing else is
assumed to be zero: a coefficient of 3 effects is 3 sd from zero, whatever its unit, the drive of the test or
its likeness to other columns. The sd of a term on its own, ``1/|x_j|``, would not do: it calls a term
detectable that a likeness to others hides. The prior keeps the effect of a term in an exact null direction
finite (without it least squares has none) and changes nothing where the data speak.

With the rows of the prior stacked under the data's, the inverse of the scaled triangular factor has rows of
length one, so that nothing in it is badly scaled. They take the place of the ridge of pysindy's optimizers:
one strength for all coefficients would shrink the strong ones so far that their neighbours fill the gap.

The paths are the supports that pysindy's optimizers go through, by threshold or by number of terms. Each runs
on ``A = R`` and ``b = z`` of a triangular factor, which has the residuals of the rows but for a constant, so
that what it gives is what it gives on the rows themselves. Only SSR's and FROLS's own picks look at that
constant or at single terms' shares; they choose badly, and are not used: the path is taken, and the evidence
chooses on it. Two facts make a whole path one fit:

- STLSQ scales: with ``b/t`` and threshold 1 it does what it does with b and threshold t, so that every
  threshold is one of several responses.
- SR3 takes a weight for each coefficient of each response.

pysindy's step of unbiasing is left out: it runs through a least squares that cuts singular values at 1e-6,
and the supports are refitted with the factor anyway.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import Factor

if TYPE_CHECKING:
    from pysindy.optimizers import BaseOptimizer

EVEN = 1e-9
"""Log evidences that differ by less are equal: a term that was not excited changes them by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """Least squares on the candidates, all other columns integrated out.

    Attributes
    ----------
    names : p candidates that the rows excite.
    R : (p + 1, p + 1) triangular factor, rows of the prior included: a unit is one effect of a column, and
        one sd of the noise of a row.
    prior : (p,) rows of the prior, effect over prior sd.
    unit : (p,) detectable effects, SI.
    """

    names: tuple[str, ...]
    R: FloatArray
    prior: FloatArray
    unit: FloatArray


def effects_of(f: Factor, sd: FloatArray, candidates: Sequence[str], scale: float) -> Effects:
    """Bring the candidates to detectable effects.

    Parameters
    ----------
    f : of the whitened rows; columns that are not candidates are in every model.
    sd : (p,) prior sds of all its columns, SI.
    candidates : among its columns; one that is zero in every row is left out.
    scale : of the noise.

    Examples
    --------
    >>> f = algebra.factor_of(np.diag([100.0, 1.0]), np.array([300.0, 0.0]), ("strong", "weak"))
    >>> e = effects_of(f, np.array([10.0, 10.0]), f.names, 1.0)
    >>> e.unit.round(4).tolist()
    [0.01, 0.995]
    >>> refitted(e, np.array([[True, False]])).round(2).tolist()
    [[300.0, 0.0]]
    """
    excited = dict(zip(f.names, f.column_norms > 0.0, strict=True))
    prior_sd = dict(zip(f.names, sd.tolist(), strict=True))
    names = tuple(name for name in candidates if excited[name])
    always = tuple(name for name in f.names if name not in candidates)
    order = (*always, *names)
    rows = np.array([scale / prior_sd[name] for name in order])
    R = algebra.with_prior_rows(algebra.reorder(f, order).R, rows)[len(always) :, len(always) :] / scale
    unit = np.linalg.norm(algebra.invert_triangular(R[:-1, :-1]), axis=1)
    R = np.ascontiguousarray(R * np.append(unit, 1.0))
    return Effects(names, R, unit * rows[len(always) :] / scale, unit)


def log_evidence(e: Effects, supports: BoolArray) -> FloatArray:
    """Log marginal likelihood (m,) of each support (m, p), up to a constant; the noise scale is known."""
    from imubayes.selection.kernels import solutions

    *_, left, log_det = solutions(e.R, supports)
    return np.sum(supports * np.log(e.prior), axis=1) - 0.5 * left - log_det


def refitted(e: Effects, supports: BoolArray) -> FloatArray:
    """Coefficients (m, p) of each support, in effects: least squares on data and prior, zero outside."""
    from imubayes.selection.kernels import solutions

    return solutions(e.R, supports)[0]


def best_of(supports: BoolArray, score: FloatArray) -> int:
    """Index of the best score; of equal ones, of the smallest support, in the middle of where it stands."""
    even = np.flatnonzero(score >= score.max() - EVEN)
    count = supports[even].sum(axis=1)
    smallest = even[count == count.min()]
    return int(smallest[len(smallest) // 2])


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
