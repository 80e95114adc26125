"""Shapes of the tables of a study file: the keys of each, and what a value of each may be.

An error becomes one sentence that names the file and the key.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, ValidationError
from pydantic.dataclasses import dataclass as shape

from imubayes.errors import InputError, StudyError
from imubayes.rig.runs import Procedure
from imubayes.study.schema.measured import STRICT, Angle, Count, Metres, Seconds, Several, Text, measured

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


def _column_name(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int) or value == "":
        raise ValueError("expected a column's name, or its number counted from 0")
    return value


@shape(config=STRICT, frozen=True)
class StudyFile:
    """A study file."""

    sensor: list[Table] = Field(default_factory=list)
    study: Table = Field(default_factory=dict)
    sampling: Table = Field(default_factory=dict)
    decision: Table = Field(default_factory=dict)
    scene: list[Table] = Field(default_factory=list)
    appendix: list[Table] = Field(default_factory=list)
    noise: Table = Field(default_factory=dict)
    quality: Table | None = None
    lots: Table | None = None
    extremes: Table | None = None
    fleet: Table | None = None
    speed: Table | None = None
    plan: Table | None = None


@shape(config=STRICT, frozen=True)
class HeaderTable:
    """``[study]``."""

    title: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    catalogue: Text | None = None
    method: Literal["auto", "exact", "collapsed", "full"] = "auto"


@shape(config=STRICT, frozen=True)
class SamplingTable:
    """``[sampling]``."""

    ess: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1000.0
    time_limit: Seconds = 600.0


@shape(config=STRICT, frozen=True)
class NoiseTable:
    """``[noise]``: the arguments of `imubayes.selection.noise_found.NoiseQuestion`."""

    identify: Literal["static", "all", "none"] = "static"
    candidates: Annotated[tuple[Literal["B", "K", "Q", "R", "G"], ...], Several] = ("B", "K", "Q", "R", "G")


@shape(config=STRICT, frozen=True)
class DecisionTable:
    """``[decision]``."""

    false_keep: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    false_drop: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    hierarchy: bool = False
    compare: bool = True


@shape(config=STRICT, frozen=True)
class ExtremesTable:
    """``[extremes]``."""

    families: Annotated[tuple[str, ...], Several] = ()
    every: Count = 1


@shape(config=STRICT, frozen=True)
class QualityTable:
    """``[quality]``."""

    sensors: Count = 200
    treatments: Annotated[tuple[str, ...], Several] = ("as modelled",)
    misspecified: Count | None = None
    powers: int = 3
    asymmetry: int = 2
    resamples: Count = 20
    processes: Count = 2
    classes: Annotated[tuple[str, ...], Several] = ()


@shape(config=STRICT, frozen=True)
class LotsTable:
    """``[lots]``."""

    kind: Literal["accelerometer", "gyroscope"]
    classes: Annotated[tuple[Text, ...], Several]
    units: Annotated[int, Field(ge=2)] = 8
    basic: bool = False
    asks: Any = "classes"
    processes: Count = 2
    library: Table = Field(default_factory=dict)
    reference: Table = Field(default_factory=dict)
    run: list[Table] = Field(default_factory=list)


@shape(config=STRICT, frozen=True)
class AgainstTable:
    """``[lots.asks]``."""

    needed_by: Annotated[tuple[Text, ...], Several]
    not_by: Annotated[tuple[Text, ...], Several]


@shape(config=STRICT, frozen=True)
class FleetTable:
    """``[fleet]``."""

    units: Any
    kind: Literal["accelerometer", "gyroscope"]
    class_: Annotated[Text, Field(alias="class")]
    part: Count = 8
    processes: Count = 2
    library: Table = Field(default_factory=dict)
    noise: Any = None
    prior: Table = Field(default_factory=dict)
    reference: Table = Field(default_factory=dict)
    robust: bool = False
    run: list[Table] = Field(default_factory=list)


@shape(config=STRICT, frozen=True)
class SpeedTable:
    """``[speed]``."""

    repeats: Count = 5
    least_squares: Annotated[tuple[int, ...], Several] = ()
    one_sided: Annotated[tuple[int, ...], Several] = ()
    subsets: Annotated[tuple[int, ...], Several] = ()
    g_prior: Annotated[tuple[int, ...], Several] = ()
    enumeration: Annotated[tuple[int, ...], Several] = ()
    noise: Annotated[tuple[int, ...], Several] = ()
    posterior: Annotated[tuple[int, ...], Several] = ()
    growth: Table = Field(default_factory=dict)


@shape(config=STRICT, frozen=True)
class GrowthTable:
    """``[speed.growth]``."""

    rows: Annotated[tuple[int, ...], Several] = ()
    terms: Annotated[tuple[int, ...], Several] = ()
    models: Annotated[tuple[int, ...], Several] = ()
    runs: Annotated[tuple[int, ...], Several] = ()
    units: Annotated[tuple[int, ...], Several] = ()


@shape(config=STRICT, frozen=True)
class SceneTable:
    """``[[scene]]``."""

    budget: Table
    name: Text | None = None
    scene: Text | None = None
    file: Text | None = None
    columns: Table = Field(default_factory=dict)
    ignore: Annotated[tuple[str, ...], Several] = ()
    duration: Seconds | None = None
    axis: Literal["x", "y", "z"] = "x"
    free_flight: bool | None = None


@shape(config=STRICT, frozen=True)
class AppendixTable:
    """``[[appendix]]``."""

    title: Text
    file: Text
    note: str = ""
    command: str = ""


@shape(config=STRICT, frozen=True)
class SensorTable:
    """``[[sensor]]``."""

    id: Text
    kind: Literal["accelerometer", "gyroscope", "imu"]
    run: list[Table] = Field(default_factory=list)
    class_: Annotated[Text | Table | None, Field(alias="class")] = None
    library: Table = Field(default_factory=dict)
    noise: Any = None
    truth: Table = Field(default_factory=dict)
    prior: Table = Field(default_factory=dict)
    reference: Table = Field(default_factory=dict)
    bench: Literal["exact", "drawn"] = "exact"
    robust: bool = False
    unit: Text | None = None
    session: Text | None = None


@shape(config=STRICT, frozen=True)
class LibraryTable:
    """``[sensor.library]``: the arguments of `imubayes.sensors.terms.library`."""

    powers: int = 3
    asymmetry: int = 2
    set: Literal["slide", "extended"] = "slide"
    temperature: int = 0
    temperature_of: Annotated[tuple[str, ...], Several] = ("b0", "b1")
    rate_of: Annotated[tuple[str, ...], Several] = ("b0",)


@shape(config=STRICT, frozen=True)
class RunTable:
    """``[[sensor.run]]``."""

    name: Text
    procedure: Procedure
    file: Text | None = None
    columns: Table = Field(default_factory=dict)
    ignore: Annotated[tuple[str, ...], Several] = ()
    gravity: Any = None
    noise: Any = None
    simulate: Table | None = None
    source: str = ""
    gyroscope_file: Text | None = None
    sections: list[Table] = Field(default_factory=list)


@shape(config=STRICT, frozen=True)
class SectionTable:
    """One of the ``sections`` of a run of an IMU."""

    rows: Annotated[tuple[int, int], Several]
    up: Literal["x", "-x", "y", "-y", "z", "-z"]
    turn: Any = None


@shape(config=STRICT, frozen=True)
class SiteTable:
    """``gravity`` of a run by place."""

    latitude: Angle
    height: Metres


@shape(config=STRICT, frozen=True)
class ColumnTable:
    """A channel of ``[sensor.run.columns]``."""

    column: Annotated[Any, AfterValidator(_column_name)] = None
    unit: Text | None = None
    scale: Text | None = None
    offset: Text | None = None
    wraps: Text | None = None


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
