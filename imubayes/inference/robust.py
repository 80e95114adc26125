"""Robust analysis: find the dwells that shocks and slips have spoilt, and go on without their rows.

Outliers hide behind the noise that they inflate. So the noise is estimated without the dwells that are
suspected, all dwells are judged by that noise, and so on until the same ones are suspected again.

The rows of a distrusted dwell are left out. A free offset for the dwell would do where all of it is off by as
much, but a shock of one second in a dwell of thirty leaves its shape behind, and the noise estimate with it:
with two percent of shocks error bars came out 13 to 27 times as large as those of clean data, 1.03 times
without the rows.

What it cannot do. An offset that the terms can follow is told from a term by the prior alone: of offsets at
one of the twelve positions at the highest level of a centrifuge all of 50 sd of the noise were found, but of
those of 20 sd two of three, and the others pulled a coefficient by up to 11 sd. Spikes of single samples are
no matter of dwells. Two percent of the samples with spikes of either sign spoil all dwells alike and count as
white noise: no coefficient is off, error bars are three times as large. Spikes of one sign are a bias as
well: 4 to 8 sd of b0.

A two-component mixture, coefficients and offsets integrated out, says which dwells are contaminated.
Dwell means obey ``y = X theta + noise + sum_d gamma_d delta_d e_d`` with ``theta ~ N(0, sd^2)``, noise of
known covariance, ``gamma_d ~ Bernoulli(eps)``, ``eps ~ Beta`` and gross offsets ``delta_d ~ N(0, tau_d^2)``.
With theta integrated out the clean means have a precision Q, and all that the data say of offsets is in Q and
``r = Q y``: those of a set g have the posterior precision ``1/tau^2 + Q_gg`` and the mean that solves
``(1/tau^2 + Q_gg) delta = r_g``. The odds of one more, or of one less, follow from the density of its own
offset at zero (Savage and Dickey), which keeps the digits that an update of the covariance by ``-tau^2``
would cancel.

Before the noise is known a fit with least absolute deviations, which outliers do not spoil, gives the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.dwells import Dwells, dwells_of, rows_kept
from imubayes.inference.linear import Linear, residuals
from imubayes.inference.whiten import whiten
from imubayes.rig.inputs import Run
from imubayes.rig.runs import renewed
from imubayes.sensors.noise import Noise

Mask = NDArray[np.bool_]

SHARE = (1.0, 49.0)
"""Beta prior of the share of contaminated dwells: mean 2 %, below 6 % with 95 %."""

SWEEPS = 400
"""Sweeps over all dwells: a probability of a half is then known to a few percent."""

BURN_IN = 100
"""Sweeps that are dropped."""


class DwellEvidence(NamedTuple):
    """All that m dwell means say of their offsets, whose prior sds are tau (m,), SI.

    Q (m, m) is the precision of the means where none is contaminated, coefficients integrated out, and r (m,)
    is ``Q y``; `certain` (m,) are precisions of each mean, given the others, at known coefficients.
    """

    Q: FloatArray
    r: FloatArray
    tau: FloatArray
    certain: FloatArray


class Offsets(NamedTuple):
    """Of each of m dwells the probability (m,) that it is contaminated, and its offset (m,) if it is, SI.

    `harm` (m,) is the expected square of the pull, in sd, on the coefficients if the dwell is kept: what of
    its offset the terms would follow, zero where the dwell is not contaminated.
    """

    probability: FloatArray
    mean: FloatArray
    sd: FloatArray
    harm: FloatArray


def evidence(
    dwells: Sequence[Dwells], noise: Sequence[Noise], prior_sd: FloatArray, tau: FloatArray
) -> DwellEvidence:
    """Integrate the coefficients out of the dwell means of all runs, which are independent of each other.

    Prior sds, SI, are those of the coefficients, (p,), and of the offsets, `tau` (m,).
    """
    from scipy.linalg import block_diag

    # inverse of the lower factor of the covariance of all dwell means
    each = (whiten(n, d.means.rows, np.eye(len(d)))[0] for d, n in zip(dwells, noise, strict=True))
    W = np.asarray(block_diag(*each))
    X, y = np.concatenate([d.means.X for d in dwells]), np.concatenate([d.means.y for d in dwells])
    # in units of the prior sd a column is no larger than what it may explain
    basis = np.linalg.qr(np.concatenate((W @ X * prior_sd, np.eye(len(prior_sd)))))[0][: len(y)]
    left = W - basis @ (basis.T @ W)
    Q = W.T @ left
    return DwellEvidence(0.5 * (Q + Q.T), left.T @ (W @ y), tau, np.einsum("ij,ij->j", W, W))


def conditional(e: DwellEvidence, on: Mask) -> tuple[FloatArray, FloatArray]:
    """Mean and variance (m,) of each dwell's offset if it and those that are `on` (m,) are contaminated."""
    g = np.flatnonzero(on)
    among = e.Q[:, g]
    T = np.linalg.inv(np.diag(e.tau[g] ** -2.0) + among[g])
    delta = T @ e.r[g]
    known = np.maximum(np.diag(e.Q) - np.einsum("ij,jk,ik->i", among, T, among), 0.0)
    variance = 1.0 / (e.tau**-2.0 + known)
    mean = variance * (e.r - among @ delta)
    variance[g], mean[g] = np.diag(T), delta
    return mean, variance


def log_odds(e: DwellEvidence, on: Mask, moments: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Log odds (m,) that each dwell is contaminated, given which others are `on`."""
    mean, variance = moments
    others = on.sum() - on
    prior = np.log(SHARE[0] + others) - np.log(SHARE[1] + len(on) - 1 - others)
    return prior + 0.5 * np.log(variance / e.tau**2) + 0.5 * mean**2 / variance


def log_posterior(e: DwellEvidence, on: Mask) -> float:
    """Log posterior, up to a constant, that exactly the dwells that are `on` (m,) are contaminated."""
    from scipy.special import betaln

    g = np.flatnonzero(on)
    precision = np.diag(e.tau[g] ** -2.0) + e.Q[np.ix_(g, g)]
    likelihood = 0.5 * e.r[g] @ np.linalg.solve(precision, e.r[g]) - 0.5 * np.linalg.slogdet(precision)[1]
    prior = betaln(SHARE[0] + len(g), SHARE[1] + len(on) - len(g))
    return float(prior + likelihood - np.sum(np.log(e.tau[g])))


def sample(e: DwellEvidence, start: Mask, rng: np.random.Generator, *, sweeps: int = SWEEPS) -> Offsets:
    """Probabilities and offsets by Gibbs sampling over the indicators, share of contaminated integrated out.

    At first the dwells of `start` (m,) are taken for contaminated; sweeps over all dwells of the burn-in are
    dropped.
    """
    on = start.copy()
    seen = []
    for _ in range(BURN_IN + sweeps):
        _relocate(e, on, rng)
        seen.append(_sweep(e, on, rng))
    mean, variance, odds = np.array(seen[BURN_IN:]).swapaxes(0, 1)
    probability = np.exp(-np.logaddexp(0.0, -odds))
    weight = probability / probability.sum(axis=0)
    middle = np.sum(weight * mean, axis=0)
    followed = np.maximum(e.certain + e.tau**-2.0 - 1.0 / variance, 0.0)
    return Offsets(
        probability=probability.mean(axis=0),
        mean=middle,
        sd=np.sqrt(np.sum(weight * (variance + (mean - middle) ** 2), axis=0)),
        harm=np.mean(probability * mean**2 * followed, axis=0),
    )


def _relocate(e: DwellEvidence, on: Mask, rng: np.random.Generator) -> None:
    """Draw anew, in place, where one of the contaminated dwells is.

    Where the terms can follow either of two offsets, the data tell that a dwell is off, but not which one:
    flips of one indicator would have to pass through states without any or with both.
    """
    g = np.flatnonzero(on)
    if not len(g):
        return
    on[rng.choice(g)] = False
    free = np.flatnonzero(~on)
    odds = log_odds(e, on, conditional(e, on))[free]
    weight = np.exp(odds - odds.max())
    on[rng.choice(free, p=weight / weight.sum())] = True


def _sweep(e: DwellEvidence, on: Mask, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw every indicator once, in place; give mean and variance of the offsets, and the odds, at the end.

    The odds change only where an indicator does: they are found once for each change, not for each dwell.
    """
    u = rng.random(len(on))
    level, done = np.log(u) - np.log1p(-u), 0
    while True:
        mean, variance = conditional(e, on)
        odds = log_odds(e, on, (mean, variance))
        changes = np.flatnonzero((level < odds)[done:] != on[done:])
        if not len(changes):
            return mean, variance, odds
        d = done + int(changes[0])
        on[d] = not on[d]
        done = d + 1


WIDE = 100.0
"""Prior sd of an offset in robust sds of the dwell means: offsets are gross. Odds depend on its logarithm."""

SUSPECT = 4.0
"""Robust sds beyond which a dwell is suspected."""

STEPS = 50
"""Steps of the fit with least absolute deviations: it is a start, no more."""

NEAR = 0.05
"""Residuals below this many robust sds weigh alike in that fit."""

NORMAL_MAD = 1.4826
"""Sd of a normal sample over its median absolute deviation."""


def first_suspects(
    rows: Sequence[Linear], dwells: Sequence[Dwells], prior_sd: FloatArray
) -> tuple[Mask, FloatArray]:
    """Dwells (m,) that stand out from a fit with least absolute deviations; prior sds (m,) of offsets, SI.

    A dwell stands out by its mean, or by the scatter of its samples. A prior sd is a hundred robust sds of
    the run's dwell means, or the largest residual where that is larger.
    """
    theta = _least_absolute(dwells, prior_sd)
    suspects, tau = [], []
    for part, d in zip(rows, dwells, strict=True):
        left = d.means.y - d.means.X @ theta
        sd = _robust_sd(left)
        within, counts = residuals(part, theta), np.diff(d.edges)
        within -= np.repeat(np.add.reduceat(within, d.edges[:-1]) / counts, counts)
        scatter = np.sqrt(np.add.reduceat(within**2, d.edges[:-1]) / counts)
        rough = np.log(np.maximum(scatter, np.finfo(float).eps * (scatter.max() or 1.0)))
        rough -= np.median(rough)
        off = np.abs(left) > SUSPECT * sd
        both = off | (np.abs(rough) > SUSPECT * _robust_sd(rough))
        suspects.append(both if 2 * np.count_nonzero(both) <= len(d) else off)
        tau.append(np.full(len(d), max(WIDE * sd, float(np.abs(left).max()))))
    return np.concatenate(suspects), np.concatenate(tau)


def _least_absolute(dwells: Sequence[Dwells], prior_sd: FloatArray) -> FloatArray:
    """Coefficients (p,) of least absolute deviations within their prior, by reweighted least squares."""
    X, y = np.concatenate([d.means.X for d in dwells]) * prior_sd, np.concatenate([d.means.y for d in dwells])
    runs = np.split(np.arange(len(y)), np.cumsum([len(d) for d in dwells])[:-1])
    eye, theta, weight = np.eye(X.shape[1]), np.zeros(X.shape[1]), np.ones(len(y))
    for _ in range(STEPS):
        left = y - X @ theta
        for run in runs:
            sd = _robust_sd(left[run])
            weight[run] = 1.0 / sd / np.sqrt(np.maximum(np.abs(left[run]) / sd, NEAR))
        stacked = np.concatenate((X * weight[:, None], eye)), np.concatenate((y * weight, 0.0 * theta))
        theta = np.linalg.lstsq(*stacked, rcond=None)[0]
    return theta * prior_sd


def _robust_sd(left: FloatArray) -> float:
    """Sd of a sample that is normal but for less than half of it; never zero."""
    return NORMAL_MAD * float(np.median(np.abs(left))) or float(np.abs(left).max()) or 1.0


NoiseOf = Callable[[Sequence[Run], Sequence[Linear]], Sequence[Noise]]
"""How the noise of each run is known, from runs and their rows."""

ROUNDS = 6
"""Rounds of noise and indicators; two or three do, unless the dwells' verdicts hang on the noise."""

LIKELY = 0.5
"""Probability from which a dwell is left out."""

HARM = 25.0
"""Expected squared pull, in sd, from which a dwell is left out though it is likely clean: one of two, say, of
which the terms could follow either. Clean dwells stay below 10 on a tumble and a centrifuge of three
levels."""


@dataclass(frozen=True, slots=True)
class Distrusted:
    """A dwell of a run, from start to stop, s, whose rows the robust analysis leaves out.

    The probability that it is contaminated is below a half where one of several dwells is, and the data do
    not tell which; if it is, its mean is off by `offset`, of this sd, SI.
    """

    run: str
    start: float
    stop: float
    probability: float
    offset: float
    sd: float


class Trusted(NamedTuple):
    """Runs without the dwells that are distrusted, and their rows, in the order given.

    A run most of whose dwells are distrusted is not among them. What was left out comes worst first; `notes`
    say in words what did not go as usual.
    """

    runs: tuple[Run, ...]
    rows: tuple[Linear, ...]
    distrusted: tuple[Distrusted, ...]
    notes: tuple[str, ...] = ()

    @property
    def noted(self) -> list[Run]:
        """The runs, of which the first says what did not go as usual, with the extremes of what is left."""
        first, *others = self.runs
        source = replace(first.source, notes=(*first.source.notes, *self.notes))
        return [renewed(run) for run in (replace(first, source=source), *others)]


def robust_rows(
    runs: Sequence[Run],
    rows: Sequence[Linear],
    prior_sd: FloatArray,
    noise_of: NoiseOf,
    *,
    rng: np.random.Generator,
) -> Trusted:
    """Leave out the dwells that are contaminated, of runs of one component with known inputs.

    `prior_sd` (p,) are those of the rows' columns, SI; `noise_of` is asked of ever other parts of the runs.
    It is an `UnobservableError` if no run has a majority of dwells that can be trusted.
    """
    dwells = [dwells_of(part) for part in rows]
    bad, tau = first_suspects(rows, dwells, prior_sd)
    for _ in range(ROUNDS):
        e = evidence(dwells, noise_of(*_without(runs, rows, dwells, bad)), prior_sd, tau)
        offsets = sample(e, bad, rng)
        before, bad = bad, (offsets.probability > LIKELY) | (offsets.harm > HARM)
        if np.array_equal(before, bad) or _without_majority(dwells, bad):
            break
    out = before | bad
    if _without_majority(dwells, out):
        # where two runs contradict each other, the sampler ends where it happens to start: is all of one off?
        of_run = np.repeat(np.arange(len(dwells)), [len(d) for d in dwells])
        states = (out, *(of_run == k for k in range(len(dwells))))
        lost = _without_majority(dwells, max(states, key=lambda on: log_posterior(e, on)))
        names, rest = [runs[k].name for k in lost], [k for k in range(len(runs)) if k not in lost]
        if not rest:
            raise UnobservableError(
                f"more than half of the dwells of {', '.join(names)} fit neither each other nor the noise:"
                " outliers must be the exception; look at units, axes and references, or leave robust out"
            )
        trusted = robust_rows([runs[k] for k in rest], [rows[k] for k in rest], prior_sd, noise_of, rng=rng)
        return trusted._replace(notes=(*(_LOST.format(name) for name in names), *trusted.notes))
    unsettled = int(np.count_nonzero(before ^ bad))
    notes = (_UNSETTLED.format(unsettled),) if unsettled else ()
    return Trusted(*_without(runs, rows, dwells, out), _named(dwells, offsets, out), notes)


_UNSETTLED = (
    "the verdict on {} of the dwells hangs on the noise, and the noise on the verdict: all of these are left"
    " out"
)
_LOST = (
    "run '{}' is left out: most of its dwells contradict the other runs or each other. Two runs that"
    " contradict each other do not tell which is right: look at units, axes, references, and turn-on bias"
)


def _by_run(dwells: Sequence[Dwells], values: Mask) -> list[Mask]:
    return np.split(values, np.cumsum([len(d) for d in dwells])[:-1])


def _without(
    runs: Sequence[Run], rows: Sequence[Linear], dwells: Sequence[Dwells], bad: Mask
) -> tuple[tuple[Run, ...], tuple[Linear, ...]]:
    """Runs and rows without the dwells that are `bad` (m,)."""
    kept = [np.repeat(~b, np.diff(d.edges)) for d, b in zip(dwells, _by_run(dwells, bad), strict=True)]
    return (
        tuple(run.left(k) for run, k in zip(runs, kept, strict=True)),
        tuple(rows_kept(part, k) for part, k in zip(rows, kept, strict=True)),
    )


def _without_majority(dwells: Sequence[Dwells], bad: Mask) -> list[int]:
    """Runs most of whose dwells are `bad` (m,)."""
    return [k for k, b in enumerate(_by_run(dwells, bad)) if 2 * np.count_nonzero(b) > len(b)]


def _named(dwells: Sequence[Dwells], offsets: Offsets, bad: Mask) -> tuple[Distrusted, ...]:
    """The dwells that are `bad` (m,), those that would do most harm first."""
    where = [(d.means.name, float(a), float(b)) for d in dwells for a, b in zip(d.start, d.stop, strict=True)]
    worst = sorted(np.flatnonzero(bad).tolist(), key=lambda k: -offsets.harm[k])
    return tuple(
        Distrusted(*where[k], *(float(v[k]) for v in (offsets.probability, offsets.mean, offsets.sd)))
        for k in worst
    )
