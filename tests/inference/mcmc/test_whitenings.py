"""Interpolated Gram matrices against whitenings of all rows."""

import math

import numpy as np
import pytest
from campaigns import campaign_of, near
from scipy.optimize import minimize

import imubayes as ib
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.mcmc.density import condition, log_marginal
from imubayes.inference.mcmc.split import splits_of
from imubayes.inference.whiten import processes
from imubayes.sensors.noise import Noise


def exact(campaign, x):
    """Log likelihood of the runs at a noise, from whitenings of all rows, up to a constant."""
    total, grams = 0.0, campaign.density.coordinates.prior.copy()
    for k, (rows, run) in enumerate(zip(campaign.rows, campaign.summary.runs, strict=True)):
        noise = Noise(*np.exp(x[3 * k : 3 * k + 3]))
        f = whitened_factor(rows, noise, processes(rows.rows, run.noise))
        grams += campaign.density.coordinates.gram(f.R)
        total -= 0.5 * f.log_det
    diagonal = np.diag(np.linalg.cholesky(grams))
    return total - np.log(diagonal[:-1]).sum() - 0.5 * diagonal[-1] ** 2


def interpolated(campaign, x):
    given = condition(campaign.density, x[None])
    prior = np.sum(((x - campaign.density.center) / campaign.density.width) ** 2)
    return float(given.base[0] + 0.5 * prior - 0.5 * given.L[0, -1, -1] ** 2 - 0.5 * given.log_det[0])


def error_over_the_posterior(campaign):
    x = near(campaign, 12)
    return np.std([interpolated(campaign, one) - exact(campaign, one) for one in x])


def test_rows_no_more_than_blocks_are_interpolated_to_a_hundredth_of_a_nat(campaign):
    assert max(run.error for run in campaign.density.runs) < 0.01
    assert error_over_the_posterior(campaign) < 0.02


def test_averages_and_what_they_leave_are_right_to_a_tenth_of_a_nat():
    # seven rows a block: what the averages leave is not quite white
    dense = campaign_of(rate=16.0)
    assert all(run.n > 4 * 1500 for run in dense.density.runs)
    assert error_over_the_posterior(dense) < 0.1


def test_maximum_of_a_run_alone_is_that_of_whitenings_of_all_rows(campaign):
    """A simplex over exact whitenings, which knows no slope, from a start of its own."""
    c, rows, run = campaign.density.coordinates, campaign.rows[0], campaign.summary.runs[0]
    center, width = np.array([(math.log(m), s) for m, s in run.found.steering.values()]).T
    sd = np.array(run.found.sd)

    def cost(away):
        x = center + sd * away
        f = whitened_factor(rows, Noise(*np.exp(x)), processes(rows.rows, run.noise))
        diagonal = np.diag(np.linalg.cholesky(c.prior + c.gram(f.R)))
        log_marginal = -0.5 * (f.log_det + diagonal[-1] ** 2) - np.log(diagonal[:-1]).sum()
        return 0.5 * np.sum(((x - center) / width) ** 2) - log_marginal

    simplex = minimize(cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-6})
    top = splits_of([rows], [run], c)[1]
    assert np.max(np.abs((top - center) / sd - simplex.x)) < 0.2


def test_white_noise_of_unknown_level_has_one_parameter():
    white = campaign_of({"centrifuge": ib.NoiseRule("white")})
    assert white.density.parameters == ("N.tumble", "B.tumble", "K.tumble", "N.centrifuge")
    level = 1.3 * white.summary.runs[1].noise.N
    one = ib.NoiseRule("fixed", Noise(level, 0.0, 0.0))
    given = campaign_of({"tumble": ib.NoiseRule("fixed", white.summary.runs[0].noise), "centrifuge": one})
    first = white.summary.runs[0].noise
    x = np.log([first.N, first.B, first.K, level])
    prior = np.sum(((x - white.density.center) / white.density.width) ** 2) / 2.0
    prior += np.log(white.density.width).sum() + 2.0 * math.log(2.0 * math.pi)
    free = float(log_marginal(white.density, x[None])[0]) + prior
    assert free == pytest.approx(float(log_marginal(given.density, np.empty((1, 0)))[0]), abs=0.02)
