"""Tables of a study: how their keys are described, checked, and named in an error.

What is wrong with a study is a `StudyError` that names its file and key, whichever table it is in.

A key is described where its value is used, in the annotation of an argument (`imubayes.units.Key`), or by
`key` in a table whose values depend on the sensor or the folder. Only this package and
`imubayes.reporting.result` import pydantic.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from types import UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema
from pydantic.dataclasses import dataclass

from imubayes import units
from imubayes.errors import MISSING, Place, hint, said, shown

_Shape = TypeVar("_Shape")

STRICT = ConfigDict(extra="forbid", strict=True, defer_build=True)
Several = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Table = dict[str, Any]
Text = units.Name
Texts = Annotated[tuple[str, ...], Several]
Names = Annotated[tuple[Text, ...], Several]

_UNIONS = (Union, UnionType)
_PRINTED = {
    "s": ("h", "min", "s"), "Hz": ("Hz",), "m/s^2": ("m/s^2",), "rad": ("deg",), "m": ("m",),
    "K/s": ("degC/min",), "rad/s": ("deg/s",),
}  # fmt: skip
"""Units that people use for the usual value of an argument, by the SI unit."""


@dataclass_transform(kw_only_default=True, frozen_default=True)
def shape(table: type[_Shape]) -> type[_Shape]:
    """Make a class the shape of a table."""
    made: Any = dataclass(config=STRICT, frozen=True, kw_only=True)(table)
    return made


def holds(*shapes: Any, many: Literal["", "list", "name"] = "") -> WithJsonSchema:
    """JSON Schema of a value that is checked later, where the sensor and the folder are known.

    Parameters
    ----------
    shapes : of which it is one: shapes of tables, or their names, or JSON Schemas.
    many : whether it is a ``list`` of them, or a table of them by ``name``.
    """
    ways = [kind if isinstance(kind, dict) else {"table": getattr(kind, "__name__", kind)} for kind in shapes]
    schema = ways[0] if len(ways) == 1 else {"anyOf": ways}
    if many == "list":
        return WithJsonSchema({"type": "array", "items": schema})
    return WithJsonSchema({"type": "object", "additionalProperties": schema} if many else schema)


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


def table_of(
    source: Callable[..., Any],
    name: str,
    heading: str,
    *,
    needed: str = "",
    within: bool = False,
    more: Mapping[str, Any] | None = None,
) -> type:
    """Shape of a table that gives the arguments of a function, or fields of a dataclass, that have a `Key`.

    `needed` is an argument that has to be given though it has a default, `more` are annotated types of keys
    that are no arguments; `within`, it is read with the table that it stands in.
    """
    hints = get_type_hints(source, include_extras=True)
    usual = {name: parameter.default for name, parameter in inspect.signature(source).parameters.items()}
    kinds, values = dict[str, Any](), dict[str, Any]()
    for argument, kind in (hints | dict(more or {})).items():
        described = next((mark for mark in _unwrapped(kind)[1] if isinstance(mark, units.Key)), None)
        default = usual.get(argument)
        if described and (default is inspect.Parameter.empty or argument == needed):
            kinds[argument], values[argument] = _read(kind), key(*described)
        elif described:
            kinds[argument] = _read(kind) | None
            values[argument] = key(*described, None, usual=_written(default, kind))
    made = type(name, (), {"__annotations__": kinds, "__doc__": f"``{heading}``.", **values})
    config: ConfigDict = {**STRICT, "strict": not within}
    return dataclass(config=config, frozen=True, kw_only=True)(made)


def arguments(wanted: type, raw: object, place: Place) -> dict[str, Any]:
    """Check the table of a function's arguments, and give those that it has."""
    return asdict(
        shaped(wanted, raw, place), dict_factory=lambda pairs: {k: v for k, v in pairs if v is not None}
    )


def _read(kind: Any) -> Any:
    """Type of an argument as a study gives it: a list for several values."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        marks = [mark for mark in inner[1:] if not isinstance(mark, units.Key)]
        return Annotated[_read(inner[0]), *marks] if marks else _read(inner[0])
    if origin is Sequence:
        return Annotated[tuple[inner[0], ...], Several]
    if origin is tuple:
        return Annotated[kind, Several]
    return _read(inner[0]) | None if origin in _UNIONS else kind


def _unwrapped(kind: Any) -> tuple[Any, list[Any]]:
    """Type of an argument that is given, and what it is annotated with."""
    if get_origin(kind) is Annotated:
        bare, marks = _unwrapped(get_args(kind)[0])
        return bare, [*marks, *get_args(kind)[1:]]
    return _unwrapped(get_args(kind)[0]) if get_origin(kind) in _UNIONS else (kind, [])


def _written(value: Any, kind: Any) -> Any:
    """Value of a signature, in SI, as a study would have it."""
    bare, marks = _unwrapped(kind)
    if isinstance(value, tuple):
        return [_written(entry, get_args(bare)[0]) for entry in value]
    like = next((mark.like for mark in marks if isinstance(mark, units.Quantity)), None)
    if like is None or value is None:
        return value
    sizes = {unit: value / units.factor(unit, like) for unit in _PRINTED[like]}
    whole = (unit for unit, size in sizes.items() if size > 0.5 and math.isclose(size, round(size)))
    unit = next(whole, _PRINTED[like][-1])
    return f"{sizes[unit]:.6g} {unit}"


def shaped(wanted: type[_Shape], raw: object, place: Place) -> _Shape:
    """Check one table against its shape."""
    if not isinstance(raw, dict):
        raise place.error(f"expected a table, came {shown(raw)}")
    known = [field.name.rstrip("_") for field in fields(wanted)]  # pyright: ignore[reportArgumentType]
    for key in raw:
        if key not in known:
            raise place.at(key).error(f"unknown key: {hint(key, known)}")
    try:
        return wanted(**raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = place.at(*first["loc"])
        raise place.error(f"{said(first)}: add it" if first["type"] in MISSING else said(first)) from None


def quantity(text: object, like: str, place: Place, *, positive: bool = False) -> float:
    """SI value of a quantity whose unit depends on the sensor."""
    try:
        return units.Quantity(like, positive=positive).read(text)
    except ValueError as error:
        raise place.error(f"{error}, came {shown(text)}") from None


def unique(names: Sequence[str], key: str, place: Place) -> None:
    """Refuse a name that an earlier table of the list here has."""
    for k, name in enumerate(names):
        if name in names[:k]:
            first = place.at(names.index(name)).key
            raise place.at(k, key).error(f"'{name}' is the {key} of {first} already: expected another")
