"""References for the extremes: the same doubles in arithmetic of 100 digits.

Nothing of the product's algebra is used. Inner products are exact, each submodel's Gram matrix is brought to
its principal axes, and the logarithm of the noise scale is integrated by the trapezoid rule in half the
product's steps around every peak.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from mpmath import mp as _mp
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from studies.extremes.cases import Stamps

mp: Any = _mp
"""The context makes its functions when it is made, so that its types know none of them."""


DIGITS = 100
"""Decimal digits: the Gram matrix squares a condition number of 1e16 and a signal of 1e15 noise sd."""

COARSE = 0.25
"""Steps of the logarithm of the noise scale in which its peaks are looked for."""

REACH = 40
"""Coarse steps beyond the full fit's and the data's scale in which they are looked for."""

FLOOR = mp.mpf(10) ** -14
"""Smallest noise scale over the rms of the response that is asked for: where a prior explains fewer rows than
columns exactly, the integral over the logarithm of the scale would not end."""

NEGLIGIBLE = 50.0
"""Log of the share of the largest at which a noise scale no longer counts."""

LOST = 1e-40
"""Square of a singular value that is zero but for the rounding of 100 digits."""

FEW = 9
"""Added to the degrees of freedom in the width of a peak, which few of them make skew."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Least squares: coefficients and their sds (p,)."""

    mean: FloatArray
    sd: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Averaged:
    """Posterior over all submodels (p,), and its log evidence under ``d sigma / sigma``."""

    mean: FloatArray
    sd: FloatArray
    inclusion: FloatArray
    log_evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Products:
    """Exact inner products of n rows, copies counted, in units of powers of two.

    `gram` (p, p) is that of the columns, `cross` p with the response, `square` of the response; `unit` (p +
    1,) are the exponents of two of each column and of the response. `log_det` is of the covariance that
    whitened the rows.
    """

    gram: Any
    cross: list[Any]
    square: Any
    unit: NDArray[np.int64]
    n: int
    log_det: Any = 0


def products(X: FloatArray, y: FloatArray, copies: int = 1) -> Products:
    """Inner products of the doubles of (n, p) and (n,), each row taken `copies` times, in whole numbers."""
    table = np.column_stack((X, y))
    p, unit = X.shape[1], _units(table)
    wholes = [_in_wholes(column) for column in table.T]

    def inner(i: int, j: int) -> Any:
        (a, low), (b, low_b) = wholes[i], wholes[j]
        return mp.ldexp(mp.mpf(copies * int(a @ b)), low + low_b - int(unit[i] + unit[j]))

    with mp.workdps(DIGITS):
        gram = mp.matrix(p, p)
        for i, j in product(range(p), repeat=2):
            gram[i, j] = gram[j, i] if j < i else inner(i, j)
        return Products(gram, [inner(i, p) for i in range(p)], inner(p, p), unit, copies * len(y))


def _in_wholes(column: FloatArray) -> tuple[NDArray[np.object_], int]:
    """Doubles (n,) as whole numbers times a power of two, and its exponent."""
    part, power = np.frexp(column)
    whole, power = np.ldexp(part, 53).astype(np.int64), power.astype(np.int64) - 53
    lowest = int(power[whole != 0].min(initial=0))
    shifted = [int(w) << int(e) - lowest if w else 0 for w, e in zip(whole, power, strict=True)]
    return np.array(shifted, dtype=object), lowest


def _units(table: FloatArray) -> NDArray[np.int64]:
    """Exponents of the powers of two above each column's largest number."""
    return np.frexp(np.abs(table).max(axis=0))[1].astype(np.int64)


def whitened_products(X: FloatArray, y: FloatArray, stamps: Stamps) -> Products:
    """Inner products of rows with coloured noise, whitened by the Cholesky factor of its dense covariance."""
    with mp.workdps(DIGITS):
        columns, unit = _in_powers(X, y)
        L = mp.cholesky(_covariance(stamps))
        whitened = [_forward(L, column) for column in columns]
        log_det = 2 * mp.fsum(mp.log(L[i, i]) for i in range(L.rows))
        return replace(_products(whitened, unit), log_det=log_det)


def _forward(L: Any, b: list[Any]) -> list[Any]:
    """Solve ``L x = b`` for lower triangular L."""
    x: list[Any] = []
    for i, value in enumerate(b):
        x.append((value - mp.fdot((L[i, k] for k in range(i)), x)) / L[i, i])
    return x


def _in_powers(X: FloatArray, y: FloatArray) -> tuple[list[list[Any]], NDArray[np.int64]]:
    """Columns and response in units of powers of two, and the exponents."""
    table = np.column_stack((X, y))
    unit = _units(table)
    scaled = [
        [mp.ldexp(mp.mpf(float(value)), -int(e)) for value in column]
        for column, e in zip(table.T, unit, strict=True)
    ]
    return scaled, unit


def _products(columns: list[list[Any]], unit: NDArray[np.int64]) -> Products:
    *X, y = columns
    p = len(X)
    gram = mp.matrix(p, p)
    for i, j in product(range(p), repeat=2):
        gram[i, j] = mp.fdot(X[i], X[j])
    cross = [mp.fdot(column, y) for column in X]
    return Products(gram, cross, mp.fdot(y, y), unit, len(y))


def _covariance(stamps: Stamps) -> Any:
    """Dense covariance of white noise, first-order processes and a random walk, averaged over each row."""
    t = [mp.mpf(float(x)) for x in stamps.rows.t]
    T = [mp.mpf(float(x)) for x in stamps.rows.duration]
    start, n = t[0] - T[0] / 2, len(t)
    N, B, K = (mp.mpf(float(x)) for x in (stamps.noise.N, stamps.noise.B, stamps.noise.K))
    parts = [(mp.mpf(float(v)) * B * B, mp.mpf(float(tau))) for v, tau in zip(*_parts(stamps), strict=True)]
    C = mp.matrix(n, n)
    for i, j in product(range(n), repeat=2):
        if i == j:
            C[i, i] = N * N / T[i] + K * K * (t[i] - start - T[i] / 6)
            C[i, i] += mp.fsum(
                2 * v * (T[i] / tau + mp.expm1(-T[i] / tau)) / (T[i] / tau) ** 2 for v, tau in parts
            )
            continue
        C[i, j] = K * K * (min(t[i], t[j]) - start)
        C[i, j] += mp.fsum(
            v * mp.exp(-abs(t[i] - t[j]) / tau) * _mean(T[i], tau) * _mean(T[j], tau) for v, tau in parts
        )
    return C


def _parts(stamps: Stamps) -> tuple[list[float], list[float]]:
    return stamps.parts.variance.tolist(), stamps.parts.tau.tolist()


def _mean(duration: Any, tau: Any) -> Any:
    x = duration / tau
    return 2 * mp.sinh(x / 2) / x


def least_squares(given: Products) -> Fit | None:
    """Least squares over all columns; None where they are linearly dependent or the rows too few."""
    p = len(given.cross)
    with mp.workdps(DIGITS):
        try:
            inverse = mp.inverse(given.gram)
        except ZeroDivisionError:
            return None
        if given.n < p or mp.norm(inverse, mp.inf) > mp.mpf(10) ** (DIGITS // 2):
            return None
        mean = [mp.fdot(inverse[j, :], given.cross) for j in range(p)]
        left = given.square - mp.fdot(mean, given.cross)
        variance = abs(left) / (given.n - p) if given.n > p else mp.inf
        sd = [mp.sqrt(variance * inverse[j, j]) for j in range(p)]
        return Fit(_in_units(mean, given), _in_units(sd, given))


def _in_units(values: list[Any], given: Products) -> FloatArray:
    steps = given.unit[-1] - given.unit[:-1]
    return np.array([float(mp.ldexp(v, int(e))) for v, e in zip(values, steps, strict=True)])


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """One submodel on its principal axes in units of the prior: ``d`` (k,) and projections ``w`` (k,).

    `axes` (k, k) holds the axes in its columns, `sd` (k,) the prior's, `log_prior` the model's.
    """

    inside: tuple[int, ...]
    d: list[Any]
    w: list[Any]
    axes: Any
    sd: list[Any]
    log_prior: float


def posterior(given: Products, sd: FloatArray, always: int = 0, *, scale: float | None = None) -> Averaged:
    """Posterior over every submodel of the columns after the first `always`.

    `sd` (p,) are those of the columns' priors, in the columns' own units; `scale` is that of the noise where
    it is known.
    """
    with mp.workdps(DIGITS):
        models = tuple(_models(given, sd, always))
        if scale is not None:
            nodes, log_step = [mp.log(mp.mpf(scale)) - int(given.unit[-1]) * mp.log(2)], 0.0
        else:
            step = 0.5 / math.sqrt(2.0 * (given.n + FEW))
            nodes, log_step = _nodes(models, given, step), math.log(step)
        return _averaged(models, given, nodes, log_step)


def _models(given: Products, sd: FloatArray, always: int) -> Iterator[_Model]:
    p = len(given.cross)
    q = p - always
    scaled = [
        mp.ldexp(mp.mpf(float(s)), int(e)) for s, e in zip(sd, given.unit[:-1] - given.unit[-1], strict=True)
    ]
    for chosen in product((False, True), repeat=q):
        inside = (*range(always), *(always + k for k in range(q) if chosen[k]))
        k = len(inside)
        if k == 0:
            yield _Model((), [], [], None, [], -math.log(q + 1))
            continue
        own = [scaled[j] for j in inside]
        A = mp.matrix(k, k)
        for a, b in product(range(k), repeat=2):
            A[a, b] = given.gram[inside[a], inside[b]] * own[a] * own[b]
        d, axes = mp.eigsy(A)
        b = [given.cross[j] * s for j, s in zip(inside, own, strict=True)]
        w = [mp.fdot(axes[:, i], b) for i in range(k)]
        log_prior = -math.log((q + 1) * math.comb(q, sum(chosen)))
        yield _Model(inside, [abs(x) for x in d], w, axes, own, log_prior)


def _log_joint(m: _Model, given: Products, s: Any) -> Any:
    """Log p(data, model | sigma = exp(s)), in units of the response."""
    v = mp.exp(2 * s)
    rss = given.square - mp.fsum(w * w / (d + v) for d, w in zip(m.d, m.w, strict=True))
    log_det = mp.fsum(mp.log1p(d / v) for d in m.d)
    return m.log_prior - given.n * s - given.n * mp.log(2 * mp.pi) / 2 - rss / (2 * v) - log_det / 2


def _total(models: tuple[_Model, ...], given: Products, s: Any) -> Any:
    logs = [_log_joint(m, given, s) for m in models]
    peak = max(logs)
    return peak + mp.log(mp.fsum(mp.exp(one - peak) for one in logs))


def _nodes(models: tuple[_Model, ...], given: Products, step: float) -> list[Any]:
    """Multiples of `step` that count, around every peak of the summed joint probability."""
    full = models[-1]
    left = given.square - mp.fsum(w * w / d for d, w in zip(full.d, full.w, strict=True) if d > LOST)
    largest = mp.log(given.square / given.n) / 2
    smallest = mp.log(max(abs(left), given.square * mp.mpf(10) ** -36) / given.n) / 2
    least = largest + mp.log(FLOOR)
    coarse = [smallest + COARSE * k for k in range(-REACH, int((largest - smallest) / COARSE) + REACH)]
    coarse = [s for s in coarse if s >= least]
    heights = [_total(models, given, s) for s in coarse]
    top, found = max(heights), dict[int, Any]()
    for k, height in enumerate(heights):
        if height == max(heights[max(k - 1, 0) : k + 2]):
            peak = _summit(models, given, coarse[k])
            top = max(top, _total(models, given, peak))
            _outwards(models, given, peak, (step, top, least), found)
    return [mp.mpf(step) * k for k, height in sorted(found.items()) if height > top - NEGLIGIBLE]


def _summit(models: tuple[_Model, ...], given: Products, near: Any) -> Any:
    """Golden section within one coarse step of a place."""
    a, b, g = near - COARSE, near + COARSE, (mp.sqrt(5) - 1) / 2
    for _ in range(30):
        c, d = b - g * (b - a), a + g * (b - a)
        if _total(models, given, c) > _total(models, given, d):
            b = d
        else:
            a = c
    return (a + b) / 2


def _outwards(
    models: tuple[_Model, ...],
    given: Products,
    peak: Any,
    grid: tuple[float, Any, Any],
    found: dict[int, Any],
) -> None:
    """Add the multiples of a step on both sides of a peak until they no longer count beside the top."""
    step, top, least = grid
    for direction in (1, -1):
        k = int(mp.nint(peak / step)) - (direction < 0)
        while k not in found and step * k >= least:
            found[k] = _total(models, given, mp.mpf(step) * k)
            if found[k] < top - NEGLIGIBLE:
                break
            k += direction


def _averaged(models: tuple[_Model, ...], given: Products, nodes: list[Any], log_step: float) -> Averaged:
    p = len(given.cross)
    logs = [[_log_joint(m, given, s) for s in nodes] for m in models]
    peak = max(max(row) for row in logs)
    total, inclusion = mp.mpf(0), [mp.mpf(0)] * p
    first, second = [mp.mpf(0)] * p, [mp.mpf(0)] * p
    for m, row in zip(models, logs, strict=True):
        weights = [mp.exp(one - peak) for one in row]
        share = mp.fsum(weights)
        total += share
        for j in m.inside:
            inclusion[j] += share
        if share > 0:
            _add_moments(m, nodes, weights, first, second)
    mean = [x / total for x in first]
    sd = [mp.sqrt(abs(x / total - a * a)) for x, a in zip(second, mean, strict=True)]
    unit = int(given.unit[-1]) * given.n * mp.log(2)
    return Averaged(
        _in_units(mean, given),
        _in_units(sd, given),
        np.array([float(x / total) for x in inclusion]),
        float(peak + mp.log(total) + log_step - unit - given.log_det / 2),
    )


def _add_moments(
    m: _Model, nodes: list[Any], weights: list[Any], first: list[Any], second: list[Any]
) -> None:
    least = max(weights) * mp.mpf(10) ** -40
    for s, weight in zip(nodes, weights, strict=True):
        if weight <= least:
            continue
        v = mp.exp(2 * s)
        shrunk = [w / (d + v) for d, w in zip(m.d, m.w, strict=True)]
        spread = [v / (d + v) for d in m.d]
        for row, j in enumerate(m.inside):
            axes = [m.axes[row, i] for i in range(len(m.d))]
            mean = m.sd[row] * mp.fdot(axes, shrunk)
            variance = m.sd[row] ** 2 * mp.fsum(a * a * x for a, x in zip(axes, spread, strict=True))
            first[j] += weight * mean
            second[j] += weight * (mean * mean + variance)
