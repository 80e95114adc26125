"""A quiet log: every noise process drawn exactly, at a constant interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from imubayes.errors import InputError
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise
from imubayes.sensors.noise_processes import NoiseProcesses

FloatArray = NDArray[np.float64]


def quiet_log(noise: NoiseProcesses, samples: int, interval: float, rng: np.random.Generator) -> FloatArray:
    """One realisation of the processes, (n,), SI.

    White noise, bias instability and random walk are those of `imubayes.rig.simulate.synthesise`;
    quantization is the difference of white angles over the interval, a ramp is zero in the middle of the log,
    and the Gauss-Markov process starts from its stationary distribution.

    Parameters
    ----------
    noise : the processes.
    samples : at least two.
    interval : averaging time of a sample, s.
    rng : the source of randomness.

    Raises
    ------
    InputError : if there are fewer than two samples, or the interval is not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> quiet_log(NoiseProcesses(N=0.0, R=2.0), 3, 0.5, rng).tolist()
    [-1.0, 0.0, 1.0]
    """
    if samples < 2 or not interval > 0.0:
        raise InputError(
            f"a log of {samples} samples every {interval} s: expected 2 or more, and time to pass"
        )
    t = np.arange(samples, dtype=float) * interval
    values = synthesise(Noise(noise.N, noise.B, noise.K), t, interval, rng)
    values += noise.Q * np.diff(rng.standard_normal(samples + 1)) / interval
    values += noise.R * (t - t.mean())
    return values + noise.G * _gauss_markov(samples, interval / noise.tau, rng)


def _gauss_markov(samples: int, x: float, rng: np.random.Generator) -> FloatArray:
    """Stationary first-order process of unit variance, sampled every x time constants."""
    innovations = rng.standard_normal(samples)
    innovations[1:] *= np.sqrt(-np.expm1(-2.0 * x))
    return np.asarray(lfilter([1.0], [1.0, -np.exp(-x)], innovations))
