"""Dwells in an order of one's own: a procedure's positions, levels or rates as somebody chose them.

For a person at the bench each is said in words: how the case is mounted, and what the rig then does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError
from imubayes.rig.inputs import Inputs
from imubayes.rig.motion import motion_of
from imubayes.rig.plans import Plan, angles_turned, samples, turned_on_earth
from imubayes.rig.tumbles import free_tumble, held_in_turn
from imubayes.units import STANDARD_GRAVITY, Key, NumberLimits, Pause, Seconds

USUAL_RATE = 10.0
"""Samples per second where none are given, as in the procedures."""

USUAL_IN_HAND = 100.0
"""The same in the hand."""

OF_STEPS = frozenset({"dwell", "settle", "ramp"})
"""Arguments of a procedure that steps say themselves."""


@dataclass(frozen=True, slots=True)
class Dwell:
    """One dwell of a sequence."""

    at: Annotated[
        int,
        NumberLimits(ge=0, strict=True),
        Key("which of the procedure's dwells, counted from 0, mount by mount", 3),
    ]
    dwell: Annotated[Seconds, Key("recorded time", "1 min")]
    pause: Annotated[Pause, Key("before it, not recorded: to settle, or to mount the case anew", "5 min")] = (
        0.0
    )


def planned(profile: Callable[..., Plan], options: Mapping[str, Any]) -> Plan:
    """Plan of a procedure by its function and arguments; an `InputError` if these make no run.

    With ``steps`` among them, the fields of a `Dwell` each, in the order that they say.
    """
    given = {key: value for key, value in options.items() if key != "steps"}
    if "steps" not in options:
        return profile(**given)
    if clash := sorted(OF_STEPS & given.keys()):
        raise InputError(f"{' and '.join(clash)} beside steps, which say it dwell by dwell: leave it out")
    steps, menu = [Dwell(**step) for step in options["steps"]], menu_of(profile, given)
    if profile is free_tumble:
        # stills in an order of one's own: the pause before each is the turn to it, and is recorded
        _check(menu, steps)
        f = menu.inputs.vectors("f")[[step.at for step in steps]]
        dwell, pause = (np.array([getattr(step, name) for step in steps]) for name in ("dwell", "pause"))
        rate = given.get("rate", USUAL_IN_HAND)
        return replace(menu, inputs=held_in_turn(f, dwell, pause[1:], rate))
    return in_order(menu, steps, rate=given.get("rate", USUAL_RATE))


def menu_of(profile: Callable[..., Plan], options: Mapping[str, Any]) -> Plan:
    """Plan of a procedure with one sample in each dwell; an `InputError` if the arguments make no run.

    What they say of times does not count.
    """
    return profile(**{**options, "dwell": 1.0, "rate": 1.0, "settle": 0.0})


def in_order(menu: Plan, steps: Sequence[Dwell], *, rate: float) -> Plan:
    """Plan that goes through dwells of a procedure in the order of steps; any may come often, or never.

    Of the `menu`, the procedure, each dwell has one sample; the plan takes `rate` samples a second. A pause
    before the first step is no part of the record. A mount that is come back to is a new mount, for the case
    does not come back to the same place. It is an `InputError` if there are no steps, the procedure has no
    such dwell, or a pause is no time.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> menu = tumble(angles=4, planes=1, dwell=1.0, rate=1.0, settle=0.0)
    >>> run = in_order(menu, [Dwell(2, 2.0), Dwell(0, 1.0, 60.0)], rate=1.0).inputs
    >>> run.t.tolist(), (run.channels["f_i"] / 9.80665).tolist()
    ([0.0, 1.0, 62.0], [-1.0, -1.0, 1.0])
    """
    _check(menu, steps)
    within = [samples(step.dwell, rate) for step in steps]
    begin = np.cumsum([0.0, *(a.dwell + b.pause for a, b in pairwise(steps))])
    counts = [len(t) for t in within]
    where = np.array([step.at for step in steps])
    visits = np.concatenate(([0], np.cumsum(np.diff(menu.inputs.mounts[where]) != 0)))
    rows = np.repeat(where, counts)
    inputs = Inputs(
        t=np.concatenate([start + t for start, t in zip(begin.tolist(), within, strict=True)]),
        channels={name: values[rows] for name, values in menu.inputs.channels.items()},
        interval=1.0 / rate,
        mount=np.repeat(visits, counts),
    )
    plan = Plan(menu.name, menu.procedure, inputs)
    if menu.turn is None:
        return plan
    # where the case heads on a table that turns depends on the order and the times
    pace = menu.turn.rate[rows]
    angle = angles_turned(inputs.t, pace, inputs.mounts)
    turn = replace(menu.turn, up=menu.turn.up[rows], rate=pace, angle=angle)
    return replace(plan, inputs=turned_on_earth(inputs, turn), turn=turn)


def _check(menu: Plan, steps: Sequence[Dwell]) -> None:
    most = len(menu.inputs) - 1
    if not steps:
        raise InputError("steps are empty: expected at least one, such as { at = 0, dwell = '60 s' }")
    for k, step in enumerate(steps):
        if not 0 <= step.at <= most:
            raise InputError(f"step {k} is at {step.at}: the procedure has dwells 0 to {most}")
        if not 0.0 <= step.pause < math.inf:
            raise InputError(f"step {k} has a pause of {step.pause} s: expected 0 or more")


ALIKE = 1e-6
"""Difference of two components of a direction that is rounding."""

PLANES = ("i-j", "i-k", "j-k")
"""Planes of a tumble, in its order: the first axis is up at 0 deg, the second one at 90 deg."""


Setting = tuple[str, str]
"""One dwell of a procedure, in words: how the case is mounted, and what the rig is set to."""


def settings_of(menu: Plan, options: Mapping[str, Any]) -> tuple[Setting, ...]:
    """Words for each dwell of a procedure, with one sample in each, of some profile and arguments.

    Examples
    --------
    >>> from imubayes.rig.rotations import centrifuge
    >>> from imubayes.rig.tumbles import tumble
    >>> options = {"profile": "tumble", "angles": 4, "planes": 1}
    >>> plan = tumble(angles=4, planes=1, dwell=1.0, rate=1.0)
    >>> settings_of(plan, options)[1]
    ('plane i-j', '90 deg')
    >>> settings_of(centrifuge([5.0], mounts=1, dwell=1.0, rate=1.0), {"profile": "centrifuge"})
    (('i outward, j up', '5 g'),)
    """
    inputs, profile = menu.inputs, options["profile"]
    zero = np.zeros((len(inputs), 3))
    m = motion_of(inputs.channels, zero, zero, turning=profile == "centrifuge")
    if profile == "tumble":
        angles = options.get("angles", 24)
        turns = [divmod(k, angles) for k in range(len(inputs))]
        return tuple((f"plane {PLANES[p]}", f"{360.0 * k / angles:g} deg") for p, k in turns)
    if menu.turn is not None:
        ways = zip(menu.turn.up, np.degrees(menu.turn.rate), strict=True)
        return tuple((f"{direction(up)} up", f"{w:+.4g} deg/s") for up, w in ways)
    if profile == "centrifuge":
        levels = np.linalg.norm(m.across, axis=1) / STANDARD_GRAVITY
        ways = zip(-m.across, m.up, levels, strict=True)
        return tuple((f"{direction(out)} outward, {direction(up)} up", f"{n:.4g} g") for out, up, n in ways)
    return tuple(("", f"{direction(up)} up") for up in m.f)


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
