"""What a person at the bench sets, in words: how the case is mounted, and what the rig then does."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.motion import motion_of
from imubayes.rig.plans import Plan
from imubayes.units import STANDARD_GRAVITY

ALIKE = 1e-6
"""Difference of two components of a direction that is rounding."""

PLANES = ("i-j", "i-k", "j-k")
"""Planes of a tumble, in its order: the first axis is up at 0 deg, the second one at 90 deg."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One dwell of a procedure, in words.

    Attributes
    ----------
    mount : how the case is mounted.
    at : what the rig is set to.
    """

    mount: str
    at: str


def settings_of(menu: Plan, options: Mapping[str, Any]) -> tuple[Setting, ...]:
    """Words for each dwell of a procedure.

    Parameters
    ----------
    menu : the procedure with one sample in each dwell.
    options : its profile and arguments.

    Examples
    --------
    >>> from imubayes.rig.rotations import centrifuge
    >>> from imubayes.rig.tumbles import tumble
    >>> options = {"profile": "tumble", "angles": 4, "planes": 1}
    >>> plan = tumble(angles=4, planes=1, dwell=1.0, rate=1.0)
    >>> settings_of(plan, options)[1]
    Setting(mount='plane i-j', at='90 deg')
    >>> settings_of(centrifuge([5.0], mounts=1, dwell=1.0, rate=1.0), {"profile": "centrifuge"})
    (Setting(mount='i outward, j up', at='5 g'),)
    """
    inputs, profile = menu.inputs, options["profile"]
    zero = np.zeros((len(inputs), 3))
    m = motion_of(inputs.channels, zero, zero, turning=profile == "centrifuge")
    if profile == "tumble":
        angles = options.get("angles", 24)
        turns = [divmod(k, angles) for k in range(len(inputs))]
        return tuple(Setting(f"plane {PLANES[p]}", f"{360.0 * k / angles:g} deg") for p, k in turns)
    if menu.turn is not None:
        ways = zip(menu.turn.up, np.degrees(menu.turn.rate), strict=True)
        return tuple(Setting(f"{direction(up)} up", f"{w:+.4g} deg/s") for up, w in ways)
    if profile == "centrifuge":
        levels = np.linalg.norm(m.across, axis=1) / STANDARD_GRAVITY
        ways = zip(-m.across, m.up, levels, strict=True)
        return tuple(
            Setting(f"{direction(out)} outward, {direction(up)} up", f"{n:.4g} g") for out, up, n in ways
        )
    return tuple(Setting("", f"{direction(up)} up") for up in m.f)


def direction(v: FloatArray) -> str:
    """Direction (3,) in case axes: by the axes that it halves, else by its components.

    Examples
    --------
    >>> direction(np.array([0.0, -2.0, 0.0])), direction(np.array([1.0, 0.0, -1.0]))
    ('-j', 'i-k')
    >>> direction(np.array([0.6, 0.8, 0.0]))
    '(0.600, 0.800, 0.000)'
    """
    length = math.sqrt(float(v @ v))
    if length == 0.0:
        return "nothing"
    u = np.where(np.abs(v) < ALIKE * length, 0.0, v / length)
    sizes = np.abs(u[u != 0.0])
    if np.ptp(sizes) > ALIKE:
        return f"({', '.join(f'{x:.3f}' for x in u)})"
    text = "".join(f"{'-' if x < 0.0 else '+'}{axis}" for x, axis in zip(u, "ijk", strict=True) if x)
    return text.removeprefix("+")
