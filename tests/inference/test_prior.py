"""Priors are the distributions that they are said to be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mpmath import mp as _mp
from scipy.stats import cauchy, norm

from imubayes.algebra.factor import factor_of, posterior_root
from imubayes.errors import TermError
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import (
    GPrior,
    HyperG,
    ScalePrior,
    ZellnerSiow,
    class_sd,
    g_nodes,
    g_step_error,
    prior,
    weak_sd,
)
from imubayes.inference.summary import summarize
from imubayes.rig.rotations import oscillation, rate_table
from imubayes.rig.simulate import simulate
from imubayes.selection.decision import posterior_draws, prior_draws, select
from imubayes.sensors.catalogue import coupled, draw_unit, prior_root, sensor, typical_noise
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import library, tied

mp: Any = _mp


@pytest.fixture(scope="module")
def turned():
    """A tactical MEMS accelerometer on a rate table and on an oscillating one, and its truth."""
    entry = sensor("mems_tactical", kind="accelerometer")
    lib = coupled(library("accelerometer", set="extended"), entry)
    plans = [rate_table([-3.0, 0.0, 3.0], rate=1.0), oscillation([1.0, 3.0])]
    rules = {plan.name: NoiseRule("fixed", typical_noise(entry)) for plan in plans}
    truth = draw_unit(entry, lib, np.random.default_rng(1))
    runs = simulate(entry, plans, seed=1, truth=truth)
    return summarize(runs, lib, sensor=entry, rules=rules), lib, entry, truth


def test_coefficients_that_a_lever_arm_alone_drives_are_fitted_as_one(turned):
    """S_ik = s_j and S_jj = S_kk in verdicts, models and draws; what only dw drives tells of S_ik too."""
    summary, lib, entry, truth = turned
    found = select(summary, prior(entry, lib))
    assert lib.tied == (("S_kk", "S_jj"), ("s_j", "S_ik"))
    said = {term.name: term for term in found.terms}
    drawn = dict(zip(lib.names, posterior_draws(found, 500, np.random.default_rng(2)).T, strict=True))
    before = dict(zip(lib.names, prior_draws(found, 500, np.random.default_rng(3)).T, strict=True))
    for name, leader in lib.tied:
        one, other = said[name], said[leader]
        numbers = ("mean", "sd", "q05", "q95", "full_mean", "full_sd", "inclusion", "limit95", "verdict")
        assert [getattr(one, key) for key in numbers] == [getattr(other, key) for key in numbers]
        assert one.unit == next(term.unit for term in lib.terms if term.name == name)
        assert one.reason.startswith(f"one lever arm with {leader}: ")
        assert (name in found.model) == (leader in found.model)
        assert name not in found.models.candidates.names
        assert (drawn[name] == drawn[leader]).all() and (before[name] == before[leader]).all()
        assert abs(one.full_mean - truth[name]) < 4.0 * one.full_sd < 0.2 * one.prior_sd


def test_posterior_of_tied_terms_is_that_of_a_prior_with_their_singular_covariance(turned):
    """Second route: numpy alone, with the columns as they are and ``cov(theta) = A A'``."""
    _, lib, entry, _ = turned
    plain = replace(lib, ties=())
    runs = simulate(entry, [oscillation([1.0, 3.0]), rate_table([-3.0, 3.0], rate=1.0)], seed=4)
    X = np.concatenate([linear_of(run, plain).columns(0, len(run.output)) for run in runs])[::20]
    y = np.concatenate([linear_of(run, plain).y for run in runs])[::20]
    sd, sigma = class_sd(entry, lib), 1e-2
    A = np.zeros((len(sd), len(sd)))
    for j, leader in enumerate(lib.carriers):
        A[j, lib.names.index(leader)] = sd[j]
    S = A @ A.T
    assert np.linalg.matrix_rank(S / np.outer(sd, sd)) == len(sd) - 2
    gain = np.linalg.solve(X @ S @ X.T + sigma**2 * np.eye(len(y)), X @ S).T
    mean, cov = gain @ y, S - gain @ X @ S
    made = factor_of(tied(lib, X.copy()) / sigma, y / sigma, lib.names)
    found, root = posterior_root(made, sd, 1.0)
    where = [lib.names.index(name) for name in lib.carriers]
    np.testing.assert_allclose(found[where] / sd, mean / sd, atol=1e-7)
    np.testing.assert_allclose(
        (root @ root.T)[np.ix_(where, where)] / np.outer(sd, sd), cov / np.outer(sd, sd), atol=1e-7
    )


def test_errors_of_coefficients_that_a_lever_arm_couples_are_as_large_as_they_say(turned):
    """Priors tie what the arm alone drives; S_ij and s_k have Kspin and Kang beside it, and are independent.

    The error of the posterior mean over units of the class, ``(C B)(C B)' + C F C`` for the prior's root B
    and the posterior covariance C, both in prior sds, has the variances that C claims. With all of the
    couplings S_ij alone would be known better, from s_k.
    """
    summary, lib, entry, _ = turned
    own = [name == carrier for name, carrier in zip(lib.names, lib.carriers, strict=True)]
    sd = class_sd(entry, lib)[own]
    G, B = summary.factor.R[:-1, :-1][:, own] * sd, prior_root(entry, lib)[own] / sd[:, None]
    F = G.T @ G
    C = np.linalg.inv(F + np.eye(len(sd)))
    error = np.sqrt(np.diagonal(C @ B @ B.T @ C + C @ F @ C))
    claimed = np.sqrt(np.diagonal(C))
    np.testing.assert_allclose(error, claimed, rtol=0.01)
    known = np.sqrt(np.diagonal(B @ np.linalg.inv(np.eye(B.shape[1]) + B.T @ F @ B) @ B.T))
    gain = dict(zip(np.array(lib.names)[own].tolist(), claimed / known, strict=True))
    assert 4.0 < gain.pop("S_ij") < 5.0 and max(gain.values()) < 1.02


@pytest.mark.parametrize("a", [3.0, 4.0])
def test_hyper_g_has_a_shrinkage_of_a_beta_distribution(a):
    """``s = g/(1 + g) ~ Beta(1, a/2 - 1)``: E s = 2/a and E s^2 = 8/(a (a + 2))."""
    g, log_weight = g_nodes(HyperG(a), 10)
    s, weight = g / (1.0 + g), np.exp(log_weight)
    np.testing.assert_allclose([weight @ s, weight @ s**2], [2.0 / a, 8.0 / (a * (a + 2.0))], rtol=1e-8)


@pytest.mark.parametrize(("n", "scale"), [(12, 1.0), (300, 0.5)])
def test_zellner_siow_makes_cauchy_coefficients(n, scale):
    """A normal of variance g/n, mixed over g, is a Cauchy variable of the scale."""
    g, log_weight = g_nodes(ZellnerSiow(scale), n)
    theta = np.array([0.0, 0.1, 1.0, 3.0, 30.0]) * scale
    mixed = np.exp(log_weight) @ norm.pdf(theta, scale=np.sqrt(g / n)[:, None])
    np.testing.assert_allclose(mixed, cauchy.pdf(theta, scale=scale), rtol=1e-8)


@pytest.mark.parametrize(("a", "columns"), [(3.0, 26), (10.0, 13), (40.0, 26)])
def test_the_error_of_the_steps_of_g_is_that_of_an_inverse_gamma_density(a, columns):
    """The bound is reached where the steps fall worst, and what is told is no more than twice that."""
    g, _ = g_nodes(HyperG(a), 10)
    s = 0.5 * (columns + a) - 1.0
    with mp.workdps(30):
        step, phases = mp.log(mp.mpf(g[1])) - mp.log(mp.mpf(g[0])), [mp.mpf(k) / 8 for k in range(8)]
        nodes = [
            [(k + phase) * step for k in range(int(-8 / float(step)), int(40 / float(step)))]
            for phase in phases
        ]
        sums = [step * mp.fsum(mp.exp(-s * x - mp.exp(-x)) for x in row) / mp.gamma(s) for row in nodes]
        worst = float(max(abs(one - 1) for one in sums))
    # eight phases come within cos(pi/8) of the worst
    bound = g_step_error(HyperG(a), columns)
    assert 0.9 * bound <= worst <= 1.01 * bound


@pytest.mark.parametrize(
    ("of", "value"),
    [(GPrior, math.inf), (GPrior, math.nan), (HyperG, 2.0), (HyperG, math.inf), (ZellnerSiow, 1e200)],
)
def test_a_prior_on_g_without_an_integral_is_refused(of, value):
    with pytest.raises(TermError, match="prior"):
        of(value)


@pytest.mark.parametrize("sd", [0.0, -1.0, math.inf, math.nan, [1.0, 0.0]])
def test_a_prior_sd_that_is_no_scale_is_refused(sd):
    with pytest.raises(TermError, match="must be positive and finite"):
        ScalePrior(sd)


def test_a_weak_prior_lets_each_term_alone_move_the_output_by_its_range():
    reach = np.array([0.5, 20.0, 0.0])
    sd = weak_sd(reach, 4.0)
    np.testing.assert_allclose((sd * reach)[:2], 4.0)
    assert np.all(np.isfinite(weak_sd(reach, 0.0)))
    assert np.all(sd > 0.0)
