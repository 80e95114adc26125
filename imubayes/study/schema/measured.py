"""Quantities of a study file, as types that read a text with a unit.

This module, `shapes` and `simulated` are the only ones that know pydantic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field

from imubayes import units
from imubayes.errors import InputError

STRICT = ConfigDict(extra="forbid", strict=True)


def measured(like: str, *, positive: bool = False) -> Callable[[Any], float]:
    """Give the reader of a quantity such as ``"30 s"``."""

    def read(value: Any) -> float:
        if not isinstance(value, str):
            raise ValueError(f'expected a quantity with its unit, such as "1 {like}"')
        try:
            si = units.quantity(value, like)
        except InputError as error:
            raise ValueError(str(error)) from None
        if not math.isfinite(si):
            raise ValueError("expected a finite number")
        if positive and not si > 0.0:
            raise ValueError("expected more than zero")
        return si

    return read


Text = Annotated[str, Field(min_length=1)]
Seconds = Annotated[float, BeforeValidator(measured("s", positive=True))]
Settle = Annotated[float, BeforeValidator(measured("s"))]
Hertz = Annotated[float, BeforeValidator(measured("Hz", positive=True))]
Metres = Annotated[float, BeforeValidator(measured("m"))]
Angle = Annotated[float, BeforeValidator(measured("rad"))]
Gravity = Annotated[float, BeforeValidator(measured("m/s^2", positive=True))]
Acceleration = Annotated[float, BeforeValidator(measured("m/s^2"))]
Rate = Annotated[float, BeforeValidator(measured("rad/s"))]
Kelvin = Annotated[float, BeforeValidator(measured("K", positive=True))]
Ramp = Annotated[float, BeforeValidator(measured("K/s", positive=True))]
Several = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Count = Annotated[int, Field(ge=1)]
