"""A quiet log: noise processes drawn at a constant interval, each sample the average over its interval.

Points of a process that changes within the interval scatter more than averages do: a Gauss-Markov process far
above the white noise would then count as white noise too.
"""

import numpy as np
from scipy.signal import lfilter

from imubayes.algebra import FloatArray
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise, Sizes


def quiet_log(noise: Sizes, samples: int, interval: float, rng: np.random.Generator) -> FloatArray:
    """One realisation of the processes, (n,), SI, whose samples are averages over an interval, s.

    White noise and bias instability are those of `imubayes.rig.simulate.synthesise`, the latter at points;
    quantization is the difference of white angles over the interval, the random walk starts from zero, a ramp
    is zero in the middle of the log, and the Gauss-Markov process starts from its stationary distribution.
    """
    t = np.arange(samples, dtype=float) * interval
    size = dict.fromkeys("NBQRKG", 0.0) | {"tau": 1.0} | noise
    values = synthesise(Noise(size["N"], size["B"], 0.0), t, interval, rng)
    values += size["Q"] * np.diff(rng.standard_normal(samples + 1)) / interval
    values += size["R"] * (t - t.mean())
    values += size["K"] * _walk(samples, interval, rng)
    return values + size["G"] * _gauss_markov(samples, interval / size["tau"], rng)


def _walk(samples: int, interval: float, rng: np.random.Generator) -> FloatArray:
    """Averages of a random walk of unit size: steps w of variance T, and averages w/2 + v, Var v = T/12."""
    steps, within = np.sqrt(interval) * rng.standard_normal((2, samples))
    return np.cumsum(steps) - 0.5 * steps + within / np.sqrt(12.0)


def _gauss_markov(samples: int, x: float, rng: np.random.Generator) -> FloatArray:
    """Averages of a stationary first-order process of unit variance over intervals of x time constants.

    Given its value at the start of an interval, the value at the end and the average over the interval are
    normal: ``a = exp(-x)``, ``E = (1 - a)/x``, Var end = 1 - a^2, Cov = x E^2, Var average = A - E^2 with the
    variance A of an average.
    """
    a, E = np.exp(-x), -np.expm1(-x) / x
    A = 1.0 - x / 3.0 + x**2 / 12.0 - x**3 / 60.0 if x < 1e-2 else 2.0 * (x + np.expm1(-x)) / x**2
    ends, within = rng.standard_normal((2, samples))
    ends *= np.sqrt(-np.expm1(-2.0 * x))
    follows = x * E**2 / -np.expm1(-2.0 * x)
    left = max(A - E**2 - follows * x * E**2, 0.0)
    first = rng.standard_normal()
    value = np.concatenate(([first], lfilter([1.0], [1.0, -a], ends[:-1], zi=[a * first])[0]))
    return np.asarray(E * value + follows * ends + np.sqrt(left) * within)
