"""Simulated runs: the model's output over a procedure's inputs, with the noise of a class.

Every noise process is drawn exactly from its own distribution at the given time stamps, gaps included.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.linalg import solve_banded

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError, TermError
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Inputs, Run, Source
from imubayes.rig.plans import Plan
from imubayes.rig.reference import OFFSET, errors_of
from imubayes.sensors.catalogue import SensorClass, draw_unit
from imubayes.sensors.noise import Noise, flicker
from imubayes.sensors.terms import HIGHEST_POWER, Kind, Library, Term, column, library

_RATIO = 4.0
"""Ratio of neighbouring time constants: the Allan variance is flat to 0.1 %."""

_SPANS = 10.0
"""Longest time constant over the run's span, at least."""


def simulate(
    sensor: SensorClass,
    plans: Iterable[Plan],
    *,
    seed: int | np.random.Generator,
    truth: Mapping[str, float] | None = None,
    noise: Noise | None = None,
) -> tuple[Run, ...]:
    """Run the plans on a simulated sensor: ``output = input + X theta + noise``.

    Parameters
    ----------
    sensor : class of the sensor.
    plans : what the rig does; plans of one name are numbered.
    seed : of the draw; runs have independent noise.
    truth : coefficients in SI by name, those not named being zero: any term of any library, also of orders
        that the slides do not reach (``b4``, ``S_ii``, ``b0*T2``). Without it a unit is drawn from the
        class over the slide library (draw it with `draw_unit` to keep it).
    noise : of every run; the class's typical N, B and K where absent.

    Raises
    ------
    TermError : if `truth` names a term that the kind does not have.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> from imubayes.sensors.catalogue import sensor
    >>> tactical = sensor("mems_tactical", kind="accelerometer")
    >>> (run,) = simulate(tactical, [tumble(angles=4, planes=1)], seed=1, truth={"b0": 0.0147})
    >>> bool(abs(run.output.mean() - 0.0147) < 2e-3), run.source.file
    (True, 'simulated')
    """
    rng = np.random.default_rng(seed)
    if truth is None:
        truth = draw_unit(sensor, library(sensor.kind), rng)
    if noise is None:
        noise = Noise(**{name: typical for name, (_, typical, _) in sensor.noise.items()})
    lib = library_of(sensor.kind, truth)
    source = Source(notes=(f"simulated: {sensor.kind} of class {sensor.id}",))
    return tuple(
        Run(name, plan.procedure, plan.inputs, _output(plan.inputs, lib, truth, noise, rng), source)
        for name, plan in _numbered(plans)
    )


def drawn_errors(
    plans: Sequence[Plan], sds: Mapping[str, float], rng: np.random.Generator
) -> dict[str, float]:
    """One draw of the errors of a bench, SI, by name: normal, with the sd of each kind."""
    return {error.name: rng.normal(0.0, sds[error.kind]) for error in errors_of(plans, sds)}


def simulate_on_bench(
    sensor: SensorClass,
    plans: Sequence[Plan],
    errors: Mapping[str, float],
    *,
    seed: np.random.Generator,
    truth: Mapping[str, float],
) -> tuple[Run, ...]:
    """Run plans as `simulate` does on a rig with errors, of which the inputs of the runs say nothing.

    Parameters
    ----------
    errors : of the bench, SI by name; none for a rig without.
    """
    moved = [replace(plan, inputs=true_inputs(plan, errors)) for plan in plans] if errors else plans
    runs = simulate(sensor, moved, seed=seed, truth=truth)
    if not errors:
        return runs
    return tuple(
        replace(run, inputs=plan.inputs, output=run.output + errors.get(f"{OFFSET}.{run.name}", 0.0))
        for run, plan in zip(runs, plans, strict=True)
    )


def synthesise(noise: Noise, t: FloatArray, interval: float, rng: np.random.Generator) -> FloatArray:
    """One realisation of a noise at arbitrary time stamps.

    White noise has the sd ``N / sqrt(interval)``; bias instability is a sum of stationary Gauss-Markov
    processes with time constants in ratio 4 from the interval to ten times the span; the random walk starts
    from zero at ``t[0]`` with increments of variance ``K^2 dt``.

    Parameters
    ----------
    noise : densities in SI.
    t : (n,) time, s, strictly increasing.
    interval : averaging time of one sample, s.
    rng : the source of randomness.

    Returns
    -------
    (n,) noise in the unit of the output.

    Raises
    ------
    InputError : if `t` is empty or not strictly increasing, or the interval is not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> synthesise(Noise(0.0, 0.0, 0.0), np.array([0.0, 1.0, 7.5]), 1.0, rng).tolist()
    [0.0, 0.0, 0.0]
    """
    steps = np.diff(t)
    if len(t) == 0 or not (steps > 0.0).all() or not interval > 0.0:
        raise InputError(f"noise of {len(t)} samples every {interval} s: expected 1 or more, time increasing")
    values = noise.N / np.sqrt(interval) * rng.standard_normal(len(t))
    if noise.B > 0.0:
        longest = max(steps.sum(), interval) * _SPANS
        for variance, tau in zip(*flicker(noise.B, _RATIO * interval, longest / _RATIO, _RATIO), strict=True):
            values += _gauss_markov(variance, tau, steps, rng)
    if noise.K > 0.0:
        values[1:] += np.cumsum(noise.K * np.sqrt(steps) * rng.standard_normal(len(steps)))
    return values


def library_of(kind: Kind, names: Iterable[str]) -> Library:
    """Terms by name, of whatever order, in the order of the model equation.

    Raises
    ------
    TermError : if the kind has no such term in any library.

    Examples
    --------
    >>> library_of("gyroscope", ["g_j", "b4", "b0*T2"]).names
    ('b4', 'g_j', 'b0*T2')
    """
    known, wanted = _every_term(kind), set(names)
    unknown = sorted(wanted - known.keys())
    if unknown:
        raise TermError(
            f"'{unknown[0]}' is not a term of kind {kind}: expected a name such as b0, b2p, c_ij, b0*T"
        )
    return Library(kind, tuple(term for name, term in known.items() if name in wanted))


@cache
def _every_term(kind: Kind) -> dict[str, Term]:
    most = HIGHEST_POWER
    names = library(kind, powers=most, asymmetry=most, set="extended").names
    every = library(
        kind,
        powers=most,
        asymmetry=most,
        set="extended",
        temperature=most,
        temperature_of=names,
        rate_of=names,
    )
    return {term.name: term for term in every.terms}


def _output(
    inputs: Inputs, lib: Library, truth: Mapping[str, float], noise: Noise, rng: np.random.Generator
) -> FloatArray:
    output = synthesise(noise, inputs.t, inputs.interval, rng)
    output += inputs.channels.get(lib.own, 0.0)
    for term in lib.terms:
        output += truth[term.name] * column(term, inputs.channels)
    return output


def _gauss_markov(variance: float, tau: float, steps: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Stationary first-order process, ``x_k - exp(-dt/tau) x_(k-1) = innovation``: one banded solve."""
    innovations = np.sqrt(variance) * rng.standard_normal(len(steps) + 1)
    innovations[1:] *= np.sqrt(-np.expm1(-2.0 * steps / tau))
    bands = np.ones((2, len(innovations)))
    bands[1, :-1] = -np.exp(-steps / tau)
    return solve_banded((1, 0), bands, innovations, overwrite_ab=True, overwrite_b=True, check_finite=False)


def _numbered(plans: Iterable[Plan]) -> Iterator[tuple[str, Plan]]:
    """Plans with names that are unique: a second tumble is ``tumble-2``."""
    seen: dict[str, int] = {}
    for plan in plans:
        seen[plan.name] = seen.get(plan.name, 0) + 1
        yield (plan.name if seen[plan.name] == 1 else f"{plan.name}-{seen[plan.name]}"), plan
