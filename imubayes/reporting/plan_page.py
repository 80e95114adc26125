"""The report on a plan: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

import imubayes
from imubayes.planning.candidates import starts
from imubayes.reporting.blocks import Block, Figure, Page, Prose, Section, Table, answer, repeat
from imubayes.reporting.html import write_page
from imubayes.reporting.plan_figures import course_panel, predicted_panel
from imubayes.reporting.plan_words import (
    AIMS,
    CALLED,
    Mount,
    at_clock,
    inseparable,
    lasting,
    mounts,
    plan_answer,
)
from imubayes.reporting.provenance import provenance
from imubayes.reporting.result.file import json_text
from imubayes.reporting.rounding import measured, per_unit, pretty
from imubayes.reporting.terminal import terminal

if TYPE_CHECKING:
    from rich.console import Group

    from imubayes.planning.proposal import Outcome, Proposal


DWELL_HEAD = ("no.", "record from", "set to", "record for")
NEXT_HEAD = ("run", "mount", "set to", "record for", "takes", "left open")

ORDER = (
    "Times are from the start of the work; the order matters, for it keeps drift apart from the terms. Axes"
    " are those of the case: i the input axis, j and k with it right-handed. In a plane the first axis is up"
    " at 0 deg and the second one at 90 deg."
)


def write_plan(found: Proposal, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    return write_page(plan_page(found), plan_json(found), folder)


def plan_page(found: Proposal) -> Page:
    """Page of a plan."""
    time = lasting(found.study.time)
    return Page(
        found.study.title,
        f"A plan for {time}, made before the test: what it will tell, and what to set, dwell by dwell.",
        first=[answer(plan_answer(found))],
        blocks=[
            Section("What it will tell", [*_terms(found)], "terms"),
            Section("What the data cannot tell apart", [*_open(found)], "open"),
            Section("The plan", [Prose(ORDER), *(_mount(one) for one in mounts(found, found.best))], "plan"),
            Section("The next dwell", [*_next(found)], "next"),
            _repeat(found),
        ],
    )


def _terms(found: Proposal) -> Iterator[Block]:
    """What a plan leaves of each term, drawn and in numbers."""
    names, scene, done = plan_names(found), np.isfinite(found.need).any(), _done(found)
    known = f" What the runs {done} say is known already." if done else ""
    told = "; ".join(
        f"{CALLED[o.name][:1].upper()}{CALLED[o.name][1:]}: {len(o.steps)} dwells in {lasting(o.seconds)}"
        for o in outcomes(found)
    )
    yield Prose(f"The plan makes small: {AIMS[found.study.aim]}.{known} {told}.")
    same = f"; squares, the best with the {names[1]}" if len(names) > 2 else ""
    need = "; bars, the sd at which a term has a tenth of the scene's budget" if scene else ""
    yield Figure(
        (predicted_panel(found, "p0"), course_panel(found, "p1")),
        "Left: sd that each plan will leave, over the sd of the class's prior, on a scale of decades; further"
        " left is better, and 1 is as if nothing had been measured. Circles,"
        f" {names[0]}{same}; diamonds, the {names[-1]}{need}. Right: what acts along the input axis in each"
        " dwell of the best plan.",
    )
    head = ["term", "", "unit", "prior sd", *(["known"] if done else []), *names]
    yield Table(
        "Predicted sd of every term",
        [*head, *(["scene's need"] if scene else []), "simulated / predicted"],
        term_rows(found),
        note="Predicted sd of each term in its unit, the errors of the bench and the drift of the sensor"
        " allowed for. The last column is the root mean square error of the best plan's estimates over"
        f" {found.study.units} simulated units, drawn from the prior and sampled with the noise of the class,"
        " over the predicted sd. Where the prediction is right it is 1, give or take"
        f" {(2 * found.study.units) ** -0.5:.2f} (one standard error).",
    )


def _open(found: Proposal) -> Iterator[Block]:
    """What the best plan, and going evenly, see only in combination."""
    if apart := inseparable(found, found.best):
        yield Prose(apart, "list")
    else:
        yield Prose("Nothing: the best plan sees every term that it drives by itself.")
    if before := inseparable(found, found.even):
        yield Section("If the positions were gone through evenly", [Prose(before, "list")])


def _mount(one: Mount) -> Section:
    """Dwells in one mount."""
    todo = f": {one.todo}" if one.todo else ""
    said = Prose(f"{len(one.rows)} dwells in {lasting(one.time)}{todo}.", "note")
    table = Table(f"Dwells of {one.run} {one.mount}", DWELL_HEAD, one.rows, "n")
    return Section(f"{one.run}: {one.mount}" if one.mount else one.run, [said, table])


def _next(found: Proposal) -> Iterator[Block]:
    """Best next dwells by themselves."""
    after = " after the runs that are done" if _done(found) else ""
    yield Prose(
        f"If there were time for one dwell only{after}, these gain most in the time that they take, handling"
        " included. The last column is the size of what is left open, in the terms of the plan's aim."
    )
    rows = []
    for step, cost, value in found.following:
        setting = found.settings[step.menu][step.setting]
        cells = (setting.mount, setting.at, lasting(step.dwell), lasting(cost), f"{value:.4g}")
        rows.append((found.study.offers[step.menu].spec.name, *cells))
    yield Table("Best next dwells", NEXT_HEAD, rows)


def _repeat(found: Proposal) -> Section:
    said = Markup(
        "It took {:.0f} s. Beside this page, plan.toml holds the planned runs as a study:"
        " <code>imubayes run plan.toml</code> simulates and analyses them. Seed {}."
    )
    told = said.format(found.seconds, found.study.seed)
    return repeat(f"imubayes plan {found.study.path}", found.study.text, told)


def _done(found: Proposal) -> str:
    """Names of the runs that are done."""
    return ", ".join(run.name for run in found.study.spec.runs)


def plan_names(found: Proposal) -> list[str]:
    """Names of the plans that are told."""
    return [CALLED[outcome.name] for outcome in outcomes(found)]


def outcomes(found: Proposal) -> tuple[Outcome, ...]:
    """Plans that are told: `same` only where there is other equipment."""
    return (found.even, found.same, found.best) if len(found.menus) > 1 else (found.even, found.best)


def term_rows(found: Proposal) -> list[tuple[str, ...]]:
    """Predicted sd of every term in printed units: before, after each plan, and what the scene needs."""
    rows = []
    for k, term in enumerate(found.study.spec.library.terms):
        unit = per_unit(term.printed, term.unit)
        before = [found.prior_sd[k], *([found.known_sd[k]] if found.study.spec.runs else [])]
        values = [*before, *(o.sd[k] for o in outcomes(found))]
        need = [found.need[k]] if np.isfinite(found.need).any() else []
        texts = [str(measured(v / unit, math.nan)) if math.isfinite(v) else "–" for v in (*values, *need)]
        mark = "needed" if term.name in found.needed else ""
        ratio = f"{found.best.simulated[k] / found.best.sd[k]:.2f}"
        rows.append((term.name, mark, pretty(term.printed), *texts, ratio))
    return rows


def plan_json(found: Proposal) -> str:
    """Text of ``result.json``: SI; what is not finite becomes null."""
    study = found.study
    document = {
        "imubayes": imubayes.__version__,
        "study": study.title,
        "seed": study.seed,
        "answer": plan_answer(found),
        "plan": {
            "sensor": study.spec.id,
            "kind": study.spec.kind,
            "time": study.time,
            "aim": study.aim,
            "units": study.units,
            "needed": found.needed,
            "terms": [
                {
                    "name": term.name,
                    "unit": term.unit,
                    "prior_sd": float(found.prior_sd[k]),
                    "known_sd": float(found.known_sd[k]),
                    "needed_sd": float(found.need[k]),
                    **{
                        o.name: {"sd": float(o.sd[k]), "simulated": float(o.simulated[k])}
                        for o in outcomes(found)
                    },
                }
                for k, term in enumerate(study.spec.library.terms)
            ],
            "plans": [_plan_entry(found, outcome) for outcome in outcomes(found)],
        },
        "seconds": found.seconds,
        "provenance": provenance(study, f"imubayes plan {study.path}"),
    }
    return json_text(document)


def _plan_entry(found: Proposal, outcome: Outcome) -> dict[str, Any]:
    worst, ratio = found.worst(outcome)
    return {
        "name": outcome.name,
        "seconds": outcome.seconds,
        "size_of_aim": outcome.worth,
        "worst": worst,
        "worst_ratio": ratio,
        "share_of_budget": outcome.share,
        "confounded": [asdict(group) for group in outcome.seen.groups],
        "steps": [
            {
                "run": found.study.offers[step.menu].spec.name,
                "start": start,
                "at": step.setting,
                "mount": found.settings[step.menu][step.setting].mount,
                "set_to": found.settings[step.menu][step.setting].at,
                "dwell": step.dwell,
            }
            for step, start in zip(outcome.steps, starts(found.menus, outcome.steps).tolist(), strict=True)
        ],
    }


def terminal_plan(found: Proposal) -> Group:
    """Lines for a terminal: the answer, the terms, and the plan mount by mount."""
    rows = []
    for k, name in enumerate(found.study.spec.library.names):
        ratios = [f"{outcome.sd[k] / found.prior_sd[k]:.3f}" for outcome in outcomes(found)]
        rows.append((name, "needed" if name in found.needed else "", *ratios))
    steps, clock = [], 0.0
    for one in mounts(found, found.best):
        steps.append((at_clock(clock), str(len(one.rows)), f"{one.run} {one.mount}"))
        clock += one.time
    return terminal(
        (
            Prose(plan_answer(found)),
            Table("", ("term", "", *plan_names(found)), rows, "ttn"),
            Prose("predicted sd over prior sd"),
            Table("", ("start", "dwells", "run and mount"), steps, "nnw"),
        )
    )
