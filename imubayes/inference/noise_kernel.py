"""Whitening by a covariance of small states, compiled: apart, so that a study is read without a compiler.

For i after j, ``Cov_ij = sum_m power_m U_im F_(i-1)m ... F_(j+1)m V_jm``, and a variance
a_i on the diagonal.
The factor L D L' has the same form, with W in place of V, and costs O(n m^2). Unlike an exponential of time,
a state may be forgotten after one row (F = 0), which is what quantization needs.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from imubayes.algebra.arrays import FloatArray


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def whitened(
    U: FloatArray, F: FloatArray, V: FloatArray, a: FloatArray, rows: FloatArray, power: FloatArray
) -> float:
    """Whiten rows (n, k) in place.

    Parameters
    ----------
    U, F, V : (n, m).
    a : (n,) variances.
    rows : (n, k).
    power : (m,) of each state.

    Returns
    -------
    log determinant of the covariance; not a number where it is not positive definite.
    """
    n, m = U.shape
    k = rows.shape[1]
    S, W, SU = np.zeros((m, m)), np.zeros(m), np.zeros(m)
    f = np.zeros((k, m))
    log_det = 0.0
    for i in range(n):
        d = a[i]
        for p in range(m):
            total = 0.0
            for q in range(m):
                total += S[p, q] * U[i, q]
            SU[p] = total
            d -= U[i, p] * total
        if not d > 0.0:
            return np.nan
        log_det += np.log(d)
        root = 1.0 / np.sqrt(d)
        for p in range(m):
            W[p] = power[p] * V[i, p] - F[i, p] * SU[p]
        for p in range(m):
            scaled = W[p] / d
            for q in range(m):
                S[p, q] = F[i, p] * F[i, q] * S[p, q] + scaled * W[q]
        for c in range(k):
            z = rows[i, c]
            for p in range(m):
                z -= U[i, p] * f[c, p]
            share = z / d
            for p in range(m):
                f[c, p] = F[i, p] * f[c, p] + W[p] * share
            rows[i, c] = z * root
    return log_det
