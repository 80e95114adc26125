"""An IMU in the hand, simulated: held still in one direction after the other, and turned between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import made
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imubayes.inference.case import Case, TriadSpec
from imubayes.inference.prior import ScalePrior
from imubayes.inference.triad import Triad, triad_of
from imubayes.rig.inputs import Inputs, Run, RunSection
from imubayes.rig.runs import read_imu_run
from imubayes.rig.simulate import synthesise
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, library

GRAVITY = 9.81
INTERVAL = 0.01
FINER = 10
"""Steps of the true attitude in a sampling interval."""

HOLD, TURN = 3.0, 1.5
"""s."""

NOISES = (Noise(6e-4, 1e-4, 0.0), Noise(1e-4, 2e-5, 0.0))
"""Of an accelerometer, m/s^2 (60 ug/sqrt(Hz), 10 ug), and of a gyroscope, rad/s (0.006 deg/s/sqrt(Hz))."""


def motion(stills: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turns of one to three radians about axes that wander while the hand turns.

    Times (n,), s, and true specific force and rate (n, 3) along the case axes.
    """
    hold, turn = round(HOLD / INTERVAL) * FINER, round(TURN / INTERVAL) * FINER
    s = (np.arange(turn) + 0.5) / turn
    bump = 2.0 * np.sin(np.pi * s) ** 2 / TURN  # 1/s: rests at both ends, and integrates to 1
    rates = []
    for _ in range(stills - 1):
        axis = _unit(rng)
        wander = 0.5 * np.sin(2.0 * np.pi * s)[:, None] * np.cross(axis, _unit(rng))
        rates += [np.zeros((hold, 3)), bump[:, None] * rng.uniform(1.0, 3.0) * (axis + wander)]
    w = np.concatenate((*rates, np.zeros((hold, 3))))
    u = np.empty_like(w)
    u[0] = _unit(rng)
    steps = Rotation.from_rotvec(-w * INTERVAL / FINER).as_matrix()
    for k in range(len(w) - 1):
        u[k + 1] = steps[k] @ u[k]
    # a rate holds over a fine step: a sample is read in the middle of it
    t = INTERVAL / FINER * np.arange(len(w))
    ends = 0.5 * (w + np.vstack((w[:1], w[:-1])))
    return t[::FINER], GRAVITY * u[::FINER], ends[::FINER]


def directions(number: int, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors (n, 3) anyhow."""
    v = rng.normal(size=(number, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _unit(rng: np.random.Generator) -> np.ndarray:
    return directions(1, rng)[0]


def only(kind: str, names: Iterable[str]) -> Library:
    """Terms of these names."""
    every = library(kind, powers=2, asymmetry=-1, set="extended")
    return Library(every.kind, tuple(term for term in every.terms if term.name in names))


def asked(
    lib: Library,
    sds: Mapping[str, float],
    noise: Noise | None = None,
    *,
    run: str = "hand",
    sensor: SensorClass | None = None,
    referenced: bool = False,
) -> TriadSpec:
    """Prior sds by name of the term, and the noise of the run where it is given."""
    libraries = triad_of(lib, referenced=referenced or lib.kind == "gyroscope").libraries
    rules = None if noise is None else {run: NoiseRule("fixed", noise)}
    return TriadSpec(lib, ScalePrior([sds[name] for one in libraries for name in one.names]), sensor, rules)


def prior_of(both: Sequence[TriadSpec], case: Case) -> np.ndarray:
    """Prior sds of all columns of a case."""
    return np.concatenate([*(one.prior.sd for one in both), [extra.sd for extra in case.summary.extras]])


def theta_of(case: Case) -> np.ndarray:
    """Coefficients of all triads."""
    return np.concatenate([triad.theta for triad in case.triads])


def with_truth(lib, truth, *, referenced: bool = False) -> Triad:
    """Triad with coefficients by name; zero where none is given."""
    triad = triad_of(lib, referenced=referenced or lib.kind == "gyroscope")
    return replace(triad, theta=np.array([truth.get(name, 0.0) for name in triad.names]))


def deviation(triad: Triad, own: np.ndarray, other: np.ndarray | None = None) -> np.ndarray:
    """Output minus input (m, 3), column by column: shares no code with the compiled outputs."""
    parts = zip(triad.regressors(own, other), triad.parts(), strict=True)
    return np.column_stack([X @ theta for X, theta in parts])


def in_the_hand(
    accelerometers: Triad, gyroscopes: Triad, *, stills: int = 24, noises=NOISES, seed: int = 1
) -> Run:
    """Record of an IMU with given coefficients."""
    rng = np.random.default_rng(seed)
    t, f, w = motion(stills, rng)
    noisy = [np.column_stack([synthesise(n, t, INTERVAL, rng) for _ in range(3)]) for n in noises]
    outputs = f + deviation(accelerometers, f) + noisy[0], w + deviation(gyroscopes, w, f) + noisy[1]
    return Run("hand", "free-tumble", Inputs(t, {}, INTERVAL), np.hstack(outputs), gravity=GRAVITY)


UP = ("x", "-x", "y", "-y", "z", "-z")
FULL_TURN = -2.0 * np.pi


def on_a_table(triads, noises=NOISES, *, faces: float = 0.0, seed: int = 1) -> Run:
    """Six positions of 5 s and three turns of 3 s by an uneven hand; each section off by `faces`, rad."""
    rng, force, rate, sections, n = np.random.default_rng(seed), [], [], [], 0
    for up, angle in [*((up, 0.0) for up in UP), *((up, FULL_TURN) for up in "xyz")]:
        count = 300 if angle else 500
        u = RunSection(0, 1, up).direction
        u = u - np.cross(faces * rng.normal(size=3) * (u == 0.0), u)
        course = 1.0 + 0.5 * np.sin(np.linspace(0.0, 7.0, count))
        rate.append(np.outer(angle / (count * INTERVAL) * course / course.mean(), u))
        force.append(np.tile(GRAVITY * u, (count, 1)))
        sections.append(RunSection(n, n + count, up, angle))
        n += count
    f, w, t = np.concatenate(force), np.concatenate(rate), INTERVAL * np.arange(n)
    noisy = [np.column_stack([synthesise(one, t, INTERVAL, rng) for _ in range(3)]) for one in noises]
    outputs = (f + deviation(triads[0], f) + noisy[0], w + deviation(triads[1], w, f) + noisy[1])
    inputs = Inputs(t, {}, INTERVAL)
    return Run("bench", "ferraris", inputs, np.hstack(outputs), gravity=GRAVITY, sections=tuple(sections))


def from_a_long_file(run: Run, folder: Path, patch: pytest.MonkeyPatch, rows: int) -> Run:
    """The record as it is read from a file, so many rows at a time."""
    columns = {f"a{axis} [m/s^2]": x for axis, x in zip("xyz", run.force.T, strict=True)}
    columns |= {f"g{axis} [rad/s]": x for axis, x in zip("xyz", run.rate.T, strict=True)}
    spec = made.written({"t [s]": run.t, **columns}, folder, run.procedure)
    made.in_parts(patch, rows, stretch=1000)
    read = read_imu_run(replace(spec, name=run.name, gravity=run.gravity, sections=run.sections))
    assert read.stream is not None
    return read
