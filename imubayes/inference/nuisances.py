"""Errors of the test bench as further columns of the linear model.

With the coefficients theta and the errors nu of the bench the output is::

    F(theta, nu) = own(u(nu)) + X(u(nu)) theta + offset(nu) + noise

where u(nu) is what the rig applied in truth. Linearised where the posterior is, it is a row of an ordinary
linear model: the library's columns at u(nu), beside them the derivatives dF/dnu, each under its own prior.
So rows, noise, factor and selection are those of every other test, and what an error of the bench hides
shows up as a column that cannot be told from it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import noise_scale
from imubayes.inference.linear import Extra, Linear, blocks_of
from imubayes.inference.reml import NoiseEstimate
from imubayes.inference.settle import At, Pace, Round, settle
from imubayes.inference.summary import Rules, Summary, summarize
from imubayes.inference.tangent import tangent
from imubayes.rig.bench import refuse_idle
from imubayes.rig.inputs import Run
from imubayes.rig.reference import TILT, errors_of, for_sensor, kind_of
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.terms import Kind, Library

PACE = Pace(judged=range(2), settled=1e-3, rounds=3, downhill=True)
"""The rows of the first round may be off by the sensor's own errors, so that two judge the noise."""

ROOM = 3.0
"""Prior sd of a tilt over that of the misalignment: so wide that it hardly tells the one from the other."""

ROTATIONS = frozenset({"fixture", "fixture_common"})
"""Kinds of errors that are a rotation in the fixture."""

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
    >>> from imubayes.rig.tumbles import tumble
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
    runs: Sequence[Run],
    lib: Library,
    extras: Sequence[Extra],
    theta: FloatArray,
    nu: FloatArray,
    *,
    leaning: FloatArray | None = None,
) -> tuple[Linear, ...]:
    """Rows of runs on a bench with errors, linearised.

    Parameters
    ----------
    runs : of one component.
    lib : candidate terms.
    extras : columns for the errors (see `extras_for`).
    theta, nu : (p,) coefficients and (q,) errors to linearise at, SI.
    leaning : (p,) coefficients whose axes a tilt turns; by default `theta`.

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
    return tuple(tangent(run, lib, errors, theta, nu, leaning=leaning) for run in runs)


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
    extras = extras_for(runs, {**kinds, **tilt_of(lib, prior_sd, kinds)}, sensor=lib.kind)
    sd, p = np.concatenate((prior_sd, [extra.sd for extra in extras])), len(prior_sd)

    def linearised(taken: Taken) -> At:
        def at(place: FloatArray, noise: Sequence[NoiseEstimate], leaning: FloatArray | None) -> Round:
            lean = None if leaning is None else leaning[:p]
            parts = rows_with(runs, lib, extras, place[:p], place[p:], leaning=lean)
            rows = tuple(taken(part) for part in parts)
            summary = summarize(runs, lib, sensor=sensor, rules=rules, rows=rows, extras=extras, known=noise)
            found = [run.found for run in summary.runs]
            return Round(place, summary, rows, found, noise_scale(summary.factor, sd))

        return at

    found = settled_rows(linearised, sd, runs)
    return found.summary, found.rows


def tilt_of(lib: Library, prior_sd: FloatArray, kinds: Collection[str]) -> dict[str, float]:
    """Prior sd of the tilt that comes with a rotation in the fixture, where there is one among the kinds.

    Parameters
    ----------
    lib : terms of a component.
    prior_sd : (p,) of these, SI.
    kinds : of errors of the bench.
    """
    sizes = [sd for name, sd in zip(lib.names, prior_sd.tolist(), strict=True) if name in ("m_j", "m_k")]
    return {TILT.name: ROOM * max(sizes)} if sizes and ROTATIONS & set(kinds) else {}


Taken = Callable[[Linear], Linear]
"""Which rows are taken of a run's: all of them, or averages."""


def all_rows(rows: Linear) -> Linear:
    """Take all rows."""
    return rows


def settled_rows(linearised: Callable[[Taken], At], sd: FloatArray, runs: Sequence[Run]) -> Round:
    """Linearise on a bench with errors where that settles.

    Parameters
    ----------
    linearised : gives the linearisation of the rows that are taken.
    sd : (p + q,) prior sds of coefficients and errors, SI.
    runs : of a component; of many rows averages find the place, and all rows have the last word.

    Raises
    ------
    ConvergenceError : if the linearisation does not settle; it carries coefficients and errors so far.
    """
    start = np.zeros(len(sd))
    if sum(len(run.inputs) for run in runs) > MANY:
        start = settle(linearised(blocks_of), sd, PACE, start).place
    return settle(linearised(all_rows), sd, PACE, start)
