"""Figures of the catalogue, and the priors made of them."""

import math
from dataclasses import replace
from functools import partial

import pytest

from imubayes.sensors.catalogue import classes, prior_sd, sensor, terms_of
from imubayes.sensors.noise import noise_prior
from imubayes.sensors.terms import Term, library

G = 9.80665
DEG = math.pi / 180.0
ULPS = 1e-14
"""A few multiplications of conversion factors."""

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")


def _term(kind: str, name: str) -> Term:
    heated = ("b0", "b1", "m_j")
    options = {"powers": 6, "asymmetry": 5, "set": "extended", "temperature": 2}
    lib = library(kind, **options, temperature_of=heated, rate_of=heated, gradient_of=heated)
    return lib.terms[lib.names.index(name)]


def _sd(id: str, kind: str, name: str) -> float:
    return prior_sd(sensor(id, kind=kind), _term(kind, name))[0]


@every_class
def test_every_term_of_the_extended_library_has_a_finite_positive_prior(entry):
    wide = partial(library, entry.kind, powers=6, asymmetry=5, set="extended")
    names = wide().names
    for term in wide(temperature=2, temperature_of=names, rate_of=names, gradient_of=names).terms:
        sd, origin = prior_sd(entry, term)
        assert 0.0 < sd < math.inf, term.name
        assert origin


@pytest.mark.parametrize(
    ("id", "kind", "name", "sd"),
    [
        ("mems_tactical", "accelerometer", "b0p", 5e-6 * G / 2.0),
        ("mems_tactical", "accelerometer", "b5", 2e-6 / G**2 / 3.0 / (20.0 * G) ** 2),
        ("mems_tactical", "accelerometer", "S_ij", math.hypot(0.5e-6 * G, 0.5e-3)),
        ("mems_tactical", "accelerometer", "S_ik", 0.5e-3),
        ("mems_tactical", "accelerometer", "S_jk", 0.5e-6 * G),
        ("mems_tactical", "accelerometer", "s_k", math.hypot(1e-6 * G, 0.5e-3)),
        ("mems_tactical", "accelerometer", "b1*T2", 15e-6 / 69.5),
        ("mems_tactical", "accelerometer", "b0*dT", 30e-6 * G * 60.0),
        ("mems_tactical", "accelerometer", "b1*dT", 15e-6 * 60.0),
        ("mems_tactical", "accelerometer", "m_j*dT", 400e-6 * 1e-3 * 60.0),
        ("mems_tactical", "accelerometer", "m_j*T2", 400e-6 * 1e-6),
        ("fog_tactical", "gyroscope", "b0", DEG / 3600.0),
        ("fog_tactical", "gyroscope", "b0p", 0.05 * DEG / 3600.0),
        ("fog_tactical", "gyroscope", "b2", 0.2e-6 / DEG),
        ("fog_tactical", "gyroscope", "c_jk", 0.001e-6 / DEG),
        ("fog_tactical", "gyroscope", "g_k", 0.05 * DEG / 3600.0 / G),
        ("fog_tactical", "gyroscope", "S_ij", 0.005 * DEG / 3600.0 / G**2),
        ("fog_tactical", "gyroscope", "b3", 1e-4 * 1e-6 / DEG**2),
        # typical is zero: a tenth of the highest
        ("fog_tactical", "gyroscope", "s_i", 0.001 / 10.0 / 3600.0),
        ("fog_tactical", "gyroscope", "b0*dT", 1.0 * DEG / 3600.0 * 60.0),
    ],
)
def test_prior_is_made_of_typical_figures_in_si(id, kind, name, sd):
    assert _sd(id, kind, name) == pytest.approx(sd, rel=ULPS)


def test_assumed_priors_say_that_they_are_assumed():
    entry = sensor("mems_tactical", kind="gyroscope")
    for name in ("b2p", "b4", "b3p", "b0*T2", "m_j*T", "b0*dT", "b1*dT", "m_j*dT"):
        assert prior_sd(entry, _term("gyroscope", name))[1].startswith("assumed: "), name
    assert prior_sd(entry, _term("gyroscope", "b1p"))[1] == "half of the typical sasym"


@every_class
def test_noise_prior_puts_five_percent_below_low_and_above_high(entry):
    for name, (median, sd) in noise_prior(entry).items():
        low, typical, high = entry.noise[name]
        assert median == typical
        # the spread is that of the whole range: P(low < x < high) of a log-normal centred in it is 90 %
        centre = math.sqrt(low * high)
        below = 0.5 * math.erfc(math.log(centre / low) / sd / math.sqrt(2.0))
        assert below == pytest.approx(0.05, abs=1e-12)


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
