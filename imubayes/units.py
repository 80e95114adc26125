"""Units at the edge: a text becomes an SI number once, and an SI number becomes a text once.

The registry is the domain's own. ``g`` is standard gravity, so ``mg`` and ``ug`` are accelerations
(in pint's default registry ``mg`` is a milligram); ``ppm`` is 1e-6; a ``count`` is a pure number.
Angles are radians, which SI counts as pure numbers, so ``deg/h`` is a frequency like ``rad/s``.

An argument that a study can give says so in its annotation, by a `Key` and what the file's value is.
"""

from __future__ import annotations

import math
import re
from functools import cache
from tokenize import TokenError
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from imubayes.errors import InputError, UnitError

if TYPE_CHECKING:
    import pint

STANDARD_GRAVITY = 9.80665
"""Standard gravity g0 in m/s^2 (CGPM 1901)."""

ZERO_CELSIUS = 273.15
"""0 degC in kelvin."""

_DEFINITIONS = (
    "nano- = 1e-9 = n-",
    "micro- = 1e-6 = u- = µ-",
    "milli- = 1e-3 = m-",
    "kilo- = 1e3 = k-",
    "second = [time] = s = sec",
    "minute = 60 * second = min",
    "hour = 3600 * second = h",
    "day = 86400 * second",
    "hertz = 1 / second = Hz",
    "meter = [length] = m",
    "centimeter = 0.01 * meter = cm",
    "kelvin = [temperature] = K",
    "volt = [potential] = V",
    "ampere = [current] = A",
    "tesla = [magnetic_flux_density] = T",
    "gauss = 1e-4 * tesla = G",
    "radian = [] = rad",
    "degree = 0.017453292519943295 * radian = deg",
    "arcminute = 0.0002908882086657216 * radian = arcmin",
    "arcsecond = 4.84813681109536e-06 * radian = arcsec",
    "turn = 6.283185307179586 * radian = rev",
    "standard_gravity = 9.80665 * meter / second ** 2 = g",
    "count = [] = LSB",
    "part_per_million = 1e-6 = ppm",
    "percent = 0.01 = pct",
    "dps = degree / second",
    "dph = degree / hour",
    "rpm = 0.10471975511965977 / second",
)

_UNREADABLE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    SyntaxError,
    TypeError,
    ValueError,
    TokenError,
)
"""What pint's parser raises on texts that are not units (``deg/``, ``1//s``), beside its own errors."""

_EXPONENT = r"(?:\*\*|\^)\s*(?:[-+]?NUMBER|\([-+]?NUMBER\))(?!\s*(?:\*\*|\^))".replace(
    "NUMBER", r"\d{1,2}(?:\.\d{1,3})?(?![\d.])"
)
_SHAPE = re.compile(rf"(?:{_EXPONENT}|[^\W\d]|[*/()\s%°²³⁻¹]|1(?![\d.]))*")
_LONGEST = 100
"""What a unit may look like, and its length: a tower of exponents (``m^9^9^9``) keeps a parser busy."""

_ROOT = re.compile(r"sqrt\(([^()]*)\)")
_BARE_ROOT = re.compile(r"√(\w+)")
_CELSIUS = re.compile(r"(?:deg_?C|°C|celsius)\b")


@cache
def _registry() -> pint.UnitRegistry:
    import pint

    registry = pint.UnitRegistry(None)  # pyright: ignore[reportArgumentType]  (None: an empty one)
    for line in _DEFINITIONS:
        registry.define(line)
    return registry


def _readable(text: str) -> str:
    """Rewrite what people type (``deg/sqrt(h)``, ``deg/√h``, ``ug/degC``, ``%``) as pint reads it."""
    text = "" if text.strip() == "1" else text
    text = _CELSIUS.sub("kelvin", text.strip()).replace("%", "percent").replace("·", "*")
    text = _BARE_ROOT.sub(r"sqrt(\1)", text.replace("μ", "µ").replace("√(", "sqrt("))
    return _ROOT.sub(r"(\1)**0.5", text)


@cache
def factor(unit: str, like: str = "") -> float:
    """SI value of one `unit`.

    Parameters
    ----------
    unit : what a person writes, such as ``ug/sqrt(Hz)``, ``deg/h/g``, ``count``.
    like : a unit that it must be convertible to; empty for a pure number.

    Raises
    ------
    UnitError : if the unit is not known, or measures something else than `like`.

    Examples
    --------
    >>> round(factor("mg", like="m/s^2"), 8)
    0.00980665
    >>> round(factor("deg/h", like="rad/s") * 1e6, 6)
    4.848137
    """
    import pint

    registry = _registry()
    try:
        if not (_SHAPE.fullmatch(_readable(unit)) and len(unit) <= _LONGEST):
            raise ValueError(unit)
        value = registry.Quantity(1.0, registry.parse_units(_readable(unit)))
        wanted = registry.parse_units(_readable(like))
        return float(value.to(wanted).magnitude * registry.Quantity(1.0, wanted).to_base_units().magnitude)
    except pint.DimensionalityError:
        raise UnitError(
            f"unit '{unit}' does not measure what is needed here: expected something like '{like or 'ppm'}'"
        ) from None
    except (pint.errors.PintError, *_UNREADABLE):
        known = {
            "m/s^2": "m/s^2, g, mg, ug",
            "rad/s": "rad/s, deg/s, deg/h",
            "rad/s^2": "rad/s^2, deg/s^2",
            "s": "s, min, h",
            "K": "degC, K",
            "rad": "rad, deg, arcsec",
        }
        raise UnitError(
            f"unit '{unit}' is not known: expected something like '{like or 'ppm'}', "
            f"for example {known.get(like, 'ppm, ug/g^2, deg/h/g, ug/sqrt(Hz)')}"
        ) from None


def converts(unit: str, like: str) -> bool:
    """Tell whether a unit measures what `like` does; one that is not known may.

    Examples
    --------
    >>> converts("mg", "m/s^2"), converts("Hz", "m/s^2"), converts("furlong", "m/s^2")
    (True, False, True)
    """
    return measures(unit, like) or not measures(unit, unit)


def measures(unit: str, like: str) -> bool:
    """Tell whether a unit is known and measures what `like` does."""
    try:
        factor(unit, like)
    except UnitError:
        return False
    return True


_SIZE = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"\s*([-+]?{_SIZE})(?:\s*/\s*({_SIZE}))?\s*(.*?)\s*$")


def quantity(text: str, like: str = "") -> float:
    """SI value of a quantity such as ``"30 s"`` or ``"1.5 mg"``.

    Parameters
    ----------
    text : number, or a fraction such as ``1/16384``, and unit; the unit may be absent where `like` is a pure
        number.
    like : a unit that it must be convertible to. ``K`` takes ``25 degC`` as a temperature.

    Raises
    ------
    UnitError : if the text has no number, or its unit is not like `like`.

    Examples
    --------
    >>> quantity("2 min", like="s")
    120.0
    >>> quantity("25 degC", like="K")
    298.15
    """
    match = _QUANTITY.match(text)
    if match is None:
        raise UnitError(f"'{text}' is not a quantity: expected a number and a unit like '{like}'")
    unit, divisor = match[3], float(match[2] or 1.0)
    if divisor == 0.0:
        raise UnitError(f"'{text}' is divided by zero: expected a finite quantity like '{like or '1'}'")
    value = float(match[1]) / divisor * factor(unit, like) + offset(unit, like)
    if not math.isfinite(value):
        raise UnitError(
            f"'{text}' is too large for a number: expected a finite quantity like '{like or '1'}'"
        )
    return value


def offset(unit: str, like: str) -> float:
    """SI value of zero on the scale of `unit`: 273.15 for ``degC`` as a temperature, else 0."""
    return ZERO_CELSIUS if like == "K" and _CELSIUS.fullmatch(unit.strip()) else 0.0


class Key(NamedTuple):
    """Marks an argument that a study can give: what it means, and a value as it stands in the file."""

    meaning: str
    example: Any


class Quantity:
    """Marks a number that is a text with a unit in a study, like ``"30 s"``.

    Parameters
    ----------
    like : SI unit.
    positive : whether it has to be more than zero.
    size : SI value of one, where the number is not in SI.
    """

    def __init__(self, like: str, *, positive: bool = False, size: float = 1.0) -> None:
        self.like, self.positive, self.size = like, positive, size

    def read(self, value: Any) -> float:
        """Number of a text; a `ValueError` says what was expected."""
        if not isinstance(value, str):
            raise ValueError(f'expected a quantity with its unit, such as "1 {self.like}"')
        try:
            si = quantity(value, self.like)
        except InputError as error:
            raise ValueError(str(error)) from None
        if self.positive and not si > 0.0:
            raise ValueError("expected more than zero")
        return si / self.size

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Read the text first."""
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, str]:
        """JSON Schema of the text."""
        return quantities(self.like)


def quantities(like: str) -> dict[str, str]:
    """JSON Schema of a text with a unit."""
    return {"type": "string", "format": f"quantity ({like})"}


class NumberLimits:
    """Marks a number or a text that has limits, by pydantic's names of them."""

    def __init__(self, **limits: Any) -> None:
        self.limits = limits

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Check them."""
        return {**handler(source), **self.limits}


Seconds = Annotated[float, Quantity("s", positive=True)]
Pause = Annotated[float, Quantity("s")]
Hertz = Annotated[float, Quantity("Hz", positive=True)]
Metres = Annotated[float, Quantity("m")]
Angle = Annotated[float, Quantity("rad")]
Rate = Annotated[float, Quantity("rad/s")]
Acceleration = Annotated[float, Quantity("m/s^2", positive=True)]
Gravities = Annotated[float, Quantity("m/s^2", size=STANDARD_GRAVITY)]
Kelvin = Annotated[float, Quantity("K", positive=True)]
Count = Annotated[int, NumberLimits(ge=1)]
Positive = Annotated[float, NumberLimits(gt=0, allow_inf_nan=False)]
Name = Annotated[str, NumberLimits(min_length=1)]


def counted(count: int, noun: str) -> str:
    """Number of things with their noun in the singular or plural.

    Examples
    --------
    >>> counted(1, "term"), counted(0, "term"), counted(8400, "sample"), counted(2, "stretch")
    ('1 term', '0 terms', '8,400 samples', '2 stretches')
    """
    ending = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count:,} {noun}{'' if count == 1 else ending}"
