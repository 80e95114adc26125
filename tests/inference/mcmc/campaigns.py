"""A small campaign with coloured noise, and its log density."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

import imubayes as ib
from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.mcmc.density import Density, density_of, fit_noise, log_marginal
from imubayes.inference.summary import Summary
from imubayes.rig.inputs import Run
from imubayes.sensors.catalogue import SensorClass, draw_unit
from imubayes.sensors.terms import Library

SENSOR = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer", powers=2, asymmetry=-1)


@dataclass(frozen=True, eq=False)
class Campaign:
    summary: Summary
    rows: tuple[Linear, ...]
    sd: np.ndarray

    @cached_property
    def density(self) -> Density:
        return density_of(self.summary, self.rows, self.sd, np.random.default_rng(1))


def campaign_of(rules: dict[str, ib.NoiseRule] | None = None, rate: float = 2.0) -> Campaign:
    plans = [
        ib.tumble(angles=12, dwell=20.0, rate=rate),
        ib.centrifuge([1, 10], mounts=12, dwell=20.0, rate=rate),
    ]
    truth = draw_unit(SENSOR, LIBRARY, np.random.default_rng(4))
    runs = ib.simulate(SENSOR, plans, seed=3, truth=truth)
    summary = ib.summarize(runs, LIBRARY, sensor=SENSOR, rules=rules)
    rows, sd = tuple(linear_of(run, LIBRARY) for run in runs), ib.prior(SENSOR, LIBRARY).sd
    return Campaign(summary, rows, sd)


def near(campaign: Campaign, size: int, seed: int = 2) -> np.ndarray:
    """Noises (size, d) as logarithms, where the posterior has nearly all of its mass."""
    density, runs = campaign.density, campaign.summary.runs
    start = np.concatenate([np.log([r.noise.N, r.noise.B, r.noise.K]) for r in runs])
    spread = np.concatenate([r.found.sd for r in runs])
    x = fit_noise(density, start, spread, np.random.default_rng(1)).draw(
        20 * size, np.random.default_rng(seed)
    )
    height = log_marginal(density, x)
    return x[height > height.max() - 8.0][:size]


def drifting_log(seed: int) -> tuple[SensorClass, Library, tuple[Run, ...]]:
    """A gyroscope, its library and a log in which bias instability passes for a random walk."""
    gyro, lib = ib.sensor("mems_tactical", kind="gyroscope"), ib.library("gyroscope", powers=1, asymmetry=-1)
    noise = ib.Noise(2.2e-5, 1.7e-6, 3.3e-7)
    return gyro, lib, ib.simulate(gyro, [ib.static(duration=1900.0, rate=2.0)], seed=seed, noise=noise)


def walkless(density: Density, N: np.ndarray) -> tuple[float, float]:
    """Log evidence, and share of the posterior with a walk below exp(-17), by quadrature over these ln N."""
    B, K = (density.center[k] + density.width[k] * np.linspace(-4.0, 4.0, 81) for k in (1, 2))
    logs = log_marginal(density, np.array([*product(N, B, K)])).reshape(len(N), 81, 81)
    share = np.exp(logs - logs.max())
    cell = (N[1] - N[0]) * (B[1] - B[0]) * (K[1] - K[0])
    return float(logs.max() + np.log(share.sum() * cell)), float(share[:, :, K < -17.0].sum() / share.sum())
