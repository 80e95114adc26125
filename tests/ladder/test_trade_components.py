from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ladders import in_memory_and_streamed
from trades import SHORT, problem, told

from imubayes.campaign import Study
from imubayes.errors import InputError
from imubayes.inference import SIDE
from imubayes.inference.linear import linear_of
from imubayes.inference.whiten import whiten
from imubayes.ladder.trade.components import (
    FEWEST,
    NAMES,
    Repeat,
    Subject,
    afforded,
    answered,
    drawn,
    of_lots,
    of_study,
    score,
    simulated_again,
)
from imubayes.rig.bench import true_inputs
from imubayes.rig.simulate import drawn_errors
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns
from imubayes.study.schema import read

LOTS = Path(__file__).parents[2] / "studies" / "mems_vs_fog.toml"


@pytest.fixture(scope="module")
def lots():
    study = read(LOTS)[1]
    assert study
    return replace(study, missions=())


def test_a_lot_gives_one_unit_of_each_class_and_further_units_as_repeats(lots):
    found = of_lots(lots, ["mems_tactical", "fog_tactical"], repeats=5)
    assert [one.name for one in found.subjects] == ["mems_tactical", "fog_tactical"]
    for subject in found.subjects:
        np.testing.assert_array_equal(drawn(subject, None, 1).truth, subject.lot.theta[2])
        assert not np.array_equal(subject.lot.theta[2], subject.lot.theta[0])


def test_the_bench_of_a_lot_is_allowed_for(lots):
    (one,) = of_lots(lots, ["fog_tactical"], repeats=2).subjects
    own = {spec.sensor_class.id: spec.reference for spec in lots.specs}
    assert one.problem.spec.reference == own["fog_tactical"]


def test_names_that_are_not_in_the_study_are_refused(lots):
    with pytest.raises(InputError, match="did you mean 'fog_tactical'"):
        of_lots(lots, ["fog_tacticl"])
    spec = problem().spec
    with pytest.raises(InputError, match="no sensor of the study is called 'x'"):
        of_study(Study("s", 1, (spec,), Path("s.toml"), ""), ["x"])


HAND = """
[[sensor]]
id = "hand"
kind = "accelerometer"
class = "mems_consumer"
[[sensor.run]]
name = "r"
procedure = "free-tumble"
simulate = { attitudes = 18, dwell = "1 s", rate = "20 Hz" }
"""


def test_what_a_trade_cannot_measure_is_left_out_and_where_nothing_is_left_refused(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(HAND)
    free = read(path)[1]
    with pytest.raises(
        InputError, match=r"study\.toml: a trade measures single components with known inputs"
    ):
        of_study(free)
    known = replace(problem().spec, id="known")
    trade = of_study(replace(free, sensors=(*free.sensors, known)))
    assert [subject.name for subject in trade.subjects] == ["known"]
    assert [name for name, _ in trade.left_out] == ["hand"]


SILENT = [(0.0, 0.0, 0.0)]


def test_a_repeat_has_the_coefficients_and_the_noise_that_it_was_given():
    one = problem()
    theta = np.linspace(-1.0, 1.0, len(one.library.terms)) * 1e-4
    quiet, noisy = (
        simulated_again(one, theta, [(N, 0.0, 0.0)], np.random.default_rng(1)) for N in (0.0, 1e-3)
    )
    rows = linear_of(quiet.runs[0], one.library)
    np.testing.assert_allclose(rows.y, rows.columns(0, len(rows)) @ theta, rtol=0.0, atol=1e-12)
    assert [run.name for run in quiet.runs] == [run.name for run in one.runs]
    left = noisy.runs[0].output - quiet.runs[0].output
    sd = 1e-3 / np.sqrt(one.runs[0].inputs.interval)
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


def test_a_repeat_of_a_streamed_run_is_the_same_rows_at_every_pass_of_known_truth(tmp_path):
    whole, part = in_memory_and_streamed(tmp_path, 20_000)
    part = replace(part, spec=replace(part.spec, reference={"gravity": 1e-3, "turn_on": 1e-3}))
    theta = np.linspace(-1.0, 1.0, len(part.library.terms)) * 1e-4
    quiet, noisy = (
        simulated_again(part, theta, [noise], np.random.default_rng(1)).runs[0]
        for noise in ((0.0, 0.0, 0.0), (1e-3, 2e-3, 1e-4))
    )
    rng, held = np.random.default_rng(1), whole.runs[0]
    errors = drawn_errors([held], part.spec.reference, rng)
    moved = true_inputs(held, errors).channels
    X = columns(part.library, moved, len(held.inputs), said=held.inputs.channels)
    expected = moved["f_i"] + X @ theta + errors["turn_on.r"]
    first, second = (np.concatenate([rows.output for rows in noisy.parts("again")]) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    still = np.concatenate([rows.output for rows in quiet.parts("all")])
    np.testing.assert_allclose(still, expected, rtol=0.0, atol=1e-12)
    left = whiten(Noise(1e-3, 2e-3, 1e-4), linear_of(held, part.library).rows, (first - still)[:, None])[0]
    assert abs(left.std() - 1.0) < 4.0 / np.sqrt(2.0 * len(left))
    # what is held of them are averages, extremes and a stretch of these very rows
    starts = np.concatenate(([0], np.cumsum(noisy.stream.counts)[:-1]))
    np.testing.assert_allclose(noisy.output, np.add.reduceat(first, starts) / noisy.stream.counts, rtol=1e-9)
    assert first.max() == noisy.extremes["output"].max()
    stretch = noisy.stream.stretch
    np.testing.assert_array_equal(stretch.output, first[stretch.first : stretch.first + len(stretch)])


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


NONE = {"<ACC>": {}}


def _repeats(*pairs):
    return [Repeat("<ACC>", 0, np.array(truth), answers=(one,)) for truth, one in pairs]


def test_a_rung_that_draws_from_its_own_posterior_holds_nine_in_ten():
    rng = np.random.default_rng(1)
    means = rng.normal([1.0, 0.0, 0.0], 0.01, size=(400, 3))
    repeats = _repeats(*(([1.0, 0.0, 0.0], told(full_mean=mean)) for mean in means))
    found = score("plug-in", repeats, EQUAL, NONE)
    # of the third term the test cannot tell: two terms a repeat count
    assert found.coverage.of == 800
    held = np.abs(means[:, :2] - [1.0, 0.0]) <= SIDE * 0.01
    assert found.coverage.events == held.sum()
    assert abs(found.coverage.share.value - 0.9) < 4.0 * np.sqrt(0.09 / 800)
    assert abs(found.error - 1.0) < 4.0 / np.sqrt(2 * 800)


def test_wrong_verdicts_are_counted_against_the_truth():
    right = ([1.0, 0.0, 0.0], told())
    alarm = ([0.0, 0.0, 0.0], told())  # b0 is needed, and zero
    silent = ([1.0, 0.5, 0.0], told())  # b1 is not needed, and half of its prior sd
    found = score("plug-in", _repeats(right, alarm, silent), Costs(1.0, 4.0), NONE)
    assert (found.false_needed.events, found.false_needed.of) == (1, 1 + 2 + 3)
    assert (found.false_not_needed.events, found.false_not_needed.of) == (1, 3)
    assert (found.missed_large.events, found.missed_large.of) == (1, 3)
    assert found.cost == pytest.approx((1.0 * 1 + 4.0 * 1) / 3)
    assert np.isnan(found.scene_terms)


def test_errors_are_counted_in_the_sd_of_the_best_rung_that_answered():
    wide = told("means", full_mean=np.array([1.03, 0.0, 0.0]), full_sd=np.array([0.1, 0.1, 1.0]))
    one = Repeat("<ACC>", 0, np.array([1.0, 0.0, 0.0]), answers=(wide, told()))
    found = score("means", [one], EQUAL, NONE)
    assert found.error == pytest.approx(3.0 / np.sqrt(2.0))
    assert found.coverage.events == 2


def test_a_rung_that_answered_nothing_has_no_score():
    assert score("raw", _repeats(([0.0, 0.0, 0.0], told())), EQUAL, NONE) is None
