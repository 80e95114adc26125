"""Whitening by a covariance of small states, compiled: apart, so that a study is read without a compiler.

For row i after row j, ``Cov_ij = sum_m U_im e_im F_(i-1)m e_(i-1)m ... F_(j+1)m e_(j+1)m V_jm power_m`` with
the decay ``e_im = exp(-rate_m gap_i)`` from the end of row i - 1 to the start of row i. The factor L D L' has
the same form, and costs O(n m^2). The power of a random walk grows by ``drift`` from centre to centre, and
what the rows before explain of it is nearly all: the difference of the two is carried, which stays of the
size of the noise however long the run is.

Arrays are set one element at a time: to set a whole part makes the compiler read what it would say if shapes
differed, which takes it longer than all the rest.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra.compiled import compiled, reordered

NEARLY = 1e-5
"""Change of an exponent that is followed by a series of second order: its error is below a rounding."""


@compiled
def sweep(table, gap, step, states, carried, d, gains):
    """Whiten rows (n, width) in place, and fill their variances d (n,), each given the rows before.

    Parameters
    ----------
    gap, step : (n,) s, from the end of the row before to the start of a row, and from centre to centre.
    states : own (n|1,), U, V, F (n|1, J), rates, power, drift (J,), as `imubayes.inference.whiten.States`.
    carried : explained (J, J), means (J, width), gain (J,), past (J,), last (width,), variance (1,), of the
        rows before; moved on.
    gains : (n, J) for the gain of each row, or empty.
    """
    own, U, V, F, rates, power, drift = states
    explained, means, gain, past, last, variance = carried
    width, J = table.shape[1], len(rates)
    kept, added, usual, seen = np.empty(J), np.empty(J), np.ones(J), np.empty(J)
    fastest, gap_usual, walks = 0.0, 0.0, False
    many, each, kept_too = int(len(U) > 1), int(len(own) > 1), len(gains) > 0
    for j in range(J):
        fastest, walks = max(fastest, rates[j]), walks or drift[j] != 0.0
    for i in range(len(table)):
        u, v, through = U[i * many], V[i * many], F[i * many]
        if abs(gap[i] - gap_usual) * fastest > NEARLY:
            gap_usual = gap[i]
            for j in range(J):
                usual[j] = np.exp(-rates[j] * gap_usual)
        for j in range(J):
            off = rates[j] * (gap[i] - gap_usual)
            decay = usual[j] * (1.0 - off * (1.0 - 0.5 * off))
            kept[j], added[j], seen[j] = decay * past[j], decay * gain[j], 0.0
        for j in range(J):
            own_kept, own_added = kept[j], variance[0] * added[j]
            for k in range(J):
                value = own_kept * kept[k] * explained[j, k] + own_added * added[k]
                explained[j, k] = value
                seen[k] += value * u[j]
        if walks:
            for j in range(J):
                explained[j, j] -= drift[j] * step[i]
                seen[j] -= drift[j] * step[i] * u[j]
        left = own[i * each]
        for j in range(J):
            left -= u[j] * seen[j]
        row = table[i]
        for j in range(J):
            own_kept, own_added, weight = kept[j], added[j], u[j]
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
        variance[0] = left
        d[i] = left
        if kept_too:
            for j in range(J):
                gains[i, j] = gain[j]


TOGETHER = 32
"""Columns that are followed side by side, as vectors: their states stay in the first cache."""


@compiled
def sweep_each(table, gap, step, states, d):
    """Whiten each column (n, m) in place by noise of its own, and fill the variances d (n, m): `sweep`.

    Of `states` own (n|1, m), power and drift (J, m) are those of each column; the others they share. Loops
    over columns are over few arrays, and from zero on, else the compiler makes no vectors of them.
    """
    own, U, V, F, rates, power, drift = states
    n, m, J, many, each = len(table), table.shape[1], len(rates), int(len(U) > 1), int(len(own) > 1)
    usual, kept = np.ones(J), np.empty(J)
    for first in range(0, m, TOGETHER):
        w, gap_usual = min(TOGETHER, m - first), np.inf
        explained, seen = np.zeros((J * J, w)), np.empty((J, w))
        means, gain = np.zeros((J, w)), np.zeros((J, w))
        row, last, variance, added, left = np.empty(w), np.zeros(w), np.zeros(w), np.empty(w), np.empty(w)
        grown, force = drift[:, first : first + w].copy(), power[:, first : first + w].copy()
        for i in range(n):
            u, v, through, before = U[i * many], V[i * many], F[i * many], F[max(i - 1, 0) * many]
            if gap[i] != gap_usual:
                gap_usual = gap[i]
                for j in range(J):
                    usual[j] = np.exp(-rates[j] * gap_usual)
            for j in range(J):
                kept[j] = usual[j] * before[j]
                for q in range(w):
                    gain[j, q] *= usual[j]
                    seen[j, q] = 0.0
            for q in range(w):
                row[q], left[q] = table[i, first + q], own[i * each, first + q]
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
                    explained[at + j, q] -= grown[j, q] * step[i]
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
                    gain[j, q] = (told * force[j, q] - lost * seen[j, q]) / left[q]
            for q in range(w):
                d[i, first + q], table[i, first + q] = left[q], row[q] / np.sqrt(left[q])


@reordered
def swept_back(white, d, gap, step, states, gains, slope):
    """Derivatives of ``L(white) - sum(ln d) / 2`` by own (n,), power and drift (J,): `sweep`, backwards.

    Parameters
    ----------
    white, d, gains : (n, width), (n,), (n, J), as `sweep` left them.
    slope : (n, width) derivatives of L.
    """
    _, U, V, F, rates, _, _ = states
    n, width, J, many = len(white), white.shape[1], len(rates), int(len(U) > 1)
    by_own, by_power, by_drift = np.empty(n), np.zeros(J), np.zeros(J)
    by_explained, by_means = np.zeros((J, J)), np.zeros((J, width))
    by_gain, by_seen, by_row = np.empty(J), np.empty(J), np.empty(width)
    usual, decayed, left, gap_usual = np.ones(J), np.empty(J), np.empty(J), 0.0
    for i in range(n - 1, -1, -1):
        u, v, through, g, after = U[i * many], V[i * many], F[i * many], gains[i], i + 1 < n
        root = np.sqrt(d[i])
        by_d = -0.5 / d[i]
        for q in range(width):
            by_row[q] = slope[i, q] / root
            by_d -= 0.5 * slope[i, q] * white[i, q] / d[i]
        if after and gap[i + 1] != gap_usual:
            gap_usual = gap[i + 1]
            for j in range(J):
                usual[j] = np.exp(-rates[j] * gap_usual)
        for j in range(J):
            decayed[j], left[j] = usual[j] * g[j], usual[j] * through[j]
            by_drift[j] -= step[i + 1] * by_explained[j, j] if after else 0.0
        for j in range(J):
            told, shared, gain = 0.0, 0.0, decayed[j]
            for q in range(width):
                told += by_means[j, q] * white[i, q]
                by_row[q] += gain * by_means[j, q]
            for k in range(J):
                shared += by_explained[j, k] * decayed[k]
            by_gain[j] = usual[j] * (told * root + 2.0 * d[i] * shared)
            by_d += gain * shared
        for j in range(J):
            by_power[j] += by_gain[j] * v[j] / d[i]
            by_d -= by_gain[j] * g[j] / d[i]
        for j in range(J):
            by_seen[j] = -by_gain[j] * through[j] / d[i] - by_d * u[j]
        for j in range(J):
            weight, kept, seen = u[j], left[j], 0.5 * by_seen[j]
            half = 0.5 * weight
            for k in range(J):
                by_explained[j, k] = kept * left[k] * by_explained[j, k] + seen * u[k] + half * by_seen[k]
            for q in range(width):
                by_means[j, q] = kept * by_means[j, q] - weight * by_row[q]
        by_own[i] = by_d
    for j in range(J):
        by_drift[j] -= step[0] * by_explained[j, j]
    return by_own, by_power, by_drift
