"""The candidate terms in pysindy's own hands."""

from __future__ import annotations

import numpy as np
import pysindy as ps
import pytest

import imubayes as ib
from imubayes.errors import TermError
from imubayes.sensors.terms import columns

LIBRARY = ib.library("accelerometer", powers=3, asymmetry=1, temperature=1)


def inputs(features, seed=1, n=400):
    rng = np.random.default_rng(seed)
    scale = [300.0 if name == "T" else 5.0 for name in features.channels]
    return rng.normal(size=(n, len(features.channels))) * scale


def test_regressors_are_the_columns_of_the_model_equation():
    features = ib.feature_library(LIBRARY)
    x = inputs(features)
    expected = columns(LIBRARY, dict(zip(features.channels, x.T, strict=True)), len(x))
    assert np.array_equal(features.fit(x).transform(x), expected)
    assert features.get_feature_names() == list(LIBRARY.names)
    assert (features.n_features_in_, features.size) == (x.shape[1], len(LIBRARY.terms))


def test_channels_can_come_in_any_order_and_those_that_do_not_are_zero():
    features = ib.feature_library(LIBRARY, ("f_k", "f_i"))
    x = inputs(features)
    expected = columns(LIBRARY, {"f_i": x[:, 1], "f_k": x[:, 0]}, len(x))
    assert np.array_equal(features.fit_transform(x), expected)


def test_several_runs_are_several_trajectories():
    features = ib.feature_library(LIBRARY)
    x = inputs(features)
    parts = features.fit_transform([x[:100], x[100:]])
    assert np.array_equal(np.vstack(parts), features.transform(x))


def test_pysindy_recovers_the_coefficients_of_a_simulated_sensor():
    """Least squares on the true support: in white noise within 4 sd of the truth, all others dropped."""
    lib = ib.library("accelerometer", powers=3, asymmetry=-1)
    truth = {"b0": 2e-2, "b1": 8e-4, "m_j": -6e-4, "c_ij": 4e-5}
    sensor = ib.sensor("mems_tactical", kind="accelerometer")
    white = ib.Noise(2e-4, 0.0, 0.0)
    plans = [ib.tumble(angles=24), ib.centrifuge([1, 5])]
    runs = ib.simulate(sensor, plans, seed=2, truth=truth, noise=white)
    features = ib.feature_library(lib)
    x = [
        np.column_stack([r.inputs.channels.get(name, np.zeros(len(r.output))) for name in features.channels])
        for r in runs
    ]
    model = ps.SINDy(feature_library=features, optimizer=ps.STLSQ(threshold=2e-5, alpha=0.0))
    model.fit(
        x,
        t=[r.inputs.t for r in runs],
        x_dot=[(r.output - r.inputs.channels["f_i"])[:, None] for r in runs],
        feature_names=list(features.channels),
    )
    found = dict(zip(model.get_feature_names(), model.coefficients()[0], strict=True))
    assert {name for name, value in found.items() if value} == set(truth)
    A = np.asarray(np.vstack(features.transform(x)))[:, [lib.names.index(name) for name in truth]]
    sd = white.N / np.sqrt(runs[0].inputs.interval) * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    assert np.all(np.abs(np.array([found[name] for name in truth]) - [*truth.values()]) < 4.0 * sd)


def test_x_without_a_channel_teaches_what_to_give():
    features = ib.feature_library(LIBRARY)
    x = inputs(features)
    with pytest.raises(TermError, match="a column for each of the 11 channels f_i, f_j"):
        features.fit(x[:, 1:])


@pytest.mark.parametrize("channels", [("f_i", "f_x"), ("f_i", "f_i")])
def test_unknown_or_repeated_channels_are_refused(channels):
    with pytest.raises(TermError, match=f"channel '{channels[1]}' is not known, or comes twice"):
        ib.feature_library(LIBRARY, channels)
