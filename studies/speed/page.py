"""The report on speed: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from imubayes import __version__
from imubayes.reporting.blocks import Both, Figure, Page, Prose, Section, Table, answer, repeat
from imubayes.reporting.rounding import duration, times
from studies.command import recorded
from studies.speed.figures import contest_panel, front_panel, law_panel, peers_panel
from studies.speed.words import exponent_text, law_note, speed_answer, trade_answer, wrong

if TYPE_CHECKING:
    from studies.speed.growth import Law
    from studies.speed.measure import Found, Place, Speed

TITLE = "How fast is it?"

QUESTION = (
    "Time beside what people would use instead, on the same problems in one run, and the error beside every"
    " time."
)

WHO = ("who", "time", Both("median to longest", None), "times ours", "error", "remark")
LAWS = ("work", "sizes", Both("time", None), "exponent", Both("which is", None))

GROWTH = (
    "Dots: the shortest time of each size, sticks up to the longest. The line is the power law fitted to the"
    " sizes that take three times the smallest one’s time or more (to the largest three at least); the error"
    " of its exponent is that of the points’ scatter about it."
)

PEERS = (
    "A dot is one of the others: its time over ours on the same problem, on a logarithmic axis. Orange: its"
    " answer is wrong."
)

FRONT = (
    "Coloured: rungs of the ladder, from rows to the decision. Grey: what others would use, for the"
    " coefficients alone. The stair is the front: nobody beside it is as fast and as near. Errors below 0.01"
    " are drawn there."
)

TIMED = (
    "Everybody solves the same problem in turns, so that what else the machine does meets all alike. A first"
    " turn, which compiles and imports, does not count; who takes more than two seconds is timed twice. Only"
    " of who takes more than twenty the first turn is the one that counts.",
    Markup(
        "<em>Least squares</em>: 21 terms of the accelerometer’s library in SI units as they come, so that"
        " columns differ by eight decades; the exact solution comes from refinement with products in"
        " extended precision. <em>One-sided</em>: seven powers of an input that stays between 40 and 50 g,"
        " columns that are nearly alike."
    ),
    Markup(
        "<em>Every subset</em>: inclusion by the weights exp(−BIC/2); abess gives the best subset alone. The"
        " exact answer comes from a QR of every subset."
    ),
    Markup(
        "<em>Posterior over all models</em>: inclusion, coefficients, evidence and the best models; with its"
        " scale integrated, the noise takes about ten values or more, and the same work each time."
    ),
    Markup(
        "<em>Noise</em>: N, B and K of simulated records of a tactical accelerometer; by restricted maximum"
        " likelihood, and read off the overlapping Allan deviation."
    ),
    Markup(
        "<em>Coefficients at given noise</em>: both samplers give draws of the same posterior; seconds are"
        " scaled to the same effective number of the worst coefficient, warm-up included."
    ),
    Markup(
        "<em>Speed for accuracy</em>: a gyroscope of a class at rest and on a rate table, noise of its class"
        " and unknown; the error is that of the coefficient that is farthest from the last rung’s, in its sd,"
        " of ours over both the averaged and the full library’s, of others over terms that the test tells."
        " What would take more than 90 s is left out; NUTS takes white noise and a flat prior."
    ),
)


def speed_page(speed: Speed) -> Page:
    """Page of the report."""
    first, *others = (said for said in speed_answer(speed) if said not in trade_answer(speed))
    return Page(
        TITLE,
        QUESTION,
        first=(answer([first]), Figure((peers_panel(_raced(speed)),), PEERS, "Time over ours")),
        data="simulated",
        blocks=(
            _beside(speed, others),
            *_traded(speed),
            _growth(speed),
            Section("What was timed", (Prose(TIMED, "list"),), "meaning"),
            _made(speed),
        ),
    )


def _beside(speed: Speed, said: Sequence[str]) -> Section:
    repeats = speed.study.repeats
    turns = f"{repeats} turns, of two where one takes seconds" if repeats > 1 else "1 turn"
    note = (
        f"Shortest of {turns}, as the dot in the figure; median and"
        " longest beside it, as its stick. An answer that is wrong is marked: a fast wrong answer is no"
        " peer."
    )
    raced = _raced(speed)
    panels = [contest_panel(found, f"c{k}") for k, found in enumerate(raced)]
    return Section(
        "Beside others",
        (Prose(said, "list"), Prose(note, "note"), Figure(panels), *_tables(raced)),
        "contests",
        brief=True,
    )


def _raced(speed: Speed) -> list[Found]:
    """Contests in which the time counts alone."""
    return [found for found in speed.contests if found.subject != "trade"]


def _traded(speed: Speed) -> Iterator[Section]:
    found = [one for one in speed.contests if one.subject == "trade"]
    if found:
        panels = [front_panel(one, f"t{k}") for k, one in enumerate(found)]
        said = Prose(trade_answer(speed), "list")
        yield Section(
            "Speed for accuracy", (said, Figure(panels, FRONT), *_tables(found)), "trade", brief=True
        )


def _tables(contests: Sequence[Found]) -> Iterator[Section]:
    for one in contests:
        yield Section(one.title, (_contest(one),), f"{one.subject.replace(' ', '-')}-{one.size}", brief=True)


def _contest(found: Found) -> Table:
    rows = [(place.name, *_cells(found, place), _remark(found, place)) for place in found.places]
    note = f"Time: of {found.time}. Error: {found.error}."
    return Table(found.title, WHO, rows, "tnnnnw", note)


def _cells(found: Found, place: Place) -> tuple[str, ...]:
    if not place.seconds:
        return ("", "", "", "")
    middle, longest = float(np.median(place.seconds)), max(place.seconds)
    error = f"{place.error:.1e}" if 0.0 < place.error < 1e-3 else f"{place.error:.2g}"
    return (
        duration(place.fastest),
        f"{duration(middle)} to {duration(longest)}",
        times(found.ratio(place)),
        "" if math.isnan(place.error) else error,
    )


def _remark(found: Found, place: Place) -> str:
    if place.absent:
        return f"left out: {place.absent}"
    return "; ".join(part for part in ("wrong" if wrong(found, place) else "", place.remark) if part)


def _growth(speed: Speed) -> Section:
    panels = [law_panel(law, f"l{k}") for k, law in enumerate(speed.laws)]
    table = Table("Exponents", LAWS, [_law(law) for law in speed.laws], "wnnnw", GROWTH)
    return Section("How time grows", (Figure(panels), table), "growth", brief=True)


def _law(law: Law) -> tuple[str, ...]:
    name = f"{law.ladder.title[:1].upper()}{law.ladder.title[1:]}"
    ends = f"{law.sizes[0]:,.0f} to {law.sizes[-1]:,.0f} {law.ladder.quantity}"
    taken = f"{duration(law.fastest[0])} to {duration(law.fastest[-1])}"
    return name, ends, taken, exponent_text(law), law_note(law)


def _made(speed: Speed) -> Section:
    here = speed.machine
    threads = ", ".join(f"{what} {count}" for what, count in here.threads.items())
    load = "" if math.isnan(here.load) else f" Load before the first timing: {here.load:.1f}."
    machine = f"{here.processor}, {here.cores} cores; {here.system}. Threads: {threads}.{load}"
    said = f"{machine} It took {duration(speed.seconds)}. Seed {speed.study.seed}."
    made_with = {"imubayes": __version__, **here.versions}
    return repeat(speed.study.command, "", said, made_with=made_with)


def speed_record(speed: Speed) -> dict[str, Any]:
    """Values of ``result.json``: every time, in s."""
    return recorded(
        speed,
        TITLE,
        speed_answer(speed),
        repeats=speed.study.repeats,
        machine=asdict(speed.machine),
        contests=[asdict(found) for found in speed.contests],
        growth=[_law_values(law) for law in speed.laws],
    )


def _law_values(law: Law) -> dict[str, object]:
    return {
        "of": law.ladder.quantity,
        "work": law.ladder.title,
        "sizes": law.sizes,
        "seconds": law.seconds,
        "exponent": law.exponent,
        "sd": law.sd,
        "expected": law.ladder.expected,
        "fitted_to": law.sizes[law.used],
    }
