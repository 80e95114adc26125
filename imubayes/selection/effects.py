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

The paths are the supports that the optimizers of pysindy go through, by threshold or by number of terms. Each
runs on ``A = R`` and ``b = z`` of a triangular factor, which has the residuals of the rows but for a
constant, so that what it gives is what it gives on the rows themselves. Only SSR's and FROLS's own picks look
at that constant or at single terms' shares; they choose badly, and are not used: the path is taken, and the
evidence chooses on it. The supports are gone through here and not in pysindy, which takes ten times as long
over a hundred resampled campaigns. Its step of unbiasing is left out: the supports are refitted with the
factor anyway.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import Factor

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

NOTHING = 1e-24
"""Share of the response, squared, below which a term of FROLS explains nothing but rounding."""

RELAXATION = 1.0
"""SR3's nu, pysindy's default: in effects the columns of an orthogonal design have length one."""

SETTLED = 1e-3
"""Change in effects below which SR3 has converged."""

MOST_STEPS = 500
"""Steps of SR3: the way to its limit shrinks by p/(p + 1) a step where columns are as alike as can be."""


def stlsq(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sequentially thresholded least squares: supports (m, p) at thresholds (m,) in effects."""
    inside = np.ones((len(strength), len(b)), dtype=np.bool_)
    while True:
        large = np.abs(_least_squares(A, b, inside)) >= strength[:, None]
        if np.array_equal(large & inside, inside):
            return inside
        inside &= large


def sr3(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Sparse relaxed regularized regression with the L0 penalty: supports (m, p) at thresholds (m,)."""
    inverse = np.linalg.inv(A.T @ A + np.eye(len(b)) / RELAXATION)
    whole, relaxed = (inverse @ (A.T @ b))[:, None], inverse / RELAXATION
    sparse = np.repeat(np.linalg.solve(A, b)[:, None], len(strength), axis=1)
    for _ in range(MOST_STEPS):
        full = whole + relaxed @ sparse
        before, sparse = sparse, np.where(np.abs(full) > strength, full, 0.0)
        if np.linalg.norm(sparse - before) < SETTLED * RELAXATION:
            break
    return sparse.T != 0.0


def ssr(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Stepwise sparse regression: supports (m, p) with numbers of terms (m,), from all terms downwards."""
    inside = np.ones((1, len(b)), dtype=np.bool_)
    visited = [inside[0].copy()]
    while inside.sum() > strength.min():
        size = np.abs(_least_squares(A, b, inside)[0])
        inside[0, np.argmin(np.where(inside[0], size, np.inf))] = False
        visited.append(inside[0].copy())
    return np.array(visited[::-1])[strength.astype(int) - int(visited[-1].sum())]


def frols(A: FloatArray, b: FloatArray, strength: FloatArray) -> BoolArray:
    """Forward orthogonal least squares: supports (m, p) with numbers of terms (m,), from none upwards.

    Where nothing is left to explain, larger sizes have the largest support before, and p that of all terms.
    """
    left, missing, visited = A.copy(), b.copy(), [np.zeros(len(b), dtype=np.bool_)]
    while len(visited) <= min(int(strength.max()), len(b) - 1):
        power = np.einsum("ij,ij->j", left, left)
        gain = np.where(visited[-1], 0.0, (missing @ left) ** 2 / np.where(visited[-1], 1.0, power))
        if gain.max() <= NOTHING * (b @ b):
            break
        best = int(np.argmax(gain))
        unit = left[:, best] / np.sqrt(power[best])
        left -= np.outer(unit, unit @ left)
        missing -= unit * (unit @ missing)
        visited.append(visited[-1] | (np.arange(len(b)) == best))
    path = np.array(visited)[np.minimum(strength.astype(int), len(visited) - 1)]
    path[strength.astype(int) == len(b)] = True
    return path


def _least_squares(A: FloatArray, b: FloatArray, inside: BoolArray) -> FloatArray:
    """Coefficients (m, p) of supports (m, p); zero outside."""
    from imubayes.selection.kernels import solutions

    whole = np.zeros((len(b) + 1, len(b) + 1))
    whole[:-1, :-1], whole[:-1, -1] = A, b
    return solutions(whole, inside)[0]


PATHS: Mapping[str, Path] = {"stlsq": stlsq, "sr3": sr3, "ssr": ssr, "frols": frols}
"""The optimizers, by the name that a report gives them."""

BY_THRESHOLD = frozenset({"stlsq", "sr3"})
"""Optimizers that go over thresholds; the others go over numbers of terms."""
