"""Values of a published result: SI; what is not finite is nan here, and null in the file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, ConfigDict, Strict
from pydantic_core import core_schema

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


def published(kind: type[_Published], source: object, /, **other: Any) -> _Published:
    """Publish what a stage found: fields of the same name, and the others as they are given.

    Parameters
    ----------
    kind : of the published value.
    source : that has attributes of its fields' names.
    other : fields that have another name or form there.
    """
    return kind(
        **{name: getattr(source, name) for name in kind.__annotations__.keys() - other.keys()}, **other
    )
