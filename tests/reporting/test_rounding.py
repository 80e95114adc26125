from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imubayes.reporting.rounding import below, measured, per_unit, pretty
from imubayes.sensors.terms import library

SIZES = st.floats(1e-12, 1e12)


def number(text: str, exponent: int) -> float:
    return float(text) * 10.0**exponent


@given(st.floats(-1e9, 1e9), SIZES)
def test_printed_value_is_within_half_of_its_last_digit_and_sd_has_two_digits(
    value: float, sd: float
) -> None:
    printed = measured(value, sd, "ug")
    unit = 10.0 ** (math.floor(math.log10(number(printed.sd, printed.exponent)) + 1e-9) - 1)
    assert abs(number(printed.sd, printed.exponent) - sd) <= 0.501 * unit
    assert abs(number(printed.value, printed.exponent) - value) <= 0.501 * unit + 1e-12 * abs(value)


@given(st.floats(-1e6, 1e6), SIZES)
def test_value_and_sd_have_equal_decimals_and_no_negative_zero(value: float, sd: float) -> None:
    printed = measured(value, sd)
    assert len(printed.value.partition(".")[2]) == len(printed.sd.partition(".")[2])
    assert not (printed.value.startswith("-") and float(printed.value) == 0.0)


@given(SIZES)
def test_printed_limit_is_not_below_the_limit_and_at_most_a_tenth_above(limit: float) -> None:
    printed = below(limit)
    assert limit * (1.0 - 1e-8) <= number(printed.value, printed.exponent) <= 1.1 * limit * (1.0 + 1e-8)


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (1502.1, 4.2, "1502.1 +- 4.2 ug"),
        (0.0, 9.96, "0 +- 10 ug"),
        (-0.001, 0.2, "0.00 +- 0.20 ug"),
        (3.0, 0.0, "3.0 ug"),
        (3.0, math.nan, "3.0 ug"),
        (0.0, 0.0, "0 ug"),
        (math.nan, 1.0, "unknown"),
    ],
)
def test_rounding_of_edge_cases(value: float, sd: float, text: str) -> None:
    assert str(measured(value, sd, "ug")) == text


def test_infinite_limit_is_said_to_be_unbounded() -> None:
    assert str(below(math.inf, "ug")) == "unbounded"


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_every_term_of_the_largest_library_has_a_printed_unit_of_its_si_unit(kind: str) -> None:
    for term in library(kind, powers=5, asymmetry=4, set="extended", temperature=3).terms:
        assert per_unit(term.printed, term.unit) > 0.0
        assert not set("^*") & set(pretty(term.printed)) and "deg" not in pretty(term.printed)
