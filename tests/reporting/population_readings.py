"""What a report says of the units of a class, and where it stands in ``population`` of ``result.json``.

Which terms a sentence must name is worked out from the terms' verdicts, intervals and tests.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from report_reading import Meant, fixed, named, readings
from study_phrases import NUM, TERM

from imubayes.reporting.rounding import per_unit

NAME = rf"(?:[a-z]+\.)?{TERM}"
LISTED = rf"({NAME}(?:(?:, | and ){NAME})*)"
SPREAD = rf"(below )?({NUM})(?: \(({NUM}) to ({NUM})\))?"
MOST = 6
"""Names in a sentence."""

Found = dict[str, Any]


def _class(r: Found, match: re.Match[str], anchor: str) -> Found:
    if anchor.startswith("class-"):
        return r["population"][int(anchor.removeprefix("class-")) - 1]
    return next(one for one in r["population"] if match.string.startswith(f"{one['class']}, {one['kind']}s."))


def _of_term(found: Found, name: str) -> list[Found]:
    """The same term of each component; it alone where there is one."""
    alike = [one for one in found["terms"] if one["term"] == name]
    return alike[1:] if len(alike) > 1 else alike


def _first(found: Found) -> list[Found]:
    """Each term once: that of all components together where there are several."""
    return list({one["term"]: one for one in reversed(found["terms"])}.values())[::-1]


def told(found: Found) -> list[Found]:
    """Terms of which the units' tests tell: those of the table."""
    names = {one["term"] for one in found["terms"] if one["verdict"] != "cannot tell"}
    return [one for one in found["terms"] if one["term"] in names]


def _whole(found: Found) -> list[Found]:
    return [one for one in _first(found) if one in told(found)]


def moves(one: Found) -> bool:
    return one["p_value"] < one["level"]


def _differs(one: Found) -> bool:
    """Whether units differ by more than an upper limit."""
    return one["unit_to_unit"]["q05"] > 0.25 * one["unit_to_unit"]["median"]


def _common(one: Found) -> bool:
    return bool(one["component"]) and moves(one) and one["common_share"]["median"] > 0.5


def _answered(verdict: str, found: Found, match: re.Match[str]) -> Iterable[Meant]:
    """Terms of a verdict, by component where the components differ in it."""
    names = []
    for first in _first(found):
        parts = _of_term(found, first["term"])
        alike = len({part["verdict"] for part in parts}) == 1
        kept = [part["parameter"] for part in parts if part["verdict"] == verdict]
        names += ([first["parameter"]] if first["verdict"] == verdict else []) if alike else kept
    return [names]


def _each(
    item: str, which: Callable[[Found], Iterable[Found]], found: Found, match: re.Match[str]
) -> Iterable[Meant]:
    """A list of names with sizes, after some words: the words stand only where these are all its names."""
    names = [one["parameter"] for one in which(found)]
    return [None if re.findall(item, match[2]) == names else names]


def _silent(found: Found, match: re.Match[str]) -> Iterable[Meant]:
    """Terms that no component's test tells of, by the answer that most units give."""
    why = {"seen only in combination": "inseparable", "too small beside the noise": "unresolved"}
    reason = why.get(match[2], "untested")
    return [
        [
            one["parameter"]
            for one in _first(found)
            if {part["verdict"] for part in (one, *_of_term(found, one["term"]))} == {"cannot tell"}
            and max(one["answers"], key=one["answers"].__getitem__) == reason
        ]
    ]


# Sizes


def two_digits(value: float) -> float | int:
    """A size as it is printed by itself."""
    rounded = float(f"{value:.1e}")
    return int(rounded) if rounded.is_integer() else rounded


def limit(high: float) -> float | int:
    """What a size stays below: its upper end, rounded up to two digits."""
    if high == 0.0:
        return 0
    step = 10.0 ** (math.floor(math.log10(high)) - 1)
    return two_digits(math.ceil(high / step - 1e-9) * step)


def spread_said(one: Found, key: str, said: Sequence[str | None]) -> list[float | None]:
    """A spread as said: whether it is below something, its size, its interval."""
    unit, spread = per_unit(one["printed_unit"], one["unit"]), one[key]
    there = moves(one) if key == "turn_on" else _differs(one)
    sizes = [spread[end] / unit for end in ("median", "q05", "q95")]
    if (said[0] is None) != there:
        return [None, math.nan]
    return [None, *sizes] if there else [None, limit(sizes[2])]


def _size_of(key: str, found: Found, match: re.Match[str]) -> Iterable[Meant]:
    one = named(found["terms"], match[1], "parameter")
    return [None, *spread_said(one, key, match.groups()[1:])]


def _opening(found: Found, match: re.Match[str]) -> Iterable[Meant]:
    right = (match[2], match[3]) == (f"{found['kind']}s", found["class"])
    return [len(found["units"]) if right else math.nan, None, None, len(found["sessions"])]


def percents(share: Found) -> list[Meant]:
    """A share and its interval in percent: whole ones, but for small ones."""
    found = [100.0 * share[end] for end in ("median", "q05", "q95")]
    return [value if 0.0 < value < 9.95 else round(value) for value in found]


def _alike(found: Found, match: re.Match[str]) -> Iterable[Meant]:
    one = named(found["terms"], match[4], "parameter")
    shift = one["session_shift"]
    off = sum(abs(mean) > 2.0 * sd for mean, sd in zip(shift["mean"], shift["sd"], strict=True))
    return [*percents(one["common_share"]), None, off, len(shift["sessions"])]


def _shift(found: Found, match: re.Match[str]) -> Iterable[Meant]:
    """Distance of a session from the mean, of the term that was named last."""
    name = re.findall(rf"of that of ({NAME})", match.string[: match.start()])[-1]
    one = named(found["terms"], name, "parameter")
    shift, unit = one["session_shift"], per_unit(one["printed_unit"], one["unit"])
    k = shift["sessions"].index(match[1])
    return [None, shift["mean"][k] / unit, shift["sd"][k] / unit]


def _steady(found: Found) -> list[Found]:
    return [one for one in _whole(found) if not moves(one)]


LISTS = {
    r"From unit to unit \(sd[^)]*\) ":
        (rf"({NAME}) differs by ", lambda c: [one for one in _whole(c) if _differs(one)][:MOST]),
    "From one session to the next ":
        (rf"({NAME}) changes by ", lambda c: [one for one in _whole(c) if moves(one)][:MOST]),
    "the sd between sessions is ": (rf"({NAME}) below", lambda c: _steady(c)[:MOST]),
    "Of the variance between sessions all units have in common, as temperature would make it: ":
        (rf"of that of ({NAME})", lambda c: [one for one in told(c) if _common(one)]),
}  # fmt: skip
"""Words before a list of names with sizes, each of its items, and what its names must be."""

CLASS_READINGS = (
    *readings(
        {rf"({words})(.*?)\.(?= [A-Z]|$)": partial(_each, *of_each) for words, of_each in LISTS.items()}
        | {
            r"(?<![\w.])(\d+) (\w+) of class (\w+)(?:, in (\d+) sessions)?\.": _opening,
            rf"The class needs {LISTED}\.": partial(_answered, "needed"),
            rf"Some units need {LISTED}, others do not\.": partial(_answered, "some need it"),
            rf"It does not need {LISTED}\.": partial(_answered, "not needed"),
            rf"The units leave {LISTED} undecided\.": partial(_answered, "undecided"),
            rf"(?:cannot tell of|;) {LISTED} \((seen only [\w ]+|too small [\w ]+|not excited)\)": _silent,
            rf"The sessions of {LISTED} agree better than by chance": lambda c, m: [
                [one["parameter"] for one in _steady(c) if one["p_value"] > 1.0 - one["level"]]
            ],
            rf"({NAME}) differs by {SPREAD} \S+(?:,| and|\.)": partial(_size_of, "unit_to_unit"),
            rf"({NAME}) changes by {SPREAD} \S+(?:,| and|\.)": partial(_size_of, "turn_on"),
            rf"(?<!: )({NAME}) (below )({NUM}) \S+(?:,| and|\.)": partial(_size_of, "turn_on"),
            rf"({NUM}) % \(({NUM}) to ({NUM})\) of that of ({NAME})(?: \((\d+) of (\d+) sessions off)?":
                _alike,
            rf"session (\S+) by ({NUM}) ± ({NUM}) ": _shift,
            r"(\d+) more parameters are in result\.json": lambda c, m: [len(c["terms"]) - len(told(c))],
        },
        _class,
    ),
    *fixed(
        r"Intervals hold (90) %",
        r"has it with (0\.95) or more",
    ),
)  # fmt: skip
