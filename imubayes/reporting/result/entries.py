"""The published result of a study of sensors: what ``result.json`` holds, in SI; small tables on one line."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass
from typing_extensions import TypedDict

from imubayes.reporting.result.values import (
    PUBLISHED,
    Count,
    Flag,
    Kind,
    Loose,
    Matrix,
    Names,
    Number,
    Numbers,
)

# fmt: off
Provenance = TypedDict("Provenance", {
    "study_file": str, "study_text": str, "command": str, "versions": dict[str, str],
})
Noise = TypedDict("Noise", {"N": Number, "B": Number, "K": Number})
Moments = TypedDict("Moments", {"mean": Number, "sd": Number, "q05": Number, "q95": Number})
NoiseDraws = TypedDict("NoiseDraws", {"N": Moments, "B": Moments, "K": Moments})
ProcessSet = TypedDict("ProcessSet", {"processes": Names, "probability": Number})
Allan = TypedDict("Allan", {
    "values": dict[str, Number], "log_sd": dict[str, Number], "chi2": Number, "dof": Count,
})
Step = TypedDict("Step", {"rung": str, "change_sd": Number, "change_inclusion": Number})
NextRung = TypedDict("NextRung", {
    "rung": str, "seconds": Number, "change_sd": Number, "change_inclusion": Number, "foreseen_by": str,
})
RungChoice = TypedDict("RungChoice", {
    "rung": str, "asked": str, "met": Flag, "seconds": Number, "foreseen_seconds": Number,
    "climbed": tuple[Step, ...], "next": NextRung | None,
})
SparseSupport = TypedDict("SparseSupport", {
    "model": Names, "inclusion": dict[str, Number], "strength": Number, "stable": Names, "cut": Number,
    "false_bound": Number,
})
Sensitivity = TypedDict("Sensitivity", {
    "widths": Numbers, "inclusion": dict[str, Numbers], "g_prior": dict[str, Number], "left_out": Names,
    "swing": Names,
})
Disagreement = TypedDict("Disagreement", {"term": str, "methods": Names, "cause": str, "text": str})
Votes = TypedDict("Votes", {
    "terms": Names, "strength": dict[str, Numbers], "keeps": dict[str, Numbers],
    "disagreements": tuple[Disagreement, ...],
})
Loss = TypedDict("Loss", {"terms": Names, "lost": Number})
Reduced = TypedDict("Reduced", {
    "terms": Names, "coefficients": Numbers, "budget": Number, "lost": Number, "path": tuple[Loss, ...],
})
Unasked = TypedDict("Unasked", {"method": str, "reason": str})
Dependence = TypedDict("Dependence", {"run": str, "input": str, "p": Number, "share": Number, "size": Number})
Misfit = TypedDict("Misfit", {
    "text": str, "found": tuple[Dependence, ...], "dependences": tuple[Dependence, ...],
    "predictive_p": dict[str, Number], "level": Number,
})
TermGroup = TypedDict("TermGroup", {"terms": Names, "any_inclusion": Number})
Evidence = TypedDict("Evidence", {"value": Number, "sd": Number, "exact": Number})
Extra = TypedDict("Extra", {
    "name": str, "kind": str, "unit": str, "prior_sd": Number, "mean": Number, "sd": Number,
    "confounded_with": Names, "text": str, "printed_unit": str,
})
DistrustedDwell = TypedDict("DistrustedDwell", {
    "run": str, "start": Number, "stop": Number, "probability": Number, "offset": Number, "sd": Number,
})
ModelProbability = TypedDict("ModelProbability", {"terms": Names, "probability": Number})
Confounded = TypedDict("Confounded", {
    "terms": Names, "direction": Numbers, "seen": Number, "exact": Flag, "reason": str, "remedy": str,
})
Observed = TypedDict("Observed", {"tested": Flag, "ratio": Number, "alone": Number, "vif": Number})
Outlier = TypedDict("Outlier", {"start": Number, "stop": Number, "size": Number})
Column = TypedDict("Column", {"column": str, "channel": str, "unit": str})
Digits = TypedDict("Digits", {"coefficients": Count, "sd": Count, "log_evidence": Count, "inclusion": Count})
AbsorbedTerms = TypedDict("AbsorbedTerms", {
    "terms": Names, "inputs": str, "rms": Number, "left": Number, "printed_unit": str,
})
Budget = TypedDict("Budget", {"quantity": str, "limit": Number})
ErrorSize = TypedDict("ErrorSize", {"median": Number, "q95": Number})
Interval = TypedDict("Interval", {"value": Number, "low": Number, "high": Number})
Drop = TypedDict("Drop", {"terms": Count, "dropped": str, "error": Number})
BetweenSessions = TypedDict("BetweenSessions", {"mean": Number, "q05": Number, "q95": Number})
Spread = TypedDict("Spread", {"median": Number, "q05": Number, "q95": Number})
PopulationMean = TypedDict("PopulationMean", {"sd": Number, "median": Number, "q05": Number, "q95": Number})
SessionShift = TypedDict("SessionShift", {"sessions": Names, "mean": Numbers, "sd": Numbers})
Measurement = TypedDict("Measurement", {"noise": Number, "alias": Number})
NeededShare = TypedDict("NeededShare", {"share": Number, "q05": Number, "q95": Number})
RecoveredRms = TypedDict("RecoveredRms", {
    "before": Number, "after": Number, "flown": Number, "fitted": Number, "fresh": Number,
})
Pooled = TypedDict("Pooled", {"inclusion": Number, "verdict": str})
Appendix = TypedDict("Appendix", {"title": str, "command": str})
Coverage = TypedDict("Coverage", {"held": Count, "of": Count, "share": Interval})
Check = TypedDict("Check", {
    "precision": Interval, "recall": Interval, "cells": tuple[Count, Count], "population_mean": Coverage,
    "population_spread": Coverage, "untold": Count,
})
Worst = TypedDict("Worst", {"unit": str, "term": str, "value": Number, "pull": Number, "outlier": Flag})
Broken = TypedDict("Broken", {"number": Count, "name": str, "error": str})
NoiseIntervals = TypedDict("NoiseIntervals", {"N": Interval, "B": Interval, "K": Interval})
Process = TypedDict("Process", {
    "unit": str, "printed_unit": str, "inclusion": Number, "mean": Number, "sd": Number, "q05": Number,
    "q50": Number, "q95": Number, "limit95": Number, "detection_limit": Number, "verdict": str,
    "reason": str, "confounded_with": Names,
})
Processes = TypedDict("Processes", {
    "identified": Names, "prior_source": str, "rows": Count, "processes": dict[str, Process],
    "sets": tuple[ProcessSet, ...], "allan": Allan | None,
})
Criterion = TypedDict("Criterion", {
    "model": Names, "value": Number, "lead": Number, "inclusion": dict[str, Number], "samples": Number,
    "compared": Count, "exact": Flag, "pareto_k": Number, "note": str,
})
Mcmc = TypedDict("Mcmc", {
    "sampler": str, "draws": Count, "ess_min": Number, "rhat_max": Number, "acceptance": Number,
    "seconds": Number, "converged": Flag, "text": str, "tau_max": Number, "steps": Count, "walkers": Count,
    "ensembles": Count, "worst": str | None, "interpolation_error": Number, "log_evidence": Evidence | None,
})
Residuals = TypedDict("Residuals", {
    "run": str, "scale": Number, "whiteness_p": Number, "normality_p": Number, "sample_scale": Number,
    "sample_whiteness_p": Number, "fits": Flag, "level": Number, "outliers": tuple[Outlier, ...],
})
Symbol = TypedDict("Symbol", {
    "symbol": str, "value": Number, "sd": Number, "unit": str, "printed_unit": str, "term": str,
    "verdict": str, "note": str,
})
Standard = TypedDict("Standard", {
    "title": str, "values": tuple[Symbol, ...], "untested": Names, "absent": Names, "exact": str,
    "standard_only": Names, "general_only": Names, "absorbed": AbsorbedTerms | None, "trouble": str,
})
Sessions = TypedDict("Sessions", {
    "parameter": str, "unit": str, "printed_unit": str, "units": Names, "sessions": Names, "mean": Matrix,
    "sd": Matrix, "pulls": tuple[Matrix, ...], "p_value": Number, "level": Number,
    "between": BetweenSessions, "exceeds": Flag, "shared": Number,
})
PopulationTerm = TypedDict("PopulationTerm", {
    "parameter": str, "term": str, "component": str, "unit": str, "printed_unit": str, "class_size": Number,
    "mean": PopulationMean, "unit_to_unit": Spread, "turn_on": Spread, "turn_on_own": Spread,
    "turn_on_common": Spread, "p_value": Number, "level": Number, "common_share": Spread,
    "next_unit": Spread, "session_shift": SessionShift, "measurement": Measurement, "verdict": str,
    "reason": str, "answers": dict[str, Count], "needed": NeededShare, "pooled_inclusion": Number,
})
Population = TypedDict("Population", {
    "class": str, "kind": Kind, "units": Names, "sessions": Names, "components": Names,
    "terms": tuple[PopulationTerm, ...],
})
RecoveredErrors = TypedDict("RecoveredErrors", {
    "run": str, "what": str, "unit": str, "count": Count, "rms": RecoveredRms, "within_2_sd": Count,
    "of": Count, "saturated": Flag, "errors": Matrix, "sd": Matrix,
})
Case = TypedDict("Case", {
    "id": str, "recovered": tuple[RecoveredErrors, ...], "pooled": dict[str, dict[str, Pooled]],
})
FleetTerm = TypedDict("FleetTerm", {
    "name": str, "needed": Interval, "open": Number, "mean": Interval, "spread": Interval,
    "true_mean": Number, "true_spread": Number, "symbol": str, "unit": str, "verdicts": dict[str, Count],
})
Fleet = TypedDict("Fleet", {
    "kind": Kind, "class": str, "units": Count, "read": Count, "samples": Count,
    "terms": tuple[FleetTerm, ...], "order": Interval, "noise": NoiseIntervals, "outliers": Count,
    "limit": Number, "worst": tuple[Worst, ...], "broken": tuple[Broken, ...],
})
# fmt: on


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Term:
    """A term of a component; `printed_unit` is the one that people use."""

    name: str
    symbol: str
    unit: str
    mean: Number
    sd: Number
    q05: Number
    q95: Number
    full_mean: Number
    full_sd: Number
    prior_sd: Number
    inclusion: Number
    inclusion_range: Numbers
    limit95: Number
    verdict: str
    reason: str
    confounded_with: Names
    group: str
    printed_unit: str
    effect: Number
    plug_in_inclusion: Number
    mcmc_mean: Number
    mcmc_sd: Number


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Run:
    """A run: its source, and what it applied."""

    name: str
    procedure: str
    samples: Count
    duration: Number
    interval: Number
    sampling: Number
    noise_origin: str
    noise_log_sd: Noise
    ranges: dict[str, Numbers]
    file: str
    sha256: str | None
    columns: tuple[Column, ...]
    notes: Names
    stills: Matrix


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Sensor:
    """What a study says of one component."""

    id: str
    kind: Kind
    class_: Annotated[str | None, Field(alias="class")]
    samples: Count
    noise: dict[str, Noise]
    noise_posterior: dict[str, NoiseDraws]
    noise_processes: dict[str, Processes]
    method: str
    method_reason: str
    choice: RungChoice | None
    terms: tuple[Term, ...]
    model: Names
    log_evidence: Number
    criteria: dict[str, Criterion]
    sindy: dict[str, SparseSupport]
    sensitivity: Sensitivity | None
    votes: Votes | None
    reduced: Reduced | None
    unasked: tuple[Unasked, ...]
    misfit: Misfit | None
    groups: tuple[TermGroup, ...]
    mcmc: Mcmc
    extras: tuple[Extra, ...]
    distrusted: tuple[DistrustedDwell, ...]
    n_models: Count
    drawn_models: Count
    missing: Number
    inclusion_error: Number
    best_models: tuple[ModelProbability, ...]
    by_size: Numbers
    candidates: Names
    inclusion_by_width: dict[str, Numbers]
    confounded: tuple[Confounded, ...]
    observability: dict[str, Observed]
    residuals: tuple[Residuals, ...]
    runs: tuple[Run, ...]
    prior_source: str
    calibration: Loose | None
    digits: Digits | None
    pooled_inclusion: dict[str, Number]
    standards: dict[str, Standard]
    seconds: Number


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class TermInScene:
    """What a term does in a scene, and its share of the budget."""

    name: str
    rms: Number
    effect: Number
    share_of_budget: Number
    share_q05: Number
    share_q95: Number
    share_at_limit95: Number
    share_unknown: Number
    inclusion: Number
    kept: Flag
    quadrant: str


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Scene:
    """A component in a scene."""

    name: str
    sensor: str
    axis: str
    duration: Number
    budget: Budget
    model: Names
    within_budget: Flag
    terms: tuple[TermInScene, ...]
    left_out_rms: Number
    left_out: ErrorSize
    left: ErrorSize
    calibrated: ErrorSize
    uncompensated: ErrorSize
    path: tuple[Drop, ...]
    noise: Noise
    notes: Names


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class SensorsResult:
    """Result of a study of sensors."""

    imubayes: str
    study: str
    seed: Count
    sensors: tuple[Sensor, ...]
    scenes: tuple[Scene, ...]
    sessions: tuple[Sessions, ...]
    population: tuple[Population, ...]
    cases: tuple[Case, ...]
    appendices: tuple[Appendix, ...]
    provenance: Provenance
