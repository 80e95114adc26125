"""The report on a plan: one page and its numbers."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import imubayes
from imubayes.planning.candidates import starts
from imubayes.reporting.plan_figures import course_panel, predicted_panel
from imubayes.reporting.plan_words import (
    AIMS,
    CALLED,
    at_clock,
    blocks,
    inseparable,
    lasting,
    plan_answer,
)
from imubayes.reporting.quality_page import finite
from imubayes.reporting.results import versions
from imubayes.reporting.rounding import measured, per_unit, pretty

if TYPE_CHECKING:
    from imubayes.planning.proposal import Outcome, Proposal


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: its name and its numbers as texts."""

    name: str
    cells: tuple[str, ...]


def write_plan(found: Proposal, folder: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``result.json`` into a folder."""
    report, values = folder / "report.html", folder / "result.json"
    report.write_text(plan_html(found), encoding="utf-8")
    values.write_text(plan_json(found), encoding="utf-8")
    return report, values


def plan_html(found: Proposal) -> str:
    """Text of the report; names that come from the study file are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    page = Environment(
        loader=PackageLoader("imubayes", "reporting"), autoescape=True, undefined=StrictUndefined
    ).get_template("plan.html.j2")
    return page.render(
        study=found.study,
        answer=plan_answer(found),
        aim=AIMS[found.study.aim],
        time=lasting(found.study.time),
        outcomes=[(CALLED[o.name], lasting(o.seconds), len(o.steps)) for o in outcomes(found)],
        plans=[CALLED[o.name] for o in outcomes(found)],
        terms=term_rows(found),
        scene=bool(np.isfinite(found.need).any()),
        done=[run.name for run in found.study.spec.runs],
        inseparable=inseparable(found, found.best),
        before=inseparable(found, found.even),
        blocks=[(one, lasting(one.time)) for one in blocks(found, found.best)],
        next=next_rows(found),
        panels=(predicted_panel(found, "p0"), course_panel(found, "p1")),
        seconds=f"{found.seconds:.0f}",
        versions=versions(),
        command=f"imubayes plan {found.study.path}",
    )


def outcomes(found: Proposal) -> tuple[Outcome, ...]:
    """Plans that are told: `same` only where there is other equipment."""
    return (found.even, found.same, found.best) if len(found.menus) > 1 else (found.even, found.best)


def term_rows(found: Proposal) -> tuple[Row, ...]:
    """Predicted sd of every term in printed units: before, after each plan, and what the scene needs."""
    rows = []
    for k, term in enumerate(found.study.spec.library.terms):
        unit = per_unit(term.printed, term.unit)
        before = [found.prior_sd[k], *([found.known_sd[k]] if found.study.spec.runs else [])]
        values = [*before, *(o.sd[k] for o in outcomes(found))]
        need = [found.need[k]] if np.isfinite(found.need).any() else []
        texts = [str(measured(v / unit, math.nan)) if math.isfinite(v) else "–" for v in (*values, *need)]
        cells = (pretty(term.printed), *texts, f"{found.best.simulated[k] / found.best.sd[k]:.2f}")
        mark = "needed" if term.name in found.needed else ""
        rows.append(Row(term.name, (mark, *cells)))
    return tuple(rows)


def next_rows(found: Proposal) -> tuple[Row, ...]:
    """Best next dwells by themselves."""
    return tuple(
        Row(
            found.study.offers[step.menu].spec.name,
            (
                found.settings[step.menu][step.setting].mount,
                found.settings[step.menu][step.setting].at,
                lasting(step.dwell),
                lasting(cost),
                f"{value:.4g}",
            ),
        )
        for step, cost, value in found.following
    )


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
        "provenance": {
            "study_file": str(study.path),
            "study_text": study.text,
            "command": f"imubayes plan {study.path}",
            "versions": versions(),
        },
    }
    return json.dumps(finite(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


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


def terminal_plan(found: Proposal) -> str:
    """Lines for a terminal: the answer, the terms, and the plan mount by mount."""
    plans = outcomes(found)
    lines = [f"{'term':8} {'':6} " + " ".join(f"{CALLED[o.name]:>14}" for o in plans)]
    for k, name in enumerate(found.study.spec.library.names):
        mark = "needed" if name in found.needed else ""
        cells = " ".join(f"{o.sd[k] / found.prior_sd[k]:14.3f}" for o in plans)
        lines.append(f"{name:8} {mark:6} {cells}")
    lines.append("predicted sd over prior sd")
    clock = 0.0
    steps = ["", f"{'start':>8}  {'dwells':>6}  run and mount"]
    for one in blocks(found, found.best):
        steps.append(f"{at_clock(clock):>8}  {len(one.rows):6}  {one.run} {one.mount}")
        clock += one.time
    return "\n".join((*plan_answer(found), "", *lines, *steps))
