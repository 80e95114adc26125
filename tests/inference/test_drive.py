"""What the inputs of a test were to a component."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import imubayes as ib
from imubayes.inference.linear import drive, linear_of
from imubayes.sensors.terms import columns

LIB = ib.library("accelerometer")
PLANS = ib.tumble(angles=8, dwell=2.0, rate=1.0), ib.centrifuge([1, 5], dwell=2.0, rate=1.0)


def test_drive_is_the_square_of_the_columns_over_all_samples_whatever_their_noise():
    runs = ib.simulate(ib.sensor("mems_tactical", kind="accelerometer"), PLANS, seed=1)
    f = drive([linear_of(run, LIB) for run in runs], LIB.names, LIB.names)
    X = np.vstack([columns(LIB, plan.inputs.channels, len(plan.inputs)) for plan in PLANS])
    assert f.n == len(X)
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(f.R[:-1, :-1].T @ f.R[:-1, :-1] / np.outer(size, size),
                               X.T @ X / np.outer(size, size), atol=1e-13)  # fmt: skip


def test_share_of_a_component_in_the_rows_of_a_case_does_not_count():
    runs = ib.simulate(ib.sensor("mems_tactical", kind="accelerometer"), PLANS[:1], seed=1)
    rows = linear_of(runs[0], LIB)
    share = np.random.default_rng(1).uniform(-1.0, 1.0, len(rows))
    share[3] = 0.0
    shared = replace(rows, columns=lambda a, b: share[a:b, None] * rows.columns(a, b))
    kept = np.delete(rows.columns(0, len(rows)), 3, axis=0)
    f = drive([shared], LIB.names, LIB.names)
    assert f.n == len(kept)
    np.testing.assert_allclose(f.column_norms, np.linalg.norm(kept, axis=0), rtol=1e-12)
