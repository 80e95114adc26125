"""A table of a study is checked against its shape; an error becomes a sentence that names file and key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import TypeVar

from pydantic import ValidationError

from imubayes.errors import MISSING, Place, said, shown
from imubayes.study.schema.measured import measured

_Shape = TypeVar("_Shape")


def shaped(wanted: type[_Shape], raw: object, place: Place) -> _Shape:
    """Check one table against its shape.

    Raises
    ------
    StudyError : naming the first key that is not known, missing, or of a wrong value.
    """
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
        for step in first["loc"]:
            place = place.at(step)
        raise place.error(f"{said(first)}: add it" if first["type"] in MISSING else said(first)) from None


def quantity(text: object, like: str, place: Place, *, positive: bool = False) -> float:
    """SI value of a quantity whose unit depends on the sensor.

    Raises
    ------
    StudyError : if it is not a quantity like `like`.
    """
    try:
        return measured(like, positive=positive)(text)
    except ValueError as error:
        raise place.error(f"{error}, came {shown(text)}") from None


def unique(names: Sequence[str], key: str, place: Place) -> None:
    """Refuse a name that an earlier table of the list here has.

    Raises
    ------
    StudyError : naming both tables.
    """
    for k, name in enumerate(names):
        if name in names[:k]:
            first = place.at(names.index(name)).key
            raise place.at(k).at(key).error(f"'{name}' is the {key} of {first} already: expected another")


def hint(key: str, known: Sequence[str]) -> str:
    """Suggest what was meant.

    Examples
    --------
    >>> hint("powrs", ["powers", "asymmetry"]), hint("x", ["powers", "asymmetry"])
    ("did you mean 'powers'?", 'expected one of powers, asymmetry')
    """
    near = get_close_matches(key, known, n=1)
    return f"did you mean '{near[0]}'?" if near else f"expected one of {', '.join(known)}"
