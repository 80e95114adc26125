"""Positions and turns of an IMU that are known: each case axis up and down, and a turn about each.

After Ferraris, Grimaldi, Parvis, "Procedure for effortless in-field calibration of three-axis rate gyros and
accelerometers", Sensors and Materials 7 (1995) 311. In a position the input is ``f = g u``, u up, and w = 0;
in a turn by an angle A about u the mean rate is ``A u / T``, whatever the hand did meanwhile. Powers of the
rate, which the hand does matter for, are averaged over the course that the gyroscope itself recorded, scaled
to the angle.

Gyroscopes alone may have positions without such turns: what they say between two of them carries up from one
to the next (`between_stills`).

A position is as good as the table and the faces of the case: with a rotation rho of the case, of its own in
each section, the inputs are ``R(-rho) v``. The columns of rho are common to all six components, and hide
what is a rotation in all positions alike: misalignments are then known no better than the faces. What is
hidden shortens the input along its axis by ``(rho_a^2 + rho_b^2) / 2``, of which the mean is taken off, and
what it scatters by is one unknown for each axis, of the positions and of the turns: a scale factor is known
no better than that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import add, noise_scale, posterior_root
from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.inference.between_stills import rotation_of
from imubayes.inference.case import Case, Told, TriadSpec, along, case_of
from imubayes.inference.free_tumble import solve_positions
from imubayes.inference.linear import Extra, Linear, among, averaged, block_edges, blocks_of
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.nuisances import shortening
from imubayes.inference.settle import Pace, Round, settle
from imubayes.inference.stills import Stills, lasting_of, means_of, rows_of, samples_in
from imubayes.inference.summary import Summary, noise_by_rule, run_summary
from imubayes.inference.triad import Triad, spans, triad_of
from imubayes.rig.bench import KINDS, SHORTENING
from imubayes.rig.inputs import Facts, Run, RunSection
from imubayes.rig.motion import turned
from imubayes.units import STANDARD_GRAVITY

TILTS = Pace("tilts of the sections", judged=range(1), settled=1e-4, rounds=50)
"""The first round is at the solution of the linear problem; four are usual."""

SHORTENED = SHORTENING["fixture"]
"""Kind of error that hidden tilts are beside themselves."""

STEP = 1e-4
"""Change of a tilt, rad, or a shortening for the derivatives: outputs are cubic in it, with 1e-8 of that."""


def solve_ferraris(
    runs: Sequence[Run], *asked: TriadSpec, extras: tuple[Extra, ...] = (), fixture: float | None = None
) -> Case:
    """Characterise the six components of an IMU, or one triad of it, from known positions and turns.

    Parameters
    ----------
    runs : with sections.
    asked : of the accelerometers, and of the gyroscopes, where there are such; priors are of whole triads
        (``triad_of(lib, referenced=True)``).
    extras : error of the local gravity, if it is allowed for.
    fixture : sd, rad, of the rotation of the case in each section about each axis across it, if allowed for.

    It is an `UnobservableError` if a run has no position at rest, or there is no turn for gyroscopes, and a
    `ConvergenceError` if the tilts of the sections do not settle.
    """
    with_turns = _check(runs)
    tilts = _tilts(runs, fixture)
    if asked[0].library.kind == "gyroscope" and not with_turns:
        return solve_positions(runs, asked[0], extras=(*tilts, *extras))
    triads = tuple(triad_of(spec.library, referenced=True) for spec in asked)
    problem = _Problem(tuple(runs), asked, triads, (*tilts, *extras))
    place, noise = np.zeros(len(problem.sd)), list[NoiseEstimate]()
    if tilts:
        flat = problem.at(place, (), None)
        problem, place = _shortened(problem, flat, tilts)
        settled = settle(problem.at, problem.sd, TILTS, place)
        place, noise = settled.place, [*settled.noise]
    facts = {
        name: Facts(triad.kind, one_sided=False, force=STANDARD_GRAVITY)
        for triad in triads
        for name in triad.components
    }
    told = problem.told(place, noise)
    case = case_of(told, triads, facts, problem.extras, sd=problem.sd)
    ranges = [_ranges(run, triad.components[k], case.triads) for run, triad, k, _ in problem.heard()]
    summarized = [
        replace(summary, ranges=ends) for summary, ends in zip(case.summary.runs, ranges, strict=True)
    ]
    return replace(case, summary=replace(case.summary, runs=tuple(summarized)))


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Runs with sections, what is asked of each triad, and errors of the positions."""

    runs: tuple[Run, ...]
    asked: tuple[TriadSpec, ...]
    triads: tuple[Triad, ...]
    extras: tuple[Extra, ...]

    @property
    def sd(self) -> FloatArray:
        """Prior sds of all columns, SI."""
        return np.concatenate((*(spec.prior.sd for spec in self.asked), [extra.sd for extra in self.extras]))

    @property
    def names(self) -> tuple[str, ...]:
        """All columns."""
        return (*(n for triad in self.triads for n in triad.names), *(extra.name for extra in self.extras))

    def heard(self) -> list[tuple[Run, Triad, int, TriadSpec]]:
        """Every component of every run: its triad, its place there, and what is asked of it."""
        return [
            (run, triad, k, spec)
            for triad, spec in zip(self.triads, self.asked, strict=True)
            for k in range(len(triad.components))
            for run in self.runs
        ]

    def told(self, place: FloatArray, noise: Sequence[NoiseEstimate]) -> list[Told]:
        """What each component of each run says at a place; its noise is judged where none is given."""
        every = self.heard()
        pairs = zip(every, noise or [None] * len(every), strict=True)
        return [_told(self, *heard, place, known) for heard, known in pairs]

    def at(self, place: FloatArray, noise: Sequence[NoiseEstimate], _: FloatArray | None) -> Round:
        """Linearise, as `settle.At` says."""
        told = self.told(place, noise)
        factor = add(*(part.run.factor for part in told))
        rows, found = tuple(part.rows for part in told), [part.run.found for part in told]
        return Round(place, Summary(factor), rows, found, noise_scale(factor, self.sd))


def _shortened(problem: _Problem, flat: Round, tilts: Sequence[Extra]) -> tuple[_Problem, FloatArray]:
    """Problem with what hidden tilts shorten, and the posterior mean of the linear problem.

    Tilts of one axis hide behind the same misalignment, so that its sections are shortened alike.
    """
    mean, root = posterior_root(flat.summary.factor, problem.sd, flat.scale)
    variance = dict(zip(problem.names, np.sum(root**2, axis=1).tolist(), strict=True))
    hidden: dict[str, list[list[float]]] = {}
    for run in problem.runs:
        for n, section in enumerate(run.sections):
            own = [variance[tilt.name] for tilt in tilts if rotation_of(tilt, f"{run.name}.{n}").any()]
            hidden.setdefault(shortening_of(section), []).append(own)
    every = list[Extra]()
    for name, sections in hidden.items():
        _, sort, axis = name.split(".")
        every += shortening(name, SHORTENED, sections, f"{SHORTENED.text}, along {axis} in {sort}")
    start = np.insert(mean, len(mean) - len(problem.extras), np.zeros(len(every)))
    return replace(problem, extras=(*every, *problem.extras)), start


def shortening_of(section: RunSection) -> str:
    """Name of the shortening that a section has with others: ``shortening.positions.x``."""
    axis = "xyz"[int(np.flatnonzero(section.direction)[0])]
    return f"{SHORTENED.name}.{'turns' if section.angle else 'positions'}.{axis}"


def _told(
    problem: _Problem,
    run: Run,
    triad: Triad,
    k: int,
    asked: TriadSpec,
    place: FloatArray,
    known: NoiseEstimate | None,
) -> Told:
    """What a run says of one component, linearised at a place."""
    rows = _component_rows(problem, run, triad, k, place)
    found = known or noise_by_rule(blocks_of(rows), asked.rule(run.name), asked.sensor)
    taken = among(averaged(rows), problem.names)
    still = _positions(run)
    summary = replace(
        run_summary(taken, found, run.source, {}),
        samples=len(rows) + samples_in(run, still) - sum(b - a for a, b in still),
        stills=tuple((float(run.t[a]), float(run.t[b - 1])) for a, b in still),
        sampling=run.interval,
    )
    index = np.searchsorted(run.t, rows.t[block_edges(rows.t, rows.interval)])
    f = np.zeros((len(index), 3))  # of each block, for the figures
    for section in run.sections:
        f[(index >= section.start) & (index < section.stop)] = run.gravity * section.direction
    return Told(summary, taken, along("f", f), (triad.components[k],))


def _check(runs: Sequence[Run]) -> bool:
    """Whether a section is a turn; refuse runs that do not tell what is asked."""
    for run in runs:
        if all(section.angle for section in run.sections):
            raise UnobservableError(f"run '{run.name}' has no position at rest: add sections without a turn")
    with_turns = any(section.angle for run in runs for section in run.sections)
    if runs[0].rate.size and runs[0].force.size and not with_turns:
        raise UnobservableError("no section is a turn: gyroscopes need one about each axis, by a known angle")
    if with_turns and not runs[0].rate.size:
        raise UnobservableError("a section is a turn, which tells accelerometers nothing: leave it out")
    return with_turns


def _tilts(runs: Sequence[Run], sd: float | None) -> tuple[Extra, ...]:
    """Columns for the rotation of the case in each section."""
    if sd is None:
        return ()
    kind, said = KINDS["fixture"], "{} about {} in section {} of run {}"
    return tuple(
        Extra.of(f"fixture_{i}.{run.name}.{n}", kind, sd, said.format(kind.text, x, n, run.name))
        for run in runs
        for n, section in enumerate(run.sections)
        for i, x, along_it in zip("ijk", "xyz", section.direction, strict=True)
        if along_it == 0.0
    )


def _positions(run: Run) -> Stills:
    """Rows of the sections at rest."""
    return tuple((s.start, s.stop) for s in run.sections if s.angle == 0.0)


def _component_rows(problem: _Problem, run: Run, triad: Triad, k: int, place: FloatArray) -> Linear:
    """Rows of one component of a triad, with the columns of its terms and of the extras."""
    component, lib = triad.components[k], triad.libraries[k]
    values = dict(zip(problem.names, place.tolist(), strict=True))
    theta = np.array([values[f"{component}.{name}"] for name in lib.names])
    nu = np.array([values[extra.name] if extra.held is None else 0.0 for extra in problem.extras])
    there = nu + [extra.held or 0.0 for extra in problem.extras]
    numbered = sorted(enumerate(run.sections), key=lambda pair: pair[1].start)
    each, made, tested = [], [], np.zeros(len(theta), dtype=bool)
    for n, section in numbered:
        if section.angle and lib.kind == "accelerometer":
            continue
        t, duration, output, at = _section_rows(run, section, triad, k)
        # how each extra turns (rad, 3) and shortens the inputs of this section
        moves = np.array([_move(extra, run, n, section) for extra in problem.extras]).reshape(-1, 4)
        lie = there @ moves
        own, terms = at(lie)
        tested |= at(np.zeros(4))[1] != 0.0
        slopes = np.zeros(len(moves))
        for e in np.flatnonzero(moves.any(axis=1)):
            ends = [at(lie + step * moves[e]) for step in (STEP, -STEP)]
            slopes[e] = (ends[0][0] - ends[1][0] + (ends[0][1] - ends[1][1]) @ theta) / (2.0 * STEP)
        y = output - own + slopes @ nu
        if lib.kind == "accelerometer":
            slopes[[extra.kind == "gravity" for extra in problem.extras]] = own / run.gravity
        each.append(np.concatenate((terms, slopes)))
        made.append((t, duration, y))
    t, duration, y = (np.concatenate(parts) for parts in zip(*made, strict=True))
    # what no section is there for is not tested by the little that its tilts make of it
    tables = np.array(each) * np.append(tested, np.ones(len(problem.extras)))
    X = np.repeat(tables, [len(part[0]) for part in made], axis=0)
    return Linear(
        name=f"{run.name} ({component})",
        procedure=run.procedure,
        names=(*(f"{component}.{name}" for name in lib.names), *(extra.name for extra in problem.extras)),
        t=t,
        duration=duration,
        interval=lasting_of(run, rows_of(_positions(run))[0])[1],
        y=y,
        columns=lambda start, stop: X[start:stop],
    )


def _move(extra: Extra, run: Run, number: int, section: RunSection) -> FloatArray:
    """What a unit of an extra turns the case by in a section, rad about its axes, and shortens inputs by."""
    if extra.kind == SHORTENED.name:
        return np.array([0.0, 0.0, 0.0, float(extra.name == shortening_of(section))])
    return np.append(rotation_of(extra, f"{run.name}.{number}"), 0.0)


InputsAt = Callable[[FloatArray], tuple[float, FloatArray]]
"""Own input of a component in a section, and its terms (p,), where the case lies turned about its axes,
rad, and inputs are shorter by a share, the last of the four."""


def _section_rows(
    run: Run, section: RunSection, triad: Triad, k: int
) -> tuple[FloatArray, FloatArray, FloatArray, InputsAt]:
    """What component k of a triad says in one section: every sample at rest, the mean over a turn.

    Time and duration (m,), s, output (m,), SI, and the inputs by how the case lies.
    """
    inside, u = slice(section.start, section.stop), section.direction
    said, force, rate = run.triad(triad.kind)[inside], run.gravity * u[None], np.zeros((1, 3))
    if section.angle == 0.0:
        t, duration = run.t[inside], lasting_of(run, np.arange(section.start, section.stop))[0]
        output = said[:, k]
    else:
        lasting = len(said) * run.interval
        bias = np.mean(means_of(run, run.rate, _positions(run)), axis=0)
        course = said @ u - bias @ u
        rate = u * (section.angle / lasting * course / course.mean())[:, None]
        force = np.repeat(force, len(said), axis=0)
        t, duration = run.t[inside].mean(keepdims=True), np.array([lasting])
        output = said.mean(axis=0, keepdims=True)[:, k]
    pair = (rate, force) if triad.kind == "gyroscope" else (force, rate)

    def at(lie: FloatArray) -> tuple[float, FloatArray]:
        own, other = ((1.0 - lie[3]) * turned(v, -lie[None, :3]) for v in pair)
        return float(own[:, k].mean()), triad.regressors(own, other)[k].mean(axis=0)

    return t, duration, output, at


def _ranges(run: Run, component: str, triads: Sequence[Triad]) -> dict[str, tuple[float, float]]:
    """Inputs of the sections that say something of a component: compensated, sample by sample.

    Where the coefficients are too far off for that (a column's scale or offset is wrong), as they are known;
    so is the force that no accelerometer measures.
    """
    of_rate, of_kind = component.startswith("g"), {triad.kind: triad for triad in triads}
    sections = [s for s in run.sections if of_rate or not s.angle]
    inside = np.concatenate([np.arange(s.start, s.stop) for s in sections])
    f = run.gravity * np.repeat([s.direction for s in sections], [s.stop - s.start for s in sections], axis=0)
    try:
        if "accelerometer" in of_kind:
            f = of_kind["accelerometer"].compensate(run.force[inside])
        w = of_kind["gyroscope"].compensate(run.rate[inside], f) if of_rate else None
    except ConvergenceError:
        f = np.array([run.gravity * s.direction for s in sections])
        w = np.array([s.angle / ((s.stop - s.start) * run.interval) * s.direction for s in sections])
    return spans("f", f) | (spans("w", w) if of_rate and w is not None else {})
