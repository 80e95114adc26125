"""Correct digits of a result, against its reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

MOST = 15.0
"""More digits are not counted: a double ends there."""


def digits_of(found: ArrayLike, reference: ArrayLike, size: ArrayLike) -> float:
    """Fewest correct digits over all elements; -inf where one is not finite.

    Parameters
    ----------
    found, reference : (p,) values.
    size : (p,) that an error is counted against: 0.1 of it is one digit.

    Examples
    --------
    >>> digits_of([1.0, 2.002], [1.0, 2.0], [1.0, 2.0])
    3.0
    """
    a, b, unit = (
        np.atleast_1d(np.asarray(values, dtype=np.longdouble)) for values in (found, reference, size)
    )
    if not np.all(np.isfinite(a) | (a == b)):
        return -np.inf
    error = np.abs(np.where(a == b, 0.0, a) - np.where(a == b, 0.0, b))
    wrong = error > 0.0
    if not wrong.any():
        return MOST
    with np.errstate(divide="ignore"):
        lost = np.log10(unit[wrong]) - np.log10(error[wrong])
    return round(float(np.min(np.clip(lost, 0.0, MOST))), 12)


def of_coefficients(found: ArrayLike, reference: ArrayLike, sd: ArrayLike) -> float:
    """Correct digits of coefficients, counted against the larger of a coefficient and its sd.

    A coefficient that is far smaller than its sd has no digits of its own that anybody could use.
    """
    return digits_of(found, reference, np.maximum(np.abs(np.asarray(reference)), np.asarray(sd)))


def of_log_evidence(found: float, reference: float) -> float:
    """Correct digits of a log evidence: of its size, or behind the point where it is below one."""
    return digits_of(found, reference, max(abs(reference), 1.0))
