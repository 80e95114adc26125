"""How the axes of a case lie, as it is printed: rotations and non-orthogonality of its triads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from imubayes.reporting.rounding import Measured, measured, per_unit

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult

UNIT = "urad"

HIDDEN = 2.0
"""A misalignment that is so much less certain than the angles between axes has something else in it: two
misalignments that are each known make an angle that is known less well than either."""

HEADS = {
    "accelerometer": "accelerometers",
    "gyroscope": "gyroscopes",
    "gyroscopes against accelerometers": "gyroscopes less accelerometers",
}
"""Columns of the table, by what an angle is of."""


@dataclass(frozen=True, slots=True)
class AngleTable:
    """Angles of the triads of a case.

    Attributes
    ----------
    heads : of the columns.
    rows : angle in words, and its value in each column; None where a column has no such angle.
    sentences : what they say.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Measured | None, ...]], ...]
    sentences: tuple[str, ...]


def angle_table(sensors: Sequence[SensorResult]) -> AngleTable | None:
    """Angles of a case's triads; None where directions were not known.

    Parameters
    ----------
    sensors : components of the case.
    """
    calibration: Mapping[str, Any] = sensors[0].calibration or {}
    angles = calibration.get("angles", [])
    if not angles:
        return None
    columns = list(dict.fromkeys(angle["of"] for angle in angles))
    by_place = {(angle["name"], angle["of"]): angle for angle in angles}
    names = dict.fromkeys(angle["name"] for angle in angles)
    rows = tuple((_text(name), tuple(_cell(by_place.get((name, of))) for of in columns)) for name in names)
    return AngleTable(tuple(HEADS[of] for of in columns), rows, tuple(_sentences(sensors, angles)))


def _cell(angle: Mapping[str, Any] | None) -> Measured | None:
    if angle is None:
        return None
    unit = per_unit(UNIT, "rad")
    return measured(angle["mean"] / unit, angle["sd"] / unit, UNIT)


def _text(name: str) -> str:
    """Angle in words.

    Examples
    --------
    >>> _text("rotation_x"), _text("nonorthogonality_xy")
    ('rotation about x', 'non-orthogonality of x and y')
    """
    what, _, axes = name.partition("_")
    return f"rotation about {axes}" if what == "rotation" else f"non-orthogonality of {axes[0]} and {axes[1]}"


def _sentences(sensors: Sequence[SensorResult], angles: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for kind in dict.fromkeys(sensor.kind for sensor in sensors):
        known = [a["sd"] for a in angles if a["of"] == kind and a["name"].startswith("nonorthogonality")]
        terms = [t for sensor in sensors if sensor.kind == kind for t in sensor.selection.terms]
        single = [term.full_sd for term in terms if term.name in ("m_j", "m_k")]
        if known and single:
            yield _sentence(f"{kind}s", max(known), max(single))


def _sentence(who: str, between: float, single: float) -> str:
    a, b = (_size(value) for value in (between, single))
    if single > HIDDEN * between:
        return (
            f"The angles between the axes of the {who} are known to {a} {UNIT}, their misalignments against"
            f" the case to {b} {UNIT}: how the case as a whole lay in its fixture is known no better."
        )
    return (
        f"The angles between the axes of the {who} are known to {a} {UNIT}, and their misalignments against"
        f" the case to {b} {UNIT}: their rotation as a whole is known about as well."
    )


def _size(value: float) -> str:
    return measured(value / per_unit(UNIT, "rad"), 0.0).value
