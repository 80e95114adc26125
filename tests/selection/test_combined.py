"""Families that object to the evidence: parts left out against refits, and the rule on verdicts."""

from dataclasses import replace

import numpy as np
import pytest
from decisions import dwells

from imubayes.algebra.factor import factor_of, noise_scale
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import select
from imubayes.selection.sensitivity import LeftOut, combined, without_parts
from imubayes.selection.sindy import Sparse
from imubayes.sensors.terms import library


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
