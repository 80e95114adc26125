"""Known positions and turns: imucal, which is the same data by another route, and simulated truths."""

import json
from dataclasses import replace

import hands
import numpy as np
import pytest

from imubayes.algebra.factor import posterior
from imubayes.errors import UnobservableError
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.observability import observe
from imubayes.inference.stills import condensed
from imubayes.rig.inputs import Inputs, Run, RunSection
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.imu import GYROSCOPES
from imubayes.sensors.noise import Noise

SDS = {
    "accelerometer": {"b0": 1.0, "b1": 5e-2, "m_j": 0.1, "m_k": 0.1},
    "gyroscope": {"b0": 3e-2, "b1": 5e-2, "m_j": 0.1, "m_k": 0.1, "g_i": 1e-4, "g_j": 1e-4, "g_k": 1e-4},
}
"""Prior sds before any factory calibration, SI."""


LIBRARIES = tuple(hands.only(kind, sds) for kind, sds in SDS.items())


def asked(which, noise=None):
    kind, sds = [*SDS.items()][which]
    entry = sensor("mems_consumer", kind=kind)
    return hands.asked(LIBRARIES[which], sds, noise, run="bench", sensor=entry, referenced=True)


def solved(run, noises=(None, None), fixture=None):
    both = [asked(k, noise) for k, noise in enumerate(noises)]
    case = solve_ferraris([run], *both, fixture=fixture)
    whole = hands.prior_of(both, case)
    return case, *posterior(case.summary.factor, whole), whole


@pytest.fixture(scope="module")
def session(recordings):
    folder = recordings / "imucal_ferraris"
    table = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    regions = json.loads((folder / "example_ferraris_session_list.json").read_text(encoding="utf-8"))
    up = {"p": "", "a": "-"}
    sections = tuple(
        RunSection(r["start"], r["end"], axis, hands.FULL_TURN)
        if what == "rot"
        else RunSection(r["start"], r["end"], up[what] + axis)
        for name, r in regions.items()
        for axis, what in [name.split("_")]
    )
    t, rate = table[:, 0] / 102.4, np.deg2rad(table[:, 1:4])
    output = np.hstack((table[:, 4:], rate))
    run = Run("bench", "ferraris", Inputs(t, {}, 1.0 / 102.4), output, gravity=9.81, sections=sections)
    return run, table, regions


def test_session_has_the_figures_that_imucal_publishes(session):
    """Faces that are off: biases then rest on the two positions of their own axis, as in imucal."""
    case, *_ = solved(session[0], fixture=np.deg2rad(2.0))
    force, rate = (np.array([part[0] for part in triad.parts()]) for triad in case.triads)
    # one unit in the last published digit, and 0.4 of the standard error of the flicker over a position
    np.testing.assert_allclose(force, [0.537, -0.616, 0.399], rtol=0.0, atol=2e-3)
    np.testing.assert_allclose(np.rad2deg(rate), [-0.600, -0.370, 0.059], rtol=0.0, atol=6e-3)
    # K is the length of a row of the gain; misalignments are below 0.02, so 2e-4 of it. imucal takes faces as
    # exact: tilts shorten an input by their square, half of it where there are two sections along an axis
    published = ([0.99675, 1.00244, 1.0234], 2.0), ([1.02792, 0.98243, 0.99831], 1.0)
    for triad, (said, sections) in zip(case.triads, published, strict=True):
        found = np.diag(triad.gain()) * (1.0 - np.deg2rad(2.0) ** 2 / sections)
        np.testing.assert_allclose(found, said, rtol=0.0, atol=3e-4)


@pytest.fixture(scope="module")
def whole(session):
    return solved(session[0])[0]


def test_accelerometers_alone_are_those_of_the_whole_imu(session, whole):
    run, *_ = session
    still = tuple(section for section in run.sections if not section.angle)
    alone = solve_ferraris([replace(run, output=run.force, sections=still)], asked(0))
    np.testing.assert_allclose(alone.theta, whole.triads[0].theta, rtol=1e-9, atol=1e-12)
    with pytest.raises(UnobservableError, match="tells accelerometers nothing"):
        solve_ferraris([replace(run, output=run.force)], asked(0))


def test_gyroscopes_alone_are_those_of_the_whole_imu(session, whole):
    run, *_ = session
    alone = solve_ferraris([replace(run, output=run.rate, components=GYROSCOPES)], asked(1))
    np.testing.assert_allclose(alone.theta, whole.triads[1].theta, rtol=1e-9, atol=1e-12)
    assert [one.name for one in alone.components] == list(GYROSCOPES)
    assert {run.ranges["f_x"] for run in alone.summary.runs} == {(-9.81, 9.81)}


def test_session_has_the_matrices_that_imucal_computes(session):
    """With exact faces: gain matrices, misalignments included."""
    imucal = pytest.importorskip("imucal")
    pandas = pytest.importorskip("pandas")
    run, table, regions = session
    names = [f"{sort}_{axis}" for sort in ("gyr", "acc") for axis in "xyz"]
    data = pandas.DataFrame(table[:, 1:], columns=names)
    found = imucal.FerrarisCalibration().compute(
        imucal.ferraris_regions_from_section_list(data, pandas.DataFrame(regions).T),
        sampling_rate_hz=102.4,
        from_acc_unit="m/s^2",
        from_gyr_unit="deg/s",
    )
    case, *_ = solved(run, noises=(Noise(1e-3, 0.0, 0.0), Noise(1e-5, 0.0, 0.0)))
    # imucal weighs positions alike, least squares by their length: they differ by what the faces are off
    np.testing.assert_allclose(case.triads[0].gain(), found.K_a @ found.R_a, rtol=0.0, atol=6e-3)
    np.testing.assert_allclose(case.triads[1].gain(), found.K_g @ found.R_g, rtol=0.0, atol=6e-3)
    bias = np.rad2deg([part[0] for part in case.triads[1].parts()])
    np.testing.assert_allclose(bias, found.b_g, rtol=0.0, atol=6e-3)


TRUTH = {
    "ax.b0": 0.5, "ay.b0": -0.3, "ax.b1": 2e-2, "ay.m_j": 3e-2, "ax.m_j": -1e-2, "az.m_k": 2e-2,
    "gx.b0": 1e-2, "gx.b1": 3e-2, "gy.m_j": -2e-2, "gz.m_k": 1e-2, "gz.g_i": 1e-4, "gx.m_k": 5e-3,
}  # fmt: skip
NOISES = (Noise(2e-3, 0.0, 0.0), Noise(2e-4, 0.0, 0.0))


def on_a_table(faces=0.0, seed=1):
    triads = [hands.with_truth(lib, TRUTH, referenced=True) for lib in LIBRARIES]
    return hands.on_a_table(triads, NOISES, faces=faces, seed=seed)


@pytest.mark.parametrize(("faces", "allowed"), [(0.0, None), (0.02, 0.02)])
def test_known_imu_is_recovered_within_its_error_bars(faces, allowed):
    pulls = []
    for seed in range(1, 7):
        case, mean, sd, _ = solved(on_a_table(faces, seed), NOISES, allowed)
        terms = len(case.summary.names) - len(case.summary.extras)
        truth = np.array([TRUTH.get(name, 0.0) for name in case.summary.names[:terms]])
        pulls.append((mean[:terms] - truth) / sd[:terms])
    every = np.concatenate(pulls)
    assert np.abs(every).max() < 4.5
    assert np.mean(every**2) < 1.0 + 4.0 * np.sqrt(2.0 / len(every)) + 0.2


def test_exact_faces_tell_misalignments_and_tilted_ones_do_not():
    """Rotation of the case and misalignment are one column where every face may be off."""
    sds = {}
    for allowed in (None, 0.02):
        case, _, sd, prior = solved(on_a_table(), NOISES, allowed)
        sds[allowed] = dict(zip(case.summary.names, sd.tolist(), strict=True))
        seen = observe(case.summary.factor, prior, case.summary.facts, reach=case.summary.reach)
        hidden = seen.partners("ax.m_j")
        assert bool(hidden) == (allowed is not None)
        # and a tilt of 0.02 that is hidden shortens a turn by 4e-4, more or less
        assert seen.partners("gx.b1") == (() if allowed is None else ("shortening.turns.x",))
    assert sds[None]["ax.m_j"] < 1e-3
    # y is up and down once each: half the difference of two tilts
    assert sds[0.02]["ax.m_j"] == pytest.approx(0.02 / np.sqrt(2.0), rel=0.05)
    # a turn about y has one tilt
    assert sds[0.02]["gx.m_j"] == pytest.approx(0.02, rel=0.05)


def test_a_run_without_turns_is_refused():
    run = on_a_table()
    still = replace(run, sections=run.sections[:6])
    with pytest.raises(UnobservableError, match="gyroscopes need one about each axis"):
        solve_ferraris([still], asked(0), asked(1))


def test_positions_and_turns_are_the_same_whatever_the_parts_that_a_file_is_read_in(tmp_path, monkeypatch):
    run = on_a_table()
    held, mean, sd, _ = solved(run, NOISES)
    found = [
        solved(condensed(hands.from_a_long_file(run, tmp_path, monkeypatch, rows)), NOISES)
        for rows in (577, len(run.t))
    ]
    # the interval of the first part differs from that of all by the rounding of the time stamps
    assert np.max(np.abs(found[0][1] - found[1][1]) / sd) < 1e-8
    # of samples, blocks reach from one position to the next
    assert np.max(np.abs(found[0][1] - mean) / sd) < 0.1
    np.testing.assert_allclose(found[0][2], sd, rtol=0.01)
    assert [r.samples for r in found[0][0].summary.runs] == [r.samples for r in held.summary.runs]
