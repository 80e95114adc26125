"""Where an IMU's model can be inverted: a bound on its slopes over a range of inputs.

With ``F(x) = x + D(x)`` the outputs at f and w together, ``Lambda[c, d]`` bounds ``|dD_c / dx_d|`` over a box
of inputs, a sum of absolute values over the terms. If the spectral radius of Lambda is below one, a weighted
maximum norm exists (Perron) in which D is a contraction; clipping to the box is not expansive in it. So the
iteration ``x <- y - D(clip(x))`` converges from anywhere to one point. If that lies in the box, it is the
only input in the box with that output; if it does not, no input in the box has that output.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.sensors.imu import CASE_CHANNELS, COMPONENTS, Imu, case_channel
from imubayes.sensors.terms import REFERENCE_TEMPERATURE, Term

Triple = tuple[float, float, float]

MOST_ROUNDS = 10_000
"""Fixed-point steps; a contraction that needs more is as good as none."""

SETTLED = 1e-17
"""Error of the compensation over the range, after its last step."""

UNLIMITED = 1e30
"""Size of an input on which no term depends: its range needs no test."""

TEMPERATURES = (1.0, 1000.0)
"""K; range of temperature where no term depends on it."""

HALVINGS = 40
"""Steps of the search for the largest range that can be inverted."""


@dataclass(frozen=True, slots=True)
class InputRange:
    """A box of inputs along the case axes, SI.

    Attributes
    ----------
    f, w, dw : largest size along x, y, z.
    T : lowest and highest temperature, K.
    warming : largest rate of temperature, K/s.
    """

    f: Triple
    w: Triple
    dw: Triple
    T: tuple[float, float]
    warming: float

    @property
    def ends(self) -> FloatArray:
        """(11,) largest size of each of `imubayes.sensors.imu.CASE_CHANNELS`, of T that of T - T0."""
        heat = max(abs(end - REFERENCE_TEMPERATURE) for end in self.T)
        return np.array([*self.f, *self.w, *self.dw, heat, self.warming])


def input_range(
    f: float | Sequence[float],
    w: float | Sequence[float],
    *,
    dw: float | Sequence[float] = 0.0,
    T: tuple[float, float] = (REFERENCE_TEMPERATURE, REFERENCE_TEMPERATURE),
    warming: float = 0.0,
) -> InputRange:
    """Box of inputs; one number stands for all three axes.

    It is an `InputError` if a size is negative or not finite, there are not three, or T is not (low, high).

    Examples
    --------
    >>> input_range(20.0, [1.0, 1.0, 5.0]).f
    (20.0, 20.0, 20.0)
    """
    sizes = [_triple(name, size) for name, size in (("f", f), ("w", w), ("dw", dw))]
    if not (len(T) == 2 and 0.0 < T[0] <= T[1] < math.inf and 0.0 <= warming < math.inf):
        raise InputError(
            f"range of T = {T}, warming = {warming}: expected (low, high) in kelvin, and a rate from zero up"
        )
    return InputRange(sizes[0], sizes[1], sizes[2], (float(T[0]), float(T[1])), float(warming))


def slopes(imu: Imu, within: InputRange) -> FloatArray:
    """Bounds (6, 6) of the slopes of each component's deviation in f and w along the case axes.

    Examples
    --------
    >>> from imubayes.sensors.imu import Component, imu_of
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", powers=2, asymmetry=-1)
    >>> ax = Component(lib, np.eye(len(lib.terms))[lib.names.index("b2")] * 1e-4)
    >>> float(slopes(imu_of({"ax": ax}), input_range(100.0, 1.0))[0, 0])
    0.02
    """
    return np.array([_row(imu, c, within.ends) for c in range(6)])


def contraction(imu: Imu, within: InputRange) -> float:
    """Spectral radius of the slopes' bounds: the compensation is proved where it is below one."""
    return float(np.max(np.abs(np.linalg.eigvals(slopes(imu, within)))))


def rounds(imu: Imu, within: InputRange) -> int:
    """Steps that bring the compensation to rounding from anywhere in the range.

    The error of step k is at most ``Lambda^k`` times the first one, component by component. An `InputError`
    names the worst component, its steepest terms, and how much of the range can be inverted, where the model
    cannot be shown to be invertible.

    Examples
    --------
    >>> from imubayes.sensors.imu import imu_of
    >>> rounds(imu_of({}), input_range(20.0, 1.0))
    2
    """
    bound = slopes(imu, within)
    error = 2.0 * within.ends[:6]
    # an input that no term depends on may be of any size; what its sensor is off by then counts
    sizes = np.where(bound.any(axis=0), error, bound @ error)
    target = SETTLED * np.repeat([sizes[:3].max(), sizes[3:].max()], 3)
    for step in range(MOST_ROUNDS if contraction(imu, within) < 1.0 else 0):
        if (error <= target).all():
            return step + 1
        error = bound @ error
    worst = int(np.argmax(slopes(imu, within).sum(axis=1)))
    component = imu.components[worst]
    sizes = [
        abs(theta)
        * sum(slope for column, slope in _term_slopes(COMPONENTS[worst], term, within.ends) if column < 6)
        for term, theta in zip(component.library.terms, component.theta, strict=True)
    ]
    steepest = [component.library.names[k] for k in np.argsort(sizes)[::-1][:3]]
    low, high = 0.0, 1.0  # scale of the range up to which the slopes are a contraction
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if contraction(imu, scaled(within, middle)) < 1.0 else (low, middle)
    raise InputError(
        f"{COMPONENTS[worst]}: the model cannot be shown to be invertible for {described(within)}: its slopes"
        f" come to {contraction(imu, within):.3g} of the input's, expected below 1; the steepest terms are"
        f" {', '.join(steepest)}. {low:.2g} of that range can be inverted:"
        " state a smaller one, or drop terms"
    )


def described(within: InputRange) -> str:
    """Range in words.

    Examples
    --------
    >>> described(input_range(20.0, [1.0, 1.0, 5.0]))
    '|f| up to 20 m/s^2, |w| up to (1, 1, 5) rad/s, |dw| up to 0 rad/s^2, T from 298.15 to 298.15 K'
    >>> described(input_range([9.8, UNLIMITED, UNLIMITED], UNLIMITED))
    '|f| up to (9.8, any, any) m/s^2, |w| of any size, |dw| up to 0 rad/s^2, T from 298.15 to 298.15 K'
    """
    own = (("f", within.f, "m/s^2"), ("w", within.w, "rad/s"), ("dw", within.dw, "rad/s^2"))
    text, (low, high) = ", ".join(f"|{name}| {_sizes(size, unit)}" for name, size, unit in own), within.T
    heat = "" if within.T == TEMPERATURES else f", T from {low:g} to {high:g} K"
    warming = f", |dT/dt| up to {within.warming:g} K/s" if 0.0 < within.warming < UNLIMITED else ""
    return f"{text}{heat}{warming}"


def _row(imu: Imu, c: int, ends: FloatArray) -> FloatArray:
    if c >= 3 or not imu.levers[c].any():
        return _gradient(imu, c, ends)[:6]
    # bounds of the size effect (3,) of the lever arm, and of its slopes (3, 3) in w
    r, w, dw = np.abs(imu.levers[c]), ends[3:6], ends[6:9]
    others = np.sum(w * r) - w * r
    arm = w * others + r * (np.sum(w * w) - w * w) + np.sum(np.outer(dw, r)) - dw @ r
    turn = np.outer(w, r) + 2.0 * np.outer(r, w)
    np.fill_diagonal(turn, others)
    there = ends.copy()
    there[:3] += arm
    slope = _gradient(imu, c, there)[:6]
    slope[3:] += (np.eye(3)[c] + slope[:3]) @ turn
    return slope


def _gradient(imu: Imu, c: int, ends: FloatArray) -> FloatArray:
    """Bounds (11,) of the slopes of ``X theta`` of a component in each of the case's inputs."""
    bound = np.zeros(len(CASE_CHANNELS))
    component = imu.components[c]
    for term, theta in zip(component.library.terms, component.theta, strict=True):
        for column, slope in _term_slopes(COMPONENTS[c], term, ends):
            bound[column] += abs(theta) * slope
    return bound


def _term_slopes(name: str, term: Term, ends: FloatArray) -> Iterator[tuple[int, float]]:
    columns = [CASE_CHANNELS.index(case_channel(name, factor.channel)) for factor in term.factors]
    sizes = [ends[column] ** factor.power for column, factor in zip(columns, term.factors, strict=True)]
    for q, (column, factor) in enumerate(zip(columns, term.factors, strict=True)):
        if factor.power:
            rest = math.prod(sizes[:q] + sizes[q + 1 :])
            yield column, factor.power * ends[column] ** (factor.power - 1) * rest


def scaled(within: InputRange, share: float) -> InputRange:
    """Range with f, w and dw times `share`; its temperatures stay."""
    f, w, dw = (_triple("range", [share * end for end in size]) for size in (within.f, within.w, within.dw))
    return InputRange(f, w, dw, within.T, within.warming)


def _triple(name: str, size: float | Sequence[float]) -> Triple:
    values = (
        np.broadcast_to(np.asarray(size, dtype=float), (3,))
        if np.size(size) in (1, 3)
        else np.array([np.nan])
    )
    if not (np.isfinite(values) & (values >= 0.0)).all():
        raise InputError(f"range of {name} = {size}: expected a size from zero up, or three along x, y, z")
    return float(values[0]), float(values[1]), float(values[2])


def _sizes(size: Triple, unit: str) -> str:
    ends = ["any" if end >= UNLIMITED else f"{end:g}" for end in size]
    if len({*ends}) > 1:
        return f"up to ({', '.join(ends)}) {unit}"
    return "of any size" if ends[0] == "any" else f"up to {ends[0]} {unit}"
