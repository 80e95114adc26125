"""Triangular factors of whitened rows, and the digits that their arithmetic keeps; here types of arrays."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Extended = NDArray[np.longdouble]


def powers_of_two(sizes: FloatArray) -> FloatArray:
    """Largest power of two that is no more than each size; 1 for a size of 0."""
    return np.exp2(np.floor(np.log2(sizes, where=sizes > 0.0, out=np.zeros_like(sizes))))


def back_substitute(R: Extended, b: Extended) -> Extended:
    """Solve ``R x = b`` for upper triangular R in extended precision, which LAPACK has not."""
    x = np.zeros_like(b)
    for i in range(len(R) - 1, -1, -1):
        x[i] = (b[i] - R[i, i + 1 :] @ x[i + 1 :]) / R[i, i]
    return x
