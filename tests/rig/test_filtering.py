"""Samples that a filter or quantization has coloured, simulated sample by sample with scipy's filters."""

import numpy as np
import pytest
from quiet_logs import quiet_log
from run_files import csv_of
from scipy.signal import butter, lfilter

from imubayes.inference.linear import linear_of
from imubayes.inference.noise_model import estimate
from imubayes.rig.filtering import MEANS, as_means
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.sensors.terms import library

INTERVAL, SAMPLES = 0.01, 200_000
N, B = np.deg2rad(2.4) / 60.0, np.deg2rad(32.0) / 3600.0
LIB = library("gyroscope", powers=1, asymmetry=-1)


def filtered(order, corner, quantum, seed):
    """White noise through a digital filter of unit gain, flicker, and the differences of an angle's rounding.

    The quantum's share of a sample is in sds of the white noise there.
    """
    rng = np.random.default_rng(seed)
    white = N / np.sqrt(INTERVAL) * rng.standard_normal(SAMPLES)
    if order == 1:
        kept = np.exp(-2.0 * np.pi * corner * INTERVAL)
        white = lfilter([1.0 - kept], [1.0, -kept], white)
    elif order == 2:
        white = lfilter(*butter(2, 2.0 * corner * INTERVAL), white)
    Q = quantum * N * np.sqrt(INTERVAL / 2.0)
    return white + quiet_log({"B": B, "Q": Q}, SAMPLES, INTERVAL, rng)


@pytest.mark.parametrize(("order", "corner", "quantum"), [(1, 5, 0), (1, 40, 0.1), (2, 15, 3), (0, 0, 10)])
def test_rows_tell_the_noise_below_the_filter_and_beyond_the_quantum(tmp_path, order, corner, quantum):
    output, t = filtered(order, corner, quantum, seed=3), INTERVAL * np.arange(SAMPLES)
    np.savez(tmp_path / "quiet.npz", **{"t [s]": t, "output [rad/s]": output})
    run = read_run(RunSpec("quiet", "static", tmp_path / "quiet.npz"), "gyroscope")
    found = estimate(linear_of(run, LIB))  # every row, as the chains have them
    off = np.log([found.noise.N / N, found.noise.B / B]) / found.sd[:2]
    assert np.all(np.abs(off) < 3.0)
    assert found.sd[0] < 0.3
    assert MEANS in run.source.notes[-1]


def test_a_long_file_is_read_as_the_means_that_a_short_one_is(tmp_path, monkeypatch):
    output, t = filtered(1, 30, 0, seed=1), INTERVAL * np.arange(SAMPLES)
    rows = np.column_stack((t, output))[: SAMPLES // 4]
    spec = RunSpec("quiet", "static", csv_of(tmp_path, "t [s],output [rad/s]", rows))
    held = read_run(spec, "gyroscope")
    monkeypatch.setattr("imubayes.rig.streams.STREAMED", 1000)
    long = read_run(spec, "gyroscope")
    assert long.stream is None
    assert np.isclose(len(long.inputs), len(held.inputs), rtol=0.3)
    assert np.isclose(long.inputs.durations @ long.output, held.inputs.durations @ held.output)


def test_samples_of_white_noise_stay_as_they_are():
    run = Run("quiet", "static", Inputs(INTERVAL * np.arange(SAMPLES), {}, INTERVAL), filtered(0, 0, 0, 1))
    assert as_means(run, "gyroscope") is run


def test_means_reach_neither_across_a_jump_of_an_input_nor_far_along_a_ramp():
    w = np.repeat([0.1, -0.2, 0.3, 0.0], 20_000)
    w[60_000:] = np.linspace(0.0, 0.3, 20_000)
    noise = lfilter([0.3], [1.0, -0.7], np.random.default_rng(2).standard_normal(len(w)))
    inputs = Inputs(INTERVAL * np.arange(len(w)), {"w_i": w}, INTERVAL)
    run = as_means(Run("steps", "rate-table", inputs, 1.01 * w + 1e-3 * noise), "gyroscope")
    seen, lasting = run.inputs.channels["w_i"], run.inputs.durations
    assert len(seen) < 20_000
    assert np.isclose(lasting.sum(), len(w) * INTERVAL)
    assert set(seen[np.cumsum(lasting) < 599.0].round(12)) == {0.1, -0.2, 0.3}
    assert np.isclose(lasting @ seen**2, INTERVAL * np.sum(w**2), rtol=1e-4)
