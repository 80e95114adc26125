"""Values of a study file, as types that read a text with a unit; and how a key of it is described.

This module, `tables`, `shapes`, `simulated` and `described` are the only ones that know pydantic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

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


def quantities(like: str) -> dict[str, str]:
    """JSON Schema of a text with a unit."""
    return {"type": "string", "format": f"quantity ({like})"}


class Quantity:
    """Marks a number that is a text with a unit in the file, like ``"30 s"``.

    Parameters
    ----------
    like : SI unit.
    positive : whether it has to be more than zero.
    """

    def __init__(self, like: str, *, positive: bool = False) -> None:
        self.like, self.read = like, measured(like, positive=positive)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read the text first."""
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """JSON Schema of the text."""
        return quantities(self.like)


Text = Annotated[str, Field(min_length=1)]
Seconds = Annotated[float, Quantity("s", positive=True)]
Settle = Annotated[float, Quantity("s")]
Hertz = Annotated[float, Quantity("Hz", positive=True)]
Metres = Annotated[float, Quantity("m")]
Angle = Annotated[float, Quantity("rad")]
Gravity = Annotated[float, Quantity("m/s^2", positive=True)]
Acceleration = Annotated[float, Quantity("m/s^2")]
Rate = Annotated[float, Quantity("rad/s")]
Kelvin = Annotated[float, Quantity("K", positive=True)]
Ramp = Annotated[float, Quantity("K/s", positive=True)]
Several = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Count = Annotated[int, Field(ge=1)]
Cost = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Table = dict[str, Any]


class Holds:
    """What a value comes to that is checked later, where the sensor and the folder are known.

    Parameters
    ----------
    shapes : of which it is one: shapes of tables, or their names, or JSON Schemas.
    many : whether it is a ``list`` of them, or a table of them by ``name``.
    """

    def __init__(self, *shapes: Any, many: Literal["", "list", "name"] = "") -> None:
        self.shapes, self.many = shapes, many

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """JSON Schema of the value; ``table`` names a shape."""
        ways = [
            one if isinstance(one, dict) else {"table": getattr(one, "__name__", one)} for one in self.shapes
        ]
        one = ways[0] if len(ways) == 1 else {"anyOf": ways}
        if self.many == "list":
            return {"type": "array", "items": one}
        return {"type": "object", "additionalProperties": one} if self.many else one


def key(
    meaning: str, example: Any, default: Any = ..., shown: str = "", *, usual: Any = None, alias: str = ""
) -> Any:
    """Describe a key of a table, for the documentation and for editors.

    Parameters
    ----------
    meaning : in words.
    example : of a value, as it stands in the file.
    default : of the key; without one it is needed. A text with a unit is read like one of the file, and a
        type makes it.
    shown : what the default comes to, in words.
    usual : value that stands for the default.
    alias : the key, where Python has a word for itself.
    """
    said = {"usual": shown, "default": usual}
    start: dict[str, Any] = {"default_factory" if isinstance(default, type) else "default": default}
    return Field(
        **start,
        alias=alias or None,
        description=meaning,
        examples=[example],
        json_schema_extra={word: value for word, value in said.items() if value not in ("", None)},
        validate_default=default is not None,
    )
