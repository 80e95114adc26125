"""Scenes of the catalogue: their ranges, and trajectories that are generated within these.

Construction, the same for every scene:

- roll, pitch and yaw are sums of two sinusoids with random phases, and a steady roll where the vehicle spins.
  What travels keeps its heading for a leg, and turns between two legs: twice to the left, twice to the right,
  so that no turn goes on for ever; on a leg all swings are a twentieth of what they are in a turn. Rate and
  angular acceleration follow from them by the kinematics of Euler angles, so that dw is the derivative of w
  and the vertical turns in the case as w says. One factor on time makes the larger of rate and angular
  acceleration, relative to its range, reach it;
- the load is a specific force within its range: along the vertical where the ground or water carries the
  case (gravity, and what is on top of it), along the case's own axis where lift, thrust or drag does. It
  swings about one g (none in free flight), grows while propellant burns, or rises and decays with drag;
  across it acts a tenth of the range;
- the force vibrates with the middle of the range of rms, Gaussian and independent along the three axes;
- temperature swings over its range, no faster than the scene's rate.

The axes are x forward, y left, z up. Rates do not vibrate. A mission longer than the rows that resolve its
motion repeats them; its temperature runs on. The rows themselves see the temperatures of the whole mission.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from typing import Any

import numpy as np

from imubayes import units
from imubayes.algebra import FloatArray
from imubayes.errors import TermError
from imubayes.rig.inputs import Inputs
from imubayes.scenes import BODY, Course, Scene, from_angles
from imubayes.sensors.catalogue_file import packaged_tables
from imubayes.units import STANDARD_GRAVITY

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
    by_id = {ranges.id: ranges for ranges in catalogue_scenes()}
    wanted = name.replace("-", "_")
    wanted = ALIASES.get(wanted, wanted)
    if wanted in by_id:
        return by_id[wanted]
    near = get_close_matches(wanted, by_id)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(by_id)}"
    raise TermError(f"scene '{name}' is not in the catalogue: {hint}; a log of your own goes in with 'file'")


FEWEST, MOST = 2_000, 30_000
"""Rows of a record."""

LONGEST = 20.0
"""s; most between two rows: Schuler's oscillation is followed."""

PER_TURN = 12.0
"""Rows in a period of the fastest motion."""

WITHIN = 0.9
"""Share of its range that the larger of rate and angular acceleration reaches, so that no seed exceeds it."""

SEARCHED = 4_000.0
"""Span, over the pulsation of the swings, that is searched for the largest rate: as long as a record."""

ACROSS = 0.1
"""Force across the load, over half of the load's range."""

KNOTS, MOST_KNOTS = 1_000, 200_000
"""Knots of the temperature in one of its swings, and in all: up to 200 swings are linear between knots to
5e-6 of half their range."""


@dataclass(frozen=True, slots=True)
class Legs:
    """Straight legs of so many seconds, and turns by an angle, rad, at a rate that grows to a peak, rad/s."""

    straight: float
    turn: float
    peak: float

    def heading(self, t: FloatArray) -> Derived:
        """Yaw (n,), rad, its rate and its acceleration at times t (n,), s.

        Examples
        --------
        >>> box = Legs(10.0, np.pi / 2.0, np.pi / 20.0)
        >>> np.degrees(box.heading(np.array([5.0, 20.0, 35.0, 65.0, 95.0]))[0]).round(6).tolist()
        [0.0, 45.0, 90.0, 180.0, 90.0]
        """
        lasting, leg, u = self._turned(t)
        number = leg.astype(int) % 4
        before, side = np.array([0.0, 1.0, 2.0, 1.0])[number], np.array([1.0, 1.0, -1.0, -1.0])[number]
        sine, cosine = np.sin(2.0 * math.pi * u), np.cos(2.0 * math.pi * u)
        return (
            self.turn * (before + side * (u - sine / (2.0 * math.pi))),
            side * 0.5 * self.peak * (1.0 - cosine),
            side * self.peak * math.pi / lasting * sine,
        )

    def swings(self, t: FloatArray) -> Derived:
        """Share (n,) of the swings at times t (n,), s, from `CALM` to 1, and its two derivatives by time."""
        lasting, _, u = self._turned(t)
        sine, cosine, k = np.sin(math.pi * u), np.cos(math.pi * u), 2 * SUDDEN
        here = (u > 0.0) & (u < 1.0)
        part, pulsation = 1.0 - CALM, math.pi / lasting
        slope = part * pulsation * k * cosine ** (k - 1) * sine
        bend = part * pulsation**2 * k * (cosine**k - (k - 1) * cosine ** (k - 2) * sine**2)
        return 1.0 - part * np.where(here, cosine**k, 1.0), slope * here, bend * here

    def _turned(self, t: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """How long a turn lasts, s, number of the leg (n,), and the share of its turn that is done (n,)."""
        lasting = 2.0 * self.turn / self.peak
        leg, into = np.divmod(t, self.straight + lasting)
        return lasting, leg, np.clip((into - self.straight) / lasting, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Manner:
    """How a scene moves.

    `swing` are the amplitudes of roll, pitch and yaw, rad, and `turn` their steady rates in the unit of time
    in which a swing has the pulsation `pace`. The `load` swings, burns or drags along the case's `axis`, or
    the vertical (``up``), about `rest`, in g; `sharp` is the power that makes its swings pulses. What travels
    has `legs`.
    """

    swing: tuple[float, float, float]
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pace: float = 1.0
    axis: str = "up"
    load: str = "swings"
    rest: float = 1.0
    sharp: float = 2.0
    legs: Legs | None = None


SHORTEST = 3.0
"""ln of the factor by which powers of the pulses are larger at most."""

CALM = 0.05
"""Share of the swings of a turn that is left on a leg."""

SUDDEN = 8
"""Power of the cosine by which swings begin and end with a turn: they are whole for most of it."""

STANDARD_RATE = math.radians(3.0)
"""rad/s; of an aircraft's turn under instrument flight rules."""

MANNERS: Mapping[str, Manner] = {
    "bench_static": Manner((0.0, 0.0, 0.0), turn=(0.0, 0.0, 1.0)),
    "pedestrian": Manner((0.3, 0.4, 0.6), sharp=4.0),
    "automotive": Manner((0.05, 0.05, 0.1), legs=Legs(30.0, 0.5 * math.pi, math.radians(30.0))),
    "quadrotor": Manner((0.5, 0.5, 0.5), axis="z"),
    "fixed_wing": Manner((0.8, 0.25, 0.2), axis="z", legs=Legs(300.0, 0.5 * math.pi, STANDARD_RATE)),
    "fighter": Manner((2.0, 0.5, 0.3), axis="z", legs=Legs(60.0, math.pi, math.radians(20.0))),
    "helicopter": Manner((0.3, 0.25, 0.4), axis="z", legs=Legs(60.0, 0.5 * math.pi, STANDARD_RATE)),
    "marine": Manner((0.4, 0.12, 0.1), legs=Legs(1800.0, 0.5 * math.pi, math.radians(1.5))),
    "planing_craft": Manner((0.2, 0.25, 0.1), sharp=8.0, legs=Legs(120.0, 0.5 * math.pi, math.radians(5.0))),
    "missile_boost": Manner((1.0, 0.15, 0.15), axis="x", load="burns"),
    "launch_vehicle": Manner((0.05, 0.1, 0.05), axis="x", load="burns"),
    "gun_projectile": Manner((2.0, 0.03, 0.03), turn=(1.0, 0.0, 0.0), pace=0.05, axis="x", rest=0.0),
    "reentry_spin": Manner((8.0, 0.1, 0.1), (1.0, 0.0, 0.0), pace=0.05, axis="x", load="drags", rest=0.0),
    "well_drilling": Manner((15.0, 0.02, 0.02), turn=(1.0, 0.0, 0.0), pace=0.05, sharp=4.0),
    "spacecraft": Manner((0.3, 0.3, 0.5), axis="x", rest=0.0, sharp=8.0),
}  # fmt: skip
"""Manner of each scene: amplitudes are orders of magnitude, the ranges come from the catalogue.

Legs are orders of magnitude too. Aircraft turn at the standard rate of 3 deg/s (FAA-H-8083-15B, chapter 5),
a helicopter after the minute of a leg in a holding pattern (chapter 10). A ship of 200 m at 15 kn that turns
within four and a half lengths (IMO MSC.137(76), 5.3.1) takes two minutes for a quarter: 1.5 deg/s at its
peak. A car takes six seconds for a corner, a fighter twenty for half a circle.
"""


def drawn(ranges: Ranges, seeds: Sequence[Sequence[int]], *, duration: float | None = None) -> Scene:
    """Generate several draws of a scene: other phases, the same ranges. Takes what `generated` takes.

    Examples
    --------
    >>> hover = drawn(scene_named("quadrotor"), [(1, 1), (1, 2), (1, 3)], duration=60.0)
    >>> len(hover.draws), hover.notes[-1]
    (3, 'the largest error of 3 draws counts, of the output the rms over all of them')
    """
    first, *others = (generated(ranges, np.random.default_rng(seed), duration=duration) for seed in seeds)
    if not others:
        return first
    counting = f"the largest error of {1 + len(others)} draws counts, of the output the rms over all of them"
    return replace(first, others=tuple(others), notes=(*first.notes, counting))


def generated(ranges: Ranges, rng: np.random.Generator, *, duration: float | None = None) -> Scene:
    """Generate a scene of the catalogue; without a duration, s, it lasts the geometric mean of its range.

    Examples
    --------
    >>> sea = generated(scene_named("marine"), np.random.default_rng(1), duration=3600.0)
    >>> bool(np.abs(sea.mean_motion.channels["w_i"]).max() < np.radians(20.0))
    True
    """
    manner = MANNERS[ranges.id]
    lasting = math.sqrt(ranges.duration[0] * ranges.duration[1]) if duration is None else duration
    waves = _waves(rng)
    pace, t = _timing(ranges, manner, waves, lasting)
    w, dw, attitude, lively = _turning(pace * t, manner, waves, pace)
    channels = {f"w_{a}": pace * w[c] for c, a in enumerate(BODY)}
    channels |= {f"dw_{a}": pace**2 * dw[c] for c, a in enumerate(BODY)}
    channels |= _heat(ranges, t * lasting / (t[-1] + t[1]))
    force = _force(ranges, manner, (attitude[:, 2].T, lively), (pace * t, t / (t[-1] + t[1])), waves)
    # scene of a motion and a force (3, n), with the vibration that each row happens to meet
    slow = Inputs(t, channels, float(t[1]))
    rms = 0.5 * (ranges.vibration[0] + ranges.vibration[1])
    shaken = force + rms * rng.standard_normal(force.shape)
    forces = ({f"f_{a}": values[c] for c, a in enumerate(BODY)} for values in (force, shaken))
    smooth, rough = (Inputs(slow.t, {**one, **slow.channels}, slow.interval) for one in forces)
    repeats = lasting / (len(slow) * slow.interval)
    notes = [f"generated within the catalogue's ranges; vibration {rms / STANDARD_GRAVITY:.3g} g rms"]
    if repeats > 1.001:
        notes.append(f"a record of {len(slow) * slow.interval:.3g} s, repeated {repeats:.3g} times")
    if ranges.note:
        notes.append(ranges.note)
    scene = Scene(ranges.id, rough, lasting, rms, ranges.band, smooth, tuple(notes))
    swings = _swinging(ranges) * lasting / (2.0 * math.pi)
    knots = np.linspace(0.0, lasting, min(2 + math.ceil(KNOTS * swings), MOST_KNOTS))
    return replace(scene, attitude=attitude, course=Course(knots, _heat(ranges, knots)))


Derived = tuple[FloatArray, FloatArray, FloatArray]
"""A value (n,), its first and its second derivative."""

Waves = Callable[[int, FloatArray, float], Derived]
"""Wave between -1 and 1 at times tau (n,), by its row (roll, pitch, yaw, the load along and across), and its
pulsation."""


def _waves(rng: np.random.Generator) -> Waves:
    """Sums of two sinusoids of random pulsations and phases."""
    pulsation = np.column_stack((rng.uniform(0.8, 1.2, 6), rng.uniform(1.5, 1.9, 6)))
    phase, share = rng.uniform(0.0, 2.0 * math.pi, (6, 2)), np.array([2.0, 1.0])[:, None] / 3.0

    def wave(row: int, tau: FloatArray, pace: float) -> Derived:
        nu = pace * pulsation[row][:, None]
        angle = nu * tau + phase[row][:, None]
        return (
            (share * np.sin(angle)).sum(axis=0),
            (share * nu * np.cos(angle)).sum(axis=0),
            -(share * nu**2 * np.sin(angle)).sum(axis=0),
        )

    return wave


def _turning(
    tau: FloatArray, manner: Manner, waves: Waves, pace: float = math.inf
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Kinematics of yaw, pitch and roll, in this order, about z, y and x; legs take their time in seconds.

    They are rate and its derivative (3, n) along x, y, z per unit of tau, attitude (n, 3, 3), and the share
    (n,) of swings.
    """
    angle, rate, slope = np.zeros((3, 3, len(tau)))
    heading, (part, grows, bends) = np.zeros((3, 1)), np.array([[1.0], [0.0], [0.0]])
    if manner.legs is not None and not math.isinf(pace):  # each with two derivatives by tau
        t, scale = tau / pace, pace ** -np.arange(3.0)[:, None]
        heading = scale * np.array(manner.legs.heading(t))
        part, grows, bends = scale * np.array(manner.legs.swings(t))
    for row in range(3):
        value, first, second = waves(row, tau, manner.pace)
        angle[row] = manner.turn[row] * tau + manner.swing[row] * part * value
        rate[row] = manner.turn[row] + manner.swing[row] * (part * first + grows * value)
        slope[row] = manner.swing[row] * (part * second + 2.0 * grows * first + bends * value)
    angle[2], rate[2], slope[2] = (
        mine + legs for mine, legs in zip((angle[2], rate[2], slope[2]), heading, strict=True)
    )
    (c_r, c_p, _), (s_r, s_p, _) = np.cos(angle), np.sin(angle)
    (roll, pitch, yaw), (ddr, ddp, ddy) = rate, slope
    attitude = from_angles(*angle)
    up = attitude[:, 2].T
    d_up = np.array(
        [-c_p * pitch, c_r * c_p * roll - s_r * s_p * pitch, -s_r * c_p * roll - c_r * s_p * pitch]
    )
    w = yaw * up + np.array([roll, pitch * c_r, -pitch * s_r])
    dw = ddy * up + yaw * d_up
    dw += np.array([ddr, ddp * c_r - pitch * roll * s_r, -ddp * s_r - pitch * roll * c_r])
    return w, dw, attitude, part


def _timing(ranges: Ranges, manner: Manner, waves: Waves, lasting: float) -> tuple[float, FloatArray]:
    """Pace in rad/s, at which rate and angular acceleration stay within their ranges, and times (n,)."""
    tau = np.linspace(0.0, SEARCHED / manner.pace, 60_001)
    w, dw = (float(np.linalg.norm(v, axis=0).max()) for v in _turning(tau, manner, waves)[:2])
    pace = (ranges.rate[1] - (manner.legs.peak if manner.legs else 0.0)) / w
    if dw > 0.0:
        pace = min(WITHIN * pace, math.sqrt(WITHIN * ranges.slope[1] / dw))
    fastest = max(w, 2.0 * manner.pace * manner.sharp)
    resolved = 2.0 * math.pi / (PER_TURN * fastest * pace)
    step = min(resolved, lasting / FEWEST, LONGEST)
    times = np.arange(min(round(lasting / step), MOST), dtype=np.float64)
    return pace, step * times


def _force(
    ranges: Ranges,
    manner: Manner,
    motion: tuple[FloatArray, FloatArray],
    clock: tuple[FloatArray, FloatArray],
    waves: Waves,
) -> FloatArray:
    """Specific force (3, n), m/s^2.

    The `motion` is the vertical in the case (3, n) and the share (n,) of swings, the `clock` tau (n,) and the
    share (n,) of the record that has passed. What rests at 1 g neither climbs nor falls all the time: upwards
    it is g on average. Where the range reaches farther from 1 g on one side, the swings to that side are
    shorter.
    """
    from scipy.optimize import root_scalar

    (up, lively), (tau, passed) = motion, clock
    main = 2 if manner.axis == "up" else "xyz".index(manner.axis)
    axis = up if manner.axis == "up" else np.eye(3)[main][:, None]
    half = 0.5 * (ranges.load[1] - ranges.load[0])
    across = np.zeros((3, len(tau)))
    for number, side in enumerate(a for a in range(3) if a != main):
        across[side] = ACROSS * half * lively * waves(4 + number, tau, manner.pace)[0]

    wave = waves(3, tau, manner.pace)[0]

    def force(shorter: float) -> FloatArray:
        return across + axis * _load(ranges, manner, wave, passed, lively, shorter)

    def lift(shorter: float) -> float:
        return float(np.mean(np.sum(force(shorter) * up, axis=0))) - STANDARD_GRAVITY

    balanced = manner.load == "swings" and manner.rest > 0.0
    if not balanced or lift(-SHORTEST) * lift(SHORTEST) >= 0.0:
        return force(0.0)
    return force(root_scalar(lift, bracket=(-SHORTEST, SHORTEST), method="brentq", xtol=1e-6).root)


def _load(
    ranges: Ranges, manner: Manner, wave: FloatArray, passed: FloatArray, lively: FloatArray, shorter: float
) -> FloatArray:
    """Load (n,); `shorter` is ln of a factor on the power of pulses above rest, -ln of one on those below."""
    low, high = ranges.load
    if manner.load == "burns":
        return low + (high - low) * passed**2
    rest = min(max(manner.rest * STANDARD_GRAVITY, low), high)
    if manner.load == "drags":
        return rest + (low - rest) * np.sin(math.pi * passed) ** 2
    powers = (manner.sharp * math.exp(max(one, 0.0)) for one in (shorter, -shorter))
    pulses = [(0.5 + 0.5 * side) ** power for side, power in zip((wave, -wave), powers, strict=True)]
    return rest + lively * ((high - rest) * pulses[0] - (rest - low) * pulses[1])


def _heat(ranges: Ranges, t: FloatArray) -> dict[str, FloatArray]:
    """Temperature (n,) and its rate (n,) at times (n,) of the mission."""
    low, high = ranges.temperature
    half, middle, pulsation = 0.5 * (high - low), 0.5 * (high + low), _swinging(ranges)
    return {"T": middle + half * np.sin(pulsation * t), "dT": half * pulsation * np.cos(pulsation * t)}


def _swinging(ranges: Ranges) -> float:
    """Pulsation of the temperature, rad/s: as fast as its rate allows over its range."""
    low, high = ranges.temperature
    return 2.0 * ranges.warming / (high - low) if high > low else 0.0
