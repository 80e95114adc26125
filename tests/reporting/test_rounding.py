import math
import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_reading import written

from imubayes.inference import Share
from imubayes.reporting.rounding import (
    below,
    duration,
    half_up,
    measured,
    percent,
    percents,
    ranged,
    share,
    share_range,
)

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
        (1502.1, 4.2, "1502.1 ± 4.2 µg"),
        (0.0, 9.96, "0 ± 10 µg"),
        (-0.001, 0.2, "0.00 ± 0.20 µg"),
        (3.0, 0.0, "3.0 µg"),
        (3.0, math.nan, "3.0 µg"),
        (0.0, 0.0, "0 µg"),
        (math.nan, 1.0, "unknown"),
        (-math.inf, 1.0, "unbounded"),
    ],
)
def test_rounding_of_edge_cases(value: float, sd: float, text: str) -> None:
    assert str(measured(value, sd, "ug")) == text
    assert str(measured(1e-6 * value, 1e-6 * sd, "ug", 1e-6)) == text


MAGNITUDES = st.floats(1e-15, 1e15)
SIGNED = st.one_of(MAGNITUDES, MAGNITUDES.map(lambda x: -x))
PARTS = st.floats(0.0, 1.0)


def _triple(middle: float, below: float, above: float) -> Share:
    return Share(middle, middle - below * abs(middle), middle + above * abs(middle))


WRITERS: dict[str, tuple[Callable[[float, float, float], str], str]] = {
    "value": (lambda m, a, b: str(measured(m, 0.0)), ""),
    "value and sd": (lambda m, a, b: str(measured(m, (a + 1e-3) * m)), ""),
    "range": (lambda m, a, b: ranged(_triple(m, a, b)), ""),
    "share": (lambda m, a, b: share(m), ""),
    "share range": (lambda m, a, b: share_range(_triple(m, a, b)), ""),
    "duration": (lambda m, a, b: duration(m), ""),
    "percent": (lambda m, a, b: percent(min(m, 1.0)), ""),
    "percents": (lambda m, a, b: percents(_triple(min(m, 1.0), a, 0.0)), "%"),
}  # fmt: skip


def _meant(writer: str, m: float, a: float, b: float) -> list[float]:
    """What a writer was given, in the order in which it writes."""
    if writer == "value and sd":
        return [m, (a + 1e-3) * m]
    if writer in ("percent", "percents"):
        m, b = min(m, 1.0), 0.0
    triple = _triple(m, a, b)
    return [m, triple.low, triple.high] if writer in ("range", "share range", "percents") else [m]


@pytest.mark.parametrize("writer", WRITERS)
@given(middle=MAGNITUDES, below=PARTS, above=PARTS)
def test_what_any_writer_prints_reads_back_as_the_number_within_its_rounding(
    writer: str, middle: float, below: float, above: float
) -> None:
    write, unit = WRITERS[writer]
    text = write(middle, below, above)
    for (read, half), meant in zip(written(text, unit), _meant(writer, middle, below, above), strict=True):
        if writer.startswith("percent") and not 5e-4 <= meant <= 0.9995:
            # a share is none or all only where it is
            assert (0.0 < read < 1.0) == (0.0 < meant < 1.0) and abs(read - meant) <= 1e-3, text
            continue
        small = writer.startswith("share") and meant < 1e-3
        assert (0.0 <= meant <= read) if small else abs(read - meant) <= half * 1.02 + 1e-9 * abs(meant), text


@given(middle=SIGNED, below=PARTS, above=PARTS)
def test_range_holds_its_value_as_it_is_printed(middle: float, below: float, above: float) -> None:
    (value, _), (low, _), (high, _) = written(ranged(_triple(middle, below, above)))
    assert low <= value <= high


@given(MAGNITUDES)
def test_share_of_a_budget_is_never_a_percentage_of_four_digits(value: float) -> None:
    assert ("times" in share(value)) == (half_up(value, 1) >= 2.0)


@pytest.mark.parametrize("empty", [math.nan, math.inf])
def test_what_is_no_number_is_no_number_in_print(empty: float) -> None:
    nothing = Share(empty, empty, empty)
    for text in (share(empty), str(measured(empty, 1.0)), share_range(nothing)):
        assert not re.search(r"\d", text)
    assert (
        duration(math.nan) == ranged(Share(math.nan, 0.0, 1.0)) == percents(Share(math.nan, 0.0, 1.0)) == ""
    )


@given(st.integers(-9999, 9999), st.integers(0, 3))
def test_a_half_goes_away_from_zero_wherever_a_number_is_printed(whole: int, decimals: int) -> None:
    value = float(f"{whole}.{'0' * decimals}5")
    near = float(f"{whole}.{'0' * decimals}")
    step = math.copysign(10.0**-decimals, value)
    assert half_up(value, decimals) == pytest.approx(near + step, abs=1e-9)
    assert half_up(near, decimals) == near


@pytest.mark.parametrize(("value", "decimals"), [(1e200, 3), (1.5, 40), (-1e300, -10), (5e-324, 400)])
def test_numbers_without_a_digit_to_round_off_stay_however_long_they_are(value, decimals):
    assert half_up(value, decimals) == value
