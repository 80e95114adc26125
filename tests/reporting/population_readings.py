"""What a report says of the units of a class, and where it stands in ``population`` of ``result.json``.

Which terms a sentence must name is worked out from the terms' verdicts, intervals and tests.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from report_reading import Meant, Reading, fixed
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


def _answered(verdict: str) -> Callable[[Found], list[str]]:
    """Terms of a verdict, by component where the components differ in it."""

    def answered(found: Found) -> list[str]:
        names = []
        for first in _first(found):
            parts = _of_term(found, first["term"])
            alike = len({part["verdict"] for part in parts}) == 1
            kept = [part["parameter"] for part in parts if part["verdict"] == verdict]
            names += [first["parameter"]] if alike and kept else kept
        return names

    return answered


def _among(which: Callable[[Found], Iterable[Found]]) -> Callable[[Found], list[str]]:
    return lambda found: [one["parameter"] for one in which(found)][:MOST]


def _names(phrase: str, wanted: Callable[[Found], list[str]]) -> Reading:
    """A list of names that must be all of them."""
    return Reading(phrase, lambda r, m, a: [wanted(_class(r, m, a))])


def _each(words: str, item: str, wanted: Callable[[Found], list[str]]) -> Reading:
    """A list of names with sizes, after some words: the words stand only where these are all its names."""

    def meant(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
        names = wanted(_class(r, match, anchor))
        return [None if re.findall(item, match[2]) == names else names]

    return Reading(rf"({words})(.*?)\.(?= [A-Z]|$)", meant)


def _silent(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Terms that no component's test tells of, by the answer that most units give."""
    why = {"seen only in combination": "inseparable", "too small beside the noise": "unresolved"}
    reason, found = why.get(match[2], "untested"), _class(r, match, anchor)
    return [
        [
            one["parameter"]
            for one in _first(found)
            if {part["verdict"] for part in _of_term(found, one["term"])} == {"cannot tell"}
            and max(one["answers"], key=one["answers"].__getitem__) == reason
        ]
    ]


# Sizes


def two_digits(value: float) -> float | int:
    """A size as it is printed by itself."""
    rounded = float(f"{value:.1e}")
    return int(rounded) if rounded.is_integer() else rounded


def _limit(high: float) -> float | int:
    """What a size stays below: its upper end, rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(high)) - 1)
    return two_digits(math.ceil(high / step - 1e-9) * step)


def spread_said(one: Found, key: str, said: Sequence[str | None]) -> list[float | None]:
    """A spread as said: whether it is below something, its size, its interval."""
    unit, spread = per_unit(one["printed_unit"], one["unit"]), one[key]
    there = moves(one) if key == "turn_on" else _differs(one)
    sizes = [spread[end] / unit for end in ("median", "q05", "q95")]
    if (said[0] is None) != there:
        return [None, math.nan]
    return [None, *sizes] if there else [None, _limit(sizes[2])]


def _size_of(key: str, r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = named(_class(r, match, anchor)["terms"], match[1])
    return [None, *spread_said(one, key, match.groups()[1:])]


def _sized(key: str, verb: str) -> Reading:
    return Reading(rf"({NAME}){verb}{SPREAD} \S+(?:,| and|\.)", partial(_size_of, key))


def named(found: Iterable[Found], name: str) -> Found:
    return next(one for one in found if one["parameter"] == name)


def _title(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = _class(r, match, anchor)
    one = named(found["terms"], match[1])
    sizes = [spread_said(one, key, [match[k]])[:2] for key, k in (("unit_to_unit", 2), ("turn_on", 4))]
    return [
        None,
        *(two_digits(size) if size else None for said in sizes for size in said),
        len(found["units"]),
    ]


def _opening(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = _class(r, match, anchor)
    right = (match[2], match[3]) == (f"{found['kind']}s", found["class"])
    return [len(found["units"]) if right else math.nan, None, None, len(found["sessions"])]


def percents(share: Found) -> list[Meant]:
    """A share and its interval in percent: whole ones, but for small ones."""
    found = [100.0 * share[end] for end in ("median", "q05", "q95")]
    return [value if 0.0 < value < 9.95 else round(value) for value in found]


def _alike(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = named(_class(r, match, anchor)["terms"], match[4])
    shift = one["session_shift"]
    off = sum(abs(mean) > 2.0 * sd for mean, sd in zip(shift["mean"], shift["sd"], strict=True))
    return [*percents(one["common_share"]), None, off, len(shift["sessions"])]


def _shift(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Distance of a session from the mean, of the term that was named last."""
    name = re.findall(rf"of that of ({NAME})", match.string[: match.start()])[-1]
    one = named(_class(r, match, anchor)["terms"], name)
    shift, unit = one["session_shift"], per_unit(one["printed_unit"], one["unit"])
    k = shift["sessions"].index(match[1])
    return [None, shift["mean"][k] / unit, shift["sd"][k] / unit]


def _left_out(r: Found, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = _class(r, match, anchor)
    return [len(found["terms"]) - len(told(found))]


def _steady(found: Found) -> list[Found]:
    return [one for one in _whole(found) if not moves(one)]


DIFFERS, CHANGES, BELOW = " differs by ", " changes by ", rf"(?<!: )({NAME}) (below )({NUM}) \S+(?:,| and|\.)"

CLASS_READINGS = (
    Reading(r"(?<![\w.])(\d+) (\w+) of class (\w+)(?:, in (\d+) sessions)?\.", _opening),
    _names(rf"The class needs {LISTED}\.", _answered("needed")),
    _names(rf"Some units need {LISTED}, others do not\.", _answered("some need it")),
    _names(rf"It does not need {LISTED}\.", _answered("not needed")),
    _names(rf"The units leave {LISTED} undecided\.", _answered("undecided")),
    Reading(rf"(?:cannot tell of|;) {LISTED} \((seen only [\w ]+|too small [\w ]+|not excited)\)", _silent),
    _each(
        r"From unit to unit \(sd[^)]*\) ",
        rf"({NAME}){DIFFERS}",
        _among(lambda found: filter(_differs, _whole(found))),
    ),
    _each(
        "From one session to the next ",
        rf"({NAME}){CHANGES}",
        _among(lambda found: filter(moves, _whole(found))),
    ),
    _each("the sd between sessions is ", rf"({NAME}) below", _among(_steady)),
    _names(
        rf"The sessions of {LISTED} agree better than by chance",
        lambda found: [one["parameter"] for one in _steady(found) if one["p_value"] > 1.0 - one["level"]],
    ),
    _each(
        "Of the variance between sessions all units have in common, as temperature would make it: ",
        rf"of that of ({NAME})",
        lambda found: [one["parameter"] for one in told(found) if _common(one)],
    ),
    _sized("unit_to_unit", DIFFERS),
    _sized("turn_on", CHANGES),
    Reading(BELOW, partial(_size_of, "turn_on")),
    Reading(
        rf"^({NAME}): sd (below )?({NUM}) \S+ from unit to unit"
        rf"(?:, (below )?({NUM}) \S+ between sessions)?(?:, of (\d+) units)?$",
        _title,
    ),
    Reading(
        rf"({NUM}) % \(({NUM}) to ({NUM})\) of that of ({NAME})(?: \((\d+) of (\d+) sessions off)?", _alike
    ),
    Reading(rf"session (\S+) by ({NUM}) ± ({NUM}) ", _shift),
    Reading(r"(\d+) more parameters are in result\.json", _left_out),
    fixed(r"Intervals hold (90) %"),
    fixed(r"has it with (0\.95) or more"),
    fixed(r"in a further session with (90) %"),
)
