"""The catalogue's files: checked tables become sensor classes.

A file holds tables ``[<kind>.<class>]`` of the form that ``grades.toml`` beside this module describes. A
user's class may state only what it changes, and take the rest from the class that it is ``like``::

    [accelerometer.screened]
    like = "mems_tactical"
    grade = "tactical, screened for bias"
    quoted = { datasheet = ["K0"] }

    [accelerometer.screened.source]
    datasheet = "acceptance tests of 40 units"

    [accelerometer.screened.coefficients]
    K0 = [200, 600, 1500, "ug"]
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from imubayes import units
from imubayes.errors import Place, StudyError, hint
from imubayes.sensors import (
    COEFFICIENT_KEYS,
    NOISE_KEYS,
    PLACES,
    RATING_KEYS,
    SOURCE_KINDS,
    CatalogueKey,
    Origins,
    Range,
    SensorClass,
    SourceKind,
)
from imubayes.sensors.noise import FLOOR
from imubayes.sensors.terms import Kind

Table = Mapping[str, Any]
KINDS: tuple[Kind, ...] = ("accelerometer", "gyroscope")

_TEXTS = ("technology", "grade", "note", "like", "campaign")
_TABLES = ("source", "quoted", "coefficients", "noise")
_NEEDED = ("technology", "grade", "full_scale", "bandwidth", "temperature", "coefficients", "noise")
_KNOWN = (*_TEXTS, "examples", "full_scale", "bandwidth", "temperature", *_TABLES)
_INSTABILITY = ("B", "floor")
"""Bias instability, of which a class states one figure: the coefficient, or the floor that it makes."""

_HUGE = 1e300
_UNSTATED = {"order_of_magnitude": "stated without a source"}


def read_catalogue(path: Path | str) -> tuple[SensorClass, ...]:
    """Classes of a user's own file, accelerometers first.

    It is a TOML file of the form of ``grades.toml``; with ``like``, a class states only what it changes. Its
    figures are orders of magnitude but for those that ``quoted`` names. A `StudyError` names the file, the
    class and the key, what was expected and what to do.
    """
    file = Place(str(Path(path)))
    try:
        raw = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise file.error(f"cannot be read ({error.strerror}): check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise file.error(f"is not TOML ({error}): expected tables [accelerometer.NAME]") from None
    _refuse_unknown(raw, KINDS, file)
    found: list[SensorClass] = []
    for kind in KINDS:
        own, shipped, place = raw.get(kind, {}), packaged_tables()[kind], file.at(kind)
        _check_table(own, place)
        for id, table in own.items():
            if id in shipped:
                raise place.at(id).error("a class of the catalogue has this id: choose another one")
            _check_shape(table, place.at(id))
        known = {**shipped, **own}
        found += [_entry(id, kind, _whole(id, known, place), place.at(id)) for id in own]
    return tuple(found)


@cache
def packaged_tables() -> Mapping[str, Any]:
    """Tables of the catalogue that comes with imubayes, as they are written."""
    return tomllib.loads(files("imubayes.sensors").joinpath("grades.toml").read_text(encoding="utf-8"))


@cache
def packaged_classes() -> tuple[SensorClass, ...]:
    """Classes of the catalogue that comes with imubayes, accelerometers first."""
    return tuple(
        _entry(id, kind, table, Place("grades.toml").at(kind, id))
        for kind in KINDS
        for id, table in packaged_tables()[kind].items()
    )


def campaign_of(entry: SensorClass) -> Table:
    """Test campaign that fits a class, as it is written: ``text``, ``source``, ``reference``, ``run``.

    It is a `StudyError` if the class has none.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> [run["name"] for run in campaign_of(sensor("fog_navigation", kind="gyroscope"))["run"]]
    ['rate steps', 'tumble', 'centrifuge', 'chamber']
    """
    known = _campaigns(entry.kind)
    if not entry.campaign:
        raise StudyError(
            f"class '{entry.id}' has no test campaign: state campaign in its table, one of {', '.join(known)}"
        )
    return known[entry.campaign]


def _campaigns(kind: Kind) -> dict[str, Table]:
    return {name: table for name, table in packaged_tables()["campaign"].items() if table["kind"] == kind}


def figure_range(figure: Sequence[Any]) -> Range:
    """``[low, typical, high, unit]`` in SI.

    Examples
    --------
    >>> figure_range([1, 2, 4, "km"])
    (1000.0, 2000.0, 4000.0)
    """
    *values, unit = figure
    scale = units.factor(unit, like=unit)
    low, typical, high = (value * scale for value in values)
    return low, typical, high


def origins_of(quoted: Table, keys: Iterable[str]) -> dict[str, Origins]:
    """Source kind of each number of the figures: an order of magnitude where no source is quoted.

    Quoted are, by source kind, the numbers that are the source's own: ``K0.high``, or ``K0`` for all three.

    Examples
    --------
    >>> origins_of({"datasheet": ["K0.high"]}, ["K0"])["K0"]
    ('order_of_magnitude', 'order_of_magnitude', 'datasheet')
    """
    found: dict[str, SourceKind] = {}
    for kind in reversed(SOURCE_KINDS):
        for number in quoted.get(kind, ()):
            key, _, place = number.partition(".")
            found |= {f"{key}.{each}": kind for each in ([place] if place else PLACES)}
    return {key: _three(found.get(f"{key}.{each}", "order_of_magnitude") for each in PLACES) for key in keys}


def _three(kinds: Iterable[SourceKind]) -> Origins:
    low, typical, high = kinds
    return low, typical, high


def _whole(id: str, known: Mapping[str, Table], place: Place, above: tuple[str, ...] = ()) -> Table:
    """Table of a class with all that it takes over from the class that it is like."""
    table, here = known[id], place.at(id, "like")
    if "like" not in table:
        return table
    like = table["like"]
    if like not in known:
        near = get_close_matches(like, known)
        meant = f"did you mean {' or '.join(near)}?" if near else f"expected one of {', '.join(known)}"
        raise here.error(f"there is no class '{like}': {meant}")
    if like in (*above, id):
        circle = " like ".join((*above, id, like))
        raise here.error(f"a circle ({circle}): one of them must state all its figures")
    return _inherited(_whole(like, known, place, (*above, id)), table, like)


def _inherited(base: Table, own: Table, like: str) -> Table:
    """Give the figures of `base` where `own` has none; what `own` states has no source in `base`."""
    said = {number for numbers in own.get("quoted", {}).values() for number in numbers}
    noise = own.get("noise", {})
    instead = _INSTABILITY if any(key in noise for key in _INSTABILITY) else ()
    stated = {*own.get("coefficients", {}), *noise, *instead, *own, *said}
    theirs = {
        kind: [number for number in numbers if stated.isdisjoint((number, number.partition(".")[0]))]
        for kind, numbers in base.get("quoted", {}).items()
    }
    quoted = {kind: [*theirs.get(kind, ()), *own.get("quoted", {}).get(kind, ())] for kind in SOURCE_KINDS}
    theirs_noise = {key: figure for key, figure in base.get("noise", {}).items() if key not in instead}
    figures = {
        "coefficients": {**base.get("coefficients", {}), **own.get("coefficients", {})},
        "noise": {**theirs_noise, **noise},
    }
    told = {kind: f"as {like}: {text}" for kind, text in base.get("source", _UNSTATED).items()}
    source = {
        kind: "; ".join(filter(None, (own.get("source", {}).get(kind), told.get(kind))))
        for kind in SOURCE_KINDS
    }
    return {**base, **own, **figures, "quoted": quoted, "source": source}


def _entry(id: str, kind: Kind, table: Table, place: Place) -> SensorClass:
    _check_shape(table, place)
    _check_present(_NEEDED, table, place)
    coefficients = _figures(table["coefficients"], COEFFICIENT_KEYS[kind], place.at("coefficients"))
    noise = _noise(table["noise"], kind, place.at("noise"))
    ratings = {key: table[key] for key in RATING_KEYS[kind]}
    rated = _figures(ratings, RATING_KEYS[kind], place, above_zero=True)
    written = {**table["coefficients"], **table["noise"], **ratings}
    quoted = table.get("quoted", {})
    _check_quoted(quoted, written, place.at("quoted"))
    temperature = _temperature(table["temperature"], place.at("temperature"))
    sources, campaign, known = table.get("source", _UNSTATED), table.get("campaign", ""), _campaigns(kind)
    if campaign and campaign not in known:
        raise place.at("campaign").error(f"there is no campaign '{campaign}': {hint(campaign, known)}")
    return SensorClass(
        id=id,
        kind=kind,
        technology=table["technology"],
        grade=table["grade"],
        examples=tuple(table.get("examples", ())),
        full_scale=rated["full_scale"][1],
        bandwidth=rated["bandwidth"][1],
        coefficients=coefficients,
        noise=noise,
        temperature=temperature,
        source="; ".join(f"{sort.replace('_', ' ')}: {text}" for sort, text in sources.items() if text),
        units={key: figure[-1] for key, figure in written.items()},
        origins=origins_of(quoted, written),
        note=table.get("note", ""),
        campaign=campaign,
    )


def _noise(table: Table, kind: Kind, place: Place) -> dict[str, Range]:
    """N, B and K; where the floor of the Allan deviation is stated, B is that over 0.664."""
    figures = _figures(table, NOISE_KEYS[kind], place, above_zero=True)
    stated = [key for key in _INSTABILITY if key in figures]
    if len(stated) != 1:
        raise place.error(
            f"{' and '.join(stated) or 'neither B nor floor'}: expected one of them, floor for the lowest"
            " Allan deviation (a data sheet's bias instability), B for the coefficient (floor / 0.664)"
        )
    low, typical, high = figures[stated[0]]
    scale = 1.0 if stated == ["B"] else 1.0 / FLOOR
    return {"N": figures["N"], "B": (low * scale, typical * scale, high * scale), "K": figures["K"]}


def _figures(
    table: Table, keys: Mapping[str, CatalogueKey], place: Place, *, above_zero: bool = False
) -> dict[str, Range]:
    _refuse_unknown(table, keys, place)
    _check_present([key for key, meaning in keys.items() if meaning.required], table, place)
    return {
        key: _figure(figure, keys[key], place.at(key), above_zero=above_zero) for key, figure in table.items()
    }


def _figure(figure: object, key: CatalogueKey, place: Place, *, above_zero: bool) -> Range:
    expected = f'expected [low, typical, high, "unit"] of {key.text}, a size without a sign'
    if not (isinstance(figure, list) and len(figure) == 4 and isinstance(figure[3], str)):
        raise place.error(f"{_shown(figure)}: {expected}")
    *values, unit = figure
    if not (all(map(_is_number, values)) and 0.0 <= values[0] <= values[1] <= values[2] and values[2] > 0.0):
        raise place.error(f"{_shown(values)}: {expected}, rising from low to high")
    if above_zero and not values[0] > 0.0:
        raise place.error(f"low is zero: {expected}, above zero; state the smallest that occurs")
    with place.blamed():
        units.factor(unit, like=key.unit)
    return figure_range(figure)


def _temperature(values: object, place: Place) -> tuple[float, float]:
    expected = 'expected [lowest, highest, "degC"] of operation'
    if not (isinstance(values, list) and len(values) == 3 and all(map(_is_number, values[:2]))):
        raise place.error(f"{_shown(values)}: {expected}")
    with place.blamed():
        low, high = (units.quantity(f"{value} {values[2]}", like="K") for value in values[:2])
    if not low < high:
        raise place.error(f"{_shown(values)}: {expected}, the lowest first")
    return low, high


def _check_shape(table: object, place: Place) -> None:
    checked = _check_table(table, place)
    _refuse_unknown(checked, _KNOWN, place)
    for key in _TABLES:
        _check_table(checked.get(key, {}), place.at(key))
    for key in _TEXTS:
        _check_texts(checked.get(key, ""), place.at(key), several=False)
    lists = {"examples": checked.get("examples", [])}
    for part in ("source", "quoted"):
        _refuse_unknown(checked.get(part, {}), SOURCE_KINDS, place.at(part))
        lists |= {f"{part}.{kind}": value for kind, value in checked.get(part, {}).items()}
    for key, value in lists.items():
        _check_texts(value, place.at(key), several=not key.startswith("source"))


def _check_texts(value: object, place: Place, *, several: bool) -> None:
    texts = value if several and isinstance(value, list) else [value]
    if several != isinstance(value, list) or not all(isinstance(text, str) for text in texts):
        raise place.error(f"{_shown(value)}: expected a {'list of texts' if several else 'text'}")


def _check_quoted(quoted: Table, figures: Table, here: Place) -> None:
    for kind, numbers in quoted.items():
        for number in numbers:
            key, dot, place = number.partition(".")
            if key not in figures or (dot and place not in PLACES):
                such = next(iter(figures))
                raise here.at(kind).error(
                    f"'{number}' is no number of this class: expected a key that has a figure, such as"
                    f" {such}, or a number of it, such as {such}.high"
                )


def _check_table(value: object, place: Place) -> Table:
    if not isinstance(value, dict):
        raise place.error(f"{_shown(value)}: expected a table")
    return value


def _check_present(needed: Iterable[str], table: Table, place: Place) -> None:
    if missing := [key for key in needed if key not in table]:
        raise place.error(
            f"there is no {', '.join(missing)}: state it, or say like = "
            '"a class of the catalogue" to take over what is not stated'
        )


def _refuse_unknown(table: Table, known: Iterable[str], place: Place) -> None:
    expected = tuple(known)
    for key in table:
        if key not in expected:
            raise place.error(f"'{key}' is not a key here: {hint(key, expected)}")


def _is_number(value: object) -> bool:
    """Whether a value is a finite number; a whole number of TOML may be beyond any float."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _HUGE


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
