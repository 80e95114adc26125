"""Figures of the catalogue, and the priors made of them."""

import math
import tomllib
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from imubayes.errors import TermError
from imubayes.sensors.catalogue import (
    classes,
    draw_unit,
    prior_sd,
    reference_errors,
    sensor,
    terms_of,
)
from imubayes.sensors.noise import noise_prior
from imubayes.sensors.terms import Library, Term, library
from imubayes.units import factor

G = 9.80665
DEG = math.pi / 180.0
ULPS = 1e-14
"""A few multiplications of conversion factors."""

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")


def _term(kind: str, name: str) -> Term:
    heated = ("b0", "b1", "m_j")
    options = {"powers": 6, "asymmetry": 5, "set": "extended", "temperature": 2}
    lib = library(kind, **options, temperature_of=heated, rate_of=heated)
    return lib.terms[lib.names.index(name)]


def _sd(id: str, kind: str, name: str) -> float:
    return prior_sd(sensor(id, kind=kind), _term(kind, name))[0]


@every_class
def test_every_term_of_the_extended_library_has_a_finite_positive_prior(entry):
    names = library(entry.kind, powers=6, asymmetry=5, set="extended").names
    lib = library(
        entry.kind, powers=6, asymmetry=5, set="extended", temperature=2, temperature_of=names, rate_of=names
    )
    for term in lib.terms:
        sd, origin = prior_sd(entry, term)
        assert 0.0 < sd < math.inf, term.name
        assert origin


@every_class
def test_figures_rise_from_low_to_high_and_noise_is_never_zero(entry):
    for key, (low, typical, high) in {**entry.coefficients, **entry.noise}.items():
        assert 0.0 <= low <= typical <= high, key
        assert high > 0.0, key
    assert min(low for low, _, _ in entry.noise.values()) > 0.0
    assert entry.temperature[0] < entry.temperature[1]


@every_class
def test_a_bias_of_the_class_stays_inside_its_full_scale(entry):
    assert prior_sd(entry, _term(entry.kind, "b0"))[0] < entry.full_scale / 10.0


SI_UNITS = {
    "accelerometer": {
        "K0": "m/s^2", "Q": "m/s^2", "s": "1", "K0p": "m/s^2", "K1p": "1", "K2": "(m/s^2)^-1",
        "Koq": "(m/s^2)^-1",
        "K3": "(m/s^2)^-2", "mis": "rad", "Kx": "(m/s^2)^-1", "Kxx": "(m/s^2)^-1", "vre": "(m/s^2)^-1",
        "Kspin": "m/s^2/(rad/s)^2", "Kaa": "m/s^2/(rad/s^2)", "lever": "m", "T0": "m/s^2/K", "T1": "1/K",
        "N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^2/sqrt(s)",
    },
    "gyroscope": {
        "b0": "rad/s", "Qang": "rad", "s": "1", "sasym": "1", "b0p": "rad/s", "nl2": "(rad/s)^-1",
        "nl3": "(rad/s)^-2",
        "mis": "rad", "crate": "(rad/s)^-1", "g1": "rad/s/(m/s^2)", "g2": "rad/s/(m/s^2)^2",
        "vre": "rad/s/(m/s^2)^2", "aa": "rad/s/(rad/s^2)", "T0": "rad/s/K", "T1": "1/K",
        "Tdot": "rad/s/(K/s)",
        "mag": "rad/s/T", "lockin": "rad/s", "dither_amp": "rad", "dither": "Hz",
        "N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s/sqrt(s)",
    },
}  # fmt: skip


@every_class
def test_every_figure_is_in_a_unit_of_what_it_measures(entry):
    text = files("imubayes.sensors").joinpath("grades.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)[entry.kind][entry.id]
    assert set(table["source"]) <= {"datasheet", "second_hand", "order_of_magnitude"}
    figures = {**table["coefficients"], **table["noise"]}
    for key, (*values, unit) in figures.items():
        name, share = ("B", math.sqrt(2.0 * math.log(2.0) / math.pi)) if key == "floor" else (key, 1.0)
        loaded = share * np.array({**entry.coefficients, **entry.noise}[name])
        expected = np.array(values) * factor(unit, like=SI_UNITS[entry.kind][name])
        np.testing.assert_allclose(loaded, expected, rtol=ULPS, err_msg=key)


@pytest.mark.parametrize(
    ("id", "kind", "name", "sd"),
    [
        ("mems_tactical", "accelerometer", "b0", 1500e-6 * G),
        ("mems_tactical", "accelerometer", "b0p", 5e-6 * G / 2.0),
        ("mems_tactical", "accelerometer", "b1p", 80e-6 / 2.0),
        ("mems_tactical", "accelerometer", "b2", 30e-6 / G),
        ("mems_tactical", "accelerometer", "b2p", 15e-6 / G),
        ("mems_tactical", "accelerometer", "b3", 2e-6 / G**2),
        ("mems_tactical", "accelerometer", "b5", 2e-6 / G**2 / 3.0 / (20.0 * G) ** 2),
        ("mems_tactical", "accelerometer", "S_ij", math.hypot(0.5e-6 * G, 0.5e-3)),
        ("mems_tactical", "accelerometer", "S_ik", 0.5e-3),
        ("mems_tactical", "accelerometer", "S_jk", 0.5e-6 * G),
        ("mems_tactical", "accelerometer", "s_k", math.hypot(1e-6 * G, 0.5e-3)),
        ("mems_tactical", "accelerometer", "b0*T", 30e-6 * G),
        ("mems_tactical", "accelerometer", "b1*T2", 15e-6 / 69.5),
        ("mems_tactical", "accelerometer", "b0*dT", 30e-6 * G * 60.0),
        ("mems_tactical", "accelerometer", "b1*dT", 15e-6 * 60.0),
        ("mems_tactical", "accelerometer", "m_j*dT", 400e-6 * 1e-3 * 60.0),
        ("mems_tactical", "accelerometer", "m_j*T2", 400e-6 * 1e-6),
        ("fog_tactical", "gyroscope", "b0", DEG / 3600.0),
        ("fog_tactical", "gyroscope", "b0p", 0.05 * DEG / 3600.0),
        ("fog_tactical", "gyroscope", "b1p", 20e-6 / 2.0),
        ("fog_tactical", "gyroscope", "b2", 0.2e-6 / DEG),
        ("fog_tactical", "gyroscope", "b3", 1e-4 * 1e-6 / DEG**2),
        ("fog_tactical", "gyroscope", "c_jk", 0.001e-6 / DEG),
        ("fog_tactical", "gyroscope", "g_k", 0.05 * DEG / 3600.0 / G),
        ("fog_tactical", "gyroscope", "S_ij", 0.005 * DEG / 3600.0 / G**2),
        (
            "fog_tactical",
            "gyroscope",
            "s_i",
            0.001 / 10.0 / 3600.0,
        ),  # typical is zero: a tenth of the highest
        ("fog_tactical", "gyroscope", "b0*dT", 1.0 * DEG / 3600.0 * 60.0),
    ],
)
def test_prior_is_the_typical_figure_in_si(id, kind, name, sd):
    assert _sd(id, kind, name) == pytest.approx(sd, rel=ULPS)


def test_assumed_priors_say_that_they_are_assumed():
    entry = sensor("mems_tactical", kind="gyroscope")
    for name in ("b2p", "b4", "b3p", "b0*T2", "m_j*T", "b0*dT", "b1*dT", "m_j*dT"):
        assert prior_sd(entry, _term("gyroscope", name))[1].startswith("assumed: "), name
    assert prior_sd(entry, _term("gyroscope", "b1p"))[1] == "half of the typical sasym"


def test_typical_figures_are_those_of_published_data_sheets():
    # MPU-6050: 0.005 deg/s/sqrt(Hz) and 0.1 deg/s/g; ADIS16460: 0.01 deg/s/g;
    # HG1700: 1 deg/h, 0.125 deg/sqrt(h)
    consumer, industrial = (sensor(id, kind="gyroscope") for id in ("mems_consumer", "mems_industrial"))
    assert consumer.noise["N"][1] == pytest.approx(0.005 * DEG, rel=ULPS)
    assert consumer.coefficients["g1"][2] == pytest.approx(0.1 * DEG / G, rel=ULPS)
    assert industrial.coefficients["g1"][1] == pytest.approx(0.01 * DEG / G, rel=ULPS)
    laser = sensor("rlg_tactical", kind="gyroscope")
    assert laser.coefficients["b0"][1] == pytest.approx(4.848e-6, rel=1e-4)
    assert laser.noise["N"][1] == pytest.approx(0.125 * 2.909e-4, rel=1e-4)


@every_class
def test_noise_prior_puts_five_percent_below_low_and_above_high(entry):
    for (median, sd), (low, typical, high) in zip(noise_prior(entry), entry.noise.values(), strict=True):
        assert median == typical
        # the spread is that of the whole range: P(low < x < high) of a log-normal centred in it is 90 %
        centre = math.sqrt(low * high)
        below = 0.5 * math.erfc(math.log(centre / low) / sd / math.sqrt(2.0))
        assert below == pytest.approx(0.05, abs=1e-12)


def test_random_units_spread_like_their_prior():
    entry, lib = sensor("mems_industrial", kind="accelerometer"), library("accelerometer")
    rng, number = np.random.default_rng(5), 2000
    units = [draw_unit(entry, lib, rng) for _ in range(number)]
    for term in lib.terms:
        scaled = np.array([unit[term.name] for unit in units]) / prior_sd(entry, term)[0]
        assert abs(scaled.mean()) < 4.0 / math.sqrt(number)
        assert abs((scaled**2).mean() - 1.0) < 4.0 * math.sqrt(2.0 / number)


ARCSEC = DEG / 3600.0

REFERENCE = {
    "index_table": 2.0 * ARCSEC, "table_orthogonality": 3.0 * ARCSEC, "level_tilt": 2.0 * ARCSEC,
    "fixture_mount": 20.0 * ARCSEC, "gravity": 1e-6 * G, "north_azimuth": 30.0 * ARCSEC,
    "rate_accuracy": 5e-6, "rate_stability": 1e-6, "centrifuge_radius": 50e-6, "centrifuge_rate": 5e-6,
    "centrifuge_arm_stretch": 1e-6 / G, "centrifuge_subtable": 60.0 * ARCSEC, "chamber": 0.1,
    "seismic_floor": 3e-6 * G, "shaker_acceleration": 5e-3,
}  # fmt: skip


def test_errors_of_test_equipment_rise_from_low_to_high_and_are_typical_in_si():
    found = reference_errors()
    assert {key: typical for key, (_, typical, _) in found.items()} == pytest.approx(REFERENCE, rel=1e-12)
    assert all(0.0 < low < typical < high for low, typical, high in found.values())


def test_class_of_both_kinds_is_told_apart_by_kind():
    assert sensor("mems_consumer", kind="gyroscope").full_scale == pytest.approx(2000.0 * DEG, rel=ULPS)
    assert sensor("mems_consumer", kind="accelerometer").full_scale == pytest.approx(16.0 * G, rel=ULPS)


@pytest.mark.parametrize(
    ("id", "kind", "message"),
    [
        ("mems_tacticl", "gyroscope", "did you mean mems_tactical"),
        ("zzz", "accelerometer", "known are mems_consumer"),
        ("rlg_navigation", "accelerometer", "is of kind gyroscope"),
        ("mems_tactical", "imu", "expected accelerometer or gyroscope"),
    ],
)
def test_class_that_is_not_known_is_refused_with_what_is(id, kind, message):
    with pytest.raises(TermError, match=message):
        sensor(id, kind=kind)


def test_term_of_the_other_kind_has_no_prior():
    lib: Library = library("gyroscope", set="extended")
    with pytest.raises(TermError, match="no term 'g_i'"):
        prior_sd(sensor("mems_tactical", kind="accelerometer"), lib.terms[lib.names.index("g_i")])


@every_class
def test_a_figure_sizes_the_terms_that_it_is_said_to_size_and_no_others(entry):
    lib = library(entry.kind, set="extended", temperature=1)
    before = {term.name: prior_sd(entry, term)[0] for term in lib.terms}
    for key, (low, typical, high) in entry.coefficients.items():
        doubled = replace(entry, coefficients={**entry.coefficients, key: (low, 2 * typical, 2 * high)})
        after = {term.name: prior_sd(doubled, term)[0] for term in lib.terms}
        changed = {name for name in before if after[name] != before[name]}
        lagging = {"b0*dT"} if key == "T0" and "Tdot" not in entry.coefficients else set()
        assert changed == {*terms_of(entry.kind, key), *lagging}, key
