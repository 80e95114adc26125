"""A small campaign with coloured noise, and its log density."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import imubayes as ib
from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.mcmc.density import Density, density_of, fit_noise, log_marginal
from imubayes.inference.summary import Summary
from imubayes.sensors.catalogue import draw_unit

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
