"""The registry of the domain, and what it refuses."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.errors import UnitError
from imubayes.units import factor, quantity

ULPS = 4 * 2.220446049250313e-16
"""A conversion is a few multiplications."""


@pytest.mark.parametrize(
    ("unit", "like", "value"),
    [
        ("g", "m/s^2", 9.80665),
        ("mg", "m/s^2", 9.80665e-3),
        ("ug", "m/s^2", 9.80665e-6),
        ("deg/h", "rad/s", math.pi / 180 / 3600),
        ("deg/sqrt(h)", "rad/s/sqrt(Hz)", math.pi / 180 / 60),
        ("deg/√h", "rad/√s", math.pi / 180 / 60),
        ("deg/h/sqrt(h)", "rad/s/sqrt(s)", math.pi / 180 / 3600 / 60),
        ("ug/sqrt(Hz)", "m/s^2/sqrt(Hz)", 9.80665e-6),
        ("μg/√Hz", "m/s/sqrt(s)", 9.80665e-6),
        ("m/s/sqrt(h)", "m/s^2/sqrt(Hz)", 1 / 60),
        ("deg/h/g", "rad/s/(m/s^2)", math.pi / 180 / 3600 / 9.80665),
        ("ppm/g", "(m/s^2)^-1", 1e-6 / 9.80665),
        ("deg/h/(degC/min)", "rad/s/(K/s)", math.pi / 180 / 60),
        ("deg/h/G", "rad/s/T", math.pi / 180 / 3600 / 1e-4),
        ("rpm", "rad/s", math.pi / 30),
        ("count", "", 1.0),
        ("%", "", 0.01),
        ("arcsec", "rad", math.pi / 180 / 3600),
    ],
)
def test_domain_unit_has_its_defined_size(unit, like, value):
    assert factor(unit, like=like) == pytest.approx(value, rel=ULPS)


def test_units_of_data_sheets_are_the_published_numbers():
    assert factor("deg/sqrt(h)", like="rad/s/sqrt(Hz)") == pytest.approx(2.909e-4, rel=1e-4)
    # a rate density of 5 deg/h/sqrt(Hz) is the same data-sheet line as 0.083 deg/sqrt(h)
    density = 5 * factor("deg/h/sqrt(Hz)", like="rad/s/sqrt(Hz)")
    assert density / factor("deg/sqrt(h)", like="rad/s/sqrt(Hz)") == pytest.approx(5 / 60, rel=ULPS)
    assert factor("ppm/g", like="1/g") == pytest.approx(factor("ug/g^2", like="1/g"), rel=ULPS)


@given(st.floats(-1e300, 1e300, allow_subnormal=False))
def test_quantity_is_the_number_times_the_unit(number):
    assert quantity(f"{number!r} g", like="m/s^2") == pytest.approx(number * 9.80665, rel=ULPS)


def test_celsius_has_an_offset_as_a_temperature_and_none_in_a_rate():
    assert quantity("25 degC", like="K") == 298.15
    assert quantity("60 degC/min", like="K/s") == pytest.approx(1.0, rel=ULPS)


@pytest.mark.parametrize(
    ("unit", "like"),
    [("furlong", "m/s^2"), ("mg", "s"), ("", "s"), ("deg (", "rad"), ("deg/h)", "rad/s"), ("9**9**9**9", "")],
)
def test_unit_that_is_unknown_or_of_another_kind_is_refused(unit, like):
    with pytest.raises(UnitError, match=r"expected something like"):
        factor(unit, like=like)


@pytest.mark.parametrize("unit", ["m^9^9^9^9", "m^(9)^(9)^(9)^(9)", "m^99999999999", "m" * 5000])
def test_unit_that_would_keep_the_parser_busy_is_refused(unit):
    with pytest.raises(UnitError, match="not known"):
        factor(unit, like="m")


@pytest.mark.parametrize("text", ["", "s", "nan s", "inf s", "1e400 s", "1 2 s", "1,5 s", "- 5 s", "5 g"])
def test_text_that_is_not_a_duration_is_refused(text):
    with pytest.raises(UnitError):
        quantity(text, like="s")


@given(st.text(alphabet=st.sampled_from("mgsdehrK/*^()0129.+- √²°%\t\n'\"[]{}_=;\\"), max_size=20))
def test_any_text_is_a_unit_or_a_unit_error(text):
    try:
        value = factor(text)
    except UnitError:
        return
    assert isinstance(value, float)
