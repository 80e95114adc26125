"""An IMU in the hand, simulated: held still in one direction after the other, and turned between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq
from scipy.spatial.transform import Rotation

from imubayes.inference.triad import Triad, triad_of
from imubayes.rig import formats, stream_survey, streams
from imubayes.rig.inputs import Inputs, Run, Section
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

GRAVITY = 9.81
INTERVAL = 0.01
FINER = 10
"""Steps of the true attitude in a sampling interval."""

HOLD, TURN = 3.0, 1.5
"""s."""

NOISES = (Noise(6e-4, 1e-4, 0.0), Noise(1e-4, 2e-5, 0.0))
"""Of an accelerometer, m/s^2 (60 ug/sqrt(Hz), 10 ug), and of a gyroscope, rad/s (0.006 deg/s/sqrt(Hz))."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """True rate and specific force (n, 3) along the case axes, at times t (n,)."""

    t: np.ndarray
    w: np.ndarray
    f: np.ndarray


def motion(stills: int, rng: np.random.Generator) -> Motion:
    """Turns of one to three radians about axes that wander while the hand turns."""
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
    return Motion(t[::FINER], _centred(w)[::FINER], GRAVITY * u[::FINER])


def _centred(w: np.ndarray) -> np.ndarray:
    """Rates at the steps' ends."""
    return 0.5 * (w + np.vstack((w[:1], w[:-1])))


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


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
    true = motion(stills, rng)
    noisy = [np.column_stack([synthesise(n, true.t, INTERVAL, rng) for _ in range(3)]) for n in noises]
    force = true.f + deviation(accelerometers, true.f) + noisy[0]
    rate = true.w + deviation(gyroscopes, true.w, true.f) + noisy[1]
    inputs = Inputs(true.t, {}, INTERVAL)
    return Run("hand", "free-tumble", inputs, np.hstack((force, rate)), gravity=GRAVITY)


UP = ("x", "-x", "y", "-y", "z", "-z")
FULL_TURN = -2.0 * np.pi


def on_a_table(triads, noises=NOISES, *, faces: float = 0.0, seed: int = 1) -> Run:
    """Six positions of 5 s and three turns of 3 s by an uneven hand; each section off by `faces`, rad."""
    rng, force, rate, sections, n = np.random.default_rng(seed), [], [], [], 0
    for up, angle in [*((up, 0.0) for up in UP), *((up, FULL_TURN) for up in "xyz")]:
        count = 300 if angle else 500
        u = Section(0, 1, up).direction
        u = u - np.cross(faces * rng.normal(size=3) * (u == 0.0), u)
        course = 1.0 + 0.5 * np.sin(np.linspace(0.0, 7.0, count))
        rate.append(np.outer(angle / (count * INTERVAL) * course / course.mean(), u))
        force.append(np.tile(GRAVITY * u, (count, 1)))
        sections.append(Section(n, n + count, up, angle))
        n += count
    f, w, t = np.concatenate(force), np.concatenate(rate), INTERVAL * np.arange(n)
    noisy = [np.column_stack([synthesise(one, t, INTERVAL, rng) for _ in range(3)]) for one in noises]
    outputs = (f + deviation(triads[0], f) + noisy[0], w + deviation(triads[1], w, f) + noisy[1])
    inputs = Inputs(t, {}, INTERVAL)
    return Run("bench", "ferraris", inputs, np.hstack(outputs), gravity=GRAVITY, sections=tuple(sections))


def from_a_long_file(run: Run, folder: Path, patch: pytest.MonkeyPatch, rows: int) -> Run:
    """The record as it is read from a file, so many rows at a time."""
    names = ("ax", "ay", "az", "gx", "gy", "gz")[: run.output.shape[1]]
    columns = {
        f"{name} [{'m/s^2' if name[0] == 'a' else 'rad/s'}]": x
        for name, x in zip(names, run.output.T, strict=True)
    }
    pq.write_table(pa.table({"t [s]": run.t, **columns}), folder / "run.parquet")
    patch.setattr(streams, "STREAMED", 1000)
    patch.setattr(formats, "ROWS", rows)
    patch.setattr(stream_survey, "STRETCH", 1000)
    spec = RunSpec(
        run.name, run.procedure, folder / "run.parquet", gravity=run.gravity, sections=run.sections
    )
    read = read_imu_run(spec) if len(names) == 6 else read_run(spec, "accelerometer")
    assert read.stream is not None
    return read
