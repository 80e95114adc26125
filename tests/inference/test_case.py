"""A component set apart from a joint problem, of which nothing is lost, and what components say at rest."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import hands
import numpy as np
import pytest

from imubayes.algebra.factor import add, factor_of, posterior
from imubayes.inference.case import apart, rows_at_rest
from imubayes.inference.free_tumble import solve_imu_tumble
from imubayes.inference.noise_model import likelihood, noise_rows, process_model
from imubayes.inference.stills import find_stills
from imubayes.inference.summary import Summary
from imubayes.inference.triad import triad_of
from imubayes.rig.inputs import Inputs, Run, RunSection
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import class_prior

SDS = {"b0": (0.5, 5e-2), "b1": (1e-2, 1e-2), "m_j": (2e-2, 2e-2), "m_k": (2e-2, 2e-2), "g_i": (1e-4, 1e-4)}


@pytest.fixture(scope="module")
def problem():
    kinds = enumerate(("accelerometer", "gyroscope"))
    sds = [{name: sd[k] for name, sd in SDS.items()} for k in (0, 1)]
    both = [hands.asked(hands.only(kind, SDS), sds[k], hands.NOISES[k]) for k, kind in kinds]
    triads = [
        replace(triad_of(one.library, referenced=k == 1), theta=0.3 * one.prior.sd)
        for k, one in enumerate(both)
    ]
    case = solve_imu_tumble([hands.in_the_hand(*triads)], *both)
    return case, np.concatenate([one.prior.sd for one in both])


@pytest.mark.parametrize("component", ["ax", "gy"])
def test_the_posterior_of_what_is_left_is_that_of_the_whole(problem, component):
    case, sd = problem
    (one,) = (c for c in case.components if c.name == component)
    columns = [f"{component}.{name}" for name in one.library.names]
    own = apart(case.summary, sd, case.rows, one.parts, columns)
    whole = dict(zip(case.summary.names, zip(*posterior(case.summary.factor, sd), strict=True), strict=True))
    mean, spread = posterior(own.summary.factor, own.sd)
    expected = np.array([whole[name] for name in own.summary.names])
    assert set(columns) <= set(own.summary.names) <= set(case.summary.names)
    # turns tell of all six, but not of the others' biases; the accelerometers' stills of theirs
    assert len(own.summary.names) == (9 if component == "ax" else len(case.summary.names) - 5)
    # the scale at which the others' priors are taken is that of the residuals, within 2 % of one
    np.testing.assert_allclose(mean, expected[:, 0], atol=0.01 * expected[:, 1].min(), rtol=1e-3)
    np.testing.assert_allclose(spread, expected[:, 1], rtol=1e-3)


def test_rows_are_those_of_the_component_s_own_runs(problem):
    case, sd = problem
    (gy,) = (c for c in case.components if c.name == "gy")
    own = apart(case.summary, sd, case.rows, gy.parts, ["gy.b0"])
    assert [run.name for run in own.summary.runs] == ["hand (gy at rest)", "hand (turns)"]
    for rows, k in zip(own.rows, gy.parts, strict=True):
        where = [case.summary.names.index(name) for name in rows.names]
        np.testing.assert_array_equal(rows.columns(3, 9), case.rows[k].columns(3, 9)[:, where])


def test_what_an_elimination_rounds_is_no_row(problem):
    """Nine rows of a large column that the component does not have say two things of its own three."""
    case, _ = problem
    names, rng = ("other", "a", "b", "c"), np.random.default_rng(1)
    told = rng.standard_normal((9, 2))
    elsewhere = np.column_stack((1e9 * rng.standard_normal(9), told, told @ [0.3, -0.7]))
    factors = [factor_of(X, np.zeros(9), names) for X in (np.eye(4)[rng.integers(1, 4, 9)], elsewhere)]
    runs = tuple(
        replace(case.summary.runs[0], factor=f, reach=np.abs(f.R[:, :-1]).max(axis=0)) for f in factors
    )
    rows = [replace(case.rows[0], names=names)] * 2
    summary = Summary(add(*factors), runs)
    own = apart(summary, np.full(4, 1e3), rows, [0], ["a", "b", "c"])
    assert own.known is not None and own.known.n == 2


def test_what_others_leave_of_their_fit_is_no_matter_of_a_component_whose_columns_follow_from_others(problem):
    """Of five columns that say three things, any solution is one without a residual."""
    case, _ = problem
    names, rng = tuple("abcde"), np.random.default_rng(2)
    X, y = rng.standard_normal((40, 3)) @ rng.standard_normal((3, 5)), 7.0 * rng.standard_normal(40)
    factors = [factor_of(rng.standard_normal((9, 5)), np.zeros(9), names), factor_of(X, y, names)]
    runs = tuple(replace(case.summary.runs[0], factor=f, reach=np.ones(5)) for f in factors)
    own = apart(
        Summary(add(*factors), runs), np.ones(5), [replace(case.rows[0], names=names)] * 2, [0], names
    )
    assert own.known is not None and own.known.n == 3
    R, (best, *_) = own.known.R, np.linalg.lstsq(X, y, rcond=None)
    np.testing.assert_allclose(R[:, :-1] @ best, R[:, -1], atol=1e-9)
    np.testing.assert_allclose(R[:, :-1].T @ R[:, :-1], X.T @ X, atol=1e-9)


G, DT, SAMPLES, MOVING = hands.GRAVITY, hands.INTERVAL, 500, 60
TERMS = ("b0", "b1", "m_j", "m_k", "g_i", "g_j", "g_k")
LIBRARIES = [hands.only(kind, TERMS) for kind in ("accelerometer", "gyroscope")]
TRIADS = tuple(hands.with_truth(lib, {}, referenced=True) for lib in LIBRARIES)
CASE = SimpleNamespace(
    triads=TRIADS, components=[SimpleNamespace(name=name) for triad in TRIADS for name in triad.components]
)
AT_REST = np.concatenate([np.arange(k * SAMPLES, (k + 1) * SAMPLES - MOVING) for k in range(6)])
PRIOR = class_prior(sensor("mems_consumer", kind="gyroscope"), DT)


def on_a_table(force=0.0, rate=0.0, seed=1):
    """Six positions and a turn, noise of unit size; `force` and `rate` (7, 3) are added to each section."""
    rng = np.random.default_rng(seed)
    sections = tuple(
        RunSection(k * SAMPLES, (k + 1) * SAMPLES - MOVING, up, angle)
        for k, (up, angle) in enumerate([*((up, 0.0) for up in hands.UP), ("x", 6.0)])
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
    data = process_model(*noise_rows(rows), PRIOR)
    return likelihood(data, ("N", "K"), np.log([0.1, 0.2])).levels[0]


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
    f = G * np.array([RunSection(0, 1, up).direction for up in (*hands.UP, "x")])
    modelled = 0.3 + f @ np.random.default_rng(3).normal(size=(3, 3))
    drift = np.linspace(0.0, 1.0, 7)[:, None] * np.ones(3)
    plain = told(on_a_table(), "gx")
    assert told(on_a_table(rate=modelled), "gx") == pytest.approx(plain, abs=1e-6)
    assert abs(told(on_a_table(rate=drift), "gx") - plain) > 1e-3


def test_stills_of_a_free_tumble_are_those_of_its_accelerometers():
    run = hands.in_the_hand(*TRIADS, stills=12, seed=4)
    rows, stills = rows_at_rest([run], CASE), find_stills(run)
    assert len(rows["ax"][0]) == len(rows["gz"][0]) == sum(b - a for a, b in stills)
    assert len(rows["ax"][0].names) == len(stills)
    assert rows["gz"][0].names == LIBRARIES[1].names
