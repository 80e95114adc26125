"""Rows at rest of the components of a case: which samples are there, and what cannot reach the noise."""

from dataclasses import replace
from types import SimpleNamespace

import hands
import numpy as np
import pytest

from imubayes.inference.case import rows_at_rest
from imubayes.inference.noise_fit import detection_limits
from imubayes.inference.noise_model import likelihood_of, process_model
from imubayes.inference.noise_rows import noise_rows
from imubayes.inference.stills import find_stills
from imubayes.rig.inputs import Inputs, Run, Section
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import NoiseProcesses, class_prior
from imubayes.sensors.terms import Library, library

G, DT, SAMPLES, MOVING = 9.81, 0.01, 500, 60
UP = ("x", "-x", "y", "-y", "z", "-z")
TERMS = ("b0", "b1", "m_j", "m_k", "g_i", "g_j", "g_k")
LIBRARIES = [
    Library(kind, tuple(term for term in library(kind, set="extended").terms if term.name in TERMS))
    for kind in ("accelerometer", "gyroscope")
]
TRIADS = tuple(hands.with_truth(lib, {}, referenced=True) for lib in LIBRARIES)
CASE = SimpleNamespace(
    triads=TRIADS, components=[SimpleNamespace(name=name) for triad in TRIADS for name in triad.components]
)
AT_REST = np.concatenate([np.arange(k * SAMPLES, (k + 1) * SAMPLES - MOVING) for k in range(6)])
NOISE = NoiseProcesses(N=0.1, K=0.2)
PRIOR = class_prior(sensor("mems_consumer", kind="gyroscope"), DT)


def on_a_table(force=0.0, rate=0.0, seed=1):
    """Six positions and a turn, noise of unit size; `force` and `rate` (7, 3) are added to each section."""
    rng = np.random.default_rng(seed)
    sections = tuple(
        Section(k * SAMPLES, (k + 1) * SAMPLES - MOVING, up, angle)
        for k, (up, angle) in enumerate([*((up, 0.0) for up in UP), ("x", 6.0)])
    )
    n = 7 * SAMPLES
    said = [rng.normal(size=(n, 3)) for _ in range(2)]
    moved = [
        np.repeat(np.broadcast_to(added, (7, 3)), SAMPLES, axis=0) + part
        for added, part in zip((force, rate), said, strict=True)
    ]
    inputs = Inputs(DT * np.arange(n), {}, DT)
    return Run("bench", "ferraris", inputs, np.hstack(moved), gravity=G, sections=sections)


def told(run, name):
    (rows,) = rows_at_rest([run], CASE)[name]
    return likelihood_of(process_model(noise_rows(rows), PRIOR), NOISE).levels[0]


def test_samples_of_the_positions_are_there_and_no_others():
    run = on_a_table()
    rows = rows_at_rest([run, replace(run, name="again")], CASE)
    assert list(rows) == ["ax", "ay", "az", "gx", "gy", "gz"]
    assert [part.name for part in rows["gy"]] == ["bench (gy at rest)", "again (gy at rest)"]
    np.testing.assert_array_equal(rows["ay"][0].y, run.force[AT_REST, 1])
    np.testing.assert_array_equal(rows["gz"][0].t, run.t[AT_REST])


def test_how_the_case_lies_does_not_reach_the_noise_of_an_accelerometer():
    tilts = np.random.default_rng(2).normal(size=(7, 3))
    moved, plain = (told(on_a_table(force), "ay") for force in (tilts, 0.0))
    assert moved == pytest.approx(plain, abs=1e-6)


def test_terms_at_rest_do_not_reach_the_noise_of_a_gyroscope_and_drift_does():
    f = G * np.array([Section(0, 1, up).direction for up in (*UP, "x")])
    modelled = 0.3 + f @ np.random.default_rng(3).normal(size=(3, 3))
    drift = np.linspace(0.0, 1.0, 7)[:, None] * np.ones(3)
    plain = told(on_a_table(), "gx")
    assert told(on_a_table(rate=modelled), "gx") == pytest.approx(plain, abs=1e-6)
    assert abs(told(on_a_table(rate=drift), "gx") - plain) > 1e-3


def test_what_drifts_from_still_to_still_is_hidden_in_accelerometers_alone():
    """The same noise, and so the same figures: a random walk shows later where each still has its mean."""
    rows, white = rows_at_rest([on_a_table()], CASE), NoiseProcesses(N=PRIOR.log_normal["N"][0])
    limit = {
        name: detection_limits(process_model(noise_rows(rows[name][0]), PRIOR), white, ("K",))["K"]
        for name in ("ax", "gx")
    }
    assert limit["ax"] > 1.5 * limit["gx"]


def test_stills_of_a_free_tumble_are_those_of_its_accelerometers():
    run = hands.in_the_hand(*TRIADS, stills=12, seed=4)
    rows = rows_at_rest([run], CASE)
    stills = find_stills(run)
    assert len(rows["ax"][0]) == len(rows["gz"][0]) == sum(b - a for a, b in stills)
    assert len(rows["ax"][0].names) == len(stills)
    assert rows["gz"][0].names == LIBRARIES[1].names
