"""Ranges of the catalogue's scenes: how large force, rate and vibration get, how warm, how long."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Any

from imubayes import units
from imubayes.errors import TermError
from imubayes.sensors.catalogue_file import packaged_tables

Ends = tuple[float, float]

BAND = (20.0, 2000.0)
"""Hz; of vibration where the catalogue gives no band: the usual one of random-vibration tests."""


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges of a scene of the catalogue, (low, high), SI.

    `load` is the specific force, `rate` and `slope` are sizes of w and dw/dt, `vibration` is an rms, its
    `band` in Hz; `warming` is the largest rate of the temperature; `note` is what the catalogue says beside.
    """

    id: str
    load: Ends
    rate: Ends
    slope: Ends
    vibration: Ends
    band: Ends
    temperature: Ends
    warming: float
    duration: Ends
    note: str = ""


_KEYS: Mapping[str, tuple[str, str, str]] = {
    # key in the catalogue, its unit, what it measures
    "load": ("f_g", "g", "m/s^2"), "rate": ("w_dps", "deg/s", "rad/s"),
    "slope": ("wd_dps2", "deg/s^2", "rad/s^2"), "vibration": ("vib_grms", "g", "m/s^2"),
    "band": ("vib_Hz", "Hz", "Hz"), "temperature": ("T_C", "degC", "K"),
    "warming": ("Tdot_Cmin", "K/min", "K/s"), "duration": ("duration_s", "s", "s"),
}  # fmt: skip


def ranges_of(table: Mapping[str, Any]) -> Ranges:
    """Read a scene's table of the catalogue; units are in its keys (``f_g = [0, 3]``).

    Examples
    --------
    >>> sea = ranges_of({"id": "marine", "f_g": [0.8, 1.3], "w_dps": [0, 20], "wd_dps2": [0, 20],
    ...     "vib_grms": [0.01, 0.1], "T_C": [0, 45], "Tdot_Cmin": 0.5, "duration_s": [3600, 2592000]})
    >>> sea.temperature, round(sea.warming, 6)
    ((273.15, 318.15), 0.008333)
    """
    ends: dict[str, Any] = {"band": BAND}
    for name, (key, unit, like) in _KEYS.items():
        if key in table or name != "band":
            low, high = figure if isinstance(figure := table[key], Sequence) else (figure, figure)
            scale, zero = units.factor(unit, like), units.offset(unit, like)
            ends[name] = low * scale + zero, high * scale + zero
    ends["warming"] = ends["warming"][1]
    return Ranges(id=str(table["id"]), **ends, note="; ".join(_left_out(table)))


@cache
def catalogue_scenes() -> tuple[Ranges, ...]:
    """Scenes of the catalogue, in its order."""
    return tuple(ranges_of(table) for table in packaged_tables()["scene"])


def _left_out(table: Mapping[str, Any]) -> Iterator[str]:
    """What the catalogue says of a scene that a trajectory does not hold."""
    if "shock_g" in table:
        figure = table["shock_g"]
        worst = max(figure) if isinstance(figure, Sequence) else figure
        yield f"shocks of up to {worst:,} g are not in it"
    if "note" in table:
        yield str(table["note"])


ALIASES = {"uav_hover": "quadrotor"}
"""Other names of scenes."""


def scene_named(name: str) -> Ranges:
    """Find a scene of the catalogue by its name; a dash counts as an underscore.

    Raises
    ------
    TermError : if there is none; names those that are spelled alike.
    """
    by_id = {one.id: one for one in catalogue_scenes()}
    wanted = name.replace("-", "_")
    wanted = ALIASES.get(wanted, wanted)
    if wanted in by_id:
        return by_id[wanted]
    near = get_close_matches(wanted, by_id)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(by_id)}"
    raise TermError(f"scene '{name}' is not in the catalogue: {hint}; a log of your own goes in with 'file'")
