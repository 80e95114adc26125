"""Results in a standard's symbols: units, uncertainty, and which standard applies."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from imubayes.sensors.catalogue import classes, figure_symbols, prior_sd, sensor
from imubayes.sensors.equations import (
    APPLIES,
    STANDARDS,
    in_standard,
    linearised,
    standard,
    standards_for,
    symbols,
)
from imubayes.sensors.terms import library
from imubayes.units import factor

ALL = list(STANDARDS.values())
BY_ID = pytest.mark.parametrize("known", ALL, ids=lambda known: f"{known.kind}-{known.id}")


def _library(kind):
    return library(kind, set="extended", temperature=1)


def _posterior(lib, rng):
    """Coefficients of about 1e-2 with correlated errors a tenth of that: well within the linear range."""
    p = len(lib.terms)
    root = rng.normal(size=(p, p)) / np.sqrt(p) * 1e-3
    return 1e-2 * rng.normal(size=p), root @ root.T


def _value(found, symbol):
    return next(
        SimpleNamespace(unit=row.unit, printed=row.printed, value=value, sd=sd)
        for row, value, sd in zip(*found, strict=True)
        if row.symbol == symbol
    )


@BY_ID
def test_sd_and_jacobian_are_by_the_slope_of_the_mapping(known):
    """Central differences as the second route: truncation h^2 and rounding 1e-16/h balance at 1e-5."""
    lib = _library(known.kind)
    mean, cov = _posterior(lib, np.random.default_rng(2))
    rows, values, J = linearised(known.id, lib, mean)
    assert len(values) == len(rows)
    ends = [
        [linearised(known.id, lib, mean + s * h)[1] for s in (1.0, -1.0)] for h in 1e-5 * np.eye(len(mean))
    ]
    slopes = np.transpose([(up - down) / 2e-5 for up, down in ends])
    np.testing.assert_allclose(J, slopes, rtol=1e-7, atol=1e-9)
    sd = np.sqrt(np.diag(slopes @ cov @ slopes.T))
    np.testing.assert_allclose(in_standard(known.id, lib, mean, cov)[2], sd, rtol=1e-6)


def test_values_print_in_the_units_people_use():
    """K2 of 41.8 ppm/g is 41.8 ug/g^2, and 1 deg/h/g is 4.8481e-6/9.80665 s/m."""
    lib = library("accelerometer")
    mean = np.array([41.8e-6 / 9.80665 if name == "b2" else 0.0 for name in lib.names])
    K2 = _value(in_standard("ieee1293", lib, mean, np.zeros((len(mean), len(mean)))), "K2")
    assert K2.printed == "ug/g^2"
    assert K2.value / factor(K2.printed, like=K2.unit) == pytest.approx(41.8, rel=1e-12)
    gyro = library("gyroscope", set="extended")
    mean = np.array([np.pi / 648000.0 / 9.80665 if name == "g_i" else 0.0 for name in gyro.names])
    D_I = _value(in_standard("ieee517", gyro, mean, np.zeros((len(mean), len(mean)))), "D_I")
    assert D_I.printed == "deg/h/g"
    assert D_I.value / factor(D_I.printed, like=D_I.unit) == pytest.approx(1.0, rel=1e-12)


def test_trap_ppm_of_the_scale_factor_is_1e_6():
    lib = library("gyroscope")
    mean = np.array([-100e-6 if name == "b1" else 0.0 for name in lib.names])
    eps_K = _value(in_standard("ieee952", lib, mean, np.zeros((len(mean), len(mean)))), "eps_K")
    # 1/(1 - 1e-4) - 1 = 1.0001e-4 and higher: the denominator shows in the fourth digit
    assert eps_K.value / factor(eps_K.printed) == pytest.approx(100.01, rel=1e-7)


@BY_ID
def test_a_displayed_symbol_has_the_sign_and_the_scale_of_the_exact_mapping(known):
    """``-X/2`` says that the coefficient is minus half of X: so it is, of each parameter alone, exactly.

    At 2^-40 of a parameter the mapping's curvature is below rounding, and the slope is a power of two.
    """
    step, none = 2.0**-40, known.from_general({})
    for row in known.symbols:
        if not row.term:
            continue
        sign, symbol, divisor = re.fullmatch(r"(-?)([^-/]+(?:/H)?)(?:/(\d))?", row.of_term).groups()
        assert symbol == row.symbol
        moved = known.to_general(replace(none, **{row.field: step}))
        said = (-1.0 if sign else 1.0) / float(divisor or 1.0)
        assert moved[row.term] / step == pytest.approx(said, abs=1e-9), row.of_term


@pytest.mark.parametrize(
    ("id", "scale", "unbalance"),
    [
        ("hrg_navigation", "eps_K", "D_a,i"),
        ("fog_tactical", "-eps_K", "-"),
        ("mech_sdf_rig", "eps_K", "D_I"),
        ("mech_dtg", "eps_x", "D_xx"),
        ("mech_rate_spring", "-", "-"),
    ],
)
def test_the_class_decides_the_symbols_of_a_gyroscope(id, scale, unbalance):
    entry = sensor(id, kind="gyroscope")
    shown = symbols(library("gyroscope", set="extended", technology=entry.technology))
    assert (shown["b1"], shown["g_i"]) == (scale, unbalance)


@pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")
def test_a_figure_of_the_catalogue_is_the_size_that_its_symbol_says(entry):
    """The figure, as that many times the parameter, gives the term the prior sd that it has."""
    rows = {r.symbol: r for id in standards_for(entry.kind, entry.technology)[:1]
            for r in standard(id, kind=entry.kind).symbols}  # fmt: skip
    lib = library(entry.kind, set="extended", temperature=1)
    terms = {term.name: term for term in lib.terms}
    for key in entry.coefficients:
        for shown in figure_symbols(entry, key):
            times, _, symbol = shown.rpartition(" ")
            row = rows[symbol]
            figure = 1.0 / float(times or 1.0) * abs(row.weight)
            size = prior_sd(replace(entry, coefficients=_alone(entry, key)), terms[row.term])[0]
            assert size == pytest.approx(figure), shown


def _alone(entry, key):
    """The class's figures with one of size 1 and nothing else."""
    return {name: (1.0, 1.0, 1.0) if name == key else (0.0, 0.0, 0.0) for name in entry.coefficients}


def test_technology_without_a_standard_has_the_basic_triad_and_a_gyroscope_of_none_no_symbols():
    assert standards_for("accelerometer", "pendulous integrating gyro accelerometer") == ("basic",)
    assert standards_for("gyroscope", "cold-atom interferometer") == ("basic",)
    assert set(symbols(library("gyroscope")).values()) == {"-"}


def test_every_class_of_the_catalogue_has_its_standard_or_is_known_to_have_none():
    for entry in classes():
        phrase = entry.technology.lower()
        assert any(kind == entry.kind and part in phrase for kind, part, _ in APPLIES), entry.id
        *own, last = standards_for(entry.kind, entry.technology)
        assert last == "basic"
        assert all(standard(id, kind=entry.kind).kind == entry.kind for id in own)
