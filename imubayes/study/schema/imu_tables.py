"""``kind = "imu"``: one ``[[sensor]]`` table that speaks of accelerometers and gyroscopes at once."""

from __future__ import annotations

from typing import Any

from imubayes.rig.reference import OFFSET
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.terms import Kind
from imubayes.study.schema.shapes import Place, hint
from imubayes.study.schema.tables import SensorTable

KINDS_OF_IMU: tuple[Kind, Kind] = ("accelerometer", "gyroscope")

APART = ("library", "prior")
"""Tables that an IMU has one of for each kind."""


def half(value: Any, kind: Kind, place: Place, *, imu: bool) -> tuple[Any, Place]:
    """What a key says of one kind: its own entry where the value is a table of both kinds.

    Parameters
    ----------
    value : of the key.
    kind : that is asked for.
    place : of the key.
    imu : whether the sensor is an IMU; of another one the value holds as it is.

    Returns
    -------
    (value, place) : an empty table where a table of both kinds does not have this one.

    Examples
    --------
    >>> half({"gyroscope": {"powers": 1}}, "gyroscope", Place("s.toml", "library"), imu=True)
    ({'powers': 1}, Place(file='s.toml', key='library.gyroscope'))
    >>> half("mems_tactical", "gyroscope", Place("s.toml", "class"), imu=True)[0]
    'mems_tactical'
    """
    if not imu or not isinstance(value, dict) or not value.keys() <= set(KINDS_OF_IMU):
        return value, place
    return value.get(kind, {} if value else value), place.at(kind)


def check_imu(table: SensorTable, place: Place) -> None:
    """Refuse what an IMU cannot have, and tables that do not say which kind they are for.

    Raises
    ------
    StudyError : naming the key.
    """
    _check_truth(table.truth, place.at("truth"))
    for name in APART:
        for key in getattr(table, name):
            if key not in KINDS_OF_IMU:
                raise (
                    place.at(name)
                    .at(key)
                    .error(
                        f"unknown key: expected [sensor.{name}.accelerometer] and [sensor.{name}.gyroscope]; "
                        f"{hint(key, KINDS_OF_IMU)}"
                    )
                )
    if isinstance(table.class_, dict) and set(table.class_) != set(KINDS_OF_IMU):
        raise place.at("class").error("expected one class, or { accelerometer = ..., gyroscope = ... }")
    if isinstance(table.reference.get(OFFSET), str):
        raise (
            place.at("reference")
            .at(OFFSET)
            .error(
                "accelerometers and gyroscopes have other units: expected"
                ' { accelerometer = "200 ug", gyroscope = "5 deg/h" }'
            )
        )
    if table.robust:
        raise place.at("robust").error("is not known for a whole IMU: leave it out")


def truths_of(raw: dict[str, Any], kind: Kind) -> dict[str, Any]:
    """Entries of an IMU's ``truth`` for the components of a kind, by component and term.

    Examples
    --------
    >>> truths_of({"ax": {"b0": "1 mg"}, "gx.b1": "30 ppm"}, "gyroscope")
    {'gx.b1': '30 ppm'}
    """
    return {name: value for name, value in _flat(raw).items() if kind_of(name.partition(".")[0]) == kind}


def without_component(name: str) -> str:
    """Term of a coefficient's name: ``b0`` of ``ax.b0`` and of ``b0``."""
    first, _, term = name.partition(".")
    return term if first in COMPONENTS else name


def _flat(raw: dict[str, Any]) -> dict[str, Any]:
    """Entries by component and term: TOML reads ``ax.b0 = ...`` as a table in a table."""
    flat: dict[str, Any] = {}
    for name, value in raw.items():
        flat |= (
            {f"{name}.{term}": one for term, one in value.items()}
            if isinstance(value, dict)
            else {name: value}
        )
    return flat


def _check_truth(raw: dict[str, Any], place: Place) -> None:
    """Refuse coefficients that do not say which component they are of."""
    for name in _flat(raw):
        if name.partition(".")[0] not in COMPONENTS or "." not in name:
            raise place.at(name).error(
                f"expected a component and its term, such as ax.b0; components are {', '.join(COMPONENTS)}"
            )
