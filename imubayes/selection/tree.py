"""The include/exclude tree over all submodels of a triangular factor.

A column is decided at each depth. Including the leading column of the trailing factor costs nothing: its row
is explained. Excluding it leaves an upper Hessenberg block that Givens rotations make triangular again.
Deep blocks are small and most nodes are deep, so a model costs a constant number of operations, whatever p
(the dropping-columns tree of Gatu and Kontoghiorghes, 2003). Prior rows stacked under the data's before the
walk need no care: with its column, a prior row becomes zero and rotates away.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from imubayes.algebra.arrays import FloatArray


def walk(R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residual sum of squares and log determinant of every submodel.

    Parameters
    ----------
    R : (p + 1, p + 1) upper triangular factor of ``[X y]``, prior rows included.

    Returns
    -------
    (rss, log_det) : arrays (2^p,), indexed by the mask of included columns (bit j for column j): the
        residual sum of squares, and the sum of ``ln |r_jj|`` over the model's own triangular factor.

    Examples
    --------
    >>> rss, log_det = walk(np.array([[2.0, 1.0], [0.0, 3.0]]))
    >>> rss.tolist(), (log_det / math.log(2)).tolist()
    ([10.0, 9.0], [0.0, 1.0])
    """
    p = R.shape[0] - 1
    reverse = [*range(p - 1, -1, -1), p]
    turned = np.ascontiguousarray(np.linalg.qr(R[:, reverse], mode="r"))
    rss, log_det = np.empty(1 << p), np.empty(1 << p)
    _walk(turned, rss, log_det)
    return rss, log_det


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(R: FloatArray, rss: FloatArray, log_det: FloatArray) -> None:
    """Visit the masks from all-included down; depth d decides bit p - 1 - d.

    ``blocks[block[d]]`` holds the trailing factor that depth d looks at, from row and column d on; its last
    column is z. A node differs from its predecessor only below the deepest bit that changed.
    """
    p = R.shape[0] - 1
    blocks = np.zeros((p + 1, p + 1, p + 1))
    blocks[0] = R
    block = np.zeros(p + 1, np.int64)
    left, det = np.zeros(p + 1), np.zeros(p + 1)
    left[0] = R[p, p] * R[p, p]
    _include(blocks, block, left, det, 0, p)
    rss[(1 << p) - 1], log_det[(1 << p) - 1] = left[p], det[p]
    for mask in range((1 << p) - 2, -1, -1):
        depth, bit = p - 1, 1
        while (mask + 1) & bit == 0:
            depth, bit = depth - 1, bit << 1
        left[depth + 1] = left[depth] + _exclude(blocks[block[depth]], depth, blocks[depth + 1], p)
        det[depth + 1] = det[depth]
        block[depth + 1] = depth + 1
        _include(blocks, block, left, det, depth + 1, p)
        rss[mask], log_det[mask] = left[p], det[p]


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _include(blocks, block, left, det, depth, p):
    """Include every column from `depth` on: views of one block, and logarithms of its diagonal."""
    for d in range(depth, p):
        block[d + 1], left[d + 1] = block[d], left[d]
        det[d + 1] = det[d] + math.log(abs(blocks[block[d], d, d]))


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _exclude(A, d, out, p):
    """Write to `out` the factor of A without column d; return the square that joins the residual.

    The row that loses its pivot is carried down, rotated against each row in turn.
    """
    out[p] = A[d]
    carry = out[p]
    for i in range(d + 1, p):
        a, b = carry[i], A[i, i]
        norm = math.sqrt(a * a + b * b)
        c, t = (b / norm, a / norm) if norm > 0.0 else (1.0, 0.0)
        out[i, i] = norm
        for k in range(i + 1, p + 1):
            u, v = carry[k], A[i, k]
            out[i, k] = c * v + t * u
            carry[k] = c * u - t * v
    return carry[p] * carry[p]
