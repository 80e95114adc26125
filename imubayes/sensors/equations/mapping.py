"""What the standards' equations share: parameters that say which generalized term determines them.

That is at once the mapping and the table of the report. Where every parameter sits inside one gain ``q``
(IEEE 1293's ``K1 { ... }``, the drift of a gyroscope before its scale factor) it says all::

    b1 = q - 1,   theta[term] = q * weight * value

The weight carries the conventions: 1/2 for the full differences K0' and K1', -1 for the angle about j, and -1
for a scale-factor error in the denominator, where it holds to first order.
Numbers may be floats, complex steps or arrays of either: everything here is arithmetic on them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import factor_of, least_squares
from imubayes.errors import TermError
from imubayes.sensors.terms import HIGHEST_POWER, REFERENCE_TEMPERATURE, Kind, Library, library

Coefficients = dict[str, Any]
"""Generalized coefficients by the name of their term, SI; numbers or arrays of them."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """One parameter of a standard.

    Attributes
    ----------
    field : its name in the dataclass of parameters.
    symbol : as the standard writes it, in ASCII.
    term : the generalized term that determines it; empty where there is none.
    unit, printed : SI unit, and the unit that people use.
    weight : of the value in the term's coefficient, before the gain.
    note : convention, in a few words.
    """

    field: str
    symbol: str
    term: str
    unit: str
    printed: str
    weight: float = 1.0
    note: str = ""

    @property
    def of_term(self) -> str:
        """The term's coefficient in this symbol, to first order: ``K0'/2``, ``-d_p``.

        Examples
        --------
        >>> Symbol("d_p", "d_p", "m_k", "rad", "urad", -1.0).of_term
        '-d_p'
        """
        sign, size = ("-" if self.weight < 0.0 else ""), 1.0 / abs(self.weight)
        return f"{sign}{self.symbol}" + (f"/{size:g}" if size != 1.0 else "")


def of(term: str, weight: float = 1.0, note: str = "", *, default: float = 0.0, **told: str) -> Any:
    """Field of a dataclass of parameters: the generalized term that determines it, as in `Symbol`.

    It has the unit of the term's coefficient, and the symbol is the field's name, unless `told` otherwise.
    """
    return field(default=default, metadata={"term": term, "weight": weight, "note": note} | told)


def symbols_of(parameters: type, kind: Kind) -> tuple[Symbol, ...]:
    """Table of the parameters of a standard for a kind of sensor."""
    known = library(kind, powers=HIGHEST_POWER, set="extended", temperature=1).terms
    units: dict[str, dict[str, Any]] = {t.name: {"unit": t.unit, "printed": t.printed} for t in known}
    told = [(one.name, one.metadata) for one in fields(parameters) if one.metadata]
    return tuple(
        Symbol(field=name, **{"symbol": name, **units.get(row["term"], {}), **row}) for name, row in told
    )


@dataclass(frozen=True, slots=True)
class Standard:
    """An equation of a standard and its mapping to the generalized coefficients.

    Attributes
    ----------
    id, title : short name, and what it describes.
    kind : accelerometer or gyroscope.
    symbols : its parameters one by one.
    indicated : ``(parameters, channels, n) -> (n,)`` indicated input, m/s^2 or rad/s.
    to_general : parameters to coefficients by term.
    from_general : coefficients by term to parameters; a term that is absent is zero.
    exact : where the equation and the library give the same output, and in which order of what they differ
        elsewhere.
    beyond : what the standard names beside its parameters that no term stands for.
    implied : terms that are not free in the standard: their coefficients follow from the others.
    """

    id: str
    title: str
    kind: Kind
    symbols: tuple[Symbol, ...]
    indicated: Callable[[Any, Mapping[str, FloatArray], int], FloatArray]
    to_general: Callable[[Any], Coefficients]
    from_general: Callable[[Mapping[str, Any]], Any]
    exact: str
    beyond: tuple[str, ...] = ()
    implied: tuple[str, ...] = ()

    @property
    def standard_only(self) -> tuple[str, ...]:
        """What the standard has and the generalized model has not."""
        return (*(row.symbol for row in self.symbols if not row.term), *self.beyond)

    def general_only(self, lib: Library) -> tuple[str, ...]:
        """Terms of `lib` that the standard has not."""
        known = {row.term for row in self.symbols} | set(self.implied)
        return tuple(name for name in lib.names if name not in known)


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Least squares of an output error on some terms over given inputs.

    A coefficient, SI, is zero where the inputs do not excite its term; `rms` is that of the error over the
    inputs, m/s^2 or rad/s, and `lost` that of what the terms leave of it.
    """

    coefficients: Mapping[str, float]
    rms: float
    lost: float


def gained_to_general(symbols: Sequence[Symbol], p: object) -> Coefficients:
    """Coefficients of parameters p that all sit inside one gain; the gain's error is the row of ``b1``."""
    error = next(getattr(p, row.field) for row in symbols if row.term == "b1")
    gain = 1.0 + error
    scaled = {row.term: gain * row.weight * getattr(p, row.field) for row in symbols if row.term}
    return {**scaled, "b1": error}


def gained_from_general(symbols: Sequence[Symbol], theta: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by field: the inverse of `gained_to_general`; a `TermError` if the gain is not positive."""
    error = theta.get("b1", 0.0)
    gain = positive_gain(error)
    return {
        row.field: error if row.term == "b1" else theta.get(row.term, 0.0) / (gain * row.weight)
        for row in symbols
        if row.term
    }


def gained(
    symbols: Sequence[Symbol], parameters: type, **given: object
) -> tuple[Callable[[Any], Coefficients], Callable[[Mapping[str, Any]], Any]]:
    """The mapping to generalized coefficients, and back, of an equation whose parameters sit inside one gain.

    It is exact for all inputs; the way back raises a `TermError` where the gain 1 + b1 is not positive. No
    term tells the parameters that are `given`.
    """
    return (
        partial(gained_to_general, symbols),
        lambda theta: parameters(**given, **gained_from_general(symbols, theta)),
    )


def positive_gain(b1: Any) -> Any:
    """``1 + b1``; a `TermError` if it is not positive: axes are mislabelled then, or the output's sign is."""
    if np.any(np.real(b1) <= -1.0):
        raise TermError(
            f"a standard needs a gain 1 + b1 above 0, got b1 = {np.min(np.real(b1)):g}:"
            " check the sign of the output and which axis is the input axis"
        )
    return 1.0 + b1


def reciprocal(e: Any) -> Any:
    """``1/(1 + e) - 1`` without cancellation; it is its own inverse.

    Examples
    --------
    >>> reciprocal(0.25), reciprocal(-0.2)
    (-0.2, 0.25)
    """
    return -e / (1.0 + e)


def row(s: Any, a_X: Any, a_Y: Any) -> tuple[Any, Any, Any]:
    """Generalized (b1, m_j, m_k) of ``(1 + s) (cos a, sinc(a) a_Y, -sinc(a) a_X)``, ``a^2 = a_X^2 + a_Y^2``.

    b1 keeps its digits where it is small. The square root is missing on the slide, and the minus of the third
    entry is IEEE 1293's and 952's.

    Examples
    --------
    >>> b1, m_j, m_k = row(0.0, 3e-4, 4e-4)
    >>> f"{b1:.6e} {m_j:.6e} {m_k:.6e}"
    '-1.250000e-07 4.000000e-04 -3.000000e-04'
    """
    squared = a_X * a_X + a_Y * a_Y
    ratio = _sinc(squared)
    half = _sinc(squared / 4.0)
    versine = squared * half * half / 2.0
    return s - (1.0 + s) * versine, (1.0 + s) * ratio * a_Y, -(1.0 + s) * ratio * a_X


def alignment(b1: Any, m_j: Any, m_k: Any) -> tuple[Any, Any, Any]:
    """``(s, a_X, a_Y)`` of a linear row: the inverse of `row`, for angles below 90 deg, a gain above 0."""
    along = positive_gain(b1)
    squared = m_j * m_j + m_k * m_k
    # |k| - 1 without cancellation: (|k|^2 - 1) / (|k| + 1)
    s = (b1 * (2.0 + b1) + squared) / (np.sqrt(along * along + squared) + 1.0)
    tangent = squared / (along * along)
    root = np.sqrt(np.where(tangent == 0.0, 1.0, tangent))
    ratio = np.where(tangent == 0.0, 1.0, np.arctan(root) / root)[()] / along
    return s, -ratio * m_k, ratio * m_j


def _sinc(squared: Any) -> Any:
    root = np.sqrt(np.where(squared == 0.0, 1.0, squared))
    return np.where(squared == 0.0, 1.0, np.sin(root) / root)[()]


def channel(channels: Mapping[str, FloatArray], name: str, n: int) -> FloatArray:
    """One input of `n` rows; zero where it is not given, as in the library's columns."""
    return np.asarray(channels[name], dtype=np.float64) if name in channels else np.zeros(n)


def vector(channels: Mapping[str, FloatArray], quantity: str, n: int) -> tuple[FloatArray, ...]:
    """The inputs of a quantity along (i, j, k)."""
    i, j, k = (channel(channels, f"{quantity}_{axis}", n) for axis in "ijk")
    return i, j, k


def warmth(channels: Mapping[str, FloatArray], n: int) -> FloatArray:
    """T - T0 in K; zero where no temperature is given."""
    return channels["T"] - REFERENCE_TEMPERATURE if "T" in channels else np.zeros(n)


def absorbing(X: FloatArray, kept: Sequence[int], dropped: Sequence[int]) -> FloatArray:
    """What dropped coefficients add to kept ones, (kept, dropped), by least squares over the inputs.

    A kept term that the inputs do not excite takes nothing over; of kept terms that they cannot tell apart,
    each takes over as little as will do, in the size of its column. X (m, p) is of regressors over the
    inputs, or their triangular factor.

    Examples
    --------
    >>> X = np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 3.0], [1.0, 2.0, 5.0]])
    >>> absorbing(X, [0, 1], [2]).round(3).tolist()
    [[1.0], [2.0]]
    """
    size = np.linalg.norm(X[:, kept], axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    found = np.linalg.lstsq(X[:, kept] / scale, X[:, dropped], rcond=_ALIKE)[0]
    return np.asarray(found / scale[:, None], dtype=np.float64)


_ALIKE = 1e-9
"""Singular value, over the largest, below which inputs cannot tell kept terms apart."""


def project(X: FloatArray, y: FloatArray, names: Sequence[str], n: int) -> Projection:
    """Least squares of an error y (m,) on terms; a term that the inputs do not excite is left at zero.

    X (m, p) is of regressors over the inputs, or their triangular factor; the rms is over n rows. It is an
    `UnobservableError` if the inputs cannot tell the excited terms apart.
    """
    excited = [j for j in range(len(names)) if X[:, j].any()]
    kept = tuple(names[j] for j in excited)
    rows = np.column_stack((X[:, excited], y))
    rows = np.pad(rows, ((0, max(len(kept) - len(rows), 0)), (0, 0)))
    fit = least_squares(factor_of(rows[:, :-1], rows[:, -1], kept))
    found = dict(zip(kept, fit.mean.tolist(), strict=True))
    root = np.sqrt(n)
    return Projection(
        {name: found.get(name, 0.0) for name in names},
        float(np.linalg.norm(y) / root),
        float(np.sqrt(fit.rss) / root),
    )
