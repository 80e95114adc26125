"""Eight consumer accelerometers in three sessions, recorded by others: what comes back, and what does not.

Data of Carlsson, Skog and Jalden (IEEE Sensors Journal 21, 2021). Temperature was neither held nor recorded.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from imubayes.algebra.factor import posterior
from imubayes.campaign.study import SensorSpec
from imubayes.inference.case import Asked, Case
from imubayes.inference.free_tumble import solve_free_tumble
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.triad import triad_of
from imubayes.population.sessions import SessionVerdict, repeatability
from imubayes.rig.inputs import Run
from imubayes.sensors.imu import ACCELEROMETERS as COMPONENTS
from imubayes.study.method import run
from imubayes.study.schema import read_runs, read_study

STUDY = Path(__file__).parents[1] / "studies" / "mimu4444.toml"
MG, PPM = 9.80665e-3, 1e-6

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


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """A session of a unit: its record, and the posterior of every term by name."""

    spec: SensorSpec
    record: Run
    found: Case
    mean: dict[str, float]
    sd: dict[str, float]
    prior_sd: dict[str, float]


def solved(spec):
    (record,) = read_runs(STUDY, spec.id)
    prior = np.concatenate([class_sd(spec.sensor_class, lib) for lib in triad_of(spec.library).libraries])
    found = solve_free_tumble([record], Asked(spec.library, ScalePrior(prior), spec.sensor_class))
    columns = (*posterior(found.summary.factor, prior), prior)
    return Session(
        spec, record, found, *(dict(zip(found.triads[0].names, c.tolist(), strict=True)) for c in columns)
    )


@pytest.fixture(scope="module")
def study(recordings):
    if not (recordings / "mimu4444").is_dir():
        pytest.skip(
            f"needs {recordings / 'mimu4444'}: the recordings of "
            "github.com/hcarlsso/Self-Calibration-Inertial-Sensor-Arrays-BCD.jl as exp_1.npz ... exp_3.npz"
        )
    return read_study(STUDY)


@pytest.fixture(scope="module")
def first_two(study):
    """The first two units, three sessions each."""
    return [solved(spec) for spec in study.sensors[:6]]


def told(session, column, term):
    """What a session says of a term, as a verdict has it."""
    posterior = {"full_mean": session.mean, "full_sd": session.sd, "prior_sd": session.prior_sd}
    known = {key: values[column] for key, values in posterior.items()}
    return SimpleNamespace(name=term.name, unit=term.unit, printed=term.printed, **known)


def compared(sessions):
    terms = [
        (component, term)
        for component, lib in zip(COMPONENTS, sessions[0].found.triads[0].libraries, strict=True)
        for term in lib.terms
    ]
    estimates = (
        SessionVerdict(s.spec.unit, s.spec.session, component, told(s, f"{component}.{term.name}", term))
        for s in sessions
        for component, term in terms
    )
    return {one.parameter: one for one in repeatability(estimates)}


def least_squares_of(session):
    """Nine coefficients from the means of the stills: white noise, no priors, no library."""
    t, output = session.record.t, session.record.output
    stills = session.found.summary.runs[0].stills
    means = np.array([output[(t >= a) & (t <= b)].mean(axis=0) for a, b in stills])

    def excess(x):
        gain = np.array([[1.0 + x[3], x[6], x[7]], [0.0, 1.0 + x[4], x[8]], [0.0, 0.0, 1.0 + x[5]]])
        return np.linalg.norm(np.linalg.solve(gain, (means - x[:3]).T), axis=0) - session.record.gravity

    found = least_squares(excess, np.zeros(9), x_scale=[0.1] * 3 + [1e-3] * 6)
    return dict(zip(LINEAR, found.x.tolist(), strict=True))


def test_clock_that_wraps_keeps_its_rate(first_two):
    """32 bits at 64 MHz last 67 s, a ninth of a record; the board samples at 62.5 Hz."""
    for session in first_two:
        t = session.record.t
        assert t[-1] - t[0] == pytest.approx(0.016 * (len(t) - 1), rel=1e-4)


def test_twenty_long_stills_and_a_last_one_are_found(first_two):
    for session in first_two:
        lasting = [b - a for a, b in session.found.summary.runs[0].stills]
        assert len(lasting) == 21
        assert min(lasting[:20]) > 20.0


def test_least_squares_on_the_means_of_the_stills_agrees_within_the_error_bars(first_two):
    for session in first_two:
        other = least_squares_of(session)
        for name in LINEAR:
            assert abs(session.mean[name] - other[name]) < 3.0 * session.sd[name], (session.spec.id, name)


@pytest.mark.parametrize("name", PUBLISHED)
def test_first_unit_has_the_published_calibration(first_two, name):
    """The figures are given to two digits: they lie among the three sessions, within that and two sds."""
    sessions = first_two[:3]
    digit, narrow = (5e-3, 0.06) if name.endswith("b0") else (5e-5, 1.5e-3)
    low = min(s.mean[name] - 2.0 * s.sd[name] for s in sessions) - digit
    high = max(s.mean[name] + 2.0 * s.sd[name] for s in sessions) + digit
    assert low < PUBLISHED[name] < high
    assert high - low < narrow


def test_bias_changes_between_sessions_and_the_scale_factor_does_not(first_two):
    found = compared(first_two)
    assert found["b0"].exceeds and found["az.b0"].exceeds
    assert 0.5 * MG < found["b0"].between[1] < found["b0"].between[2] < 3.0 * MG
    assert np.nanmax(np.abs(found["az.b0"].pulls)) > 5.0
    assert not found["b1"].exceeds
    assert found["b1"].between[2] < 300.0 * PPM


def test_terms_that_stills_do_not_excite_are_not_compared(first_two):
    assert not {"S_ij", "s_k"} & set(compared(first_two))


@pytest.fixture(scope="module")
def whole(study):
    start = time.perf_counter()
    result = run(study)
    return result, time.perf_counter() - start


@pytest.mark.slow
def test_eight_units_come_back_in_all_but_their_biases(whole, measured):
    result, seconds = whole
    found = {one.parameter: one for one in result.sessions}
    measured("s for 24 triads", round(seconds, 1))
    for axis in COMPONENTS:
        measured(f"mg: {axis}.b0 between sessions", round(found[f"{axis}.b0"].between[0] / MG, 3))
    measured("mg: b0 between sessions, all axes", round(found["b0"].between[0] / MG, 3))
    measured("ppm: b1 between sessions, all axes", round(found["b1"].between[0] / PPM, 1))
    assert {name for name, one in found.items() if one.exceeds} == {"b0", "ax.b0", "az.b0"}
    assert 0.7 * MG < found["b0"].between[1] < found["b0"].between[2] < 1.4 * MG
    assert found["b1"].between[2] < 100.0 * PPM
    # all eight move alike: by chance an eighth of the scatter would be common to them
    assert min(found["ax.b0"].shared, found["az.b0"].shared) > 0.7


@pytest.mark.slow
def test_class_needs_bias_scale_and_misalignment_and_its_turn_on_is_common_to_all_units(whole, measured):
    """Eight units on one board: what a session does, it does to all of them."""
    result, _ = whole
    (found,) = result.classes
    terms = {term.name: term for term in found.terms}
    verdicts = {name: term.need.verdict for name, term in terms.items()}
    assert (len(found.units), found.sessions, found.components) == (8, ("1", "2", "3"), COMPONENTS)
    needed = {f"{axis}.{name}" for axis in COMPONENTS for name in ("b0", "b1")} | {"ay.m_j", "ax.m_k"}
    assert {name for name, verdict in verdicts.items() if verdict == "needed" and "." in name} == needed
    assert verdicts["ax.m_j"] == "not needed"
    for name in ("b2", "c_ij", "c_jj", "S_ij", "s_k"):
        assert verdicts[name] == "cannot tell"
    bias, scale = terms["b0"].spreads, terms["b1"].spreads
    measured("mg: b0 between sessions, of 8 units that move together", round(bias.turn_on.value / MG, 3))
    # the sd of units that move independently is inside the interval of those that need not
    between = next(one for one in result.sessions if one.parameter == "b0").between[0]
    assert bias.turn_on.low < between < bias.turn_on.high < 2.5 * MG
    assert terms["az.b0"].spreads.common_share.low > 0.7
    assert scale.turn_on.high < 100.0 * PPM < 0.05 * scale.unit.value


@pytest.mark.slow
def test_noise_model_holds_within_a_session_but_for_the_first_second_of_a_still(whole):
    """The board rocks for a moment where it is put down; the fourth unit's x axis is filtered otherwise."""
    result, _ = whole
    checks = [(one, one.checks[0]) for one in result.sensors[::3]]
    assert all(abs(check.scale - 1.0) < 0.15 for _, check in checks)
    assert sum(check.whiteness_p > 0.01 for _, check in checks) >= 23
    late = [
        min(abs(outlier[0] - start) for start, _ in one.runs[0].stills)
        for one, check in checks
        for outlier in check.outliers
    ]
    # a still is twenty blocks: one in twenty would be the first by chance
    assert sum(s < 0.1 for s in late) > 0.75 * len(late)
    assert len(late) < 0.005 * sum(len(check.t) for _, check in checks)
