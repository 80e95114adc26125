"""What errors of the test bench hide: the terms, in words with a remedy, and the published claims."""

import numpy as np
import pytest
from observed import observed

import imubayes as ib
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import Plan
from imubayes.rig.reference import KINDS

SERVO, FOG = "quartz_flexure_servo", "fog_navigation"
TUMBLE = ib.tumble(angles=24, rate=1.0)
PLANE = ib.tumble(angles=24, planes=1, rate=1.0)
ARM = ib.centrifuge([1, 2, 5, 10, 20], rate=1.0)
FLAT = ib.centrifuge([1, 2, 5, 10, 20], mounts=8, rate=1.0)
OUTWARD = ib.centrifuge([1, 2, 5, 10, 20], mounts=1, rate=1.0)
TABLE = ib.rate_table(np.radians([-200, -50, -10, 10, 50, 200]), rate=1.0)
T = np.arange(4000) / 100.0
SWING = Plan(
    "swing",
    "oscillation",
    Inputs(T, {"w_i": np.sin(2.0 * T), "dw_i": 2.0 * np.cos(2.0 * T), "f_i": np.full(4000, 9.8)}, 0.01),
)


FIXTURE = "rotation of the case in its fixture"
HIDDEN = [
    (SERVO, [TUMBLE], {"gravity": 1e-3}, ("b1", "gravity"), "error of local gravity", "a survey of local"),
    (SERVO, [FLAT], {"radius": 50e-6}, ("b1", "radius"), "error of the arm's radius", "tumble"),
    (SERVO, [TUMBLE, FLAT], {"radius": 50e-6, "gravity": 1e-3}, ("b1", "radius", "gravity"),
     "error of local gravity and the error of the arm's radius act on the output as b1 does", "survey"),
    (SERVO, [OUTWARD], {"arm_stretch": 1e-7}, ("b2", "arm_stretch"), "stretch of the arm", "under load"),
    (SERVO, [TUMBLE], {"turn_on": 1e-3}, ("b0", "turn_on.tumble"), "turned on", "turned off before each"),
    (SERVO, [TUMBLE, ARM], {"turn_on": 1e-3}, ("b0", "turn_on.tumble", "turn_on.centrifuge"),
     "turned on", "turned off before each"),
    (SERVO, [PLANE], {"plane_zero": 1e-5}, ("m_j", "plane_zero.tumble.0"), "tumble's table", "three planes"),
    (SERVO, [PLANE], {"table_zero": 1e-5}, ("m_j", "table_zero"), "common zero", "three planes"),
    (SERVO, [TUMBLE, ARM], {"fixture_common": 1e-4}, ("m_j", "fixture_common_k"), FIXTURE, "turned over"),
    (SERVO, [TUMBLE, ARM], {"fixture_common": 1e-4}, ("m_k", "fixture_common_j"), FIXTURE, "turned over"),
    (FOG, [TABLE], {"fixture_common": 1e-4}, ("m_j", "fixture_common_k"), FIXTURE, "turned over"),
    (FOG, [TABLE], {"rate_scale": 5e-6}, ("b1", "rate_scale.rate-table"), "scale error", "whole turns"),
    (FOG, [SWING], {"latency": 1e-3}, ("s_i", "latency"), "latency", "one clock for rig and sensor"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("class_id", "plans", "kinds", "terms", "reason", "remedy"),
    HIDDEN,
    ids=lambda v: getattr(v, "name", None),
)
def test_what_an_error_of_the_bench_hides_is_told_with_a_remedy(
    class_id, plans, kinds, terms, reason, remedy
):
    seen, _ = observed(class_id, plans, kinds, set="extended" if class_id == FOG else "slide")
    (group,) = [group for group in seen.groups if set(group.terms) == set(terms)]
    assert group.exact and group.seen == pytest.approx(1.0, abs=1e-6)
    assert reason in group.reason and remedy in group.remedy
    assert group.remedy.endswith("would separate them")
    assert set(terms) <= {terms[0], *seen.partners(terms[0])}


def test_every_kind_of_error_has_a_case_here():
    told = {kind for _, _, kinds, *_ in HIDDEN for kind in kinds}
    assert told == KINDS.keys() - {"fixture", "earth_rate"}  # which a turntable shows


def test_a_rotation_in_each_mount_is_told_with_each_term_that_it_hides():
    seen, _ = observed(SERVO, [TUMBLE, ARM], {"fixture": 1e-4})
    for term, axis in (("m_j", "k"), ("m_k", "j")):
        (group,) = [group for group in seen.groups if term in group.terms and group.exact]
        others = [name for name in group.terms if name != term]
        # every mount in which the axis across is ever excited takes part
        assert all(name.startswith(f"fixture_{axis}.") for name in others)
        assert len(others) > 10
        # and what hides two terms does not make them partners
        assert seen.partners(term) == tuple(name for name in seen.names if name in others)


def test_gravity_is_told_from_the_scale_factor_by_a_centrifuge():
    seen, _ = observed(SERVO, [TUMBLE, ARM], {"gravity": 1e-2})
    assert "gravity" not in seen.partners("b1")
