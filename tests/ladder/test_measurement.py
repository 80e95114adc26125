import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from trades import SHORT, problem, told

from imubayes.algebra.factor import posterior
from imubayes.ladder.costs import STATUS
from imubayes.ladder.problem import change, ground_of
from imubayes.ladder.rungs import stand
from imubayes.ladder.trade.measurement import best_of, difference, measured_of, monte_carlo
from imubayes.work import silent


@pytest.fixture(scope="module")
def answers():
    ground = ground_of(problem(), np.random.default_rng(2), silent, SHORT)
    return {name: stand(name, ground) for name in ("means", "sparse", "plug-in", "averaged", "collapsed")}


def _with(answer, **posterior):
    return replace(answer, posterior=replace(answer.posterior, **posterior))


def test_the_monte_carlo_error_is_the_scatter_of_averages_over_as_many_draws(answers):
    unique = tuple({id(noise): noise for noise in answers["averaged"].posterior.noises}.values())
    answer = _with(answers["averaged"], noises=unique)
    p, n = len(answer.names), len(unique)
    each = np.array([posterior(noise.factor, answer.ready.prior.sd)[0][:p] for noise in unique])
    picks = np.random.default_rng(1).integers(n, size=(4000, n))
    scatter = each[picks].mean(axis=1).std(axis=0) / answer.full_sd
    # an sd of 4000 draws is off by 1.1 %: four of these
    np.testing.assert_allclose(
        monte_carlo(answer), scatter * np.sqrt(n / (n - 1.0)), rtol=4.0 / np.sqrt(8000.0), atol=1e-12
    )


def test_chains_that_fall_short_want_more_time(answers):
    reached = float(answers["collapsed"].posterior.chains.diagnostics.ess.min())
    asked = 10.0 * reached
    short = measured_of(_with(answers["collapsed"], converged=False), asked, np.random.default_rng(1))
    assert short.wanting >= asked / reached
    assert short.whole_seconds == pytest.approx(short.seconds + (short.wanting - 1.0) * short.chain_seconds)


def test_chains_that_are_too_short_are_held_against_others_and_not_others_against_them():
    assert best_of([told("collapsed", ess=900.0), told("raw", ess=50.0)]).rung == "collapsed"


ALONE = """
import numpy as np
from imubayes.ladder.costs import with_peak

with_peak(lambda: np.ones(25_000_000).sum())  # a larger peak before does not count
print(*with_peak(lambda: float(np.ones(8_000_000).sum())))
"""
"""In a process of its own: what other tests left is given back at any time."""


@pytest.mark.skipif(not STATUS.exists(), reason="needs /proc")
def test_the_peak_is_what_an_array_takes_though_it_is_freed():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
    found, taken = map(float, done.stdout.split())
    assert found == 8e6
    assert 60e6 < taken < 80e6


def test_what_is_kept_of_an_answer_is_what_it_says(answers):
    for rung, answer in answers.items():
        told = measured_of(answer, 100.0, np.random.default_rng(1))
        assert told.rung == rung
        assert told.verdicts == tuple(term.verdict for term in answer.selection.terms)
        # draws of the posterior have its mean: four standard errors
        error = 4.0 * told.draws.std(axis=0) / np.sqrt(len(told.draws))
        sure = [name for name, p in zip(told.names, told.inclusion, strict=True) if p > 0.999]
        for name in sure:
            j = told.names.index(name)
            assert abs(told.draws[:, j].mean() - told.mean[j]) < error[j] + 1e-12


def test_draws_that_are_taken_again_make_the_monte_carlo_error_no_smaller_and_none_is_no_error(answers):
    answer = answers["averaged"]
    first, second = list({id(noise): noise for noise in answer.posterior.noises}.values())[:2]
    few = monte_carlo(_with(answer, noises=(first, second)))
    np.testing.assert_allclose(monte_carlo(_with(answer, noises=(first, second) * 8)), few, rtol=1e-12)
    assert few.any() and not monte_carlo(answers["means"]).any()


def test_the_largest_difference_is_what_the_ladder_calls_a_change(answers):
    below, best = answers["sparse"], answers["plug-in"]
    one, other = (measured_of(answer, 100.0, np.random.default_rng(1)) for answer in (below, best))
    got = difference(one, replace(other, verdicts=("needed",) * len(other.names)), {}, {})
    assert (got.largest, got.inclusion) == pytest.approx(change(below, best), rel=1e-12)
    # of terms that the runs do not excite nothing counts
    got = difference(one, replace(other, verdicts=("untested",) * len(other.names)), {}, {})
    assert got.largest == got.inclusion == 0.0
