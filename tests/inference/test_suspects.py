"""First suspects: outliers are found before the noise is known, and clean dwells mostly are not."""

from dataclasses import replace

import numpy as np
import pytest

import imubayes as ib
from imubayes.inference.contamination import WIDE, first_suspects
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import class_sd

SERVO = ib.sensor("quartz_flexure_servo", kind="accelerometer")
LIBRARY = ib.library("accelerometer")
PRIOR = class_sd(SERVO, LIBRARY)
SD = 3e-5
"""m/s^2; noise of a dwell mean of the class's typical sensor, its neighbours known."""


def tumble(seed, offsets=(), ringing=()):
    (run,) = ib.simulate(SERVO, [ib.tumble(angles=24, planes=3, rate=1.0)], seed=seed)
    output = run.output.copy()
    for dwell, size in offsets:
        output[30 * dwell : 30 * dwell + 30] += size
    for dwell in ringing:
        output[30 * dwell + 10 : 30 * dwell + 20] += 1e3 * SD * np.tile([1.0, -1.0], 5)
    return replace(run, output=output)


def suspects(run):
    rows = linear_of(run, LIBRARY)
    return first_suspects([rows], [dwells_of(rows)], PRIOR)


@pytest.mark.parametrize("seed", range(3))
def test_gross_offsets_are_suspected_whatever_else_is(seed):
    rng = np.random.default_rng(seed)
    off = rng.choice(72, 14, replace=False)
    sizes = SD * rng.choice([-1.0, 1.0], 14) * np.exp(rng.uniform(np.log(100.0), np.log(1000.0), 14))
    found, tau = suspects(tumble(seed, tuple(zip(off, sizes, strict=True))))
    assert np.all(found[off])
    assert np.count_nonzero(found) <= 20
    assert np.all(tau >= np.abs(sizes).max() * 0.9)


def test_ringing_that_leaves_the_mean_alone_is_suspected():
    found, _ = suspects(tumble(1, ringing=(5, 40)))
    assert np.all(found[[5, 40]])


def test_few_clean_dwells_are_suspected_and_offsets_may_be_gross():
    shares = []
    for seed in range(10):
        found, tau = suspects(tumble(seed))
        shares.append(found.mean())
        # the robust sd of 72 means is right to 1.17/sqrt(72), and slow noise only adds to it
        assert np.all(tau > 0.4 * WIDE * SD)
    # twice 4 sd of 72 normal numbers with an estimated scale would be 0.1 %; drift has heavier tails
    assert np.mean(shares) < 0.03


def test_never_more_than_half_of_a_run_is_suspected():
    rng = np.random.default_rng(2)
    run = tumble(2, tuple(enumerate(3e3 * SD * rng.normal(size=72))))
    assert np.count_nonzero(suspects(run)[0]) <= 36


def test_output_without_any_noise_suspects_nothing():
    run = tumble(1)
    found, tau = suspects(replace(run, output=run.inputs.channels["f_i"].copy()))
    assert not found.any()
    assert np.all(np.isfinite(tau) & (tau > 0.0))
