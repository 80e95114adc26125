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

NEARLY = 1e-5
"""Change of an exponent that is followed by a series of second order: its error is below a rounding."""


@compiled
def sweep(table, gap, step, states, carried, d, gains, room):
    """Whiten rows (n, width) in place, and fill their variances d (n,), each given the rows before.

    Parameters
    ----------
    gap, step : (n,) s, from the end of the row before to the start of a row, and from centre to centre.
    states : own (n|1,), U, V, F (n|1, J), rates, power, drift (J,), as `imubayes.inference.whiten.States`.
    carried : explained (J, J), means (J, width), gain (J,), past (J,), last (width,), variance (1,), of the
        rows before; moved on.
    gains : (n, J) for the gain of each row, or empty.
    room : four of (J,).
    """
    own, U, V, F, rates, power, drift = states
    explained, means, gain, past, last, variance = carried
    width, J = table.shape[1], len(rates)
    kept, added, usual, seen = room
    fastest, gap_usual, walks = 0.0, 0.0, False
    many, each, kept_too = 1 if len(U) > 1 else 0, 1 if len(own) > 1 else 0, len(gains) > 0
    for j in range(J):
        usual[j], walks = 1.0, walks or drift[j] != 0.0
        if rates[j] > fastest:
            fastest = rates[j]
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


@compiled
def sweep_each(table, gap, step, states, d, room):
    """Whiten each column (n, w) in place by noise of its own, and fill the variances d (n, w): `sweep`.

    Of `states` own (n|1, w), power and drift (J, w) are those of each column; the others they share. `room`
    is two of (J,), one of (J * J, w), three of (J, w) and five of (w,), all zero. Loops over columns are over
    few arrays, and from zero on, else the compiler makes no vectors of them.
    """
    own, U, V, F, rates, power, drift = states
    usual, kept, explained, seen, means, gain, row, last, variance, added, left = room
    n, w, J = len(table), table.shape[1], len(rates)
    many, each, gap_usual = 1 if len(U) > 1 else 0, 1 if len(own) > 1 else 0, np.inf
    for i in range(n):
        u, v, through, before = U[i * many], V[i * many], F[i * many], F[(i - 1 if i else 0) * many]
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
def swept_back(white, d, gap, step, states, gains, slope, found, room):
    """Derivatives of ``L(white) - sum(ln d) / 2``: `sweep`, backwards.

    Parameters
    ----------
    white, d, gains : (n, width), (n,), (n, J), as `sweep` left them.
    slope : (n, width) derivatives of L.
    found : zeros, for those by own (n,), power and drift (J,).
    room : (J, J), (J, width), (width,), and five of (J,), all zero.
    """
    _, U, V, F, rates, _, _ = states
    n, width, J, many = len(white), white.shape[1], len(rates), 1 if len(U) > 1 else 0
    by_own, by_power, by_drift = found
    by_explained, by_means, by_row, by_gain, by_seen, usual, decayed, left = room
    gap_usual = np.inf
    for i in range(n - 1, -1, -1):
        u, v, through, g, after = U[i * many], V[i * many], F[i * many], gains[i], i + 1 < n
        root = np.sqrt(d[i])
        by_d = -0.5 / d[i]
        for q in range(width):
            by_row[q] = slope[i, q] / root
            by_d -= 0.5 * slope[i, q] * white[i, q] / d[i]
        if not after or gap[i + 1] != gap_usual:
            gap_usual = gap[i + 1] if after else 0.0
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
