"""Whitening by a covariance of small states, compiled: apart, so that a study is read without a compiler.

For row i after row j, ``Cov_ij = sum_m U_im e_im F_(i-1)m e_(i-1)m ... F_(j+1)m e_(j+1)m V_jm power_m`` with
the decay ``e_im = exp(-rate_m gap_i)`` from the end of row i - 1 to the start of row i. The factor L D L' has
the same form, and costs O(n m^2). The power of a random walk grows by ``drift`` from centre to centre, and
what the rows before explain of it is nearly all: the difference of the two is carried, which stays of the
size of the noise however long the run is.

What takes the compiler longer than all the rest is left to the caller, or written out: new arrays (`room` to
work in is given), parts of arrays set at once, and functions of another library.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra.compiled import compiled, reordered


@compiled
def sweep(table, step, states, carried, d, gains, room):
    """Whiten rows (n, width) in place, and fill their variances d (n,), each given the rows before.

    Parameters
    ----------
    step : (n,) s, from the centre of the row before to that of a row.
    states : own (n|1,), U, V, F, decays over the gap before a row (n|1, J), power, drift (J,), as
        `imubayes.inference.whiten.States.over`.
    carried : explained (J, J), means (J, width), gain (J,), past (J,), last (width,), variance (1,), of the
        rows before; moved on.
    gains : (n, J) for the gain of each row, or empty.
    room : three of (J,).
    """
    own, U, V, F, decays, power, drift = states
    explained, means, gain, past, last, variance = carried
    width, J = table.shape[1], len(power)
    kept, added, seen = room
    fresh = 1 if len(decays) > 1 else 0
    many, each, kept_too = 1 if len(U) > 1 else 0, 1 if len(own) > 1 else 0, len(gains) > 0
    for i in range(len(table)):
        u, v, through, row = U[i * many], V[i * many], F[i * many], table[i]
        for j in range(J):
            decay = decays[i * fresh, j]
            kept[j], added[j], seen[j] = decay * past[j], decay * gain[j], 0.0
        for j in range(J):
            own_kept, own_added = kept[j], variance[0] * added[j]
            for k in range(J):
                value = own_kept * kept[k] * explained[j, k] + own_added * added[k]
                explained[j, k] = value
                seen[k] += value * u[j]
        left = own[i * each]
        for j in range(J):
            own_kept, own_added, weight, grown = kept[j], added[j], u[j], drift[j] * step[i]
            explained[j, j] -= grown
            seen[j] -= grown * weight
            left -= weight * seen[j]
            for q in range(width):
                state = own_kept * means[j, q] + own_added * last[q]
                means[j, q] = state
                row[q] -= weight * state
        root = 1.0 / np.sqrt(left)
        for q in range(width):
            last[q] = row[q]
            row[q] *= root
        for j in range(J):
            past[j] = through[j]
            gain[j] = (v[j] * power[j] - through[j] * seen[j]) / left
            if kept_too:
                gains[i, j] = gain[j]
        variance[0] = d[i] = left


@compiled
def sweep_each(table, step, states, d, room):
    """Whiten each column (n, w) in place by noise of its own, and fill the variances d (n, w): `sweep`.

    Of `states` own (n|1, w), power and drift (J, w) are those of each column; the others they share. `room`
    is one of (J,), one of (J * J, w), three of (J, w) and five of (w,), all zero. Loops over columns are over
    few arrays, and from zero on, else the compiler makes no vectors of them.
    """
    own, U, V, F, decays, power, drift = states
    kept, explained, seen, means, gain, row, last, variance, added, left = room
    n, w, J = len(table), table.shape[1], len(drift)
    many, each, fresh = 1 if len(U) > 1 else 0, 1 if len(own) > 1 else 0, 1 if len(decays) > 1 else 0
    for i in range(n):
        u, v, through, before = U[i * many], V[i * many], F[i * many], F[(i - 1 if i else 0) * many]
        for j in range(J):
            decay = decays[i * fresh, j]
            kept[j] = decay * before[j]
            for q in range(w):
                gain[j, q] *= decay
                seen[j, q] = 0.0
        for q in range(w):
            row[q], left[q] = table[i, q], own[i * each, q]
        for j in range(J):
            weight, at = u[j], j * J
            for q in range(w):
                added[q] = variance[q] * gain[j, q]
            for k in range(j + 1):
                both, other, here = kept[j] * kept[k], u[k], at + k
                for q in range(w):
                    explained[here, q] = both * explained[here, q] + added[q] * gain[k, q]
                if k < j:
                    for q in range(w):
                        seen[j, q] += other * explained[here, q]
                    for q in range(w):
                        seen[k, q] += weight * explained[here, q]
            for q in range(w):
                explained[at + j, q] -= drift[j, q] * step[i]
            for q in range(w):
                seen[j, q] += weight * explained[at + j, q]
        for j in range(J):
            weight = u[j]
            for q in range(w):
                left[q] -= weight * seen[j, q]
            for q in range(w):
                means[j, q] = kept[j] * means[j, q] + gain[j, q] * last[q]
            for q in range(w):
                row[q] -= weight * means[j, q]
        for q in range(w):
            variance[q], last[q] = left[q], row[q]
        for j in range(J):
            told, lost = v[j], through[j]
            for q in range(w):
                gain[j, q] = (told * power[j, q] - lost * seen[j, q]) / left[q]
        for q in range(w):
            d[i, q], table[i, q] = left[q], row[q] / np.sqrt(left[q])


@reordered
def swept_back(white, d, step, states, gains, slope, found, room):
    """Derivatives of ``L(white) - sum(ln d) / 2``: `sweep`, backwards.

    Parameters
    ----------
    white, d, gains : (n, width), (n,), (n, J), as `sweep` left them.
    slope : (n, width) derivatives of L.
    found : zeros, for those by own (n,), power and drift (J,).
    room : (J, J), (J, width), (width,), and two of (J,), all zero.
    """
    _, U, V, F, decays, _, _ = states
    n, width, J, many = len(white), white.shape[1], gains.shape[1], 1 if len(U) > 1 else 0
    by_own, by_power, by_drift = found
    by_explained, by_means, by_row, by_seen, decayed = room
    after = 0
    for i in range(n - 1, -1, -1):
        u, v, through, g, decay = U[i * many], V[i * many], F[i * many], gains[i], decays[after]
        root, each = np.sqrt(d[i]), 1.0 / d[i]
        by_d = -0.5 * each
        for q in range(width):
            by_row[q] = slope[i, q] / root
            by_d -= 0.5 * slope[i, q] * white[i, q] * each
        for j in range(J):
            decayed[j] = decay[j] * g[j]
        for j in range(J):
            told, shared, gain = 0.0, 0.0, decayed[j]
            for q in range(width):
                told += by_means[j, q] * white[i, q]
                by_row[q] += gain * by_means[j, q]
            for k in range(J):
                shared += by_explained[j, k] * decayed[k]
            by_gain = decay[j] * (told * root * each + 2.0 * shared)
            by_d += gain * shared - by_gain * g[j]
            by_power[j] += by_gain * v[j]
            by_seen[j] = -by_gain * through[j]
        for j in range(J):
            half, kept, seen = 0.5 * u[j], decay[j] * through[j], 0.5 * by_seen[j] - by_d * u[j]
            for k in range(J):
                own = kept * decay[k] * through[k] * by_explained[j, k]
                by_explained[j, k] = own + seen * u[k] + half * by_seen[k]
            for q in range(width):
                by_means[j, q] = kept * by_means[j, q] - u[j] * by_row[q]
            by_drift[j] -= step[i] * by_explained[j, j]
        by_own[i], after = by_d, i if len(decays) > 1 else 0
