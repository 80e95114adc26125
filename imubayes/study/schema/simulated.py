"""Shapes of the ``simulate`` tables: the options of each profile of a simulated run."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as shape

from imubayes import units
from imubayes.study.schema.measured import (
    STRICT,
    Acceleration,
    Angle,
    Count,
    Gravity,
    Hertz,
    Kelvin,
    Metres,
    Ramp,
    Rate,
    Seconds,
    Settle,
    Several,
)


def _in_g(levels: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(level / units.STANDARD_GRAVITY for level in levels)


@shape(config=ConfigDict(extra="forbid"), frozen=True)
class StepOptions:
    """A dwell of ``steps``: which of the procedure's dwells, for how long, and the pause before it."""

    at: Annotated[int, Field(ge=0, strict=True)]
    dwell: Seconds
    pause: Settle = 0.0


Steps = Annotated[tuple[StepOptions, ...] | None, Several]


@shape(config=STRICT, frozen=True)
class StaticOptions:
    """``simulate`` of a static log."""

    duration: Seconds
    rate: Hertz
    up: Annotated[tuple[float, float, float] | None, Several] = None
    gravity: Gravity | None = None
    latitude: Angle | None = None
    north: Annotated[tuple[float, float, float] | None, Several] = None


@shape(config=STRICT, frozen=True)
class TumbleOptions:
    """``simulate`` of a tumble."""

    angles: Count | None = None
    planes: Count | None = None
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    gravity: Gravity | None = None
    latitude: Angle | None = None
    steps: Steps = None


@shape(config=STRICT, frozen=True)
class PositionsOptions:
    """``simulate`` of a standard set of positions."""

    positions: Count
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    gravity: Gravity | None = None
    latitude: Angle | None = None
    steps: Steps = None


@shape(config=STRICT, frozen=True)
class RateTableOptions:
    """``simulate`` of a rate table."""

    rates: Annotated[tuple[Rate, ...], Several]
    mounts: Count | None = None
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    latitude: Angle | None = None
    radius: Metres | None = None
    steps: Steps = None


@shape(config=STRICT, frozen=True)
class OscillationOptions:
    """``simulate`` of an oscillating table."""

    frequencies: Annotated[tuple[Hertz, ...], Several]
    amplitude: Angle | None = None
    mounts: Count | None = None
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    latitude: Angle | None = None
    radius: Metres | None = None


@shape(config=STRICT, frozen=True)
class CentrifugeOptions:
    """``simulate`` of a centrifuge."""

    levels: Annotated[tuple[Acceleration, ...], Several, AfterValidator(_in_g)]
    mounts: Count | None = None
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    arm: Metres | None = None
    ramp: bool | None = None
    steps: Steps = None


@shape(config=STRICT, frozen=True)
class VibrationOptions:
    """``simulate`` of vibration on a shaker."""

    levels: Annotated[tuple[Acceleration, ...], Several, AfterValidator(_in_g)]
    mounts: Count | None = None
    dwell: Seconds | None = None
    rate: Hertz | None = None
    settle: Settle | None = None
    band: Annotated[tuple[Hertz, Hertz] | None, Several] = None


@shape(config=STRICT, frozen=True)
class ThermalOptions:
    """``simulate`` of soaks and ramps."""

    temperatures: Annotated[tuple[Kelvin, ...], Several]
    positions: Count | None = None
    dwell: Seconds | None = None
    soak: Settle | None = None
    ramp: Ramp | None = None
    rate: Hertz | None = None
    turning: Rate | None = None


SIMULATED = {
    "static": StaticOptions,
    "tumble": TumbleOptions,
    "positions": PositionsOptions,
    "rate-table": RateTableOptions,
    "oscillation": OscillationOptions,
    "centrifuge": CentrifugeOptions,
    "vibration": VibrationOptions,
    "thermal": ThermalOptions,
}
"""Profiles that can be simulated, with the shape of their options."""

CALLED = {"positions": "tumble", "vibration": "other"}
"""What a study calls the profiles that have no procedure of their own."""
