"""``kind = "imu"``: one ``[[sensor]]`` table that speaks of accelerometers and gyroscopes at once."""

from __future__ import annotations

from typing import Any

from imubayes.config.shapes import Place, SensorTable, hint
from imubayes.sensors.terms import Kind

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
    if table.truth:
        raise place.at("truth").error("a run of a whole IMU cannot be simulated: leave it out")
    if table.robust:
        raise place.at("robust").error("is not known for a whole IMU: leave it out")
