"""What the scenes of a study require of each component that was characterised."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from imubayes.campaign.study import Mission, SensorResult, SensorSpec
from imubayes.scenes.relevance import (
    MATTERS,
    QUADRANTS,
    Exposure,
    Relevance,
    TermRelevance,
    exposure,
    known,
    weigh,
)
from imubayes.selection.verdicts import listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Library

CANNOT_TELL = ("untested", "unresolved", "inseparable")
"""Verdicts that leave a term open."""


def required(
    missions: Sequence[Mission], results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
) -> tuple[tuple[str, Relevance], ...]:
    """Hold every component against every scene: its id, and what the scene requires of it, scene by scene.

    A budget of the output is only for components of its kind.
    """
    found: list[tuple[str, Relevance]] = []
    for mission in missions:
        exposed: dict[tuple[str, Library], Exposure] = {}
        for spec, one in ((spec, one) for spec, components in results for one in components):
            if mission.kind in (None, one.kind):
                key = _axis(mission, spec, one), component_library(spec, one)
                if key not in exposed:
                    exposed[key] = exposure(mission.scene, key[1], mission.budget, axis=key[0])
                found.append((one.id, _required(mission, exposed[key], one)))
    return tuple(found)


def _axis(mission: Mission, spec: SensorSpec, result: SensorResult) -> str:
    """Case axis of a component's input: of a triad its own (``ax`` lies along x)."""
    component = result.id.removeprefix(f"{spec.id}.")
    return component[-1] if component in COMPONENTS and result.id != spec.id else mission.axis


def component_library(spec: SensorSpec, result: SensorResult) -> Library:
    """Terms of a component: a triad leaves out those that only turn its case."""
    names = {term.name for term in result.selection.terms}
    lib = spec.of(result.kind).library
    return replace(lib, terms=tuple(term for term in lib.terms if term.name in names), ties=())


def _required(mission: Mission, exposed: Exposure, result: SensorResult) -> Relevance:
    """Hold one component against one scene; the longest run shows its B and K best."""
    longest = max(result.runs, key=lambda run: run.duration)
    found = weigh(exposed, known(result.selection, result.draws), noise=longest.noise)
    notes = (*found.notes, f"noise as in run '{longest.name}'", *_idle(exposed))
    open_terms = {term.name for term in result.selection.terms if term.verdict in CANNOT_TELL}
    terms = tuple(_unshown(term) if term.name in open_terms else term for term in found.terms)
    return replace(found, scene=mission.name, notes=notes, terms=terms)


def _unshown(term: TermRelevance) -> TermRelevance:
    """Term that the test could not tell: its inclusion is mostly the prior's, and shows nothing."""
    return replace(term, quadrant=QUADRANTS[2] if term.possible >= MATTERS else QUADRANTS[3])


def _idle(exposed: Exposure) -> Iterator[str]:
    """Say which terms the scene does not drive, and whether that is for want of a temperature."""
    alone = exposed.output.single(np.ones(len(exposed.lib.terms)))
    idle = [name for name, size in zip(exposed.lib.names, alone, strict=True) if size == 0.0]
    if not idle:
        return
    cold = any("*" in name for name in idle) and "T" not in exposed.scene.inputs.channels
    why = "it has no temperature, and " if cold else ""
    yield f"{why}nothing in it drives {listed(idle)}: counted as without effect"
