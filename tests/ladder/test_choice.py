"""The method that is right where the study leaves it open, and the reason that is given."""

from dataclasses import replace
from typing import get_args

import pytest
from campaigns import campaign_of

import imubayes as ib
from imubayes.ladder import RungName
from imubayes.ladder.rungs import chosen_method

FIXED = ib.NoiseRule("fixed", ib.Noise(6e-4, 4e-4, 3e-6))


@pytest.fixture(scope="module")
def campaign():
    return campaign_of()


@pytest.fixture(scope="module")
def given():
    return campaign_of({"tumble": FIXED, "centrifuge": FIXED})


def test_given_noise_is_exact(given):
    method, reason = chosen_method("auto", given.summary)
    assert method == "plug-in"
    assert "given" in reason


def test_estimated_noise_is_sampled_and_the_runs_are_named(campaign):
    method, reason = chosen_method("auto", campaign.summary)
    assert method == "collapsed"
    assert "tumble, centrifuge" in reason


def test_so_many_rows_that_sampling_takes_long_are_exact_and_say_so(campaign):
    huge = replace(campaign.summary, factor=replace(campaign.summary.factor, n=3_000_000))
    method, reason = chosen_method("auto", huge)
    assert method == "plug-in"
    assert "3,000,000" in reason


def test_so_many_columns_that_sampling_takes_long_are_exact_and_say_so(campaign):
    summary = campaign.summary
    wide = replace(summary, runs=tuple(replace(run, name=f"r{k}") for k in range(3) for run in summary.runs))
    assert chosen_method("auto", wide)[0] == "collapsed"
    wide = replace(wide, factor=replace(summary.factor, names=tuple(f"x{k}" for k in range(100))))
    method, reason = chosen_method("auto", wide)
    assert method == "plug-in"
    assert "6 runs beside 100 columns" in reason
    assert chosen_method("collapsed", wide)[0] == "collapsed"


@pytest.mark.parametrize("wanted", get_args(RungName))
def test_what_the_study_or_the_command_line_asks_for_is_done(campaign, given, wanted):
    for c in (campaign, given):
        assert chosen_method(wanted, c.summary) == (wanted, f"the method {wanted} was asked for")
