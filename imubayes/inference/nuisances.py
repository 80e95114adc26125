"""Errors of the test bench as further columns of the linear model.

With the coefficients theta and the errors nu of the bench the output is::

    F(theta, nu) = own(u(nu)) + X(u(nu)) theta + offset(nu) + noise

where u(nu) is what the rig applied in truth. Linearised where the posterior is, it is a row of an ordinary
linear model: the library's columns at u(nu), beside them the derivatives dF/dnu, each under its own prior.
So rows, noise, factor and selection are those of every other test, and what an error of the bench hides
shows up as a column that cannot be told from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import ConvergenceError
from imubayes.factor import noise_scale, posterior
from imubayes.inference.linear import Extra, Linear, blocks_of
from imubayes.inference.summary import Rules, RunSummary, Summary, summarize
from imubayes.inference.tangent import tangent
from imubayes.rig.inputs import Run
from imubayes.rig.reference import TILT, errors_of, for_sensor, kind_of, refuse_idle
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library

FloatArray = NDArray[np.float64]

SETTLED = 1e-3
"""Change of a coefficient, in posterior sd, at which the linearisation has settled."""

NOISE_ROUNDS = 2
"""Rounds that estimate the noise: the rows of the first may be off by the sensor's own errors."""

ROUNDS = 30
"""Most relinearisations; four are usual, seven with gains that are off by several percent."""

LONGEST = 3.0
"""Most of the last move that a round adds to its own step."""

ROOM = 3.0
"""Prior sd of a tilt over that of the misalignment: so wide that it hardly tells the one from the other."""

MANY = 10_000
"""Rows from which it pays to settle on block averages first."""


def extras_for(
    runs: Sequence[Run], kinds: Mapping[str, float], *, sensor: Kind = "accelerometer"
) -> tuple[Extra, ...]:
    """Columns for the errors of the bench.

    Parameters
    ----------
    runs : of one component.
    kinds : prior sd in SI of each kind of error, by its key in `imubayes.rig.reference.KINDS`.
    sensor : kind of the component, for the unit of an offset.

    Raises
    ------
    TermError : if a kind is not known.
    UnobservableError : if a kind applies to none of the runs.

    Examples
    --------
    >>> from imubayes.rig.profiles import tumble
    >>> plan = tumble(angles=4, planes=1)
    >>> run = Run("tumble", plan.procedure, plan.inputs, np.zeros(len(plan.inputs)))
    >>> [(extra.name, extra.sd) for extra in extras_for([run], {"gravity": 1e-5})]
    [('gravity', 1e-05)]
    """
    refuse_idle(runs, kinds)
    extras = []
    for name, sd in kinds.items():
        for error in errors_of(runs, [name]):
            kind = for_sensor(kind_of(name), sensor)
            extras.append(Extra(error.name, name, sd, kind.unit, kind.printed, error.text))
    return tuple(extras)


def rows_with(
    runs: Sequence[Run], lib: Library, extras: Sequence[Extra], theta: FloatArray, nu: FloatArray
) -> tuple[Linear, ...]:
    """Rows of runs on a bench with errors, linearised.

    Parameters
    ----------
    runs : of one component.
    lib : candidate terms.
    extras : columns for the errors (see `extras_for`).
    theta, nu : (p,) coefficients and (q,) errors to linearise at, SI.

    Returns
    -------
    rows of each run, with the columns of the library and then of the extras. The response is such that a
    linear fit gives coefficients and errors, not corrections of those that it started from.

    Raises
    ------
    DataError : if an error needs what a run does not tell (see `bench_of`).
    """
    kinds = dict.fromkeys(extra.kind for extra in extras)
    known = {error.name: error for error in errors_of(runs, kinds)}
    errors = tuple(known[extra.name] for extra in extras)
    return tuple(tangent(run, lib, errors, theta, nu) for run in runs)


def solve(
    runs: Sequence[Run],
    lib: Library,
    prior_sd: FloatArray,
    kinds: Mapping[str, float],
    *,
    sensor: SensorClass | None = None,
    rules: Rules | None = None,
) -> tuple[Summary, tuple[Linear, ...]]:
    """Summarize runs on a bench with errors, relinearised until that settles.

    Parameters
    ----------
    runs : of one component.
    lib : candidate terms.
    prior_sd : (p,) of the terms, SI.
    kinds : prior sd in SI of each kind of error of the bench.
    sensor : class whose noise prior steers the estimate of the noise.
    rules : how the noise is known, by run.

    Returns
    -------
    (summary, rows) : over the terms and, after them, the errors; rows of each run where they settled.

    Raises
    ------
    ConvergenceError : if the linearisation does not settle; it carries coefficients and errors so far.
    """
    extras = extras_for(runs, {**kinds, **_tilt(lib, prior_sd, kinds)}, sensor=lib.kind)
    sd = np.concatenate((prior_sd, [extra.sd for extra in extras]))
    ask = _Asked(lib, extras, sd, sensor, rules)
    start = np.zeros(len(sd))
    if sum(len(run.inputs) for run in runs) > MANY:
        # block averages of the rows find the place, all rows have the last word
        start = _settled(runs, ask, start, _averaged)[2]
    return _settled(runs, ask, start, lambda rows: rows)[:2]


def _tilt(lib: Library, prior_sd: FloatArray, kinds: Mapping[str, float]) -> dict[str, float]:
    """Prior sd of the tilt that comes with a rotation in the fixture."""
    sizes = [sd for name, sd in zip(lib.names, prior_sd.tolist(), strict=True) if name in ("m_j", "m_k")]
    return {TILT.name: ROOM * max(sizes)} if sizes and {"fixture", "fixture_common"} & kinds.keys() else {}


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """What is asked of runs, whichever they are (see `solve`); `sd` (p + q,) is that of terms and extras."""

    lib: Library
    extras: tuple[Extra, ...]
    sd: FloatArray
    sensor: SensorClass | None
    rules: Rules | None


def _settled(
    runs: Sequence[Run], ask: _Asked, at: FloatArray, taken: Callable[[Linear], Linear]
) -> tuple[Summary, tuple[Linear, ...], FloatArray]:
    """Summary and rows where the linearisation has settled, and coefficients and errors (p + q,) there.

    `taken` says which rows are taken of a run's.
    """
    p, judged, scale, before = len(ask.lib.terms), (), 1.0, (at, np.zeros(len(at)))
    for turn in range(ROUNDS):
        rows = tuple(taken(part) for part in rows_with(runs, ask.lib, ask.extras, at[:p], at[p:]))
        rules = ask.rules if turn < NOISE_ROUNDS else _held(judged, ask.rules)
        summary = summarize(runs, ask.lib, sensor=ask.sensor, rules=rules, rows=rows, extras=ask.extras)
        judged = summary.runs if turn < NOISE_ROUNDS else judged
        scale = noise_scale(summary.factor, ask.sd) if turn <= NOISE_ROUNDS else scale
        mean, spread = posterior(summary.factor, ask.sd, scale)
        if np.all(np.abs(mean - at) <= SETTLED * spread):
            return _with_judged(summary, judged), rows, mean
        at, before = _onward(at, mean - at, before, spread), (at, mean - at)
    raise ConvergenceError(
        f"the errors of the test bench did not settle in {ROUNDS} rounds: check scale and sign of the output",
        at,
    )


def _onward(
    at: FloatArray, step: FloatArray, before: tuple[FloatArray, FloatArray], spread: FloatArray
) -> FloatArray:
    """Where to linearise next: a step on, and further along it if the steps shrink by a steady share.

    They do where the data bend what the prior holds. `before` is (place, step) of the last round (Anderson's
    acceleration with one past step, which for a single direction is the secant rule).
    """
    was, last = before
    change = (step - last) / spread
    if not last.any() or not change.any():
        return at + step
    share = float(np.clip(change @ (step / spread) / (change @ change), -LONGEST, LONGEST))
    return at + step - share * (at - was + step - last)


def _averaged(rows: Linear) -> Linear:
    """Averages over the blocks of `blocks_of` as rows."""
    blocks = blocks_of(rows)
    taken = blocks.rows
    return replace(
        rows, t=taken.t, duration=taken.duration, y=blocks.y, columns=lambda start, stop: blocks.X[start:stop]
    )


def _held(judged: Sequence[RunSummary], rules: Rules | None) -> dict[str, NoiseRule]:
    """Rules that hold the noise as it was judged; the scale of white noise follows from the residuals."""
    white = {name for name, rule in (rules or {}).items() if rule.rule == "white"}
    return {
        run.name: NoiseRule("white") if run.name in white else NoiseRule("fixed", run.noise) for run in judged
    }


def _with_judged(summary: Summary, judged: Sequence[RunSummary]) -> Summary:
    """Summary that tells of its noise how it was judged."""
    runs = (
        replace(
            run,
            noise_sd=first.noise_sd,
            noise_origin=first.noise_origin,
            noise_run=first.noise_run,
            steering=run.steering if first.noise_origin == "white" else first.steering,
        )
        for run, first in zip(summary.runs, judged, strict=True)
    )
    return replace(summary, runs=tuple(runs))
