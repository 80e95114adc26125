"""Many units together, against their own generative model drawn at random."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import binomtest, norm

from imubayes.population.levels import Likelihoods, of_units
from imubayes.population.pooled import ALL, SHARES, over_lots, pooled
from imubayes.population.spreads import spreads

SIZES, SCALE = (0.3, 10.0), 3.0


def _drawn(rng, lots=2, units=10):
    """Presence, share, coefficients and estimates of a class and of one unit more, of its first lot."""
    there = rng.random() < 0.5
    share = rng.random() * there
    theta = []
    for _ in range(lots):
        tau = np.exp(rng.uniform(*np.log(SIZES)))
        own = rng.normal(tau * rng.standard_normal(), tau, units + 1)
        theta.append(np.where(rng.random(units + 1) < share, own, 0.0))
    variance = [np.exp(rng.normal(0.0, 0.7, units)) for _ in range(lots)]
    estimate = [rng.normal(one[:-1], np.sqrt(v)) for one, v in zip(theta, variance, strict=True)]
    return there, share, theta, estimate, variance


@pytest.fixture(scope="module")
def many():
    rng = np.random.default_rng(4)
    drawn = [_drawn(rng) for _ in range(400)]
    return drawn, [pooled(estimate, variance, SIZES) for *_, estimate, variance in drawn]


def test_probability_that_units_have_a_term_is_how_often_they_do(many):
    drawn, found = many
    there = np.array([one[0] for one in drawn], dtype=float)
    said = np.array([one.inclusion for one in found])
    assert abs((there - said).sum()) < 3.0 * np.sqrt((said * (1.0 - said)).sum())
    for low, high in ((0.0, 0.4), (0.4, 0.8), (0.8, 0.99), (0.99, 1.0)):
        few = (said >= low) & (said <= high)
        assert binomtest(int(there[few].sum()), int(few.sum()), float(said[few].mean())).pvalue > 0.005
    assert (said > 0.95).mean() > 0.2


def test_intervals_of_the_share_and_limits_of_a_further_unit_hold_what_they_say(many):
    drawn, found = many
    held = [
        one.share.low <= true[1] <= one.share.high for true, one in zip(drawn, found, strict=True) if true[0]
    ]
    assert binomtest(sum(held), len(held), 0.9).pvalue > 0.005
    below = [
        np.mean([abs(lot[-1]) <= one.limit for lot in true[2]])
        for true, one in zip(drawn, found, strict=True)
    ]
    assert abs(np.mean(below) - 0.95) < 3.0 * np.std(below) / np.sqrt(len(below))


def _sessions(rng, *, coupled=2, units=8, sessions=3):
    """Presence and share of a class, coefficient of one unit more, and what sessions of 8 units say."""
    there = rng.random() < 0.5
    share = rng.random() * there
    tau = np.exp(rng.uniform(*np.log(SIZES)))
    theta = rng.normal(tau * rng.standard_normal(), tau, units + 1) * (rng.random(units + 1) < share)
    angle, turn_on = rng.uniform(0.0, 0.5 * np.pi), min(abs(SCALE * rng.standard_cauchy()), 20.0 * SCALE)
    own, common = turn_on * np.cos(angle), turn_on * np.sin(angle)
    alias = 0.5 * rng.normal(size=coupled) * np.ones((units, sessions, coupled))
    others = (rng.standard_normal(coupled) + rng.standard_normal((units, coupled))) / np.sqrt(2.0)
    noise = np.exp(rng.normal(0.0, 0.5, (units, sessions)))
    value = theta[:-1, None] + common * rng.standard_normal(sessions) + (alias * others[:, None]).sum(axis=-1)
    value += rng.normal(0.0, np.hypot(own, noise))
    value[rng.random(value.shape) < 0.1] = np.nan
    return there, share, theta[-1], Likelihoods(value, noise, alias)


def test_recorded_units_have_a_term_as_often_as_their_sessions_together_say():
    """Mutation: a turn-on of all units, or of one, that is left out of the errors is taken for a term."""
    rng, rows = np.random.default_rng(12), []
    for _ in range(40):
        there, share, further, one = _sessions(rng)
        found = spreads([one], SCALE)
        weight, estimate, variance = of_units(one, found.turn_on_own, found.turn_on_common)
        said = pooled([estimate], [variance], SIZES, [weight])
        held = said.share.low <= share <= said.share.high
        rows.append((there, said.inclusion, held, abs(further) <= said.limit))
    there, said, held, below = np.array(rows, dtype=float).T
    assert abs((there - said).sum()) < 3.0 * np.sqrt((said * (1.0 - said)).sum())
    for low, high in ((0.0, 0.4), (0.4, 0.8), (0.8, 1.0)):
        few = (said >= low) & (said <= high)
        assert binomtest(int(there[few].sum()), int(few.sum()), float(said[few].mean())).pvalue > 0.005
    assert (said > 0.95).mean() > 0.1
    assert binomtest(int(held[there > 0.0].sum()), int(there.sum()), 0.9).pvalue > 0.005
    assert binomtest(int(below.sum()), len(below), 0.95).pvalue > 0.005


@pytest.mark.parametrize("shares", [SHARES, ALL])
def test_inclusion_is_that_of_a_plain_average_over_draws_of_the_prior(shares):
    rng = np.random.default_rng(8)
    estimate, variance = np.array([2.0, -0.4, 1.1, 3.0]), np.array([1.0, 0.5, 2.0, 1.5])
    share = np.maximum(rng.random(200_000), shares == ALL)[:, None]
    tau = np.exp(rng.uniform(*np.log(SIZES), len(share)))[:, None]
    mean = tau * rng.standard_normal(tau.shape)
    apart = norm.pdf(estimate, 0.0, np.sqrt(variance))
    units = (1.0 - share) * apart + share * norm.pdf(estimate, mean, np.sqrt(tau**2 + variance))
    log = np.log(units).sum(axis=1)
    odds = np.exp(logsumexp(log) - np.log(len(log)) - np.log(apart).sum())
    found = pooled([estimate], [variance], SIZES, shares=shares)
    assert found.inclusion == pytest.approx(odds / (1.0 + odds), abs=0.01)


def test_share_of_a_class_is_as_unsure_as_its_lots_differ():
    """Lots drawn by a beta distribution: the 90 % interval of their class's share holds it."""
    rng, held = np.random.default_rng(3), []
    for _ in range(300):
        share, correlation = rng.random(2)
        more = 1.0 / correlation - 1.0
        lots = rng.beta(share * more, (1.0 - share) * more, 3)
        found = over_lots(tuple(rng.binomial(8, lots).tolist()), 8)
        held.append(found.low <= share <= found.high)
    assert binomtest(sum(held), len(held), 0.9).pvalue > 0.005
