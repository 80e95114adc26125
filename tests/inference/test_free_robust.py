"""A still that somebody touched is left out of a test in the hand."""

from __future__ import annotations

from dataclasses import replace

import hands
import numpy as np
import pytest

from imubayes.inference.case import Asked
from imubayes.inference.free_tumble import solve_free_tumble, trusted_stills
from imubayes.inference.prior import ScalePrior
from imubayes.inference.stills import find_stills, left_by
from imubayes.inference.triad import triad_of
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.terms import library

LIBRARY = library("accelerometer", powers=1, asymmetry=-1)
INDUSTRIAL = sensor("mems_industrial", kind="accelerometer")
TRUTH = {"ax.b0": 0.05, "ay.b1": 2e-3}


@pytest.fixture(scope="module")
def touched():
    """A record, and the same with one of its 24 stills off by 0.15 m/s^2 along x and y."""
    none = library("gyroscope", powers=1, asymmetry=-1)
    run = hands.in_the_hand(
        hands.with_truth(LIBRARY, TRUTH), hands.with_truth(none, {}, referenced=True), stills=24
    )
    run = replace(run, output=run.force)
    stills = find_stills(run)
    start, stop = stills[7]
    output = run.output.copy()
    output[start - 30 : stop + 30, :2] += 0.15
    return run, replace(run, output=output), stills


def asked():
    names = [one for lib in triad_of(LIBRARY).libraries for one in lib.terms]
    return Asked(LIBRARY, ScalePrior([prior_sd(INDUSTRIAL, term)[0] for term in names]), INDUSTRIAL)


def test_a_still_that_was_touched_is_found_and_the_others_say_what_they_said(touched):
    clean, spoilt, stills = touched
    runs, distrusted, case = trusted_stills([spoilt], asked(), rng=np.random.default_rng(1))
    assert len(distrusted) == 1
    t = spoilt.t[stills[7][0]], spoilt.t[stills[7][1] - 1]
    assert distrusted[0].start <= t[1] and distrusted[0].stop >= t[0]
    assert len(find_stills(runs[0])) == len(stills) - 1
    without = replace(clean, stills=find_stills(runs[0]))
    expected, found, pulled = (solve_free_tumble([run], asked()).theta for run in (without, runs[0], spoilt))
    np.testing.assert_array_equal(case.theta, found)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.abs(pulled - expected).max() > 10.0 * np.abs(found - expected).max() + 1e-3


def test_nothing_is_left_out_where_nobody_touched_anything(touched):
    clean, _, stills = touched
    runs, distrusted, _ = trusted_stills([clean], asked(), rng=np.random.default_rng(1))
    assert distrusted == () and find_stills(runs[0]) == stills


def test_a_spoilt_piece_of_a_long_rest_leaves_the_rest(touched):
    run, _, _ = touched
    span = float(run.t[400]) - 1e-6, float(run.t[500]) - 1e-6
    assert left_by(run, ((0, 1000), (1200, 1500)), [span]) == ((0, 400), (500, 1000), (1200, 1500))
