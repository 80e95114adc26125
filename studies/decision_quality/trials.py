"""What every method says of simulated sensors, as modelled and where the model is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast, get_args

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import Factor
from imubayes.campaign import SensorSpec
from imubayes.campaign.preparation import prepare
from imubayes.campaign.prepared import Doubt, Prepared
from imubayes.errors import ImubayesError
from imubayes.inference.drift import drift_of
from imubayes.inference.prior import class_sd
from imubayes.inference.residuals import FAMILIES
from imubayes.inference.summary import Summary, summarize
from imubayes.ladder.posteriors import averaged
from imubayes.ladder.problem import decided, ground_of, prepared, problem_of
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import Procedure, RunSpec
from imubayes.selection.decision import LOOSE, Selection, over_record, select
from imubayes.selection.panel import Votes, begun, panel_of
from imubayes.selection.sensitivity import combined, mounts_of
from imubayes.selection.verdicts import EQUAL
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library, library
from imubayes.work import Progress, shared, silent
from studies.decision_quality.faults import COARSE, FAULTS, MOUNTED, WARM, applies
from studies.decision_quality.subjects import Subject, as_read, runs_of, subject, walked

MODELLED = "as modelled"
WHITE = "noise assumed white"
MISSING = "one true term missing"

TREATMENTS = (MODELLED, *FAULTS, WHITE, MISSING)
"""How a sensor is treated: rightly; on a test with a fault that nobody knows of; or by a wrong analysis."""

STRONG = 8.0
"""Effect over noise from which a true term is strong: one of these is what goes missing."""

DECISION, EVIDENCE, TRUSTED = "decision", "evidence alone", "evidence, bench trusted"
OWN = (DECISION, EVIDENCE, TRUSTED)
"""The decision; what the evidence alone would say; and what it would if the bench had no errors at all."""

SIDES = {"needed": 1.0, "not needed": 0.0}
"""Verdicts that do not leave a term open."""


@dataclass(frozen=True, slots=True)
class QualityStudy:
    """What is measured: so many sensors of each kind, and `misspecified` of them under wrong treatments.

    `MODELLED` is always among the treatments. Sensors are drawn from some `classes` of the catalogue, or from
    all where that is empty, with candidates of these `powers` and this `asymmetry`
    (`imubayes.sensors.terms.library`). `resamples` campaigns are drawn for the frequencies of the sparse
    regressions.
    """

    seed: int = 7
    sensors: int = 20
    misspecified: int = 8
    treatments: tuple[str, ...] = TREATMENTS
    classes: tuple[str, ...] = (
        "mems_consumer", "mems_industrial", "mems_tactical", "vba_quartz", "quartz_flexure_servo",
        "strategic_piga", "fog_tactical", "fog_navigation", "rlg_navigation", "rlg_tactical",
        "hrg_navigation", "ifog_strategic", "mech_sdf_rig", "mech_dtg",
    )  # fmt: skip
    powers: int = 3
    asymmetry: int = 1
    resamples: int = 20
    processes: int = 2
    command: str = "python -m studies.decision_quality"


SMALL = QualityStudy(
    sensors=1,
    misspecified=1,
    treatments=(MODELLED, MOUNTED, COARSE, WHITE, MISSING),
    classes=(),
    powers=2,
    asymmetry=-1,
    resamples=2,
    processes=1,
)
"""One sensor of each kind, and a treatment of each sort."""


OPTIONS = ("sensors", "misspecified", "treatments", "resamples", "processes")
"""Settings that the command line can change."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What the methods say of one sensor under one treatment.

    Attributes
    ----------
    kind, number, class_id : of the sensor.
    treatment : one of `TREATMENTS`.
    terms : names of the t terms that the test excites and the library holds.
    truth : (t,) coefficients, SI.
    effect : (t,) size of each over its sd under the full library without a prior, with the noise estimated.
    methods : m of them, `OWN` first.
    keeps : (m, t) 1 in the method's model, 0 out.
    strength : (m, t) from 0 to 1; NaN where a method says nothing.
    said : (m, t) 1 for needed, 0 for not needed, NaN for what is left open.
    pull : (m, t) of what has a verdict: mean less truth over sd, model-averaged of what is needed, of what is
        not with all candidates; NaN elsewhere.
    missing : term that was taken out of the library; empty where none was.
    refused : why the analysis refuses, which leaves all terms open; empty where it does not.
    """

    kind: Kind
    number: int
    class_id: str
    treatment: str
    terms: tuple[str, ...]
    truth: FloatArray
    effect: FloatArray
    methods: tuple[str, ...]
    keeps: FloatArray
    strength: FloatArray
    said: FloatArray
    pull: FloatArray
    missing: str = ""
    refused: str = ""


def trials(study: QualityStudy, *, progress: Progress = silent) -> tuple[Trial, ...]:
    """Simulate every sensor, and ask every method about it under every treatment.

    In the order of kinds, sensors and treatments, whatever the number of processes; `progress` is told how
    many sensors are done.
    """
    jobs = [(study, kind, k) for kind in get_args(Kind) for k in range(study.sensors)]
    found = shared(judge, jobs, study.processes, things="sensors", progress=progress)
    return tuple(trial for told in found for trial in told)


def judge(study: QualityStudy, kind: Kind, number: int) -> list[Trial]:
    """Ask every method about one sensor under every treatment that it takes part in."""
    lib = library(kind, powers=study.powers, asymmetry=study.asymmetry)
    one = subject(lib, number, study.seed, study.classes)
    reference = _Reference.of(one, summarize(runs_of(one), one.library, sensor=one.sensor))
    return [
        _trial(one, reference, treatment, study.resamples)
        for treatment in dict.fromkeys((MODELLED, *study.treatments))
        if number < (study.sensors if treatment == MODELLED else study.misspecified)
        and applies(one.plans, treatment)
        and (treatment != MISSING or reference.strong(one.truth))
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    """The right analysis of a sensor: what any method could see of each term.

    `T` is the factor (p + 1, p + 1) under a prior so wide that it only holds what the data leave open.
    """

    summary: Summary
    T: Factor
    scale: float
    seed: tuple[int, ...]

    @classmethod
    def of(cls, one: Subject, summary: Summary) -> _Reference:
        """Prepare the analysis of a sensor's runs."""
        whole, sd = summary.factor, class_sd(one.sensor, one.library)
        scale = algebra.noise_scale(whole, sd)
        held = replace(whole, R=algebra.with_prior_rows(whole.R, scale / (LOOSE * sd)))
        return cls(summary, held, scale, (*one.seed, 2))

    def effect(self, name: str, truth: Mapping[str, float]) -> float:
        """Size of what a term adds that no other can, over the noise: ``|theta| / sd``."""
        T = algebra.reorder(self.T, [*(other for other in self.T.names if other != name), name]).R
        return abs(float(T[-2, -2]) * truth[name]) / self.scale

    def strong(self, truth: Mapping[str, float]) -> str:
        """One of the true terms that are strong, by lot; empty where there is none. The bias always stays."""
        found = [n for n, v in truth.items() if v and n != "b0" and self.effect(n, truth) > STRONG]
        return str(np.random.default_rng(self.seed).choice(found)) if found else ""


def _trial(one: Subject, reference: _Reference, treatment: str, resamples: int) -> Trial:
    """Ask every method about one sensor under one treatment."""
    missing = reference.strong(one.truth) if treatment == MISSING else ""
    lib = replace(one.library, terms=tuple(t for t in one.library.terms if t.name != missing))
    own, said, refused = _asked(one, lib, treatment, resamples)
    terms = said.terms
    others = [k for k, name in enumerate(said.methods) if name != "evidence"]
    # what a method cannot have is not in its model
    strength, keeps = said.strength[others], np.nan_to_num(said.keeps[others])
    told = told_truth(one, treatment)
    truth, over = (np.array([values[name] for name in terms]) for values in (told, over_test(one, told)))
    ours = [_ballot(selection, terms, over) for selection in own]
    rows = [np.array(row) for row in zip(*ours, strict=True)]
    return Trial(
        kind=one.library.kind,
        number=one.number,
        class_id=one.sensor.id,
        treatment=treatment,
        terms=terms,
        truth=truth,
        effect=np.array([reference.effect(name, one.truth) for name in terms]),
        methods=(*OWN, *(said.methods[k] for k in others)),
        keeps=np.vstack((rows[0], keeps)),
        strength=np.vstack((rows[1], strength)),
        said=np.vstack((rows[2], _sided(strength, keeps))),
        pull=np.vstack((rows[3], np.full(keeps.shape, np.nan))),
        missing=missing,
        refused=refused,
    )


def told_truth(one: Subject, treatment: str) -> Mapping[str, float]:
    """Coefficients by name, SI; the bias of a sensor that warms up is that on average over its test."""
    if treatment != WARM:
        return one.truth
    pairs = zip(runs_of(one, WARM), runs_of(one), strict=True)
    drift = np.concatenate([warm.output - cold.output for warm, cold in pairs])
    return {**one.truth, "b0": one.truth["b0"] + float(drift.mean())}


def over_test(one: Subject, truth: Mapping[str, float]) -> Mapping[str, float]:
    """Coefficients of which the bias is that on average over a test whose noise walks, as it is reported."""
    return {**truth, "b0": truth["b0"] + walked(one)}


def _asked(
    one: Subject, lib: Library, treatment: str, resamples: int
) -> tuple[tuple[Selection, Selection, Selection], Votes, str]:
    """Give what `OWN` say and the votes of the other methods, as a user's run would, and why it refuses."""
    runs, seed = tuple(map(as_read, runs_of(one, treatment))), one.seed
    rule = NoiseRule("white") if treatment == WHITE else NoiseRule()
    specs = tuple(RunSpec(run.name, cast(Procedure, run.procedure), noise=rule) for run in runs)
    spec = SensorSpec(one.sensor.id, lib.kind, one.sensor, lib, specs, truth={})
    plain = prepare(spec, runs, silent, np.random.default_rng([*seed, 4]))
    try:
        (ready, evidence), refused = _evidence(spec, runs, seed), ""
    except ImubayesError as error:
        ready, evidence, refused = plain, select(plain.summary, plain.prior), str(error)
    given, rng = (ready.summary, ready.prior, ready.rows), np.random.default_rng([*seed, 3])
    asked = begun(*given, rng=rng, resamples=resamples, widths=(1.0,))
    panel = panel_of(asked, evidence, mounts=mounts_of(ready.runs))
    told = combined(evidence, panel.left_out, panel.sindy, doubtful=ready.doubtful)
    own = told, evidence
    together, alone = map(_opened, own) if refused else own
    trusted = _over_record(select(plain.summary, plain.prior), plain, seed)
    ours = _over_record(together, ready, seed), _over_record(alone, ready, seed)
    return (*ours, trusted), panel.votes, refused


def _over_record(selection: Selection, ready: Prepared, seed: Sequence[int]) -> Selection:
    """Decision whose b0 is that on average over the test, where a random walk moves it, as it is reported."""
    drift = drift_of(ready.summary, ready.rows, ready.prior.sd, "b0")
    return over_record(selection, drift, np.random.default_rng([*seed, 6]))[0] if drift else selection


def _evidence(spec: SensorSpec, runs: Sequence[Run], seed: Sequence[int]) -> tuple[Prepared, Selection]:
    """Weigh every model over draws of the noise, with what bench and library lack where that shows."""
    problem = replace(problem_of(spec, runs), doubt=Doubt(FAMILIES, (*seed, 5)))
    ground = ground_of(problem, np.random.default_rng([*seed, 4]), silent, None)
    found = averaged(ground)
    return prepared(ground), decided(ground, found).selection


def _opened(selection: Selection) -> Selection:
    """Decision that leaves every term open."""
    return replace(selection, terms=tuple(replace(term, verdict="undecided") for term in selection.terms))


def _ballot(selection: Selection, terms: Sequence[str], truth: FloatArray) -> tuple[FloatArray, ...]:
    """What a decision keeps, how strongly, its verdicts, and the pulls of these: (t,) each."""
    verdicts = {term.name: term for term in selection.terms}
    told = [verdicts[name] for name in terms]
    said = np.array([SIDES.get(term.verdict, np.nan) for term in told])
    mean, sd = np.array(
        [(t.mean, t.sd) if t.verdict == "needed" else (t.full_mean, t.full_sd) for t in told]
    ).T
    keeps = np.array([float(name in selection.model) for name in terms])
    strength = np.array([term.inclusion for term in told])
    return keeps, strength, said, np.where(np.isnan(said), np.nan, (mean - truth) / sd)


def _sided(strength: FloatArray, keeps: FloatArray) -> FloatArray:
    """1, 0 or NaN as a strength is above the upper threshold of the verdicts, below the lower, or between."""
    sides = np.where(strength >= EQUAL.needed, 1.0, np.where(strength <= EQUAL.not_needed, 0.0, np.nan))
    return np.where(np.isnan(strength), keeps, sides)
