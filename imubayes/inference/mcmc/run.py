"""The two samplers: from a summary and its rows to chains.

*collapsed* samples the noise parameters with the coefficients integrated out, and draws the coefficients
exactly afterwards; *full* samples both.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import ConvergenceError
from imubayes.inference.importance import Mixture, Student, log_integral
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc import Chains, Diagnostics, NoiseDraw, at_noise, by_dwell, noises_at
from imubayes.inference.mcmc.density import (
    TAIL,
    Density,
    condition,
    density_of,
    draw_conditional,
    fit_noise,
    in_parts,
    independent,
    independent_noise,
    log_joint,
    log_marginal,
    theta_of,
)
from imubayes.inference.mcmc.ensembles import (
    LOOKED_AT,
    ChainHistory,
    Limits,
    Target,
    effective_size,
    run_ensembles,
    split_rhat,
)
from imubayes.inference.summary import Summary
from imubayes.work import Progress, silent

Method = Literal["collapsed", "full"]

DRAWS = 250
"""Draws of each ensemble that the result keeps."""

INDEPENDENT, DIFFERENTIAL = 0.9, 0.1
"""Shares of the two moves: the first is as good as its fit, the second does not depend on it."""

BRIDGE = 8000
"""About so many draws go into the bridge."""

TRUSTED = 2.0
"""Nats: largest error of the log density that leaves the noise's posterior where it is, to an sd or so."""


class Sampled(NamedTuple):
    """Chains of a component, and the linear Gaussian problem at some of their noises.

    Beside them stands what was sampled, and what proposed the noise.
    """

    chains: Chains
    noises: tuple[NoiseDraw, ...]
    density: Density
    proposal: Student | Mixture


def sample(
    summary: Summary,
    rows: Sequence[Linear],
    sd: FloatArray,
    *,
    method: Method = "collapsed",
    limits: Limits | None = None,
    progress: Progress = silent,
) -> Sampled:
    """Sample the posterior of all columns and of the noise that is not known.

    Parameters
    ----------
    summary : of the runs.
    rows : of each run, as they went into the summary.
    sd : (p,) prior sds of all columns, SI.
    method : ``collapsed`` or ``full``.
    limits : when the chains end, and where they are kept.
    progress : is told how far they are, now and then.

    Raises
    ------
    ConvergenceError : at the time limit, or before, where the chains do not get there; `estimate` has what
        they are until then. Without an estimate: if the density cannot be sampled at all.
    InputError : if the checkpoint cannot be used.

    Examples
    --------
    >>> from imubayes.inference.linear import linear_of
    >>> from imubayes.inference.prior import prior
    >>> from imubayes.inference.summary import summarize
    >>> from imubayes.rig.tumbles import tumble
    >>> from imubayes.rig.simulate import simulate
    >>> from imubayes.sensors.catalogue import sensor
    >>> from imubayes.sensors.terms import library
    >>> tactical = sensor("mems_tactical", kind="accelerometer")
    >>> lib = library("accelerometer", powers=1, asymmetry=-1)
    >>> runs = simulate(tactical, [tumble(angles=12, dwell=5.0)], seed=1)
    >>> summary = summarize(runs, lib, sensor=tactical)
    >>> rows = [linear_of(run, lib) for run in runs]
    >>> sample(summary, rows, prior(tactical, lib).sd).chains.diagnostics.converged
    True
    """
    from threadpoolctl import threadpool_limits

    limits = limits or Limits()
    rng = np.random.default_rng([limits.seed, 1])
    limits = replace(limits, fingerprint=_fingerprint(summary, rows, sd, method, limits.seed))
    # many small matrices: threads of the linear algebra only wait for each other
    with threadpool_limits(1, user_api="blas"):
        progress("whitening the runs over a range of noises")
        density = density_of(summary, rows, sd, rng)
        if astray := [run.name for run, at in zip(summary.runs, density.runs, strict=True) if at.misleads]:
            # it is made up between its whitenings: walkers would go astray in it
            raise ConvergenceError(
                f"the likelihood of the noise of run{'s' if len(astray) > 1 else ''} {', '.join(astray)} is"
                " too steep to be followed, as where residuals are no noise"
            )
        q = _fitted(density, summary, rng)
        if method == "collapsed" and density.d == 0:
            history = _without_noise(limits)
        else:
            history = run_ensembles(target_of(density, q, method), limits, progress)
        progress("drawing from the chains")
        noises, error = _noise_draws(density, history, summary, rows, limits.draws)
        if error > TRUSTED:
            text = f"not converged: the density is off by {error:.1f} nats between the whitenings"
            history = history._replace(found=replace(history.found, converged=False, text=text))
        chains = _chains((density, summary, rows), history, method, error, rng)
        sampled = Sampled(chains, noises, density, q)
    if not history.found.converged:
        raise ConvergenceError(f"the {method} sampler has {history.found.text}", sampled)
    return sampled


def target_of(density: Density, q: Student | Mixture, method: Method) -> Target:
    """What is sampled, started and proposed from q."""
    full, p = method == "full", density.p

    def start(rng: np.random.Generator, size: int) -> FloatArray:
        x = np.empty((0 if density.d else size, density.d))
        while len(x) < size:  # where the density is not zero
            drawn = q.draw(size, rng)
            x = np.concatenate((x, drawn[np.isfinite(log_marginal(density, drawn))]))[:size]
        if not full:
            return x
        return np.column_stack((draw_conditional(condition(density, x), rng.standard_normal((size, p))), x))

    def readable(c: FloatArray) -> FloatArray:
        return np.concatenate((theta_of(density, c[..., :p]), c[..., p:]), axis=-1) if full else c

    proposal = independent(density, q) if full else independent_noise(q)
    return Target(
        names=(*density.names, *density.parameters) if full else density.parameters,
        log_prob=_log_prob(density, method),
        moves=((proposal, INDEPENDENT), (None, DIFFERENTIAL)),
        start=start,
        readable=readable,
    )


def _log_prob(density: Density, method: Method) -> Callable[[FloatArray], FloatArray]:
    p = density.p
    if method == "collapsed":
        return lambda x: log_marginal(density, x)
    return lambda c: log_joint(density, c[:, :p], c[:, p:])


def _fitted(density: Density, summary: Summary, rng: np.random.Generator) -> Student | Mixture:
    """Proposal for the noise, fitted from where each run by itself has it."""
    start, spread = np.empty(density.d), np.empty(density.d)
    for run, made, places in zip(summary.runs, density.runs, density.places, strict=True):
        if places is not None:
            start[places], known = made.top, 1.0 / np.sqrt(2.0 * run.samples)
            spread[places] = np.maximum(run.found.sd[: len(run.found.steering)], known)
    return fit_noise(density, start, spread, rng) if density.d else Student(start, np.empty((0, 0)), TAIL)


def _without_noise(limits: Limits) -> ChainHistory:
    """Every draw is exact and independent where there is no noise to sample."""
    n, empty = limits.ensembles, np.zeros(0)
    nothing = np.empty((-(-int(limits.ess) // n), 1, 0))
    text = "nothing but coefficients: every draw is exact and independent"
    found = Diagnostics((), empty, empty, empty, 1.0, len(nothing), 1, n, 0.0, True, text)
    return ChainHistory((nothing,) * n, (np.zeros(nothing.shape[:2]),) * n, found)


def _drawn(
    density: Density, history: ChainHistory, method: Method, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Coefficients phi (steps, walkers, p) and logarithms x (steps, walkers, d), one ensemble after another.

    The collapsed sampler's coefficients are drawn here, exactly, and for as many walkers as the
    autocorrelation is taken from: given the noise they are independent of each other, so that they mix as
    fast as the noise does, or faster.
    """
    p = density.p
    if method == "full":
        return ((c[..., :p], c[..., p:]) for c in history.chains)

    def drawn(x: FloatArray) -> FloatArray:
        return draw_conditional(condition(density, x), rng.standard_normal((len(x), p)))

    chains = (chain[:, :LOOKED_AT] for chain in history.chains)
    return ((in_parts(drawn, flat(chain)).reshape(*chain.shape[:2], p), chain) for chain in chains)


def _chains(
    problem: tuple[Density, Summary, Sequence[Linear]],
    history: ChainHistory,
    method: Method,
    error: float,
    rng: np.random.Generator,
) -> Chains:
    density, summary, rows = problem
    kept, whole = list[tuple[FloatArray, FloatArray]](), list[FloatArray]()
    for phi, x in _drawn(density, history, method, rng):
        kept.append((thinned(phi), thinned(x)))
        whole.append(np.concatenate((theta_of(density, phi), x), axis=-1))
    phi, x = (np.array(parts) for parts in zip(*kept, strict=True))
    theta, noise = theta_of(density, phi), noises_at(summary.runs, x)
    scored = by_dwell(
        rows, [run.noise for run in summary.runs], flat(theta), noise.reshape(-1, *noise.shape[2:])
    )
    prior_x = density.center + density.width * rng.standard_normal((DRAWS, density.d))
    log_density = log_joint(density, flat(phi), flat(x))
    # coefficients and noise are judged alike, however they were sampled
    ess, tau = effective_size(whole, history.found.walkers)
    names = (*density.names, *density.parameters)
    diagnosed = replace(history.found, parameters=names, ess=ess, rhat=split_rhat(whole), tau=tau)
    shape = theta.shape[:2]
    return Chains(
        sampler=method,
        names=density.names,
        units=_units(summary),
        theta=theta,
        runs=tuple(run.name for run in summary.runs),
        noise=noise,
        log_density=log_density.reshape(shape),
        dwells=scored.dwells,
        log_likelihood=scored.log_likelihood.reshape(*shape, -1),
        observed=scored.observed,
        predicted=scored.predicted.reshape(*shape, -1),
        prior_theta=density.sd * rng.standard_normal((DRAWS, density.p)),
        prior_noise=noises_at(summary.runs, prior_x),
        diagnostics=diagnosed,
        interpolation_error=error,
        log_evidence=_bridged(density, history, method, rng),
    )


def _noise_draws(
    density: Density, history: ChainHistory, summary: Summary, rows: Sequence[Linear], count: int
) -> tuple[tuple[NoiseDraw, ...], float]:
    """Exact whitenings at so many draws, and how far the log density's error there is off its median.

    A constant error changes no probability, and the evidence by bridge sampling by as much.
    """
    if density.d == 0:
        return (NoiseDraw(summary.factor, float(log_marginal(density, np.empty((1, 0)))[0])),), 0.0
    every = np.concatenate([flat(chain[..., -density.d :]) for chain in history.chains])
    chosen = every[np.linspace(0, len(every) - 1, count).astype(int)]
    noises = noises_at(summary.runs, chosen)
    draws = tuple(at_noise(summary, rows, noise, density.sd) for noise in noises)
    exact = np.array([draw.log_marginal for draw in draws])
    error = log_marginal(density, chosen) - density.log_prior(chosen) - exact
    return draws, float(np.max(np.abs(error - np.median(error))))


def _bridged(
    density: Density, history: ChainHistory, method: Method, rng: np.random.Generator
) -> tuple[float, float]:
    """Log evidence of the full library by bridge sampling; exact where there is nothing to sample."""
    if history.chains[0].shape[2] == 0:
        return float(log_marginal(density, np.empty((1, 0)))[0]), 0.0
    # steps of all ensembles by turns, so that both halves have every ensemble
    samples = flat(np.concatenate(history.chains, axis=1))
    log_prob = np.concatenate(history.log_prob, axis=1).ravel()
    step = max(1, len(samples) // BRIDGE)
    tau = float(history.found.tau.max())
    return log_integral(samples[::step], log_prob[::step], _log_prob(density, method), tau=tau, rng=rng)


def _units(summary: Summary) -> tuple[str, ...]:
    """SI units of the columns; a triad's library is that of its components."""
    of_terms = {term.name: term.unit for term in summary.library.terms} if summary.library else {}
    of_extras = {extra.name: extra.unit for extra in summary.extras}
    return tuple(
        of_extras.get(name, "") or of_terms.get(name.rpartition(".")[2], "") for name in summary.names
    )


def flat(values: FloatArray) -> FloatArray:
    """All draws (m, k) of chains (..., k)."""
    return values.reshape(math.prod(values.shape[:-1]), values.shape[-1])


def thinned(chain: FloatArray) -> FloatArray:
    """Draws (DRAWS, k) of an ensemble (steps, walkers, k), evenly over its steps and walkers."""
    every = flat(chain)
    return every[np.linspace(0, len(every) - 1, DRAWS).astype(int)]


def _fingerprint(summary: Summary, rows: Sequence[Linear], sd: FloatArray, method: Method, seed: int) -> str:
    """Hash of what the chains depend on, blind to the last digits."""
    named = [(run.name, run.noise_run, len(run.found.steering)) for run in summary.runs]
    hashed, numbers = hashlib.sha256(repr((method, seed, summary.names, named)).encode()), []
    for run in summary.runs:
        known = run.found.steering.values() or (run.noise.N, run.noise.B, run.noise.K)
        numbers += [np.ravel([*known]), run.reach]
    for values in (*numbers, sd, *(part.y for part in rows)):
        hashed.update(np.asarray(values, dtype=np.float32).tobytes())
    return hashed.hexdigest()
