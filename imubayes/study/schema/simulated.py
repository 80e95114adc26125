"""Shapes of the ``simulate`` tables: the arguments of each profile's function, as a study gives them."""

from __future__ import annotations

import inspect
import math
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass as shape

from imubayes import units
from imubayes.rig.runs import PROFILES
from imubayes.study.schema.measured import (
    STRICT,
    Acceleration,
    Angle,
    Count,
    Gravity,
    Hertz,
    Kelvin,
    Metres,
    Quantity,
    Ramp,
    Rate,
    Seconds,
    Settle,
    Several,
    key,
)


def _in_g(levels: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(level / units.STANDARD_GRAVITY for level in levels)


@shape(config=ConfigDict(extra="forbid"), frozen=True, kw_only=True)
class StepOptions:
    """``steps``: which of the procedure's dwells, for how long, and the pause before it."""

    at: Annotated[int, Field(ge=0, strict=True)] = key(
        "which of the procedure's dwells, counted from 0, mount by mount", 3
    )
    dwell: Seconds = key("recorded time", "1 min")
    pause: Settle = key("before it, not recorded: to settle, or to mount the case anew", "5 min", "0 s")


_Levels = Annotated[tuple[Acceleration, ...], Several, AfterValidator(_in_g)]
_Direction = Annotated[tuple[float, float, float], Several]

_CUBE = "the first of i, -i, j, -j, k, -k up, then halfway between i-j, i-k, j-k"
_EARTH = "north positive; puts the Earth's rate into `w_i w_j w_k`"

_OPTIONS: dict[str, tuple[Any, str, Any]] = {
    "dwell": (Seconds, "recorded time at a step", "1 min"),
    "rate": (Hertz, "samples a second", "1 Hz"),
    "settle": (Settle, "between steps, not recorded", "20 s"),
    "gravity": (Gravity, "local gravity", "9.81 m/s^2"),
    "latitude": (Angle, _EARTH, "48.1 deg"),
    "radius": (Metres, "of the sensing point from the axis", "2 cm"),
    "mounts": (Count, _CUBE, 6),
    "steps": (
        Annotated[tuple[StepOptions, ...], Several],
        "the dwells in an order and with times of their own, see `steps`",
        [{"at": 1, "dwell": "1 min"}],
    ),
    "static duration": (Seconds, "of the log", "2 h"),
    "static up": (_Direction, "vertical in case axes i, j, k, any length", [0, 0, 1]),
    "static north": (
        _Direction,
        "in case axes; only its horizontal part counts, and only with a `latitude`; without it along the"
        " first axis most across the vertical",
        [0, 1, 0],
    ),
    "tumble angles": (Count, "equal steps of a turn in each plane", 36),
    "tumble planes": (Count, "the first of i-j, i-k, j-k", 2),
    "tumble latitude": (
        Angle, f"{_EARTH}. A gyroscope feels it; the axis of the table lies level to the north", "48.1 deg"
    ),
    "positions positions": (Count, "which set: 4, 6, 12, 24 or 26", 26),
    "rate-table rates": (
        Annotated[tuple[Rate, ...], Several],
        "table rates, counter-clockwise from above positive",
        ["-100 deg/s", "100 deg/s"],
    ),
    "oscillation frequencies": (
        Annotated[tuple[Hertz, ...], Several], "one dwell at each", ["1 Hz", "5 Hz"]
    ),
    "oscillation amplitude": (Angle, "A", "0.5 deg"),
    "oscillation rate": (Hertz, "samples a second, 8 a period or more", "200 Hz"),
    "centrifuge levels": (_Levels, "centripetal accelerations", ["1 g", "5 g", "20 g"]),
    "centrifuge mounts": (
        Count,
        "the first of: i outward and inward with j and with k up, i along the motion both ways, two at 45"
        " degrees, four tilted",
        4,
    ),
    "centrifuge arm": (Metres, "radius", "2.5 m"),
    "centrifuge ramp": (bool, "records the changes of level too (constant dw/dt over `settle`)", True),
    "vibration levels": (_Levels, "rms along the shaken direction; 0 is at rest", ["0 g", "2 g", "5 g"]),
    "vibration mounts": (
        Count,
        "the first of: shaken along i with i, -i and j up, along j with k up, along k with j up, halfway"
        " between i-j with k up, i-k with j up, j-k with i up",
        3,
    ),
    "vibration rate": (Hertz, "samples a second, 2.56 times the band's upper end or more", "2 kHz"),
    "vibration band": (
        Annotated[tuple[Hertz, Hertz], Several], "lowest and highest frequency", ["20 Hz", "100 Hz"]
    ),
    "thermal temperatures": (
        Annotated[tuple[Kelvin, ...], Several],
        "of the soaks, in order; up and down again shows hysteresis",
        ["-20 degC", "60 degC", "-20 degC"],
    ),
    "thermal positions": (Count, _CUBE, 2),
    "thermal dwell": (Seconds, "time in each position", "30 s"),
    "thermal soak": (Settle, "time at a temperature before the positions", "1 h"),
    "thermal ramp": (Ramp, "size of the rate between soaks", "3 degC/min"),
    "thermal turning": (
        Rate, "rate about the vertical in each position, which a gyroscope's `b1*T` needs", "60 deg/s"
    ),
}  # fmt: skip
"""Type, meaning and example of an argument, by its name, or by profile and name where it is another's."""

_STEPPED = ("tumble", "positions", "rate-table", "centrifuge")
"""Profiles whose dwells can be given one by one."""

_PRINTED = {
    "s": ("h", "min", "s"), "Hz": ("Hz",), "m/s^2": ("m/s^2",), "rad": ("deg",), "m": ("m",),
    "K/s": ("degC/min",), "rad/s": ("deg/s",),
}  # fmt: skip
"""Units that people use for the usual value of an argument, by the SI unit."""


def _written(value: Any, kind: Any) -> Any:
    """Value of a signature, in SI, as a study would have it."""
    if isinstance(value, tuple):
        return [_written(one, get_args(get_args(kind)[0])[0]) for one in value]
    like = next((one.like for one in get_args(kind)[1:] if isinstance(one, Quantity)), None)
    if like is None or value is None:
        return value
    sizes = {unit: value / units.factor(unit, like) for unit in _PRINTED[like]}
    whole = (unit for unit, size in sizes.items() if size > 0.5 and math.isclose(size, round(size)))
    unit = next(whole, _PRINTED[like][-1])
    return f"{sizes[unit]:.6g} {unit}"


def _options(profile: str) -> type:
    """Shape of the options of a profile: the arguments of its function."""
    fields: dict[str, Any] = {}
    kinds: dict[str, Any] = {}
    usual = {name: one.default for name, one in inspect.signature(PROFILES[profile]).parameters.items()}
    for name, default in (usual | ({"steps": None} if profile in _STEPPED else {})).items():
        kind, meaning, example = _OPTIONS.get(f"{profile} {name}") or _OPTIONS[name]
        if default is inspect.Parameter.empty or name == profile:  # that key alone tells of a standard set
            kinds[name], fields[name] = kind, key(meaning, example)
        else:
            kinds[name] = kind | None
            fields[name] = key(meaning, example, None, usual=_written(default, kind))
    made = type(f"{profile}-options", (), {"__annotations__": kinds, "__doc__": f"``{profile}``.", **fields})
    return shape(config=STRICT, frozen=True, kw_only=True)(made)


SIMULATED = {profile: _options(profile) for profile in PROFILES}
"""Profiles that can be simulated, with the shape of their options."""

CALLED = {"positions": "tumble", "vibration": "other"}
"""What a study calls the profiles that have no procedure of their own."""
