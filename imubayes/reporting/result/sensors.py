"""The published result of a study of sensors: what ``result.json`` holds, in SI."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from imubayes.reporting.result.entries import (
    AbsorbedTerms,
    Allan,
    Appendix,
    BetweenSessions,
    Budget,
    Column,
    Confounded,
    Digits,
    DistrustedDwell,
    Drop,
    ErrorSize,
    Evidence,
    Extra,
    Measurement,
    Misfit,
    ModelProbability,
    NeededShare,
    Noise,
    NoiseDraws,
    Observed,
    Outlier,
    Pooled,
    PopulationMean,
    ProcessSet,
    Provenance,
    RecoveredRms,
    Reduced,
    RungChoice,
    Sensitivity,
    SessionShift,
    SparseSupport,
    Spread,
    TermGroup,
    Unasked,
    Votes,
)
from imubayes.reporting.result.values import (
    PUBLISHED,
    Count,
    Flag,
    Loose,
    Matrix,
    Names,
    Number,
    Numbers,
)

Kind = Literal["accelerometer", "gyroscope"]


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Process:
    """A noise process of a run."""

    unit: str
    printed_unit: str
    inclusion: Number
    mean: Number
    sd: Number
    q05: Number
    q50: Number
    q95: Number
    limit95: Number
    detection_limit: Number
    verdict: str
    reason: str
    confounded_with: Names


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Processes:
    """Noise processes of a run that was asked for them."""

    identified: Names
    prior_source: str
    rows: Count
    processes: dict[str, Process]
    sets: tuple[ProcessSet, ...]
    allan: Allan | None


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
class Criterion:
    """The best subset by an information criterion or a predictive score."""

    model: Names
    value: Number
    lead: Number
    inclusion: dict[str, Number]
    samples: Number
    compared: Count
    exact: Flag
    pareto_k: Number
    note: str


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Mcmc:
    """How the draws came about, and how well the chains mixed."""

    sampler: str
    draws: Count
    ess_min: Number
    rhat_max: Number
    acceptance: Number
    seconds: Number
    converged: Flag
    text: str
    tau_max: Number
    steps: Count
    walkers: Count
    ensembles: Count
    worst: str | None
    interpolation_error: Number
    log_evidence: Evidence | None


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Residuals:
    """Residuals of a run against its noise."""

    run: str
    scale: Number
    whiteness_p: Number
    normality_p: Number
    sample_scale: Number
    sample_whiteness_p: Number
    fits: Flag
    level: Number
    outliers: tuple[Outlier, ...]


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
class Symbol:
    """A coefficient as a standard defines it."""

    symbol: str
    value: Number
    sd: Number
    unit: str
    printed_unit: str
    term: str
    verdict: str
    note: str


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Standard:
    """The component in the terms of a standard."""

    title: str
    values: tuple[Symbol, ...]
    untested: Names
    absent: Names
    exact: str
    standard_only: Names
    general_only: Names
    absorbed: AbsorbedTerms | None
    trouble: str


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
class Sessions:
    """A parameter of units that were tested in several sessions."""

    parameter: str
    unit: str
    printed_unit: str
    units: Names
    sessions: Names
    mean: Matrix
    sd: Matrix
    pulls: tuple[Matrix, ...]
    p_value: Number
    level: Number
    between: BetweenSessions
    exceeds: Flag
    shared: Number


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class PopulationTerm:
    """A term over the units of a class."""

    parameter: str
    term: str
    component: str
    unit: str
    printed_unit: str
    class_size: Number
    mean: PopulationMean
    unit_to_unit: Spread
    turn_on: Spread
    turn_on_own: Spread
    turn_on_common: Spread
    p_value: Number
    level: Number
    common_share: Spread
    next_unit: Spread
    session_shift: SessionShift
    measurement: Measurement
    verdict: str
    reason: str
    answers: dict[str, Count]
    needed: NeededShare
    pooled_inclusion: Number


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Population:
    """Units of a class and kind, put together."""

    class_: Annotated[str, Field(alias="class")]
    kind: Kind
    units: Names
    sessions: Names
    components: Names
    terms: tuple[PopulationTerm, ...]


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class RecoveredErrors:
    """A known quantity of a run, before and after compensation."""

    run: str
    what: str
    unit: str
    count: Count
    rms: RecoveredRms
    within_2_sd: Count
    of: Count
    saturated: Flag
    errors: Matrix
    sd: Matrix


@dataclass(frozen=True, kw_only=True, config=PUBLISHED)
class Case:
    """Components in one case."""

    id: str
    recovered: tuple[RecoveredErrors, ...]
    pooled: dict[str, dict[str, Pooled]]


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
