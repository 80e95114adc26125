"""What is wrong with a test, of which its analysis knows nothing, by treatment.

Each fault acts where it does in a laboratory: the bench on all inputs, a shaker and a dead band on the input
along the sensor's own axis, a power in its response, then the noise, the warm-up, and last the ends and the
steps of the output::

    output = steps(ends(warm-up(response(dead band(shaker(bench(inputs)))) + noise)))

Sizes are in standard deviations of one sample's white noise where nothing else is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.rig.bench import KINDS, errors_of
from imubayes.rig.plans import Plan

MOUNTED, RADIUS, POWER = "mounts rotated", "arm's radius off", "a power missing"
BAND, SHAKEN, WARM = "dead band", "shaker line", "warm-up drift"
TAILS, LEVEL = "heavy tails", "noise by level"
CLIPPED, COARSE = "clipped peaks", "coarse steps"

LARGE = 10.0
"""Noise sds of what a fault adds where it is largest: two digits of a dwell's mean are wrong."""

SMALL_INPUT = 1.0 / 30.0
"""Share of the largest input at which a dead band has lost so much; the least that a rate table turns at."""

ARCSECONDS = math.radians(20.0 / 3600.0)
"""rad: sd of the rotation of each mount about each axis."""

RADII = 5.0
"""Typical errors of an arm's radius, by the catalogue, that it is off."""

WARMING = 900.0
"""s in which the drift after each turn-on falls by e."""

LINE = 0.137
"""Hz of the shaker's line, or what it is aliased to."""

FREEDOM = 3.0
"""Degrees of freedom of Student's t: the fourth moment is infinite."""

STEP = 8.0
"""Noise sds of a step of the output."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """What passes through the chain of a sensor in a run: values (n,) at this place and times t (n,), s.

    `x` (n,) is the input along the sensor's own axis, as the rig says, `largest` its largest size over all
    runs, and `top` that of the sensor's response; `sigma` is the sd of a sample's white noise.
    """

    values: FloatArray
    t: FloatArray
    x: FloatArray
    sigma: float
    largest: float
    top: float


Fault = Callable[[Signal, np.random.Generator], FloatArray]


def applies(plans: Sequence[Plan], treatment: str) -> bool:
    """Whether a treatment changes anything of a test."""
    return treatment != RADIUS or any(plan.procedure == "centrifuge" for plan in plans)


def bench_errors(plans: Sequence[Plan], treatment: str, rng: np.random.Generator) -> dict[str, float]:
    """Errors of the bench under a treatment of a test, SI by name."""
    if treatment == MOUNTED:
        return {error.name: rng.normal(0.0, ARCSECONDS) for error in errors_of(plans, ["fixture"])}
    if treatment == RADIUS:
        size = RADII * (KINDS["radius"].default or 0.0) * rng.choice([-1.0, 1.0])
        return {error.name: size for error in errors_of(plans, ["radius"])}
    return {}


def _band(s: Signal, rng: np.random.Generator) -> FloatArray:
    """Nothing inside a band about zero, and sqrt(x^2 - d^2) beyond, as where two beams lock.

    A band that is taken off beyond its ends, x - d sgn(x), would be the library's b0'. At an input
    of `SMALL_INPUT` `LARGE` is lost.
    """
    small, lost = SMALL_INPUT * s.largest, LARGE * s.sigma
    width = math.sqrt(lost * (2.0 * small - lost)) if lost < small else small
    return np.sign(s.values) * np.sqrt(np.clip(s.values**2 - width**2, 0.0, None))


def _shaken(s: Signal, rng: np.random.Generator) -> FloatArray:
    return s.values + LARGE * s.sigma * np.sin(2.0 * math.pi * (LINE * s.t + rng.random()))


def _tails(s: Signal, rng: np.random.Generator) -> FloatArray:
    """White noise by Student's t."""
    return s.values * np.sqrt(FREEDOM / rng.chisquare(FREEDOM, len(s.values)))


def _by_level(s: Signal, rng: np.random.Generator) -> FloatArray:
    """White noise that is `LARGE` times as large at the largest input as at zero."""
    return s.values * (1.0 + (LARGE - 1.0) * np.abs(s.x) / s.largest)


def _warm(s: Signal, rng: np.random.Generator) -> FloatArray:
    return s.values + rng.choice([-1.0, 1.0]) * LARGE * s.sigma * np.exp(-(s.t - s.t[0]) / WARMING)


def _clipped(s: Signal, rng: np.random.Generator) -> FloatArray:
    end = s.top - LARGE * s.sigma
    return np.clip(s.values, -end, end)


def _coarse(s: Signal, rng: np.random.Generator) -> FloatArray:
    return STEP * s.sigma * np.round(s.values / (STEP * s.sigma))


INPUT: Mapping[str, Fault] = {SHAKEN: _shaken, BAND: _band}
"""What happens to the input along the sensor's own axis."""

NOISE: Mapping[str, Fault] = {TAILS: _tails, LEVEL: _by_level}
"""What happens to the white noise."""

OUTPUT: Mapping[str, Fault] = {WARM: _warm, CLIPPED: _clipped, COARSE: _coarse}
"""What happens to the sum of both."""

FAULTS = {
    MOUNTED: "the case is turned in each mount by 20 arcsec about each axis, sd, and nobody allowed for it",
    RADIUS: f"the arm of the centrifuge is off by {RADII:g} times the catalogue's typical error",
    POWER: "a fourth power that the library lacks, of the class's typical size or "
    f"{LARGE:g} noise sds of a sample at the largest input",
    BAND: "nothing comes out of an input in a band about zero, and sqrt(x² − d²) beyond; at a thirtieth "
    f"of the largest input {LARGE:g} noise sds are lost",
    WARM: f"{LARGE:g} noise sds after each turn-on, which fall by e in {WARMING / 60.0:g} min",
    TAILS: f"Student's t with {FREEDOM:g} degrees of freedom in place of normal noise",
    COARSE: f"steps of the output of {STEP:g} noise sds",
    SHAKEN: f"a line of {LARGE:g} noise sds at {LINE:g} Hz in the input",
    LEVEL: f"the noise at the largest input is {LARGE:g} times that at zero",
    CLIPPED: f"the range ends {LARGE:g} noise sds below the largest output; what is saturated is left out, as"
    " where a file is read",
}
"""What is wrong under each treatment, in words."""
