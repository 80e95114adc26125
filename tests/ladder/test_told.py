from dataclasses import replace

import numpy as np
import pytest
from trades import SHORT, problem

from imubayes.algebra.factor import posterior
from imubayes.ladder.problem import ground_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.alone import Measured
from imubayes.ladder.trade.told import monte_carlo, told_of


@pytest.fixture(scope="module")
def answers():
    ground = ground_of(problem(), np.random.default_rng(2), lambda message: None, SHORT)
    return {name: stand(name, ground) for name in ("means", "plug-in", "averaged", "collapsed")}


def test_what_is_kept_of_an_answer_is_what_it_says(answers):
    for rung, answer in answers.items():
        told = told_of(answer, 100.0, np.random.default_rng(1))
        assert told.rung == rung
        assert told.verdicts == tuple(term.verdict for term in answer.selection.terms)
        # draws of the posterior have its mean: four standard errors
        error = 4.0 * told.draws.std(axis=0) / np.sqrt(len(told.draws))
        sure = [name for name, p in zip(told.names, told.inclusion, strict=True) if p > 0.999]
        for name in sure:
            j = told.names.index(name)
            assert abs(told.draws[:, j].mean() - told.mean[j]) < error[j] + 1e-12


def test_rungs_without_draws_have_no_monte_carlo_error(answers):
    assert not monte_carlo(answers["means"]).any()
    assert not monte_carlo(answers["plug-in"]).any()


def test_the_monte_carlo_error_is_the_scatter_of_averages_over_as_many_draws(answers):
    unique = tuple({id(noise): noise for noise in answers["averaged"].noises}.values())
    answer = replace(answers["averaged"], noises=unique)
    p, n = len(answer.names), len(unique)
    each = np.array([posterior(noise.factor, answer.ready.prior.sd)[0][:p] for noise in unique])
    picks = np.random.default_rng(1).integers(n, size=(4000, n))
    scatter = each[picks].mean(axis=1).std(axis=0) / answer.full_sd
    # an sd of 4000 draws is off by 1.1 %: four of these
    np.testing.assert_allclose(
        monte_carlo(answer), scatter * np.sqrt(n / (n - 1.0)), rtol=4.0 / np.sqrt(8000.0), atol=1e-12
    )


def test_draws_that_are_taken_again_make_the_monte_carlo_error_no_smaller(answers):
    answer = answers["averaged"]
    first, second = list({id(noise): noise for noise in answer.noises}.values())[:2]
    even = replace(answer, noises=(first, second) * 8)
    few = replace(answer, noises=(first, second))
    np.testing.assert_allclose(monte_carlo(even), monte_carlo(few), rtol=1e-12)


def test_chains_that_fall_short_want_more_time(answers):
    asked = 10.0 * float(answers["collapsed"].chains.diagnostics.ess.min())
    short = told_of(replace(answers["collapsed"], converged=False), asked, np.random.default_rng(1))
    assert short.wanting >= 10.0
    whole = Measured(short, short.seconds, short.seconds, 0.0, (0.0, 0.0)).whole_seconds
    assert whole == pytest.approx(short.seconds + (short.wanting - 1.0) * short.chain_seconds)
