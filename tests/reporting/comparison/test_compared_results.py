"""Results side by side: what differs beyond uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from published_found import FILE, a_term

from imubayes.errors import InputError
from imubayes.reporting.comparison.pulls import LEVEL
from imubayes.reporting.comparison.result_files import ComponentFile, NoiseEstimate, ResultFile
from imubayes.reporting.comparison.results import compared, differing


def _part(id="A", values=((1.0, 0.1),), noise=((1.0, 0.1),), kind="accelerometer", runs="run"):
    terms = {f"b{k}": a_term(f"b{k}", *value) for k, value in enumerate(values)}
    found = {(f"{runs}{k}", "N"): NoiseEstimate(*value) for k, value in enumerate(noise)}
    return ComponentFile(id, kind, "", terms, found, tuple(terms))


def _file(*parts):
    return ResultFile(FILE, parts)


def test_difference_is_over_the_combined_sd():
    found = compared([_file(_part(values=[(5.0, 0.3)])), _file(_part(values=[(3.0, 0.4)]))])
    pull = found.components[0].terms[0].pull
    assert pull.size == pytest.approx(2.0 / 0.5, rel=1e-14) and pull.pair == ("A", "B")


def test_noise_differs_by_its_logarithm():
    found = compared([_file(_part(noise=[(math.e, 0.3)])), _file(_part(noise=[(1.0, 0.4)]))])
    assert found.components[0].noise[0].pull.size == pytest.approx(1.0 / 0.5, rel=1e-14)


def test_noise_that_was_given_is_not_compared_with_itself_and_has_no_sd():
    found = compared([_file(_part(noise=[(2.0, 0.0)])), _file(_part(noise=[(1.0, 0.0)]))])
    assert found.components[0].noise[0].pull is None and found.tests == 1


def test_a_false_alarm_anywhere_has_the_level_at_most():
    """Equal truths, 300 pairs of results of 20 values: alarms are binomial, so 4 sd above the level."""
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(300):
        drawn = rng.standard_normal((2, 20))
        files = [_file(_part(values=[(x, 1.0) for x in row], noise=())) for row in drawn]
        alarms += any(True for _ in differing(compared(files).components[0]))
    assert alarms / 300 <= LEVEL + 4.0 * math.sqrt(LEVEL * (1.0 - LEVEL) / 300)
    assert alarms > 0


def test_true_difference_far_beyond_the_threshold_is_found_and_comes_first():
    a = _part(values=[(0.0, 1.0), (0.0, 1.0), (0.0, 1.0)], noise=[(1.0, 0.01)])
    b = _part(values=[(9.0, 1.0), (0.5, 1.0), (-20.0, 1.0)], noise=[(1.1, 0.01)])
    (component,) = compared([_file(a), _file(b)]).components
    sizes = [entry.pull.size for entry in differing(component)]
    assert sizes == sorted(sizes, reverse=True) and len(sizes) == 3
    assert not component.terms[1].pull.beyond


def test_threshold_counts_every_pair_of_every_value():
    three = compared([_file(_part(values=[(k, 1.0), (k, 1.0)])) for k in (0.0, 1.0, 2.0)])
    assert three.tests == 3 * 3
    assert three.components[0].terms[0].pull.pair == ("A", "C")


def test_sensors_are_matched_by_id_whatever_their_order():
    found = compared([_file(_part("P"), _part("Q")), _file(_part("Q"), _part("P"))])
    ids = [[one.id for one in c.members] for c in found.components]
    assert ids == [["P", "P"], ["Q", "Q"]] and not any(c.by_order for c in found.components)


def test_sensors_of_other_ids_are_matched_by_kind_and_order_and_said_so():
    gyro = _part("G1", kind="gyroscope")
    found = compared([_file(_part("P"), gyro), _file(replace(gyro, id="G2"), _part("Q"), _part("R"))])
    ids = {tuple(one.id for one in c.members) for c in found.components}
    assert ids == {("P", "Q"), ("G1", "G2")} and all(c.by_order for c in found.components)
    assert found.alone == (("B", "R"),)


def test_components_of_triads_are_matched_with_their_own_axis():
    found = compared([_file(_part("P.ax"), _part("P.ay")), _file(_part("Q.ay"), _part("Q.ax"))])
    assert {tuple(one.id for one in c.members) for c in found.components} == {
        ("P.ax", "Q.ax"),
        ("P.ay", "Q.ay"),
    }


def test_runs_of_other_names_are_compared_in_their_order():
    found = compared([_file(_part(runs="monday")), _file(_part(runs="friday", noise=[(9.0, 0.1)]))])
    (noise,) = found.components[0].noise
    assert noise.run == "monday0" and noise.pull.beyond


def test_untested_term_is_not_compared():
    a, b = _part(), _part()
    b = replace(b, terms={"b0": a_term("b0", 99.0, 0.1, "untested")})
    (component,) = compared([_file(a), _file(b)]).components
    assert component.terms[0].pull is None and component.terms[0].verdicts_differ


def test_results_agree_with_themselves_whatever_they_hold():
    one = _file(_part(values=[(1.0, 0.1), (math.nan, math.nan), (0.0, 0.0)]))
    (component,) = compared([one, one]).components
    assert list(differing(component)) == [] and component.terms[1].pull is None


def test_what_cannot_be_compared_is_refused():
    one = _file(_part())
    with pytest.raises(InputError, match="2 to 26 results"):
        compared([one])
    with pytest.raises(InputError, match="no kind of sensor in common"):
        compared([one, _file(_part(kind="gyroscope"))])
    other = replace(_part(), terms={"b0": replace(a_term("b0", 1.0, 1.0), unit="rad/s")})
    with pytest.raises(InputError, match="b0 has different units"):
        compared([one, _file(other)])
