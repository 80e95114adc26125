"""The model's terms as expressions of a programming language."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from imubayes.sensors.imu import CASE_CHANNELS, COMPONENTS, Component, Imu, case_channel
from imubayes.sensors.terms import Factor, Term


@dataclass(frozen=True, slots=True)
class Line:
    """One term of a component as text.

    Attributes
    ----------
    name, unit : of the term; SI.
    value : its coefficient.
    product : coefficient times regressor.
    """

    name: str
    unit: str
    value: str
    product: str


@dataclass(frozen=True, slots=True)
class Language:
    """How a language writes a product.

    Attributes
    ----------
    number : a coefficient.
    channel : an input, by its number from zero in `imubayes.sensors.imu.CASE_CHANNELS`.
    sign : of an expression.
    times : between factors.
    """

    number: Callable[[float], str]
    channel: Callable[[int], str]
    sign: Callable[[str], str]
    times: str = " * "


def lines(imu: Imu, language: Language) -> dict[str, tuple[Line, ...]]:
    """Terms of each component, ``ax`` to ``gz``."""
    named = zip(COMPONENTS, imu.components, strict=True)
    return {name: _component(name, component, language) for name, component in named}


def regressor(name: str, term: Term) -> str:
    """Regressor of a component's term along the case axes, for people.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer")
    >>> [regressor("ay", lib.terms[k]) for k in (0, 3, 5, 9)]
    ['1', 'f_y^3', 'sgn(f_y) f_y', 'f_y f_z']
    """
    return " ".join(_readable(case_channel(name, factor.channel), factor) for factor in term.factors) or "1"


def _component(name: str, component: Component, language: Language) -> tuple[Line, ...]:
    pairs = zip(component.library.terms, component.theta, strict=True)
    return tuple(
        Line(term.name, term.unit, language.number(theta), _product(name, term, float(theta), language))
        for term, theta in pairs
    )


def _product(name: str, term: Term, theta: float, language: Language) -> str:
    factors = [language.number(theta)]
    for factor in term.factors:
        x = language.channel(CASE_CHANNELS.index(case_channel(name, factor.channel)))
        factors += [x] * factor.power + ([language.sign(x)] if factor.signed else [])
    return language.times.join(factors)


def _readable(channel: str, factor: Factor) -> str:
    channel = "(T - T0)" if channel == "T" else "dT/dt" if channel == "dT" else channel
    power = "" if factor.power == 0 else channel if factor.power == 1 else f"{channel}^{factor.power}"
    return " ".join(part for part in (f"sgn({channel})" if factor.signed else "", power) if part)
