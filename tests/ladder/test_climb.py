"""The way up: what a budget or an accuracy takes, and the method that is right where the study leaves it
open, with the reason that is given."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from campaigns import campaign_of
from ladders import ground, problem

import imubayes as ib
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import RungName
from imubayes.ladder.costs import REFERENCE, foreseen
from imubayes.ladder.problem import change, ground_of, size_of
from imubayes.ladder.rungs import NAMES, by_accuracy, by_budget, chosen_method, stand
from imubayes.progress import silent

SHORT = Limits(ess=200.0, time_limit=2.0)


def _climbed(one, names, limits=None):
    """Answers of rungs that share what they have in common."""
    again = ground_of(one, np.random.default_rng(1), silent, limits)
    return [stand(name, again) for name in names]


def test_a_budget_takes_the_best_rung_that_fits_and_no_other():
    one, told = problem(dwell=4.0), []
    telling = ground_of(one, np.random.default_rng(1), lambda doing, share=None: told.append(doing), None)
    found, choice = by_budget(telling, 0.25, REFERENCE)
    assert choice.rung == found.rung == "plug-in"
    assert choice.climbed == ()
    assert "dwell means" not in told
    assert choice.next_rung == "averaged"
    assert choice.foreseen == foreseen("plug-in", size_of(one), REFERENCE) <= 0.25
    assert choice.seconds >= found.seconds
    assert choice.asked == "a budget of 0.25 s"
    # noise that is known to some percent moves no coefficient by a good part of its sd
    assert 0.0 < choice.next_change[0] < 0.3


def test_a_budget_that_nothing_fits_gets_the_cheapest_rung():
    found, choice = by_budget(ground(problem(dwell=4.0), 1), 1e-6, REFERENCE)
    assert found.rung == "means"
    assert choice.foreseen > 1e-6
    assert choice.next_reason


def test_an_accuracy_climbs_until_two_rungs_agree():
    one = problem(dwell=4.0)
    climbed = ground_of(one, np.random.default_rng(1), silent, SHORT)
    found, choice = by_accuracy(climbed, 0.5, REFERENCE)
    names = [name for name, _, _ in choice.climbed]
    assert names == list(NAMES[: len(names)])
    assert found.rung == choice.rung == names[-1]
    changes = [moved for _, moved, _ in choice.climbed[1:]]
    assert changes[-1] <= 0.5
    assert all(moved > 0.5 for moved in changes[:-1])
    # climbing shares what rungs have in common, and changes no answer
    again = _climbed(one, names, SHORT)
    assert change(again[-2], again[-1]) == pytest.approx(choice.climbed[-1][1:], abs=1e-12)


def test_the_change_foreseen_from_dwell_means_has_the_size_of_the_change():
    one = problem()
    first, second = _climbed(one, NAMES[:2])
    _, choice = by_budget(ground(one, 1), 1e-6, REFERENCE)
    assert (choice.rung, second.rung) == ("means", "sparse")
    moved = change(first, second)[0]
    assert moved / 3.0 < choice.next_change[0] < 3.0 * moved


FIXED = ib.NoiseRule("fixed", ib.Noise(6e-4, 4e-4, 3e-6))


@pytest.fixture(scope="module")
def summaries():
    """Of noise that is estimated or given, of what takes long to sample, and of what nearly does."""
    estimated = campaign_of().summary
    factor, runs = estimated.factor, [replace(run, name=f"r{k}") for k in range(3) for run in estimated.runs]
    several = replace(estimated, runs=tuple(runs))
    return {
        "estimated": estimated,
        "given": campaign_of({"tumble": FIXED, "centrifuge": FIXED}).summary,
        "long": replace(estimated, factor=replace(factor, n=3_000_000)),
        "several": several,
        "wide": replace(several, factor=replace(factor, names=tuple(f"x{k}" for k in range(100)))),
    }


@pytest.mark.parametrize(
    ("of", "method", "said"),
    [
        ("estimated", "collapsed", "tumble, centrifuge"),
        ("given", "plug-in", "given"),
        ("long", "plug-in", "3,000,000"),
        ("several", "collapsed", "is estimated"),
        ("wide", "plug-in", "6 runs beside 100 columns"),
    ],
)
def test_noise_is_sampled_where_it_is_not_given_and_that_takes_no_minutes(summaries, of, method, said):
    found, reason = chosen_method("auto", summaries[of])
    assert found == method
    assert said in reason


@pytest.mark.parametrize("wanted", get_args(RungName))
def test_what_the_study_or_the_command_line_asks_for_is_done(summaries, wanted):
    for summary in summaries.values():
        assert chosen_method(wanted, summary) == (wanted, f"the method {wanted} was asked for")
