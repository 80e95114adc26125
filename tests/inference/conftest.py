"""A triad turned by hand, simulated."""

from __future__ import annotations

from typing import NamedTuple

import hands
import numpy as np
import pytest

from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

GRAVITY = 9.81
INTERVAL = 0.01
QUIET = Noise(6e-4, 1e-4, 0.0)  # m/s^2: 60 ug/sqrt(Hz), 10 ug


class HandTumble(NamedTuple):
    """A record, and the sample indices [start, stop) at which the hand was at rest."""

    run: Run
    held: tuple[tuple[int, int], ...]


@pytest.fixture(scope="session")
def xsens(recordings):
    """imu_tk's recording of an IMU in the hand at its nominal scales, and gravity as in its test program."""
    folder = recordings / "imu_tk_xsens"
    force, rate = (np.loadtxt(folder / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    output = np.hstack(((force[:, 1:] - 32768.0) * 2.42e-3, (rate[:, 1:] - 32768.0) * 2.1e-4))
    return Run("hand", "free-tumble", Inputs(force[:, 0], {}, 0.01), output, gravity=9.81744)


def specific_force(up, hold, move, rng):
    """Holds of `hold` s, joined by turns of `move` s along great circles, with the jerk of a hand."""
    at_rest, turn = round(hold / INTERVAL), round(move / INTERVAL)
    pieces, held, n = [], [], 0
    smooth = 0.5 - 0.5 * np.cos(np.pi * (np.arange(turn) + 0.5) / turn)
    for k, here in enumerate(up):
        pieces.append(np.repeat(here[None], at_rest, axis=0))
        held.append((n, n + at_rest))
        n += at_rest + turn
        if k + 1 < len(up):
            angle = np.arccos(np.clip(here @ up[k + 1], -1.0, 1.0))
            a, b = np.sin((1.0 - smooth) * angle), np.sin(smooth * angle)
            path = (a[:, None] * here + b[:, None] * up[k + 1]) / np.sin(angle)
            jerk = 0.1 * np.sin(np.pi * smooth)[:, None] * rng.normal(size=(turn, 3))
            pieces.append(path + jerk)
    return GRAVITY * np.concatenate(pieces), tuple(held)


@pytest.fixture(scope="session")
def hand_tumble():
    """Make a record of a triad: ``deviation(f)`` (n, 3) is output minus input along the case axes."""

    def make(deviation=np.zeros_like, *, stills=30, hold=3.0, noise=QUIET, seed=1):
        rng = np.random.default_rng(seed)
        up = hands.directions(stills, rng)
        f, held = specific_force(up, hold, 1.0, rng)
        t = INTERVAL * np.arange(len(f))
        noises = np.column_stack([synthesise(noise, t, INTERVAL, rng) for _ in range(3)])
        run = Run("hand", "free-tumble", Inputs(t, {}, INTERVAL), f + deviation(f) + noises, gravity=GRAVITY)
        return HandTumble(run, held)

    return make
