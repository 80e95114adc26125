"""Verdicts where errors of the test bench share a column with a term: the prior of the error decides."""

import math

import numpy as np
import pytest
from benches import measured

import imubayes as ib
from imubayes.algebra.factor import reorder
from imubayes.inference.nuisances import solve
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.summary import Summary
from imubayes.selection.decision import select
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import inclusion_given
from imubayes.sensors.catalogue import draw_unit

ARCSEC = math.pi / 648000.0
SENSOR = ib.sensor("mems_industrial", kind="accelerometer")
TUMBLE, ARM = ib.tumble(angles=24, rate=1.0), ib.centrifuge([1, 2, 5, 10, 20], rate=1.0)


def verdicts(plans, kinds, **given):
    """Verdicts on a unit of the class with the given coefficients, on a bench that is right."""
    lib = ib.library("accelerometer", powers=3, asymmetry=0)
    rng = np.random.default_rng(1)
    truth = {**draw_unit(SENSOR, lib, rng), **given}
    sd = class_sd(SENSOR, lib)
    summary, _ = solve(measured(SENSOR, plans, truth, {}, rng), lib, sd, kinds, sensor=SENSOR)
    chosen = ib.select(summary, ScalePrior([*sd, *(extra.sd for extra in summary.extras)]))
    return {term.name: term for term in chosen.terms}


@pytest.mark.parametrize("plans", [[TUMBLE], [TUMBLE, ARM]], ids=["tumble", "with-centrifuge"])
def test_a_misalignment_as_large_as_the_doubt_in_the_fixture_is_inseparable_from_it(plans):
    """Mounting faces as rough as the sensor's misalignment, 0.9 mrad in this class, tell nothing of it."""
    found = verdicts(plans, {"fixture_common": 1e-3}, m_j=1e-3, m_k=-8e-4)
    for name, partner in (("m_j", "fixture_common_k"), ("m_k", "fixture_common_j")):
        assert found[name].verdict == "inseparable"
        assert found[name].confounded_with == (partner,)
        assert "turned over in its fixture" in found[name].reason
        # the sum is known and nothing else: the two priors share it out
        assert found[name].full_sd == pytest.approx(1.0 / math.hypot(1 / 9e-4, 1 / 1e-3), rel=0.05)
    if ARM in plans:
        assert found["b1"].verdict == found["b3"].verdict == "needed"


def test_a_misalignment_beyond_the_doubt_in_the_fixture_is_needed():
    found = verdicts([TUMBLE, ARM], {"fixture_common": 2.0 * ARCSEC}, m_j=1e-3, m_k=-8e-4)
    for name, value in (("m_j", 1e-3), ("m_k", -8e-4)):
        assert found[name].verdict == "needed"
        assert abs(found[name].mean - value) < 4.0 * found[name].sd
        assert found[name].sd == pytest.approx(2.0 * ARCSEC, rel=0.1)


@pytest.mark.parametrize(("doubt", "verdict"), [(1e-3 * 9.80665, "inseparable"), (1e-6 * 9.80665, "needed")])
def test_a_scale_factor_is_as_sure_as_local_gravity(doubt, verdict):
    found = verdicts([TUMBLE], {"gravity": doubt}, b1=1.2e-3, b3=0.0)
    assert found["b1"].verdict == verdict
    assert found["m_j"].verdict == "needed"
    if verdict == "inseparable":
        assert found["b1"].confounded_with == ("gravity",)
        assert found["b1"].reason.endswith("a survey of local gravity would separate them")


def test_width_of_the_prior_is_that_of_the_terms_and_not_of_the_bench():
    """Gravity known to 1e-3 leaves b1 that much, however wide b1's own prior is."""
    sensor, lib = ib.sensor("mems_tactical", kind="accelerometer"), ib.library("accelerometer", powers=1)
    runs = ib.simulate(sensor, [ib.tumble(angles=12, dwell=5.0)], seed=1, truth={"b1": 3e-4})
    prior = ib.prior(sensor, lib)
    summary, _ = solve(runs, lib, prior.sd, {"gravity": 1e-3}, sensor=sensor)
    whole = ScalePrior([*prior.sd, 1e-3])
    selection = select(summary, whole)
    wide = dict(selection.by_width)[3.0]
    by_hand = enumerate_models(
        Summary(reorder(summary.factor, selection.models.candidates.columns)),
        ScalePrior(
            [
                3.0 * whole.sd[summary.names.index(n)] if n != "gravity" else 1e-3
                for n in selection.models.candidates.columns
            ]
        ),
        always=("gravity",),
        scale_limit=10.0,
    )
    np.testing.assert_allclose(wide, inclusion_given(by_hand, ()), rtol=1e-9)
