"""Gyroscopes alone on a table whose rate is all that is known: simulated, and least squares of scipy."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imubayes.algebra.factor import posterior
from imubayes.errors import DataError, UnobservableError
from imubayes.inference.case import Asked
from imubayes.inference.conflicts import refuse_conflicts
from imubayes.inference.free_tumble import solve_free_tumble, trusted_stills
from imubayes.inference.known_quantities import recover
from imubayes.inference.linear import Extra
from imubayes.inference.observability import observe
from imubayes.inference.prior import ScalePrior
from imubayes.inference.triad import triad_of
from imubayes.rig.inputs import Inputs, Run, Section
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
        sections.append(Section(k * count, (k + 1) * count, rate=rate))
    t = INTERVAL * np.arange(count * dwells)
    inputs = Inputs(t, {}, INTERVAL)
    output, parts = np.concatenate(outputs), tuple(sections)
    return Run("table", "free-tumble", inputs, output, sections=parts, components=GYROSCOPES), theta


def solved(run, extras=(EARTH,), noise=NOISE):
    rules = None if noise is None else {"table": NoiseRule("fixed", noise)}
    case = solve_free_tumble([run], Asked(LIBRARY, ScalePrior(WIDE), None, rules), extras=extras)
    return case, *posterior(case.summary.factor, np.append(WIDE, [extra.sd for extra in extras]))


def test_coefficients_are_off_by_what_their_error_bars_say():
    pulls = []
    for seed in range(30):
        earth = EARTH.sd * np.random.default_rng(seed).normal()
        run, theta = turned(seed, earth=earth)
        _, mean, sd = solved(run)
        pulls.append((mean - np.append(theta, earth)) / sd)
    assert np.abs(pulls).max() < 4.5
    # 300 numbers, of which the ten of a unit share its noise
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * 300.0))


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
    asked = Asked(LIBRARY, ScalePrior(WIDE), None, {"table": NoiseRule("fixed", NOISE)})
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
