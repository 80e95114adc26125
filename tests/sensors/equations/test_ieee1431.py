"""IEEE 1431: the scale-factor error multiplies, and the product is multiplied out."""

import numpy as np
import pytest

from imubayes.sensors.equations import ieee952
from imubayes.sensors.equations.ieee1431 import STANDARD, VibratoryGyro, indicated, to_general
from imubayes.sensors.terms import REFERENCE_TEMPERATURE, library


def test_trap_scale_factor_error_has_the_opposite_sign_of_ieee_952():
    assert to_general(VibratoryGyro(eps_K=1e-4))["b1"] == 1e-4
    assert ieee952.to_general(ieee952.FiberOpticGyro(eps_K=1e-4))["b1"] < 0.0
    warm = {"w_i": np.array([1.0]), "T": np.array([REFERENCE_TEMPERATURE + 10.0])}
    assert indicated(VibratoryGyro(eps_T=1e-4), warm, 1)[0] == pytest.approx(1.001, rel=1e-13)


def test_terms_that_follow_from_the_others_are_not_counted_as_missing_in_the_standard():
    lib = library("gyroscope", powers=1, asymmetry=-1, temperature=2, temperature_of=("b0", "m_j"))
    assert "b0*T2" not in STANDARD.general_only(lib)
    assert "m_j*T2" in STANDARD.general_only(lib)
