"""What compensation makes of a recording, held against what is known of it without a reference.

A recording of an IMU holds quantities that are known though no table or arm gives them: |f| = g in a still,
no rotation there (the Earth's, at most 15 deg/h, counts as bias), up carried through a turn is up in the next
still, and a turn by 360 deg is one. Each is taken from the raw output and from the compensated one, beside
the sd that the posterior gives it.

With rows X, coefficients of covariance P and noise of covariance C, what the fit leaves of its own rows has
the covariance ``C - X P X'``; new rows at the same inputs will be off by ``C + X P X'``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import posterior_root
from imubayes.inference.between_stills import TURNS, closures, directions, known_directions, lasting
from imubayes.inference.case import Case
from imubayes.inference.linear import Linear, Rows
from imubayes.inference.stills import Stills, find_stills, lengths_of, means_of, shifts_of, times_of
from imubayes.inference.triad import Triad
from imubayes.inference.whiten import marginal_variance
from imubayes.rig.inputs import Run, Section
from imubayes.sensors.imu import ACCELEROMETERS, GYROSCOPES

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
    fresh : (m, c) sd of new stills and turns at the same inputs.
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

    Parameters
    ----------
    case : of free tumbles, or of runs with known sections; of others nothing is told.
    runs : that it was made of.
    sd : prior sd of all columns of its summary, SI.
    kept : (p,) coefficients of the compensation that is used, in the order of the triads; zero for a term
        that is not.

    Raises
    ------
    ConvergenceError : if the model cannot be inverted: scale or offset of a column are far off.
    """
    if not runs:
        return ()
    judge = _Judge(case, posterior_root(case.summary.factor, sd)[1])
    ideal, used = (_at(case.triads, theta) for theta in (np.zeros_like(kept), kept))
    found: list[Recovered] = []
    for run in runs:
        if run.procedure == "free-tumble":
            found += _of_tumble(run, (ideal, case.triads, used), judge)
        elif run.sections:
            found += _of_sections(run, (ideal, case.triads, used), judge)
    return tuple(found)


Triads = tuple[Triad, ...]
Spread = tuple[FloatArray, FloatArray]
"""Sd of what is left of fitted rows, and of new ones."""


def _at(triads: Triads, theta: FloatArray) -> Triads:
    ends = np.cumsum([len(triad.theta) for triad in triads])[:-1]
    return tuple(replace(t, theta=part) for t, part in zip(triads, np.split(theta, ends), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class _Judge:
    """A case, and a root (p, p) of its posterior covariance."""

    case: Case
    root: FloatArray

    def known(self, run: Run, stills: Stills) -> FloatArray:
        """Length (k, 1) of what is sensed in each still, with the errors of what it was said to be, SI."""
        extras = self.case.summary.extras
        errors = self.case.theta[len(self.case.theta) - len(extras) :]
        return (lengths_of(run, stills) + shifts_of(run, stills, extras) @ errors)[:, None]

    def spread(self, part: str, times: Times) -> Spread:
        """Sds (k,) of the mean of a part's rows over spans of time."""
        rows, X, taken = self._means(part, times)
        return self._sds(X, marginal_variance(rows, taken))

    def spread_of_turns(self, part: str, whole: FloatArray) -> Spread:
        """Sds (m, 2), rad, of the rows of turns that last `whole` (m,), s."""
        k = self._number(part)
        rows, noise = self.case.rows[k], self.case.summary.runs[k].noise
        sds = self._sds(rows.columns(0, len(rows)), marginal_variance(noise, rows.rows))
        fitted, fresh = (one.reshape(-1, 2) * whole[:, None] for one in sds)
        return fitted, fresh

    def _means(self, part: str, times: Times):
        k = self._number(part)
        rows = self.case.rows[k]
        inside = [np.flatnonzero((rows.t >= a) & (rows.t <= b)) for a, b in times]
        X, axes = rows.columns(0, len(rows)), rows.axes
        taken = Rows(
            np.array([0.5 * (a + b) for a, b in times]),
            np.array([rows.duration[i].sum() for i in inside]),
            None if axes is None else _mean(rows, axes, inside),
        )
        return self.case.summary.runs[k].noise, _mean(rows, X, inside), taken

    def _number(self, part: str) -> int:
        return [run.name for run in self.case.summary.runs].index(part)

    def _sds(self, X: FloatArray, own: FloatArray) -> Spread:
        known = np.sum((X @ self.root) ** 2, axis=1)
        return np.sqrt(np.maximum(own - known, 0.0)), np.sqrt(own + known)


def _mean(rows: Linear, values: FloatArray, inside: Sequence[NDArray[np.intp]]) -> FloatArray:
    """Means (k, a) over groups of rows, each row with its duration."""
    return np.array([np.average(values[i], axis=0, weights=rows.duration[i]) for i in inside])


def _of_tumble(run: Run, triads: tuple[Triads, Triads, Triads], judge: _Judge) -> Iterator[Recovered]:
    """Stills of a free tumble, and the turns between them, or sections at a known rate."""
    stills = find_stills(run)
    times, known = times_of(run, stills), judge.known(run, stills)
    values = [_tumbled(run, stills, those, known) for those in triads]
    spreads = [_side_by_side([judge.spread(run.name, times)])]
    if not run.force.size:
        return _collected(run.name, ("rate",), values, spreads)
    if run.rate.size:
        at_rest = [judge.spread(f"{run.name} ({name} at rest)", times) for name in GYROSCOPES]
        turned = judge.spread_of_turns(
            f"{run.name} ({TURNS})", lasting(directions(triads[1][0], run, stills))
        )
        spreads += [_side_by_side(at_rest), turned]
    return _collected(run.name, ("gravity", "rest", "closure"), values, spreads)


def _tumbled(run: Run, stills: Stills, triads: Triads, known: FloatArray) -> list[FloatArray]:
    """Errors of lengths that are known (k, 1), and of an IMU of rest (k, 3) and closure (m, 2)."""
    f = triads[0].compensate(means_of(run, run.triad(triads[0].kind), stills))
    found = [_length(f, known)]
    if run.force.size and run.rate.size:
        rate = means_of(run, run.rate, stills)
        seen = directions(triads[0], run, stills)
        found += [triads[1].compensate(rate, f), closures(seen, triads[1])]
    return found


def _of_sections(run: Run, triads: tuple[Triads, Triads, Triads], judge: _Judge) -> Iterator[Recovered]:
    """Positions, and turns by known angles."""
    still = [s for s in run.sections if not s.angle]
    turned = [s for s in run.sections if s.angle]

    def spreads(names: Sequence[str], sections: Sequence[Section]) -> list[Spread]:
        times = [(float(run.t[s.start]), float(run.t[s.stop - 1])) for s in sections]
        return [judge.spread(f"{run.name} ({name})", times) for name in names]

    if not (run.force.size or turned):
        return _between_positions(run, triads, judge)
    what, found = [], []
    if run.force.size:
        what, found = ["gravity"], [_along(spreads(ACCELEROMETERS, still), still)]
    if run.rate.size:
        whole = np.array([(s.stop - s.start) * run.interval for s in turned])
        fitted, fresh = (sd * whole[:, None] for sd in _along(spreads(GYROSCOPES, turned), turned))
        what += ["rest", "turn"]
        found += [_side_by_side(spreads(GYROSCOPES, still)), (fitted, fresh)]
    return _collected(run.name, what, [_held(run, still, turned, those) for those in triads], found)


def _between_positions(run: Run, triads: tuple[Triads, Triads, Triads], judge: _Judge) -> Iterator[Recovered]:
    """Rest in positions that are known, and up from one to the next."""
    seen = known_directions(run, judge.case.summary.extras)
    times = times_of(run, seen.stills)
    at_rest = [judge.spread(f"{run.name} ({name} at rest)", times) for name in GYROSCOPES]
    turned = judge.spread_of_turns(f"{run.name} ({TURNS})", lasting(seen))
    rate = means_of(run, run.rate, seen.stills)
    values = [[those[0].compensate(rate, seen.f), closures(seen, those[0])] for those in triads]
    return _collected(run.name, ("rest", "closure"), values, [_side_by_side(at_rest), turned])


def _held(run: Run, still: Sequence[Section], turned: Sequence[Section], triads: Triads) -> list[FloatArray]:
    """Errors of gravity (k, 1), of rest (k, 3), and of turns (m, 1), as far as there are triads for them."""
    found, of_kind = [], {triad.kind: triad for triad in triads}
    f = run.gravity * np.array([s.direction for s in still])
    if accelerometers := of_kind.get("accelerometer"):
        f = accelerometers.compensate(_means(run, run.force, still))
        found += [_length(f, run.gravity)]
    if gyroscopes := of_kind.get("gyroscope"):
        found += [gyroscopes.compensate(_means(run, run.rate, still), f), _angles(run, turned, of_kind)]
    return found


def _means(run: Run, values: FloatArray, still: Sequence[Section]) -> FloatArray:
    """Means (k, a) over positions of what (n, a) components said."""
    return means_of(run, values, tuple((s.start, s.stop) for s in still))


def _angles(run: Run, turned: Sequence[Section], of_kind: Mapping[str, Triad]) -> FloatArray:
    """Integrated rate about the axis of each turn minus its angle, (m, 1), rad."""
    found = []
    for s in turned:
        inside = slice(s.start, s.stop)
        f = np.tile(run.gravity * s.direction, (s.stop - s.start, 1))
        if accelerometers := of_kind.get("accelerometer"):
            f = accelerometers.compensate(run.force[inside])
        w = of_kind["gyroscope"].compensate(run.rate[inside], f)
        found.append(float(run.interval * np.sum(w @ s.direction) - s.angle))
    return np.array(found)[:, None]


def _length(own: FloatArray, known: float | FloatArray) -> FloatArray:
    return np.linalg.norm(own, axis=1, keepdims=True) - known


def _along(spreads: Sequence[Spread], sections: Sequence[Section]) -> Spread:
    """Sds (k, 1) of the component along the axis of each section."""
    axes = [int(np.argmax(np.abs(s.direction))) for s in sections]
    fitted, fresh = (
        np.array([spreads[c][which][k] for k, c in enumerate(axes)])[:, None] for which in (0, 1)
    )
    return fitted, fresh


def _side_by_side(spreads: Sequence[Spread]) -> Spread:
    return np.column_stack([one[0] for one in spreads]), np.column_stack([one[1] for one in spreads])


def _collected(
    run: str, what: Sequence[str], values: Sequence[Sequence[FloatArray]], spreads: Sequence[Spread]
) -> Iterator[Recovered]:
    """One `Recovered` a quantity: `values` are before, after and flown."""
    for name, before, after, flown, (fitted, fresh) in zip(what, *values, spreads, strict=False):
        yield Recovered(run, name, before, after, flown, fitted, fresh)
