"""What a report on sensors says, and where each number of it stands in ``result.json``.

Counts and lists are worked out from the terms' verdicts, sizes from their SI values: a second route to what
the report was made from.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from report_reading import (
    Block,
    Meant,
    Reading,
    agrees,
    drawn,
    fixed,
    number,
    plain,
    problems,
    sentences,
    tree,
    written,
)
from session_readings import is_of_class, wrong_population
from study_phrases import NUM, SAID, SHARE, TERM, UNHELD, P

from imubayes.reporting.method_words import spoken
from imubayes.reporting.noise_views import process_units
from imubayes.reporting.rounding import OUTPUT_SI, OUTPUT_UNIT, per_unit

VERDICTS = {
    "needed": "needed",
    "not needed": "not needed",
    "undecided": "undecided",
    "inseparable": "inseparable in this test",
    "unresolved": "unresolved",
    "untested": "untested",
}
"""Verdicts, and how the first paragraph counts them."""

UNREAD = ("appendices", "runs", "repeat", "sessions")
"""Sections that are the study's own words, lists of files and versions, or tables."""


class Sensors:
    """Result of a study of sensors, by the anchors of its report."""

    def __init__(self, result: dict[str, Any]) -> None:
        self.sensors: list[dict[str, Any]] = result["sensors"]
        self.cases: list[dict[str, Any]] = result.get("cases", [])
        self.by_id = {one["id"]: one for one in self.sensors}

    def at(self, match: re.Match[str], anchor: str) -> dict[str, Any]:
        """Sensor that a text is of: that of its section, else the one that it names first."""
        found = re.match(r"s(\d+)(?:-|$)", anchor)
        if found:
            return self.sensors[int(found[1]) - 1]
        text = match.string.removeprefix("Noise of ")
        named = [name for name in self.by_id if text.startswith((f"{name} (", f"{name}, ", f"{name}:"))]
        return self.by_id[max(named, key=len)]

    def case(self, anchor: str, text: str) -> dict[str, Any]:
        """Case that a text is of."""
        found = re.match(r"case(\d+)", anchor)
        if found:
            return self.cases[int(found[1]) - 1]
        return next(one for one in self.cases if text.startswith(f"{one['id']} as a whole"))


def verdicts(sensor: dict[str, Any], verdict: str) -> list[str]:
    """Terms of a verdict."""
    return [term["name"] for term in sensor["terms"] if term["verdict"] == verdict]


def _term(sensor: dict[str, Any], name: str) -> dict[str, Any]:
    return next(term for term in sensor["terms"] if term["name"] == name)


def _unit(term: dict[str, Any]) -> float:
    return per_unit(term["printed_unit"], term["unit"])


def _output(sensor: dict[str, Any]) -> float:
    """SI value of the unit in which effects on the output are printed."""
    return per_unit(OUTPUT_UNIT[sensor["kind"]], OUTPUT_SI[sensor["kind"]])


def _counted(verdict: str) -> Reading:
    """The count of a verdict in a first paragraph, and the terms that stand behind it in brackets."""

    def meant(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
        found = verdicts(r.at(match, anchor), verdict)
        said = match[2]
        return [len(found), None if said is None or said.endswith("and others") else found]

    said = r"(?: \(([^()]*(?:\([^()]*\))?[^()]*)\))?"
    return Reading(rf"(?<=\. )(\d+) (?:is|are) {VERDICTS[verdict]}{said}(?=[:., ])", meant)


def _needed(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    needed = verdicts(sensor, "needed")
    return [len(needed), len(sensor["terms"]), needed]


def _needed_title(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    return [len(verdicts(sensor, "needed")), len(sensor["terms"])]


def _width(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    low, high = _term(r.at(match, anchor), match[1])["inclusion_range"]
    return [None, low, high]


def _likely(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Candidates of one half or more that a run excites."""
    sensor = r.at(match, anchor)
    return [
        [t["name"] for t in sensor["terms"] if t["inclusion"] >= 0.5 and t["verdict"] != "untested"],
    ]


def _best_models(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    best = r.at(match, anchor)["best_models"]
    return [len(best), math.fsum(one["probability"] for one in best)]


def _disagree(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Terms that between 5 and 95 % of the best models, by their probability, hold."""
    sensor = r.at(match, anchor)
    total = math.fsum(one["probability"] for one in sensor["best_models"])
    held = {
        name: math.fsum(one["probability"] for one in sensor["best_models"] if name in one["terms"]) / total
        for name in sensor["candidates"]
    }
    varied = [name for name, share in held.items() if 0.05 < share < 0.95]
    return [len(varied) if re.match(r"\d", match[1]) else varied]


def _fit(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    checks, samples = sensor["residuals"], {run["name"]: run["samples"] for run in sensor["runs"]}
    weights = [samples.get(one["run"], 1) for one in checks]
    squares = math.fsum(w * one["scale"] ** 2 for w, one in zip(weights, checks, strict=True))
    scale = math.sqrt(squares / math.fsum(weights))
    return [
        scale if all(one["fits"] for one in checks) else math.nan,
        min(number(one["whiteness_p"]) for one in checks),
    ]


def _misfit(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    one = next(one for one in r.at(match, anchor)["residuals"] if one["run"] == match[1])
    count = len(one["outliers"])
    sizes = [abs(outlier["size"]) for outlier in one["outliers"]]
    return [
        None,
        math.nan if one["fits"] else one["scale"],
        one["whiteness_p"],
        count if count else math.nan,
        max(sizes, default=math.nan),
    ]


def _level(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    return [r.at(match, anchor)["residuals"][0]["level"]]


def _run_title(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Scale and outlying blocks of a run: the one whose scale it is."""
    checks = r.at(match, anchor)["residuals"]
    one = min(checks, key=lambda check: abs(check["scale"] - float(match[1])))
    return [one["scale"], len(one["outliers"]) if match[2] else None]


def _white_title(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    checks = r.at(match, anchor)["residuals"]
    ps = [number(one["whiteness_p"]) for one in checks]
    if match[1].startswith("<"):
        return [min(ps)]
    return [min(ps, key=lambda p: abs(p - float(match[1])))]


def _posterior(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    term = _term(r.at(match, anchor), match[1])
    unit, power = _unit(term), float(f"1e{(match[4] or '0').replace('−', '-')}")
    sd = term["sd"] / unit / power
    away = abs(term["mean"]) / term["sd"] if term["verdict"] == "needed" else math.nan
    right = match[5] is not None or match[6] in (term["verdict"], None)
    mean = term["mean"] / unit / power
    (said, _), (_, half) = *written(match[2]), *written(match[3])
    near = abs(said - mean) <= 1.02 * half
    return [None, None if near and right else mean if right else math.nan, sd, None, away, None]


def _inclusion(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    term = _term(r.at(match, anchor), match[1])
    return [None, term["inclusion"] if term["verdict"] == match[3] else math.nan, None]


def _by_size(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    values = r.at(match, anchor)["by_size"]
    return [None, number(values[int(match[1])]) - max(v for v in values if v is not None)]


def _likely_size(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    values = [number(v) for v in r.at(match, anchor)["by_size"]]
    best = max(v for v in values if not math.isnan(v))
    weights = [0.0 if math.isnan(v) else math.exp(v - best) for v in values]
    size = weights.index(max(weights))
    return [size, weights[size] / math.fsum(weights)]


def _model(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    best = r.at(match, anchor)["best_models"]
    one = next(one for one in best if sorted(one["terms"]) == sorted(match[2].split()))
    return [one["probability"], None]


def _votes(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    votes = sensor["votes"]
    k = votes["terms"].index(match[1])
    right = _term(sensor, match[1])["verdict"] == match[4]
    kept = sum(number(one[k]) == 1.0 for one in votes["keeps"].values())
    of = sum(one[k] is not None for one in votes["keeps"].values())
    return [None, kept if right else math.nan, of, None]


def _all_methods(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    told = verdicts(sensor, "needed") + verdicts(sensor, "not needed") + verdicts(sensor, "undecided")
    kept = [name for name in told if _keeping(sensor, name)]
    return [len(sensor["votes"]["keeps"]), len(kept)]


def _keeping(sensor: dict[str, Any], name: str) -> int:
    """Methods that keep a term."""
    votes = sensor["votes"]
    k = votes["terms"].index(name) if name in votes["terms"] else None
    return 0 if k is None else sum(one[k] == 1.0 for one in votes["keeps"].values())


def _in_common(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Terms that the test can tell and every method keeps."""
    sensor = r.at(match, anchor)
    of = len(sensor["votes"]["keeps"])
    told = verdicts(sensor, "needed") + verdicts(sensor, "not needed") + verdicts(sensor, "undecided")
    return [of, sum(_keeping(sensor, name) == of for name in told)]


def _keepers(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    return [_keeping(sensor, match[3]), len(sensor["votes"]["keeps"]), None]


def _cannot_tell(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    return [len(verdicts(sensor, "inseparable")) + len(verdicts(sensor, "unresolved"))]


def _degree(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Highest power of temperature in the library."""
    powers = [re.fullmatch(r".*\*T(\d?)", term["name"]) for term in r.at(match, anchor)["terms"]]
    return [max(int(found[1] or 1) for found in powers if found)]


def _outlying(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sizes = [o["size"] for one in r.at(match, anchor)["residuals"] for o in one["outliers"]]
    said = float(match[1].replace("−", "-"))
    return [min(sizes, key=lambda size: abs(size - said))]


def _leaning(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Distance from zero as the reason of the verdict has it."""
    reason = _term(r.at(match, anchor), match[1].split(", ")[0])["reason"]
    return [None, float(re.findall(rf"({NUM}) sd from zero", reason)[0])]


def _sparse(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    return [None, sensor["sindy"][match[1].lower()]["strength"]]


def _reduced(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    found, unit = sensor["reduced"], _output(sensor)
    return [len(found["terms"]), found["terms"], found["lost"] / unit, found["budget"] / unit]


def _nothing(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    found, unit = sensor["reduced"], _output(sensor)
    return [found["path"][0]["lost"] / unit, found["budget"] / unit]


def _within(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    return [len(sensor["reduced"]["terms"]), sensor["reduced"]["budget"] / _output(sensor)]


def _lost(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Loss of a place on the way to the smallest model: that which is nearest in order."""
    sensor = r.at(match, anchor)
    k = len(re.findall(r", (?=\+|best)", match.string[: match.end()]))
    one = sensor["reduced"]["path"][k]
    return [len(one["terms"]), one["lost"] / _output(sensor)]


def _dependence(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    found = sensor["misfit"]["found"]
    unit = _output(sensor)
    said = float(match[1].replace(",", ""))
    one = min(found, key=lambda one: abs(one["size"] / unit - said))
    return [one["size"] / unit, one["share"], one["p"]][: len(match.groups())]


def _replicated(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    ps = r.at(match, anchor)["misfit"]["predictive_p"].values()
    return [min(ps), max(ps)]


def _any(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    groups = r.at(match, anchor)["groups"]
    named = re.split(r", | and ", match[1])
    one = next(one for one in groups if sorted(one["terms"]) == sorted(named))
    return [None, one["any_inclusion"]]


def _process(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Size of a noise process: of the run that shows these."""
    sensor = r.at(match, anchor)
    unit, si = process_units(sensor["kind"])[match[1]]
    scale = per_unit(unit, si) * float(f"1e{match[4] or 0}")
    said = float(match[2])
    runs = [run["processes"][match[1]] for run in sensor["noise_processes"].values()]
    one = min(runs, key=lambda one: abs(one["mean"] / scale - said))
    right = one["verdict"] == "needed"
    return [None, one["mean"] / scale if right else math.nan, one["sd"] / scale, None]


def _none_of(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Noise processes of a verdict, in the run that a sentence is of."""
    word = {"Not there": "not needed", "Undecided": "undecided"}.get(match[1], "unresolved")
    runs = r.at(match, anchor)["noise_processes"].values()
    found = [
        [n for n, one in run["processes"].items() if one["verdict"] == word and n != "tau"] for run in runs
    ]
    said = sorted(match[2].split(", "))
    return [None, min(found, key=lambda names: sorted(names) != said)]


# A case as a whole

RAW, FORCE = "Length of the force in the stills, from local g", "The force in the "
WHAT = {
    RAW: "gravity",
    "Rates in the stills": "rest",
    "Up carried through the turns": "closure",
    "Angles of the known turns": "turn",
    "|f| − g": "gravity",
    "rate": "rest",
    "error of up": "closure",
    "error of the turn": "turn",
}
"""Names of the known quantities, in sentences and in figures."""

SIZES = {"mg": ("mg", "m/s^2"), "°/s": ("deg/s", "rad/s"), "°": ("deg", "rad")}


def _size(said: str, value: float | None) -> float:
    """Value in the unit in which a size is said."""
    unit = re.sub(rf"^{NUM} ?", "", said)
    return number(value) / per_unit(*SIZES[unit])


def _row(r: Sensors, match: re.Match[str], anchor: str, what: str) -> dict[str, Any]:
    rows = [one for one in r.case(anchor, match.string)["recovered"] if one["what"] == what]
    if len(rows) > 1:
        rows = [one for one in rows if agrees(match[2], _size(match[2], one["rms"]["after"]))] or rows
    return rows[0]


def _changed(r: Sensors, match: re.Match[str], anchor: str, *, what: str) -> Iterable[Meant]:
    row = _row(r, match, anchor, what)
    predicted = row["rms"]["fresh" if row["saturated"] else "fitted"]
    sizes = (row["rms"]["before"], row["rms"]["after"], predicted)
    return [_size(match[k], size) for k, size in enumerate(sizes, start=1)]


def _force(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    row = _row(r, match, anchor, "gravity")
    return [_size(match[1], row["rms"]["before"]), _size(match[2], row["rms"]["after"])]


def _gravity(r: Sensors, match: re.Match[str], anchor: str) -> list[dict[str, Any]]:
    rows = r.case(anchor, match.string)["recovered"]
    return [one for one in rows if one["what"] == "gravity" and f" of {one['run']} " in match.string]


def _counted_places(r: Sensors, match: re.Match[str], anchor: str) -> int:
    """Stills or turns that a figure shows."""
    what = next(what for name, what in WHAT.items() if match.string.startswith(f"{name} by "))
    counts = [one["count"] for one in r.case(anchor, match.string)["recovered"] if one["what"] == what]
    return int(match[1]) if int(match[1]) in counts else counts[0]


def _held(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Errors within 2 sd, and how many there are, of the known quantity that a text is of."""
    rows = r.case(anchor, match.string)["recovered"]
    names = [name for name in WHAT if match.string.startswith(name)]
    what = WHAT[max(names, key=len)] if names else "gravity"
    said = (int(match[1]), int(match[2]))
    counts = [(row["within_2_sd"], row["of"]) for row in rows if row["what"] == what]
    return list(said if said in counts else counts[0])


def _one_of(key: str) -> Any:
    """A size of a case's rows of gravity, in mg."""

    def meant(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
        rows = _gravity(r, match, anchor)
        sizes = [_size(match[1], row["rms"][key]) for row in rows]
        return [min(sizes, key=lambda size: abs(size - float(match[1].split()[0].replace(",", ""))))]

    return meant


def _pooled(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Terms that all components of a kind need, of one model for them."""
    pooled = r.case(anchor, match.string)["pooled"][match[1]]
    return [None, [name for name, one in pooled.items() if one["verdict"] == "needed"]]


def _in_one_model(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.by_id[re.findall(r"In one model for (\S+?)(?:,| and|:)", match.string)[0]]
    pooled = r.case(anchor, match.string)["pooled"][sensor["kind"]]
    word = "cannot tell" if match[1].startswith("this test") else re.sub(" (is|are)$", "", match[1])
    return [None, [name for name, one in pooled.items() if one["verdict"] == word]]


AMOUNT = rf"({NUM} ?(?:mg|°/s|°))"
NAMES = rf"({TERM}(?:(?:, | and ){TERM})*)"


def _against(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Chance of what an input leaves in any run, between its rise and its fall too."""
    found = r.at(match, anchor)["misfit"]["dependences"]
    return [None, min(one["p"] for one in found if one["input"].removeprefix("hysteresis of ") == match[1])]


def _hidden(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    ratios = [sensor["observability"][name]["ratio"] for name in re.split(r", ", match[1])]
    return [None, max(ratios)]


def _dealt(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Draws in the file: those of a posterior, but no more of all and of their priors than 16 MB hold."""
    values = 2 * sum(len(sensor["terms"]) for sensor in r.sensors)
    return [min(r.at(match, anchor)["mcmc"]["draws"], 16_000_000 // (8 * values))]


def _kept(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Terms that a sparse regression keeps, of those that the test can tell."""
    sensor = r.at(match, anchor)
    told = verdicts(sensor, "needed") + verdicts(sensor, "not needed") + verdicts(sensor, "undecided")
    return [None, len(set(sensor["sindy"][match[1].lower()]["model"]) & set(told))]


def _kept_apart(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    sensor = r.at(match, anchor)
    needed = set(verdicts(sensor, "needed"))
    told = needed | set(verdicts(sensor, "not needed")) | set(verdicts(sensor, "undecided"))
    kept = set(sensor["sindy"][match[1].lower()]["model"]) & told
    return [*_kept(r, match, anchor), None, None] if kept else [None, 0, None, None]


def _uncertain(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    """Largest change of an inclusion when the noise is averaged over, and the term whose it is."""
    terms = [term for term in r.at(match, anchor)["terms"] if term["plug_in_inclusion"] is not None]
    moved = {term["name"]: abs(term["inclusion"] - term["plug_in_inclusion"]) for term in terms}
    return [moved[match[2]] if moved[match[2]] == max(moved.values()) else math.nan, None]


def _over_widths(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    found = r.at(match, anchor)["sensitivity"]["inclusion"][match[1]]
    return [None, min(found), max(found)]


def _moved(r: Sensors, match: re.Match[str], anchor: str) -> Iterable[Meant]:
    moved = r.at(match, anchor)["sensitivity"]["swing"]
    return [len(moved) if re.match(r"\d", match[1]) else moved]


AMOUNT = rf"({NUM} ?(?:mg|°/s|°))"
NAMES = rf"({TERM}(?:(?:, | and ){TERM})*)"

CASES = (
    *(
        Reading(
            rf"{re.escape(name)}: {AMOUNT} rms raw, {AMOUNT} compensated; the posterior predicts {AMOUNT}",
            partial(_changed, what=what),
        )
        for name, what in list(WHAT.items())[:4]
    ),
    Reading(rf"off local gravity by {AMOUNT} rms raw, and by {AMOUNT} compensated", _force),
    Reading(r"The force in the (\d+) stills", lambda r, m, a: [_gravity(r, m, a)[0]["count"]]),
    Reading(rf"The posterior predicts {AMOUNT} for them", _one_of("fitted")),
    Reading(rf"the posterior predicts {AMOUNT} for new ones: ", _one_of("fresh")),
    Reading(rf"new ones would be off by {AMOUNT}", _one_of("fresh")),
    Reading(rf"The kept terms alone leave {AMOUNT}", _one_of("flown")),
    Reading(r"(\d+) of (\d+) (?:lie )?within 2 sd", _held),
    Reading(r"by (?:still|turn), (\d+) of them", lambda r, m, a: [_counted_places(r, m, a)]),
    Reading(rf"its (accelerometer|gyroscope)s need {NAMES}(?=[.;])", _pooled),
    Reading(
        rf"((?:not )?needed (?:is|are)|undecided (?:is|are)|this test cannot tell of) {NAMES}(?=[.;])",
        _in_one_model,
    ),
    fixed(rf"known (?:only )?to ({NUM}) \S+"),
)


READINGS = (
    Reading(rf"(\d+) of (\d+) terms? (?:is|are) needed(?:: {NAMES})?", _needed),
    *map(_counted, tuple(VERDICTS)[1:]),
    Reading(r"^(\d+) of (\d+) terms? needed; ", _needed_title),
    Reading(rf"the prior's width matters most for (\S+) \(({NUM}) to ({NUM})\)", _width),
    Reading(rf"with an inclusion of one half or more: {NAMES}\.", _likely),
    Reading(rf"The best (\d+) models hold ({SHARE})", _best_models),
    Reading(rf"The best model holds ({SHARE})",
            lambda r, m, a: [r.at(m, a)["best_models"][0]["probability"]]),
    Reading(rf"models hold {SHARE} and disagree on (\d+ terms?|{NAMES[1:-1]})$", _disagree),
    Reading(rf"to the noise floor \(residual over noise ({NUM}), white, p {P}\)", _fit),
    Reading(
        rf"(?:explain runs? |\), | and )([^,;()]+?(?: \([\w ]+\))?) \(residual over noise ({NUM}),"
        rf" (?:not )?white, p (?:= )?{P}"
        rf"(?:, (\d+) blocks? stands? out by up to ({NUM}) sd)?\)",
        _misfit,
    ),
    Reading(rf"(?:below p|p above) ({NUM})", _level),
    Reading(
        r"to leave (\d+) digits? of every coefficient, .*?, (\d+) of every sd and (\d+) of the inclusions",
        lambda r, m, a: [r.at(m, a)["digits"][key] for key in ("coefficients", "sd", "inclusion")],
    ),
    Reading(rf"(?:Residual over noise|over time, rms) ({NUM}); (?:(\d+) blocks?|nothing)", _run_title),
    Reading(rf"Ljung-Box p {P}", _white_title),
    Reading(
        rf"^(?:Posterior of )?({TERM})(?: = |, )\(?({NUM}) (?:±|\+-) ({NUM})\)?(?:e([-−]?\d+))?[^,]*,"
        rf" (?:({NUM}) sd from zero|({'|'.join(VERDICTS)})$|{NUM} times)",
        _posterior,
    ),
    Reading(rf"(?:by term: |, )({TERM}) ({NUM}) ({'|'.join(VERDICTS)})(?=,|$)", _inclusion),
    Reading(rf"(?:relative to the best: |, )(\d+): ({NUM})(?=,|$)", _by_size),
    Reading(rf"Most likely (\d+) terms? \(({SHARE})\)", _likely_size),
    Reading(rf"(?:probabilities: |; )({NUM}): ?([^;]*)", _model),
    Reading(rf"(?:by term: |; )({TERM}) kept by (\d+) of (\d+), ([\w ]+)(?=;|$)", _votes),
    Reading(r"All (\d+) methods keep the same (\d+) terms?", _all_methods),
    Reading(rf"^(STLSQ|SR3), at ({NUM}) detectable", _sparse),
    Reading(rf"^Coefficients of (STLSQ|SR3) .*; at ({NUM}) it keeps", _sparse),
    Reading(
        rf"^(\d+) terms? predicts? the test .*?: {NAMES} (?:together )?loses? ({NUM}) .+? rms, of ({NUM}) ",
        _reduced,
    ),
    Reading(rf"without any, ({NUM}) \S+ rms is lost of ({NUM}) \S+ allowed", _nothing),
    Reading(rf"^(\d+) terms? predicts? within ({NUM}) ", _within),
    Reading(rf"(?:terms: none|, \+ {TERM}|, best (\d+)) ({NUM})(?=,|$)", _lost),
    Reading(rf"({NUM}) \S+ rms, ({SHARE}) of the residual, p {P}", _dependence),
    Reading(rf"in run [^()]*\(({NUM}) \S+ rms\)", _dependence),
    Reading(rf"of those seen \(p ({NUM})(?: to ({NUM}))?\)", _replicated),
    Reading(rf"At least one of {NAMES} is in the model with probability ((?:above )?{NUM})", _any),
    Reading(rf"\b([NBKQRG]) = \(?({NUM}) ± ({NUM})\)?(?:e(-?\d+))?", _process),
    Reading(rf"Against (\S+): nothing is left beyond chance \(p {P}\)", _against),
    Reading(rf"with means of bins: nothing is left beyond chance \(p ({NUM})\)", lambda r, m, a: [None]),
    Reading(rf"unresolved: (.+)\. posterior sd is ({NUM}) of the prior's", _hidden),
    Reading(rf"({NUM}) (?:independent draws|draws of the full library)", _dealt),
    Reading(rf"no inclusion probability moves by more than ({NUM}) \(({TERM})\)", _uncertain),
    Reading(rf"(?:over prior widths: |, )({TERM}) ({NUM}) to ({NUM})(?=,|$)", _over_widths),
    Reading(rf"leaves ({NUM}) \S+ rms in ", _dependence),
    Reading(rf"({NUM}) \S+ rms are left (?:between|in)", _dependence),
    Reading(r"a polynomial of degree (\d) in T", _degree),
    Reading(rf"^({NUM}) sd$", _outlying),
    Reading(rf"undecided: ([^.]+)\. (?:one lever arm with \S+: )?leans .*?, ({NUM}) sd from zero", _leaning),
    Reading(rf"undecided: ([^.]+)\. there, but below .*? {SHARE}, ({NUM}) sd from zero", _leaning),
    Reading(rf"averaged over ({NUM}) models drawn", lambda r, m, a: [r.at(m, a)["drawn_models"]]),
    Reading(r"All (\d+) methods keep (\d+) terms? in common", _in_common),
    Reading(rf"(\d+) of (\d+) keep ({TERM})(?=[;.,]|$)", _keepers),
    Reading(r"the test cannot tell (\d+) more", _cannot_tell),
    Reading(rf"prior's width (\d+ terms?|{NAMES[1:-1]}) cross(?:es)? a threshold", _moved),
    Reading(r"^(STLSQ|SR3), at .* keeps (?:the decision's )?(\d+) terms?(?!: \d)", _kept),
    Reading(r"^(STLSQ|SR3), at .* keeps (\d+) terms?: (\d+) more, (\d+) fewer", _kept_apart),
    Reading(rf"width moves (\d+ terms?|{NAMES[1:-1]}) across", _moved),
    Reading(r"(Not there|Undecided|Too small for this run to tell): ((?:[BKQRG], )*[BKQRG])\.", _none_of),
)  # fmt: skip


def wrong_study(html: str, result: dict[str, Any]) -> list[str]:
    """What a report on sensors says that its result does not."""
    page = tree(html)
    every = [*sentences(page), *drawn(page)]
    of_class = [block for block in every if result.get("population") and is_of_class(block)]
    blocks = [block for block in every if block.anchor not in UNREAD and block not in of_class]
    titles = {plain(result["study"])} | {plain(one["id"]) for one in result["sensors"]}
    notes = [
        spoken(f"WAIC: {c['note']}").removeprefix("WAIC: ")
        for one in result["sensors"]
        for c in one["criteria"].values()
        if c["note"]
    ]
    notes += [s["exact"] for one in result["sensors"] for s in one["standards"].values() if s.get("exact")]
    read = (_without(block, notes) for block in blocks if block.text not in titles and not _doubt(block))
    ids = [fixed(rf"(?<![\w-])({re.escape(one['id'])})(?![\w-])") for one in result["sensors"]]
    found = problems(
        (block for block in read if block.text), (*READINGS, *CASES, *SAID, *UNHELD, *ids), Sensors(result)
    )
    return [*found, *wrong_population(page, of_class, result)] if of_class else found


def _without(block: Block, notes: Sequence[str]) -> Block:
    """A block without what the result says in the same words."""
    text = block.text
    for note in sorted(notes, key=len, reverse=True):
        text = text.replace(plain(note), "")
    return Block(block.anchor, text)


def _doubt(block: Block) -> bool:
    """Whether a block is a link, or says why a method decides otherwise: by a threshold of its own."""
    link = block.anchor == "nav" and not re.search(r"\(|Noise of| whole[:.]|polynomial", block.text)
    return link or bool(re.match(r"[\w ,-]+ (?:keeps?|drops?) [\w ,*/]+(?::|,)", block.text))
