"""A component set apart from a joint problem: nothing that the whole says of it is lost."""

from __future__ import annotations

from dataclasses import replace

import hands
import numpy as np
import pytest

from imubayes.algebra.factor import add, factor_of, posterior
from imubayes.inference.case import Asked, apart
from imubayes.inference.free_tumble import solve_imu_tumble
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.inference.triad import triad_of
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library, library

SDS = {"b0": (0.5, 5e-2), "b1": (1e-2, 1e-2), "m_j": (2e-2, 2e-2), "m_k": (2e-2, 2e-2), "g_i": (1e-4, 1e-4)}


def asked(which, kind):
    every = library(kind, powers=1, asymmetry=-1, set="extended")
    lib = Library(kind, tuple(term for term in every.terms if term.name in SDS))
    sd = [SDS[name][which] for one in triad_of(lib, referenced=which == 1).libraries for name in one.names]
    return Asked(lib, ScalePrior(sd), None, {"hand": NoiseRule("fixed", hands.NOISES[which])})


@pytest.fixture(scope="module")
def problem():
    both = [asked(k, kind) for k, kind in enumerate(("accelerometer", "gyroscope"))]
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
    # turns move what all six say, the accelerometers' stills but theirs
    assert len(own.summary.names) == (9 if component == "ax" else len(case.summary.names))
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
