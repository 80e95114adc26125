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
    drawn,
    fixed,
    number,
    plain,
    problems,
    sentences,
    tree,
    written,
)

from imubayes.reporting.method_words import called
from studies.decision_quality.trials import DECISION, SURE

NUM = r"[-−]?[\d.,]*\d(?:e-?\d+)?"
TIME = rf"(?:about )?{NUM} (?:ns|µs|ms|s|min|h)"
PERCENT = rf"{NUM} ?%"
RATE = rf"({PERCENT}) \((?:95 %: )?({NUM}) to ({NUM})\)"


def wrong_numbers(
    html: str,
    result: dict[str, Any],
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
    first = plain(" ".join(block.text for block in blocks if block.anchor in ("", "first", "nav")))
    unsaid = [f"not on the first screen: {text}" for text in result["answer"] if plain(text) not in first]
    kept = [
        block for block in blocks if block.anchor != "meaning" and plain(result["study"]) not in block.text
    ]
    read = [one for block in kept if block.anchor != "repeat" and (one := told(block))]
    made = [block for block in kept if block.text.startswith("It took") and "imubayes" not in block.text]
    return [*unsaid, *problems(read, readings, result), *problems(made, MADE, result)]


def _times(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [result["seconds"]]


MADE = (
    Reading(rf"It took ({NUM} (?:s|min|h))", _times),
    Reading(r"with (\d+) processes", lambda r, m, a: [None]),
)


# Speed for accuracy


def wrong_trade(html: str, result: dict[str, Any]) -> list[str]:
    """What a page of speed for accuracy says that its result does not."""
    reasons = {
        plain(f"{one['id']}: {rung} was left out: {why}.")
        for one in result["components"]
        for rung, why in one["skipped"].items()
    }
    return wrong_numbers(html, result, TRADE, told=lambda block: None if block.text in reasons else block)


def _rung(result: Any, name: str) -> dict[str, Any]:
    return next(one for one in result["rungs"] if one["rung"] == name)


def _score(result: Any, name: str) -> dict[str, Any]:
    return next(one for one in result["scores"] if one["rung"] == name)


def _held(result: Any, name: str) -> list[float]:
    share = _score(result, name)["coverage"]["share"]
    return [share["value"], share["low"], share["high"]]


def _decades(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    first, last = result["rungs"][0], result["rungs"][-1]
    whole, measured = (math.log10(last[key] / first["seconds"]) for key in ("whole_seconds", "seconds"))
    ends = (first["whole_seconds"], last["whole_seconds"])
    return [*ends, whole, measured, first["largest"], first["rms"]]


def _against_best(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    default, last = _rung(result, result["default"]), result["rungs"][-1]
    return [last["whole_seconds"] / default["whole_seconds"]]


def _default_time(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    times = [_rung(result, result[name])["whole_seconds"] for name in ("default", "recommended")]
    return [times[0] / times[1]]


def _cut_short(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    component = next(one for one in result["components"] if one["id"] == match[1])
    one = next(one for one in component["rungs"] if one["rung"] == match[2])
    return [None, None, one["seconds"], one["ess"], None, one["seconds_to_what_was_asked"]]


def _wrong_verdicts(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [_score(result, match[2])["cost"], None, max(one["cost"] for one in result["scores"])]


def _listed(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Inclusions, or wrong verdicts, of a figure by rung."""
    if match.string.startswith("Largest difference of an inclusion"):
        return [None, _rung(result, match[1])["inclusion"]]
    return [None, _score(result, match[1])["cost"]]


TRADE = (
    Reading(
        rf"Take ([\w-]+) \([^)]*\): [^.]*?, ({TIME}); no coefficient is off by more than ({NUM}) posterior sd"
        rf" \(({NUM}) is allowed\), no inclusion by more than ({NUM})",
        lambda r, m, a: [
            [r["recommended"]],
            *(_rung(r, m[1])[key] for key in ("whole_seconds", "largest")),
            r["good_enough"],
            _rung(r, m[1])["inclusion"],
        ],
    ),
    Reading(rf"Take ([\w-]+) \([^)]*\): [^.;]*?, ({TIME}); the others are held against it",
            lambda r, m, a: [[r["recommended"]], _rung(r, m[1])["whole_seconds"]]),
    Reading(rf"with a Monte Carlo error of up to ({NUM}) posterior sd",
            lambda r, m, a: [r["monte_carlo_floor"]["largest"]]),
    Reading(rf"its 90 % intervals hold ({PERCENT}) \(({NUM}) to ({NUM} %)\) of the truths",
            lambda r, m, a: [*_percents(_held(r, r["recommended"]))]),
    Reading(rf"([\w-]+) \(({TIME})\): a coefficient is off by ({NUM}) posterior sd",
            lambda r, m, a: [None, _rung(r, m[1])["whole_seconds"], _rung(r, m[1])["largest"]]),
    Reading(rf"([\w-]+) \(({TIME})\): an inclusion is off by ({NUM})",
            lambda r, m, a: [None, _rung(r, m[1])["whole_seconds"], _rung(r, m[1])["inclusion"]]),
    Reading(rf"([\w-]+) \(({TIME})\): its 90 % intervals hold only ({PERCENT}) of the truths",
            lambda r, m, a: [None, _rung(r, m[1])["whole_seconds"], _held(r, m[1])[0]]),
    Reading(
        rf"From [\w-]+ \(({TIME})\) to [\w-]+ \(({TIME})\) time grows by ({NUM}) decades"
        rf"(?: \(({NUM}) measured\))?; coefficients of the cheapest are off by ({NUM}) posterior sd at most,"
        rf" ({NUM}) rms",
        _decades,
    ),
    Reading(rf"({NUM}) times the recommended rung's time", _default_time),
    Reading(rf"would take ({NUM}) times as long", _against_best),
    Reading(rf"change ({NUM}) posterior sd rms \(Monte Carlo error ({NUM})\)",
            lambda r, m, a: [_rung(r, r["default"])["rms"], r["monte_carlo_floor"]["rms"]]),
    Reading(
        rf"(\S+): ([\w-]+) ran for ({TIME}) and has ({NUM}) effective draws \(({NUM}) are asked for\);"
        rf" until .*? it would take about ({TIME})",
        _cut_short,
    ),
    Reading(rf"errors fall until ([\w-]+), ({TIME})",
            lambda r, m, a: [None, _rung(r, m[1])["whole_seconds"]]),
    Reading(rf"(?:time: |; )([\w-]+) ({TIME}), (<?{NUM}) rms, (<?{NUM}) at most",
            lambda r, m, a: [None, *(_rung(r, m[1])[key] for key in ("whole_seconds", "rms", "largest"))]),
    Reading(rf"(?:against time: |; )([\w-]+) (<?{NUM})(?=;|$)", _listed),
    Reading(rf"(?:intervals: |; )([\w-]+) ({NUM}%)", lambda r, m, a: [None, _held(r, m[1])[0]]),
    Reading(rf"Wrong verdicts a sensor: ({NUM}) by ([\w-]+), ({NUM}) at most", _wrong_verdicts),
    fixed(r"(90) % interval"),
)  # fmt: skip


def _percents(share: Sequence[float]) -> list[float]:
    """Value, low and high of a share as they are written: '94 % (92 to 96 %)'."""
    return [share[0], 100.0 * share[1], share[2]]


# Quality of the decision


def wrong_quality(html: str, result: dict[str, Any]) -> list[str]:
    """What a page on the quality of the decision says that its result does not."""
    return wrong_numbers(html, result, QUALITY, told=lambda block: None if block.anchor == "kinds" else block)


def _treated(result: Any, match: re.Match[str], anchor: str) -> dict[str, Any]:
    """Scores of the treatment that a sentence names, or that its section is of; the first is as modelled."""
    overall = [one for one in result["scores"] if not one["kind"]]
    named = [one for one in overall if f"With {one['treatment']}," in match.string]
    return named[0] if named else overall[int((re.findall(r"treatment-(\d+)", anchor) or [0])[0])]


def _rate(found: dict[str, Any]) -> list[float]:
    """Value, low and high as they are written: '1.2 % (0.8 to 1.9)'."""
    return [found["value"], 100.0 * found["low"], 100.0 * found["high"]]


def _by_method(told: dict[str, Any], name: str) -> dict[str, Any]:
    return next(one for one in told["methods"] if called(one["method"]).lower() == name.lower())


def _others(told: dict[str, Any]) -> list[dict[str, Any]]:
    return [one for one in told["methods"] if one["method"] not in (DECISION, SURE)]


def _opened(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    told = _treated(result, match, anchor)
    said, best = told["verdicts"], min(_others(told), key=lambda one: one["opened"]["value"])
    apart = best["opened_excess"]
    right = called(best["method"]) == match[4]
    return [
        said["left"]["value"],
        said["left_strong"]["value"],
        told["methods"][0]["opened"]["value"],
        None,
        best["opened"]["value"] if right else math.nan,
        *(apart[end] for end in ("value", "low", "high")),
        said["nothing"]["value"],
    ]


def _claimed(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    what = "false_keeps" if match[1].startswith("of the zero") else "false_drops"
    found = _treated(result, match, anchor)["verdicts"][what]
    yes = found["value"] <= 0.02
    right = match[2] == ("yes" if yes else "no")
    return [None, None, found["value"] if right else math.nan, found["high"]]


def _wrong_choice(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    told = _treated(result, match, anchor)
    best = min(_others(told), key=lambda one: one["cost"]["value"])
    right = called(best["method"]) == match[2]
    return [told["methods"][0]["cost"]["value"], None, best["cost"]["value"] if right else math.nan]


def _cheapest(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    costs = [one["cost"]["value"] for one in _treated(result, match, anchor)["methods"]]
    own = _by_method(_treated(result, match, anchor), match[1])["cost"]["value"]
    return [None, own if own == min(costs) else math.nan]


def _dear(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    careful = _treated(result, match, anchor)["careful"]
    one = next((one for one in careful if one["false_keeps"]["value"] <= 0.02), careful[-1])
    return [one["ratio"], *_rate(one["false_keeps"])]


def _ratios_won(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    least = _least(_treated(result, match, anchor))
    return [sum(ratio >= 1.0 for ratio in least), len(least)]


def _least(told: dict[str, Any]) -> list[float]:
    """Cost of the cheapest other method over the decision's, by ratio of costs."""
    own = told["methods"][0]["weighed"]
    return [
        min(one["weighed"][k]["value"] for one in _others(told)) / own[k]["value"] for k in range(len(own))
    ]


def _ratio(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    told = _treated(result, match, anchor)
    k = [one["ratio"] for one in told["careful"]].index(float(match[2]))
    return [_least(told)[k], None]


def _dropped(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    low = 0.0 if match[1].startswith("below") else float(re.findall(NUM, match[1])[0])
    k = result["effect_edges"].index(low)
    return [None, _treated(result, match, anchor)["methods"][0]["false_drops"][k]["value"]]


def _bin(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = _treated(result, match, anchor)["calibration"]
    nearest = min(found, key=lambda b: abs(b["inclusion"] - float(match[1])))
    return [nearest["inclusion"], nearest["true"]["value"]]


def _bins_off(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = _treated(result, match, anchor)["calibration"]
    off = sum(not b["true"]["low"] <= b["inclusion"] <= b["true"]["high"] for b in found)
    return [off, len(found)]


QUALITY = (
    Reading(
        rf"Over ({NUM}) simulated sensors the verdict called {RATE} of the ({NUM}) terms that are zero"
        rf" needed, and {RATE} of the ({NUM}) terms above 8 sd not needed",
        lambda r, m, a: [
            (told := _treated(r, m, a))["sensors"],
            *_rate(told["verdicts"]["false_keeps"]), told["zero"],
            *_rate(told["verdicts"]["false_drops"]), told["verdicts"]["false_drops"]["of"],
        ],
    ),
    Reading(rf"At most 2\.0 % (of the zero|above 8 sd)[^.:]*: (yes|no)(?:, ({PERCENT}))?"
            rf"(?:, but the interval reaches ({PERCENT}))?", _claimed),
    Reading(
        rf"It leaves ({PERCENT}) of the terms open \(({PERCENT}) of those above 8 sd\)\. Counted as 0\.05"
        rf" of a wrong term each, that and its errors come to ({NUM}) a sensor\. Of the other methods, given"
        rf" the same option, (.+?) is best with ({NUM}) \(difference ({NUM}), 95 %: ({NUM}) to ({NUM})\);"
        rf" to leave everything open costs ({NUM})",
        _opened,
    ),
    Reading(rf"it is wrong in ({NUM}) terms a sensor, the fewest of all methods; the next, (.+?),"
            rf" has ({NUM})", _wrong_choice),
    Reading(rf"it is wrong in ({NUM}) terms a sensor, (?!the fewest)(.+?) in ({NUM})", _wrong_choice),
    Reading(rf"its ({NUM}) wrong terms a sensor are not the fewest",
            lambda r, m, a: [_treated(r, m, a)["methods"][0]["cost"]["value"]]),
    Reading(rf"(?:not the fewest: |, | and )([\w -]+) \(({NUM})\)(?=[.,]| and)",
            lambda r, m, a: [None, _by_method(_treated(r, m, a), m[1])["cost"]["value"]]),
    Reading(rf"one half or more, keeps {RATE} of the zero terms",
            lambda r, m, a: _rate(_treated(r, m, a)["methods"][0]["false_keeps"])),
    Reading(rf"If a false keep costs ({NUM}) times a false drop, it keeps {RATE}", _dear),
    Reading(rf"it calls {RATE} of the zero terms needed, {RATE} above 8 sd not needed",
            lambda r, m, a: [*_rate(_treated(r, m, a)["verdicts"]["false_keeps"]),
                             *_rate(_treated(r, m, a)["verdicts"]["false_drops"])]),
    Reading(rf"^({NUM}) sensors, ({NUM}) terms that are zero and ({NUM}) that are not",
            lambda r, m, a: [_treated(r, m, a)[key] for key in ("sensors", "zero", "true")]),
    Reading(rf"The decision drops ({PERCENT}) of what is above 8 sd",
            lambda r, m, a: [_treated(r, m, a)["methods"][0]["false_drops"][-1]["value"]]),
    Reading(rf"^(.+) costs least: ({NUM}) wrong terms a sensor", _cheapest),
    Reading(r"costs least at (\d+) of (\d+) ratios", _ratios_won),
    Reading(rf"(?:false drops: |noise: |; )(below 1|above 8|\d to \d) sd ({PERCENT})", _dropped),
    Reading(rf"(?:a sensor: |; )([^;:]+?) ({NUM})(?=;|$)",
            lambda r, m, a: [None, _by_method(_treated(r, m, a), m[1])["cost"]["value"]]
            if m.string.startswith("Wrong terms") else [None, None]),
    Reading(rf"(?:decision's: |; )({NUM}) where a false keep costs ({NUM})", _ratio),
    Reading(r"Inclusion is off in (\d+) of (\d+) bins", _bins_off),
    Reading(rf"(?:true terms: |; )({NUM}) ({NUM})(?=;|$)", _bin),
    fixed(r"(0\.05) of a wrong term"),
    fixed(r"(?:above|At most) (8|2\.0 %)"),
    fixed(r"(?:Intervals hold|with|[(,]) ?(95) %"),
    fixed(r"^(?:below |above )?(\d)(?: to (\d))?$"),
    fixed(r"below (1) another"),
)  # fmt: skip


# Speed


def wrong_speed(html: str, result: dict[str, Any]) -> list[str]:
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


def _contest(result: Any, text: str) -> dict[str, Any]:
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


def _largest(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = max((c for c in result["contests"] if c["subject"] == "enumeration"), key=lambda c: c["size"])
    known, scaled = (min(place["seconds"]) for place in one["places"][:2])
    return [2 ** one["size"], one["size"], known, known / 2 ** one["size"], scaled]


def _law(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    law = result["growth"][int(match[1])]
    return [None, law["exponent"], max(law["sd"], 0.01)]


def _grown(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Time at a size of the law whose figure this is: the one whose times are nearest."""
    size = float(match[1].replace(",", ""))
    said = next(written(match[2]))[0]
    laws = [law for law in result["growth"] if match.string.startswith(f"Time against {law['of']}:")]
    times = [min(t) for law in laws for n, t in zip(law["sizes"], law["seconds"], strict=True) if n == size]
    return [None, min(times, key=lambda t: abs(t - said), default=math.nan)]


SPEED = (
    Reading(
        rf"({NUM}) models \(2\^(\d+)\) are weighed in ({TIME}) where the noise is known, ({TIME}) a model,"
        rf" and in ({TIME}) with its scale integrated",
        _largest,
    ),
    Reading(rf"^contest_\d+: ({TIME})",
            lambda r, m, a: [min(_contest(r, m.string)["places"][0]["seconds"])]),
    Reading(rf"law_(\d+) \^\(({NUM}) ± ({NUM})\)", _law),
    Reading(rf"(?:Time against \w+: |; )({NUM}) ({TIME})", _grown),
    fixed(rf"^({TIME})$"),
    Reading(r"Shortest of (\d+) turns", lambda r, m, a: [r["repeats"]]),
    Reading(r"of ({NUM}) effective samples".replace("{NUM}", NUM), lambda r, m, a: [1000]),
)  # fmt: skip


# Extremes


def wrong_extremes(html: str, result: dict[str, Any]) -> list[str]:
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
    figures = [_fewest(family, cases) for family, cases in families.items()]
    return wrong_numbers(
        html, result, (*EXTREMES, *figures), told=lambda block: None if block.text in known else block
    )


def _all_digits(family: str, cases: Sequence[dict[str, Any]]) -> str:
    """What stands for a figure of correct digits."""
    said = "; ".join(
        f"{one['case']} " + ", ".join(f"{name} {_digits(one, name)}" for name in one["digits"])
        for one in cases
    )
    return plain(f"Correct digits, {family}: {said}")


def _digits(one: dict[str, Any], name: str) -> str:
    correct = one["digits"][name]["correct"]
    if correct is None:
        return "!" if name in one["lost"] else "–"
    return f"{math.floor(correct)}"


def _fewest(family: str, cases: Sequence[dict[str, Any]]) -> Reading:
    correct = [
        told["correct"] for one in cases for told in one["digits"].values() if told["correct"] is not None
    ]
    return Reading(
        rf"^({re.escape(family)}): at least (\d+) digits",
        lambda r, m, a: [None, math.nan if any(one["lost"] for one in cases) else math.floor(min(correct))],
    )


def _promised(result: Any) -> list[dict[str, Any]]:
    return [
        one
        for one in result["cases"]
        if one["full_rank"] and number(one["condition"]) <= 1e10 and one["family"] != "noise 0"
    ]


def _kept(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    cases = [one["digits"] for one in _promised(result) if not one["refused"]]
    kept = [min(one[name]["correct"] for one in cases) for name in ("least squares", "averaged", "inclusion")]
    return [math.floor(min(kept[:2])), math.floor(kept[2])]


def _rows(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    cases = [one for one in _promised(result) if not one["refused"]]
    own = [one["rows"] for one in cases if match[3] is None or one["family"] != "rows"]
    return [min(one["rows"] for one in cases), max(own), max(one["rows"] for one in cases)]


def _claims(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    answers = sum(
        told["correct"] is not None or name in one["lost"]
        for one in result["cases"]
        for name, told in one["digits"].items()
    )
    silent = sum(len(one["silent"]) for one in result["cases"])
    lost = sum(len(one["lost"]) for one in result["cases"])
    return [*(None if count == 0 else count for count in (silent,)), answers, None if lost == 0 else lost]


def _refused(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    promised = _promised(result)
    return [sum(bool(one["refused"]) for one in promised), len(promised)]


EXTREMES = (
    Reading(r"(None|\d+) of (\d+) answers claims more digits than are right, and (none|\d+) is NaN", _claims),
    Reading(r"up to a condition number of 1e10 keep at least (\d+) digits of every coefficient, and inclusion"
            r" to 1e-(\d+)", _kept),
    Reading(rf"They had ({NUM}) to ({NUM}) rows(?:, and up to ({NUM}) of a short record)?", _rows),
    Reading(r"That leaves out (\d+) of (\d+) such problems", _refused),
    Reading(r"(\d+) problems are refused at least in part",
            lambda r, m, a: [sum(bool(one["refused"]) for one in r["cases"])]),
    Reading(r"(\d+) problems went to the ends", lambda r, m, a: [len(r["cases"])]),
    fixed(r"condition number of (1e10)"),
    fixed(r"inclusion to (1e-\d+)"),
    fixed(r"from (0) \(dark\) to (15) \(light\)"),
)  # fmt: skip


# Ranks


def wrong_ranks(html: str, result: dict[str, Any]) -> list[str]:
    """What a page of ranks says that its result does not."""
    return wrong_numbers(html, result, RANKS)


def _quantity(result: Any, name: str) -> dict[str, Any]:
    return next(one for one in result["quantities"] if one["name"] == name)


def _count(result: Any, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    name = re.findall(r"by rank of (\S+):", match.string)[0]
    return [_quantity(result, name)["counts"][match.string.count(";", 0, match.end())]]


RANKS = (
    Reading(r"for all (\d+) quantities", lambda r, m, a: [len(r["quantities"])]),
    Reading(r"as far as (\d+) simulated campaigns can tell", lambda r, m, a: [r["campaigns"]]),
    Reading(rf"The smallest p-value is ({NUM}), of (\S+)\.",
            lambda r, m, a: [min(one["p_value"] for one in r["quantities"]), None]),
    Reading(rf"^(\S+): p = ({NUM})", lambda r, m, a: [None, _quantity(r, m[1])["p_value"]]),
    Reading(r"(?:: |; )(\d+)(?=;|$)", _count),
    fixed(r"below all \((0)\) to above all \((1)\)"),
    fixed(r"in (99) % of cases"),
)  # fmt: skip
