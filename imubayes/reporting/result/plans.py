"""The published results of a plan, and of a trade of speed for accuracy; SI."""

from __future__ import annotations

from typing import Literal, NotRequired

from pydantic.dataclasses import dataclass
from typing_extensions import TypedDict

from imubayes.reporting.result.entries import Confounded, Interval, Provenance
from imubayes.reporting.result.values import PUBLISHED, Count, Kind, Names, Number

# fmt: off
Predicted = TypedDict("Predicted", {"sd": Number, "simulated": Number})
PlannedTerm = TypedDict("PlannedTerm", {
    "name": str, "unit": str, "prior_sd": Number, "known_sd": Number, "needed_sd": Number,
    "even": Predicted, "same": NotRequired[Predicted], "best": Predicted,
})
PlannedStep = TypedDict("PlannedStep", {
    "run": str, "start": Number, "at": Count, "mount": str, "set_to": str, "dwell": Number,
})
PlanFound = TypedDict("PlanFound", {
    "name": str, "seconds": Number, "size_of_aim": Number, "worst": str, "worst_ratio": Number,
    "share_of_budget": Number, "confounded": tuple[Confounded, ...], "steps": tuple[PlannedStep, ...],
})
Plan = TypedDict("Plan", {
    "sensor": str, "kind": Kind, "time": Number, "aim": Literal["worst", "D", "scene"], "units": Count,
    "needed": Names, "terms": tuple[PlannedTerm, ...], "plans": tuple[PlanFound, ...],
})
Floor = TypedDict("Floor", {"largest": Number, "rms": Number})
Rate = TypedDict("Rate", {"events": Count, "of": Count, "share": Interval})
Rung = TypedDict("Rung", {
    "rung": str, "seconds": Number, "whole_seconds": Number, "processor_seconds": Number, "memory": Number,
    "largest": Number, "rms": Number, "inclusion": Number, "verdicts": Count, "scene_share": Number,
    "scene_terms": Count, "monte_carlo": Number, "foreseen": Number, "components": Count,
})
RungScore = TypedDict("RungScore", {
    "rung": str, "repeats": Count, "coverage": Rate, "error": Number, "false_needed": Rate,
    "false_not_needed": Rate, "missed_large": Rate, "cost": Number, "scene_terms": Number,
})
SceneChange = TypedDict("SceneChange", {"scene": str, "terms": Names, "share": Number})
Difference = TypedDict("Difference", {
    "largest": Number, "rms": Number, "worst": str, "inclusion": Number,
    "verdicts": tuple[tuple[str, str, str], ...], "scenes": tuple[SceneChange, ...],
})
AnsweredTerm = TypedDict("AnsweredTerm", {
    "name": str, "mean": Number, "full_mean": Number, "full_sd": Number, "inclusion": Number, "verdict": str,
})
ComponentRung = TypedDict("ComponentRung", {
    "rung": str, "seconds": Number, "seconds_to_what_was_asked": Number, "processor_seconds": Number,
    "memory": Number, "ess": Number, "foreseen_change_sd": Number, "foreseen_change_inclusion": Number,
    "difference": Difference, "model": Names, "terms": tuple[AnsweredTerm, ...],
})
Component = TypedDict("Component", {
    "id": str, "best": str, "monte_carlo_floor": Floor, "skipped": dict[str, str],
    "rungs": tuple[ComponentRung, ...],
})
Machine = TypedDict("Machine", {
    "processor": str, "system": str, "cores": Count, "threads": dict[str, Count], "load": Number,
    "versions": dict[str, str],
})
Traded = TypedDict("Traded", {"study_file": str, "study_text": str, "command": str})
# fmt: on


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class PlanResult:
    """Result of a plan."""

    imubayes: str
    study: str
    seed: Count
    answer: Names
    plan: Plan
    seconds: Number
    provenance: Provenance


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class TradeResult:
    """Result of a trade of speed for accuracy."""

    imubayes: str
    study: str
    seed: Count
    limit: Number
    repeats: Count
    answer: Names
    recommended: str
    default: str
    best: str
    front: Names
    monte_carlo_floor: Floor
    good_enough: Number
    rungs: tuple[Rung, ...]
    scores: tuple[RungScore, ...]
    components: tuple[Component, ...]
    machine: Machine
    seconds: Number
    provenance: Traded
