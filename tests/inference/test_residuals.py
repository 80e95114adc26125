"""Residual checks: runs that the model fits pass, and what it lacks is told."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import imubayes as ib
from imubayes.inference.linear import linear_of
from imubayes.inference.residuals import SUSPECT, check_residuals, level_of
from imubayes.inference.summary import summarize
from imubayes.rig.simulate import synthesise
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library

INDUSTRIAL = ib.sensor("mems_industrial", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
TRUTH = {"b0": 0.1, "b1": 1e-3, "b2": 1e-5, "m_j": 1e-3, "c_ij": 5e-6}
COLOURED = Noise(6e-4, 3e-4, 2e-5)
ESTIMATED = NoiseRule()


def tumble(seed, *, truth=TRUTH, noise=COLOURED, angles=16):
    plan = ib.tumble(angles=angles, planes=3, dwell=20.0, rate=5.0)
    (run,) = ib.simulate(INDUSTRIAL, [plan], seed=seed, truth=truth, noise=noise)
    return run


def checked(run, lib=LIBRARY, rule=ESTIMATED):
    """Check of a run under the least-squares coefficients of `lib`."""
    summary = summarize([run], lib, sensor=INDUSTRIAL, rules={run.name: rule})
    R, norms = summary.factor.R, summary.factor.column_norms
    theta, seen = np.zeros(len(norms)), norms > 0.0
    # 15 columns on a sphere have rank 14: the smallest of all solutions leaves the same residuals
    theta[seen] = np.linalg.lstsq(R[:-1, :-1][:, seen] / norms[seen], R[:-1, -1], rcond=1e-9)[0] / norms[seen]
    cov = np.zeros((len(norms), len(norms)))
    cov[np.ix_(seen, seen)] = np.linalg.pinv(R[:-1, :-1][:, seen].T @ R[:-1, :-1][:, seen])
    return check_residuals(linear_of(run, lib), theta, summary.runs[0], cov=cov)


def at_rest(values, noise, interval=0.1, level=SUSPECT):
    """Check of raw residuals of a run at rest, at a noise that is given."""
    t = interval * np.arange(len(values))
    plan = ib.static(len(t) * interval, 1.0 / interval)
    (run,) = ib.simulate(INDUSTRIAL, [plan], seed=1, truth={}, noise=noise)
    summary = summarize([run], LIBRARY, rules={"static": NoiseRule("fixed", noise)}).runs[0]
    rows = replace(linear_of(run, LIBRARY), y=values)
    return check_residuals(rows, np.zeros(len(rows.names)), summary, level=level)


@pytest.mark.parametrize(("left", "told"), [(2, (False, False)), (20, (True, False)), (90, (True, True))])
def test_a_fit_that_leaves_little_tells_neither_size_nor_whiteness(left, told):
    """Of 100 rows at rest, whose bias takes as many degrees of freedom as its variance says."""
    noise, n = Noise(1.0, 0.0, 0.0), 100
    plan = ib.static(n * 1.0, 1.0)
    (run,) = ib.simulate(INDUSTRIAL, [plan], seed=1, truth={}, noise=noise)
    (summary,) = summarize([run], LIBRARY, rules={"static": NoiseRule("fixed", noise)}).runs
    rows, cov = linear_of(run, LIBRARY), np.zeros((len(LIBRARY.names),) * 2)
    cov[0, 0] = (n - left) / np.sum(summary.factor.R[:-1, 0] ** 2)
    check = check_residuals(rows, np.zeros(len(cov)), summary, cov=cov)
    assert (not np.isnan(check.scale), not np.isnan(check.whiteness_p)) == told
    if told[0]:
        assert check.scale == pytest.approx(np.linalg.norm(rows.y) / np.sqrt(left))


def test_p_values_of_noise_alone_are_uniform():
    noise, n = Noise(1.0, 0.0, 0.0), 4000
    t, rng = 0.1 * np.arange(n), np.random.default_rng(1)
    checks = [at_rest(synthesise(noise, t, 0.1, rng), noise) for _ in range(200)]
    for p in (
        [c.whiteness_p for c in checks],
        [c.normality_p for c in checks],
        [c.sample_whiteness_p for c in checks],
    ):
        for level in (0.05, 0.2, 0.5):
            # Ljung-Box and Jarque-Bera are asymptotic: at 400 blocks a few percent off
            spread = np.sqrt(level * (1.0 - level) / len(p))
            assert abs(np.mean(np.array(p) < level) - level) < 4.0 * spread + 0.03
    assert np.mean([bool(c.outliers) for c in checks]) < 0.01 + 4.0 * np.sqrt(0.01 / 200)


def test_scale_is_one_at_the_noise_floor_and_two_at_twice_the_noise():
    noise = Noise(0.5, 0.2, 0.01)
    values = synthesise(noise, 0.1 * np.arange(8000.0), 0.1, np.random.default_rng(2))
    usual, double = at_rest(values, noise), at_rest(2.0 * values, noise)
    assert usual.scale == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(usual.t)))
    assert double.scale == pytest.approx(2.0 * usual.scale, rel=1e-12)
    assert double.sample_scale == pytest.approx(2.0 * usual.sample_scale, rel=1e-12)
    assert usual.fits and not double.fits


def test_what_a_fit_took_is_taken_from_the_degrees_of_freedom():
    noise, plan = Noise(6e-4, 0.0, 0.0), ib.tumble(angles=8, planes=3, dwell=1.0, rate=2.0)
    runs = (ib.simulate(INDUSTRIAL, [plan], seed=k, truth=TRUTH, noise=noise)[0] for k in range(30))
    squares = [checked(run, rule=NoiseRule("fixed", noise)).scale ** 2 for run in runs]
    # 48 samples, of which the fit takes 14
    assert np.mean(squares) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (34 * 30)))


@pytest.mark.parametrize(
    ("missing", "rule"),
    [({"b3": 2e-5}, ESTIMATED), ({"b2p": 2e-4}, ESTIMATED), ({"c_jk": 2e-4}, NoiseRule("fixed", COLOURED))],
    ids=str,
)
def test_a_strong_term_that_the_library_lacks_is_told(missing, rule):
    lean = Library("accelerometer", tuple(t for t in LIBRARY.terms if t.name in TRUTH))
    assert checked(tumble(3), lean, rule).fits
    assert not checked(tumble(3, truth={**TRUTH, **missing}), lean, rule).fits


def test_coloured_noise_taken_for_white_is_told():
    strong = Noise(6e-4, 1e-3, 5e-5)
    white, coloured = (
        checked(tumble(4, noise=strong), rule=rule) for rule in (NoiseRule("white"), ESTIMATED)
    )
    assert white.whiteness_p < 1e-6 and not white.fits
    assert coloured.fits


def test_a_knock_is_listed_first_and_at_its_instant():
    noise, n = Noise(0.5, 0.0, 0.0), 8000
    values = synthesise(noise, 0.1 * np.arange(n), 0.1, np.random.default_rng(6))
    values[5000:5020] -= 20.0
    result = at_rest(values, noise)
    start, stop, size = result.outliers[0]
    assert start - 0.1 <= 500.0 < stop and stop - start == pytest.approx(2.0)
    assert size < -10.0
    assert not result.fits


@pytest.mark.parametrize(
    ("studies", "runs", "n"), [(60, 8, 1000), pytest.param(1000, 24, 4000, marks=pytest.mark.slow)]
)
def test_studies_that_are_right_give_an_alarm_no_more_often_than_stated(studies, runs, n):
    """Of all tests of all runs of a study together; three families share the level, and this is one."""
    noise, rng = Noise(1.0, 0.0, 0.0), np.random.default_rng(13)
    level = level_of(1, runs)  # as if the runs' tests had the whole level
    alarms = sum(
        not all(at_rest(synthesise(noise, 0.1 * np.arange(n), 0.1, rng), noise, level=level).fits
                for _ in range(runs))
        for _ in range(studies)
    )  # fmt: skip
    expected = SUSPECT * studies
    assert alarms <= expected + 4.0 * np.sqrt(expected)


@pytest.mark.parametrize("power", [1, 3])
def test_p_of_normality_is_that_of_jarque_and_bera(power):
    values = np.random.default_rng(4).standard_normal(20_000) ** power
    check = at_rest(values, Noise(1.0, 0.0, 0.0))
    assert check.normality_p == pytest.approx(stats.jarque_bera(check.shown).pvalue, rel=1e-9)
