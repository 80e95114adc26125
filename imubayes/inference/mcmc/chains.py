"""What the chains gave, and whether they can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor


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


@dataclass(frozen=True, slots=True, eq=False)
class NoiseDraw:
    """The linear Gaussian problem at one draw of the noise's posterior.

    Attributes
    ----------
    factor : of all rows, whitened at that noise.
    log_marginal : log p(data | noise) under the full library.
    """

    factor: Factor
    log_marginal: float
