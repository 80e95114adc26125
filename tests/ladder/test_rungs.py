"""Every rung's answer, against the others and in memory or streamed. The way up: what a budget or an accuracy
takes, and the method that is right where the study leaves it open, with the reason that is given."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from campaigns import campaign_of
from ladders import ground, in_memory_and_streamed, problem

import imubayes as ib
from imubayes.errors import InputError
from imubayes.inference.mcmc import run as sampled
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import RungName
from imubayes.ladder.costs import REFERENCE, foreseen
from imubayes.ladder.problem import change, ground_of, problem_of, size_of
from imubayes.ladder.rungs import NAMES, by_accuracy, by_budget, chosen_method, foresee, provisional, stand
from imubayes.rig.inputs import Inputs, Run
from imubayes.selection import decision
from imubayes.work import silent

SHORT = Limits(ess=200.0, time_limit=2.0)


@pytest.fixture(scope="module")
def climbed():
    one = problem()
    g = ground_of(one, np.random.default_rng(2), silent, SHORT)
    return g, {name: stand(name, g) for name in NAMES}


def test_what_the_next_rung_changes_is_foreseen_where_fewer_draws_are_averaged_over(climbed, monkeypatch):
    """Of many candidates the decision takes some of the draws of the noise."""
    before, whole = climbed
    monkeypatch.setattr(decision, "LARGEST", 5)
    g = ground_of(problem(), np.random.default_rng(2), silent, SHORT)
    few = stand("collapsed", g)
    assert len(few.selection.models.parts) < len(few.posterior.noises)
    (coefficients, inclusions), _ = foresee(g, few)
    (usual, _), _ = foresee(before, whole["collapsed"])
    assert 0.2 * usual < coefficients < 5.0 * usual and 0.0 <= inclusions < 1.0


def test_an_unknown_rung_is_answered_with_those_there_are():
    with pytest.raises(InputError, match=r"'fastest' is not known: expected one of means, sparse, plug-in"):
        stand("fastest", ground(problem()))


@pytest.mark.parametrize("rung", NAMES)
def test_every_rung_gives_an_answer_that_is_sound(climbed, rung):
    g, answers = climbed
    found = answers[rung]
    p = len(g.problem.library.terms)
    assert found.names == g.problem.library.names
    for values in (found.mean, found.inclusion, found.full_mean, found.full_sd):
        assert values.shape == (p,)
        assert np.isfinite(values).all()
    assert ((found.inclusion >= 0.0) & (found.inclusion <= 1.0)).all()
    assert (found.full_sd > 0.0).all()
    assert len(found.selection.terms) == p
    assert len(found.posterior.noise) == len(g.problem.runs)
    assert found.seconds > 0.0
    assert {"b0", "b1", "m_j"} <= set(found.model)


@pytest.mark.parametrize(
    ("lower", "upper"), [("plug-in", "averaged"), ("averaged", "collapsed"), ("collapsed", "full")]
)
def test_rungs_that_average_over_the_noise_agree_within_monte_carlo_error(climbed, lower, upper):
    g, answers = climbed
    foreseen, _ = foresee(g, answers[lower])
    coefficients, inclusions = change(answers[lower], answers[upper])
    assert coefficients < 0.1 + 4.0 * foreseen[0]
    assert inclusions < 0.02 + 4.0 * foreseen[1]


@pytest.mark.parametrize("rung", ["averaged", "collapsed", "full"])
def test_seconds_are_those_that_a_rung_takes_alone_though_it_was_on_the_ground_before(climbed, rung):
    g, _ = climbed
    assert stand(rung, g).seconds >= g.shared["factor"][1] + g.shared[rung][1] > g.shared["factor"][1]


def test_what_is_provisional_is_the_answer_at_the_estimated_noise_where_chains_are_to_follow(climbed):
    g, answers = climbed
    assert change(provisional("collapsed", g), answers["plug-in"]) == (0.0, 0.0)
    assert provisional("exact", g) is None and provisional("means", g) is None


def test_full_rung_and_every_row_agree(climbed):
    answers = climbed[1]
    # both from a thousand draws at most, of which two hundred count: 4 standard errors of the difference
    draws = 4.0 * np.sqrt(2.0 / 100.0)
    apart = np.abs(answers["raw"].full_mean - answers["full"].full_mean) / answers["full"].full_sd
    assert np.max(apart) < draws


def test_every_row_is_sampled_by_more_walkers_than_draws_are_kept_of_the_rung_below(monkeypatch):
    monkeypatch.setattr(sampled, "DRAWS", 50)
    many = replace(SHORT, walkers=60)
    found = stand("raw", ground_of(problem(), np.random.default_rng(2), silent, many))
    assert found.posterior.chains.theta.shape[:2] == (4, 50)
    assert np.isfinite(found.full_mean).all() and (found.full_sd > 0.0).all()


def test_free_tumbles_are_told_where_to_go():
    one = problem()
    run = one.runs[0]
    output = np.zeros((len(run.output), 3))
    free = Run("free", "free-tumble", Inputs(run.inputs.t, {}, 1.0), output, run.source, gravity=9.8)
    with pytest.raises(InputError, match=r"'free' is one of several components.*one component with known"):
        problem_of(one.spec, [free])


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    """Grounds of one recording: its rows in memory, and read a part at a time."""
    pair = in_memory_and_streamed(tmp_path_factory.mktemp("twice"))
    return tuple(ground_of(one, np.random.default_rng(2), silent, LONGER) for one in pair)


LONGER = Limits(ess=200.0, time_limit=30.0, seed=3)


@pytest.mark.parametrize(
    "rung",
    [
        "means",
        "sparse",
        "plug-in",
        "averaged",
        "collapsed",
        pytest.param("full", marks=pytest.mark.slow),
        pytest.param("raw", marks=pytest.mark.slow),
    ],
)
def test_a_streamed_run_says_what_its_rows_in_memory_say(twice, rung):
    whole, part = (stand(rung, g) for g in twice)
    # two means from 200 effective draws each; sds and the noise from as many
    draws = 4.0 * np.sqrt(2.0 / LONGER.ess)
    assert np.max(np.abs(part.full_mean - whole.full_mean) / whole.full_sd) < draws
    assert np.max(np.abs(np.log(part.full_sd / whole.full_sd))) < draws / np.sqrt(2.0)
    assert np.max(np.abs(part.mean - whole.mean) / whole.full_sd) < draws
    assert np.max(np.abs(part.inclusion - whole.inclusion)) < 0.05
    # 9,000 rows tell the white noise to an sd of a percent or so, by whatever averages it is judged
    assert abs(np.log(part.posterior.noise[0, 0] / whole.posterior.noise[0, 0])) < 0.04


def test_a_streamed_run_is_as_large_as_its_rows_in_memory(twice):
    whole, part = (size_of(g.problem) for g in twice)
    assert (whole.rows, whole.streamed) == (9000, 0)
    assert part == replace(whole, streamed=9000)


def _climbed(one, names, limits=None):
    """Answers of rungs that share what they have in common."""
    again = ground_of(one, np.random.default_rng(1), silent, limits)
    return [stand(name, again) for name in names]


def test_a_budget_takes_the_best_rung_that_fits_and_no_other():
    one, told = problem(dwell=4.0), []
    telling = ground_of(one, np.random.default_rng(1), lambda doing, share=None: told.append(doing), None)
    found, choice = by_budget(telling, 0.7, REFERENCE)
    assert choice.rung == found.rung == "plug-in"
    assert choice.climbed == ()
    assert "dwell means" not in told
    assert choice.next_rung == "averaged"
    assert choice.foreseen == foreseen("plug-in", size_of(one), REFERENCE) <= 0.7
    assert choice.seconds >= found.seconds
    assert choice.asked == "a budget of 0.7 s"
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


def test_an_accuracy_has_as_many_draws_of_the_noise_as_it_needs():
    one = problem()

    def averaged_at(accuracy, seed):
        return by_accuracy(ground_of(one, np.random.default_rng(seed), silent, SHORT), accuracy, REFERENCE)[0]

    usual, fine, again = averaged_at(0.3, 2), averaged_at(0.05, 2), averaged_at(0.05, 3)
    assert usual.rung == fine.rung == again.rung == "averaged"
    assert len(usual.posterior.noises) == 16 < min(len(one.posterior.noises) for one in (fine, again))
    assert change(fine, again)[0] < 0.05


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
