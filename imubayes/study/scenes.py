"""What the scenes of a study require of each component that was characterised."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from imubayes.algebra.factor import reorder
from imubayes.campaign.study import Mission, RunSummary, SensorResult, SensorSpec
from imubayes.population.needs import CANNOT_TELL
from imubayes.scenes.effects import SceneEffects
from imubayes.scenes.relevance import (
    CaseRelevance,
    Exposure,
    Relevance,
    exposure,
    known,
    quadrant,
    weigh,
    weigh_case,
)
from imubayes.selection.verdicts import listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Library


def required(
    missions: Sequence[Mission], results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
) -> tuple[tuple[tuple[str, Relevance], ...], tuple[tuple[str, CaseRelevance], ...]]:
    """Hold every component against every scene, and the components of a case together.

    A budget of the output is only for components of its kind.

    Returns
    -------
    id of a component and what a scene requires of it, scene by scene; the same of cases.
    """
    found: list[tuple[str, Relevance]] = []
    cases: list[tuple[str, CaseRelevance]] = []
    for mission in missions:
        expose = cache(partial(exposure, mission.scene, budget=mission.budget))
        for spec, components in results:
            seen: dict[str, Exposure] = {}
            for one in components:
                if mission.kind in (None, one.kind):
                    name = one.id.removeprefix(f"{spec.id}.")
                    # of a triad a component's own axis: ``ax`` lies along x
                    own = name in COMPONENTS and one.id != spec.id
                    axis = name[-1] if own else mission.axis
                    seen[one.id] = expose(component_library(spec, one), axis=axis)
                    found.append((one.id, _required(mission, seen[one.id], one)))
            if len(seen) > 1 and mission.budget.quantity != "output":
                knowledge = {one.id: known(one.selection, one.draws) for one in components}
                noise = {one.id: _longest(one).noise for one in components}
                case = weigh_case(seen, knowledge, noise)
                cases.append((spec.id, replace(case, scene=mission.name)))
    return tuple(found), tuple(cases)


def component_library(spec: SensorSpec, result: SensorResult) -> Library:
    """Terms of a component: a triad leaves out those that only turn its case."""
    names = {term.name for term in result.selection.terms}
    lib = spec.of(result.kind).library
    return replace(lib, terms=tuple(term for term in lib.terms if term.name in names), ties=())


def _required(mission: Mission, exposed: Exposure, result: SensorResult) -> Relevance:
    """Hold one component against one scene; the longest run shows its B and K best."""
    longest, tested = _longest(result), None
    if result.drive is not None:
        factor = reorder(result.drive, exposed.lib.names)
        tested = SceneEffects(exposed.lib.names, factor.R[:-1, :-1])
    found = weigh(exposed, known(result.selection, result.draws), noise=longest.noise, tested=tested)
    notes = (*found.notes, f"noise as in run '{longest.name}'", *_idle(exposed))
    # of a term that the test cannot tell inclusion is mostly the prior's, and shows nothing
    silent = {term.name for term in result.selection.terms if term.verdict in CANNOT_TELL}
    terms = tuple(
        replace(term, quadrant=quadrant(0.0, 0.0, term.possible)) if term.name in silent else term
        for term in found.terms
    )
    return replace(found, scene=mission.name, notes=notes, terms=terms)


def _longest(result: SensorResult) -> RunSummary:
    return max(result.runs, key=lambda run: run.duration)


def _idle(exposed: Exposure) -> Iterator[str]:
    """Say which terms the scene does not drive, and whether that is for want of a thermometer."""
    alone = exposed.output.single(np.ones(len(exposed.lib.terms)))
    idle = [name for name, size in zip(exposed.lib.names, alone, strict=True) if size == 0.0]
    if not idle:
        return
    single = set(idle).intersection(exposed.lib.on("gT"))
    heated = sum("*" in name for name in idle) > len(single)
    cold = heated and "T" not in exposed.scene.inputs.channels
    why = "it has no temperature, and " if cold else "it has no second thermometer, and " if single else ""
    yield f"{why}nothing in it drives {listed(idle)}: counted as without effect"
