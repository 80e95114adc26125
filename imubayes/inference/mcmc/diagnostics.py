"""Effective sample size and split R-hat of ensembles of walkers.

Walkers of one ensemble propose from each other, so they are no independent chains: the effective size comes
from emcee's autocorrelation time, averaged over the walkers, and R-hat compares whole ensembles.
"""

from __future__ import annotations

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.mcmc.engine import autocorrelation_time

LONG = 50.0
"""Steps in autocorrelation times below which emcee's estimate of that time is not to be trusted."""


def effective_size(chains: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Effective sample size and autocorrelation time (d,) of several ensembles (steps, walkers, d)."""
    taus = np.array([autocorrelation_time(chain) for chain in chains])
    sizes = np.array([chain.shape[0] * chain.shape[1] for chain in chains])
    return np.sum(sizes[:, None] / taus, axis=0), taus.max(axis=0)


def split_rhat(chains: list[FloatArray]) -> FloatArray:
    """Split R-hat (d,) over ensembles (steps, walkers, d): both halves of each one count as chains.

    Gelman et al., Bayesian Data Analysis (2013), section 11.4, with all walkers of an ensemble as one chain.
    """
    half = min(len(chain) for chain in chains) // 2
    d = chains[0].shape[2]
    if half < 1:
        return np.full(d, np.inf)
    parts = [part.reshape(-1, d) for chain in chains for part in (chain[:half], chain[-half:])]
    n = len(parts[0])
    means = np.array([part.mean(axis=0) for part in parts])
    within = np.mean([part.var(axis=0, ddof=1) for part in parts], axis=0)
    between = n * means.var(axis=0, ddof=1)
    still = within == 0.0
    pooled = (n - 1.0) / n * within + between / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(still, np.where(between == 0.0, 1.0, np.inf), np.sqrt(pooled / within))
