"""Values of a published result: SI; what is not finite is nan here, and null in the file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from types import SimpleNamespace, UnionType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BeforeValidator, ConfigDict, Field, Strict
from pydantic.fields import FieldInfo
from pydantic_core import core_schema
from typing_extensions import is_typeddict

PUBLISHED = ConfigDict(validate_by_name=True, validate_by_alias=True, defer_build=True)


class _Real:
    """A number, or null where it is not finite."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        absent = core_schema.no_info_after_validator_function(lambda _: math.nan, core_schema.none_schema())
        return core_schema.union_schema(
            [core_schema.float_schema(strict=True), absent],
            mode="left_to_right",
            custom_error_type="number",
            custom_error_message="expected a number or null",
        )


def _listed(value: Any) -> Any:
    """Numpy's arrays and scalars as Python has them."""
    return value.tolist() if hasattr(value, "tolist") else value


def plain(value: Any) -> Any:
    """Values of any form as Python has them, with null for what is not finite."""
    value = _listed(value)
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def says(meaning: str) -> FieldInfo:
    """What a key of a result means, and its unit where it isn't SI's: the documentation is made of it."""
    return Field(description=meaning)


Number = Annotated[float, _Real()]
Count = Annotated[int, BeforeValidator(_listed), Strict()]
Flag = Annotated[bool, BeforeValidator(_listed), Strict()]
Names = tuple[str, ...]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(_listed)]
Matrix = Annotated[tuple[Numbers, ...], BeforeValidator(_listed)]
Loose = dict[str, Any]
"""A table whose keys depend on what was tested."""

Kind = Literal["accelerometer", "gyroscope"]

_Published = TypeVar("_Published")
_hints = cache(get_type_hints)


def published(kind: type[_Published], source: object, /, **other: Any) -> _Published:
    """Publish what a stage found: fields of the same name, and the others as they are given.

    What a field holds is published alike, one or several; a tuple has its values in the order of the fields.

    Parameters
    ----------
    kind : of the published value.
    source : that has attributes of its fields' names.
    other : fields that have another name or form there.
    """
    given = {name: getattr(source, name) for name in _hints(kind).keys() - other.keys()} | other
    return kind(**{name: _of_form(form, given[name]) for name, form in _hints(kind).items()})


def _of_form(form: Any, value: Any) -> Any:
    """Publish a value where its form is a published one, a row or a table of these; else leave it."""
    kinds = get_args(form)
    if value is None or isinstance(value, str):
        return value
    if get_origin(form) is UnionType:
        return _of_form(kinds[0], value)
    if get_origin(form) is tuple and kinds[-1] is Ellipsis and _is_published(kinds[0]):
        return tuple(_of_form(kinds[0], each) for each in value)
    if get_origin(form) is dict and _is_published(kinds[1]):
        return {key: _of_form(kinds[1], each) for key, each in value.items()}
    if not _is_published(form) or isinstance(value, Mapping) or type(value) is form:
        return value
    if isinstance(value, tuple):
        value = SimpleNamespace(**dict(zip(_hints(form), value, strict=True)))
    return published(form, value)


def _is_published(form: Any) -> bool:
    return is_typeddict(form) or is_dataclass(form)
