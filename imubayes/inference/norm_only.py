"""Reference-free tumble: a triad in the hand, of which only |f| = g is known while it rests.

At rest the compensated output has the length g, so each still gives one equation. Linearised about the
current coefficients theta_0 it is a row of an ordinary linear model: with the compensated output f of the
still, ``F(f) = y``, its direction ``u = f/|f|`` and ``w = u' (I + M)^-1``::

    w . (y_t - y) + |f| - g + x theta_0 = x theta + w . noise_t,      x_(c,k) = w_c phi_k(f)

so that rows, noise, factor and selection are those of every other test. A rotation of the case leaves all
lengths alone; `triad` says how it is fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, add, posterior, row_blocks, triangular
from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.inference.linear import Extra, Linear, Rows, blocks_of, residuals
from imubayes.inference.prior import ScalePrior
from imubayes.inference.reml import NoiseEstimate, estimate
from imubayes.inference.stills import Stills, find_stills
from imubayes.inference.summary import Rules, RunSummary, Summary
from imubayes.inference.triad import Triad, spans, triad_of
from imubayes.inference.whiten import whiten, whitener
from imubayes.inference.whitened import whitened_factor
from imubayes.rig.inputs import Facts, TriadRun, durations
from imubayes.sensors.catalogue import SensorClass, noise_prior
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library
from imubayes.units import STANDARD_GRAVITY, counted

FEWEST = 9
"""Stills below which bias, scale factor and non-orthogonality (9 parameters) are not determined."""

SETTLED = 1e-6
"""Change of a coefficient, in posterior sd, at which the linearisation has settled."""

ROUNDS = 50
"""Most relinearisations; three to six are usual."""

NOISE_ROUND = 2
"""Round from which the rows are good enough to judge the noise by."""

ORIGIN = {"estimate": "REML", "fixed": "given", "white": "white"}
"""Origin of the noise, by rule."""


@dataclass(frozen=True, slots=True, eq=False)
class FreeTumble:
    """Outcome of a reference-free tumble.

    Attributes
    ----------
    summary : factor over the terms of all three components, named ``ax.b0`` and so on.
    triad : at the coefficients that the rows are linearised about.
    residuals : of each run: (residuals in m/s^2, rows, compensated force (n, 3)) for the checks.
    rows : of each run, linearised where they settled.
    """

    summary: Summary
    triad: Triad
    residuals: tuple[tuple[FloatArray, Rows, FloatArray], ...]
    rows: tuple[Linear, ...]


def solve_free_tumble(
    runs: Sequence[TriadRun],
    lib: Library,
    prior: ScalePrior,
    *,
    sensor: SensorClass | None = None,
    rules: Rules | None = None,
    gravity: Extra | None = None,
) -> FreeTumble:
    """Linearise free tumbles of one triad until they settle.

    Parameters
    ----------
    runs : of one triad.
    lib : candidate terms of a component.
    prior : of the triad's terms, in the order of `triad.triad_of(lib).names`.
    sensor : class whose noise prior steers the estimate.
    rules : how the noise is known, by run.
    gravity : error of the local gravity, if it is allowed for: all lengths are then off by it.

    Raises
    ------
    UnobservableError : if there are fewer than 9 stills.
    ConvergenceError : if the linearisation does not settle; it carries the triad so far.
    """
    stills = [find_stills(run) for run in runs]
    _check_stills(sum(map(len, stills)))
    extras = () if gravity is None else (gravity,)
    sds = np.concatenate((prior.sd, [extra.sd for extra in extras]))
    triad, every = triad_of(lib), [(rules or {}).get(run.name, NoiseRule()) for run in runs]
    noises = [_start(run, s, rule) for run, s, rule in zip(runs, stills, every, strict=True)]
    for turn in range(ROUNDS):
        linear = [_rows(triad, run, s, extras) for run, s in zip(runs, stills, strict=True)]
        rows = [blocks_of(part) for part in linear]
        if turn == NOISE_ROUND:
            noises = _judged(rows, noises, every, sds, sensor)
            noises = _borrowed(noises, every, [run.name for run in runs])
        names = linear[0].names
        parts = (_factor(part, found.noise, names) for part, found in zip(rows, noises, strict=True))
        theta, sd = posterior(reduce(add, parts), sds)
        terms, spread = theta[: len(triad.theta)], sd[: len(triad.theta)]
        settled = turn > NOISE_ROUND and bool(np.all(np.abs(terms - triad.theta) <= SETTLED * spread))
        triad = replace(triad, theta=terms)
        if settled:
            return _outcome(runs, (stills, noises, every), triad, extras, theta)
    raise ConvergenceError(f"the free tumble did not settle in {ROUNDS} rounds", triad)


def _check_stills(count: int) -> None:
    if count < FEWEST:
        raise UnobservableError(
            f"{counted(count, 'still')} {'is' if count == 1 else 'are'} too few: {FEWEST} directions at"
            " least, 20 or more are usual"
        )


def _start(run: TriadRun, stills: Stills, rule: NoiseRule) -> NoiseEstimate:
    """Noise that the study gives, or white noise from the scatter within the stills to start from."""
    within = [run.output[a:b] - run.output[a:b].mean(axis=0) for a, b in stills]
    variance = sum(float(np.sum(part**2)) for part in within) / sum(part.size - 3 for part in within)
    scatter = Noise(float(np.sqrt(variance * run.interval)), 0.0, 0.0)
    return NoiseEstimate(rule.value or scatter, (0.0, 0.0, 0.0), ())


def _judged(
    rows: Sequence[Linear],
    noises: Sequence[NoiseEstimate],
    rules: Sequence[NoiseRule],
    sd: FloatArray,
    sensor: SensorClass | None,
) -> list[NoiseEstimate]:
    """Noise estimated where the rule says so.

    The stills are hardly more than the coefficients, which keep their prior instead of being taken out whole.
    """
    of_class = noise_prior(sensor) if sensor else None
    return [
        estimate(part, of_class, sd) if rule.rule == "estimate" else noise
        for part, noise, rule in zip(rows, noises, rules, strict=True)
    ]


def _borrowed(
    noises: Sequence[NoiseEstimate], rules: Sequence[NoiseRule], names: Sequence[str]
) -> list[NoiseEstimate]:
    """Noise of another run where the rule names one."""
    return [
        noises[names.index(rule.like)] if rule.like in names else noise
        for noise, rule in zip(noises, rules, strict=True)
    ]


def _rows(triad: Triad, run: TriadRun, stills: Stills, extras: tuple[Extra, ...]) -> Linear:
    """Linearised rows of the stills."""
    means = np.array([run.output[a:b].mean(axis=0) for a, b in stills])
    f = triad.compensate(means)
    length = np.linalg.norm(f, axis=1)
    w = np.linalg.solve(triad.gain().T, (f / length[:, None]).T).T
    X = np.hstack([w[:, [c]] * phi for c, phi in enumerate(triad.regressors(f))])
    base = length - run.gravity + X @ triad.theta
    X = np.hstack((X, np.ones((len(X), len(extras)))))  # gravity: every length is off by as much
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    still = np.repeat(np.arange(len(stills)), [b - a for a, b in stills])
    t = run.t[index]
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=(*triad.names, *(extra.name for extra in extras)),
        t=t,
        duration=durations(t, run.interval),
        interval=run.interval,
        y=base[still] + np.einsum("na,na->n", w[still], run.output[index] - means[still]),
        columns=lambda start, stop: X[still[start:stop]],
        axes=w[still],
    )


def _factor(part: Linear, noise: Noise, names: tuple[str, ...]) -> Factor:
    w = whitener(noise, part.rows)
    white = whiten(w, np.column_stack((part.X, part.y)))
    R = triangular((white[i:j] for i, j in row_blocks(len(white))), white.shape[1])
    return Factor(names, R, len(white), w.log_det)


def _outcome(
    runs: Sequence[TriadRun],
    found: tuple[Sequence[Stills], Sequence[NoiseEstimate], Sequence[NoiseRule]],
    triad: Triad,
    extras: tuple[Extra, ...],
    theta: FloatArray,
) -> FreeTumble:
    """Summary on all samples of the stills, at the settled linearisation."""
    stills, noises, rules = found
    rows = tuple(_rows(triad, run, s, extras) for run, s in zip(runs, stills, strict=True))
    summaries = tuple(
        _run_summary(run, s, part, noise, rule, triad)
        for run, s, part, noise, rule in zip(runs, stills, rows, noises, rules, strict=True)
    )
    reach = np.max([s.reach for s in summaries], axis=0)
    summary = Summary(
        factor=reduce(add, (s.factor for s in summaries)),
        runs=summaries,
        library=triad.libraries[0],
        facts=Facts("accelerometer", one_sided=False, force=STANDARD_GRAVITY, reference_free=True),
        reach=dict(zip(rows[0].names, reach.tolist(), strict=True)),
        extras=extras,
    )
    left = tuple(
        (residuals(part, theta), part.rows, _forces(triad, run, s))
        for part, run, s in zip(rows, runs, stills, strict=True)
    )
    return FreeTumble(summary, triad, left, rows)


def _run_summary(
    run: TriadRun, stills: Stills, part: Linear, found: NoiseEstimate, rule: NoiseRule, triad: Triad
) -> RunSummary:
    made, reach = whitened_factor(part, found.noise)
    held = np.concatenate([run.output[a:b] for a, b in stills])
    return RunSummary(
        name=run.name,
        procedure=run.procedure,
        samples=len(part),
        duration=float(run.t[-1] - run.t[0]),
        interval=run.interval,
        noise=found.noise,
        noise_sd=found.sd,
        noise_prior=found.prior,
        noise_origin=f"run {rule.like}" if rule.like else ORIGIN[rule.rule],
        noise_run=rule.like or run.name,
        steering=found.steering,
        ranges=spans("f", triad.compensate(held)),
        source=run.source,
        factor=made,
        reach=reach,
        stills=tuple((float(run.t[a]), float(run.t[b - 1])) for a, b in stills),
    )


def _forces(triad: Triad, run: TriadRun, stills: Stills) -> FloatArray:
    """Compensated specific force (n, 3) of each sample's still."""
    f = triad.compensate(np.array([run.output[a:b].mean(axis=0) for a, b in stills]))
    return np.repeat(f, [b - a for a, b in stills], axis=0)
