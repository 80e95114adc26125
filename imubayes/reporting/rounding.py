"""Rounding as people print: two digits of the sd, the value to match, the unit they use."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from imubayes.sensors.terms import Kind
from imubayes.units import factor

FIXED_DIGITS = 5
"""Decimals, and digits of the sd before the point, beyond which a power of ten is written out."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard deviation as text, with a common power of ten and a unit.

    Attributes
    ----------
    value, sd : digits only; `sd` is empty where there is none.
    exponent : power of ten of both, mostly 0.
    unit : printed unit.
    """

    value: str
    sd: str
    exponent: int
    unit: str

    def __str__(self) -> str:
        """ASCII text, such as ``41.80 +- 0.62 ug/g^2``."""
        body = f"{self.value} +- {self.sd}" if self.sd else self.value
        if self.exponent:
            body = f"({body})e{self.exponent}" if self.sd else f"{body}e{self.exponent}"
        return f"{body} {self.unit}".rstrip()


def measured(value: float, sd: float, unit: str = "") -> Measured:
    """Round a value to two significant digits of its standard deviation.

    Parameters
    ----------
    value, sd : in `unit`. With an sd that is zero or not finite, two digits of the value are kept.

    Examples
    --------
    >>> str(measured(41.7961, 0.6234, "ug/g^2"))
    '41.80 +- 0.62 ug/g^2'
    >>> str(measured(-152341.0, 1234.0, "ug"))
    '-152300 +- 1200 ug'
    >>> str(measured(3.2123e-8, 4.4e-10))
    '(3.212 +- 0.044)e-8'
    """
    if not (math.isfinite(value) and math.isfinite(sd) and sd > 0.0):
        return _plain(value, unit)
    exponent = _exponent(max(abs(value), sd)) if _needs_power(_exponent(sd)) else 0
    value, sd = value * 10.0**-exponent, sd * 10.0**-exponent
    decimals = 1 - _exponent(sd)
    return Measured(_fixed(value, decimals), _fixed(sd, decimals), exponent, unit)


def below(limit: float, unit: str = "") -> Measured:
    """Round an upper limit up, to two significant digits: what is below the limit is below what is printed.

    Examples
    --------
    >>> str(below(0.2841, "ug/g^3"))
    '0.29 ug/g^3'
    """
    if not (math.isfinite(limit) and limit > 0.0):
        return _plain(limit, unit)
    step = 10.0 ** (math.floor(math.log10(limit)) - 1)
    # a limit that is two digits long already must not step up by rounding of the quotient
    return _plain(math.ceil(limit / step - 1e-9) * step, unit)


def _plain(value: float, unit: str) -> Measured:
    if not math.isfinite(value):
        return Measured("unknown" if math.isnan(value) else "unbounded", "", 0, "")
    if value == 0.0:
        return Measured("0", "", 0, unit)
    exponent = _exponent(value) if _needs_power(_exponent(value)) else 0
    value = value * 10.0**-exponent
    return Measured(_fixed(value, 1 - _exponent(value)), "", exponent, unit)


def _exponent(value: float) -> int:
    """Power of ten of a value that is rounded to two digits: 0.0996 counts as 0.10."""
    return int(f"{abs(value):.1e}".partition("e")[2])


def _needs_power(exponent: int) -> bool:
    return exponent >= FIXED_DIGITS + 1 or 1 - exponent > FIXED_DIGITS


def _fixed(value: float, decimals: int) -> str:
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def per_unit(printed: str, si: str) -> float:
    """SI value of one printed unit of a term.

    Examples
    --------
    >>> per_unit("ppm", "1")
    1e-06
    """
    return factor(printed, like="" if si in ("1", "rad") else si)


_PRETTY = (
    (re.compile(r"\bu(?=g\b|rad\b)"), "µ"),
    (re.compile(r"sqrt\(([^()]*)\)"), r"√\1"),
    (re.compile(r"\bdegC\b"), "°C"),
    (re.compile(r"\bdeg\b"), "°"),
    (re.compile(r"\^2\b"), "²"),
    (re.compile(r"\^3\b"), "³"),
    (re.compile(r"\^(-?\d+)"), lambda found: found[1].translate(_SUPERSCRIPT)),
)
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def pretty(unit: str) -> str:
    """Write a unit with the real signs, for paper and screen.

    Examples
    --------
    >>> pretty("ug/sqrt(Hz)"), pretty("deg/h/g^2"), pretty("ppm/(deg/s)^3")
    ('µg/√Hz', '°/h/g²', 'ppm/(°/s)³')
    """
    for pattern, sign in _PRETTY:
        unit = pattern.sub(sign, unit)
    return unit


def superscript(exponent: int) -> str:
    """Power of ten in raised digits.

    Examples
    --------
    >>> superscript(-8)
    '⁻⁸'
    """
    return str(exponent).translate(_SUPERSCRIPT)


OUTPUT_UNIT: dict[Kind, str] = {"accelerometer": "ug", "gyroscope": "deg/h"}
"""Unit in which an effect on the output is printed."""

OUTPUT_SI: dict[Kind, str] = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}

NOISE_UNITS: dict[Kind, tuple[str, str, str]] = {
    "accelerometer": ("ug/sqrt(Hz)", "ug", "ug/sqrt(s)"),
    "gyroscope": ("deg/sqrt(h)", "deg/h", "deg/h/sqrt(h)"),
}
"""Data-sheet units of N, B, K."""

NOISE_SI: dict[Kind, tuple[str, str, str]] = {
    "accelerometer": ("m/s^2/sqrt(Hz)", "m/s^2", "m/s^2/sqrt(s)"),
    "gyroscope": ("rad/s/sqrt(Hz)", "rad/s", "rad/s/sqrt(s)"),
}

CHANNEL_UNIT = {"f": "g", "w": "deg/s", "dw": "deg/s^2", "T": "degC", "dT": "degC/min"}
"""Unit in which the range of an input channel is printed."""
