"""What no sensor does, and a wrong unit, sign or axis in the study does: found before anything is fitted.

A bias, scale factor and misalignment are fitted to each recorded run. Where one of them is far beyond its
prior, the mistakes that people make are tried one by one; one that explains the output is the cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import permutations, product

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import DataError
from imubayes.inference.prior import weak_sd
from imubayes.inference.stills import means_of
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import FREE_TUMBLE, TRIADS
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import prior_sd
from imubayes.sensors.equations.basic import TERMS
from imubayes.sensors.imu import ACCELEROMETERS, COMPONENTS, GYROSCOPES, axes_of, kind_of
from imubayes.sensors.terms import Kind, library
from imubayes.units import STANDARD_GRAVITY

BEYOND = 50.0
"""Prior sds from which on a bias, a scale factor or a misalignment is no sensor's."""

EXPLAINED = 0.1
"""A cause explains a conflict if it leaves less than this share of it."""

WRONG = 0.5
"""Scale-factor error beyond which a cause is looked for whatever the prior is: without a class it is wide."""

LOOKED_AT = 20_000
"""Rows of a run that are looked at."""

DEGREE = 180.0 / np.pi

MISTAKEN: Mapping[Kind, tuple[tuple[float, str, str], ...]] = {
    "accelerometer": ((1.0 / STANDARD_GRAVITY, "g", "m/s^2"), (STANDARD_GRAVITY, "m/s^2", "g")),
    "gyroscope": ((DEGREE, "deg/s", "rad/s"), (1.0 / DEGREE, "rad/s", "deg/s")),
}
"""Size of an output over what it should be, the unit that it has, and the one that the study says."""

LIKENESS = 0.2
"""Relative difference by which a ratio is that of two units."""

STEP = 0.25
"""s, over which a turn is compared with how the force turns."""

CONVINCING = 0.7
"""Correlation of the force's change with what the gyroscopes say of it, from which they are believed."""

Priors = Mapping[Kind, tuple[SensorClass | None, Mapping[str, float]]]
"""Class, and prior sds of terms that take the place of its own, by kind."""


def refuse_conflicts(run: Run, kind: Kind, priors: Priors) -> None:
    """Refuse a run whose outputs no sensor of the class gives, with the likely mistake, by a `DataError`.

    It is of a component of a kind, of a triad, or of a whole IMU; `priors` are of each kind in it.
    """
    if cause := next(_causes(run, kind, priors), ""):
        raise DataError(
            f"run '{run.name}' ({run.source.file}): {cause}; if the sensor is like that, go on with"
            " accept_prior_conflict = true in its [[sensor]]"
        )


def _causes(run: Run, kind: Kind, priors: Priors) -> Iterator[str]:
    """What is wrong with a run, in words."""
    run = run if run.known else run.stretch
    if run.procedure != FREE_TUMBLE:
        for name, of, y, U in _components(run, kind):
            yield from _cause(y, U, of, name, _sd(*priors[of], of, y, U))
        return
    of: Kind = "accelerometer" if run.force.size else "gyroscope"
    yield from _length(run, of, _sd(*priors[of], of, run.triad(of)[:, 0], np.ones((1, 3))))
    if run.rate.size and run.force.size:
        yield from _turning(run)


def _sd(
    sensor: SensorClass | None, own: Mapping[str, float], kind: Kind, y: FloatArray, U: FloatArray
) -> FloatArray:
    """Prior sds (4,) of bias, scale factor and misalignments."""
    if sensor is None:
        sd = weak_sd(np.array([1.0, *np.abs(U).max(axis=0)]), float(np.abs(y).max()))
    else:
        terms = {term.name: term for term in library(kind, powers=1, asymmetry=0).terms}
        sd = np.array([prior_sd(sensor, terms[name])[0] for name in TERMS])
    return np.array([own.get(name, usual) for name, usual in zip(TERMS, sd.tolist(), strict=True)])


def _components(run: Run, kind: Kind) -> Iterator[tuple[str, Kind, FloatArray, FloatArray]]:
    """Name, kind, output (n,) and inputs (n, 3) along its axes (i, j, k) of each component of a run.

    Of sections at rest the means for the accelerometers, of turns for the gyroscopes.
    """
    for names, turned in ((ACCELEROMETERS, False), (GYROSCOPES, True)) if run.sections else ():
        said = run.triad(kind_of(names[0]))
        sections = [section for section in run.sections if (section.angle != 0.0) == turned and said.size]
        means = [said[section.start : section.stop].mean(axis=0) for section in sections]
        lasting = [(section.stop - section.start) * run.interval for section in sections]
        size = [
            section.angle / s if turned else run.gravity for section, s in zip(sections, lasting, strict=True)
        ]
        along = np.array([s * section.direction for s, section in zip(size, sections, strict=True)]).reshape(
            -1, 3
        )
        for name, y in zip(names, np.transpose(means), strict=False):
            yield name, kind_of(name), y, along[:, list(axes_of(name))]
    if run.sections:
        return
    few = slice(None, None, -(-len(run.t) // LOOKED_AT))
    for name in COMPONENTS if run.of_case else ("output",):
        one, of = (run.component(name), kind_of(name)) if run.of_case else (run, kind)
        channels, letter = one.inputs.channels, "f" if of == "accelerometer" else "w"
        U = [channels.get(f"{letter}_{axis}", np.zeros(len(one.t)))[few] for axis in "ijk"]
        yield name, of, one.output[few], np.column_stack(U)


def _cause(y: FloatArray, U: FloatArray, kind: Kind, name: str, sd: FloatArray) -> Iterator[str]:
    """What explains an output (n,) at inputs (n, 3) that is far beyond the prior sds (4,)."""
    worst = _pull(y, U, sd)
    left = {said: _pull(*as_meant, sd) for said, as_meant in _explanations(y, U, kind, name)}
    said = min(left, key=lambda text: left[text])
    slope = 1.0  # scale factor by least squares, where the own input varies
    if np.ptp(U[:, 0]) > 0.1 * np.abs(U).max():
        slope = float(np.linalg.lstsq(np.column_stack((np.ones(len(y)), U)), y, rcond=1e-12)[0][1])
    if left[said] < EXPLAINED * worst and (worst > BEYOND or abs(slope - 1.0) > WRONG):
        yield said
    elif worst > BEYOND:
        missing = "" if U.any() else ", or the file lacks its input"
        yield (
            f"{name} is {worst:.3g} prior sds from what its inputs make of a sensor of this class: expected"
            f" less than {BEYOND:g}; its unit, scale or axis is wrong{missing}, or the class is"
        )


def _pull(y: FloatArray, U: FloatArray, sd: FloatArray) -> float:
    """Largest of bias, scale factor and misalignments, in prior sds, at the noise of the best fit."""
    Z, r = np.column_stack((np.ones(len(y)), U)) * sd, y - U[:, 0]
    best = Z @ np.linalg.lstsq(Z, r, rcond=1e-12)[0]
    noise = float(np.sqrt(np.mean((r - best) ** 2))) + 1e-9 * float(np.abs(y).max())
    stacked = np.vstack((Z / noise, np.eye(4)))
    return float(np.abs(np.linalg.lstsq(stacked, np.append(r / noise, np.zeros(4)), rcond=None)[0]).max())


def _explanations(
    y: FloatArray, U: FloatArray, kind: Kind, name: str
) -> Iterator[tuple[str, tuple[FloatArray, FloatArray]]]:
    """Mistakes, each with output and inputs as they were meant."""
    usual, letter = float(np.linalg.norm(U, axis=1).max()), "f" if kind == "accelerometer" else "w"
    for size, has, told in MISTAKEN[kind]:
        # at 1 g the size of the force tells whose unit is wrong
        if kind == "accelerometer" and abs(usual * size / STANDARD_GRAVITY - 1.0) < LIKENESS:
            yield f'inputs {letter} look like {told} under {has}: expected unit = "{told}"', (y, U * size)
        else:
            yield f'{name} looks like {has} under {told}: expected unit = "{has}"', (y / size, U)
    yield f"{name} has the opposite sign of its input: expected a positive scale, at rest +1 g up", (-y, U)
    i, *others = "ijk" if name == "output" else ("xyz"[k] for k in axes_of(name))
    for (axis, other), sign in product(enumerate(others, start=1), (1.0, -1.0)):
        if U[:, axis].any():
            swapped = U.copy()
            swapped[:, 0], swapped[:, axis] = sign * U[:, axis], U[:, 0]
            follows = f"{name} follows {'-' if sign < 0.0 else ''}{letter}_{other} and not {letter}_{i}"
            yield f"{follows}: axes are swapped, expected other columns", (y, swapped)


def _length(run: Run, kind: Kind, sd: FloatArray) -> Iterator[str]:
    """What is wrong with the size of the force in the hand, most of which is gravity, or of the rate."""
    said, known, letters = run.triad(kind), run.gravity, " ".join(TRIADS[kind])
    if run.sections:
        fastest = max(run.sections, key=lambda section: abs(section.rate))
        said, known = said[fastest.start : fastest.stop], abs(fastest.rate)
    ratio = float(np.median(np.linalg.norm(said, axis=1))) / known
    for size, has, told in MISTAKEN[kind]:
        if abs(ratio / size - 1.0) < LIKENESS:
            yield f'{letters} look like {has} under {told}: expected unit = "{has}"'
    if abs(ratio - 1.0) > max(BEYOND * (sd[1] + sd[0] / known), LIKENESS):
        seen = f"the rate is {ratio:.3g} times that of the table where it is fastest"
        if kind == "accelerometer":
            seen = f"the force is {ratio:.3g} g most of the time, and is 1 g at rest"
        yield f"{seen}: expected another scale, offset or unit of {letters}"


def _turning(run: Run) -> Iterator[str]:
    """How the gyroscopes of an IMU in the hand lie and count, by the way in which gravity turns in the case.

    At rest in space ``df/dt = f x w``; with the outputs w' and ``w = M w'`` this is linear in M.
    """
    width = max(1, round(STEP / run.interval))
    steps = tuple((a, a + width) for a in range(0, len(run.t) - 2 * width, width))
    rate = run.rate - np.median(run.rate, axis=0)
    f, w = means_of(run, run.force, steps), means_of(run, rate, steps)
    if len(steps) < 10 or not run.gravity:
        return
    # from the middle of a step to that of the next the case turns by half of both
    mean_f, mean_w = 0.5 * (f[1:] + f[:-1]), 0.5 * (w[1:] + w[:-1])
    change = np.diff(f, axis=0) / (width * run.interval)
    turns = np.stack([np.cross(mean_f, axis) for axis in np.eye(3)], axis=2)
    X = np.einsum("nca,nb->ncab", turns, mean_w).reshape(-1, 9)
    M, *_ = np.linalg.lstsq(X, change.ravel(), rcond=1e-9)
    told = X @ M
    if float(np.corrcoef(told, change.ravel())[0, 1]) < CONVINCING:
        return
    yield from _said_of(M.reshape(3, 3))


def _said_of(M: FloatArray) -> Iterator[str]:
    """What is wrong where outputs w' of gyroscopes mean the rates ``M w'``."""
    size = 1.0 / float(np.cbrt(abs(np.linalg.det(M))))
    for ratio, has, told in MISTAKEN["gyroscope"]:
        if abs(size / ratio - 1.0) < 2.0 * LIKENESS:
            yield f'gx gy gz look like {has} under {told}: expected unit = "{has}"'
    every = product(permutations(range(3)), product((1, -1), repeat=3))
    signed = [np.diag(signs)[list(order)] for order, signs in every]
    nearest = max(signed, key=lambda axes: float(np.sum(axes * M)))
    if not np.array_equal(nearest, np.eye(3)):
        means = [f"{'-' if row.min() < 0 else ''}g{'xyz'[int(np.argmax(np.abs(row)))]}" for row in nearest]
        yield (
            f"as the force turns, the rates about x y z are {', '.join(means)} and not gx, gy, gz: axes or"
            " signs of gyroscopes and accelerometers differ; expected the same right-handed axes of both, and"
            " +1 g up at rest"
        )
    if abs(size - 1.0) > WRONG:
        yield f"gx gy gz are {size:.3g} times the rate at which the force turns: expected another scale"
