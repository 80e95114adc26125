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
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, invert_triangular, noise_scale, posterior, with_prior_rows
from imubayes.errors import ConvergenceError
from imubayes.inference.linear import Extra, Linear, blocks_of
from imubayes.inference.summary import Rules, RunSummary, Summary, summarize
from imubayes.inference.tangent import tangent
from imubayes.rig.bench import refuse_idle
from imubayes.rig.inputs import Run
from imubayes.rig.reference import TILT, errors_of, for_sensor, kind_of
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library

SETTLED = 1e-3
"""Change of a coefficient, in posterior sd, at which the linearisation has settled."""

NOISE_ROUNDS = 2
"""Rounds that estimate the noise: the rows of the first may be off by the sensor's own errors."""

NEARLY = 0.02
"""Step still to go, in posterior sd, that is let pass where a curved valley makes it shrink slowly."""

FEW_ROUNDS = 12
"""Relinearisations after which a search begins anew with louder noise; four are usual."""

LOUDER = (1e3, 1e2, 10.0, 1.0)
"""Factors on the noise in such a search, one after the other."""

STALLED = 1e-15
"""Relative change of place or misfit that is rounding."""

ROUNDS = 100
"""Most relinearisations at each of them."""

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
    sd = np.concatenate((prior_sd, [extra.sd for extra in extras]))
    ask = _Asked(lib, extras, sensor, rules)
    return settled_rows(lambda taken: _linearised(runs, ask, taken), sd, runs)[:2]


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


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """What is asked of runs, whichever they are (see `solve`)."""

    lib: Library
    extras: tuple[Extra, ...]
    sensor: SensorClass | None
    rules: Rules | None


def _linearised(runs: Sequence[Run], ask: _Asked, taken: Taken) -> Linearised:
    """Give summary and rows of runs, of whose rows `taken` says which are taken."""
    p = len(ask.lib.terms)

    def linearised(
        place: FloatArray, leaning: FloatArray | None, judged: Sequence[RunSummary]
    ) -> tuple[Summary, tuple[Linear, ...]]:
        at = None if leaning is None else leaning[:p]
        parts = rows_with(runs, ask.lib, ask.extras, place[:p], place[p:], leaning=at)
        rows = tuple(taken(part) for part in parts)
        rules = held(judged, ask.rules) if judged else ask.rules
        summary = summarize(runs, ask.lib, sensor=ask.sensor, rules=rules, rows=rows, extras=ask.extras)
        return summary, rows

    return linearised


Taken = Callable[[Linear], Linear]
"""Which rows are taken of a run's: all of them, or averages."""

Linearised = Callable[
    [FloatArray, FloatArray | None, Sequence[RunSummary]], tuple[Summary, tuple[Linear, ...]]
]
"""Summary and rows, linearised at coefficients and errors (p + q,), the tilt's columns at others where these
are given, and the noise as it was judged where it was."""


@dataclass(frozen=True, slots=True, eq=False)
class _Tangents:
    """Linearisations under priors `sd` (p + q,), the noise and the place that a tilt leans on held or not."""

    sd: FloatArray
    linearised: Linearised
    judged: Sequence[RunSummary] = ()
    leaning: FloatArray | None = None

    def at(self, place: FloatArray) -> tuple[Summary, tuple[Linear, ...]]:
        """Summary and rows, linearised at coefficients and errors (p + q,)."""
        return self.linearised(place, self.leaning, self.judged)


def settled_rows(
    linearised: Callable[[Taken], Linearised], sd: FloatArray, runs: Sequence[Run]
) -> tuple[Summary, tuple[Linear, ...], FloatArray]:
    """Linearise where that settles.

    Parameters
    ----------
    linearised : gives the linearisation of the rows that are taken.
    sd : (p + q,) prior sds of coefficients and errors, SI.
    runs : of a component; many rows of it are averaged first, until that settles.

    Returns
    -------
    (summary, rows, place) : where they settled, with the coefficients and errors (p + q,) there.

    Raises
    ------
    ConvergenceError : if the linearisation does not settle; it carries coefficients and errors so far.
    """
    start = np.zeros(len(sd))
    if sum(len(run.inputs) for run in runs) > MANY:
        # block averages of the rows find the place, all rows have the last word
        start = _settled(_Tangents(sd, linearised(_averaged)), start)[2]
    return _settled(_Tangents(sd, linearised(lambda rows: rows)), start)


def _settled(tangents: _Tangents, at: FloatArray) -> tuple[Summary, tuple[Linear, ...], FloatArray]:
    """Summary and rows where the linearisation has settled, and coefficients and errors (p + q,) there.

    While the noise is judged each round goes where the linear problem is solved; where that does not settle,
    trust regions do.
    """
    judged, scale = (), 1.0
    for turn in range(NOISE_ROUNDS + 1):
        summary, rows = tangents.at(at)
        judged = summary.runs if turn < NOISE_ROUNDS else judged
        tangents = replace(tangents, judged=judged if turn + 1 >= NOISE_ROUNDS else ())
        scale = noise_scale(summary.factor, tangents.sd)
        mean, spread = posterior(summary.factor, tangents.sd, scale)
        if np.all(np.abs(mean - at) <= SETTLED * spread):
            return _with_judged(summary, judged), rows, mean
        at = mean if turn < NOISE_ROUNDS else at
    at = _peak(replace(tangents, leaning=at), at, summary.factor, scale)
    summary, rows, at = _polished(tangents, at)
    return _with_judged(summary, judged), rows, at


def _polished(tangents: _Tangents, at: FloatArray) -> tuple[Summary, tuple[Linear, ...], FloatArray]:
    """Follow the linear problem from near the peak while its steps shrink; a tilt leans on each place."""
    summary, rows = tangents.at(at)
    step = np.inf
    for _ in range(FEW_ROUNDS):
        mean, spread = posterior(summary.factor, tangents.sd, noise_scale(summary.factor, tangents.sd))
        before, step = step, float(np.max(np.abs(mean - at) / spread))
        if step <= SETTLED or step >= before:
            break
        at = mean
        summary, rows = tangents.at(at)
    return summary, rows, at


def _peak(tangents: _Tangents, start: FloatArray, f: Factor, scale: float) -> FloatArray:
    """Coefficients and errors at the posterior's peak, the noise and the tilt's columns held.

    Parameters
    ----------
    tangents : linearisations.
    start : where to begin, with the factor f there.
    scale : of the noise that whitened.

    Raises
    ------
    ConvergenceError : if it is not found; it carries the place so far.
    """
    place, left = _descended(tangents, start, f, scale, FEW_ROUNDS)
    if left > SETTLED:
        # the valley is curved and narrow: with louder noise it is wide, and leads to where it is deepest
        place = start
        for louder in LOUDER:
            place, left = _descended(tangents, place, f, louder * scale, ROUNDS)
            f = tangents.at(place)[0].factor
    if left > NEARLY:
        raise ConvergenceError(
            f"the errors of the test bench did not settle in {ROUNDS} rounds: check scale and sign of the"
            " output, and whether the errors that the study states for the bench are as large as that",
            place,
        )
    return place


def _descended(
    tangents: _Tangents, start: FloatArray, f: Factor, scale: float, rounds: int
) -> tuple[FloatArray, float]:
    """Go downhill by trust regions; give the place, and the step that is left in posterior sd.

    The way is taken in coordinates in which the posterior is a unit ball at the start.
    """
    from scipy.optimize import least_squares

    rows = scale / tangents.sd
    metric = scale * invert_triangular(with_prior_rows(f.R, rows)[:-1, :-1])

    @lru_cache(maxsize=1)
    def there(way: bytes) -> tuple[FloatArray, FloatArray]:
        place = start + metric @ np.frombuffer(way)
        T = with_prior_rows(tangents.at(place)[0].factor.R, rows) / scale
        return T[:, :-1] @ place - T[:, -1], T[:, :-1] @ metric

    slope: Any = lambda way: there(way.tobytes())[1]  # noqa: E731
    found = least_squares(
        lambda way: there(way.tobytes())[0],
        np.zeros(len(start)),
        slope,
        gtol=SETTLED,
        xtol=STALLED,
        ftol=STALLED,
        max_nfev=rounds,
    )
    return start + metric @ found.x, float(found.optimality)


def _averaged(rows: Linear) -> Linear:
    """Averages over the blocks of `blocks_of` as rows."""
    blocks = blocks_of(rows)
    taken = blocks.rows
    return replace(
        rows, t=taken.t, duration=taken.duration, y=blocks.y, columns=lambda start, stop: blocks.X[start:stop]
    )


def held(judged: Sequence[RunSummary], rules: Rules | None) -> dict[str, NoiseRule]:
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
