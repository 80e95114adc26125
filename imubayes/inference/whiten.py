"""Whitening of correlated rows in O(n), with any time stamps, all at once or a part at a time.

Rows are averages over ``T`` that begin a gap ``g`` after the end of the row before, and ``E(x)`` is
``(1 - exp(-x)) / x``. Each process is a few states of `imubayes.inference.noise_kernel`:

- Gauss-Markov, ``x = T/tau``: variance ``2 s^2 (x - 1 + exp(-x)) / x^2``, ``U = V = E``, ``F = exp(-x)``,
  and a decay at the rate ``1/tau`` over the gap; bias instability is a row of them;
- random walk from the run's start t0: variance ``K^2 (c - t0 - T/6)`` at the centre c, of which
  ``K^2 (c - t0)`` is what rows share with later ones, so that it drifts by K^2;
- quantization of the integrated output, ``(q_end - q_start) / T``: variance ``2 Q^2 / T^2``, and
  ``-Q^2 / (T_i T_j)`` between rows that share a boundary: a state that is forgotten after one row.

What n stands for in the penalties of information criteria is the effective sample size of coloured noise. A
column's information in the coloured rows is the squared norm of the whitened column; were the rows
independent with the variances they have, it would be ``sum x_i^2 / Var_i``. n times the ratio of the two is
how many independent rows would tell the coefficient as well as the n coloured ones do. For a constant and a
first-order process of correlation a it is ``(n (1 - a) + 2 a) / (1 + a)``; for white noise it is n, whatever
the durations. A column that alternates faster than the noise wanders would count as more than n rows; it
counts as n.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, row_blocks
from imubayes.inference.linear import Linear, Rows
from imubayes.sensors.noise import FLICKER_RATIO, Noise, flicker

ALIKE = 1e-8
"""Largest change of an exponent, gap over time constant, with which gaps are one: rounded times differ so."""

FASTEST = 20.0
"""Processes whose time constant is this much shorter than a row are white there: correlation below 2.5 %."""

DROWNED = 0.25
"""Variance of white noise in a row over B^2 below which the noise is all flicker there."""

FINE_RATIO = 4.0
"""Ratio of time constants there: the Allan variance is flat to 0.1 %, with the usual one to 4 %."""


class Processes(NamedTuple):
    """First-order processes for bias instability: variances (m,) per unit B^2, time constants (m,), s.

    What is faster than all of them is white, of the density `white` per unit B^2, s.
    """

    variance: FloatArray
    tau: FloatArray
    white: float = 0.0

    def averaged(self, duration: FloatArray) -> FloatArray:
        """Variance (n,) per unit B^2 of rows of these durations (n,), s."""
        return averaged_variance(duration[:, None] / self.tau) @ self.variance + self.white / duration


class States(NamedTuple):
    """States of some processes over n rows; a single line where all rows are alike.

    A row has a variance of its `own` (n,), but for what a random walk shares with later rows. U, V, F (n, J)
    are what it sees of a state, what it tells of it, and what is left of it after the row; `rates`, `power`
    and `drift` (J,) decay in 1/s, variance, and its growth in 1/s.
    """

    own: FloatArray
    U: FloatArray
    V: FloatArray
    F: FloatArray
    rates: FloatArray
    power: FloatArray
    drift: FloatArray

    def over(self, gap: FloatArray) -> tuple[FloatArray, ...]:
        """All of them in this order, as the kernel takes them: for the rates the decays over gaps (n,), s."""
        alike = np.ptp(gap) * self.rates.max(initial=0.0) < ALIKE
        told = self._replace(rates=np.exp((gap[:1] if alike else gap)[:, None] * -self.rates))
        return tuple(np.ascontiguousarray(values) for values in told)


def processes(rows: Rows, noise: Noise | None = None) -> Processes:
    """Return the processes that make flicker noise of unit B over the averaging times of `rows`.

    Where the noise is about known, white noise hides the flicker below some averaging time; where that is far
    below a row, the time constants are so close that their ripple is not taken for it.
    """
    if noise is not None and noise.B == 0.0:
        return Processes(np.empty(0), np.empty(0))
    least = float(np.median(rows.duration)) if rows.finest is None else rows.finest
    longest = float(rows.duration.max()) if rows.finest is None else rows.finest
    equal = 0.0 if noise is None else (noise.N / noise.B) ** 2
    ratio = FLICKER_RATIO if noise is None or equal > DROWNED * least else FINE_RATIO
    return flickering(min(max(0.1 * equal, least), rows.span), rows.span, longest / FASTEST, ratio)


def flickering(
    shortest: float, longest: float, fastest: float = 0.0, ratio: float = FLICKER_RATIO
) -> Processes:
    """Return processes of flicker noise of unit B from the shortest to the longest averaging time, s.

    Those whose time constant is not above the `fastest`, s, count as white, with all that a sum without an
    end would have below the shortest time.
    """
    variance, tau = flicker(1.0, shortest, longest, ratio)
    slow, without_end = tau > fastest, tau[0] / (ratio - 1.0)
    white = 2.0 * float(variance[0]) * (float(tau[~slow].sum()) + float(without_end))
    return Processes(variance[slow], tau[slow], white)


def gauss_markov(duration: FloatArray, parts: Processes) -> States:
    """First-order processes over rows of these durations (n,), s."""
    x = duration[:, None] / parts.tau
    E = -np.expm1(-x) / x
    own, still = parts.averaged(duration), np.zeros(len(parts.tau))
    return States(own, E, E, np.exp(-x), 1.0 / parts.tau, parts.variance, still)


def quantization(duration: FloatArray, joined: NDArray[np.bool_]) -> States:
    """Quantization of unit Q; `joined` (n,) says which rows begin where the one before ends."""
    inverse = 1.0 / duration[:, None]
    seen, nothing = np.where(joined[:, None], -inverse, 0.0), np.zeros(1)
    own = 2.0 * inverse[:, 0] ** 2
    return States(own, seen, inverse, np.zeros_like(inverse), nothing, np.ones(1), nothing)


class Together(NamedTuple):
    """States of k independent processes of unit size, whose `own` variances (k, n|1) are not added up yet.

    `of` (J,) says whose each state is.
    """

    units: States
    of: NDArray[np.intp]

    def sized(self, sizes: FloatArray) -> States:
        """States of the sum of the processes in these sizes (k,), or (k, m) of m sums at once."""
        square, one = sizes**2, self.units
        each = square[self.of].T
        return one._replace(own=one.own.T @ square, power=(each * one.power).T, drift=(each * one.drift).T)

    def by_size(self, sizes: FloatArray, by: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
        """Derivatives (k,) by the logarithms of the sizes, of those by own (n,), power and drift (J,)."""
        (by_own, by_power, by_drift), one = by, self.units
        by_state = np.bincount(self.of, by_power * one.power + by_drift * one.drift, len(sizes))
        return 2.0 * sizes**2 * ((one.own * by_own).sum(axis=1) + by_state)


def together(parts: Sequence[States], axes: FloatArray | None = None) -> Together:
    """Independent processes side by side; `axes` (n, a) as `Rows` has them."""
    # a single line is alike in every row
    n = max(len(part.U) for part in parts) if axes is None else len(axes)
    own, U, V, F = (
        [table if len(table) == n else np.repeat(table, n, axis=0) for table in tables]
        for tables in zip(*(part[:4] for part in parts), strict=True)
    )
    U, V, F = (np.concatenate(tables, axis=1) for tables in (U, V, F))
    rates, power, drift = (np.concatenate(each) for each in zip(*(part[4:] for part in parts), strict=True))
    of = np.repeat(np.arange(len(parts)), [len(part.rates) for part in parts])
    if axes is None:
        return Together(States(np.array(own), U, V, F, rates, power, drift), of)
    width = axes.shape[1]
    U, V = ((table[:, :, None] * axes[:, None, :]).reshape(n, -1) for table in (U, V))
    F, rates, power, drift = (np.repeat(values, width, axis=-1) for values in (F, rates, power, drift))
    own = np.array(own) * np.sum(axes**2, axis=1)
    return Together(States(own, U, V, F, rates, power, drift), np.repeat(of, width))


def common(duration: FloatArray) -> FloatArray:
    """One duration where all are alike: what follows from it is then broadcast, not held for each row."""
    return duration[:1] if duration.min() == duration.max() else duration


def nbk_states(duration: FloatArray, parts: Processes) -> dict[str, States]:
    """States of unit N, B and K, which walks from the run's start, over rows of these durations (n,), s."""
    lasting = common(duration)
    nothing, one, still = np.empty((len(lasting), 0)), np.ones((len(lasting), 1)), np.zeros(1)
    return {
        "N": States(1.0 / lasting, nothing, nothing, nothing, *np.empty((3, 0))),
        "B": gauss_markov(lasting, parts),
        "K": States(lasting / -6.0, one, one, one, still, still, np.ones(1)),
    }


def nbk(parts: Processes, rows: Rows) -> Together:
    """N, B and K side by side, over rows."""
    return together([*nbk_states(rows.duration, parts).values()], rows.axes)


def states_of(noise: Noise, parts: Processes, duration: FloatArray, axes: FloatArray | None = None) -> States:
    """States of N, B and K over rows of these durations (n,), s; without a walk where there is none."""
    sizes, made = {"N": noise.N, "B": noise.B, "K": noise.K}, nbk_states(duration, parts)
    there = [name for name in made if name != "K" or noise.K**2 > 0.0]
    return together([made[name] for name in there], axes).sized(np.array([sizes[name] for name in there]))


class Carry(NamedTuple):
    """Whitening of a run between two of its parts, J states; the arrays change as it goes on.

    The rows before explain the covariance `explained` (J, J), less that of a random walk as it is, and have
    the states `means` (J, width) by column. Of the last row: its gain and what it left of the `past` states,
    (J,), itself (width,) before it was scaled, its variance (1,), and its end and centre, s, `at` (2,).
    """

    explained: FloatArray
    means: FloatArray
    gain: FloatArray
    past: FloatArray
    last: FloatArray
    variance: FloatArray
    at: FloatArray


def begin(states: int, start: float, width: int) -> Carry:
    """Whitening before the first row, which begins at `start`, s, of tables of `width` columns."""
    J, zeros = states, np.zeros
    at = np.full(2, start)
    return Carry(zeros((J, J)), zeros((J, width)), zeros(J), zeros(J), zeros(width), zeros(1), at)


def whiten_on(
    carry: Carry,
    states: States,
    t: FloatArray,
    duration: FloatArray,
    table: FloatArray,
    gains: FloatArray | None = None,
) -> FloatArray:
    """Whiten the next rows in place, and give their variances (k,) given all rows before.

    `carry` is after the rows before, and moves on. The rows `table` (k, width), row-major, at times (k,), s,
    that last (k,), s, have the width that the whitening began with; `gains` (k, J) keep what `swept_back`
    needs of the way.
    """
    # what is compiled is imported where rows are whitened: a study is read without it
    from imubayes.inference.noise_kernel import sweep

    gap, step = apart(t, duration, carry.at.tolist())
    d, room = np.empty(len(t)), tuple(np.empty((3, len(states.rates))))
    *carried, at = carry
    gains = np.empty((0, 0)) if gains is None else gains
    sweep(table, step, states.over(gap), tuple(carried), d, gains, room)
    at[:] = t[-1] + 0.5 * duration[-1], t[-1]
    return d


def apart(t: FloatArray, duration: FloatArray, before: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Gap before each row (n,) and step from centre to centre, s.

    Rows at one time, of which axes see different components, have a gap of minus their duration. `before` are
    end and centre of the row before the first.
    """
    half = 0.5 * duration
    gap = t - half - np.concatenate(([before[0]], (t + half)[:-1]))
    # of a gap that is rounding, below zero, what is fast enough would grow
    gap[np.abs(gap) < ALIKE * duration] = 0.0
    return gap, np.diff(t, prepend=before[1])


def whiten(
    noise: Noise, rows: Rows, table: FloatArray, parts: Processes | None = None
) -> tuple[FloatArray, FloatArray]:
    """Whiten a row-major table (n, width) in place; with it the variance (n,) of each row given those before.

    At least one of N, B, K is positive; `parts` are the processes that stand for B, by default those that
    matter beside the white noise.
    """
    states = states_of(noise, processes(rows, noise) if parts is None else parts, rows.duration, rows.axes)
    return table, whiten_by(states, rows, table)


def whiten_by(states: States, rows: Rows, table: FloatArray, gains: FloatArray | None = None) -> FloatArray:
    """Whiten all rows of a run in place, and give their variances (n,); `gains` as in `whiten_on`."""
    carry = begin(len(states.rates), float(rows.t[0] - 0.5 * rows.duration[0]), table.shape[1])
    return whiten_on(carry, states, rows.t, rows.duration, table, gains)


def whiten_each(states: States, rows: Rows, table: FloatArray) -> FloatArray:
    """Whiten each column (n, m) of a run in place by noise of its own, and give its variances (n, m).

    Of the states `own` (n|1, m), `power` and `drift` (J, m) are by column.
    """
    from imubayes.inference.noise_kernel import sweep_each

    start, J, m = float(rows.t[0] - 0.5 * rows.duration[0]), len(states.rates), table.shape[1]
    gap, step = apart(rows.t, rows.duration, (start, start))
    d, by_state = np.empty_like(table), (np.zeros(J), np.zeros((J * J, m)), *np.zeros((3, J, m)))
    sweep_each(table, step, states.over(gap), d, (*by_state, *np.zeros((5, m))))
    return d


def averaged_variance(x: FloatArray) -> FloatArray:
    """Variance of the average of a unit process over x time constants: 2 (x - 1 + exp(-x)) / x^2."""
    small = 1.0 - x / 3.0 + x * x / 12.0 - x**3 / 60.0
    return np.where(x < 1e-3, small, 2.0 * (x + np.expm1(-x)) / np.maximum(x, 1e-3) ** 2)


def effective_samples(f: Factor, rows: Sequence[Linear], noises: Sequence[Noise]) -> float:
    """Effective sample size, the geometric mean over the columns of a factor of all whitened rows.

    These are the columns that count: those of the candidates that are excited. The rows of each run, which
    its noise whitened, may have others.
    """
    alone = np.zeros(f.p)
    for part, noise in zip(rows, noises, strict=True):
        places = [part.names.index(name) for name in f.names]
        # of a run that is read a part at a time each average counts as so many single samples
        single = Rows(part.t, np.full(len(part), part.sampling)) if part.stream else part.rows
        weight = part.counts / marginal_variance(noise, single)
        for a, b in row_blocks(len(part)):
            alone += weight[a:b] @ part.columns(a, b)[:, places] ** 2
    return samples_of(f.column_norms**2, alone, f.n)


def samples_of(whitened: FloatArray, alone: FloatArray, n: int) -> float:
    """Effective sample size of n rows from what they tell of each column (p,), and would if independent.

    That is the squared norm of the whitened column, and of the rows divided by the noise's sd.

    Examples
    --------
    >>> round(samples_of(np.array([1.0, 4.0]), np.array([100.0, 100.0]), 1000), 9)
    20.0
    """
    told = alone > 0.0
    share = np.minimum(whitened[told] / alone[told], 1.0)
    return n * float(np.exp(np.mean(np.log(share)))) if told.any() else float(n)


def marginal_variance(noise: Noise, rows: Rows, parts: Processes | None = None) -> FloatArray:
    """Variance (n,) of the noise in each row, SI squared.

    White noise, flicker and a random walk that starts with the run, each averaged over the row. Flicker has
    no end: how large it is depends on the `parts` that it is made of, by default those of these rows.
    """
    parts = parts or processes(rows, noise)
    start = rows.t[0] - 0.5 * rows.duration[0]
    white = noise.N**2 + noise.B**2 * parts.white
    variance = white / rows.duration + noise.K**2 * (rows.t - start - rows.duration / 6.0)
    for unit, tau in zip(parts.variance.tolist(), parts.tau.tolist(), strict=True):
        variance += noise.B**2 * unit * averaged_variance(rows.duration / tau)
    return variance if rows.axes is None else variance * np.sum(rows.axes**2, axis=1)
