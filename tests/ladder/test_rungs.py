from dataclasses import replace

import numpy as np
import pytest
from ladders import ground, in_memory_and_streamed, problem

from imubayes.errors import InputError
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import LADDER
from imubayes.ladder.problem import change, ground_of, problem_of, size_of
from imubayes.ladder.rungs import foresee, provisional, stand
from imubayes.progress import silent
from imubayes.rig.inputs import Inputs, Run

NAMES = [rung.name for rung in LADDER]
SHORT = Limits(ess=200.0, time_limit=2.0)


@pytest.fixture(scope="module")
def climbed():
    one = problem()
    g = ground_of(one, np.random.default_rng(2), silent, SHORT)
    return g, {name: stand(name, g) for name in NAMES}


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
    ["means", "sparse", "plug-in", "averaged", "collapsed", pytest.param("full", marks=pytest.mark.slow)],
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


def test_every_row_at_every_step_is_refused_where_rows_are_not_held(twice):
    with pytest.raises(InputError, match=r"raw is not for this study.*a part at a time.*take full"):
        stand("raw", twice[1])
