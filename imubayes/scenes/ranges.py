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

    Attributes
    ----------
    id : in the catalogue.
    load : specific force, m/s^2.
    rate, slope : size of w, rad/s, and of dw/dt, rad/s^2.
    vibration : rms, m/s^2.
    band : of the vibration, Hz.
    temperature : K; `warming` is its largest rate, K/s.
    duration : s.
    note : what the catalogue says of the scene that is not in these.
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


def ranges_of(table: Mapping[str, Any]) -> Ranges:
    """Read a scene's table of the catalogue; units are in its keys (``f_g = [0, 3]``).

    Raises
    ------
    TermError : if a figure is missing, names the scene and the figure.

    Examples
    --------
    >>> sea = ranges_of({"id": "marine", "f_g": [0.8, 1.3], "w_dps": [0, 20], "wd_dps2": [0, 20],
    ...     "vib_grms": [0.01, 0.1], "T_C": [0, 45], "Tdot_Cmin": 0.5, "duration_s": [3600, 2592000]})
    >>> sea.temperature, round(sea.warming, 6)
    ((273.15, 318.15), 0.008333)
    """
    ends = {field: _ends(table, key) for field, (key, _, _) in _KEYS.items()}
    return Ranges(
        id=str(table["id"]),
        load=ends["load"],
        rate=ends["rate"],
        slope=ends["slope"],
        vibration=ends["vibration"],
        band=_ends(table, "vib_Hz") if "vib_Hz" in table else BAND,
        temperature=ends["temperature"],
        warming=ends["warming"][1],
        duration=ends["duration"],
        note="; ".join(_left_out(table)),
    )


@cache
def catalogue_scenes() -> tuple[Ranges, ...]:
    """Scenes of the catalogue, in its order.

    Examples
    --------
    >>> len(catalogue_scenes())
    15
    """
    return tuple(ranges_of(table) for table in packaged_tables()["scene"])


_KEYS: Mapping[str, tuple[str, str, str]] = {
    # key in the catalogue, its unit, what it measures
    "load": ("f_g", "g", "m/s^2"), "rate": ("w_dps", "deg/s", "rad/s"),
    "slope": ("wd_dps2", "deg/s^2", "rad/s^2"), "vibration": ("vib_grms", "g", "m/s^2"),
    "temperature": ("T_C", "degC", "K"), "warming": ("Tdot_Cmin", "K/min", "K/s"),
    "duration": ("duration_s", "s", "s"),
}  # fmt: skip


def _ends(table: Mapping[str, Any], key: str) -> Ends:
    """Lowest and highest value of a figure, SI; one number is both."""
    if key not in table:
        raise TermError(
            f"scene '{table.get('id', '')}' of the catalogue has no '{key}': expected [low, high]"
        )
    figure = table[key]
    low, high = figure if isinstance(figure, Sequence) else (figure, figure)
    unit, like = next(((unit, like) for name, unit, like in _KEYS.values() if name == key), ("Hz", "Hz"))
    scale, zero = units.factor(unit, like), units.offset(unit, like)
    return low * scale + zero, high * scale + zero


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
