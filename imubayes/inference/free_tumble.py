"""Reference-free tumble: a triad in the hand, or a whole IMU, of which only |f| = g is known while it rests.

At rest the compensated output has the length g, so each still gives one equation. Linearised about the
current coefficients theta_0 it is a row of an ordinary linear model: with the compensated output f of the
still, ``F(f) = y``, its direction ``u = f/|f|`` and ``w = u' (I + M)^-1``::

    w . (y_t - y) + |f| - g + x theta_0 = x theta + w . noise_t,      x_(c,k) = w_c phi_k(f)

so that rows, noise, factor and selection are those of every other test. A rotation of the case leaves all
lengths alone; `triad` says how it is fixed.

Gyroscopes on a table whose rate is known, lying on it in any direction, are the same: in a section at a
constant rate |w| is known, but for the Earth's rate along the table's axis, which adds to turns in one sense
and takes from those in the other; what is left of it goes round in the case, and averages out. A rotation of
the case is not seen here either.

Of a whole IMU the accelerometers are solved first; with the directions that they give, the turns between the
stills are linearised about the gyroscopes' coefficients until these settle (`between_stills`). All rows then
add up to one factor over the terms of all six components, so that what the accelerometers leave open is open
for the gyroscopes too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, add, posterior_root
from imubayes.errors import UnobservableError
from imubayes.inference.between_stills import (
    Directions,
    directions,
    known_directions,
    rest_rows,
    turn_rows,
    turning,
)
from imubayes.inference.case import Case, Told, TriadSpec, along, case_of
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.linear import (
    Extra,
    Linear,
    among,
    averaged,
    block_edges,
    blocks_of,
    reach_of,
    widened_factor,
    with_columns,
)
from imubayes.inference.noise_model import NoiseEstimate, estimate
from imubayes.inference.robust import ROUNDS, Distrusted, robust_rows
from imubayes.inference.settle import Pace, Round, settle
from imubayes.inference.stills import (
    lasting_of,
    left_by,
    lengths_of,
    means_of,
    resting,
    rows_of,
    samples_in,
    shifts_of,
    times_of,
)
from imubayes.inference.summary import RunSummary, Summary, noise_by_rule, run_summary
from imubayes.inference.triad import Triad, spans, triad_of
from imubayes.rig.inputs import Facts, Run
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import Noise, noise_prior
from imubayes.units import STANDARD_GRAVITY, counted

FEWEST = 9
"""Stills below which bias, scale factor and non-orthogonality (9 parameters) are not determined."""

STILLS = Pace("free tumble", judged=range(2, 3), settled=1e-6, rounds=50)
"""From the third round on the rows are good enough to judge the noise by; three to six rounds are usual."""

TURNS = Pace("turns between the stills", judged=range(1, 3), settled=1e-5, rounds=50)
"""In the first round the noise of the turns is taken to be that at rest; three to six rounds are usual."""

ORIGIN = {"estimate": "REML", "fixed": "given", "white": "white"}
"""Origin of the noise, by rule."""


def solve_free_tumble(runs: Sequence[Run], asked: TriadSpec, *, extras: tuple[Extra, ...] = ()) -> Case:
    """Linearise free tumbles of one triad until they settle.

    The `extras` are errors of local gravity, or of the rate of a table, that are allowed for (`shifts_of`).
    It is an `UnobservableError` if there are fewer than 9 stills, or sections at a known rate, and a
    `ConvergenceError`, which carries the coefficients so far, if the linearisation does not settle.
    """
    runs, kind = [resting(run) for run in runs], asked.library.kind
    if (count := sum(len(run.stills) for run in runs)) < FEWEST:
        what = counted(count, "still" if kind == "accelerometer" else "section")
        raise UnobservableError(
            f"{what} {'is' if count == 1 else 'are'} too few: {FEWEST} directions at least, 20 or more are"
            " usual"
        )
    sd = np.concatenate((asked.prior.sd, [extra.sd for extra in extras]))
    triad, first = triad_of(asked.library), [_start(run, asked) for run in runs]

    def at(place: FloatArray, noise: Sequence[NoiseEstimate], _: FloatArray | None) -> Round:
        there = replace(triad, theta=place[: len(triad.theta)])
        rows = tuple(norm_rows(there, run, extras) for run in runs)
        blocks = [blocks_of(part) for part in rows]
        noise = noise or _judged(blocks, first, asked, sd)
        factors = (whitened_factor(part, one.noise) for part, one in zip(blocks, noise, strict=True))
        return Round(place, Summary(add(*factors)), rows, noise)

    settled = settle(at, sd, STILLS, np.zeros(len(sd)), first)
    there = replace(triad, theta=settled.place[: len(triad.theta)])
    told = [_told_of(there, run, extras, one) for run, one in zip(runs, settled.noise, strict=True)]
    force = STANDARD_GRAVITY if kind == "accelerometer" else 0.0
    facts = Facts(kind, one_sided=False, force=force, reference_free=True)
    known = dict.fromkeys(triad.components, facts)
    return case_of(told, [triad], known, extras, sd=sd, theta=settled.place)


def trusted_stills(
    runs: Sequence[Run], asked: TriadSpec, *, extras: tuple[Extra, ...] = (), rng: np.random.Generator
) -> tuple[tuple[Run, ...], tuple[Distrusted, ...], Case]:
    """Runs without the stills, or parts of a rest, that somebody touched; these; and the case that is left.

    All stills are linearised about coefficients that the spoilt ones pull at: so it is done again without
    them. `asked` is of the triad by whose lengths stills are judged: of an IMU the accelerometers.
    """
    found: tuple[Distrusted, ...] = ()
    runs = [resting(run) for run in runs]
    case = solve_free_tumble(runs, asked, extras=extras)
    sd = np.concatenate((asked.prior.sd, [extra.sd for extra in case.summary.extras]))
    for _ in range(ROUNDS):
        first = {run.name: _start(run, asked) for run in runs}
        at_rest = [np.isin(np.arange(len(run.t)), rows_of(run.stills)[0]) for run in runs]
        held = [run.left(rows) for run, rows in zip(runs, at_rest, strict=True)]

        def noise_of(some: Sequence[Run], rows: Sequence[Linear], first=first) -> list[Noise]:
            blocks, own = [blocks_of(part) for part in rows], [first[run.name] for run in some]
            return [one.noise for one in _judged(blocks, own, asked, sd)]

        seen = robust_rows(held, case.rows, sd, noise_of, rng=rng)
        if not seen.distrusted and len(seen.runs) == len(runs):
            break
        spans = [[(d.start, d.stop) for d in seen.distrusted if d.run == run.name] for run in runs]
        kept = [left_by(run, run.stills, own) for run, own in zip(runs, spans, strict=True)]
        there = {run.name for run in seen.runs}
        left = [replace(run, stills=own) for run, own in zip(runs, kept, strict=True) if run.name in there]
        source = replace(left[0].source, notes=(*left[0].source.notes, *seen.notes))
        runs = [replace(left[0], source=source), *left[1:]]
        found += seen.distrusted
        case = solve_free_tumble(runs, asked, extras=extras)
    return tuple(runs), found, case


def _start(run: Run, asked: TriadSpec) -> NoiseEstimate:
    """Noise that the study gives, or white noise from the scatter within the stills to start from.

    Means have none: the class's is as good a start.
    """
    rule = asked.rule(run.name)
    index, still = rows_of(run.stills)
    if len(index) == len(run.stills) and asked.sensor:
        return NoiseEstimate(rule.value or typical_noise(asked.sensor), origin=ORIGIN[rule.rule])
    said = run.triad(asked.library.kind)
    within = said[index] - means_of(run, said, run.stills)[still]
    averaged = run.inputs.averaged
    lasting = run.interval if averaged is None else averaged[index, None]
    density = float(np.sum(lasting * within**2)) / (within.size - 3 * len(run.stills))
    scatter = Noise(float(np.sqrt(density)), 0.0, 0.0)
    return NoiseEstimate(rule.value or scatter, origin=ORIGIN[rule.rule])


def _judged(
    blocks: Sequence[Linear], first: Sequence[NoiseEstimate], asked: TriadSpec, sd: FloatArray
) -> list[NoiseEstimate]:
    """Noise of each run, estimated where its rule says so, or that of another run.

    The stills are hardly more than the coefficients, which keep their prior instead of being taken out whole.
    """
    prior = noise_prior(asked.sensor) if asked.sensor else None
    rules = {part.name: asked.rule(part.name) for part in blocks}
    own = {
        part.name: estimate(part, prior, sd) if rules[part.name].rule == "estimate" else one
        for part, one in zip(blocks, first, strict=True)
    }
    return [
        replace(own[rule.like], origin=f"run {rule.like}", run=rule.like) if rule.like in own else own[name]
        for name, rule in rules.items()
    ]


def norm_rows(triad: Triad, run: Run, extras: tuple[Extra, ...] = ()) -> Linear:
    """Rows of the stills, linearised at a triad's coefficients."""
    said, (index, still) = run.triad(triad.kind), rows_of(run.stills)
    means, known = means_of(run, said, run.stills), lengths_of(run)
    lasting, interval = lasting_of(run, index)
    f = triad.compensate(means)
    length = np.linalg.norm(f, axis=1)
    w = np.linalg.solve(triad.gain().T, (f / length[:, None]).T).T
    X = np.hstack([w[:, [c]] * phi for c, phi in enumerate(triad.regressors(f))])
    base = length - known + X @ triad.theta
    X = np.hstack((X, shifts_of(run, extras)))
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=(*triad.names, *(extra.name for extra in extras)),
        t=run.t[index],
        duration=lasting,
        interval=interval,
        y=base[still] + np.einsum("na,na->n", w[still], said[index] - means[still]),
        columns=lambda start, stop: X[still[start:stop]],
        axes=w[still],
    )


def _told_of(triad: Triad, run: Run, extras: tuple[Extra, ...], found: NoiseEstimate) -> Told:
    """All samples of the stills, at the settled linearisation."""
    rows, (index, still) = norm_rows(triad, run, extras), rows_of(run.stills)
    letter, said = ("f" if triad.kind == "accelerometer" else "w"), run.triad(triad.kind)
    summary = replace(
        run_summary(rows, found, run.source, spans(letter, triad.compensate(said[index]))),
        samples=samples_in(run, run.stills),
        duration=float(run.t[-1] - run.t[0]),
        stills=times_of(run, run.stills),
        sampling=run.inputs.sampling,
    )
    own = triad.compensate(means_of(run, said, run.stills))
    return Told(summary, rows, along(letter, own[still]), triad.components)


def solve_imu_tumble(
    runs: Sequence[Run],
    accelerometer: TriadSpec,
    gyroscope: TriadSpec,
    *,
    extras: tuple[Extra, ...] = (),
    free: Case | None = None,
) -> Case:
    """Characterise the six components of an IMU that was turned by hand between stills.

    An error of the local gravity may be allowed for; `free` is the accelerometers, where they are solved.
    Errors are as in `solve_free_tumble`; of turns a run needs 6 between its stills.
    """
    free = free or solve_free_tumble(runs, accelerometer, extras=extras)
    seen = [directions(free.triads[0], resting(run)) for run in runs]
    gyroscopes, extras = triad_of(gyroscope.library, referenced=True), free.summary.extras
    names = (*free.triads[0].names, *gyroscopes.names, *(extra.name for extra in extras))
    sd = np.concatenate((accelerometer.prior.sd, gyroscope.prior.sd, [extra.sd for extra in extras]))
    beside = Summary(widened_factor(free.summary.factor, names), free.summary.runs)
    gyroscopes, carried = _carried(seen, beside, gyroscopes, gyroscope, sd)
    told = []
    for one, run, part in zip(seen, free.summary.runs, free.rows, strict=True):
        rows = among(averaged(part), names)
        factor, reach = whitened_factor(rows, run.noise), reach_of(rows)
        made = replace(run, factor=factor, reach=reach, interval=rows.interval, sampling=run.interval)
        told.append(Told(made, rows, _still_forces(one), free.triads[0].components))
    triads = (free.triads[0], gyroscopes)
    facts = {name: replace(free.summary.facts, kind=t.kind) for t in triads for name in t.components}
    return case_of([*told, *carried], triads, facts, extras, sd=sd)


def solve_positions(runs: Sequence[Run], asked: TriadSpec, *, extras: tuple[Extra, ...] = ()) -> Case:
    """Characterise gyroscopes alone that were turned by hand between positions in which up is known.

    `extras` are errors of the positions that are allowed for, one for each section.
    Errors are as in `solve_imu_tumble`.
    """
    seen, triad = [known_directions(run, extras) for run in runs], triad_of(asked.library, referenced=True)
    sd = np.concatenate((asked.prior.sd, [extra.sd for extra in extras]))
    width = len(sd) + 1
    nothing = Factor((*triad.names, *(extra.name for extra in extras)), np.zeros((width, width)), 0)
    triad, told = _carried(seen, Summary(nothing), triad, asked, sd)
    facts = Facts(triad.kind, one_sided=False, force=STANDARD_GRAVITY, reference_free=True)
    return case_of(told, [triad], dict.fromkeys(triad.components, facts), extras, sd=sd)


def _carried(
    seen: Sequence[Directions], beside: Summary, gyroscopes: Triad, asked: TriadSpec, sd: FloatArray
) -> tuple[Triad, tuple[Told, ...]]:
    """Gyroscopes at rest and in the turns between stills whose directions are known, and what they say.

    `beside` is what the accelerometers say of all columns, with a run for each of `seen`, or none.
    """
    names = beside.factor.names
    # within a still nothing but the noise changes: averages tell of the coefficients what all samples do
    resting = [
        (one, name, averaged(part), noise_by_rule(blocks_of(part), asked.rule(one.run.name), asked.sensor))
        for one in seen
        for name, part in zip(gyroscopes.components, rest_rows(one, gyroscopes), strict=True)
    ]
    factors = (whitened_factor(part, found.noise) for *_, part, found in resting)
    # of a component like these: root mean squares
    each = [np.square((one.noise.N, one.noise.B, one.noise.K)) for *_, one in resting]
    usual = Noise(*np.sqrt(np.mean(each, axis=0)).tolist())
    exact = [Noise(0.0, 0.0, 0.0)] * len(seen)
    noises = [(noise, usual) for noise in [run.noise for run in beside.runs] or exact]
    whole = add(beside.factor, *(widened_factor(f, names) for f in factors))
    turned = _turns(seen, noises, (whole, sd), gyroscopes, asked)
    first = names.index(gyroscopes.names[0])
    gyroscopes = replace(gyroscopes, theta=turned.place[first : first + len(gyroscopes.theta)])
    told = []
    for one, name, part, found in resting:
        ranges = spans("f", one.force[rows_of(one.run.stills)[0]])
        made = _part(one, rows := among(part, names), found, ranges)
        run = replace(made, samples=samples_in(one.run, one.run.stills))
        told.append(Told(run, rows, _still_forces(one), (name,)))
    of_turns = map(_of_turns, seen, turned.rows, turned.noise, [gyroscopes] * len(seen))
    return gyroscopes, (*told, *of_turns)


def _turns(
    seen: Sequence[Directions],
    noises: Sequence[tuple[Noise, Noise]],
    given: tuple[Factor, FloatArray],
    gyroscopes: Triad,
    asked: TriadSpec,
) -> Round:
    """Turns linearised where that settles, with their noise.

    `noises` are of an accelerometer of each run, and of a gyroscope at rest; `given` is what all other rows
    say, and the prior sds.
    """
    known, sd = given
    # bias and g-sensitivity are known from rest before the first turn is integrated
    mean, root = posterior_root(known, sd)
    first = known.names.index(gyroscopes.names[0])

    def at(place: FloatArray, noise: Sequence[NoiseEstimate], _: FloatArray | None) -> Round:
        there = replace(gyroscopes, theta=place[first : first + len(gyroscopes.theta)])
        rows = tuple(
            among(turn_rows(one, there, noises=pair), known.names)
            for one, pair in zip(seen, noises, strict=True)
        )
        # given what all other rows say, and anew: a turn adds what the rates do not tell between two samples
        left = [with_columns(part, part.X @ root, part.y - part.X @ mean) for part in rows]
        noise = noise or [
            noise_by_rule(part, asked.rule(one.run.name), asked.sensor, np.ones(root.shape[1]))
            for part, one in zip(left, seen, strict=True)
        ]
        factors = (whitened_factor(part, one.noise) for part, one in zip(rows, noise, strict=True))
        return Round(place, Summary(add(known, *factors)), rows, noise)

    return settle(at, sd, TURNS, mean, [NoiseEstimate(pair[1]) for pair in noises])


def _of_turns(seen: Directions, rows: Linear, found: NoiseEstimate, gyroscopes: Triad) -> Told:
    rates, forces = zip(*turning(seen, gyroscopes), strict=True)
    ranges = spans("w", np.concatenate(rates)) | spans("f", np.concatenate(forces))
    means = np.repeat([w.mean(axis=0) for w in rates], 2, axis=0)  # two rows a turn
    run = _part(seen, rows, found, ranges)
    return Told(run, rows, along("w", means), gyroscopes.components)


def _part(
    seen: Directions, rows: Linear, found: NoiseEstimate, ranges: dict[str, tuple[float, float]]
) -> RunSummary:
    run, stills = seen.run, times_of(seen.run, seen.run.stills)
    return replace(run_summary(rows, found, run.source, ranges), stills=stills, sampling=run.interval)


def _still_forces(seen: Directions) -> dict[str, FloatArray]:
    """Specific force of each block of the stills."""
    index, still = rows_of(seen.run.stills)
    _, interval = lasting_of(seen.run, index)
    return along("f", seen.f[still[block_edges(seen.run.t[index], interval)]])
