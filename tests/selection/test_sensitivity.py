"""Inclusion under other priors, against published numbers, the decision's own, and quadrature. Families that
object to the evidence: parts left out against refits, and the rule on verdicts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from decisions import dwells, records, table
from scipy.integrate import quad

from imubayes.algebra.factor import factor_of, noise_scale, reorder
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import select
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.sensitivity import LeftOut, combined, sensitivity, without_parts
from imubayes.selection.sindy import Sparse
from imubayes.selection.verdicts import Costs
from imubayes.sensors.terms import library


def made(n=60, p=5, *, seed=1, effect=0.4, names="abcdefghijklmnopqrstuvwxyz"):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p))
    theta = np.where(np.arange(p) % 2 == 0, effect * rng.normal(size=p), 0.0)
    return X, X @ theta + rng.normal(size=n), tuple(names[:p])


@pytest.mark.parametrize("name", ["attitude", "hald"])
def test_the_second_opinion_is_the_published_one(references, name):
    """BAS 1.7.5, hyper-g with a = 3, beta-binomial models, intercept in every model."""
    published = {
        row["variable"]: float(row["PIP"])
        for row in records(references / f"bms/coef_{name}_hyper3_random.csv")
    }
    header, X, y = table(references / f"bms/{name}.csv")
    X = np.column_stack((X, np.ones(len(y))))
    sd = np.append(np.ones(len(header)), math.inf)
    told = sensitivity(factor_of(X, y, (*header, "1")), sd, header)
    assert told.left_out == ()
    np.testing.assert_allclose(told.g_prior, [published[term] for term in header], atol=1e-9)


def test_the_widths_of_the_verdicts_are_those_of_the_decision(campaign):
    summary, prior, _, selection = campaign
    names = selection.models.candidates.names
    sd = prior.sd[[summary.names.index(name) for name in names]]
    told = sensitivity(reorder(summary.factor, names), sd, names)
    for width, inclusion in selection.by_width:
        at = int(np.argmin(np.abs(told.widths - width)))
        assert told.widths[at] == pytest.approx(width)
        np.testing.assert_allclose(told.inclusion[at], inclusion, rtol=1e-9)


def test_inclusion_of_a_single_candidate_is_that_of_quadrature():
    X, y, names = made(n=25, p=1)
    told = sensitivity(factor_of(X, y, names), np.array([0.3]), names)
    xx, xy, yy, n = float(X[:, 0] @ X[:, 0]), float(X[:, 0] @ y), float(y @ y), len(y)
    start = math.sqrt((yy - xy**2 / xx) / (n - 1))  # where the decision's scale starts: it ends at ten of it

    def joint(log_scale, sd):
        s2 = math.exp(2.0 * log_scale)
        shrunk = 0.0 if sd is None else xy**2 / (xx + s2 / sd**2)
        occam = 0.0 if sd is None else 0.5 * math.log1p(xx * sd**2 / s2)
        return math.exp(-0.5 * (yy - shrunk) / s2 - occam - n * (log_scale - math.log(start)) + 0.5 * n)

    def evidence(sd):
        middle = math.log(start)
        return quad(joint, middle - 2.0, middle + math.log(10.0), args=(sd,), epsabs=0.0, limit=200)[0]

    for width, inclusion in zip(told.widths, told.inclusion[:, 0], strict=True):
        odds = evidence(0.3 * width) / evidence(None)
        assert inclusion == pytest.approx(odds / (1.0 + odds), abs=1e-7)


def test_what_is_known_from_elsewhere_keeps_its_width():
    X, y, names = made()
    sd, f = np.full(5, 0.5), factor_of(X, y, names)
    wider = np.where(np.arange(5) < 4, 3.0, 1.0) * sd
    told = sensitivity(f, sd, names[:4], known=names[4:])
    stretched = sensitivity(f, wider, names[:4], known=names[4:])
    at = list(np.round(told.widths, 6))
    np.testing.assert_allclose(told.inclusion[at.index(3.0)], stretched.inclusion[at.index(1.0)], rtol=1e-12)
    loose = sensitivity(f, sd, names[:4])
    assert np.abs(loose.inclusion[0] - told.inclusion[0]).max() > 1e-3


def test_columns_that_depend_on_others_are_left_out_of_the_g_prior_and_named():
    X, y, names = made(p=4)
    doubled = np.column_stack((X, X[:, 0] - 2.0 * X[:, 2], X[:, 1]))
    told = sensitivity(factor_of(doubled, y, "abcdef"), np.ones(6), tuple("abcdef"))
    alone = sensitivity(factor_of(X, y, names), np.ones(4), names)
    assert told.left_out == ("e", "f")
    np.testing.assert_allclose(told.g_prior[:4], alone.g_prior, rtol=1e-9)
    assert np.isnan(told.g_prior[4:]).all() and np.isfinite(told.inclusion).all()


def test_an_error_that_is_known_well_takes_nothing_from_the_g_prior():
    """A column like the first candidate, whose coefficient is known: flat, it would explain all of it."""
    X, y, names = made(p=3)
    f = factor_of(np.column_stack((X, X[:, 0])), y, (*names, "known"))
    alone = sensitivity(factor_of(X, y, names), np.ones(3), names)
    told = sensitivity(f, np.array([1.0, 1.0, 1.0, 1e-6]), names, known=("known",))
    np.testing.assert_allclose(told.g_prior, alone.g_prior, rtol=1e-6)
    assert sensitivity(f, np.array([1.0, 1.0, 1.0, math.inf]), names).left_out == names[:1]


def test_too_few_rows_leave_no_g_prior():
    X, y, names = made(n=5, p=4)
    assert np.isnan(sensitivity(factor_of(X, y, names), np.ones(4), names).g_prior).all()


def test_a_term_swings_where_a_threshold_lies_between_its_inclusions():
    X, y, names = made(n=200, effect=0.25)
    f = factor_of(X, y, names)
    for costs in (Costs(), Costs(10.0, 1.0), Costs(1.0, 10.0)):
        told = sensitivity(f, np.full(5, 1.0), names, costs=costs)
        usual = told.inclusion[2:-2]
        expected = [
            any(
                usual[:, j].min() < threshold <= usual[:, j].max()
                for threshold in (costs.not_needed, costs.keep, costs.needed)
            )
            for j in range(5)
        ]
        assert [name in told.swing for name in names] == expected
        assert 0 < sum(expected) < 5


def test_many_candidates_have_three_widths_at_one_noise_scale():
    X, y, names = made(n=4000, p=21, effect=0.05)
    f, sd = factor_of(X, y, names), np.full(21, 0.05)
    told = sensitivity(f, sd, names)
    np.testing.assert_allclose(told.widths, [1.0 / 3.0, 1.0, 3.0])
    assert np.isnan(told.g_prior).all()
    # the scale is known to 1/sqrt(2 n) = 1.1 %, which moves t^2/2 of a term at t by t^2 times as much
    exact = enumerate_models(Summary(f), ScalePrior(sd), scale_limit=10.0).inclusion
    assert np.abs(told.inclusion[1] - exact).max() < 0.01
    assert 0.01 < exact.min() < 0.5 < exact.max()


def test_changes_without_a_mount_are_those_of_refits_over_what_chance_allows():
    rng = np.random.default_rng(4)
    X, sd = rng.standard_normal((60, 2)), np.array([2.0, 3.0])
    y = X @ [0.5, -1.0] + rng.standard_normal(60)
    pieces = [dwells(np.split(np.column_stack((X, y)), 6), ("a", "b"), run="r")]
    mounts = {"r": (np.arange(6) + 0.5, np.array([1, 1, 2, 2, 3, 3]))}
    f = factor_of(X, y, ("a", "b"))
    found = without_parts(f, sd, pieces, mounts)
    assert found is not None
    assert found.parts == ("mount 1 of run r", "mount 2 of run r", "mount 3 of run r")

    def refitted(rows, scale):
        A = np.vstack((X[rows], scale * np.diag(1.0 / sd)))
        P = np.linalg.inv(A.T @ A)
        return P @ A.T @ np.concatenate((y[rows], np.zeros(2))), scale**2 * np.diag(P)

    scale = noise_scale(f, sd)
    mean, variance = refitted(np.arange(60), scale)
    for k in range(3):
        without = np.setdiff1d(np.arange(60), np.arange(20 * k, 20 * k + 20))
        other, more = refitted(without, scale)
        np.testing.assert_allclose(found.change[k], (other - mean) / np.sqrt(more - variance), rtol=1e-9)
    assert without_parts(f, sd, pieces, {}) is None


def decided_on(seed=0):
    rng = np.random.default_rng(seed)
    lib = library("accelerometer", powers=2, asymmetry=-1)
    X = rng.standard_normal((200, len(lib.names)))
    y = 3.0 * X[:, 0] + 0.05 * rng.standard_normal(200)
    summary = Summary(factor_of(X, y, lib.names), library=lib)
    return select(summary, ScalePrior(np.ones(len(lib.names)))), lib


def sparse_of(lib, frequency):
    zero = np.zeros(1)
    inclusion = dict.fromkeys(lib.names, frequency)
    return Sparse("stlsq", lib.names, (), inclusion, zero, zero[None], zero, 0, (), 0.9, 0.0)


@pytest.mark.parametrize(
    ("moved", "frequency", "verdict", "said"),
    [
        (0.5, 1.0, "needed", "sd from zero"),
        (-9.0, 1.0, "undecided", "but without run y it moves by 9.0 sd"),
        (0.5, 0.0, "undecided", "sparse regressions keep it in 0 % of resampled campaigns"),
    ],
)
def test_who_objects_leaves_the_term_open_and_is_named(moved, frequency, verdict, said):
    selection, lib = decided_on()
    change = np.zeros((2, len(lib.names)))
    change[1, 0] = moved
    told = combined(selection, LeftOut(("run x", "run y"), lib.names, change), [sparse_of(lib, frequency)])
    bias = told.terms[0]
    assert selection.terms[0].verdict == "needed"
    assert (bias.verdict, said in bias.reason) == (verdict, True)
    assert bias.voices is not None
    assert bias.voices[0] == "needed"
    assert abs(bias.voices.change) == abs(moved)
    assert combined(selection, None, []).terms == selection.terms
    assert replace(told, terms=selection.terms).model == selection.model
