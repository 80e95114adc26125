"""Data that contradict the prior: a wrong sign or unit must be told, not explained away."""

from dataclasses import replace

import numpy as np
import pytest

import imubayes as ib
from imubayes.inference.linear import linear_of
from imubayes.inference.residuals import check_residuals
from imubayes.selection.verdicts import STRAINED

SENSOR = ib.sensor("mems_tactical", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
TRUTH = {"b0": 5e-3, "b1": 2e-4}


def _run(truth=TRUTH):
    (run,) = ib.simulate(SENSOR, [ib.tumble(angles=12, planes=2, dwell=10.0, rate=1.0)], seed=5, truth=truth)
    return run


def _wrong(run, mistake):
    if mistake == "flipped output":
        return replace(run, output=-run.output)
    if mistake == "output in mg":
        return replace(run, output=1000.0 * run.output)
    if mistake == "input left out":
        channels = {name: values for name, values in run.inputs.channels.items() if name != "f_i"}
        return replace(run, inputs=replace(run.inputs, channels=channels))
    return run


def _decided(run):
    summary = ib.summarize([run], LIBRARY, sensor=SENSOR)
    selection = ib.select(summary, ib.prior(SENSOR, LIBRARY))
    return summary, selection


@pytest.mark.parametrize("mistake", ["flipped output", "output in mg"])
def test_wrong_sign_or_unit_strains_the_prior(mistake):
    _, selection = _decided(_wrong(_run(), mistake))
    assert max(term.strain for term in selection.terms) > 10.0 * STRAINED


def test_run_without_its_own_input_does_not_fit_and_needs_no_term():
    run = _wrong(_run(), "input left out")
    summary, selection = _decided(run)
    assert not check_residuals(run, linear_of(run, LIBRARY), selection.free, summary.runs[0]).fits
    assert all(term.verdict != "needed" for term in selection.terms)


@pytest.mark.parametrize(("name", "size"), [("b1", 0.02), ("b0", 0.5)])
def test_unit_far_outside_its_class_is_needed_named_and_still_explained(name, size):
    run = _run(TRUTH | {name: size})
    summary, selection = _decided(run)
    (term,) = [term for term in selection.terms if term.name == name]
    assert term.strain == pytest.approx(size / term.prior_sd, rel=0.05)
    assert term.inclusion > 0.99
    checked = check_residuals(run, linear_of(run, LIBRARY), selection.free, summary.runs[0])
    assert checked.scale == pytest.approx(1.0, abs=0.3)


def test_unit_of_its_class_strains_nothing():
    _, selection = _decided(_run())
    assert max(term.strain for term in selection.terms) < STRAINED
    assert np.all(np.isfinite(selection.free))
