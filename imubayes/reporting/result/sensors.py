"""The published result of a study of sensors: what ``result.json`` holds, in SI."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from imubayes.reporting.result.entries import (
    Appendix,
    Budget,
    Case,
    Column,
    Confounded,
    Criterion,
    Digits,
    DistrustedDwell,
    Drop,
    ErrorSize,
    Extra,
    Mcmc,
    Misfit,
    ModelProbability,
    Noise,
    NoiseDraws,
    Observed,
    Population,
    Processes,
    Provenance,
    Reduced,
    Residuals,
    RungChoice,
    Sensitivity,
    Sessions,
    SparseSupport,
    Standard,
    TermGroup,
    Unasked,
    Votes,
)
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
