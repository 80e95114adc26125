"""Algebra of the triangular factor: all that a linear Gaussian model can learn, in (p + 1)^2 numbers.

Convention: R is upper triangular with ``R'R = [X y]'[X y]`` of the whitened rows. Its last column holds
``z = Q'y`` on top and the residual norm ``rho`` at the bottom::

    R = | R_x  z  |
        |  0  rho |

The factor of two sets of rows is the factor of their stacked factors. The Gram matrix X'X is never formed:
it would square the condition number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, Extended, FloatArray, back_substitute, powers_of_two
from imubayes.algebra.digits import Digits, bounds, digits_within, norms, rounding_of
from imubayes.errors import UnobservableError

ROWS_AT_ONCE = 4096
"""Rows that are taken at a time: they fit the cache, and the factors are then stacked."""

TILE = 8192
"""Numbers (rows times columns) in one Householder sweep: OpenBLAS leaves so few to one thread. More threads
gain nothing on a narrow block, and on a busy machine they wait for each other 20 times as long."""

FAR = 1e100
"""Size of a column beyond which, and below whose inverse, it is scaled before it is factored."""

EXTENDED_ROWS = 4096
"""Up to so many rows the factor is computed in extended precision: of more, it is refined where that pays."""

SCALE_STEPS = 5
"""Fixed-point steps of the noise scale: each gains a digit or more."""

PLENTY = 2
"""Rows for each column from which least squares says how strong the noise is."""

VANISHED = 1e-12
"""A column of which less is left beside the others, relative to its norm, is rounding of the input."""

FAINT = 1e-3
"""Effect of a combination of columns at its prior sd, over the sd of the noise, that no fit shows: finite
differences are alike to less."""

TAKES_PART = 0.03
"""Smallest share of a vanished column that makes another one part of what it looks like."""


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """Triangular factor of whitened rows ``[X y]``.

    Attributes
    ----------
    names : the p columns of X.
    R : (p + 1, p + 1) upper triangular.
    n : rows that went in.
    log_det : log determinant of the noise covariance that whitened them; 0 for rows given as white.
    rest : what R lost when it was rounded to double, (p + 1, p + 1); 0 where it was computed in double.
    """

    names: tuple[str, ...]
    R: FloatArray
    n: int
    log_det: float = 0.0
    rest: FloatArray | float = 0.0

    @property
    def p(self) -> int:
        """Number of columns of X."""
        return len(self.names)

    @property
    def column_norms(self) -> FloatArray:
        """(p,) norms of the whitened columns."""
        return norms(self.R[:, :-1])

    @property
    def rounding(self) -> float:
        """Relative rounding of the columns' norms that R and what it lost stand for."""
        if isinstance(self.rest, float):
            return rounding_of(self.n, self.p)
        return rounding_of(self.n, self.p, float(np.finfo(np.longdouble).eps))


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """Ordinary least squares from a factor.

    Attributes
    ----------
    mean, sd : (p,) coefficients and their standard deviations, noise scale estimated; sd is inf where no row
        is left to estimate it from.
    rss : residual sum of squares; 0 or inf where it leaves the range of doubles, which mean and sd do not.
    dof : rows minus columns.
    digits : that can be trusted of mean and sd; those of an evidence that is not there are 0.
    """

    mean: FloatArray
    sd: FloatArray
    rss: float
    dof: int
    digits: Digits


def factor_of(X: FloatArray, y: FloatArray, names: Sequence[str], *, log_det: float = 0.0) -> Factor:
    """Factor of rows X (n, p) and responses y (n,) that are white already.

    `log_det` is the log determinant of the covariance that whitened them.

    Examples
    --------
    >>> f = factor_of(np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]]), np.array([1.0, 2.0, 3.0]), ("one", "x"))
    >>> least_squares(f).mean.round(12).tolist()
    [1.0, 1.0]
    """
    n = len(y)
    if n <= EXTENDED_ROWS:
        return _in_halves(_householder(np.column_stack((X, y))), tuple(names), n, log_det)

    def blocks() -> Iterator[FloatArray]:
        return (np.column_stack((X[i:j], y[i:j])) for i, j in row_blocks(n))

    R = triangular(blocks(), len(names) + 1)
    sharp = sharpened(R, blocks)
    if sharp is None:
        return Factor(tuple(names), R, n, log_det)
    return _in_halves(sharp, tuple(names), n, log_det)


def _in_halves(R: Extended, names: tuple[str, ...], n: int, log_det: float) -> Factor:
    """Factor rounded to double, with what that loses beside it."""
    rounded = R.astype(np.float64)
    return Factor(names, rounded, n, log_det, (R - rounded).astype(np.float64))


def sharpened(R: FloatArray, blocks: Callable[[], Iterable[FloatArray]]) -> Extended | None:
    """Refined factor of the rows in `blocks` whose factor R is, or None where that would gain nothing."""
    from imubayes.algebra.refinement import refined, worth_refining

    return refined(R, blocks()) if worth_refining(R) else None


def _householder(rows: NDArray[np.floating], together: int = 0) -> Extended:
    """Triangular factor by Householder reflections in extended precision.

    Rows that come so many `together` begin with a zero more than those before them. Small ill-conditioned
    problems with large residuals (NIST's Wampler5) lose log10(cond) digits to the rounding of Q'y; the longer
    mantissa of ``np.longdouble`` gives them back where the platform has one.
    """
    A = rows.astype(np.longdouble)
    n, width = A.shape
    for k in range(min(n - 1, width)):
        left = slice(k, (k + 1) * together or n)
        v = A[left, k].copy()
        peak = np.abs(v).max()
        if peak == 0.0:
            continue
        v /= peak
        v[0] += np.copysign(np.sqrt(v @ v), v[0])
        A[left, k:] -= np.outer(v, (2.0 / (v @ v)) * (v @ A[left, k:]))
    upper = np.triu(A[:width])
    return np.pad(upper, ((0, width - upper.shape[0]), (0, 0)))


def row_blocks(n: int, rows: int | None = None) -> Iterator[tuple[int, int]]:
    """(start, stop) of consecutive blocks that cover `n` rows, by default `ROWS_AT_ONCE` in each."""
    rows = rows or ROWS_AT_ONCE
    return ((i, min(i + rows, n)) for i in range(0, n, rows))


def triangular(blocks: Iterable[FloatArray], width: int) -> FloatArray:
    """Upper triangular factor, (width, width), of rows that come in blocks.

    Householder reflections within a block; the factors of the blocks are stacked. Where squares of a column
    could over- or underflow, columns are scaled by powers of two, which changes no digit.
    """
    R = np.zeros((width, width))
    for rows in blocks:
        stacked = np.concatenate((R, rows)) if R.any() else rows
        upper = _tiled(stacked)
        size = np.abs(upper).max(axis=0, initial=0.0)
        if stacked[:, ~((size > 1.0 / FAR) & (size < FAR))].any():
            scale = powers_of_two(np.abs(stacked).max(axis=0))
            upper = _tiled(stacked / scale) * scale
        R[: len(upper)] = upper
        R[len(upper) :] = 0.0
    return R


def _tiled(rows: FloatArray) -> FloatArray:
    """Triangular factor of a tall block: its tiles' factors are stacked until they are one tile."""
    width = rows.shape[1]
    height = max(TILE // width, 2 * width)
    while len(rows) > height:
        whole = len(rows) // height * height
        upper = np.asarray(np.linalg.qr(rows[:whole].reshape(-1, height, width), mode="r"))
        rows = np.concatenate((upper.reshape(-1, width), rows[whole:]))
    return np.asarray(np.linalg.qr(rows, mode="r"))


def add(*factors: Factor) -> Factor:
    """Factor of the rows of all, of the same columns; in extended precision, so that it costs no digit."""
    names, width = factors[0].names, factors[0].p + 1
    if other := next((f for f in factors if f.names != names), None):
        raise ValueError(f"factors of different columns cannot be added: {names} and {other.names}")
    if len(factors) == 1:
        return factors[0]
    n, log_det = sum(f.n for f in factors), sum(f.log_det for f in factors)
    R = np.stack([f.R for f in factors], axis=1, dtype=np.longdouble)  # row by row of all
    for k, f in enumerate(factors):
        R[:, k] += f.rest
    scale = powers_of_two(np.abs(R).max(axis=(0, 1)).astype(np.float64))
    upper = _householder((R / scale).reshape(-1, width), len(factors)) * scale
    made = _in_halves(upper, names, n, log_det)
    return made if all(isinstance(f.rest, np.ndarray) for f in factors) else replace(made, rest=0.0)


def reorder(f: Factor, names: Sequence[str]) -> Factor:
    """Factor of the named columns, in the order given; columns that are not named leave the model."""
    order = [f.names.index(name) for name in names]
    return Factor(tuple(names), triangular((f.R[:, [*order, f.p]],), len(order) + 1), f.n, f.log_det)


def with_prior_rows(R: FloatArray, rows: FloatArray) -> FloatArray:
    """Factor of R with ``diag(rows)`` of the prior stacked under it (zero response)."""
    prior = np.column_stack((np.diag(rows), np.zeros(len(rows))))
    return triangular((np.concatenate((R, prior)),), len(R))


def noise_scale(f: Factor, sd: FloatArray) -> float:
    """Scale of the noise of whitened rows: 1 where the whitening was right.

    From the residual of least squares; where the rows are few, from what a fit within the normal prior of the
    coefficients, sd (p,), leaves.

    Examples
    --------
    >>> f = factor_of(np.ones((4, 2)), np.array([1.0, -1.0, 1.0, -1.0]), ("a", "b"))
    >>> round(noise_scale(f, np.ones(2)) ** 2, 9)  # 4 rows and one combination of columns
    1.333333333
    """
    if f.n >= PLENTY * f.p:
        # a combination of columns that does nothing takes a share of the residual, which is up to rounding
        left, size = abs(float(f.R[-1, -1])), f.column_norms
        with np.errstate(invalid="ignore", over="ignore"):  # a prior may be flat, also of a column of zeros
            most = np.fmin(size * sd / (left / math.sqrt(f.n) or 1.0), FAINT / VANISHED)
        U, s, _ = np.linalg.svd(f.R[:-1, :-1] / np.where(size > 0.0, size, 1.0) * most)
        idle = s <= FAINT
        left = math.hypot(left, *(U[:, idle].T @ f.R[:-1, -1]))
        return left / math.sqrt(f.n - np.count_nonzero(~idle)) or 1.0
    scale = 1.0
    for _ in range(SCALE_STEPS):
        scale = abs(float(with_prior_rows(f.R, scale / sd)[-1, -1])) / math.sqrt(f.n) or 1.0
    return scale


def posterior(f: Factor, sd: FloatArray, scale: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Mean and sd (p,) of the coefficients of all columns under a normal prior of these sds (p,)."""
    mean, root = posterior_root(f, sd, scale)
    return mean, np.linalg.norm(root, axis=1)


def posterior_root(f: Factor, sd: FloatArray, scale: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) as `posterior`, and a root S (p, p) of the covariance ``S S'``."""
    T = with_prior_rows(f.R, scale / sd)
    inverse = invert_triangular(T[:-1, :-1])
    return inverse @ T[:-1, -1], scale * inverse


def least_squares(f: Factor) -> LeastSquares:
    """Coefficients, standard deviations and residual sum of squares.

    It is an `UnobservableError` if a column vanishes to rounding once the others before it are accounted for,
    or there are fewer rows than columns.
    """
    lost = vanished(f.R)
    if f.n < f.p or lost.any():
        raise _dependent(f, lost)
    dof = f.n - f.p
    whole = f.R.astype(np.longdouble) + f.rest
    left = abs(whole[-1, -1])
    scale = left / np.sqrt(np.longdouble(dof)) if dof > 0 else np.longdouble(np.inf)
    solved = back_substitute(whole[:-1, :-1], np.column_stack((whole[:-1, -1], np.eye(f.p))))
    size = np.abs(solved[:, 1:]).max(axis=1, initial=0.0)
    sd = scale * (size * np.sqrt(np.sum((solved[:, 1:] / size[:, None]) ** 2, axis=1)))
    largest = max(np.abs(solved[:, 0]).max(initial=0.0), sd.max(initial=0.0) if dof > 0 else 0.0)
    if largest > np.finfo(np.float64).max:
        raise UnobservableError(
            "coefficients leave the range of doubles (1e308): give columns or response in other units",
            f.names,
        )
    mean, sd = solved[:, 0].astype(np.float64), sd.astype(np.float64)
    with np.errstate(over="ignore"):
        rss = (left * left).astype(np.float64)
    return LeastSquares(mean, sd, float(rss), dof, _digits(f, mean, sd))


def vanished(R: FloatArray) -> BoolArray:
    """Which columns (p,) depend on those before them, to rounding."""
    return np.abs(np.diag(R)[:-1]) <= VANISHED * norms(R[:, :-1])


def _dependent(f: Factor, lost: BoolArray) -> UnobservableError:
    """What to say of columns that others stand for."""
    terms = tuple(name for name, gone in zip(f.names, lost, strict=True) if gone)
    told, size = "", f.column_norms
    for k in np.flatnonzero(lost).tolist():
        if size[k] == 0.0:
            told += f"; {f.names[k]} is zero in every row"
            continue
        others = np.flatnonzero(~lost[:k])
        A = f.R[:k, [*others, k]] / size[[*others, k]]
        share = np.linalg.lstsq(A[:, :-1], A[:, -1])[0]
        made = [f.names[j] for j, part in zip(others, share, strict=True) if abs(part) >= TAKES_PART]
        told += f"; {f.names[k]} is a combination of {', '.join(made)}" if made else ""
    return UnobservableError(
        f"least squares needs independent columns: {f.n} rows do not tell"
        f" {', '.join(terms) or f'{f.p} terms'} from the others{told};"
        " leave some out, or add rows that differ",
        terms,
    )


def _digits(f: Factor, mean: FloatArray, sd: FloatArray) -> Digits:
    found = bounds(f.R, f.rounding)
    against = np.maximum(np.abs(mean), sd)
    refined = f.n > EXTENDED_ROWS and isinstance(f.rest, np.ndarray)
    turned = rounding_of(f.n, f.p) * math.sqrt(f.n) if refined else 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(np.isinf(against), found.coefficients / np.abs(mean), found.coefficients / against)
    return Digits(_fewest(error + turned), _fewest(found.sd + turned), 0, 0)


def _fewest(errors: FloatArray) -> int:
    return min(map(digits_within, np.nan_to_num(errors, nan=np.inf).tolist()), default=0)


def solve_triangular(R: FloatArray, b: FloatArray) -> FloatArray:
    """Solve ``R x = b`` for upper triangular R."""
    from scipy.linalg import solve_triangular as solve

    return solve(R, b, check_finite=False)


def invert_triangular(R: FloatArray) -> FloatArray:
    """Inverse of an upper triangular matrix; its rows hold the standard deviations."""
    return solve_triangular(R, np.eye(R.shape[0]))
