"""From runs to one factor: generalized least squares by a dense route, and the laws of adding runs."""

from __future__ import annotations

import math
from dataclasses import replace

import made
import numpy as np
import pytest

from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor, add
from imubayes.errors import InputError, StudyError, UnobservableError
from imubayes.inference.linear import Extra, Rows, blocks_of, deviation, linear_of
from imubayes.inference.summary import Summary, summarize
from imubayes.inference.whiten import Processes
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import CHANNELS, columns, library

LIB = library("accelerometer", powers=2, asymmetry=-1)
NOISE = Noise(0.02, 0.0, 0.01)
INTERVAL = 0.5


def _run(name: str, n: int, seed: int, *, channels=CHANNELS) -> Run:
    rng = np.random.default_rng(seed)
    t = np.cumsum(INTERVAL + rng.integers(0, 3, n) * 1.5)  # gaps between rows
    u = {channel: rng.normal(size=n) for channel in channels}
    output = (
        u.get("f_i", 0.0) + columns(LIB, u, n) @ rng.normal(size=len(LIB.terms)) + 0.1 * rng.normal(size=n)
    )
    return Run(name, "other", Inputs(t, u, INTERVAL), output)


def _given(*names: str, noise: Noise = NOISE) -> dict[str, NoiseRule]:
    return {name: NoiseRule("fixed", noise) for name in names}


def _gram(f: Factor) -> np.ndarray:
    """Inner products of the whitened rows, columns scaled: a factor without its free signs."""
    size = np.linalg.norm(f.R, axis=0)
    return f.R.T @ f.R / np.outer(size, size)


def test_summary_is_generalized_least_squares_with_the_dense_covariance():
    run = _run("a", 60, 1)
    found = summarize([run], LIB, rules=_given("a"))
    X, nothing = columns(LIB, run.inputs.channels, 60), np.empty(0)
    C = made.dense(NOISE, Rows(run.inputs.t, np.full(60, INTERVAL)), Processes(nothing, nothing))
    y = run.output - run.inputs.channels["f_i"]
    information = X.T @ np.linalg.solve(C, X)
    theta = np.linalg.solve(information, X.T @ np.linalg.solve(C, y))
    rss = (y - X @ theta) @ np.linalg.solve(C, y - X @ theta)
    fit = found.least_squares()
    np.testing.assert_allclose(fit.mean, theta, rtol=1e-8, atol=1e-10)
    assert fit.rss == pytest.approx(rss, rel=1e-9)
    sd = np.sqrt(rss / (60 - len(LIB.terms)) * np.diag(np.linalg.inv(information)))
    np.testing.assert_allclose(fit.sd, sd, rtol=1e-8)
    assert found.factor.log_det == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-10)


def test_the_summary_of_runs_is_the_sum_of_their_summaries_in_any_order():
    runs = [_run("a", 30, 1), _run("b", 25, 2), _run("c", 40, 3)]
    rules = _given("a", "b", "c")
    whole, turned = summarize(runs, LIB, rules=rules), summarize(runs[::-1], LIB, rules=rules)
    one, two, three = (summarize([run], LIB, rules=rules).factor for run in runs)
    for other in (turned.factor, add(add(one, two), three)):
        np.testing.assert_allclose(_gram(other), _gram(whole.factor), rtol=0.0, atol=1e-13)
        assert other.n == whole.factor.n == 95
        assert other.log_det == pytest.approx(whole.factor.log_det, rel=1e-13)
    assert [run.name for run in whole.runs] == ["a", "b", "c"]


def test_white_noise_of_unknown_scale_is_ordinary_least_squares_with_unit_residuals():
    run = _run("a", 60, 7)
    found = summarize([run], LIB, rules={"a": NoiseRule("white")})
    X, y = columns(LIB, run.inputs.channels, 60), run.output - run.inputs.channels["f_i"]
    theta, rss, _, _ = np.linalg.lstsq(X, y, rcond=None)
    fit = found.least_squares()
    np.testing.assert_allclose(fit.mean, theta, rtol=1e-10, atol=1e-12)
    assert fit.rss / fit.dof == pytest.approx(1.0, rel=1e-12)
    spread = math.sqrt(rss[0] / fit.dof)
    # a sample of length T has the white sd N / sqrt(T)
    assert found.runs[0].noise.N / math.sqrt(INTERVAL) == pytest.approx(spread, rel=1e-10)
    assert found.factor.log_det == pytest.approx(120.0 * math.log(spread), rel=1e-9)


def test_a_run_takes_the_noise_of_the_run_that_it_is_like_whatever_their_order():
    runs = [_run("a", 30, 1), _run("b", 30, 2)]
    rules = {"a": NoiseRule("fixed", like="b"), **_given("b")}
    for order in (runs, runs[::-1]):
        found = {run.name: run for run in summarize(order, LIB, rules=rules).runs}
        assert found["a"].noise == NOISE
        assert (found["a"].found.origin, found["b"].found.origin) == ("run b", "given")
    with pytest.raises(StudyError, match="run 'a' takes its noise from run 'z'"):
        summarize(runs, LIB, rules={"a": NoiseRule("fixed", like="z"), **_given("b")})


def _flicker(rng: np.random.Generator, n: int, B: float, finer: int = 8) -> np.ndarray:
    """Averages over 1 s of noise whose spectrum is ``B^2 / (2 pi f)``, by Fourier's sum at a finer rate."""
    m = 2 * n * finer
    f = np.fft.rfftfreq(m, 1.0 / finer)[1:]
    size = np.sqrt(B**2 / (2.0 * math.pi * f) * m * finer / 2.0)
    X = np.append(0.0, size * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))))
    return np.fft.irfft(X, m)[: n * finer].reshape(n, finer).mean(axis=1)


@pytest.mark.parametrize("B", [1e-4, 4e-4])
def test_white_noise_of_a_long_log_is_judged_where_bias_instability_does_not_hide_it(B):
    """By blocks of a 1500th of the log alone N was 2.4 times too large, four of its sds."""
    N, n, rng = 3.5e-4, 100_000, np.random.default_rng(3)
    output = 9.8 + N * rng.normal(size=n) + _flicker(rng, n, B)
    log = Run("log", "static", Inputs(np.arange(float(n)), {"f_i": np.full(n, 9.8)}, 1.0), output)
    found = summarize([log], LIB).runs[0].found
    for value, true, sd in ((found.noise.N, N, found.sd[0]), (found.noise.B, B, found.sd[1])):
        assert sd < 0.05
        assert abs(math.log(value / true)) < 3.0 * sd


def test_fewer_rows_than_tested_terms_are_named():
    few = _run("a", 4, 1, channels=("f_i", "f_j"))
    with pytest.raises(UnobservableError, match="4 rows in 1 run are too few") as caught:
        summarize([few], LIB, rules=_given("a"))
    assert set(caught.value.terms) == {"b0", "b1", "b2", "m_j", "c_ij", "c_jj"}


def test_reach_is_the_largest_size_of_a_column_over_the_runs():
    runs = [_run("a", 30, 1, channels=("f_i", "f_j")), _run("b", 30, 2, channels=("f_i", "w_i"))]
    found = summarize(runs, LIB, rules=_given("a", "b"))
    X = np.vstack([columns(LIB, run.inputs.channels, 30) for run in runs])
    assert list(found.reach) == list(LIB.names)
    np.testing.assert_array_equal(list(found.reach.values()), np.abs(X).max(axis=0))
    assert found.reach["m_k"] == 0.0


@pytest.mark.parametrize("chunk", [1, 3, 70, algebra.ROWS_AT_ONCE])
def test_blocks_are_averages_however_many_are_made_at_a_time(chunk, monkeypatch):
    monkeypatch.setattr(algebra, "ROWS_AT_ONCE", chunk)
    run = _run("a", 700, 8)
    found = blocks_of(linear_of(run, LIB))
    counts = np.rint(found.rows.duration / INTERVAL).astype(int)
    ends = np.cumsum(counts)
    X, y = linear_of(run, LIB).X, deviation(run, LIB)
    assert ends[-1] == 700
    for k, (a, b) in enumerate(zip(ends - counts, ends, strict=True)):
        np.testing.assert_allclose(found.X[k], X[a:b].mean(axis=0), rtol=1e-12, atol=1e-13)
        assert found.y[k] == pytest.approx(y[a:b].mean(), rel=1e-12, abs=1e-13)
        assert found.rows.t[k] == pytest.approx(run.inputs.t[a:b].mean(), rel=1e-13)


def test_the_output_of_a_run_whose_own_input_was_not_excited_is_all_deviation():
    run = _run("a", 20, 9, channels=("f_j",))
    np.testing.assert_array_equal(deviation(run, LIB), run.output)


def test_without_columns_all_is_residual():
    fit = Summary.from_arrays(np.empty((3, 0)), [1.0, 2.0, 2.0], ()).least_squares()
    assert (fit.rss, fit.dof, fit.mean.shape) == (pytest.approx(9.0, rel=1e-15), 3, (0,))


ONES = np.ones((3, 1))


@pytest.mark.parametrize(
    ("X", "y", "names", "said"),
    [
        (np.ones(3), np.ones(3), "a", r"X must be \(n, p\)"),
        (np.ones((3, 2)), np.ones(3), "a", r"X must be \(n, p\)"),
        (ONES, np.ones(4), "a", r"X must be \(n, p\)"),
        (ONES, ONES, "a", r"X must be \(n, p\)"),
        ([[1.0], [math.nan]], np.ones(2), "a", "must be finite"),
        (ONES, [1.0, math.inf, 1.0], "a", "must be finite"),
        (ONES, np.ma.masked_greater(np.arange(3.0), 1.0), "a", "y: expected plain real numbers"),
        (ONES, np.ones(3) + 0j, "a", "y: expected plain real numbers"),
        # whatever is asked of it would be told of the first alone: a signal in the third column got lost
        (np.ones((3, 3)), np.ones(3), "aba", r"'a' is there twice, in columns 0 and 2.*rename one"),
    ],
)
def test_arrays_that_are_no_rows_are_refused(X, y, names, said):
    with pytest.raises((InputError, UnobservableError), match=said):
        Summary.from_arrays(X, y, tuple(names))


@pytest.mark.parametrize(("size", "same"), [(1e-9, True), (1.0, False)])
def test_a_column_of_rounding_takes_no_direction_out_of_the_noise(size, same):
    run = _run("a", 400, 5)
    plain = linear_of(run, LIB)
    wandering = size * np.cumsum(np.random.default_rng(6).normal(size=400))[:, None]
    wider = replace(
        plain,
        names=(*plain.names, "fixture_i"),
        columns=lambda a, b: np.hstack((plain.columns(a, b), wandering[a:b])),
    )
    extra = Extra("fixture_i", "fixture", 1e-3, "rad", "arcsec", "rotation about the input axis")
    alone, beside = (
        summarize([run], LIB, rows=[rows], extras=extras).runs[0].noise
        for rows, extras in ((plain, ()), (wider, (extra,)))
    )
    assert (pytest.approx((alone.N, alone.B), rel=1e-9) == (beside.N, beside.B)) == same
