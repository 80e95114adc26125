"""More candidates than are enumerated: the decision's own path, against enumeration and a known truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

import imubayes as ib
from imubayes import ScalePrior, Summary
from imubayes.selection import enumerate, search
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import components_given, inclusion_given, inclusion_of_any
from imubayes.selection.spaces import Listed

NAMES = tuple(f"x{k}" for k in range(14))


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(60, 14)) + 0.7 * rng.normal(size=(60, 1))
    theta = np.where(rng.random(14) < 0.4, rng.normal(0.0, 0.5, 14), 0.0)
    return Summary.from_arrays(X, X @ theta + rng.normal(size=60), NAMES), ScalePrior(0.5)


@pytest.mark.parametrize("needs", [(), (("x3", "x1"), ("x5", "x3"))])
def test_searched_posterior_is_the_enumerated_one(problem, monkeypatch, needs):
    """What is missing is 1e-6 at most, so that no probability differs by more."""
    exact = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    found = enumerate_models(*problem, always=("x0",), scale=1.0, needs=needs)
    assert isinstance(found.space, Listed)
    assert 0.0 < found.missing <= 1e-6
    assert found.error == 0.0
    np.testing.assert_allclose(found.inclusion, exact.inclusion, atol=2e-6)
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=2e-6)
    # moments are those of a systematic sample of the models, 2,000 of them
    assert np.all(np.abs(found.mean - exact.mean)[1:] < 0.02 * exact.sd[1:])
    np.testing.assert_allclose(found.sd[1:], exact.sd[1:], rtol=0.05)
    given = inclusion_given(found, ("x5",)) - inclusion_given(exact, ("x5",))
    assert np.abs(given).max() < 1e-3
    assert inclusion_of_any(found, ("x2", "x4")) == pytest.approx(
        inclusion_of_any(exact, ("x2", "x4")), abs=3e-6
    )
    full, alike = (components_given(m, NAMES[1:]).moments() for m in (found, exact))
    np.testing.assert_allclose(np.array(full)[:, 1:], np.array(alike)[:, 1:], rtol=1e-9)


def test_sampled_posterior_is_the_enumerated_one_within_its_error(problem, monkeypatch):
    exact = enumerate_models(*problem, scale=1.0)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    monkeypatch.setattr(search, "TOLERANCE", 1e-300)
    monkeypatch.setattr(search, "EFFORT", 2.0)
    found = enumerate_models(*problem, scale=1.0)
    assert math.isnan(found.missing)
    assert 0.0 < found.error < 0.02
    assert np.abs(found.inclusion - exact.inclusion).max() < 0.02
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=0.1)


def test_unknown_noise_scale_is_held_at_what_the_library_leaves(problem, monkeypatch):
    """60 rows know the scale to 9 %, which moves the log odds of a term t sd away by 0.09 t^2."""
    exact = enumerate_models(*problem)
    monkeypatch.setattr(enumerate, "LARGEST", 10)
    found = enumerate_models(*problem)
    assert np.abs(found.inclusion - exact.inclusion).max() < 0.1


@pytest.mark.slow
def test_temperature_expanded_accelerometer_is_decided():
    """44 excited terms of 47, and which of them are not zero is found, wherever the test can tell."""
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    heated = ("b0", "b1", "b2", "b3", "m_j", "m_k", "c_ij", "c_ik", "c_jk", "c_jj", "c_kk")
    lib = ib.library(
        "accelerometer", set="extended", temperature=2, temperature_of=heated, rate_of=("b0", "b1")
    )
    plans = (
        ib.thermal([233.0, 273.0, 298.0, 343.0], positions=9, dwell=60.0, soak=900.0, ramp=2.0 / 60.0),
        ib.centrifuge([1, 5, 10, 20], mounts=12, dwell=20.0, rate=2.0),
    )
    rng = np.random.default_rng(2)
    sd = ib.prior(sensor, lib).sd
    inside = rng.random(len(sd)) < 0.35
    truth = dict(zip(lib.names, (inside * sd * rng.standard_normal(len(sd))).tolist(), strict=True))
    summary = ib.summarize(ib.simulate(sensor, plans, seed=3, truth=truth), lib, sensor=sensor)
    chosen = ib.select(summary, ib.prior(sensor, lib))
    assert len(chosen.models.candidates.names) == 44
    assert chosen.models.missing <= 1e-6 or chosen.models.error < 0.01
    for term in chosen.terms:
        true = truth[term.name]
        assert term.verdict != "needed" or true != 0.0
        assert term.verdict != "not needed" or abs(true) < 0.1 * term.prior_sd
        if term.verdict not in ("untested", "inseparable"):
            assert abs(term.full_mean - true) < 4.0 * term.full_sd
