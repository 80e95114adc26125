"""Results of sensors side by side: what differs beyond uncertainty, each difference by a second route."""

import math
from dataclasses import replace

import numpy as np
import pytest
from published_found import FILE, a_result, a_sensor, a_term
from results_found import sampled_result, study_result
from scenes_found import a_relevance
from scipy import stats

from imubayes.errors import InputError
from imubayes.inference import SIDE
from imubayes.reporting.comparison.differences import LEVEL, differing, fisher, largest, normal_of
from imubayes.reporting.comparison.page import comparison_record
from imubayes.reporting.comparison.sensors import SENSORS, noise_of, sensors_compared
from imubayes.reporting.results import published_result
from imubayes.reporting.scene_words import published_scene


def _part(id="A", values=((1.0, 0.1),), noise=((1.0, 0.1),), runs="run", **other):
    terms = [a_term(f"b{k}", *value) for k, value in enumerate(values)]
    return a_sensor(id, terms, {f"{runs}{k}": value for k, value in enumerate(noise)}, **other)


def _compared(*results):
    return sensors_compared([FILE] * len(results), results)


def _pair(a, b):
    """The one component that two results have in common."""
    (component,) = _compared(a_result(a), a_result(b)).groups
    return component


def _ids(found):
    return [tuple(one["id"] if one else None for one in group.members) for group in found.groups]


def test_difference_is_over_the_combined_sd():
    pull = _pair(_part(values=[(5.0, 0.3)]), _part(values=[(3.0, 0.4)])).terms["b0"].pull
    assert pull.size == pytest.approx(2.0 / 0.5, rel=1e-14) and pull.pair == ("A", "B")


def test_noise_differs_by_its_logarithm():
    found = _pair(_part(noise=[(math.e, 0.3)]), _part(noise=[(1.0, 0.4)]))
    assert found.noise["run0", "N"].pull.size == pytest.approx(1.0 / 0.5, rel=1e-14)


def test_noise_that_was_given_is_not_compared_with_itself_and_has_no_sd():
    found = _compared(a_result(_part(noise=[(2.0, 0.0)])), a_result(_part(noise=[(1.0, 0.0)])))
    assert found.groups[0].noise["run0", "N"].pull is None and found.tests == 1


def test_sampled_noise_has_the_mean_and_sd_of_its_draws():
    (sensor,) = published_result(study_result(sampled_result()))["sensors"]
    for (run, letter), (mean, log_sd) in noise_of(sensor).items():
        said = sensor["noise_posterior"][run][letter]
        # a log-normal of this mean and log sd has the sd that the draws have
        assert mean == said["mean"]
        assert mean * math.sqrt(math.expm1(log_sd**2)) == pytest.approx(said["sd"], rel=1e-10)


def test_a_false_alarm_anywhere_has_the_level_at_most():
    """Equal truths, 300 pairs of results of 20 values: alarms are binomial, so 4 sd above the level."""
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(300):
        drawn = rng.standard_normal((2, 20))
        parts = (_part(values=[(x, 1.0) for x in row], noise=()) for row in drawn)
        alarms += bool(differing(_pair(*parts).entries))
    assert 0 < alarms / 300 <= LEVEL + 4.0 * math.sqrt(LEVEL * (1.0 - LEVEL) / 300)


def test_true_difference_far_beyond_the_threshold_is_found_and_comes_first():
    a = _part(values=[(0.0, 1.0), (0.0, 1.0), (0.0, 1.0)], noise=[(1.0, 0.01)])
    b = _part(values=[(9.0, 1.0), (0.5, 1.0), (-20.0, 1.0)], noise=[(1.1, 0.01)])
    assert [name for name, _ in differing(_pair(a, b).entries)] == ["b2", "noise N of run run0", "b0"]


def test_threshold_leaves_the_level_to_every_pair_of_every_value_together():
    three = _compared(*(a_result(_part(values=[(k, 1.0), (k, 1.0)])) for k in (0.0, 1.0, 2.0)))
    assert three.tests == 3 * 3
    assert math.erfc(three.threshold / math.sqrt(2.0)) * 9 == pytest.approx(LEVEL, rel=1e-10)
    assert three.groups[0].terms["b0"].pull.pair == ("A", "C")


@pytest.mark.parametrize(
    ("first", "second", "matched", "alone"),
    [
        ("PQ", "QP", {("P", "P"), ("Q", "Q")}, []),
        (["P", "G1"], ["G2", "Q", "R"], {("P", "Q"), ("G1", "G2")}, [("B", "R")]),
        (["P.ax", "P.ay"], ["Q.ay", "Q.ax"], {("P.ax", "Q.ax"), ("P.ay", "Q.ay")}, []),
    ],
    ids=["by id", "by kind and order", "by axis of a triad"],
)
def test_sensors_are_matched(first, second, matched, alone):
    results = [
        a_result(*(_part(id, kind="gyroscope" if id[0] == "G" else "accelerometer") for id in ids))
        for ids in (first, second)
    ]
    found = _compared(*results)
    assert set(_ids(found)) == matched and found.alone == alone
    by = {one["matched_by"] for one in comparison_record(found, SENSORS)["components"]}
    assert by == ({"id"} if first == "PQ" else {"order"})


def test_results_agree_with_themselves_whatever_they_hold():
    one = _part(values=[(1.0, 0.1), (math.nan, math.nan), (0.0, 0.0)])
    found = _pair(one, one)
    assert differing(found.entries) == [] and found.terms["b1"].pull is None


def test_what_cannot_be_compared_is_refused():
    one = a_result(_part())
    with pytest.raises(InputError, match="2 to 26 results"):
        _compared(one)
    with pytest.raises(InputError, match="no kind of sensor in common"):
        _compared(one, a_result(_part(kind="gyroscope")))
    other = _part() | {"terms": (a_term("b0", 1.0, 1.0, unit="rad/s"),)}
    with pytest.raises(InputError, match="b0 has different units"):
        _compared(one, a_result(other))


def _scenes(*scenes, seed=1):
    return a_result(_part(), scenes=[published_scene(one, "A") for one in scenes], seed=seed)


def _moved(name, low, half, high, *, kept=True):
    """The made-up scene with another share of one term, and another model."""
    found = a_relevance()
    terms = tuple(
        replace(t, share_q05=low, share_of_budget=half, share_q95=high, kept=kept) if t.name == name else t
        for t in found.terms
    )
    return replace(found, terms=terms, model=tuple(t.name for t in terms if t.kept))


def test_shares_differ_by_the_error_over_its_sd():
    found = _compared(_scenes(a_relevance()), _scenes(_moved("b2", 1.2, 1.3, 1.4)))
    ((scene,),) = (group.scenes for group in found.groups)
    sd = 100.0 * (0.4 - 0.2) / (2.0 * SIDE)
    assert scene.terms["b2"].pull.size == pytest.approx(100.0 / (2.0**0.5 * sd), rel=1e-12)
    assert [name for name, term in scene.terms.items() if term.beyond] == ["b2"]


def test_scenes_are_matched_by_name_and_by_what_is_budgeted():
    found = a_relevance()
    other = replace(found, scene="marine")
    turned = replace(found, budget=replace(found.budget, quantity="attitude"))
    scenes = _compared(_scenes(found, other), _scenes(turned, other, found)).groups[0].scenes
    assert [(one.name, one.record["quantity"]) for one in scenes] == [
        ("quadrotor", "position"),
        ("marine", "position"),
    ]


def test_untested_term_is_not_compared():
    b0 = _pair(_part(), _part() | {"terms": (a_term("b0", 99.0, 0.1, "untested"),)}).terms["b0"]
    assert b0.pull is None and b0.divided


@pytest.mark.parametrize(("a", "n", "b", "m"), [(8, 8, 0, 8), (3, 10, 7, 8), (0, 9, 1, 9), (40, 50, 10, 60)])
def test_shares_differ_as_the_ways_to_deal_them_out_say(a, n, b, m):
    ways = [math.comb(n, k) * math.comb(m, a + b - k) if k <= a + b else 0 for k in range(n + 1)]
    p = sum(count for count in ways if count <= ways[a]) / sum(ways)
    # a normal's two-sided tail; where everything is as likely, p = 1 has the size 0
    assert 2.0 * stats.norm.sf(fisher((a, n), (b, m))) == pytest.approx(p, rel=1e-8)
    assert fisher((a, n), (b, m)) == pytest.approx(fisher((b, m), (a, n)), rel=1e-12)


def test_shares_of_a_thousand_have_a_finite_size():
    assert np.isfinite(fisher((0, 1000), (1000, 1000)))


def test_largest_difference_of_shares_names_its_pair():
    pull = largest([(8, 8), (7, 8), None, (0, 8)], fisher)
    assert pull.pair == ("A", "D") and pull.size == fisher((8, 8), (0, 8))


def test_interval_of_a_normal_gives_its_sd_back():
    low, high = stats.norm(3.0, 0.7).ppf([0.05, 0.95])
    assert normal_of(low, high) == pytest.approx(0.7, rel=1e-12)
