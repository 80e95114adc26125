"""Positions and turns of an IMU that are known: each case axis up and down, and a turn about each.

After Ferraris, Grimaldi, Parvis, "Procedure for effortless in-field calibration of three-axis rate gyros and
accelerometers", Sensors and Materials 7 (1995) 311. In a position the input is ``f = g u``, u up, and w = 0;
in a turn by an angle A about u the mean rate is ``A u / T``, whatever the hand did meanwhile. Powers of the
rate, which the hand does matter for, are averaged over the course that the gyroscope itself recorded, scaled
to the angle.

Gyroscopes alone may have positions without such turns: what they say between two of them carries up from one
to the next (`between_stills`).

A position is as good as the table and the faces of the case: with a rotation rho of the case, of its own in
each section, the inputs are ``v - rho x v``. The columns of rho are common to all six components, and hide
what is a rotation in all positions alike: misalignments are then known no better than the faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.inference.between_stills import turned_by
from imubayes.inference.case import Case, Told, TriadSpec, along, case_of
from imubayes.inference.free_tumble import solve_positions
from imubayes.inference.linear import Extra, Linear, among, averaged, block_edges, blocks_of
from imubayes.inference.stills import Stills, lasting_of, means_of, rows_of, samples_in
from imubayes.inference.summary import noise_by_rule, run_summary
from imubayes.inference.triad import Triad, spans, triad_of
from imubayes.rig.bench import KINDS
from imubayes.rig.inputs import Facts, Run, RunSection
from imubayes.units import STANDARD_GRAVITY


def solve_ferraris(
    runs: Sequence[Run],
    *asked: TriadSpec,
    extras: tuple[Extra, ...] = (),
    fixture: float | None = None,
) -> Case:
    """Characterise the six components of an IMU, or one triad of it, from known positions and turns.

    Parameters
    ----------
    runs : with sections.
    asked : of the accelerometers, and of the gyroscopes, where there are such; priors are of whole triads
        (``triad_of(lib, referenced=True)``).
    extras : error of the local gravity, if it is allowed for.
    fixture : sd, rad, of the rotation of the case in each section about each axis across it, if allowed for.

    It is an `UnobservableError` if a run has no position at rest, or there is no turn for gyroscopes.
    """
    turned = _check(runs)
    extras = (*_tilts(runs, fixture), *extras)
    if asked[0].library.kind == "gyroscope" and not turned:
        return solve_positions(runs, asked[0], extras=extras)
    sd = np.concatenate((*(one.prior.sd for one in asked), [extra.sd for extra in extras]))
    triads = [triad_of(one.library, referenced=True) for one in asked]
    names = (*(name for triad in triads for name in triad.names), *(extra.name for extra in extras))
    heard = [
        (run, triad, k, one)
        for triad, one in zip(triads, asked, strict=True)
        for k in range(len(triad.components))
        for run in runs
    ]
    told = [_told(run, triad, k, one, (extras, names)) for run, triad, k, one in heard]
    facts = {
        name: Facts(triad.kind, one_sided=False, force=STANDARD_GRAVITY)
        for triad in triads
        for name in triad.components
    }
    case = case_of(told, triads, facts, extras, sd=sd)
    ranges = [_ranges(run, triad.components[k], case.triads) for run, triad, k, _ in heard]
    summarized = [replace(one, ranges=ends) for one, ends in zip(case.summary.runs, ranges, strict=True)]
    return replace(case, summary=replace(case.summary, runs=tuple(summarized)))


def _told(
    run: Run, triad: Triad, k: int, asked: TriadSpec, held: tuple[Sequence[Extra], Sequence[str]]
) -> Told:
    """What a run says of one component, `held` are the extras and all columns."""
    rows = _component_rows(run, triad, k, held[0])
    found = noise_by_rule(blocks_of(rows), asked.rule(run.name), asked.sensor)
    taken = among(averaged(rows), held[1])
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
    turned = any(section.angle for run in runs for section in run.sections)
    if runs[0].rate.size and runs[0].force.size and not turned:
        raise UnobservableError("no section is a turn: gyroscopes need one about each axis, by a known angle")
    if turned and not runs[0].rate.size:
        raise UnobservableError("a section is a turn, which tells accelerometers nothing: leave it out")
    return turned


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


def _component_rows(run: Run, triad: Triad, k: int, extras: Sequence[Extra]) -> Linear:
    """Rows of one component of a triad, with the columns of its terms and of the extras."""
    component, lib = triad.components[k], triad.libraries[k]
    numbered = sorted(enumerate(run.sections), key=lambda pair: pair[1].start)
    told = [(n, s) for n, s in numbered if s.angle == 0.0 or lib.kind == "gyroscope"]
    made = [_section_rows(run, s, triad, k) for _, s in told]
    each, of_gravity = [], [extra.kind == "gravity" for extra in extras]
    for (n, _), (*_, own, terms) in zip(told, made, strict=True):
        gravity = own[k] / run.gravity if lib.kind == "accelerometer" else 0.0
        turned = [turned_by(extra, f"{run.name}.{n}", own)[k] for extra in extras]
        each.append(np.concatenate((terms, np.where(of_gravity, gravity, turned))))
    t, duration, y = (np.concatenate(parts) for parts in list(zip(*made, strict=True))[:3])
    X = np.repeat(each, [len(part[0]) for part in made], axis=0)
    return Linear(
        name=f"{run.name} ({component})",
        procedure=run.procedure,
        names=(*(f"{component}.{name}" for name in lib.names), *(extra.name for extra in extras)),
        t=t,
        duration=duration,
        interval=lasting_of(run, rows_of(_positions(run))[0])[1],
        y=y,
        columns=lambda start, stop: X[start:stop],
    )


def _section_rows(run: Run, section: RunSection, triad: Triad, k: int) -> tuple[FloatArray, ...]:
    """Rows of component k in one section: every sample at rest, the mean over a turn.

    Time and duration (m,), s, and output minus own input (m,), SI; the triad's own input (3,) and the terms
    (p,), which are alike in all rows of the section.
    """
    inside, u = slice(section.start, section.stop), section.direction
    said, force = run.triad(triad.kind)[inside], run.gravity * u
    if section.angle == 0.0:
        own, other = (np.zeros(3), force) if triad.kind == "gyroscope" else (force, np.zeros(3))
        X = triad.regressors(own[None], other[None])[k]
        duration = lasting_of(run, np.arange(section.start, section.stop))[0]
        return run.t[inside], duration, said[:, k] - own[k], own, X[0]
    lasting = len(said) * run.interval
    bias = np.mean(means_of(run, run.rate, _positions(run)), axis=0)
    course = said @ u - bias @ u
    w = u * (section.angle / lasting * course / course.mean())[:, None]
    X, own = triad.regressors(w, np.tile(force, (len(said), 1)))[k], section.angle / lasting * u
    y = said.mean(axis=0, keepdims=True)[:, k] - own[k]
    return run.t[inside].mean(keepdims=True), np.array([lasting]), y, own, X.mean(axis=0)


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
