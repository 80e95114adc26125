"""What compensation makes of a recording, held against what is known of it without a reference.

A recording of an IMU holds quantities that are known though no table or arm gives them: |f| = g in a still,
no rotation there (the Earth's, at most 15 deg/h, counts as bias), up carried through a turn is up in the next
still, and a turn by 360 deg is one. Each is taken from the raw output and from the compensated one, beside
the sd that the posterior gives it.

With rows X, coefficients of covariance P and noise of covariance C, what the fit leaves of its own rows has
the covariance ``C - X P X'``; new rows at the same inputs will be off by ``C + X P X'``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import posterior_root
from imubayes.inference.between_stills import (
    TURNS,
    Directions,
    closures,
    directions,
    known_directions,
    lasting,
    rotation_of,
)
from imubayes.inference.case import Case
from imubayes.inference.ferraris import shortening_of
from imubayes.inference.linear import Linear, Rows
from imubayes.inference.stills import lengths_of, means_of, resting, shifts_of, times_of
from imubayes.inference.triad import Triad
from imubayes.inference.whiten import marginal_variance, processes
from imubayes.rig.inputs import Run, RunSection
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.sensors.imu import ACCELEROMETERS, GYROSCOPES
from imubayes.sensors.noise import Noise

Times = Sequence[tuple[float, float]]
"""(start, stop), s."""

SURE = 2.0
"""Sds within which 95 % of all errors are expected."""

SATURATED = 0.2
"""Share of the sd of new errors below which that of fitted ones says that there is a coefficient for each."""


@dataclass(frozen=True, slots=True, eq=False)
class Recovered:
    """Errors of a known quantity of a run: m stills or turns, and c components or directions of each.

    Attributes
    ----------
    run : its name.
    what : ``gravity`` (length of the specific force minus g, m/s^2), ``rate`` (length of the rate minus that
        of the table, rad/s), ``rest`` (rate at rest of gx, gy, gz, rad/s), ``closure`` (rad, two directions
        across up) or ``turn`` (rad, about the axis of a known turn).
    before, after : (m, c) of the raw output, and compensated under the full library.
    flown : (m, c) compensated by the terms that are kept.
    fitted : (m, c) sd of `after`, which the coefficients were fitted to.
    fresh : (m, c) sd of new stills and turns at the same inputs; where tilts of sections are allowed for,
        with what these take of the inputs along their axes.
    """

    run: str
    what: str
    before: FloatArray
    after: FloatArray
    flown: FloatArray
    fitted: FloatArray
    fresh: FloatArray

    @property
    def saturated(self) -> bool:
        """Whether the fit has a coefficient for each error, so that their size tells nothing of it."""
        return bool(np.linalg.norm(self.fitted) < SATURATED * np.linalg.norm(self.fresh))

    @property
    def expected(self) -> FloatArray:
        """(m, c) sd of `after`; of new stills and turns where it is saturated."""
        return self.fresh if self.saturated else self.fitted

    @property
    def inside(self) -> int:
        """How many of the m c errors after compensation lie within 2 sd of zero."""
        return int(np.sum(np.abs(self.after) <= SURE * self.expected))


def recover(case: Case, runs: Sequence[Run], sd: FloatArray, kept: FloatArray) -> tuple[Recovered, ...]:
    """Hold the compensated stills and turns of every run against what is known of them.

    The case is of free tumbles, or of runs with known sections; of others nothing is told. `sd` are prior sds
    of all columns of its summary, SI, and `kept` (p,) the coefficients of the compensation that is used, in
    the order of the triads; zero for a term that is not. It is a `ConvergenceError` if the model cannot be
    inverted: scale or offset of a column are far off.
    """
    if not runs:
        return ()
    root = posterior_root(case.summary.factor, sd)[1]
    ends = np.cumsum([len(triad.theta) for triad in case.triads])[:-1]
    ideal, used = (
        tuple(replace(t, theta=part) for t, part in zip(case.triads, np.split(theta, ends), strict=True))
        for theta in (np.zeros_like(kept), kept)
    )
    found = []
    for run in runs:
        known: Iterator[Known] = iter(())
        if run.procedure == FREE_TUMBLE:
            known = _of_tumble(run, case, root)
        elif run.sections and (run.force.size or any(section.angle for section in run.sections)):
            known = _of_sections(run, case, root)
        elif run.sections:
            seen = known_directions(run, case.summary.extras)
            known = _between_stills(run, lambda _, seen=seen: seen, case, root)
        for what, errors, sds in known:
            found.append(Recovered(run.name, what, errors(ideal), errors(case.triads), errors(used), *sds))
    return tuple(found)


Triads = tuple[Triad, ...]
Sds = tuple[FloatArray, FloatArray]
"""Sds (m, c) of what is left of fitted rows, and of new ones."""

Known = tuple[str, Callable[[Triads], FloatArray], Sds]
"""What is known of a run, its errors (m, c) as some triads compensate it, and their sds."""


def _spread(case: Case, root: FloatArray, parts: Sequence[str], times: Times) -> Sds:
    """Sds (k, parts) of the means of some parts' rows over spans of time.

    The root (p, p) is that of the posterior covariance of a case.
    """
    every = []
    for part in parts:
        rows, noise = _part(case, part)
        inside = [np.flatnonzero((rows.t >= a) & (rows.t <= b)) for a, b in times]

        def mean(
            values: FloatArray, rows: Linear = rows, inside: list[NDArray[np.intp]] = inside
        ) -> FloatArray:
            return np.array([np.average(values[i], axis=0, weights=rows.duration[i]) for i in inside])

        middle, lasting = [0.5 * (a + b) for a, b in times], [rows.duration[i].sum() for i in inside]
        axes = None if rows.axes is None else mean(rows.axes)
        taken = Rows(np.array(middle), np.array(lasting), axes)
        own = marginal_variance(noise, taken, processes(rows.rows, noise))
        every.append(_sds(root, mean(rows.X), own))
    fitted, fresh = (np.column_stack(sds) for sds in zip(*every, strict=True))
    return fitted, fresh


def _part(case: Case, part: str) -> tuple[Linear, Noise]:
    k = [run.name for run in case.summary.runs].index(part)
    return case.rows[k], case.summary.runs[k].noise


def _sds(root: FloatArray, X: FloatArray, own: FloatArray) -> Sds:
    known = np.sum((X @ root) ** 2, axis=1)
    return np.sqrt(np.maximum(own - known, 0.0)), np.sqrt(own + known)


def _of_tumble(run: Run, case: Case, root: FloatArray) -> Iterator[Known]:
    """Stills of a free tumble, and the turns between them, or sections at a known rate."""
    run = resting(run)
    said, extras = run.force if run.force.size else run.rate, case.summary.extras
    # what is sensed has errors of its own: of gravity, or of the table
    errors = case.theta[len(case.theta) - len(extras) :]
    known = (lengths_of(run) + shifts_of(run, extras) @ errors)[:, None]
    means, what = means_of(run, said, run.stills), "gravity" if run.force.size else "rate"
    sds = _spread(case, root, [run.name], times_of(run, run.stills))
    yield what, lambda triads: _length(triads[0].compensate(means), known), sds
    if run.force.size and run.rate.size:
        yield from _between_stills(run, cache(lambda triads: directions(triads[0], run)), case, root)


def _between_stills(
    run: Run, seen_by: Callable[[Triads], Directions], case: Case, root: FloatArray
) -> Iterator[Known]:
    """Rest of gyroscopes in stills whose directions are known, and up from one to the next."""
    seen = seen_by(case.triads)
    rate, parts = means_of(run, run.rate, seen.run.stills), [f"{run.name} ({g} at rest)" for g in GYROSCOPES]
    at_rest = _spread(case, root, parts, times_of(run, seen.run.stills))
    yield "rest", lambda triads: triads[-1].compensate(rate, seen_by(triads).f), at_rest
    rows, noise = _part(case, f"{run.name} ({TURNS})")
    sds = _sds(root, rows.X, marginal_variance(noise, rows.rows))
    fitted, fresh = (one.reshape(-1, 2) * lasting(seen)[:, None] for one in sds)
    yield "closure", lambda triads: closures(seen_by(triads), triads[-1]), (fitted, fresh)


def _of_sections(run: Run, case: Case, root: FloatArray) -> Iterator[Known]:
    """Positions, and turns by known angles."""
    still = [s for s in run.sections if not s.angle]
    turned = [s for s in run.sections if s.angle]
    positions = tuple((s.start, s.stop) for s in still)

    def spread(names: Sequence[str], sections: Sequence[RunSection]) -> Sds:
        times = [(float(run.t[s.start]), float(run.t[s.stop - 1])) for s in sections]
        return _spread(case, root, [f"{run.name} ({name})" for name in names], times)

    def force(triads: Triads) -> FloatArray:
        if run.force.size:
            return triads[0].compensate(means_of(run, run.force, positions))
        return run.gravity * np.array([s.direction for s in still])

    extras, values = case.summary.extras, case.theta[len(case.theta) - len(case.summary.extras) :]

    def shorter(sections: Sequence[RunSection], *, seen: bool) -> FloatArray:
        """Share (m, 1) that tilts take of an input along the axis of each section, `seen` ones too or not."""
        shares = np.zeros((len(sections), 1))
        for share, section in zip(shares, sections, strict=True):
            place, tilt = f"{run.name}.{run.sections.index(section)}", np.zeros(3)
            for extra, value in zip(extras, values, strict=True):
                tilt += seen * value * rotation_of(extra, place)
                share += (extra.held or 0.0) * (extra.name == shortening_of(section))
            share += 0.5 * tilt @ tilt
        return shares

    if run.force.size:
        fitted, fresh = _along(spread(ACCELEROMETERS, still), still)
        sds = fitted, np.hypot(fresh, run.gravity * shorter(still, seen=False))
        yield "gravity", lambda triads: _length(force(triads), run.gravity), sds
    if run.rate.size:
        rate = means_of(run, run.rate, positions)
        yield "rest", lambda triads: triads[-1].compensate(rate, force(triads)), spread(GYROSCOPES, still)
        whole = np.array([(s.stop - s.start) * run.interval for s in turned])
        fitted, fresh = (sd * whole[:, None] for sd in _along(spread(GYROSCOPES, turned), turned))
        less = np.array([[section.angle] for section in turned]) * shorter(turned, seen=True)
        yield "turn", lambda triads: _angles(run, turned, triads), (fitted, np.hypot(fresh, less))


def _angles(run: Run, turned: Sequence[RunSection], triads: Triads) -> FloatArray:
    """Integrated rate about the axis of each turn minus its angle, (m, 1), rad."""
    found = []
    for s in turned:
        inside = slice(s.start, s.stop)
        f = np.tile(run.gravity * s.direction, (s.stop - s.start, 1))
        if run.force.size:
            f = triads[0].compensate(run.force[inside])
        w = triads[-1].compensate(run.rate[inside], f)
        found.append(float(run.interval * np.sum(w @ s.direction) - s.angle))
    return np.array(found)[:, None]


def _length(own: FloatArray, known: float | FloatArray) -> FloatArray:
    return np.linalg.norm(own, axis=1, keepdims=True) - known


def _along(sds: Sds, sections: Sequence[RunSection]) -> Sds:
    """Sds (k, 1) of the component along the axis of each section, of those (k, 3) of all three."""
    axes = np.array([[int(np.argmax(np.abs(s.direction)))] for s in sections])
    fitted, fresh = (np.take_along_axis(one, axes, axis=1) for one in sds)
    return fitted, fresh
