"""The generalized component model, term by term.

Output minus input of one component is linear in its coefficients::

    y = sum_k theta_k phi_k(f, w, dw/dt, T)

Each regressor ``phi`` is a product of powers of input channels, with a sign where the term is an
asymmetry, so a term is data: a name, its factors, its unit. Axes are (i, j, k) = (input, pendulous or
spin, output), right-handed. Coefficients are *errors*: ``b1`` is the scale-factor error, and the
``cos(alpha)`` of the direction vector is part of it (only their sum is estimable).

Source: Olson, Bingham, Walker, "A Generalized IMU Modeling Framework for Varying Inertial Sensing
Technologies and Performance Grades", JNC 2023.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Annotated, Literal

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import TermError
from imubayes.units import Key

Kind = Literal["accelerometer", "gyroscope"]

AXES = "ijk"
CHANNELS = (*(f"{quantity}_{axis}" for quantity in ("f", "w", "dw") for axis in AXES), "T", "dT", "gT")
"""Input channels: specific force, rate, angular acceleration, temperature, its rate, and what a second
thermometer reads above the first, in SI."""

QUANTITY: Mapping[str, str] = {"accelerometer": "f", "gyroscope": "w"}
"""What each kind measures, as the first part of its channels' names."""

OUTPUT_UNIT: Mapping[Kind, str] = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
CHANNEL_UNITS = {"f": "m/s^2", "w": "rad/s", "dw": "rad/s^2", "T": "K", "dT": "K/s", "gT": "K"}
REFERENCE_TEMPERATURE = 298.15
"""T0 of the temperature expansion: 25 degC in kelvin."""

HIGHEST_POWER = 12


@dataclass(frozen=True, slots=True)
class InputPower:
    """One factor of a regressor: ``channel ** power``, times ``sign(channel)`` if `signed`."""

    channel: str
    power: int
    signed: bool = False


@dataclass(frozen=True, slots=True)
class Term:
    """One term of the model equation.

    Attributes
    ----------
    name : as in the slides, in ASCII (``b2p``, ``c_ij``, ``S_jk``, ``b0*T``).
    factors : the regressor as a product; empty for the bias.
    unit : SI unit of the coefficient.
    printed : the unit that people use.
    group : the part of the model equation it belongs to.
    """

    name: str
    factors: tuple[InputPower, ...]
    unit: str
    printed: str
    group: str

    @property
    def linear(self) -> bool:
        """Whether the regressor is one input as it is."""
        return [(factor.power, factor.signed) for factor in self.factors] == [(1, False)]


@dataclass(frozen=True, slots=True)
class Library:
    """The candidate terms of one component.

    Attributes
    ----------
    kind : accelerometer or gyroscope.
    terms : in the order of the model equation.
    technology : of the sensor, in words; it decides the standard whose symbols the terms are shown with (see
        `imubayes.sensors.equations.symbols`).
    ties : (term, leader) names of two coefficients that are one by nature (`catalogue.coupled`). The leader's
        column is then the sum of both, and the other's zero: as a factor and a prior see them, the leader
        carries both.
    """

    kind: Kind
    terms: tuple[Term, ...]
    technology: str = ""
    ties: tuple[tuple[str, str], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term.name for term in self.terms)

    @property
    def carriers(self) -> tuple[str, ...]:
        """Names of the terms whose columns carry each coefficient: its own, or that of its leader."""
        names = self.names
        leader = {name: leader for name, leader in self.ties if leader in names}
        return tuple(leader.get(name, name) for name in names)

    @property
    def tied(self) -> tuple[tuple[str, str], ...]:
        """Ties of which both terms are there."""
        pairs = zip(self.names, self.carriers, strict=True)
        return tuple((name, leader) for name, leader in pairs if name != leader)

    def on(self, channel: str) -> tuple[str, ...]:
        """Names of the terms that an input takes part in."""
        return tuple(t.name for t in self.terms if any(f.channel == channel for f in t.factors))

    @property
    def own(self) -> str:
        """Channel of the component's own input: ``f_i`` or ``w_i``."""
        return f"{QUANTITY[self.kind]}_i"


def library(
    kind: Kind,
    *,
    powers: Annotated[int, Key("highest power of the own input, 1 to 12", 4)] = 3,
    asymmetry: Annotated[
        int, Key("highest power that also comes times the sign of the input, up to 12; -1 for none", -1)
    ] = 2,
    set: Annotated[
        Literal["slide", "extended"],
        Key(
            "`extended` adds `S_ii S_jj S_kk` and, for a gyroscope, `g_i g_j g_k` and `s_i s_j s_k`",
            "extended",
        ),
    ] = "slide",
    temperature: Annotated[
        int,
        Key(
            "highest power of T - 25 degC that multiplies the terms of `temperature_of`, up to 12; 0 for no"
            " term of temperature",
            2,
        ),
    ] = 0,
    temperature_of: Annotated[
        tuple[str, ...], Key("terms that may depend on temperature", ["b0", "b1", "m_j"])
    ] = ("b0", "b1"),
    rate_of: Annotated[
        tuple[str, ...],
        Key(
            "terms that may depend on the rate of temperature (`b0*dT`), where `temperature` is 1 or more",
            ["b0", "b1"],
        ),
    ] = ("b0",),
    gradient_of: Annotated[
        tuple[str, ...],
        Key(
            "terms that may depend on what a second thermometer `T_2` reads above the first (`b0*gT`), where"
            " `temperature` is 1 or more",
            ["b0", "b1"],
        ),
    ] = (),
    technology: str = "",
) -> Library:
    """Candidate terms of an accelerometer or a gyroscope.

    ``slide`` is exactly the slides' equation, with powers up to N_a, and up to N_a' with the sign of the
    input. `technology` is that of the sensor's class, in words.

    Raises
    ------
    TermError : if an order is out of range, or a name in `temperature_of`, `rate_of` or `gradient_of` is no
        term.

    Examples
    --------
    >>> library("gyroscope", powers=2, asymmetry=0).names
    ('b0', 'b1', 'b2', 'b0p', 'm_j', 'm_k', 'c_ij', 'c_ik', 'c_jj', 'c_jk', 'c_kk', 'S_ij', 'S_ik', 'S_jk')
    """
    if kind not in _OPPOSITE_UNITS:
        raise TermError(f"kind '{kind}' is not known: expected accelerometer or gyroscope")
    if set not in ("slide", "extended"):
        raise TermError(f"set '{set}' is not known: expected slide or extended")
    limits = (("powers", powers, 1), ("asymmetry", asymmetry, -1), ("temperature", temperature, 0))
    for name, value, low in limits:
        if not low <= value <= HIGHEST_POWER:
            raise TermError(f"{name} = {value} is out of range: expected {low} to {HIGHEST_POWER}")
    terms = [*_equation(kind, powers, asymmetry, set == "extended")]
    by_name = {term.name: term for term in terms}
    if temperature:
        asked = {"temperature_of": temperature_of, "rate_of": rate_of, "gradient_of": gradient_of}
        for option, names in asked.items():
            if strange := [name for name in names if name not in by_name]:
                raise TermError(
                    f"{option} names '{strange[0]}', which is not a term of this library: "
                    f"expected some of {', '.join(by_name)}"
                )
            if twice := [name for k, name in enumerate(names) if name in names[:k]]:
                raise TermError(f"{option} names '{twice[0]}' twice: expected each term once")
        orders = range(1, temperature + 1)
        terms += [_by(by_name[name], "T", q) for name in temperature_of for q in orders]
        terms += [_by(by_name[name], "dT") for name in rate_of]
        terms += [_by(by_name[name], "gT") for name in gradient_of]
    return Library(kind, tuple(terms), technology)


def columns(
    lib: Library,
    channels: Mapping[str, FloatArray],
    n: int,
    out: FloatArray | None = None,
    *,
    said: Mapping[str, FloatArray] | None = None,
) -> FloatArray:
    """Regressors (n, p) of every term at known inputs, SI; of tied terms in the leader's column (see `tied`).

    Parameters
    ----------
    channels : SI arrays of length `n` by channel name; an absent channel is zero (not excited).
    out : array (n, p) to fill, for callers that own the memory.
    said : what the rig says of the inputs, where its errors moved them (see `held_sign`).

    Examples
    --------
    >>> lib = library("gyroscope", powers=1, asymmetry=0)
    >>> columns(lib, {"w_i": np.array([-2.0, 0.0])}, 2)[:, :3].tolist()
    [[1.0, -2.0, -1.0], [1.0, 0.0, 0.0]]
    """
    X = np.empty((n, len(lib.terms))) if out is None else out
    for j, term in enumerate(lib.terms):
        X[:, j] = column(term, channels)
        if said is not None:
            X[:, j] *= held_sign(term, said, channels)
    return tied(lib, X)


def tied(lib: Library, X: FloatArray) -> FloatArray:
    """Add the columns (..., p) of terms that are tied to others to those of their leaders, in place.

    Examples
    --------
    >>> lib = Library("accelerometer", library("accelerometer").terms[:2], ties=(("b1", "b0"),))
    >>> tied(lib, np.array([[1.0, 5.0]])).tolist()
    [[6.0, 0.0]]
    """
    for name, leader in lib.tied if lib.ties else ():
        j, k = lib.names.index(name), lib.names.index(leader)
        X[..., k] += X[..., j]
        X[..., j] = 0.0
    return X


def column(term: Term, channels: Mapping[str, FloatArray]) -> FloatArray | float:
    """One term's regressor; a scalar where it does not depend on the inputs given."""
    if any(factor.channel not in channels for factor in term.factors):
        return 0.0
    powers = (power_of(channels[factor.channel], factor) for factor in term.factors)
    return reduce(operator.mul, powers) if term.factors else 1.0


def held_sign(
    term: Term, said: Mapping[str, FloatArray], seen: Mapping[str, FloatArray]
) -> FloatArray | float:
    """Factor that gives a term at inputs `seen` the signs of those that the rig says.

    Where the rig says zero an error of the bench is far below the noise of a sample, which takes the
    sensor to and fro over the jump of an asymmetry: on average it stays in the middle.
    """
    signed = [f.channel for f in term.factors if f.signed and f.channel in seen]
    return math.prod((np.sign(said.get(name, 0.0)) * np.sign(seen[name]) for name in signed), start=1.0)


def power_of(values: FloatArray, factor: InputPower) -> FloatArray:
    """One factor of a regressor, from the values (n,) of its input."""
    if factor.channel == "T":
        values = values - REFERENCE_TEMPERATURE
    if factor.power == 0:
        return np.sign(values) if factor.signed else np.ones_like(values)
    value = np.abs(values) if factor.signed else values
    for _ in range(factor.power - 1):
        value = value * values
    return value


def _equation(kind: Kind, powers: int, asymmetry: int, extended: bool) -> Iterator[Term]:
    """Terms of the model equation, in its order."""
    own, other = ("f", "w") if kind == "accelerometer" else ("w", "f")
    for n in range(powers + 1):
        yield Term(f"b{n}", (InputPower(f"{own}_i", n),) if n else (), *_own_units(kind, n), "bias and scale")
    for n in range(asymmetry + 1):
        yield Term(f"b{n}p", (InputPower(f"{own}_i", n, signed=True),), *_own_units(kind, n), "asymmetry")
    for axis in "jk":
        yield Term(f"m_{axis}", (InputPower(f"{own}_{axis}", 1),), "rad", "urad", "misalignment")
    for pair in ("ij", "ik", "jj", "jk", "kk"):
        yield Term(f"c_{pair}", _product(own, pair), *_own_units(kind, 2), "cross terms")
    units, group = _OPPOSITE_UNITS[kind], "opposite phenomenon"
    if kind == "gyroscope" and extended:
        for axis in AXES:
            yield Term(f"g_{axis}", (InputPower(f"f_{axis}", 1),), *units["g"], group)
    for pair in ("ij", "ik", "jk", *(("ii", "jj", "kk") if extended else ())):
        yield Term(f"S_{pair}", _product(other, pair), *units["S"], group)
    if kind == "accelerometer" or extended:
        for axis in AXES:
            yield Term(f"s_{axis}", (InputPower(f"dw_{axis}", 1),), *units["s"], group)


def _product(quantity: str, pair: str) -> tuple[InputPower, ...]:
    if pair[0] == pair[1]:
        return (InputPower(f"{quantity}_{pair[0]}", 2),)
    return tuple(InputPower(f"{quantity}_{axis}", 1) for axis in pair)


def _by(term: Term, channel: str, q: int = 1) -> Term:
    """Term times a power of what is known of the temperature."""
    power, raised = ("", "") if q == 1 else (str(q), f"^{q}")
    unit, printed = (
        f"1/{by}{raised}" if unit == "1" else f"{unit}/{by}{raised}"
        for unit, by in zip((term.unit, term.printed), _HEAT_UNITS[channel], strict=True)
    )
    factors = (*term.factors, InputPower(channel, q))
    return Term(f"{term.name}*{channel}{power}", factors, unit, printed, "temperature")


_HEAT_UNITS = {"T": ("K", "degC"), "dT": ("(K/s)", "(degC/min)"), "gT": ("K", "degC")}


def _own_units(kind: Kind, n: int) -> tuple[str, str]:
    """SI unit ``(unit)^(1-n)`` and printed unit of the coefficient of the n-th power of the own input."""
    base = OUTPUT_UNIT[kind]
    si = base if n == 0 else "1" if n == 1 else f"({base})^{1 - n}"
    if kind == "accelerometer":
        printed = ("ug", "ppm")[n] if n < 2 else f"ug/g^{n}"
    else:
        printed = ("deg/h", "ppm", "ppm/(deg/s)")[n] if n < 3 else f"ppm/(deg/s)^{n - 1}"
    return si, printed


_OPPOSITE_UNITS = {
    "accelerometer": {"S": ("m/s^2/(rad/s)^2", "ug/(rad/s)^2"), "s": ("m/s^2/(rad/s^2)", "ug/(rad/s^2)")},
    "gyroscope": {
        "g": ("rad/s/(m/s^2)", "deg/h/g"),
        "S": ("rad/s/(m/s^2)^2", "deg/h/g^2"),
        "s": ("rad/s/(rad/s^2)", "deg/h/(deg/s^2)"),
    },
}
