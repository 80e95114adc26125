"""The report on a trade of speed for accuracy: one page, its numbers, and the table for a terminal."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imubayes
from imubayes.campaign.fidelity import rung_of
from imubayes.ladder.trade.plan import DEFAULT, NAMES
from imubayes.ladder.trade.recommend import allowed
from imubayes.reporting.blocks import Block, Figure, Page, Prose, Section, Table, repeat, strong
from imubayes.reporting.html import write_page
from imubayes.reporting.result.file import json_text
from imubayes.reporting.rounding import duration
from imubayes.reporting.terminal import terminal
from imubayes.reporting.trade_figures import trade_panels
from imubayes.reporting.trade_words import bytes_text, error_text, rate_text, seconds_of, trade_answer

if TYPE_CHECKING:
    from rich.console import Group

    from imubayes.ladder.trade.alone import Measured
    from imubayes.ladder.trade.differ import Difference
    from imubayes.ladder.trade.record import Place, Standing, Traded
    from imubayes.ladder.trade.score import Score

HEADS = ("rung", "time", "processor", "memory", "off, rms", "largest", "Monte Carlo", "foresaw",
         "inclusion off", "other verdicts")  # fmt: skip

SCORE_HEADS = ("rung", "sensors", "90 % intervals hold", "error", "false needed", "false not needed",
               "missed", "cost a sensor")  # fmt: skip

COMPONENT_HEADS = ("component", "rung", "time", "off, rms", "largest", "in", "inclusion off",
                   "other verdicts")  # fmt: skip

OWN_PROCESS = (
    "Each rung has a process of its own, warmed up on a small problem, so that imports and compilation do not"
    " count. Of a rung that takes less than two seconds the fastest of up to five turns counts. Memory is the"
    " peak of the first turn, beside what the process held before."
)

COUNTED = (
    "Intervals are counted over the terms that the test can tell. Error: rms of coefficients under the"
    " full library against the truth, in posterior sd of the best rung that answered the same sensor."
    " False needed: of terms that are zero or below one posterior sd. False not needed: of terms above a"
    " tenth of their prior sd. Missed: left out of the model though above eight posterior sd. Beside a"
    " rate stands its 90 % interval, by the Beta posterior, as if terms were independent."
)


def write_trade(found: Traded, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    return write_page(trade_page(found), trade_json(found), folder)


def trade_page(found: Traded) -> Page:
    """Page of a trade."""
    first, *rest = trade_answer(found)
    on = ", and on sensors simulated from what was found" if found.scores else ""
    what = _counted(len(found.standings))
    components = Table(
        "Component by component",
        (*COMPONENT_HEADS, *(["other needs of scenes"] if found.trade.missions else [])),
        list(_component_rows(found)),
        "ttnnntnw",
    )
    return Page(
        f"{found.trade.title}: speed for accuracy",
        f"Every method of the ladder on this study’s own {what}{on}.",
        first=[Prose(strong(first), "answer"), Prose(rest, "list")],
        blocks=[
            Section("Time and error", [_figure(found)], "figure"),
            Section("The rungs", [*_rungs(found)], "rungs"),
            *([Section("Simulated repeats", [_scores(found)], "repeats")] if found.scores else []),
            Section("Component by component", [components], "components"),
            Section("How to read this", [_meaning(found)], "meaning"),
            _repeat(found),
        ],
    )


def _figure(found: Traded) -> Figure:
    best = found.best
    return Figure(
        trade_panels(found),
        f"First figure: the dot is the coefficient that differs most from {best}’s, the stick goes down to"
        f" the rms of all; {best} itself is hollow and stands at its own Monte Carlo error, below which"
        " (shaded) a difference means nothing. The default has the other colour. The stairs are the"
        " front: no rung beside it is faster and no worse. Dashed: what is good enough.",
    )


def _rungs(found: Traded) -> Iterator[Block]:
    """Each rung in numbers, and what it is."""
    scenes = (
        " Budgets off: largest change of what a term takes of a scene’s budget, in such budgets; terms"
        " off: by how many terms the models that the scenes require differ, over all components."
        if found.trade.missions
        else ""
    )
    yield Table(
        "The rungs",
        (*HEADS, *(("budgets off", "terms off") if scenes else ())),
        [_row(place, bool(scenes)) for place in found.places],
        note=f"Off: coefficients against {found.best}’s, in its posterior sd, the rms and the largest over"
        " tested terms. Monte Carlo: what the rung’s own few draws leave, rms. Foresaw: what a rung says"
        f" itself that the next one would change, at most.{scenes} Times of chains that were cut short are"
        " extrapolated to what was asked of them and marked “about”.",
    )
    rungs = [rung_of(place.rung) for place in found.places]
    lacks = [f"; it {rung.leaves_out}" if rung.leaves_out else "." for rung in rungs]
    told = [strong(rung.name) + f": {rung.title}{lack}" for rung, lack in zip(rungs, lacks, strict=True)]
    yield Prose(told, "list")


def _scores(found: Traded) -> Table:
    scenes = bool(found.trade.missions)
    rows = [_score_row(one, scenes) for one in found.scores]
    head = (*SCORE_HEADS, *(["terms off a scene"] if scenes else []))
    return Table("Simulated repeats", head, rows, note=f"{_drawn(found)} {COUNTED}")


def _meaning(found: Traded) -> Prose:
    good = (
        f"Good enough: no coefficient off by more than {allowed(found.floor[0]):.2g} posterior sd (a"
        " tenth, or twice the Monte Carlo error of a difference), no inclusion by more than 0.1, and 90 %"
        " intervals that hold 90 % of the truths, or more."
    )
    best = (
        f"The rungs are compared with {found.best}, the highest with long enough chains. What all of them"
        " take for granted, that the model is linear and the noise is made of N, B and K, is not tested"
        " here."
    )
    return Prose([OWN_PROCESS, good, best], "list")


def _repeat(found: Traded) -> Section:
    machine = found.machine
    load = "" if math.isnan(machine.load) else f" Load at the end: {machine.load:.1f}."
    said = (
        f"{machine.processor}, {machine.cores} cores; {machine.system}.{load} It took"
        f" {duration(found.seconds)}. Seed {found.trade.seed}."
    )
    versions = {"imubayes": imubayes.__version__, **machine.versions}
    return repeat(command(found), found.trade.text, said, made_with=versions)


def command(found: Traded) -> str:
    """The command that made it.

    Only what is not the usual is said.
    """
    trade = found.trade
    parts = ["imubayes trade", shlex.quote(str(trade.path)), f"--repeats {trade.repeats}"]
    parts += [f"--only {shlex.quote(','.join(trade.only))}"] if trade.only else []
    parts += [f"--rungs {','.join(trade.rungs)}"] if trade.rungs != NAMES else []
    return " ".join([*parts, f'--limit "{trade.limit:g} s"'])


def _counted(components: int) -> str:
    return "component" if components == 1 else f"{components} components"


def _row(place: Place, scenes: bool) -> tuple[str, ...]:
    name = f"{place.rung} (default)" if place.rung == DEFAULT else place.rung
    cells = (
        name,
        seconds_of(place),
        f"{place.processor_seconds:.2g} s",
        bytes_text(place.memory),
        error_text(place.rms),
        error_text(place.largest),
        error_text(place.monte_carlo),
        error_text(place.foreseen),
        error_text(place.inclusion),
        str(place.verdicts),
    )
    needs = (error_text(place.scene_share), str(place.scene_terms)) if scenes else ()
    return (*cells, *needs)


def _score_row(one: Score, scenes: bool) -> tuple[str, ...]:
    cells = (
        one.rung,
        str(one.repeats),
        rate_text(one.coverage),
        error_text(one.error),
        f"{one.false_needed.events} of {one.false_needed.of}",
        f"{one.false_not_needed.events} of {one.false_not_needed.of}",
        f"{one.missed_large.events} of {one.missed_large.of}",
        f"{one.cost:.2f}",
    )
    return (*cells, f"{one.scene_terms:.1f}") if scenes else cells


def _drawn(found: Traded) -> str:
    """Say where the simulated sensors come from."""
    if any(one.lot is not None for one in found.trade.subjects):
        return "The simulated sensors are further units of the lots, each on a bench with errors of its own."
    best = found.standings[0].best
    return (
        f"The simulated sensors have coefficients and noise that are drawn from the posterior of {best}, each"
        " by itself, and go through the same tests."
    )


def _component_rows(found: Traded) -> Iterator[tuple[str, ...]]:
    for standing in found.standings:
        for one, apart in zip(standing.measured, standing.differences, strict=True):
            yield _component_row(standing, one, apart, scenes=bool(found.trade.missions))


def _component_row(standing: Standing, one: Measured, apart: Difference, *, scenes: bool) -> tuple[str, ...]:
    verdicts = "; ".join(f"{name}: {said}, not {right}" for name, said, right in apart.verdicts)
    needs = "; ".join(f"{scene.scene}: {', '.join(scene.terms)}" for scene in apart.scenes if scene.terms)
    best = one.told.rung == standing.best
    cells = (
        standing.subject,
        one.told.rung,
        f"{one.seconds:.2g} s",
        "" if best else error_text(apart.rms),
        "" if best else error_text(apart.largest),
        "" if best else apart.worst,
        "" if best else error_text(apart.inclusion),
        "held against" if best else verdicts,
    )
    return (*cells, needs) if scenes else cells


def trade_json(found: Traded) -> str:
    """Text of ``result.json``: every number, SI; what is not finite becomes null."""
    trade = found.trade
    document = {
        "imubayes": imubayes.__version__,
        "study": trade.title,
        "seed": trade.seed,
        "limit": trade.limit,
        "repeats": trade.repeats,
        "answer": trade_answer(found),
        "recommended": found.recommended,
        "default": DEFAULT,
        "best": found.best,
        "front": found.front,
        "monte_carlo_floor": {"largest": found.floor[0], "rms": found.floor[1]},
        "good_enough": allowed(found.floor[0]),
        "rungs": [asdict(place) for place in found.places],
        "scores": [asdict(one) for one in found.scores],
        "components": [_standing_values(standing) for standing in found.standings],
        "machine": asdict(found.machine),
        "seconds": found.seconds,
        "provenance": {
            "study_file": str(trade.path),
            "study_text": trade.text,
            "command": command(found),
        },
    }
    return json_text(document)


def _standing_values(standing: Standing) -> dict[str, Any]:
    return {
        "id": standing.subject,
        "best": standing.best,
        "monte_carlo_floor": {"largest": standing.floor[0], "rms": standing.floor[1]},
        "skipped": dict(standing.skipped),
        "rungs": [
            _measured_values(one, apart)
            for one, apart in zip(standing.measured, standing.differences, strict=True)
        ],
    }


def _measured_values(one: Measured, apart: Difference) -> dict[str, Any]:
    told = one.told
    terms = zip(
        told.names, told.mean, told.full_mean, told.full_sd, told.inclusion, told.verdicts, strict=True
    )
    keys = ("name", "mean", "full_mean", "full_sd", "inclusion", "verdict")
    return {
        "rung": told.rung,
        "seconds": one.seconds,
        "seconds_to_what_was_asked": one.whole_seconds,
        "processor_seconds": one.processor_seconds,
        "memory": one.memory,
        "ess": told.ess,
        "foreseen_change_sd": one.foreseen[0],
        "foreseen_change_inclusion": one.foreseen[1],
        "difference": asdict(apart),
        "model": told.model,
        "terms": [dict(zip(keys, _plain(term), strict=True)) for term in terms],
    }


def _plain(term: tuple[Any, ...]) -> Iterator[Any]:
    return (value if isinstance(value, str) else float(value) for value in term)


def terminal_trade(found: Traded) -> Group:
    """Table and answer for a console of 80 columns."""
    heads = ("rung", "time", "memory", "off rms", "largest", "incl.", "verd.", "90 % holds", "cost")
    rows = []
    for place in found.places:
        score = found.score(place.rung)
        cells = (
            place.rung,
            seconds_of(place).replace("about ", "~"),
            bytes_text(place.memory),
            error_text(place.rms),
            error_text(place.largest),
            error_text(place.inclusion),
            str(place.verdicts),
            f"{score.coverage.share.value:.0%}" if score and score.coverage.of else "",
            f"{score.cost:.2f}" if score else "",
        )
        rows.append(cells)
    first, *rest = trade_answer(found)
    return terminal([Table("", heads, rows), Prose(first, "answer"), Prose(rest)])
