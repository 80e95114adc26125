"""Gyroscopes alone, on a table whose rate is all that is known or laid on faces: simulated, and by scipy."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imubayes.algebra.factor import posterior
from imubayes.errors import DataError, UnobservableError
from imubayes.inference.case import TriadSpec
from imubayes.inference.conflicts import refuse_conflicts
from imubayes.inference.ferraris import solve_ferraris
from imubayes.inference.free_tumble import solve_free_tumble, trusted_stills
from imubayes.inference.known_quantities import recover
from imubayes.inference.linear import Extra
from imubayes.inference.observability import observe
from imubayes.inference.prior import ScalePrior
from imubayes.inference.triad import triad_of
from imubayes.rig.inputs import Inputs, Run, RunSection
from imubayes.sensors.imu import GYROSCOPES
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, library

SDS = {"b0": 1e-2, "b1": 1e-2, "m_j": 1e-2, "m_k": 1e-2}
LIBRARY = Library("gyroscope", tuple(t for t in library("gyroscope", powers=1).terms if t.name in SDS))
WIDE = np.array([SDS[term.name] for lib in triad_of(LIBRARY).libraries for term in lib.terms])
NOISE = Noise(2e-4, 0.0, 0.0)
RATES = np.deg2rad([20.0, -20.0, 60.0, -60.0, 120.0, -120.0])
EARTH = Extra("earth_rate", "earth_rate", 7.292115e-5 / np.sqrt(3.0), "rad/s", "deg/h", "Earth's rate")
SECTION, INTERVAL = 10.0, 0.02


@cache
def turned(seed, dwells=24, *, earth=0.0, noise=NOISE):
    """Unit drawn from the prior, on a table at known rates in attitudes of any kind; and its coefficients.

    The table's axis is the lab's z axis, along which the Earth turns at `earth`; across it as fast.
    """
    rng = np.random.default_rng([seed, 3])
    theta = WIDE * rng.normal(size=len(WIDE))
    b, (xx, xy, xz, yy, yz, zz) = theta[[0, 4, 7]], theta[[1, 2, 3, 5, 6, 8]]
    gain = np.eye(3) + np.array([[xx, xy, xz], [0.0, yy, yz], [0.0, 0.0, zz]])
    count, sections, outputs = round(SECTION / INTERVAL), [], []
    for k in range(dwells):
        rate = RATES[k % len(RATES)]
        angles = rate * INTERVAL * np.arange(count)
        # lab to case: the table turns, and the triad lies on it somehow
        to_case = Rotation.random(random_state=rng) * Rotation.from_rotvec(np.outer(-angles, [0.0, 0.0, 1.0]))
        w = to_case.apply([earth, 0.0, rate + earth])
        outputs.append(w @ gain.T + b + noise.N / np.sqrt(INTERVAL) * rng.normal(size=(count, 3)))
        sections.append(RunSection(k * count, (k + 1) * count, rate=rate))
    t = INTERVAL * np.arange(count * dwells)
    inputs = Inputs(t, {}, INTERVAL)
    output, parts = np.concatenate(outputs), tuple(sections)
    return Run("table", "free-tumble", inputs, output, sections=parts, components=GYROSCOPES), theta


def solved(run, extras=(EARTH,), noise=NOISE):
    rules = None if noise is None else {"table": NoiseRule("fixed", noise)}
    case = solve_free_tumble([run], TriadSpec(LIBRARY, ScalePrior(WIDE), None, rules), extras=extras)
    return case, *posterior(case.summary.factor, np.append(WIDE, [extra.sd for extra in extras]))


def test_coefficients_are_off_by_what_their_error_bars_say():
    pulls = []
    for seed in range(16):
        earth = EARTH.sd * np.random.default_rng(seed).normal()
        run, theta = turned(seed, earth=earth)
        _, mean, sd = solved(run)
        pulls.append((mean - np.append(theta, earth)) / sd)
    assert np.abs(pulls).max() < 4.5
    # the ten numbers of a unit share its noise
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * np.size(pulls)))


def test_least_squares_on_the_lengths_finds_the_same():
    run, _ = turned(1)
    means = np.array([run.output[s.start : s.stop].mean(axis=0) for s in run.sections])
    rates = np.array([s.rate for s in run.sections])
    sd = NOISE.N / np.sqrt(SECTION)

    def missed(x):
        gain = np.array([[1 + x[1], x[2], x[3]], [0.0, 1 + x[5], x[6]], [0.0, 0.0, 1 + x[8]]])
        w = np.linalg.solve(gain, (means - x[[0, 4, 7]]).T)
        known = np.abs(rates) + np.sign(rates) * x[9]
        u = np.linalg.solve(gain.T, w / np.linalg.norm(w, axis=0))
        return np.append(
            (np.linalg.norm(w, axis=0) - known) / (sd * np.linalg.norm(u, axis=0)), x / [*WIDE, EARTH.sd]
        )

    found = least_squares(missed, np.zeros(10), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    _, mean, sds = solved(run)
    np.testing.assert_allclose(found.x, mean, rtol=0.0, atol=3e-3 * sds.min())
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))), sds, rtol=3e-3)


def test_the_earth_adds_to_one_sense_and_takes_from_the_other():
    quiet = Noise(1e-5, 0.0, 0.0)
    run, theta = turned(5, earth=7.292115e-5, noise=quiet)
    _, mean, sd = solved(run, noise=quiet)
    assert mean[-1] == pytest.approx(7.292115e-5, abs=4.0 * sd[-1])
    assert sd[-1] < 0.1 * EARTH.sd
    _, plain, narrow = solved(run, extras=(), noise=quiet)
    assert np.abs((mean[:9] - theta) / sd[:9]).max() < 4.0
    assert np.abs((plain - theta) / narrow).max() > 8.0


def test_at_one_rate_in_one_sense_the_earth_is_a_scale_factor():
    run, _ = turned(6, dwells=120)
    one_way = replace(run, sections=tuple(s for s in run.sections if s.rate == RATES[0]))
    case, *_ = solved(one_way)
    summary, sd = case.summary, np.append(WIDE, EARTH.sd)
    seen = observe(summary.factor, sd, case.components[0].facts, reach=summary.reach)
    (group,) = (group for group in seen.groups if "earth_rate" in group.terms)
    assert {"gx.b1", "gy.b1", "gz.b1"} <= set(group.terms)
    assert "Earth's rate along the table's axis acts" in group.reason
    assert group.remedy == "as many turns in the other sense would separate them"


def test_lengths_are_recovered_with_the_earth_in_them():
    run, _ = turned(3, dwells=48, earth=7.292115e-5)
    case, *_ = solved(run)
    (found,) = recover(case, [run], np.append(WIDE, EARTH.sd), case.triads[0].theta)
    assert (found.what, len(found.after)) == ("rate", 48)
    # 38 degrees of freedom
    assert np.mean((found.after / found.fitted) ** 2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 38.0))
    assert np.abs(found.before).max() > 20.0 * found.fresh.max()


def test_noise_is_estimated_from_the_sections():
    case, *_ = solved(turned(2)[0], noise=None)
    assert pytest.approx(NOISE.N, rel=0.05) == case.summary.runs[0].noise.N


def test_a_section_that_somebody_touched_is_left_out():
    run, _ = turned(4)
    spoilt = np.arange(len(run.t))[2100:2300]  # within the fifth section
    output = run.output.copy()
    output[spoilt] += 0.05
    touched = replace(run, output=output)
    asked = TriadSpec(LIBRARY, ScalePrior(WIDE), None, {"table": NoiseRule("fixed", NOISE)})
    rng = np.random.default_rng(1)
    runs, distrusted, case = trusted_stills([touched], asked, extras=(EARTH,), rng=rng)
    assert {d.run for d in distrusted} == {"table"}
    assert min(d.start for d in distrusted) < run.t[2100] < run.t[2299] < max(d.stop for d in distrusted)
    clean, pulled = (solved(one)[1] for one in (run, touched))
    sd = solved(run)[2]
    assert np.abs((case.theta - clean) / sd).max() < 1.5 < np.abs((pulled - clean) / sd).max()
    assert sum(b - a for a, b in runs[0].stills) > 0.9 * len(run.t)


def test_rates_in_another_unit_are_said():
    run, _ = turned(1)
    with pytest.raises(DataError, match="gx gy gz look like deg/s under rad/s"):
        refuse_conflicts(replace(run, output=np.rad2deg(run.output)), "gyroscope", {"gyroscope": (None, {})})


def test_eight_sections_are_too_few():
    with pytest.raises(UnobservableError, match="8 sections are too few"):
        solved(turned(1, dwells=8)[0])


LAID = np.tile([1e-2, 2e-2, 2e-2, 2e-2], 3)
HOLD, TURN, STEP = 400, 300, 0.005
UP = ["x", "y", "z", "-x", "-y", "z", "x", "-z", "y", "x", "-y", "-z", "-x"]


@cache
def by_hand(seed, positions=13, tilt=0.0):
    """Cube that is laid on one face after the other, by a hand that wanders; and its coefficients."""
    rng = np.random.default_rng([seed, 5])
    theta = LAID * rng.normal(size=12)
    # rows of the gain along x y z, from b1 m_j m_k along i j k of each component
    rows = np.array([np.roll(part[1:], k) for k, part in enumerate(theta.reshape(3, 4))])
    rates, sections, here, first = [], [], Rotation.identity(), 0
    s, step = np.arange(1, TURN) / TURN, 1e-4
    for k, up in enumerate(UP[:positions]):
        lies = RunSection(0, 1, up).direction
        lies = Rotation.from_rotvec(tilt * rng.normal(size=3)).apply(lies)
        # case to lab: what points up is turned to z, and about that the face is laid down anyhow
        there = Rotation.align_vectors([[0.0, 0.0, 1.0]], [lies])[0]
        there = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * there
        if k:
            way = here.inv() * there  # in axes of the case
            axis = rng.normal(size=3)

            def path(s, here=here, way=way, axis=axis):
                wander = Rotation.from_rotvec(np.outer(np.sin(np.pi * s) ** 2, axis))
                course = 10 * s**3 - 15 * s**4 + 6 * s**5
                return here * Rotation.from_rotvec(np.outer(course, way.as_rotvec())) * wander

            turned = (path(s - step).inv() * path(s + step)).as_rotvec()
            rates.append(turned / (2.0 * step * TURN * STEP))
            first += TURN - 1
        rates.append(np.zeros((HOLD, 3)))
        sections.append(RunSection(first, first + HOLD, up))
        first, here = first + HOLD, there
    w = np.concatenate(rates)
    output = w + w @ rows.T + theta[[0, 4, 8]] + NOISE.N / np.sqrt(STEP) * rng.normal(size=w.shape)
    inputs = Inputs(STEP * np.arange(len(w)), {}, STEP)
    return Run(
        "cube", "ferraris", inputs, output, gravity=9.81, sections=tuple(sections), components=GYROSCOPES
    ), theta


def placed(run, fixture=None):
    asked = TriadSpec(LIBRARY, ScalePrior(LAID), None, {"cube": NoiseRule("fixed", NOISE)})
    case = solve_ferraris([run], asked, fixture=fixture)
    sd = np.append(LAID, [extra.sd for extra in case.summary.extras])
    return case, *posterior(case.summary.factor, sd), sd


@pytest.mark.parametrize("tilt", [0.0, 5e-3])
def test_coefficients_of_a_cube_are_off_by_what_their_error_bars_say(tilt):
    pulls = []
    for seed in range(10):
        run, theta = by_hand(seed, tilt=tilt)
        _, mean, sd, _ = placed(run, tilt or None)
        pulls.append((mean[:12] - theta) / sd[:12])
    assert np.abs(pulls).max() < 4.5
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * np.size(pulls)))


def test_least_squares_on_where_up_is_carried_finds_the_same():
    run, _ = by_hand(1)
    t, stills = run.t, [(s.start, s.stop) for s in run.sections]
    ups = [s.direction for s in run.sections]

    def missed(x):
        gain = np.eye(3) + [np.roll(part[1:], k) for k, part in enumerate(x.reshape(3, 4))]
        w = np.linalg.solve(gain, (run.output - at_rest).T).T  # turns tell nothing of the biases
        left = [x / LAID, *(run.output[a:b].mean(axis=0) - x[[0, 4, 8]] for a, b in stills)]
        left[1:] = [one / (NOISE.N / np.sqrt(HOLD * STEP)) for one in left[1:]]
        for k in range(len(stills) - 1):
            a, b = stills[k][1] - 1, stills[k + 1][0] + 1
            mean, up = 0.5 * (w[a : b - 1] + w[a + 1 : b]) * STEP, ups[k]
            turns = Rotation.from_rotvec(-mean + np.cross(w[a + 1 : b], w[a : b - 1]) * STEP**2 / 12)
            for turn in turns.as_matrix():
                up = turn @ up
            u = ups[k + 1]
            across = np.linalg.svd(u[None])[2][1:]
            weights = np.linalg.norm(np.linalg.solve(gain.T, np.cross(u, across).T), axis=0)
            left.append(across @ (u - up) / (NOISE.N * np.sqrt(t[b - 1] - t[a]) * weights))
        return np.concatenate(left)

    at_rest = np.mean([run.output[a:b].mean(axis=0) for a, b in stills], axis=0)
    found = least_squares(missed, np.zeros(12), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    _, mean, sd, _ = placed(run)
    assert np.abs((found.x - mean) / sd).max() < 0.2  # rows are linearised sample by sample
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))), sd, rtol=0.05)


def test_rest_and_up_are_recovered():
    case, _, _, sd = placed(by_hand(2)[0])
    rest, closure = recover(case, [by_hand(2)[0]], sd, case.theta[:12])
    assert (rest.what, closure.what) == ("rest", "closure")
    assert np.abs(closure.before).max() > 20.0 * np.abs(closure.after).max()
    for one in (rest, closure):
        assert one.inside >= 0.8 * one.after.size


def test_six_positions_have_too_few_turns_between_them():
    with pytest.raises(UnobservableError, match="5 turns without a gap between its 6 stills"):
        placed(by_hand(1, positions=6)[0])
