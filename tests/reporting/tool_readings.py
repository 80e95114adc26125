"""What the reports on the tool itself say: how good, fast and exact it is, and what accuracy costs.

Each answer stands in ``result.json`` too: the first screen is held against it word by word, and its numbers
against the values behind them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from report_reading import (
    Block,
    Meant,
    Reading,
    Told,
    drawn,
    fixed,
    named,
    number,
    plain,
    problems,
    readings,
    sentences,
    tree,
    value,
    written,
)

from imubayes.reporting.method_views import called
from studies.decision_quality.scores import RATIOS
from studies.decision_quality.trials import OWN, TREATMENTS

Found = dict[str, Any]
Match = re.Match[str]

NUM = r"[-−]?[\d.,]*\d(?:e-?\d+)?"
TIME = rf"(?:about )?{NUM} (?:ns|µs|ms|s|min|h)"
PERCENT = rf"{NUM} ?%"
RATE = rf"({PERCENT}) \((?:95 %: )?({NUM}) to ({NUM})\)"


def wrong_numbers(
    html: str,
    result: Found,
    readings: Sequence[Reading],
    *,
    told: Callable[[Block], Block | None] = lambda block: block,
) -> list[str]:
    """Numbers of a page that its result does not hold, and sentences of its answer that it does not say.

    How things were counted, and how the page was made, is not asked of the result.

    Parameters
    ----------
    told : a block as it is to be read, or None where it only repeats a text of the result.
    """
    page = tree(html)
    blocks = [*sentences(page), *drawn(page)]
    whole = plain(" ".join(block.text for block in blocks))
    unsaid = [f"not on the page: {text}" for text in result["answer"] if plain(text) not in whole]
    kept = [
        block for block in blocks if block.anchor != "meaning" and plain(result["study"]) not in block.text
    ]
    read = [one for block in kept if block.anchor != "repeat" and (one := told(block))]
    made = [block for block in kept if block.text.startswith("It took") and "imubayes" not in block.text]
    return [*unsaid, *problems(read, readings, result), *problems(made, MADE, result)]


MADE = readings(
    {
        rf"It took ({NUM} (?:s|min|h))": lambda r, m: [r["seconds"]],
        r"with (\d+) processes": lambda r, m: [None],
    }
)


# Speed for accuracy


def wrong_trade(html: str, result: Found) -> list[str]:
    """What a page of speed for accuracy says that its result does not."""
    reasons = {
        plain(f"{one['id']}: {rung} was left out: {why}.")
        for one in result["components"]
        for rung, why in one["skipped"].items()
    }
    return wrong_numbers(html, result, TRADE, told=lambda block: None if block.text in reasons else block)


def _rung(result: Found, name: str) -> Found:
    return named(result["rungs"], name, "rung")


def _score(result: Found, name: str) -> Found:
    return named(result["scores"], name, "rung")


def _held(result: Found, name: str) -> list[float]:
    """Share of the truths that intervals hold, as it is written: '94 % (92 to 96 %)'."""
    share = _score(result, name)["coverage"]["share"]
    return [share["value"], 100.0 * share["low"], share["high"]]


def _of_rung(*keys: str) -> Callable[[Found, Match], Iterable[Meant]]:
    """Numbers of the rung that a phrase names first."""
    return lambda r, m: [None, *(_rung(r, m[1])[key] for key in keys)]


def _decades(result: Found, match: Match) -> Iterable[Meant]:
    first, last = result["rungs"][0], result["rungs"][-1]
    whole, measured = (math.log10(last[key] / first["seconds"]) for key in ("whole_seconds", "seconds"))
    ends = (first["whole_seconds"], last["whole_seconds"])
    return [*ends, whole, measured, first["largest"], first["rms"]]


def _times_as_long(result: Found, long: Found, short: str) -> Iterable[Meant]:
    return [long["whole_seconds"] / _rung(result, result[short])["whole_seconds"]]


def _cut_short(result: Found, match: Match) -> Iterable[Meant]:
    one = named(named(result["components"], match[1], "id")["rungs"], match[2], "rung")
    return [None, None, one["seconds"], one["ess"], None, one["seconds_to_what_was_asked"]]


def _wrong_verdicts(result: Found, match: Match) -> Iterable[Meant]:
    return [_score(result, match[2])["cost"], None, max(one["cost"] for one in result["scores"])]


def _listed(result: Found, match: Match) -> Iterable[Meant]:
    """Inclusions, or wrong verdicts, of a figure by rung."""
    if match.string.startswith("Largest difference of an inclusion"):
        return [None, _rung(result, match[1])["inclusion"]]
    return [None, _score(result, match[1])["cost"]]


TRADE = (
    *readings(
        {
            rf"Take ([\w-]+) \([^)]*\): [^.]*?, ({TIME}); no coefficient is off by more than ({NUM})"
            rf" posterior sd \(({NUM}) is allowed\), no inclusion by more than ({NUM})": lambda r, m: [
                [r["recommended"]],
                *(_rung(r, m[1])[key] for key in ("whole_seconds", "largest")),
                r["good_enough"],
                _rung(r, m[1])["inclusion"],
            ],
            rf"Take ([\w-]+) \([^)]*\): [^.;]*?, ({TIME}); the others are held against it":
                lambda r, m: [[r["recommended"]], _rung(r, m[1])["whole_seconds"]],
            rf"with a Monte Carlo error of up to ({NUM}) posterior sd":
                lambda r, m: [r["monte_carlo_floor"]["largest"]],
            rf"its 90 % intervals hold ({PERCENT}) \(({NUM}) to ({NUM} %)\) of the truths":
                lambda r, m: _held(r, r["recommended"]),
            rf"([\w-]+) \(({TIME})\): a coefficient is off by ({NUM}) posterior sd":
                _of_rung("whole_seconds", "largest"),
            rf"([\w-]+) \(({TIME})\): an inclusion is off by ({NUM})": _of_rung("whole_seconds", "inclusion"),
            rf"([\w-]+) \(({TIME})\): its 90 % intervals hold only ({PERCENT}) of the truths":
                lambda r, m: [None, _rung(r, m[1])["whole_seconds"], _held(r, m[1])[0]],
            rf"From [\w-]+ \(({TIME})\) to [\w-]+ \(({TIME})\) time grows by ({NUM}) decades"
            rf"(?: \(({NUM}) measured\))?; coefficients of the cheapest are off by ({NUM}) posterior sd at"
            rf" most, ({NUM}) rms": _decades,
            rf"({NUM}) times the recommended rung's time":
                lambda r, m: _times_as_long(r, _rung(r, r["default"]), "recommended"),
            rf"would take ({NUM}) times as long": lambda r, m: _times_as_long(r, r["rungs"][-1], "default"),
            rf"change ({NUM}) posterior sd rms \(Monte Carlo error ({NUM})\)":
                lambda r, m: [_rung(r, r["default"])["rms"], r["monte_carlo_floor"]["rms"]],
            rf"(\S+): ([\w-]+) ran for ({TIME}) and has ({NUM}) effective draws \(({NUM}) are asked for\);"
            rf" until .*? it would take about ({TIME})": _cut_short,
            rf"errors fall until ([\w-]+), ({TIME})": _of_rung("whole_seconds"),
            rf"(?:time: |; )([\w-]+) ({TIME}), (<?{NUM}) rms, (<?{NUM}) at most":
                _of_rung("whole_seconds", "rms", "largest"),
            rf"(?:against time: |; )([\w-]+) (<?{NUM})(?=;|$)": _listed,
            rf"(?:intervals: |; )([\w-]+) ({NUM}%)": lambda r, m: [None, _held(r, m[1])[0]],
            rf"Wrong verdicts a sensor: ({NUM}) by ([\w-]+), ({NUM}) at most": _wrong_verdicts,
        }
    ),
    *fixed(r"(90) % interval"),
)  # fmt: skip


# Quality of the decision

UNDER = "|".join(map(plain, TREATMENTS))


def wrong_quality(html: str, result: Found) -> list[str]:
    """What a page on the quality of the decision says that its result does not."""
    skipped = ("kinds", "treatments")
    return wrong_numbers(html, result, QUALITY, told=lambda b: None if b.anchor in skipped else b)


def _treated(result: Found, match: Match, anchor: str) -> Found:
    """Scores of the treatment that a sentence names, or that its section is of; the first is as modelled."""
    overall = [one for one in result["scores"] if not one.get("kind")]
    said = [one for one in overall if f"With {one['treatment']}," in match.string]
    told = said[0] if said else overall[int((re.findall(r"treatment-(\d+)", anchor) or [0])[0])]
    return told | {"effect_edges": result["effect_edges"], "treated": result.get("treated", ())}


def _rate(found: Found) -> list[float]:
    """Value, low and high as they are written: '1.2 % (0.8 to 1.9)'."""
    return [found["value"], 100.0 * found["low"], 100.0 * found["high"]]


def _by_method(told: Found, name: str) -> Found:
    return next(one for one in told["methods"] if called(one["method"]).lower() == name.lower())


def _others(told: Found) -> list[Found]:
    return [one for one in told["methods"] if one["method"] not in OWN]


def _cost(told: Found) -> float:
    """Wrong terms a sensor of the decision."""
    return told["methods"][0]["cost"]["value"]


def _opened(told: Found, match: Match) -> Iterable[Meant]:
    said, best = told["verdicts"], min(_others(told), key=lambda one: one["opened"]["value"])
    return [
        said["left"]["value"],
        said["left_strong"]["value"],
        told["methods"][0]["opened"]["value"],
        None,
        best["opened"]["value"] if called(best["method"]) == match[4] else math.nan,
        *(best["opened_excess"][end] for end in ("value", "low", "high")),
        told.get("nothing", said.get("nothing"))["value"],
    ]


def _false(told: Found) -> dict[str, float]:
    """Share of the zero terms that the decision calls needed under each treatment that has some."""
    return _by_treatment(told, lambda said: said["false_keeps"]["value"])


def _pulls(told: Found) -> dict[str, float]:
    return _by_treatment(told, lambda said: said["rms"])


def _by_treatment(told: Found, of: Callable[[Found], float | None], k: int = 0) -> dict[str, float]:
    found = {one["treatment"]: of(one["verdicts"][k]) for one in told["treated"]}
    return {name: value for name, value in found.items() if value is not None}


def _met(found: dict[str, float], most: float, said: str) -> bool:
    return (said == "yes") == (max(found.values()) <= most)


def _worst(found: dict[str, float], name: str) -> Iterable[Meant]:
    return [None, found[name] if found[name] == max(found.values()) else math.nan]


def _more_open(told: Found, match: Match) -> Iterable[Meant]:
    own, alone = (told["treated"][0]["verdicts"][k]["left"]["events"] for k in (0, 2))
    return [0.05, None, own if (match[2] == "yes") == (own <= 1.05 * alone) else math.nan, alone]


def _strong_missed(told: Found, match: Match) -> Iterable[Meant]:
    found = told["treated"][0]["verdicts"][0]["false_drops"]
    return [found["of"], None, found["events"] if (match[2] == "yes") == (not found["events"]) else math.nan]


def _wrong_choice(told: Found, match: Match) -> Iterable[Meant]:
    best = min(_others(told), key=lambda one: one["cost"]["value"])
    right = called(best["method"]) == match[2]
    return [_cost(told), None, best["cost"]["value"] if right else math.nan]


def _cheapest(told: Found, match: Match) -> Iterable[Meant]:
    own = _by_method(told, match[1])["cost"]["value"]
    return [
        None,
        own if own == min(one["cost"]["value"] for one in (told["methods"][0], *_others(told))) else math.nan,
    ]


def _least(told: Found) -> list[float]:
    """Cost of the cheapest other method over the decision's, by ratio of costs."""
    own = told["methods"][0]["weighed"]
    return [
        min(one["weighed"][k]["value"] for one in _others(told)) / own[k]["value"] for k in range(len(own))
    ]


def _ratio(told: Found, match: Match) -> Iterable[Meant]:
    return [_least(told)[RATIOS.index(float(match[2]))], None]


def _dropped(told: Found, match: Match) -> Iterable[Meant]:
    low = 0.0 if match[1].startswith("below") else float(re.findall(NUM, match[1])[0])
    return [None, told["methods"][0]["false_drops"][told["effect_edges"].index(low)]["value"]]


def _bin(told: Found, match: Match) -> Iterable[Meant]:
    one = min(told["calibration"], key=lambda b: abs(b["inclusion"] - float(match[1])))
    return [one["inclusion"], one["true"]["value"]]


def _bins_off(told: Found, match: Match) -> Iterable[Meant]:
    found = told["calibration"]
    return [sum(not b["true"]["low"] <= b["inclusion"] <= b["true"]["high"] for b in found), len(found)]


QUALITY = (
    *readings(
        {
            rf"Over ({NUM}) simulated sensors the verdict called {RATE} of the ({NUM}) terms that are zero"
            rf" needed, and {RATE} of the ({NUM}) terms above 8 sd not needed": lambda t, m: [
                t["sensors"],
                *_rate(t["verdicts"]["false_keeps"]), t["zero"],
                *_rate(t["verdicts"]["false_drops"]), t["verdicts"]["false_drops"]["of"],
            ],
            rf"({PERCENT}) of the zero terms called needed under each of ({NUM}) treatments: (yes|no)":
                lambda t, m: [0.02, len(t["treated"]) if _met(_false(t), 0.02, m[3]) else math.nan],
            rf"at most ({NUM}) rms under each: (yes|no)":
                lambda t, m: [1.5 if _met(_pulls(t), 1.5, m[2]) else math.nan],
            rf"({PERCENT}) under ({UNDER})": lambda t, m: [_false(t)[m[2]]],
            rf"At most ({PERCENT}) false under ({NUM}) of ({NUM}) treatments": lambda t, m: [
                0.02, sum(share <= 0.02 for share in _false(t).values()), len(_false(t))
            ],
            rf"(?:bench: |; )({UNDER}) ({PERCENT}), ({PERCENT})": lambda t, m: [
                None, *(_by_treatment(t, lambda said: said["false_keeps"]["value"], k)[m[1]] for k in (0, 2))
            ],
            rf"({NUM}) under ({UNDER})": lambda t, m: [_pulls(t)[m[2]]],
            rf"most under ({UNDER}), ({PERCENT})\.": lambda t, m: _worst(_false(t), m[1]),
            rf"most under ({UNDER}), ({NUM})\.(?!\d)": lambda t, m: _worst(_pulls(t), m[1]),
            rf"at most ({PERCENT}) more terms left open[^:]*: (yes|no), ({NUM}) against ({NUM})": _more_open,
            rf"None of the ({NUM}) above 8 sd called not needed there: (yes|no), ({NUM})": _strong_missed,
            rf"It leaves ({PERCENT}) of the terms open \(({PERCENT}) of those above 8 sd\)\. Counted as 0\.05"
            rf" of a wrong term each, that and its errors come to ({NUM}) a sensor\. Of the other methods,"
            rf" given the same option, (.+?) is best with ({NUM}) \(difference ({NUM}), 95 %: ({NUM}) to"
            rf" ({NUM})\); to leave everything open costs ({NUM})": _opened,
            rf"it is wrong in ({NUM}) terms a sensor, the fewest of all methods; the next, (.+?),"
            rf" has ({NUM})": _wrong_choice,
            rf"its ({NUM}) wrong terms a sensor are not the fewest": lambda t, m: [_cost(t)],
            rf"(?:not the fewest: |, | and )([\w -]+) \(({NUM})\)(?=[.,]| and)":
                lambda t, m: [None, _by_method(t, m[1])["cost"]["value"]],
            rf"^({NUM}) sensors, ({NUM}) terms that are zero and ({NUM}) that are not":
                lambda t, m: [t[key] for key in ("sensors", "zero", "true")],
            rf"The decision drops ({PERCENT}) of what is above 8 sd":
                lambda t, m: [t["methods"][0]["false_drops"][-1]["value"]],
            rf"^(.+) costs least: ({NUM}) wrong terms a sensor": _cheapest,
            r"costs least at (\d+) of (\d+) ratios":
                lambda t, m: [sum(ratio >= 1.0 for ratio in _least(t)), len(_least(t))],
            rf"(?:false drops: |noise: |; )(below 1|above 8|\d to \d) sd ({PERCENT})": _dropped,
            rf"(?:a sensor: |; )([^;:]+?) ({NUM})(?=;|$)": lambda t, m: [
                None,
                _by_method(t, m[1])["cost"]["value"] if m.string.startswith("Wrong terms") else None,
            ],
            rf"(?:decision's: |; )({NUM}) where a false keep costs ({NUM})": _ratio,
            r"Inclusion is off in (\d+) of (\d+) bins": _bins_off,
            rf"(?:true terms: |; )({NUM}) ({NUM})(?=;|$)": _bin,
        },
        _treated,
    ),
    *fixed(
        r"(0\.05) of a wrong term",
        r"(?:above|At most) (8|2\.0 %)",
        r"(?:Intervals hold|with|[(,]) ?(95) %",
        r"^(?:below |above )?(\d)(?: to (\d))?$",
        r"below (1) another",
    ),
)  # fmt: skip


# Speed


def wrong_speed(html: str, result: Found) -> list[str]:
    """What a page of times says that its result does not."""
    texts = {one["title"]: f"contest_{k}" for k, one in enumerate(result["contests"])}
    for k, one in enumerate(result["growth"]):
        texts[f"{one['work'][:1].upper()}{one['work'][1:]}: {one['of']}^"] = f"law_{k} ^"

    def named(block: Block) -> Block:
        text = block.text
        for title in sorted(texts, key=len, reverse=True):
            text = text.replace(plain(title), texts[title])
        return Block(block.anchor, text)

    return wrong_numbers(html, result, (*SPEED, *_entrants(result)), told=named)


def _contest(result: Any, text: str) -> Found:
    return result["contests"][int(re.findall(r"contest_(\d+)", text)[0])]


def _entrants(result: Any) -> Iterable[Reading]:
    """A reading for each entrant, by its name: its time, over ours, and its error over ours."""
    for name in sorted({place["name"] for contest in result["contests"] for place in contest["places"]}):

        def meant(r: Any, match: re.Match[str], anchor: str, name: str = name) -> Iterable[Meant]:
            places = _contest(r, match.string)["places"]
            own, one = places[0], next(place for place in places if place["name"] == name)
            ratio = min(one["seconds"]) / min(own["seconds"])
            error = number(one["error"]) / own["error"] if own["error"] else math.nan
            return [min(one["seconds"]), ratio, error]

        yield Reading(
            rf"(?<=[:;,] ){re.escape(name.removeprefix('imubayes, '))}(?: \(wrong\))? ({TIME})"
            rf"(?: \(({NUM}) times ours(?:, with ({NUM}) times the error)?\))?",
            meant,
        )


def _largest(result: Found, match: Match) -> Iterable[Meant]:
    one = max((c for c in result["contests"] if c["subject"] == "enumeration"), key=lambda c: c["size"])
    known, scaled = (min(place["seconds"]) for place in one["places"][:2])
    return [2 ** one["size"], one["size"], known, known / 2 ** one["size"], scaled]


def _law(result: Found, match: Match) -> Iterable[Meant]:
    law = result["growth"][int(match[1])]
    return [None, law["exponent"], max(law["sd"], 0.01)]


def _grown(result: Found, match: Match) -> Iterable[Meant]:
    """Time at a size of the law whose figure this is: the one whose times are nearest."""
    said = next(written(match[2]))[0]
    laws = [law for law in result["growth"] if match.string.startswith(f"Time against {law['of']}:")]
    sized = [pair for law in laws for pair in zip(law["sizes"], law["seconds"], strict=True)]
    times = [min(seconds) for size, seconds in sized if size == value(match[1])]
    return [None, min(times, key=lambda t: abs(t - said), default=math.nan)]


SPEED = (
    *readings(
        {
            rf"({NUM}) models \(2\^(\d+)\) are weighed in ({TIME}) where the noise is known, ({TIME}) a"
            rf" model, and in ({TIME}) with its scale integrated": _largest,
            rf"^contest_\d+: ({TIME})": lambda r, m: [min(_contest(r, m.string)["places"][0]["seconds"])],
            rf"law_(\d+) \^\(({NUM}) ± ({NUM})\)": _law,
            rf"(?:Time against \w+: |; )({NUM}) ({TIME})": _grown,
            r"Shortest of (\d+) turns": lambda r, m: [r["repeats"]],
            rf"of ({NUM}) effective samples": lambda r, m: [1000],
        }
    ),
    *fixed(rf"^({TIME})$"),
)  # fmt: skip


# Extremes


def wrong_extremes(html: str, result: Found) -> list[str]:
    """What a page on the extremes says that its result does not."""
    families = {one["family"]: [] for one in result["cases"]}
    for one in result["cases"]:
        families[one["family"]].append(one)
    refusals = [(one, why) for one in result["cases"] for why in one["refused"]]
    known = {plain(f"{one['family']}, {one['case']}: {why}.") for one, why in refusals}
    known |= {plain(text) for text in families}
    known |= {_all_digits(family, cases) for family, cases in families.items()}
    known |= {re.sub("columns", "X", one["case"].replace("-", "−")) for one in result["cases"]}
    known |= {re.sub("response", "y", text) for text in known}
    figures = readings(dict(_fewest(family, cases) for family, cases in families.items()))
    return wrong_numbers(
        html, result, (*EXTREMES, *figures), told=lambda block: None if block.text in known else block
    )


def _all_digits(family: str, cases: Sequence[Found]) -> str:
    """What stands for a figure of correct digits."""
    said = "; ".join(
        f"{one['case']} " + ", ".join(f"{name} {_digits(one, name)}" for name in one["digits"])
        for one in cases
    )
    return plain(f"Correct digits, {family}: {said}")


def _digits(one: Found, name: str) -> str:
    correct = one["digits"][name]["correct"]
    if correct is None:
        return "!" if name in one["lost"] else "–"
    return f"{math.floor(correct)}"


def _fewest(family: str, cases: Sequence[Found]) -> tuple[str, Told]:
    correct = [told["correct"] for one in cases for told in one["digits"].values()]
    fewest = math.floor(min(one for one in correct if one is not None))
    lost = any(one["lost"] for one in cases)
    return (
        rf"^({re.escape(family)}): at least (\d+) digits",
        lambda r, m: [None, math.nan if lost else fewest],
    )


def _promised(result: Found) -> list[Found]:
    return [
        one
        for one in result["cases"]
        if one["full_rank"] and number(one["condition"]) <= 1e10 and one["family"] != "noise 0"
    ]


def _kept(result: Found, match: Match) -> Iterable[Meant]:
    cases = [one["digits"] for one in _promised(result) if not one["refused"]]
    kept = [min(one[name]["correct"] for one in cases) for name in ("least squares", "averaged", "inclusion")]
    return [math.floor(min(kept[:2])), math.floor(kept[2])]


def _rows(result: Found, match: Match) -> Iterable[Meant]:
    cases = [one for one in _promised(result) if not one["refused"]]
    own = [one["rows"] for one in cases if match[3] is None or one["family"] != "rows"]
    return [min(one["rows"] for one in cases), max(own), max(one["rows"] for one in cases)]


def _claims(result: Found, match: Match) -> Iterable[Meant]:
    answers = sum(
        told["correct"] is not None or name in one["lost"]
        for one in result["cases"]
        for name, told in one["digits"].items()
    )
    silent, lost = (sum(len(one[key]) for one in result["cases"]) for key in ("silent", "lost"))
    return [silent or None, answers, lost or None]


EXTREMES = (
    *readings(
        {
            r"(None|\d+) of (\d+) answers claims more digits than are right, and (none|\d+) is NaN": _claims,
            r"up to a condition number of 1e10 keep at least (\d+) digits of every coefficient, and inclusion"
            r" to 1e-(\d+)": _kept,
            rf"They had ({NUM}) to ({NUM}) rows(?:, and up to ({NUM}) of a short record)?": _rows,
            r"That leaves out (\d+) of (\d+) such problems":
                lambda r, m: [sum(bool(one["refused"]) for one in _promised(r)), len(_promised(r))],
            r"(\d+) problems are refused at least in part":
                lambda r, m: [sum(bool(one["refused"]) for one in r["cases"])],
            r"(\d+) problems went to the ends": lambda r, m: [len(r["cases"])],
        }
    ),
    *fixed(
        r"condition number of (1e10)",
        r"inclusion to (1e-\d+)",
        r"from (0) \(dark\) to (15) \(light\)",
    ),
)  # fmt: skip


# Ranks


def wrong_ranks(html: str, result: Found) -> list[str]:
    """What a page of ranks says that its result does not."""
    return wrong_numbers(html, result, RANKS)


def _count(result: Found, match: Match) -> Iterable[Meant]:
    name = re.findall(r"by rank of (\S+):", match.string)[0]
    return [named(result["quantities"], name)["counts"][match.string.count(";", 0, match.end())]]


RANKS = (
    *readings(
        {
            r"for all (\d+) quantities": lambda r, m: [len(r["quantities"])],
            r"as far as (\d+) simulated campaigns can tell": lambda r, m: [r["campaigns"]],
            rf"The smallest p-value is ({NUM}), of (\S+)\.":
                lambda r, m: [min(one["p_value"] for one in r["quantities"]), None],
            rf"^(\S+): p = ({NUM})": lambda r, m: [None, named(r["quantities"], m[1])["p_value"]],
            r"(?:: |; )(\d+)(?=;|$)": _count,
        }
    ),
    *fixed(r"below all \((0)\) to above all \((1)\)", r"in (99) % of cases"),
)  # fmt: skip
