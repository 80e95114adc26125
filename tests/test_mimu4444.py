"""Eight consumer accelerometers in three sessions, recorded by others: what comes back, and what does not.

Data of Carlsson, Skog and Jalden (IEEE Sensors Journal 21, 2021). Temperature was neither held nor recorded.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from imubayes.algebra.factor import posterior
from imubayes.inference.case import TriadSpec
from imubayes.inference.free_tumble import solve_free_tumble
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.triad import triad_of
from imubayes.study.schema import read_runs, read_study

STUDY = Path(__file__).parents[1] / "studies" / "mimu4444.toml"

PUBLISHED = {
    "ax.b0": -0.28,
    "ay.b0": -0.12,
    "az.b0": -0.55,
    "ax.b1": 0.0045,
    "ay.b1": 0.0065,
    "az.b1": -0.0017,
}
"""First unit, m/s^2 and 1: published as the compensation, which has the opposite signs."""

LINEAR = (*PUBLISHED, "ax.m_j", "ax.m_k", "ay.m_j")


@pytest.fixture(scope="module")
def sessions(recordings):
    """Of each session of the first unit, what was found, and mean and sd of every term by name."""
    if not (recordings / "mimu4444").is_dir():
        pytest.skip(
            f"needs {recordings / 'mimu4444'}: the recordings of "
            "github.com/hcarlsso/Self-Calibration-Inertial-Sensor-Arrays-BCD.jl as exp_1.npz ... exp_3.npz"
        )
    return [solved(spec) for spec in read_study(STUDY).sensors[:3]]


def solved(spec):
    (record,) = read_runs(STUDY, spec.id)
    prior = np.concatenate([class_sd(spec.sensor_class, lib) for lib in triad_of(spec.library).libraries])
    found = solve_free_tumble([record], TriadSpec(spec.library, ScalePrior(prior), spec.sensor_class))
    mean, sd = (
        dict(zip(found.triads[0].names, column.tolist(), strict=True))
        for column in posterior(found.summary.factor, prior)
    )
    return SimpleNamespace(record=record, stills=found.summary.runs[0].stills, mean=mean, sd=sd)


def least_squares_of(session):
    """Nine coefficients from the means of the stills: white noise, no priors, no library."""
    t, output = session.record.t, session.record.output
    means = np.array([output[(t >= a) & (t <= b)].mean(axis=0) for a, b in session.stills])

    def excess(x):
        gain = np.array([[1.0 + x[3], x[6], x[7]], [0.0, 1.0 + x[4], x[8]], [0.0, 0.0, 1.0 + x[5]]])
        return np.linalg.norm(np.linalg.solve(gain, (means - x[:3]).T), axis=0) - session.record.gravity

    found = least_squares(excess, np.zeros(9), x_scale=[0.1] * 3 + [1e-3] * 6)
    return dict(zip(LINEAR, found.x.tolist(), strict=True))


def test_least_squares_on_the_means_of_the_stills_agrees_within_the_error_bars(sessions):
    for session in sessions:
        other = least_squares_of(session)
        for name in LINEAR:
            assert abs(session.mean[name] - other[name]) < 3.0 * session.sd[name], name


@pytest.mark.parametrize("name", PUBLISHED)
def test_first_unit_has_the_published_calibration(sessions, name):
    """The figures are given to two digits: they lie among the three sessions, within that and two sds."""
    digit, narrow = (5e-3, 0.06) if name.endswith("b0") else (5e-5, 1.5e-3)
    low = min(s.mean[name] - 2.0 * s.sd[name] for s in sessions) - digit
    high = max(s.mean[name] + 2.0 * s.sd[name] for s in sessions) + digit
    assert low < PUBLISHED[name] < high
    assert high - low < narrow
