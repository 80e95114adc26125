import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from trades import SHORT, problem, told

from imubayes.inference.linear import linear_of
from imubayes.ladder.trade.components import (
    FEWEST,
    NAMES,
    Subject,
    afforded,
    answered,
    drawn,
    simulated_again,
)
from imubayes.rig.bench import true_inputs

SILENT = [(0.0, 0.0, 0.0)]


def test_least_squares_gives_back_what_was_simulated_without_noise():
    one = problem()
    theta = np.linspace(-1.0, 1.0, len(one.library.terms)) * 1e-4
    again = simulated_again(one, theta, SILENT, np.random.default_rng(1))
    rows = linear_of(again.runs[0], one.library)
    X = rows.columns(0, len(rows))
    np.testing.assert_allclose(rows.y, X @ theta, rtol=0.0, atol=1e-12)
    assert [run.name for run in again.runs] == [run.name for run in one.runs]


def test_noise_of_a_repeat_has_the_density_it_was_given():
    one = problem()
    again = simulated_again(
        one, np.zeros(len(one.library.terms)), [(1e-3, 0.0, 0.0)], np.random.default_rng(1)
    )
    run = again.runs[0]
    left = run.output - run.inputs.channels["f_i"]
    sd = 1e-3 / np.sqrt(run.inputs.interval)
    assert abs(left.std() / sd - 1.0) < 4.0 / np.sqrt(2.0 * len(left))


def test_errors_of_the_bench_are_drawn_with_the_sd_that_is_stated():
    one = problem(gravity=1e-4)
    zero, drawn = np.zeros(len(one.library.terms)), []
    for seed in range(200):
        run = simulated_again(one, zero, SILENT, np.random.default_rng(seed)).runs[0]
        moved = true_inputs(run, {"gravity": 1.0}).channels["f_i"] - run.inputs.channels["f_i"]
        drawn.append(float(moved @ (run.output - run.inputs.channels["f_i"]) / (moved @ moved)))
    assert abs(np.std(drawn) / 1e-4 - 1.0) < 4.0 / np.sqrt(2.0 * len(drawn))
    assert abs(np.mean(drawn)) < 4.0 * 1e-4 / np.sqrt(len(drawn))


def test_rungs_of_a_repeat_answer_for_the_truth_that_was_drawn():
    subject = Subject("a", problem())
    names = subject.problem.library.names
    theta = np.array([{"b0": 0.05, "m_j": -0.002}.get(name, 0.0) for name in names])
    one = drawn(subject, told(draws=theta[None], noises=np.array([[[5e-4, 1e-4, 0.0]]])), 0)
    got, again = (answered(one, subject, ("means", "plug-in"), SHORT, (1,)) for _ in range(2))
    assert [found.rung for found in got.answers] == ["means", "plug-in"]
    np.testing.assert_array_equal(got.truth, theta)
    assert all({"b0", "m_j"} <= set(found.model) for found in got.answers)
    best = got.answers[-1]
    assert np.all(np.abs(best.full_mean - theta) < 5.0 * best.full_sd)
    # the same seed gives the same repeat
    np.testing.assert_array_equal(again.answers[1].mean, best.mean)


SECONDS = st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=len(NAMES)).map(
    lambda each: dict(zip(NAMES, sorted(each), strict=False))
)


@given(SECONDS, st.integers(0, 100), st.floats(0.0, 1e4), st.integers(1, 8))
def test_repeats_fit_into_the_time_and_better_rungs_have_no_more_of_them(seconds, repeats, left, processes):
    found = afforded(seconds, repeats, left, processes)
    taken = sum(count * seconds[rung] for rung, count in found.items())
    assert taken <= left * processes * (1.0 + 1e-9)
    assert list(found) == list(seconds)[: len(found)]
    numbers = list(found.values())
    assert all(min(FEWEST, repeats) <= count <= repeats for count in numbers)
    assert (
        len(found) == len(seconds) or not repeats or left * processes - taken < FEWEST * max(seconds.values())
    )
