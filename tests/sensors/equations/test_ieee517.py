"""IEEE 517: the drift of a floated gyro, term by term."""

import numpy as np
import pytest

from imubayes.sensors.equations.ieee517 import RateIntegratingGyro, drift, indicated, to_general


def test_drift_is_the_quadratic_form_of_the_acceleration():
    rng = np.random.default_rng(1)
    F, I, S, O, II, SS, OO, IS, IO, OS = rng.normal(size=10)  # noqa: E741 - the standard's indices
    p = RateIntegratingGyro(D_F=F, D_I=I, D_S=S, D_O=O, D_II=II, D_SS=SS, D_OO=OO, D_IS=IS, D_IO=IO, D_OS=OS)
    a = rng.normal(size=(20, 3))
    form = np.array([[II, IS / 2, IO / 2], [IS / 2, SS, OS / 2], [IO / 2, OS / 2, OO]])
    expected = F + a @ [I, S, O] + np.einsum("ra,ab,rb->r", a, form, a)
    channels = {f"f_{axis}": a[:, n] for n, axis in enumerate("ijk")}
    np.testing.assert_allclose(drift(p, channels, 20), expected, rtol=1e-12, atol=1e-13)


def test_trap_angle_about_the_spin_axis_has_the_minus_sign():
    rate = indicated(RateIntegratingGyro(a_S=1e-3), {"w_k": np.array([1.0])}, 1)[0]
    assert rate == pytest.approx(-1e-3, rel=1e-15)
    assert to_general(RateIntegratingGyro(a_S=1e-3))["m_k"] == -1e-3
