"""What disturbs a record is told with its time and channel; what does not is let pass."""

from dataclasses import replace

import numpy as np
import pytest
from run_files import csv_of

from imubayes.rig.checks import faults
from imubayes.rig.filtering import with_disturbances
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise

N = 20_000
T = 0.01 * np.arange(N)
NOISE = Noise(1e-3, 5e-4, 1e-5)


def still(seed=1, more=0.0, scatter=1.0):
    y = synthesise(NOISE, T, 0.01, np.random.default_rng(seed))
    white = np.random.default_rng(seed + 100).standard_normal(N) * NOISE.N / 0.1
    return Run("log", "static", Inputs(T, {"f_i": np.full(N, 9.81)}, 0.01), 9.81 + y + more + white * scatter)


def notes(run):
    return with_disturbances(run, "accelerometer").source.notes


def test_step_is_told_with_its_size_and_time():
    (note,) = notes(still(more=np.where(T < 120.0, 0.0, 0.05)))
    assert note.startswith("output steps by 0.0")
    assert float(note.partition("t = ")[2].split()[0]) == pytest.approx(120.0, abs=1.0)


def test_bad_stretch_is_told_with_its_time():
    (note,) = notes(still(scatter=np.where(abs(T - 50.0) < 2.0, 8.0, 1.0)))
    assert note.startswith("output is restless from t = 4")
    start, stop = (float(part.split()[0]) for part in note.replace("to", "t =").split("t = ")[1:3])
    assert (start, stop) == (pytest.approx(48.0, abs=0.6), pytest.approx(52.0, abs=0.6))


def test_nothing_is_said_of_noise_drift_turns_or_a_warm_up():
    for seed in range(10):
        assert notes(still(seed)) == ()
    assert notes(still(more=0.2 * np.exp(-T / 40.0))) == ()
    turned = np.where(np.arange(N) // 500 % 2 == 0, 9.81, -9.81)
    run = still()
    assert (
        notes(replace(run, inputs=Inputs(T, {"f_i": turned}, 0.01), output=run.output - 9.81 + turned)) == ()
    )


def test_faults_are_told_by_run_channel_and_time(tmp_path):
    t, y = np.delete(T[:3000], slice(500, 700)), np.random.default_rng(1).standard_normal(2800)
    table = np.column_stack((t, np.minimum(y, 2.0)))
    path = csv_of(tmp_path, "t [s],output [g]", table)
    run = read_run(RunSpec("log", "static", path, "log.csv"), "accelerometer")
    told = faults([(run.name, run.procedure, run.source), ("tumble", "tumble", run.source)])
    first = t[y >= 2.0][0]
    assert [text for text in told if text.startswith("log: output is saturated at 2 g")]
    assert any(f"first at t = {first:.6g} s" in text for text in told)
    assert "log: 1 gap in time, the longest 2.01 s at t = 4.99 s" in told
    assert not any("tumble: 1 gap" in text for text in told)
