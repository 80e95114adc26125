"""A study as its file says, what comes of it, and the linear problem of each of its sensors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.noise import OPTIONAL, Process
from imubayes.sensors.terms import Kind, Library
from imubayes.units import Key, Name, Positive, Seconds

if TYPE_CHECKING:
    from imubayes.algebra import FloatArray
    from imubayes.algebra.factor import Factor
    from imubayes.inference.known_quantities import Recovered
    from imubayes.inference.linear import Extra, Linear
    from imubayes.inference.mcmc import Chains
    from imubayes.inference.misfit import Misfit
    from imubayes.inference.observability import Observability
    from imubayes.inference.reproducibility import Spread
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.inference.robust import Distrusted
    from imubayes.inference.summary import RunSummary
    from imubayes.rig.recordings import RunSpec
    from imubayes.scenes import Scene
    from imubayes.scenes.propagation import Budget
    from imubayes.selection.compensations import Compensation
    from imubayes.selection.decision import Bias, Selection
    from imubayes.selection.noise_choice import NoiseChoice
    from imubayes.selection.panel import Panel


@dataclass(frozen=True, slots=True, eq=False)
class SensorSpec:
    """A sensor of a study, before its runs are read; the keys of ``[[sensor]]`` in SI.

    Attributes
    ----------
    truth : coefficients by name, for simulated runs; empty draws them from the class.
    prior : prior sds by name that take the place of the class's.
    reference : sd of each error of the bench that is allowed for, by its kind (`imubayes.rig.bench`).
    estimated : kinds of these whose sd the data are to tell; what `reference` says of them is then typical.
    unit, session : of a unit that was tested in several sessions; empty else.
    gyroscope : of an IMU, what is asked of its gyroscopes, on the same runs; the rest is then of its
        accelerometers. Its truth is by component and term, ``ax.b0``.
    bench_drawn : whether the bench of simulated runs has errors, drawn from `reference`.
    accept_prior_conflict : whether recorded outputs may be far beyond the class.
    bench_stated : whether the study says anything of its bench; what it does not name is then exact.
    """

    id: str
    kind: Kind
    sensor_class: SensorClass | None
    library: Library
    runs: tuple[RunSpec, ...]
    truth: Mapping[str, float]
    prior: Mapping[str, float] = field(default_factory=dict)
    reference: Mapping[str, float] = field(default_factory=dict)
    robust: bool = False
    unit: str = ""
    session: str = ""
    gyroscope: SensorSpec | None = None
    bench_drawn: bool = False
    accept_prior_conflict: bool = False
    estimated: frozenset[str] = frozenset()
    bench_stated: bool = False

    @property
    def halves(self) -> tuple[SensorSpec, ...]:
        """What is asked of accelerometers and of gyroscopes; of a sensor of one kind that alone."""
        return (self, self.gyroscope) if self.gyroscope else (self,)

    def of(self, kind: Kind) -> SensorSpec:
        """What is asked of the components of a kind."""
        return self.halves[-1] if kind == "gyroscope" else self


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the posterior is computed.

    Attributes
    ----------
    method : a rung of the ladder, ``auto``, the one that is right for each sensor, or ``exact``, plug-in.
    checkpoints : folder of the chains' files; None keeps none.
    resume : continue the chains that are in that folder.
    budget : s of compute that each sensor may take; the best rung of the ladder that fits in is taken.
    accuracy : posterior sd; the ladder is climbed until a rung changes no coefficient by more.
    """

    method: str = "auto"
    ess: Annotated[
        Positive,
        Key("effective sample size at which the chains of a sensor stop, reached by every parameter", 400),
    ] = 1000.0
    time_limit: Annotated[
        Seconds, Key("for each sensor; chains that are not done by then are reported as not converged", "1 h")
    ] = 600.0
    checkpoints: Path | None = None
    resume: bool = False
    budget: float | None = None
    accuracy: float | None = None

    @property
    def climbs(self) -> bool:
        """Whether the ladder of methods is asked for."""
        return self.budget is not None or self.accuracy is not None


@dataclass(frozen=True, slots=True)
class Appendix:
    """A table measured elsewhere, as texts, that the report shows beside its own results."""

    title: Annotated[Name, Key("heading", "Effective samples a second")]
    note: Annotated[str, Key("what it shows, in words", "Two cores.")] = ""
    command: Annotated[str, Key("that made it", "pytest -m benchmark")] = ""
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """A scene, and what is asked of the sensors there: of one kind, or with None of all.

    A sensor has its input along the case axis `axis`; a component of a triad has its own.
    """

    name: str
    scene: Scene
    budget: Budget
    axis: str = "x"
    kind: Kind | None = None


SHORTEST = 100
"""Samples below which a run tells nothing of its noise processes."""


@dataclass(frozen=True, slots=True)
class NoiseQuestion:
    """Which runs are asked for their noise processes."""

    identify: Annotated[
        Literal["static", "all", "none"],
        Key(
            "which runs are asked for their noise processes: `static` (quiet logs), `all` (tests too; of a"
            " triad or a whole IMU the samples at rest), or `none` ([docs/noise.md](noise.md))",
            "all",
        ),
    ] = "static"
    candidates: Annotated[
        tuple[Process, ...], Key("processes beside white noise that a run may show", ["B", "K", "Q"])
    ] = OPTIONAL

    def asks(self, rows: Linear) -> bool:
        """Whether a run is asked."""
        wanted = self.identify == "all" or (self.identify == "static" and rows.procedure == "static")
        return wanted and len(rows) >= SHORTEST


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A study, as its file `path` says, of the content `text`."""

    title: str
    seed: int
    sensors: tuple[SensorSpec, ...]
    path: Path
    text: str
    sampling: Sampling = field(default_factory=Sampling)
    appendices: tuple[Appendix, ...] = ()
    costs: Costs = EQUAL
    hierarchical: bool = False
    compare: bool = True
    scenes: tuple[Mission, ...] = ()
    noise: NoiseQuestion = field(default_factory=NoiseQuestion)


@dataclass(frozen=True, slots=True, eq=False)
class SensorCheck:
    """What the runs of a component can tell of its terms and extras, before anything is fitted.

    Of the runs, `notes` says what is wrong with their records.
    """

    id: str
    library: Library
    observability: Observability
    extras: tuple[Extra, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ExtraPosterior:
    """Posterior (SI) of a column that is no term, under the full library; partners are confounded with it."""

    extra: Extra
    mean: float
    sd: float
    partners: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """Which rung of the ladder of methods was taken, and why: part of a result.

    Attributes
    ----------
    rung : that was taken.
    asked : in words, as the user asked: a budget of time, an accuracy, or a rung by its name.
    seconds : that it took, with all rungs below it that were climbed.
    foreseen : s, what the machine's cost law said before.
    climbed : rungs that were run, with the change that each made to the coefficients against the one before
        (largest over terms, in posterior sd) and to the inclusions (largest difference); 0 for the first.
    next_rung : the one above; None at the top.
    next_seconds : what it would take.
    next_change : what it would change: (coefficients in posterior sd, inclusions), foreseen as
        `next_reason` says.
    next_reason : how `next_change` was foreseen, a sentence; where there is no rung above, why.
    budget : s, where a budget was asked for.
    accuracy : in posterior sd, where an accuracy was asked for.
    """

    rung: str
    asked: str
    seconds: float
    foreseen: float
    climbed: tuple[tuple[str, float, float], ...]
    next_rung: str | None
    next_seconds: float
    next_change: tuple[float, float]
    next_reason: str
    budget: float | None = None
    accuracy: float | None = None

    @property
    def met(self) -> bool:
        """Whether what was asked for is what came: in time, or a last step within the accuracy."""
        if self.accuracy is not None:
            return len(self.climbed) > 1 and self.climbed[-1][1] <= self.accuracy
        return self.budget is None or self.seconds <= self.budget


@dataclass(frozen=True, slots=True, eq=False)
class SensorResult:
    """What a study says of one component.

    Attributes
    ----------
    id : sensor's id; ``<sensor>.<component>`` for a component of a triad.
    kind, class_id : of the component; the class is empty where the study names none.
    samples : rows used.
    runs : noise, ranges and source of each run.
    selection : verdicts and models.
    checks : residual checks by run.
    draws : (m, p) exact posterior draws of the coefficients (zero where a draw's model has no such term).
    prior_draws : (m, p) draws of the prior, in the same form.
    prior_source : in words, where the priors come from.
    seconds : compute time.
    calibration : for a reference-free triad, the component's row of the compensation; else None.
    method, method_reason : how the posterior was computed, and why so.
    chains : of the sampler; None where the method has none.
    extras : what the data say of the columns that are no terms.
    distrusted : dwells that the robust analysis holds for contaminated, worst first.
    panel : what every other method says.
    misfit : what the residuals say that the library does not contain; None where they were not asked.
    correlation : (p, p) of the coefficients under the full library; None where it was not asked.
    drive : factor of the library's columns over the samples of the test; None where it was not asked.
    choice : which rung of the ladder was taken, and what the next would change; None where none was asked.
    processes : noise processes of the runs that were asked for them.
    pooled : of each term by name, probability that all components of its kind in the case have it, not none;
        empty for a single component.
    recovered : known quantities of the case's runs before and after compensation, alike for all of its
        components; none where inputs are known.
    bias : at the start, on average and at the end of the record, where a random walk of the noise counts: b0
        is then the average. None where it is one and the same.
    compensations : models that may be exported, the best predicting one first; none if nothing was left out.
    spreads : sds that the data tell: of errors of the bench from mount to mount or run to run, of what dwells
        of a run scatter by beyond its samples, and of functions of inputs that the library lacks.
    absorbed : what residuals showed before such functions stood beside the library; None where nothing did.
    """

    id: str
    kind: Kind
    class_id: str
    samples: int
    runs: tuple[RunSummary, ...]
    selection: Selection
    checks: tuple[ResidualCheck, ...]
    draws: FloatArray
    prior_draws: FloatArray
    prior_source: str
    seconds: float
    calibration: Mapping[str, object] | None = None
    method: str = "plug-in"
    method_reason: str = ""
    chains: Chains | None = None
    extras: tuple[ExtraPosterior, ...] = ()
    distrusted: tuple[Distrusted, ...] = ()
    panel: Panel | None = None
    misfit: Misfit | None = None
    correlation: FloatArray | None = None
    drive: Factor | None = None
    choice: Choice | None = None
    processes: tuple[NoiseChoice, ...] = ()
    pooled: Mapping[str, float] = field(default_factory=dict)
    pulls: Mapping[str, FloatArray] = field(default_factory=dict)
    recovered: tuple[Recovered, ...] = ()
    bias: Bias | None = None
    compensations: tuple[Compensation, ...] = ()
    spreads: tuple[Spread, ...] = ()
    absorbed: Misfit | None = None

    @property
    def conditional(self) -> bool:
        """Whether the data reject the model, so that verdicts hold only if what it lacks touches no term."""
        return bool(self.misfit and self.misfit.found) or not all(check.fits for check in self.checks)


def file_name(name: str) -> str:
    """Name of a file for a sensor or run: what file systems forbid becomes a dash.

    Examples
    --------
    >>> file_name("ACC 07/b"), file_name("..")
    ('ACC-07-b', 'unnamed')
    """
    return re.sub(r"[^\w.-]+", "-", name).strip("-.") or "unnamed"
