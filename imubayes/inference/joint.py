"""A whole IMU turned by hand: accelerometers by the length of gravity, gyroscopes by its turns.

The accelerometers are solved first (`norm_only`); with the directions that they give, the turns between the
stills are linearised about the gyroscopes' coefficients until these settle (`between_stills`). All rows then
add up to one factor over the terms of all six components, so that what the accelerometers leave open is open
for the gyroscopes too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, add, posterior, posterior_root
from imubayes.errors import ConvergenceError
from imubayes.inference.between_stills import (
    Directions,
    directions,
    rest_forces,
    rest_rows,
    turn_rates,
    turn_rows,
    turning,
)
from imubayes.inference.case import Asked, Case, Component, along, components_of
from imubayes.inference.linear import (
    Extra,
    Linear,
    averaged,
    block_edges,
    blocks_of,
    residuals,
    widened,
    widened_factor,
    with_columns,
)
from imubayes.inference.norm_only import FreeTumble, solve_free_tumble
from imubayes.inference.reml import NoiseEstimate, estimate
from imubayes.inference.stills import Stills, find_stills
from imubayes.inference.summary import RunSummary
from imubayes.inference.triad import Triad, spans, triad_of
from imubayes.inference.whitened import whitened_factor
from imubayes.rig.inputs import ImuRun
from imubayes.sensors.catalogue import noise_prior
from imubayes.sensors.noise import Noise, NoiseRule

SETTLED = 1e-5
"""Change of a coefficient, in posterior sd, at which the linearisation has settled."""

ROUNDS = 50
"""Most relinearisations; three to six are usual."""

NOISE_ROUND = 2
"""Last round in which the noise of the turns is judged; in the first it is taken to be that at rest."""

NO_SD = (0.0, 0.0, 0.0)
"""Sd of ln N, ln B, ln K that are taken as known."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A run, its stills, and what the accelerometers say of them."""

    run: ImuRun
    stills: Stills
    directions: Directions
    noise: Noise


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """Rows of one part of a run, the noise that was found for them, and where it comes from."""

    rows: Linear
    found: NoiseEstimate
    origin: str


def solve_imu_tumble(
    runs: Sequence[ImuRun], accelerometer: Asked, gyroscope: Asked, *, gravity: Extra | None = None
) -> Case:
    """Characterise the six components of an IMU that was turned by hand between stills.

    Parameters
    ----------
    runs : of one IMU.
    accelerometer, gyroscope : what is asked of the components of each kind.
    gravity : error of the local gravity, if it is allowed for.

    Raises
    ------
    UnobservableError : if there are fewer than 9 stills, or in a run fewer than 6 turns between them.
    ConvergenceError : if a linearisation does not settle; it carries the triad so far.
    """
    free = solve_free_tumble(
        [run.accelerometers for run in runs],
        accelerometer.library,
        accelerometer.prior,
        sensor=accelerometer.sensor,
        rules=accelerometer.rules,
        gravity=gravity,
    )
    seen = [_seen(run, free, k) for k, run in enumerate(runs)]
    gyroscopes = triad_of(gyroscope.library)
    extras = free.summary.extras
    names = (*free.triad.names, *gyroscopes.names, *(extra.name for extra in extras))
    sd = np.concatenate((accelerometer.prior.sd, gyroscope.prior.sd, [extra.sd for extra in extras]))
    resting = [part for one in seen for part in _at_rest(one, gyroscopes, gyroscope)]
    known = reduce(
        add,
        (
            widened_factor(f, names)
            for f in (
                free.summary.factor,
                *(whitened_factor(part.rows, part.found.noise)[0] for part in resting),
            )
        ),
    )
    turned, gyroscopes = _settled(seen, resting, (known, sd), gyroscopes, gyroscope)
    return _case(free, gyroscopes, (resting, turned), seen, sd)


def _seen(run: ImuRun, free: FreeTumble, k: int) -> _Seen:
    stills = find_stills(run.accelerometers)
    return _Seen(run, stills, directions(free.triad, run, stills), free.summary.runs[k].noise)


def _at_rest(seen: _Seen, gyroscopes: Triad, asked: Asked) -> list[_Judged]:
    """Rows of each gyroscope in the stills of a run, and their noise."""
    parts = rest_rows(seen.run, seen.stills, seen.directions, gyroscopes)
    # within a still nothing but the noise changes: averages tell of the coefficients what all samples do
    return [_judged(averaged(part), blocks_of(part), asked, seen.run.name) for part in parts]


def _judged(rows: Linear, blocks: Linear, asked: Asked, run: str, *, sd: FloatArray | None = None) -> _Judged:
    """Rows with their noise by the rule of their run; `sd` as `reml.estimate` takes it."""
    rule = (asked.rules or {}).get(run, NoiseRule())
    if rule.value is not None:
        return _Judged(rows, NoiseEstimate(rule.value, NO_SD, ()), "given")
    found = estimate(blocks, noise_prior(asked.sensor) if asked.sensor else None, sd)
    if rule.rule == "white":
        return _Judged(rows, NoiseEstimate(Noise(found.noise.N, 0.0, 0.0), NO_SD, found.prior), "white")
    return _Judged(rows, found, "REML")


def _settled(
    seen: Sequence[_Seen],
    resting: Sequence[_Judged],
    given: tuple[Factor, FloatArray],
    gyroscopes: Triad,
    asked: Asked,
) -> tuple[list[_Judged], Triad]:
    """Turns linearised where that settles, with their noise, and the gyroscopes there.

    `given` is what all other rows say, and the prior sds.
    """
    known, sd = given
    own = slice(first := known.names.index(gyroscopes.names[0]), first + len(gyroscopes.theta))
    usual = _usual([part.found.noise for part in resting])
    # bias and g-sensitivity are known from rest before the first turn is integrated
    gyroscopes = replace(gyroscopes, theta=posterior(known, sd)[0][own])
    turned: list[_Judged] = []
    for turn in range(ROUNDS):
        rows = [widened(_turns(one, gyroscopes, usual), known.names) for one in seen]
        if turn == 0:
            turned = [_Judged(part, NoiseEstimate(usual, NO_SD, ()), "REML") for part in rows]
        elif turn <= NOISE_ROUND:
            named = zip(rows, (one.run.name for one in seen), strict=True)
            turned = [_turn_noise(part, known, sd, asked, name) for part, name in named]
        turned = [replace(old, rows=part) for old, part in zip(turned, rows, strict=True)]
        whole = reduce(add, (whitened_factor(part.rows, part.found.noise)[0] for part in turned), known)
        theta, spread = posterior(whole, sd)
        moved = np.abs(theta[own] - gyroscopes.theta)
        gyroscopes = replace(gyroscopes, theta=theta[own])
        if turn > NOISE_ROUND and np.all(moved <= SETTLED * spread[own]):
            return turned, gyroscopes
    raise ConvergenceError(f"the turns between the stills did not settle in {ROUNDS} rounds", gyroscopes)


def _turns(seen: _Seen, gyroscopes: Triad, usual: Noise) -> Linear:
    return turn_rows(seen.run, seen.stills, seen.directions, gyroscopes, noises=(seen.noise, usual))


def _usual(noises: Iterable[Noise]) -> Noise:
    """Noise of a component like these: root mean squares."""
    N, B, K = np.sqrt(np.mean([np.square((n.N, n.B, n.K)) for n in noises], axis=0)).tolist()
    return Noise(N, B, K)


def _turn_noise(rows: Linear, known: Factor, sd: FloatArray, asked: Asked, run: str) -> _Judged:
    """Noise of the turns, given what all other rows say of the coefficients.

    It is estimated anew: a turn adds what the rates do not tell, such as what happens between two samples.
    """
    mean, root = posterior_root(known, sd)
    X = rows.columns(0, len(rows))
    blocks = with_columns(rows, X @ root, rows.y - X @ mean)
    return _judged(rows, blocks, asked, run, sd=np.ones(root.shape[1]))


def _case(
    free: FreeTumble,
    gyroscopes: Triad,
    judged: tuple[Sequence[_Judged], Sequence[_Judged]],
    seen: Sequence[_Seen],
    sd: FloatArray,
) -> Case:
    """All rows of all components as one problem; `judged` are those at rest, run by run, and the turns."""
    old, split = free.summary, len(free.triad.theta)
    names = (*free.triad.names, *gyroscopes.names, *(extra.name for extra in old.extras))
    of_run = [one for one in seen for _ in gyroscopes.components] + list(seen)
    parts = [replace(part, rows=widened(part.rows, names)) for part in (*judged[0], *judged[1])]
    runs = (
        *(_among(run, part, names) for run, part in zip(old.runs, free.rows, strict=True)),
        *(_run_summary(part, one, gyroscopes) for part, one in zip(parts, of_run, strict=True)),
    )
    reach = np.max([run.reach for run in runs], axis=0)
    factor = reduce(add, (run.factor for run in runs))
    rows = (*(widened(averaged(part), names) for part in free.rows), *(part.rows for part in parts))
    theta, _ = posterior(factor, sd)
    rates = theta[split : split + len(gyroscopes.theta)]
    return Case(
        summary=replace(old, factor=factor, runs=runs, reach=dict(zip(names, reach.tolist(), strict=True))),
        rows=rows,
        components=tuple(_components(free, gyroscopes, len(seen))),
        triads=(replace(free.triad, theta=theta[:split]), replace(gyroscopes, theta=rates)),
        residuals=tuple(residuals(part, theta) for part in rows),
        inputs=tuple(_inputs(seen, gyroscopes)),
    )


def _components(free: FreeTumble, gyroscopes: Triad, runs: int) -> Iterator[Component]:
    """Components: accelerometers in all of their runs, each gyroscope at rest and in the turns."""
    facts = free.summary.facts
    yield from components_of(free.triad, facts, dict.fromkeys(free.triad.components, tuple(range(runs))))
    turns = range(4 * runs, 5 * runs)
    parts = {name: (*range(runs + c, 4 * runs, 3), *turns) for c, name in enumerate(gyroscopes.components)}
    yield from components_of(gyroscopes, replace(facts, kind="gyroscope"), parts)


def _inputs(seen: Sequence[_Seen], gyroscopes: Triad) -> Iterator[dict[str, FloatArray]]:
    """What moved in each part: the force at rest, then the rate in the turns."""
    yield from (_still_forces(one) for one in seen)
    yield from (_still_forces(one) for one in seen for _ in gyroscopes.components)
    for one in seen:
        yield along("w", turn_rates(one.run, one.stills, one.directions, gyroscopes))


def _still_forces(seen: _Seen) -> dict[str, FloatArray]:
    """Specific force of each block of the stills."""
    index = np.concatenate([np.arange(a, b) for a, b in seen.stills])
    edges = block_edges(seen.run.t[index], seen.run.interval)
    return along("f", rest_forces(seen.stills, seen.directions)[edges])


def _among(run: RunSummary, part: Linear, names: Sequence[str]) -> RunSummary:
    """Summary of a run of the accelerometers among the columns of all components."""
    rows = widened(averaged(part), names)
    made, reach = whitened_factor(rows, run.noise)
    return replace(run, factor=made, reach=reach, interval=rows.interval, sampling=run.interval)


def _run_summary(part: _Judged, seen: _Seen, gyroscopes: Triad) -> RunSummary:
    """Summary of a part of a run of the gyroscopes: their inputs at rest, or in the turns."""
    made, reach = whitened_factor(part.rows, part.found.noise)
    run, found = seen.run, part.found
    if part.rows.axes is None:
        ranges = spans("f", np.concatenate([seen.directions.force[a:b] for a, b in seen.stills]))
    else:
        w, f = turning(run, seen.stills, seen.directions, gyroscopes)
        ranges = spans("w", w) | spans("f", f)
    return RunSummary(
        name=part.rows.name,
        procedure=run.procedure,
        samples=len(part.rows) if part.rows.axes is not None else sum(b - a for a, b in seen.stills),
        duration=float(part.rows.t[-1] - part.rows.t[0]),
        interval=part.rows.interval,
        noise=found.noise,
        noise_sd=found.sd,
        noise_prior=found.prior,
        noise_origin=part.origin,
        noise_run=part.rows.name,
        steering=found.steering,
        ranges=ranges,
        source=run.source,
        factor=made,
        reach=reach,
        stills=tuple((float(run.t[a]), float(run.t[b - 1])) for a, b in seen.stills),
        sampling=run.interval,
    )
