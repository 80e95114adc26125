"""Posteriors by Markov chains: two samplers on one log density.

Here stand what the chains gave, whether they can be trusted, and the linear problem at some of their noises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, noise_scale, row_blocks, with_prior_rows
from imubayes.inference.dwells import always, dwells_of, stacked, whitened_factor
from imubayes.inference.linear import Linear, blocks_of
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import RunSummary, Summary
from imubayes.inference.whiten import nbk, processes, whiten_each
from imubayes.sensors.noise import Noise


@dataclass(frozen=True, slots=True, eq=False)
class Diagnostics:
    """How well the chains mixed.

    Attributes
    ----------
    parameters : d names of what was sampled, coefficients of the collapsed sampler included.
    ess : (d,) effective sample size.
    rhat : (d,) split R-hat over the ensembles.
    tau : (d,) integrated autocorrelation time in steps.
    acceptance : mean share of accepted proposals.
    steps : of each walker, after those that were dropped.
    walkers, ensembles : how many walkers each of the independent ensembles has, and how many there are.
    seconds : compute time, that of interrupted runs included.
    converged : whether every parameter has the asked effective sample size and R-hat below the limit.
    text : why the chains ended, in words.
    """

    parameters: tuple[str, ...]
    ess: FloatArray
    rhat: FloatArray
    tau: FloatArray
    acceptance: float
    steps: int
    walkers: int
    ensembles: int
    seconds: float
    converged: bool
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """Posterior of a component under the full library, by Markov chains.

    Draws are thinned to `theta.shape[1]` a chain; a chain is one ensemble.

    Attributes
    ----------
    sampler : ``collapsed`` or ``full``.
    names : p columns: terms, then extras.
    units : (p,) SI.
    theta : (chains, draws, p) coefficients, SI.
    runs : g runs that have a noise of their own.
    noise : (chains, draws, g, 3) N, B, K of these runs, SI; constant where the noise was given.
    log_density : (chains, draws) of the log posterior, up to no constant.
    dwells : q dwells of all runs: (run, start in s, stop in s).
    log_likelihood : (chains, draws, q) of each dwell's block averages, given the dwells before it in its run.
    observed : (q,) mean output minus input of each dwell, SI.
    predicted : (chains, draws, q) what the coefficients make of it.
    prior_theta : (draws, p) draws of the coefficients' prior.
    prior_noise : (draws, g, 3) draws of the noise's prior.
    diagnostics : how well the chains mixed.
    interpolation_error : largest error of the log density, in nats, found at exact whitenings; 0 where none
        was interpolated.
    log_evidence : of the full library, by bridge sampling, and its Monte Carlo standard error.
    """

    sampler: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: FloatArray
    runs: tuple[str, ...]
    noise: FloatArray
    log_density: FloatArray
    dwells: tuple[tuple[str, float, float], ...]
    log_likelihood: FloatArray
    observed: FloatArray
    predicted: FloatArray
    prior_theta: FloatArray
    prior_noise: FloatArray
    diagnostics: Diagnostics
    interpolation_error: float
    log_evidence: tuple[float, float]


def of_columns(chains: Chains, columns: Sequence[str], carriers: Sequence[str]) -> Chains:
    """Chains of some columns: a component of a triad, with what is no term of any; `carriers` hold them."""
    places = [chains.names.index(name) for name in carriers]
    return replace(
        chains,
        names=tuple(columns),
        units=tuple(chains.units[k] for k in places),
        theta=chains.theta[..., places],
        prior_theta=chains.prior_theta[..., places],
    )


class NoiseDraw(NamedTuple):
    """Factor of all rows, whitened at a draw of the noise, and log p(data | noise) under the full library."""

    factor: Factor
    log_marginal: float


def at_noise(summary: Summary, rows: Sequence[Linear], noise: FloatArray, sd: FloatArray) -> NoiseDraw:
    """Whiten all rows of g runs by a noise (g, 3), N, B, K of each, SI; sd (p,) are prior sds, SI."""
    factors = [
        whitened_factor(part, Noise(*values.tolist()), processes(part.rows, run.noise))
        for part, values, run in zip(rows, noise, summary.runs, strict=True)
    ]
    whole = stacked([always(f) for f in factors])
    return NoiseDraw(whole, log_marginal(whole, sd))


def places_of(runs: Sequence[RunSummary]) -> dict[str, slice]:
    """Where ln N, ln B, ln K of each noise that is not known lie among all, by the run that has it."""
    found: dict[str, slice] = {}
    for run in runs:
        if run.found.steering and run.noise_run not in found:
            first = max((place.stop for place in found.values()), default=0)
            found[run.noise_run] = slice(first, first + len(run.found.steering))
    return found


def noises_at(runs: Sequence[RunSummary], x: FloatArray) -> FloatArray:
    """N, B, K (..., g, 3) of every run, from logarithms (..., d) of those that are not known."""
    out, places = np.empty((*x.shape[:-1], len(runs), 3)), places_of(runs)
    for k, run in enumerate(runs):
        out[..., k, :] = (run.noise.N, run.noise.B, run.noise.K)
        if run.found.steering:
            out[..., k, : len(run.found.steering)] = np.exp(x[..., places[run.noise_run]])
    return out


def log_marginal(f: Factor, sd: FloatArray) -> float:
    """Log probability of the rows of a factor, whitened by their true noise, under prior sds (p,).

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.array([[1.0]]), np.array([2.0]), ("b0",))
    >>> round(log_marginal(f, np.array([1.0])), 6)  # y ~ N(0, 2)
    -2.265512
    """
    diagonal = np.diag(with_prior_rows(f.R, 1.0 / sd))
    log_det = f.log_det + 2.0 * float(np.sum(np.log(np.abs(diagonal[:-1]) * sd)))
    return -0.5 * (log_det + float(diagonal[-1] ** 2) + f.n * math.log(2.0 * math.pi))


def at_found_noise(summary: Summary, prior: ScalePrior) -> NoiseDraw:
    """Problem at the noise that was found, its common scale included.

    Rows are hundreds or thousands, so that the scale is known to a few percent: to average over it would take
    ten times as long and hardly move an inclusion.
    """
    found = summary.factor
    scale = noise_scale(found, prior.sd)
    log_det = found.log_det + 2.0 * found.n * math.log(scale)
    return NoiseDraw(replace(found, R=found.R / scale, log_det=log_det, rest=0.0), 0.0)


AT_ONCE = 32
"""Draws that are followed side by side, as vectors: their states stay in the first cache."""


class Pointwise(NamedTuple):
    """The q dwells of all runs, as `Chains` has them, for m draws: (m, q)."""

    dwells: tuple[tuple[str, float, float], ...]
    observed: FloatArray
    predicted: FloatArray
    log_likelihood: FloatArray


def by_dwell(
    rows: Sequence[Linear], estimated: Sequence[Noise], theta: FloatArray, noise: FloatArray
) -> Pointwise:
    """Score every dwell of g runs for m draws of coefficients theta (m, p), SI, and noise N, B, K (m, g, 3).

    The noise that each run's whitening was made for, `estimated`, says which processes matter.
    """
    found, observed, predicted, scores = [], [], [], []
    for run, (part, usual) in enumerate(zip(rows, estimated, strict=True)):
        dwells, blocks = dwells_of(part), blocks_of(part)
        units = nbk(processes(part.rows, usual), blocks.rows)
        # a block belongs to the dwell that its middle lies in; its centre is never on the border of two
        owner = np.searchsorted(dwells.start, blocks.t, side="right") - 1
        owner = np.clip(owner, 0, len(dwells.means.y) - 1)
        first = np.flatnonzero(np.diff(owner, prepend=-1))
        index, score = owner[first], np.empty((len(theta), len(first)))
        for i, j in row_blocks(len(theta), AT_ONCE):
            left = blocks.y[:, None] - blocks.X @ theta[i:j].T
            deviance = whiten_each(units.sized(noise[i:j, run].T), blocks.rows, left)
            deviance = np.log(deviance, out=deviance) + left**2 + math.log(2.0 * math.pi)
            score[i:j] = -0.5 * np.add.reduceat(deviance, first).T
        found += [(part.name, float(dwells.start[d]), float(dwells.stop[d])) for d in index]
        observed.append(dwells.means.y[index])
        predicted.append(theta @ dwells.means.X[index].T)
        scores.append(score)
    return Pointwise(tuple(found), np.concatenate(observed), np.hstack(predicted), np.hstack(scores))
