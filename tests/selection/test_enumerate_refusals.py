"""What is asked of an enumeration and has no answer is refused, with what to do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imubayes.algebra.factor import Factor
from imubayes.errors import InputError, TermError, UnobservableError
from imubayes.inference.prior import HyperG, ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import enumerate_models

NAMES = ("a", "b", "c")


def _summary(n: int = 60) -> Summary:
    rng = np.random.default_rng(0)
    X = rng.normal(size=(n, 3))
    return Summary.from_arrays(X, X @ [3.0, 0.1, 0.3] + rng.normal(size=n), NAMES)


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, math.inf])
def test_a_noise_scale_that_is_no_scale_is_refused(scale):
    with pytest.raises(InputError, match=r"scale = .*: expected the sd of the noise, positive and finite"):
        enumerate_models(_summary(), ScalePrior(1.0), scale=scale)


@pytest.mark.parametrize("scale", [1e-320, 1e200])
def test_a_noise_scale_far_from_every_unit_of_the_response_is_refused(scale):
    with pytest.raises(InputError, match="in the units of the response, whose norm is about 1e1"):
        enumerate_models(_summary(), ScalePrior(1.0), scale=scale)


@pytest.mark.parametrize("limit", [-1.0, 0.0, 0.5, 1.0, math.nan])
def test_a_limit_of_the_noise_scale_below_the_scale_itself_is_refused(limit):
    with pytest.raises(InputError, match=r"scale_limit = .*: expected more than 1"):
        enumerate_models(_summary(), ScalePrior(1.0), scale_limit=limit)


@pytest.mark.parametrize(
    "options", [{"always": ["a", "a"]}, {"forced": ["a", "a"]}, {"forced": ["a"], "always": ["a"]}]
)
def test_a_term_that_is_held_twice_is_refused(options):
    with pytest.raises(TermError, match="'a' is there twice, expected each term once"):
        enumerate_models(_summary(), ScalePrior(1.0), **options)


@pytest.mark.parametrize(
    ("needs", "message"),
    [
        ([("a", "b"), ("b", "a")], "a needs b needs a: expected an end"),
        ([("a", "a")], "a needs a: expected an end"),
        ([("a", "b"), ("a", "c")], "'a' has two parents, expected one"),
    ],
)
def test_needs_without_an_end_or_with_two_parents_are_refused(needs, message):
    with pytest.raises(TermError, match=message):
        enumerate_models(_summary(), ScalePrior(1.0), needs=needs)


def test_a_need_that_is_told_twice_counts_once():
    once, twice = (
        enumerate_models(_summary(), ScalePrior(1.0), needs=[("b", "a")] * times) for times in (1, 2)
    )
    assert once.log_evidence == twice.log_evidence


def test_names_that_a_factor_repeats_are_refused():
    f = Factor(("a", "a"), np.eye(3), 10)
    with pytest.raises(InputError, match="'a' is there twice"):
        enumerate_models(Summary(f), ScalePrior(1.0))


@pytest.mark.parametrize("prior", [ScalePrior(1.0), HyperG(3.0)])
@pytest.mark.parametrize("copy", [0.0, 1.0])
def test_forced_columns_that_depend_on_each_other_are_refused(prior, copy):
    rng = np.random.default_rng(1)
    X = rng.normal(size=(60, 3))
    X[:, 1] = copy * X[:, 0]
    s = Summary.from_arrays(X, X[:, 0] + rng.normal(size=60), NAMES)
    with pytest.raises(UnobservableError, match="expected independent columns, but b is zero or") as caught:
        enumerate_models(s, prior, forced=["a", "b"])
    assert caught.value.terms == ("b",)


def test_no_more_rows_than_forced_columns_are_refused():
    with pytest.raises(UnobservableError, match="2 rows for 2 forced columns leave nothing"):
        enumerate_models(_summary(2), ScalePrior(1.0), forced=["a", "b"])


def test_a_response_that_the_forced_columns_explain_is_refused_under_a_g_prior():
    X = np.column_stack((np.ones(60), np.random.default_rng(2).normal(size=(60, 2))))
    with pytest.raises(UnobservableError, match="fit the response exactly"):
        enumerate_models(Summary.from_arrays(X, np.zeros(60), NAMES), HyperG(3.0), forced=["a"], scale=1.0)
