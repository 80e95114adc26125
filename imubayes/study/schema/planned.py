"""A plan becomes a study: its runs dwell by dwell, so that the planned test can be simulated and analysed."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imubayes.planning.candidates import pauses, runs_of
from imubayes.study.schema.recorded import named_files, toml_lines
from imubayes.study.schema.run_tables import located

if TYPE_CHECKING:
    from imubayes.planning.candidates import Step
    from imubayes.planning.proposal import Proposal

PLANNED = "plan.toml"
"""Name of the study of the planned runs."""


def write_planned(found: Proposal, folder: Path) -> Path:
    """Write the best plan as a study with simulated runs.

    Parameters
    ----------
    found : the proposal.
    folder : that exists. Runs that are done are named by their full paths.
    """
    file = folder / PLANNED
    file.write_text(planned_text(found), encoding="utf-8")
    return file


def planned_text(found: Proposal) -> str:
    """Text of a study of the planned runs, one line for each dwell."""
    tables = tomllib.loads(found.study.text)
    offers = tables.pop("plan")["run"]
    sensor = tables.pop("sensor")[0]
    for table, key in named_files(tables):
        if key in table:
            table[key] = str(located(table[key], found.study.path.parent).resolve())
    for run, spec in zip(sensor.get("run", []), found.study.spec.runs, strict=True):
        if spec.file is not None:
            run["file"] = str(spec.file.resolve())
    lines = [*toml_lines(tables | {"sensor": [sensor]})]
    for offer, steps in runs_of(found.best.steps):
        lines += _run_lines(found, offers[offer], offer, steps)
    return "\n".join(lines).lstrip() + "\n"


def _run_lines(found: Proposal, table: dict[str, Any], offer: int, steps: list[Step]) -> Iterator[str]:
    run = {"name": table["name"], "procedure": table["procedure"]}
    yield "\n[[sensor.run]]"
    yield from toml_lines(run)
    yield "\n[sensor.run.simulate]"
    yield from toml_lines(table["candidates"] | {"rate": f"{found.study.offers[offer].rate:g} Hz"})
    yield "steps = ["
    for step, pause in zip(steps, pauses(found.menus[offer], steps), strict=True):
        words = found.settings[offer][step.setting]
        yield (
            f'  {{ at = {step.setting}, pause = "{pause:.9g} s", dwell = "{step.dwell:.9g} s" }},'
            f"  # {', '.join(filter(None, (words.mount, words.at)))}"
        )
    yield "]"
