"""Shapes of the tables of a study file: the keys of each, and what a value of each may be.

The only module that knows pydantic. An error becomes one sentence that names the file and the key.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass as shape

from imubayes import units
from imubayes.errors import InputError, StudyError
from imubayes.rig.runs import Procedure

Table = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Place:
    """A key of a file, by its dotted path (``sensor[0].run[1].file``)."""

    file: str
    key: str = ""

    def at(self, key: str | int) -> Place:
        """Go to a key of the table here, or to an entry of the list here."""
        if isinstance(key, int):
            return Place(self.file, f"{self.key}[{key}]")
        return Place(self.file, f"{self.key}.{key}" if self.key else key)

    def error(self, text: str) -> StudyError:
        """Give the error that says `text` of this place."""
        return StudyError(f"{self.file}: {self.key}: {text}" if self.key else f"{self.file}: {text}")

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Name this place in whatever input error the block raises."""
        try:
            yield
        except InputError as error:
            raise self.error(str(error)) from None


_STRICT = ConfigDict(extra="forbid", strict=True)


def _measured(like: str, *, positive: bool = False) -> Callable[[Any], float]:
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


def _column_name(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int) or value == "":
        raise ValueError("expected a column's name, or its number counted from 0")
    return value


def _in_g(levels: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(level / units.STANDARD_GRAVITY for level in levels)


_Text = Annotated[str, Field(min_length=1)]
_Seconds = Annotated[float, BeforeValidator(_measured("s", positive=True))]
_Settle = Annotated[float, BeforeValidator(_measured("s"))]
_Hertz = Annotated[float, BeforeValidator(_measured("Hz", positive=True))]
_Metres = Annotated[float, BeforeValidator(_measured("m"))]
_Angle = Annotated[float, BeforeValidator(_measured("rad"))]
_Gravity = Annotated[float, BeforeValidator(_measured("m/s^2", positive=True))]
_Acceleration = Annotated[float, BeforeValidator(_measured("m/s^2"))]
_Rate = Annotated[float, BeforeValidator(_measured("rad/s"))]
_Kelvin = Annotated[float, BeforeValidator(_measured("K", positive=True))]
_Ramp = Annotated[float, BeforeValidator(_measured("K/s", positive=True))]
_Several = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
_Count = Annotated[int, Field(ge=1)]


@shape(config=_STRICT, frozen=True)
class StudyFile:
    """A study file."""

    sensor: list[Table] = Field(default_factory=list)
    study: Table = Field(default_factory=dict)
    sampling: Table = Field(default_factory=dict)
    decision: Table = Field(default_factory=dict)
    appendix: list[Table] = Field(default_factory=list)
    quality: Table | None = None


@shape(config=_STRICT, frozen=True)
class HeaderTable:
    """``[study]``."""

    title: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    method: Literal["auto", "exact", "collapsed", "full"] = "auto"


@shape(config=_STRICT, frozen=True)
class SamplingTable:
    """``[sampling]``."""

    ess: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1000.0
    time_limit: _Seconds = 600.0


@shape(config=_STRICT, frozen=True)
class DecisionTable:
    """``[decision]``."""

    false_keep: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    false_drop: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    hierarchy: bool = False
    compare: bool = True


@shape(config=_STRICT, frozen=True)
class QualityTable:
    """``[quality]``."""

    sensors: _Count = 200
    treatments: Annotated[tuple[str, ...], _Several] = ("as modelled",)
    misspecified: _Count | None = None
    powers: int = 3
    asymmetry: int = 2
    resamples: _Count = 20
    processes: _Count = 2


@shape(config=_STRICT, frozen=True)
class AppendixTable:
    """``[[appendix]]``."""

    title: _Text
    file: _Text
    note: str = ""
    command: str = ""


@shape(config=_STRICT, frozen=True)
class SensorTable:
    """``[[sensor]]``."""

    id: _Text
    kind: Literal["accelerometer", "gyroscope", "imu"]
    run: list[Table] = Field(default_factory=list)
    class_: Annotated[_Text | None, Field(alias="class")] = None
    library: Table = Field(default_factory=dict)
    noise: Any = None
    truth: Table = Field(default_factory=dict)
    prior: Table = Field(default_factory=dict)
    reference: Table = Field(default_factory=dict)
    robust: bool = False
    unit: _Text | None = None
    session: _Text | None = None


@shape(config=_STRICT, frozen=True)
class LibraryTable:
    """``[sensor.library]``: the arguments of `imubayes.sensors.terms.library`."""

    powers: int = 3
    asymmetry: int = 2
    set: Literal["slide", "extended"] = "slide"
    temperature: int = 0
    temperature_of: Annotated[tuple[str, ...], _Several] = ("b0", "b1")
    rate_of: Annotated[tuple[str, ...], _Several] = ("b0",)


@shape(config=_STRICT, frozen=True)
class RunTable:
    """``[[sensor.run]]``."""

    name: _Text
    procedure: Procedure
    file: _Text | None = None
    columns: Table = Field(default_factory=dict)
    gravity: Any = None
    noise: Any = None
    simulate: Table | None = None
    source: str = ""


@shape(config=_STRICT, frozen=True)
class SiteTable:
    """``gravity`` of a run by place."""

    latitude: _Angle
    height: _Metres


@shape(config=_STRICT, frozen=True)
class ColumnTable:
    """A channel of ``[sensor.run.columns]``."""

    column: Annotated[Any, AfterValidator(_column_name)] = None
    unit: _Text | None = None
    scale: _Text | None = None
    offset: _Text | None = None
    wraps: _Text | None = None


@shape(config=_STRICT, frozen=True)
class StaticOptions:
    """``simulate`` of a static log."""

    duration: _Seconds
    rate: _Hertz
    up: Annotated[tuple[float, float, float] | None, _Several] = None
    gravity: _Gravity | None = None


@shape(config=_STRICT, frozen=True)
class TumbleOptions:
    """``simulate`` of a tumble."""

    angles: _Count | None = None
    planes: _Count | None = None
    dwell: _Seconds | None = None
    rate: _Hertz | None = None
    settle: _Settle | None = None
    gravity: _Gravity | None = None


@shape(config=_STRICT, frozen=True)
class RateTableOptions:
    """``simulate`` of a rate table."""

    rates: Annotated[tuple[_Rate, ...], _Several]
    mounts: _Count | None = None
    dwell: _Seconds | None = None
    rate: _Hertz | None = None
    settle: _Settle | None = None
    latitude: _Angle | None = None
    radius: _Metres | None = None


@shape(config=_STRICT, frozen=True)
class CentrifugeOptions:
    """``simulate`` of a centrifuge."""

    levels: Annotated[tuple[_Acceleration, ...], _Several, AfterValidator(_in_g)]
    mounts: _Count | None = None
    dwell: _Seconds | None = None
    rate: _Hertz | None = None
    settle: _Settle | None = None
    arm: _Metres | None = None
    ramp: bool | None = None


@shape(config=_STRICT, frozen=True)
class ThermalOptions:
    """``simulate`` of soaks and ramps."""

    temperatures: Annotated[tuple[_Kelvin, ...], _Several]
    positions: _Count | None = None
    dwell: _Seconds | None = None
    soak: _Settle | None = None
    ramp: _Ramp | None = None
    rate: _Hertz | None = None
    turning: _Rate | None = None


SIMULATED = {
    "static": StaticOptions,
    "tumble": TumbleOptions,
    "rate-table": RateTableOptions,
    "centrifuge": CentrifugeOptions,
    "thermal": ThermalOptions,
}
"""Procedures that can be simulated, with the shape of their options."""

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
        raise place.error(_said(first["type"], first["msg"], first["input"])) from None


def quantity(text: object, like: str, place: Place, *, positive: bool = False) -> float:
    """SI value of a quantity whose unit depends on the sensor.

    Raises
    ------
    StudyError : if it is not a quantity like `like`.
    """
    try:
        return _measured(like, positive=positive)(text)
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


def shown(value: object) -> str:
    """Show a value of the file, shortened.

    Examples
    --------
    >>> shown("x" * 100)
    "'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx..."
    """
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _said(sort: str, message: str, value: object) -> str:
    """Say in the house's words what pydantic found."""
    if sort in ("missing", "missing_argument"):
        return "the key is missing: add it"
    message = message.removeprefix("Value error, ").replace("Input should be", "expected")
    message = message.replace("a valid integer", "an integer").replace("a valid ", "a ")
    return f"{message[:1].lower()}{message[1:]}, came {shown(value)}"
