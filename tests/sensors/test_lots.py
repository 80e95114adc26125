"""Lots: the population is what it is said to be, and the units are drawn from it."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from imubayes.rig.simulate import library_of
from imubayes.sensors.catalogue import classes, draw_unit, prior_root, prior_sd, sensor
from imubayes.sensors.lots import NOISE_SPREAD, TRIMMED, draw_lot, magnitude
from imubayes.sensors.terms import columns, library

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")

TACTICAL = sensor("mems_tactical", kind="accelerometer")
LIB = library("accelerometer")
NUMBER = 1500


def _single(entry):
    """Narrow a class to its typical figures: every lot has the same magnitudes."""
    figures = {key: (typical or high / 10.0,) * 3 for key, (_, typical, high) in entry.coefficients.items()}
    noise = {key: (typical,) * 3 for key, (_, typical, _) in entry.noise.items()}
    return replace(entry, coefficients=figures, noise=noise)


def _mean_is(values, expected, sd):
    return abs(np.mean(values) - expected) < 4.0 * sd / math.sqrt(len(values))


def test_units_of_a_lot_have_the_mean_and_the_spread_of_its_population():
    lot = draw_lot(TACTICAL, LIB, NUMBER, np.random.default_rng(2))
    scaled = (lot.theta - lot.mean) / lot.sd
    for column in scaled.T:
        assert _mean_is(column, 0.0, 1.0)
        assert _mean_is(column**2, 1.0, math.sqrt(2.0))
    root = prior_root(TACTICAL, LIB)
    coupled = np.abs(root @ root.T) > 0.0
    across = np.where(coupled, 0.0, scaled.T @ scaled / NUMBER)
    assert np.abs(across[np.triu_indices(len(LIB.names), 1)]).max() < 5.0 / math.sqrt(NUMBER)


@pytest.mark.parametrize("entry", classes("accelerometer"), ids=lambda entry: entry.id)
def test_units_feel_a_lever_arm_as_the_motion_of_their_sensing_point(entry):
    """S and s without what else they hold give ``w x (w x r) + dw x r`` along i, for a unit and for a lot."""
    without = dict.fromkeys(("Kspin", "Kaa"), (1e-30, 1e-30, 1e-30))
    entry = replace(entry, coefficients={**entry.coefficients, **without})
    lib, rng = library("accelerometer", set="extended"), np.random.default_rng(8)
    lot = draw_lot(entry, lib, 2, rng)
    shared = dict(zip(lib.names, lot.mean.tolist(), strict=True))
    for unit in (draw_unit(entry, lib, rng), lot.truth(0), lot.truth(1), shared):
        r = np.array([-unit["S_jj"], unit["S_ij"], unit["S_ik"]])
        assert np.linalg.norm(r) > 0.0
        moved = {"w": rng.normal(size=3), "dw": rng.normal(size=3)}
        w, dw = moved["w"], moved["dw"]
        felt = (np.cross(w, np.cross(w, r)) + np.cross(dw, r))[0]
        driven = {name: value for name, value in unit.items() if name[0] in "sS"}
        channels = {f"{name}_{axis}": moved[name][[k]] for name in moved for k, axis in enumerate("ijk")}
        X = columns(library_of("accelerometer", driven), channels, 1)[0]
        found = X @ [driven[name] for name in library_of("accelerometer", driven).names]
        assert found == pytest.approx(felt, rel=1e-9)


def test_a_pendulous_unit_breaks_the_couplings_of_its_lever_arm_by_kspin_and_kang_only():
    """S_ij + s_k is Kspin + Kang: its spread over units is theirs, whatever the arm is."""
    entry, lib = sensor("quartz_flexure_servo", kind="accelerometer"), library("accelerometer")
    rng = np.random.default_rng(9)
    units = [draw_unit(entry, lib, rng) for _ in range(NUMBER)]
    assert all(unit["S_ik"] == unit["s_j"] for unit in units)
    size = math.hypot(entry.coefficients["Kspin"][1], entry.coefficients["Kaa"][1])
    left = np.array([unit["S_ij"] + unit["s_k"] for unit in units]) / size
    assert _mean_is(left, 0.0, 1.0) and _mean_is(left**2, 1.0, math.sqrt(2.0))


@every_class
def test_root_of_the_prior_has_the_sd_of_every_term(entry):
    lib = library(entry.kind, set="extended", temperature=2, temperature_of=("b0", "S_ik", "S_ij"))
    sizes = [prior_sd(entry, term)[0] for term in lib.terms]
    np.testing.assert_allclose(np.linalg.norm(prior_root(entry, lib), axis=1), sizes, rtol=1e-12)


def test_shared_part_and_spread_add_up_to_the_prior_of_the_class():
    entry, rng = _single(TACTICAL), np.random.default_rng(3)
    lots = [draw_lot(entry, LIB, 1, rng) for _ in range(NUMBER)]
    for j, term in enumerate(LIB.terms):
        size = prior_sd(entry, term)[0]
        shared = 0.1 if term.name in TRIMMED else 0.5
        means = np.array([lot.mean[j] for lot in lots]) / size
        units = np.array([lot.theta[0, j] for lot in lots]) / size
        assert _mean_is(means**2, shared, shared * math.sqrt(2.0))
        assert lots[0].sd[j] ** 2 == pytest.approx((1.0 - shared) * size**2, rel=1e-12)
        assert _mean_is(units, 0.0, 1.0) and _mean_is(units**2, 1.0, math.sqrt(2.0))


@pytest.mark.parametrize("values", [(1.0, 2.0, 40.0), (1e-6, 5e-6, 6e-6), (0.0, 2.0, 40.0), (0.0, 0.0, 40.0)])
def test_magnitudes_fill_the_range_of_the_class_with_the_typical_one_in_the_middle(values):
    rng = np.random.default_rng(4)
    drawn = np.sort([magnitude(values, rng) for _ in range(NUMBER)])
    low, typical, high = values
    typical = typical or high / 10.0
    low = low or typical / (high / typical)  # as far below as the highest is above
    assert low <= drawn[0] and drawn[-1] <= high
    assert _mean_is(drawn < typical, 0.5, 0.5)
    # cut normal: below z it has (Phi(z) - 0.05) / 0.9, and z = 1 is this far on the way from typical to high
    z, point = 1.0, 1.6448536269514722
    expected = (NormalDist().cdf(z) - 0.05) / 0.9
    spread = math.sqrt(expected * (1.0 - expected))
    assert _mean_is(drawn < typical * (high / typical) ** (z / point), expected, spread)
    assert _mean_is(drawn > typical * (low / typical) ** (z / point), expected, spread)


def test_noise_of_units_scatters_log_normally_about_the_lots():
    lot = draw_lot(TACTICAL, LIB, NUMBER, np.random.default_rng(6))
    for name, spread in NOISE_SPREAD.items():
        low, _, high = TACTICAL.noise[name]
        middle = getattr(lot.typical_noise, name)
        assert low <= middle <= high
        logs = np.log([getattr(noise, name) / middle for noise in lot.noise])
        assert _mean_is(logs, 0.0, spread) and _mean_is(logs**2, spread**2, math.sqrt(2.0) * spread**2)
