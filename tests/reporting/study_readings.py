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

from first_readings import wrong_first
from report_reading import (
    Block,
    Meant,
    Reading,
    agrees,
    drawn,
    fixed,
    named,
    nearest,
    number,
    plain,
    problems,
    readings,
    sentences,
    tree,
    value,
    written,
)
from session_readings import is_of_class, wrong_population
from study_phrases import NUM, SAID, SHARE, TERM, UNHELD, P

from imubayes.reporting.method_views import spoken
from imubayes.reporting.rounding import NOISE, OUTPUT_SI, OUTPUT_UNIT, per_unit

Found = dict[str, Any]
Match = re.Match[str]

VERDICTS = {
    "needed": "needed",
    "not needed": "not needed",
    "undecided": "undecided",
    "inseparable": "inseparable in this test",
    "unresolved": "unresolved",
    "untested": "untested",
}
"""Verdicts, and how the first paragraph counts them."""

TOLD = ("needed", "not needed", "undecided")
"""Verdicts on what a test can tell."""

UNREAD = ("appendices", "runs", "repeat", "sessions")
"""Sections that are the study's own words, lists of files and versions, or tables."""


class Sensors:
    """Result of a study of sensors, by the anchors of its report."""

    def __init__(self, result: Found) -> None:
        self.sensors: list[Found] = result["sensors"]
        self.cases: list[Found] = result.get("cases", [])
        self.by_id = {one["id"]: one for one in self.sensors}

    def at(self, match: Match, anchor: str) -> Found:
        """Sensor that a text is of: that of its section, else the one that it names first."""
        found = re.match(r"s(\d+)(?:-|$)", anchor)
        if found:
            return self.sensors[int(found[1]) - 1]
        text = match.string.removeprefix("Noise of ")
        called = [name for name in self.by_id if text.startswith((f"{name} (", f"{name}, ", f"{name}:"))]
        return self.by_id[max(called, key=len)]

    def case(self, match: Match, anchor: str) -> Found:
        """Case that a text is of."""
        found = re.match(r"case(\d+)", anchor)
        if found:
            return self.cases[int(found[1]) - 1]
        return next(one for one in self.cases if match.string.startswith(f"{one['id']} as a whole"))


def verdicts(sensor: Found, *among: str) -> list[str]:
    """Terms of these verdicts."""
    return [term["name"] for term in sensor["terms"] if term["verdict"] in among]


def _term(sensor: Found, name: str) -> Found:
    return named(sensor["terms"], name)


def _of_terms(entries: Iterable[Found], names: Sequence[str]) -> Found:
    """Model or group of these terms."""
    return next(one for one in entries if sorted(one["terms"]) == sorted(names))


def _output(sensor: Found) -> float:
    """SI value of the unit in which effects on the output are printed."""
    return per_unit(OUTPUT_UNIT[sensor["kind"]], OUTPUT_SI[sensor["kind"]])


def _counted(verdict: str, sensor: Found, match: Match) -> Iterable[Meant]:
    """The count of a verdict in a first paragraph, and the terms that stand behind it in brackets."""
    found = verdicts(sensor, verdict)
    return [len(found), None if match[2] is None or match[2].endswith("and others") else found]


def _varied(sensor: Found, match: Match) -> Iterable[Meant]:
    """Terms that between 5 and 95 % of the best models, by their probability, hold."""
    best = sensor["best_models"]
    total = math.fsum(one["probability"] for one in best)
    held = {
        name: math.fsum(one["probability"] for one in best if name in one["terms"]) / total
        for name in sensor["candidates"]
    }
    varied = [name for name, share in held.items() if 0.05 < share < 0.95]
    return [len(varied) if re.match(r"\d", match[1]) else varied]


def _fit(sensor: Found, match: Match) -> Iterable[Meant]:
    checks, samples = sensor["residuals"], {run["name"]: run["samples"] for run in sensor["runs"]}
    weights = [samples.get(one["run"], 1) for one in checks]
    squares = math.fsum(w * one["scale"] ** 2 for w, one in zip(weights, checks, strict=True))
    scale = math.sqrt(squares / math.fsum(weights))
    fits = all(one["fits"] for one in checks)
    return [scale if fits else math.nan, min(number(one["whiteness_p"]) for one in checks)]


def _misfit(sensor: Found, match: Match) -> Iterable[Meant]:
    one = named(sensor["residuals"], match[1], "run")
    sizes = [abs(outlier["size"]) for outlier in one["outliers"]]
    scale = math.nan if one["fits"] else one["scale"]
    return [None, scale, one["whiteness_p"], len(sizes) or math.nan, max(sizes, default=math.nan)]


def _run_title(sensor: Found, match: Match) -> Iterable[Meant]:
    """Scale and outlying blocks of a run: the one whose scale it is."""
    one = min(sensor["residuals"], key=lambda check: abs(check["scale"] - float(match[1])))
    return [one["scale"], len(one["outliers"]) if match[2] else None]


def _white_title(sensor: Found, match: Match) -> Iterable[Meant]:
    ps = [number(one["whiteness_p"]) for one in sensor["residuals"]]
    return [min(ps) if match[1].startswith("<") else nearest(match[1], ps)]


def _posterior(sensor: Found, match: Match) -> Iterable[Meant]:
    term = _term(sensor, match[1])
    unit = per_unit(term["printed_unit"], term["unit"]) * float(f"1e{(match[4] or '0').replace('−', '-')}")
    mean, sd = term["mean"] / unit, term["sd"] / unit
    away = abs(term["mean"]) / term["sd"] if term["verdict"] == "needed" else math.nan
    right = match[5] is not None or match[6] in (term["verdict"], None)
    (said, _), (_, half) = *written(match[2]), *written(match[3])
    near = abs(said - mean) <= 1.02 * half
    return [None, None if near and right else mean if right else math.nan, sd, None, away, None]


def _bias(sensor: Found, match: Match) -> Iterable[Meant]:
    """Mean and sd of the bias over the record, at its start and its end, and of its drift."""
    unit = per_unit(_term(sensor, "b0")["printed_unit"], _term(sensor, "b0")["unit"])
    for k, key in enumerate(("mean", "start", "end", "drift")):
        mean, sd = (sensor["bias"][key][size] / unit for size in ("mean", "sd"))
        (said, _), (_, half) = *written(match[2 * k + 1]), *written(match[2 * k + 2])
        yield None if abs(said - mean) <= 1.02 * half else mean
        yield sd


def _strayed(sensor: Found, match: Match) -> Iterable[Meant]:
    """Drift over what a walk strays in that time, and how many walks go as far."""
    unit = per_unit(_term(sensor, "b0")["printed_unit"], _term(sensor, "b0")["unit"])
    ratio = abs(sensor["bias"]["drift"]["mean"]) / unit / value(match[1])
    low, high = (math.erfc((value(match[3]) + k) / math.sqrt(2.0)) for k in (0.05, -0.05))
    yield from (None, None, None if abs(value(match[3]) / ratio - 1.0) < 0.05 else ratio)
    yield None if low <= value(match[4]) <= high or high < 1e-3 else low


def _spread(sensor: Found, match: Match) -> Iterable[Meant]:
    """Sd from still to still or dwell to dwell of a run, or from mount to mount in arc seconds."""
    kind = f"{match[1]}.{match[2]}" if match[1] else "fixture"
    one, unit = named(sensor["reproducibility"], kind, "kind"), _output(sensor) if match[1] else ARCSECOND
    return [None, None, one["mean"] / unit, one["sd"] / unit]


ARCSECOND = math.pi / 648000.0

LEFT_OUT = {"every": "full", "bias,": "basic", "the": "needed"}
"""First word of what a compensation keeps, and what the result calls it."""


def _left_out(sensor: Found, match: Match) -> Iterable[Meant]:
    """Error of positions that are predicted from all others."""
    one = named(sensor["compensations"], LEFT_OUT[match[1].split()[0]], "model")
    return [None, one["held_out"] / _output(sensor)]


def _narrowed(sensor: Found, match: Match) -> Iterable[Meant]:
    """Terms of the model that are known ten times as well as before."""
    terms = [_term(sensor, name) for name in sensor["model"]]
    kept = [t for t in terms if number(t["sd"]) > 0.0 and not math.isnan(number(t["mean"]))]
    return [sum(10.0 * t["sd"] <= t["prior_sd"] for t in kept), len(kept)]


def _in_prior_sd(sensor: Found, match: Match) -> Iterable[Meant]:
    term = _term(sensor, match[1])
    return [None, term["mean"] / term["prior_sd"], term["sd"] / term["prior_sd"]]


def _inclusion(sensor: Found, match: Match) -> Iterable[Meant]:
    term = _term(sensor, match[1])
    return [None, term["inclusion"] if term["verdict"] == match[3] else math.nan, None]


def _by_size(sensor: Found, match: Match) -> Iterable[Meant]:
    values = sensor["by_size"]
    return [None, number(values[int(match[1])]) - max(v for v in values if v is not None)]


def _likely_size(sensor: Found, match: Match) -> Iterable[Meant]:
    values = [-math.inf if v is None else v for v in sensor["by_size"]]
    weights = [math.exp(v - max(values)) for v in values]
    size = weights.index(max(weights))
    return [size, weights[size] / math.fsum(weights)]


def _votes(sensor: Found, match: Match) -> Iterable[Meant]:
    kept = _keeping(sensor, match[1])
    k = sensor["votes"]["terms"].index(match[1])
    of = sum(one[k] is not None for one in sensor["votes"]["keeps"].values())
    return [None, kept if _term(sensor, match[1])["verdict"] == match[4] else math.nan, of, None]


def _keeping(sensor: Found, name: str) -> int:
    """Methods that keep a term."""
    votes = sensor["votes"]
    k = votes["terms"].index(name) if name in votes["terms"] else None
    return 0 if k is None else sum(one[k] == 1.0 for one in votes["keeps"].values())


def _kept_by(fewest: int, sensor: Found) -> Iterable[Meant]:
    """Methods, and terms that the test can tell and that many of them keep; all of them where it says 0."""
    of = len(sensor["votes"]["keeps"])
    return [of, sum(_keeping(sensor, name) >= (fewest or of) for name in verdicts(sensor, *TOLD))]


def _reduced(sensor: Found, match: Match) -> Iterable[Meant]:
    found, unit = sensor["reduced"], _output(sensor)
    return [len(found["terms"]), found["terms"], found["lost"] / unit, found["budget"] / unit]


def _lost(sensor: Found, match: Match) -> Iterable[Meant]:
    """Loss of a place on the way to the smallest model: that which is nearest in order."""
    one = sensor["reduced"]["path"][len(re.findall(r", (?=\+|best)", match.string[: match.end()]))]
    return [len(one["terms"]), one["lost"] / _output(sensor)]


def _dependence(sensor: Found, match: Match) -> Iterable[Meant]:
    unit, said = _output(sensor), value(match[1])
    shown = sensor["misfit"]["found"] or sensor["misfit"]["dependences"][:1]
    one = min(shown, key=lambda one: abs(one["size"] / unit - said))
    return [one["size"] / unit, one["share"], one["p"]][: len(match.groups())]


def _process(sensor: Found, match: Match) -> Iterable[Meant]:
    """Size of a noise process: of the run that shows these."""
    unit, si = NOISE[sensor["kind"]][match[1]]
    scale = per_unit(unit, si) * float(f"1e{match[4] or 0}")
    runs = [run["processes"][match[1]] for run in sensor["noise_processes"].values()]
    one = min(runs, key=lambda one: abs(one["mean"] / scale - float(match[2])))
    mean = one["mean"] / scale if one["verdict"] == "needed" else math.nan
    return [None, mean, one["sd"] / scale, None]


def _none_of(sensor: Found, match: Match) -> Iterable[Meant]:
    """Noise processes of a verdict, in the run that a sentence is of."""
    word = {"Not there": "not needed", "Undecided": "undecided"}.get(match[1], "unresolved")
    found = [
        [n for n, one in run["processes"].items() if one["verdict"] == word and n != "tau"]
        for run in sensor["noise_processes"].values()
    ]
    said = sorted(match[2].split(", "))
    return [None, min(found, key=lambda names: sorted(names) != said)]


def _hysteresis(sensor: Found, match: Match) -> Iterable[Meant]:
    """Chance of what an input leaves in any run, between its rise and its fall too."""
    found, name = sensor["misfit"]["dependences"], "t" if match[1] == "time" else match[1]
    return [None, min(one["p"] for one in found if one["input"].removeprefix("hysteresis of ") == name)]


def _kept(sensor: Found, match: Match) -> Iterable[Meant]:
    """Terms that a sparse regression keeps, of those that the test can tell."""
    kept = set(sensor["sindy"][match[1].lower()]["model"]) & set(verdicts(sensor, *TOLD))
    return [None, len(kept), *[None] * (len(match.groups()) - 2)]


def _uncertain(sensor: Found, match: Match) -> Iterable[Meant]:
    """Largest change of an inclusion when the noise is averaged over, and the term whose it is."""
    terms = [term for term in sensor["terms"] if term["plug_in_inclusion"] is not None]
    moved = {term["name"]: abs(term["inclusion"] - term["plug_in_inclusion"]) for term in terms}
    return [moved[match[2]] if moved[match[2]] == max(moved.values()) else math.nan, None]


def _over_widths(sensor: Found, match: Match) -> Iterable[Meant]:
    found = sensor["sensitivity"]["inclusion"][match[1]]
    return [None, min(found), max(found)]


def _moved(sensor: Found, match: Match) -> Iterable[Meant]:
    moved = sensor["sensitivity"]["swing"]
    return [len(moved) if re.match(r"\d", match[1]) else moved]


def _mixed(sensor: Found, match: Match) -> Iterable[Meant]:
    """Diagnostics of the chains; the reasons and names between are the result's own words."""
    keys = ("ensembles", "walkers", "steps", "", "seconds", "ess_min", "", "rhat_max", "", "tau_max",
            "acceptance", "interpolation_error")  # fmt: skip
    return [sensor["mcmc"].get(key) for key in keys]


NAMES = rf"({TERM}(?:(?:, | and ){TERM})*)"
LISTED = r"(?: \(([^()]*(?:\([^()]*\))?[^()]*)\))?"
COUNTS = {
    rf"(?<=\. )(\d+) (?:is|are) {words}{LISTED}(?=[:., ])": partial(_counted, verdict)
    for verdict, words in VERDICTS.items()
    if verdict != "needed"
}

READINGS = readings(
    COUNTS
    | {
        rf"^({NUM}) ensembles of ({NUM}) walkers, ({NUM}) steps each: (.*?); ({NUM}) s\. Smallest effective"
        rf" sample size ({NUM}) \((.*?)\), largest R-hat ({NUM}) \((.*?)\), longest autocorrelation time"
        rf" ({NUM}) steps, ({SHARE}) of the proposals accepted, log density interpolated to ({NUM}) nats":
            _mixed,
        rf"by bridge sampling; ({NUM}) in closed form": lambda s, m: [s["mcmc"]["log_evidence"]["exact"]],
        rf"the full library(?:, averaged over the prior of the noise)?: ({NUM}) ± ({NUM}) by bridge":
            lambda s, m: [s["mcmc"]["log_evidence"][key] for key in ("value", "sd")],
        rf"(\d+) of (\d+) terms? (?:is|are) needed(?:: {NAMES})?": lambda s, m: [
            len(found := verdicts(s, "needed")), len(s["terms"]), found
        ],
        r"^(\d+) of (\d+) terms? needed; ": lambda s, m: [len(verdicts(s, "needed")), len(s["terms"])],
        rf"the prior's width matters most for (\S+) \(({NUM}) to ({NUM})\)":
            lambda s, m: [None, *_term(s, m[1])["inclusion_range"]],
        rf"with an inclusion of one half or more: {NAMES}\.": lambda s, m: [
            [t["name"] for t in s["terms"] if t["inclusion"] >= 0.5 and t["verdict"] != "untested"]
        ],
        rf"The best (\d+) models hold ({SHARE})": lambda s, m: [
            len(s["best_models"]), math.fsum(one["probability"] for one in s["best_models"])
        ],
        rf"The best model holds ({SHARE})": lambda s, m: [s["best_models"][0]["probability"]],
        rf"models hold {SHARE} and disagree on (\d+ terms?|{NAMES[1:-1]})$": _varied,
        rf"to the noise floor \(residual over noise ({NUM}), white, p {P}\)": _fit,
        rf"(?:explain runs? |\), | and )((?:(?!\. )[^,;()])+?(?: \([\w ]+\))?) \(residual over noise ({NUM}),"
        rf" (?:not )?white, p (?:= )?{P}(?:, (\d+) blocks? stands? out by up to ({NUM}) sd)?\)": _misfit,
        rf"(?:below p|p above) ({NUM})": lambda s, m: [s["residuals"][0]["level"]],
        r"Drawn below: the (?:run|\d+ runs) of (\d+) that fits? worst": lambda s, m: [len(s["residuals"])],
        rf"importance sampling, largest k ({NUM})": lambda s, m: [s["criteria"]["loo"]["pareto_k"]],
        r"to leave (\d+) digits? of every coefficient, .*?, (\d+) of every sd and (\d+) of the inclusions":
            lambda s, m: [s["digits"][key] for key in ("coefficients", "sd", "inclusion")],
        rf"(?:Residual over noise|over time, rms) ({NUM}); (?:(\d+) blocks?|nothing)": _run_title,
        rf"Ljung-Box p {P}": _white_title,
        rf"^(?:Posterior of )?({TERM})(?: = |, )\(?({NUM}) (?:±|\+-) ({NUM})\)?(?:e([-−]?\d+))?[^,]*,"
        rf" (?:({NUM}) sd from zero|({'|'.join(VERDICTS)})$|{NUM} times)": _posterior,
        rf"(?:by term: |, )({TERM}) ({NUM}) ({'|'.join(VERDICTS)})(?=,|$)": _inclusion,
        rf"(?:relative to the best: |, )(\d+): ({NUM})(?=,|$)": _by_size,
        rf"Most likely (\d+) terms? \(({SHARE})\)": _likely_size,
        rf"(?:probabilities: |; )({NUM}): ?([^;]*)":
            lambda s, m: [_of_terms(s["best_models"], m[2].split())["probability"], None],
        rf"(?:by term: |; )({TERM}) kept by (\d+) of (\d+), ([\w ]+)(?=;|$)": _votes,
        r"All (\d+) methods keep the same (\d+) terms?": lambda s, m: _kept_by(1, s),
        r"All (\d+) methods keep (\d+) terms? in common": lambda s, m: _kept_by(0, s),
        rf"(\d+) of (\d+) keep ({TERM})(?=[;.,]|$)":
            lambda s, m: [_keeping(s, m[3]), len(s["votes"]["keeps"]), None],
        r"the test cannot tell (\d+) more": lambda s, m: [len(verdicts(s, "inseparable", "unresolved"))],
        rf"^(STLSQ|SR3), at ({NUM}) detectable": lambda s, m: [None, s["sindy"][m[1].lower()]["strength"]],
        rf"^Coefficients of (STLSQ|SR3) .*; at ({NUM}) it keeps":
            lambda s, m: [None, s["sindy"][m[1].lower()]["strength"]],
        r"^(STLSQ|SR3), at .* keeps (?:the decision's )?(\d+) terms?(?!: \d)": _kept,
        rf"^(\d+) terms? predicts? the test .*?: {NAMES} (?:together )?loses? ({NUM}) .+? rms, of ({NUM}) ":
            _reduced,
        rf"without any, ({NUM}) \S+ rms is lost of ({NUM}) \S+ allowed": lambda s, m: [
            lost / _output(s) for lost in (s["reduced"]["path"][0]["lost"], s["reduced"]["budget"])
        ],
        rf"^(\d+) terms? predicts? within ({NUM}) ":
            lambda s, m: [len(s["reduced"]["terms"]), s["reduced"]["budget"] / _output(s)],
        rf"(?:terms: none|, \+ {TERM}|, best (\d+)) ({NUM})(?=,|$)": _lost,
        rf"({NUM}) \S+ rms, ({SHARE}) of the residual, p {P}": _dependence,
        rf"in run [^()]*\(({NUM}) \S+ rms\)": _dependence,
        rf"leaves ({NUM}) \S+ rms in ": _dependence,
        rf"of those seen \(p ({NUM})(?: to ({NUM}))?\)":
            lambda s, m: [end(s["misfit"]["predictive_p"].values()) for end in (min, max)],
        rf"At least one of {NAMES} is in the model with probability ((?:above )?{NUM})":
            lambda s, m: [None, _of_terms(s["groups"], re.split(r", | and ", m[1]))["any_inclusion"]],
        rf"\b([NBKQRG]) = \(?({NUM}) ± ({NUM})\)?(?:e(-?\d+))?": _process,
        r"(Not there|Undecided|Too small for this run to tell): ((?:[BKQRG], )*[BKQRG])\.": _none_of,
        rf"Against (\S+): nothing is left beyond chance \(p {P}\)": _hysteresis,
        rf"(?:chance against|,|and) (\w+) \(p {P}\)": _hysteresis,
        r"^(\d+) of (\d+) kept terms? (?:is|are) known ten times": _narrowed,
        rf"(?:in prior sd: |, )({TERM}) ({NUM}) ± ({NUM})(?=,|$)": _in_prior_sd,
        rf"with means of bins: nothing is left beyond chance \(p ({NUM})\)": lambda s, m: [None],
        rf"unresolved: (.+)\. posterior sd is ({NUM}) of the prior's":
            lambda s, m: [None, max(s["observability"][name]["ratio"] for name in m[1].split(", "))],
        rf"no inclusion probability moves by more than ({NUM}) \(({TERM})\)": _uncertain,
        rf"(?:over prior widths: |, )({TERM}) ({NUM}) to ({NUM})(?=,|$)": _over_widths,
        r"a polynomial of degree (\d) in T": lambda s, m: [
            max(int(n or 1) for t in s["terms"] for n in re.findall(r"\*T(\d?)$", t["name"]))
        ],
        rf"is the mean over the record, ({NUM}) ± ({NUM}) \S+: ({NUM}) ± ({NUM}) \S+ at its start, ({NUM}) ±"
        rf" ({NUM}) \S+ at its end, a drift of ({NUM}) ± ({NUM})": _bias,
        rf"strays ({NUM}) \S+ \((1) sd\) in that time, and this is ({NUM}) sd, as ({SHARE}) of walks do":
            _strayed,
        rf"(?:the (still|dwell)s of run (.+?) differ|differs between mounts) by ({NUM}) (?:±|\+-) ({NUM})":
            _spread,
        r"library temperature = (1)": lambda s, m: [None],
        r"Predicting each of (\d+) positions": lambda s, m: [s["compensations"][0]["positions"]],
        rf"with (every tested term|bias, scale and misalignment|the terms that the data ask for and resolve)"
        rf" ({NUM}) \S+ rms": _left_out,
        rf"^({NUM}) sd$": lambda s, m: [
            nearest(m[1], (o["size"] for one in s["residuals"] for o in one["outliers"]))
        ],
        rf"undecided: ([^.]+)\. (?:(?:one lever arm with \S+: )?leans .*?|there, but below .*? {SHARE}),"
        rf" ({NUM}) sd from zero": lambda s, m: [
            None,
            float(re.findall(rf"({NUM}) sd from zero", _term(s, m[1].split(", ")[0])["reason"])[0]),
        ],
        rf"averaged over ({NUM}) models drawn": lambda s, m: [s["drawn_models"]],
        rf"prior's width (\d+ terms?|{NAMES[1:-1]}) cross(?:es)? a threshold": _moved,
        rf"width moves (\d+ terms?|{NAMES[1:-1]}) across": _moved,
    },
    Sensors.at,
)  # fmt: skip


# A case as a whole

WHAT = {
    "Length of the force in the stills, from local g": "gravity",
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
AMOUNT = rf"({NUM} ?(?:mg|°/s|°))"


def _size(said: str, size: float | None) -> float:
    """Value in the unit in which a size is said."""
    return number(size) / per_unit(*SIZES[re.sub(rf"^{NUM} ?", "", said)])


def _rows(case: Found, what: str) -> list[Found]:
    return [one for one in case["recovered"] if one["what"] == what]


def _changed(what: str, case: Found, match: Match) -> Iterable[Meant]:
    """Errors of a known quantity: raw and compensated, and predicted where a sentence says so."""
    rows = _rows(case, what)
    alike = [one for one in rows if agrees(match[2], _size(match[2], one["rms"]["after"]))]
    row = (alike or rows)[0]
    said = ("before", "after", "fresh" if row["saturated"] else "fitted")
    return [_size(match[k], row["rms"][key]) for k, key in enumerate(said[: len(match.groups())], start=1)]


def _counted_places(case: Found, match: Match) -> Iterable[Meant]:
    """Stills or turns that a figure shows."""
    what = next(what for name, what in WHAT.items() if match.string.startswith(f"{name} by "))
    counts = [one["count"] for one in _rows(case, what)]
    return [int(match[1]) if int(match[1]) in counts else counts[0]]


def _held(case: Found, match: Match) -> Iterable[Meant]:
    """Errors within 2 sd, and how many there are, of the known quantity that a text is of."""
    names = [name for name in WHAT if match.string.startswith(name)]
    what = WHAT[max(names, key=len)] if names else "gravity"
    counts = [(row["within_2_sd"], row["of"]) for row in _rows(case, what)]
    said = (int(match[1]), int(match[2]))
    return said if said in counts else counts[0]


def _of_all(pooled: Found, verdict: str) -> Iterable[Meant]:
    """Terms of a verdict, of one model for all components of a kind."""
    return [None, [name for name, one in pooled.items() if one["verdict"] == verdict]]


CASES = readings(
    {
        rf"{re.escape(name)}: {AMOUNT} rms raw, {AMOUNT} compensated; the posterior predicts {AMOUNT}":
            partial(_changed, what)
        for name, what in list(WHAT.items())[:4]
    }
    | {
        r"(?<!\d)(?<!as predicted: )(\d+) of (\d+) (?:lie )?within 2 sd": _held,
        r"by (?:still|turn), (\d+) of them": _counted_places,
        rf"its (accelerometer|gyroscope)s need {NAMES}(?=[.;])":
            lambda case, m: _of_all(case["pooled"][m[1]], "needed"),
    },
    Sensors.case,
)  # fmt: skip


def _in_one_model(r: Sensors, match: Match, anchor: str) -> Iterable[Meant]:
    sensor = r.by_id[re.findall(r"In one model for (\S+?)(?:,| and|:)", match.string)[0]]
    word = "cannot tell" if match[1].startswith("this test") else re.sub(" (is|are)$", "", match[1])
    return _of_all(r.case(match, anchor)["pooled"][sensor["kind"]], word)


def _dealt(r: Sensors, match: Match, anchor: str) -> Iterable[Meant]:
    """Draws in the file: those of a posterior, but no more of all and of their priors than 16 MB hold."""
    values = 2 * sum(len(sensor["terms"]) for sensor in r.sensors)
    return [min(r.at(match, anchor)["mcmc"]["draws"], 16_000_000 // (8 * values))]


def _as_predicted(r: Sensors, match: Match, anchor: str) -> Iterable[Meant]:
    """Errors of known quantities of a component's kind within 2 sd, and how many there are."""
    sensor = r.at(match, anchor)
    case = next(one for one in r.cases if sensor["id"].startswith(f"{one['id']}."))
    force = sensor["kind"] == "accelerometer"
    rows = [one for one in case["recovered"] if (one["what"] == "gravity") == force]
    return [sum(one[key] for one in rows) for key in ("within_2_sd", "of")]


WHOLE = (
    Reading(r"are (?:as predicted|too small|wider than they need be): (\d+) of (\d+)", _as_predicted),
    Reading(
        rf"((?:not )?needed (?:is|are)|undecided (?:is|are)|this test cannot tell of) {NAMES}(?=[.;])",
        _in_one_model,
    ),
    Reading(r"drawn of (\d+) of the (\d+) components", lambda r, m, _: [int(m[1]), len(r.sensors)]),
    Reading(rf"({NUM}) (?:independent draws|draws of the full library)", _dealt),
)


def wrong_study(html: str, result: Found) -> list[str]:
    """What a report on sensors says that its result does not."""
    page = tree(html)
    every = [one for one in (*sentences(page), *drawn(page)) if not one.text.startswith("Made on ")]
    of_class = [block for block in every if result.get("population") and is_of_class(block)]
    first = [block for block in every if block.anchor == "first"]
    blocks = [block for block in every if block.anchor not in (*UNREAD, "first") and block not in of_class]
    titles = {plain(result["study"])} | {plain(one["id"]) for one in result["sensors"]}
    notes = [
        spoken(f"WAIC: {c['note']}").removeprefix("WAIC: ")
        for one in result["sensors"]
        for c in one["criteria"].values()
        if c["note"]
    ]
    notes += [note for one in result["sensors"] for run in one["runs"] for note in run["notes"]]
    notes += [s["exact"] for one in result["sensors"] for s in one["standards"].values() if s.get("exact")]
    read = (_without(block, notes) for block in blocks if block.text not in titles and not _doubt(block))
    names = dict.fromkeys(n for one in result["sensors"] for n in (one["id"], one["id"].rpartition(".")[0]))
    ids = fixed(*(rf"(?<![\w-])({re.escape(name)})(?![\w-])" for name in names if name))
    known = (*READINGS, *CASES, *WHOLE, *SAID, *UNHELD, *fixed(rf"known (?:only )?to ({NUM}) \S+"), *ids)
    found = [
        *wrong_first(first, result),
        *problems((block for block in read if block.text), known, Sensors(result)),
    ]
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
