"""Right-hand sides of one factor: each component's factor is that of its own rows."""

import numpy as np
import pytest

from imubayes.algebra.factor import posterior, with_prior_rows
from imubayes.inference.linear import linear_of
from imubayes.inference.shared_columns import shared_rows
from imubayes.inference.whitened import whitened_factor
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.catalogue import coupled, sensor
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import library

MEMS = {kind: sensor("mems_tactical", kind=kind) for kind in ("accelerometer", "gyroscope")}
LIBRARIES = {
    name: coupled(
        library(kind_of(name), set="extended", temperature=1, temperature_of=("b0", "c_ij")),
        MEMS[kind_of(name)],
    )
    for name in COMPONENTS
}
"""An accelerometer's tie S_ik and s_j, S_jj and S_kk: a column of it is a sum of two products."""


@pytest.fixture(scope="module")
def run():
    rng = np.random.default_rng(1)
    n = 500
    names = [f"{quantity}_{axis}" for quantity in ("f", "w", "dw") for axis in "xyz"]
    channels = {name: rng.normal(size=n) for name in names} | {"T": 298.15 + rng.normal(size=n)}
    t = np.cumsum(rng.uniform(0.5, 1.5, n))
    return Run("run", "other", Inputs(t, channels, 1.0), rng.normal(size=(n, 6)))


@pytest.mark.parametrize("noise", [Noise(1.0, 0.0, 0.0), Noise(1.0, 0.3, 0.1)])
def test_factor_of_a_component_is_that_of_its_own_rows(run, noise):
    together = shared_rows([run], LIBRARIES)
    for name in COMPONENTS:
        (rows,) = together[name]
        shared, reach = whitened_factor(rows, noise)
        alone, own_reach = whitened_factor(linear_of(run.component(name), LIBRARIES[name]), noise)
        np.testing.assert_allclose(reach, own_reach, rtol=1e-14)
        assert (shared.n, shared.log_det) == (alone.n, pytest.approx(alone.log_det, rel=1e-12))
        sd = np.full(alone.p, 10.0)
        for one, other in zip(posterior(shared, sd), posterior(alone, sd), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
        left = [with_prior_rows(one.R, 1.0 / sd)[-1, -1] for one in (shared, alone)]
        assert abs(left[0]) == pytest.approx(abs(left[1]), rel=1e-10)
