"""Rounding as people print: two digits of the sd, the value to match, the unit they use."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from typing import Any

from imubayes.inference import Share
from imubayes.rig.recordings import OUTPUT_UNIT as OUTPUT_SI
from imubayes.sensors.terms import Kind
from imubayes.units import factor

FIXED_DIGITS = 5
"""Decimals, and digits of the sd before the point, beyond which a power of ten is written out."""

NARROW = "\u00a0"
"""Space before a percent sign, where no line ends."""

TIMES = 1.95
"""Share of a budget from which it is printed as a multiple: what rounds to twice."""

DUST = 1e-6
"""Part of a size below which numbers differ by rounding alone."""

RARE = 0.001
"""Share of a budget below which no digits are printed."""


@dataclass(frozen=True, slots=True)
class Rounded:
    """Digits of a value and of its sd (empty if there is none), their common power of ten, and their unit."""

    value: str
    sd: str
    exponent: int
    unit: str

    def __str__(self) -> str:
        """Text on one line, such as ``41.80 ± 0.62 µg/g²``."""
        body = f"{self.value} ± {self.sd}" if self.sd else self.value
        if self.exponent:
            body = f"({body})e{self.exponent}" if self.sd else f"{body}e{self.exponent}"
        return f"{minus(body)} {pretty(self.unit)}".rstrip()


def measured(value: float, sd: float, unit: str = "", size: float = 1.0) -> Rounded:
    """Round a value to two significant digits of its standard deviation.

    Parameters
    ----------
    value, sd : with an sd that is zero or not finite, two digits of the value are kept.
    unit, size : printed unit, and what one of it is in that of the value.

    Examples
    --------
    >>> str(measured(41.7961, 0.6234, "ug/g^2"))
    '41.80 ± 0.62 µg/g²'
    >>> str(measured(-0.152341, 0.001234, "ug", 1e-6))
    '−152300 ± 1200 µg'
    >>> str(measured(3.2123e-8, 4.4e-10))
    '(3.212 ± 0.044)e−8'
    """
    value, sd = value / size, sd / size
    if not math.isfinite(value):
        return Rounded("unknown" if math.isnan(value) else "unbounded", "", 0, "")
    alone = not (math.isfinite(sd) and sd > 0.0)
    least = abs(value) if alone else sd
    if least == 0.0:
        return Rounded("0", "", 0, unit)
    exponent = 0
    if not 1 - FIXED_DIGITS <= _exponent(least) <= FIXED_DIGITS:
        exponent = _exponent(max(abs(value), least))
    value, least = value * 10.0**-exponent, least * 10.0**-exponent
    decimals = 1 - _exponent(least)
    return Rounded(_fixed(value, decimals), "" if alone else _fixed(least, decimals), exponent, unit)


def below(limit: float, unit: str = "", size: float = 1.0) -> Rounded:
    """Round an upper limit up, to two significant digits: what is below the limit is below what is printed.

    >>> str(below(0.2841, "ug/g^3"))
    '0.29 µg/g³'
    """
    limit /= size
    if math.isfinite(limit) and limit > 0.0:
        step = 10.0 ** (math.floor(math.log10(limit)) - 1)
        # a limit that is two digits long already must not step up by rounding of the quotient
        limit = math.ceil(limit / step - 1e-9) * step
    return measured(limit, 0.0, unit)


def _exponent(value: float) -> int:
    """Power of ten of a value that is rounded to two digits: 0.0996 counts as 0.10."""
    return int(f"{Decimal(repr(abs(float(value)))):.1e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    text = f"{half_up(value, decimals):.{max(decimals, 0)}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def ranged(interval: Share, unit: str = "", size: float = 1.0) -> str:
    """Value with its interval, SI, in a printed unit of this size, to two digits of half the interval.

    Where the interval is no wider than rounding, two digits of the value.

    >>> from imubayes.inference import Share
    >>> ranged(Share(4.18e-5, 3.9e-5, 4.5e-5), "ppm", 1e-6)
    '41.8 (39.0 to 45.0) ppm'
    >>> ranged(Share(4.18e8, 3.9e8, 4.5e8))
    '4.18e8 (3.90e8 to 4.50e8)'
    >>> ranged(Share(0.84, 0.84, 0.84 + 1e-16))
    '0.84 (0.84 to 0.84)'
    """
    if math.isnan(interval.value):
        return ""
    value, low, high = (x / size for x in (interval.value, interval.low, interval.high))
    rounded = measured(value, 0.5 * (high - low) if high - low > DUST * abs(value) else 0.0)
    power = f"e{rounded.exponent}" if rounded.exponent else ""
    sd = rounded.sd or rounded.value.lstrip("-")
    decimals = len(sd.partition(".")[2]) or min(2 - len(sd), 0)  # down to the second digit of the sd
    middle, *ends = (
        f"{_fixed(x * 10.0**-rounded.exponent, decimals)}{power}".replace("-", "−", x < 0.0)
        for x in (value, low, high)
    )
    return f"{middle} ({ends[0]} to {ends[1]}) {pretty(unit)}".rstrip()


def percent(share: float) -> str:
    r"""Share of a count in percent, with a decimal where it is small, or where only all is more.

    >>> [percent(share) for share in (0.0123, 0.45, 0.0, 1e-4, 0.996, 0.99996, 1.0)]
    ['1.2\xa0%', '45\xa0%', '0\xa0%', '0.1\xa0%', '99.6\xa0%', '99.9\xa0%', '100\xa0%']
    """
    value = 100.0 * share
    if 0.0 < value < 9.95:
        return f"{max(value, 0.1):.1f}{NARROW}%"
    return f"{min(value, 99.9):.1f}{NARROW}%" if 99.5 <= value < 100.0 else f"{value:.0f}{NARROW}%"


def percents(interval: Share) -> str:
    r"""Share of a count with its interval; nothing where nothing was counted."""
    if math.isnan(interval.value):
        return ""
    low, high = (percent(end).removesuffix(f"{NARROW}%") for end in (interval.low, interval.high))
    return f"{percent(interval.value)} ({low} to {high})"


def share(value: float) -> str:
    """Share of a budget, two digits: a percentage, or how many times the budget.

    >>> share(0.0004), share(0.034), share(0.62), share(1.996), share(7.3), share(5812.0), share(1.2e8)
    ('below 0.1 %', '3.4 %', '62 %', '2.0 times', '7.3 times', '5,800 times', '1.2e8 times')
    """
    if not math.isfinite(value):
        return str(measured(value, 0.0))
    if value < RARE:
        return "below 0.1 %"
    rounded = measured(value if value >= TIMES else 100.0 * value, 0.0)
    number = str(rounded) if rounded.exponent or "." in rounded.value else f"{int(rounded.value):,}"
    return f"{number} {'times' if value >= TIMES else '%'}"


def share_range(interval: Share) -> str:
    """Share of a budget with its interval; nothing where it was not asked."""
    if math.isnan(interval.value):
        return ""
    return f"{share(interval.value)} ({share(interval.low)} to {share(interval.high)})"


def duration(seconds: float, digits: int = 3) -> str:
    """Time in the unit that reads well, with so many digits at most; nothing where it is not known.

    >>> duration(0.00123), duration(9.0), duration(75.0), duration(600.0), duration(7200.0)
    ('1.23 ms', '9 s', '75 s', '10 min', '2 h')
    >>> duration(3.6e7), duration(19275.0, 2), duration(float("nan"))
    ('10,000 h', '5.4 h', '')
    """
    if math.isnan(seconds):
        return ""
    for limit, size, unit in _DURATIONS:
        if seconds < limit:
            return f"{_short(seconds / size, digits)} {unit}"
    return f"{_short(seconds / 3600.0, digits)} h"


_DURATIONS = (
    (1e-6, 1e-9, "ns"),
    (1e-3, 1e-6, "µs"),
    (0.1, 1e-3, "ms"),
    (120.0, 1.0, "s"),
    (7200.0, 60.0, "min"),
)
"""Units of time, each up to which limit in s it is used, and its size in s; hours beyond."""


def _short(value: float, digits: int) -> str:
    return f"{float(f'{value:.{digits}g}'):,.15g}"


def times(ratio: float) -> str:
    """Write a ratio of times, two digits.

    >>> times(182.3), times(0.456), times(float("nan"))
    ('180', '0.46', '')
    """
    return "" if math.isnan(ratio) else _short(ratio, 2)


def per_unit(printed: str, si: str) -> float:
    """SI value of one printed unit of a term.

    >>> per_unit("ppm", "1")
    1e-06
    """
    return factor(printed, like="" if si in ("1", "rad") else si)


def unit_of(term: Any) -> tuple[str, float]:
    """Unit in which the coefficient of what has a `unit` in SI is `printed`, and its size in SI."""
    return term.printed, per_unit(term.printed, term.unit)


def sized(of: Any, value: float, sd: float = 0.0) -> Rounded:
    """Value and sd, SI, of what has a `unit` in SI, in the one that is `printed`."""
    return measured(value, sd, *unit_of(of))


_PRETTY = (
    (re.compile(r"\bu(?=g\b|rad\b)"), "µ"),
    (re.compile(r"sqrt\(([^()]*)\)"), r"√\1"),
    (re.compile(r"\bdegC\b"), "°C"),
    (re.compile(r"\bdeg\b"), "°"),
    (re.compile(r"\^2\b"), "²"),
    (re.compile(r"\^3\b"), "³"),
    (re.compile(r"\^(-?\d+)"), lambda match: match[1].translate(_SUPERSCRIPT)),
)
_MINUS = re.compile(r"(?<!\w)-|(?<=[\d)]e)-(?=\d)")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def pretty(unit: str) -> str:
    """Write a unit with the real signs, for paper and screen.

    >>> pretty("ug/sqrt(Hz)"), pretty("deg/h/g^2"), pretty("ppm/(deg/s)^3")
    ('µg/√Hz', '°/h/g²', 'ppm/(°/s)³')
    """
    for pattern, sign in _PRETTY:
        unit = pattern.sub(sign, unit)
    return unit


def minus(text: str) -> str:
    """Write minus signs as such; the hyphen of a word, a name or a date stays.

    >>> minus("-3.1e-05 of the whole-angle mode, IMU-1, K1/K1nom - 1")
    '−3.1e−05 of the whole-angle mode, IMU-1, K1/K1nom − 1'
    """
    return _MINUS.sub("−", text)


def ten(exponent: int) -> str:
    """Power of ten with raised digits."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def signed(value: Rounded | None) -> str:
    """Value and sd without the unit, for paper and screen; nothing of None.

    >>> signed(measured(-3.2123e-8, 4.4e-10))
    '−3.212 ± 0.044 ×10⁻⁸'
    """
    if value is None:
        return ""
    sd = f" ± {value.sd}" if value.sd else ""
    return f"{minus(value.value)}{sd}{f' ×{ten(value.exponent)}' if value.exponent else ''}"


def in_unit(value: Rounded) -> str:
    """Value and sd in their unit, for paper and screen."""
    return f"{signed(value)} {pretty(value.unit)}"


OUTPUT_UNIT: dict[Kind, str] = {"accelerometer": "ug", "gyroscope": "deg/h"}
"""Unit in which an effect on the output is printed."""

NOISE: dict[Kind, dict[str, tuple[str, str]]] = {
    "accelerometer": {
        "N": ("ug/sqrt(Hz)", "m/s^2/sqrt(Hz)"),
        "B": ("ug", "m/s^2"),
        "K": ("ug/sqrt(s)", "m/s^2/sqrt(s)"),
        "Q": ("m/s", "m/s"),
        "R": ("ug/h", "m/s^2/s"),
        "G": ("ug", "m/s^2"),
        "tau": ("s", "s"),
    },
    "gyroscope": {
        "N": ("deg/sqrt(h)", "rad/s/sqrt(Hz)"),
        "B": ("deg/h", "rad/s"),
        "K": ("deg/h/sqrt(h)", "rad/s/sqrt(s)"),
        "Q": ("arcsec", "rad"),
        "R": ("deg/h/h", "rad/s^2"),
        "G": ("deg/h", "rad/s"),
        "tau": ("s", "s"),
    },
}
"""Data-sheet unit and SI unit of the size of each noise process, and of the time constant of G."""


def noise_unit(name: str, kind: Kind) -> tuple[str, float]:
    """Unit in which the size of a noise process is printed, and its size in SI."""
    printed, si = NOISE[kind][name]
    return printed, per_unit(printed, si)


def output_unit(kind: Kind) -> tuple[str, float]:
    """Unit in which an effect on the output is printed, and its size in SI."""
    return OUTPUT_UNIT[kind], per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])


def on_output(size: float, kind: Kind, sd: float = 0.0) -> Rounded:
    """Size on the output, SI, with its sd if it has one, in ug or deg/h."""
    return measured(size, sd, *output_unit(kind))


CHANNEL_UNIT = {"f": "g", "w": "deg/s", "dw": "deg/s^2", "T": "degC", "dT": "degC/min", "gT": "K"}
"""Unit in which the range of an input channel is printed."""


def probability(p: float) -> str:
    """p-value to two digits, never as a bare zero.

    >>> probability(0.3123), probability(2e-9), probability(float("nan"))
    ('0.31', '<0.001', 'not tested')
    """
    if math.isnan(p):
        return "not tested"
    return "<0.001" if p < 1e-3 else f"{p:.2g}" if p < 0.01 else f"{p:.2f}"


def probable(chance: float) -> str:
    """Probability to three digits, never as a bare one or zero.

    >>> probable(0.99997), probable(0.4321), probable(2e-5)
    ('above 0.999', '0.432', 'below 0.001')
    """
    if chance > 0.9995:
        return "above 0.999"
    return "below 0.001" if chance < 0.0005 else f"{chance:.3f}"


def half_up(value: float, decimals: int = 0) -> float:
    """Round as people do: a half goes away from zero, as the number is written.

    >>> half_up(12.5), half_up(13.5), half_up(-0.125, 2), half_up(1250.0, -2)
    (13.0, 14.0, -0.13, 1300.0)
    """
    if not math.isfinite(value):
        return value
    written = Decimal(repr(float(value)))
    # no digit to round off, maybe too many to write
    if int(written.normalize().as_tuple().exponent) >= -decimals:
        return float(value)
    return float(written.quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP))


def models_text(count: int) -> str:
    """Write the number of models, as a power of two where it is one.

    >>> models_text(32768), models_text(100)
    ('2^15', '100')
    """
    return f"2^{count.bit_length() - 1}" if count > 1 and count & (count - 1) == 0 else f"{count:,}"
