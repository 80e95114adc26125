from dataclasses import replace

import numpy as np
import pytest
from lot_studies import shaken, small

from imubayes.campaign.study import Mission
from imubayes.population.lots import basic_left, exposures, missions
from imubayes.population.records import Record
from imubayes.scenes.propagation import Budget
from imubayes.scenes.relevance import exposure
from imubayes.sensors.terms import columns

STUDY = small()
LIB = STUDY.library


def unit(theta, number=0, scatter=0.0) -> Record:
    """A unit whose test says the truth, but for a scatter of the draws."""
    p = len(theta)
    noise = scatter * np.random.default_rng(number).standard_normal((200, p))
    draws, ones = theta + noise * np.abs(theta), np.ones(p)
    return Record(
        number,
        "any",
        theta,
        ones,
        theta,
        ones,
        ones,
        ("needed",) * p,
        (1e-4, 0.0, 0.0),
        1,
        np.eye(p + 1),
        theta,
        draws,
    )


def weighed(units, study=STUDY):
    exposed = exposures(study.missions, study.library)
    return missions(units, study.missions, exposed, basic=study.basic)


def outputs(scene) -> np.ndarray:
    inputs = scene.inputs
    return columns(LIB, inputs.channels, len(inputs))


def test_shares_are_medians_of_the_rms_effect_over_the_budget():
    thetas = [np.full(len(LIB.terms), size) for size in (1e-5, 4e-5, 2e-5)]
    (found,) = weighed([unit(theta, k) for k, theta in enumerate(thetas)])
    rms = 2e-5 * np.sqrt(np.mean(outputs(STUDY.missions[0].scene) ** 2, axis=0))
    for term, expected in zip(found.terms, rms, strict=True):
        assert term.rms == pytest.approx(expected, rel=1e-9)
        assert term.share.value == pytest.approx(expected / 1e-3, rel=1e-9)
        assert term.true_share == pytest.approx(term.share.value, rel=1e-9)


def test_a_term_is_required_in_the_units_where_nothing_else_keeps_the_budget():
    large, small_one = np.zeros(len(LIB.terms)), np.zeros(len(LIB.terms))
    large[LIB.names.index("b0")], small_one[LIB.names.index("b0")] = 5e-3, 1e-4
    (found,) = weighed([unit(large), unit(small_one), unit(large), unit(large)])
    required = {term.name: term.required for term in found.terms}
    assert required.pop("b0") == 0.75
    assert set(required.values()) == {0.0}
    assert (found.order.value, found.within) == (1.0, 1.0)
    assert found.noise_share == pytest.approx(1e-4 / 1e-3)


def test_a_calibration_that_leaves_too_much_is_not_within_the_budget():
    theta = np.zeros(len(LIB.terms))
    theta[0] = 0.1
    (found,) = weighed([unit(theta, 0, 0.5), unit(theta, 1)])
    assert found.within == 0.5


def test_what_the_basic_triad_leaves_is_the_residual_of_least_squares_over_the_scene():
    theta = np.random.default_rng(5).standard_normal(len(LIB.terms))
    scene = shaken()
    X = outputs(scene)
    basic = X[:, [LIB.names.index(name) for name in ("b0", "b1", "m_j", "m_k")]]
    y = X @ theta
    left = y - basic @ np.linalg.lstsq(basic, y, rcond=None)[0]
    seen = exposure(scene, LIB, Budget("output", 1.0))
    assert basic_left(seen, theta[None]) == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)


def test_the_basic_triad_serves_a_scene_at_rest_entirely():
    """All that any term does at rest is a bias; scale and misalignment cannot be told from it."""
    seen = exposure(shaken(still=True), LIB, Budget("output", 1.0), axis="z")
    ones = np.ones(len(LIB.terms))
    assert basic_left(seen, ones[None]) < 1e-12


def test_what_the_test_does_not_know_of_the_triad_itself_is_not_held_against_it():
    """A bias known to 0.01 m/s^2 leaves nothing that the larger model would not; a b2 is its own."""
    seen = exposure(shaken(), LIB, Budget("output", 1.0), axis="z")
    draws = np.zeros((4_000, len(LIB.terms)))
    draws[:, LIB.names.index("b0")] = 0.01 * np.random.default_rng(2).standard_normal(4_000)
    assert basic_left(seen, draws) < 1e-12
    draws[:, LIB.names.index("b2")] = 1e-6
    assert basic_left(seen, draws) > 1e-6


def test_basic_share_is_not_a_number_where_it_is_not_asked():
    (found,) = weighed([unit(np.zeros(len(LIB.terms)))], replace(STUDY, basic=False))
    assert np.isnan(found.basic_share)


def test_input_axis_of_a_mission_decides_which_component_is_weighed():
    up, level = (
        replace(STUDY, missions=(Mission("rest", shaken(still=True), Budget("output", 1.0), axis=axis),))
        for axis in ("z", "x")
    )
    theta = np.ones(len(LIB.terms))
    scale = LIB.names.index("b1")
    assert weighed([unit(theta)], up)[0].terms[scale].rms == pytest.approx(9.8)
    assert weighed([unit(theta)], level)[0].terms[scale].rms == 0.0
