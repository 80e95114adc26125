"""What every method says of simulated sensors, as modelled and where the model is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import linear_of
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.summary import Summary, summarize
from imubayes.population.processes import Progress, shared
from imubayes.rig.inputs import Run
from imubayes.selection.decision import LOOSE, Selection, select
from imubayes.selection.panel import Panel, panel_of
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Kind, Library, library
from studies.decision_quality.subjects import Subject, runs_of, subject

MODELLED = "as modelled"
WHITE = "noise assumed white"
MISPLACED = "table zero not modelled"
MISSING = "one true term missing"

TREATMENTS = (MODELLED, WHITE, MISPLACED, MISSING)
"""How the runs of a sensor are treated: rightly, and in three wrong ways."""

STRONG = 8.0
"""Effect over noise from which a true term is strong: one of these is what goes missing."""

DECISION, SURE = "decision", "decision, needed only"
"""The decision's own rows: keep where it costs less, and keep only what has the verdict needed."""

OWN = "evidence"
"""The decision among the votes of the methods."""


@dataclass(frozen=True, slots=True)
class QualityStudy:
    """What is measured.

    Attributes
    ----------
    seed : of everything that is drawn.
    sensors : simulated of each kind.
    misspecified : of these, under treatments that are wrong on purpose.
    treatments : some of `TREATMENTS`, `MODELLED` among them.
    classes : ids of the catalogue that sensors are drawn from; empty for all.
    powers, asymmetry : of the candidate terms (see `imubayes.sensors.terms.library`).
    resamples : campaigns drawn for the frequencies of the sparse regressions.
    processes : that share the work.
    command : that measures it.
    """

    seed: int = 7
    sensors: int = 200
    misspecified: int = 100
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


SMALL = QualityStudy(sensors=1, misspecified=1, classes=(), powers=2, asymmetry=-1, resamples=2, processes=1)
"""One sensor of each kind."""


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
    groups : indices of terms whose columns cancel to rounding, whatever the noise.
    group_effect : of each group, seen together.
    methods : m of them, the decision's two first.
    keeps : (m, t) 1 in the method's model, 0 out.
    strength : (m, t) from 0 to 1; NaN where a method says nothing.
    verdict : (t,) 1 for needed, 0 for not needed, NaN where the decision leaves the term open.
    missing : term that was taken out of the library; empty where none was.
    """

    kind: Kind
    number: int
    class_id: str
    treatment: str
    terms: tuple[str, ...]
    truth: FloatArray
    effect: FloatArray
    groups: tuple[tuple[int, ...], ...]
    group_effect: FloatArray
    methods: tuple[str, ...]
    keeps: FloatArray
    strength: FloatArray
    verdict: FloatArray
    missing: str = ""


def trials(study: QualityStudy, *, progress: Progress = lambda message: None) -> tuple[Trial, ...]:
    """Simulate every sensor, and ask every method about it under every treatment.

    Parameters
    ----------
    study : says how many, and which treatments.
    progress : is told how many sensors are done.

    Returns
    -------
    in the order of kinds, sensors and treatments, whatever the number of processes.
    """
    jobs = [(study, kind, k) for kind in get_args(Kind) for k in range(study.sensors)]
    found = shared(judge, jobs, study.processes, things="sensors", progress=progress)
    return tuple(trial for told in found for trial in told)


def judge(study: QualityStudy, kind: Kind, number: int) -> list[Trial]:
    """Ask every method about one sensor under every treatment that it takes part in."""
    lib = library(kind, powers=study.powers, asymmetry=study.asymmetry)
    one = subject(lib, number, study.seed, study.classes)
    runs = runs_of(one)
    reference = _Reference.of(one, summarize(runs, one.library, sensor=one.sensor))
    return [
        _trial(one, runs, reference, treatment, study.resamples)
        for treatment in study.treatments
        if number < (study.sensors if treatment == MODELLED else study.misspecified)
        and (treatment != MISSING or reference.strong(one.truth))
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Reference:
    """The right analysis of a sensor: what any method could see of each term and group of terms.

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

    def effect(self, names: Sequence[str], truth: Mapping[str, float]) -> float:
        """Size of what these terms add that no other term can, over the noise: ``|theta| / sd`` of one."""
        others = [name for name in self.T.names if name not in names]
        T = algebra.reorder(self.T, [*others, *names]).R
        first = len(others)
        theta = np.array([truth[name] for name in names])
        return float(np.linalg.norm(T[first:-1, first:-1] @ theta)) / self.scale

    def strong(self, truth: Mapping[str, float]) -> str:
        """One of the true terms that are strong, by lot; empty where there is none. The bias always stays."""
        found = [n for n, v in truth.items() if v and n != "b0" and self.effect([n], truth) > STRONG]
        return str(np.random.default_rng(self.seed).choice(found)) if found else ""


def _trial(one: Subject, runs: Sequence[Run], reference: _Reference, treatment: str, resamples: int) -> Trial:
    """Ask every method about one sensor under one treatment."""
    missing = reference.strong(one.truth) if treatment == MISSING else ""
    lib = replace(one.library, terms=tuple(t for t in one.library.terms if t.name != missing))
    taken = runs_of(one, misplaced=True) if treatment == MISPLACED else runs
    selection, panel = _asked(one, taken, lib, treatment == WHITE, resamples)
    terms = panel.votes.terms
    groups = _exact_groups(selection, terms)
    keeps, strength = _ballots(selection, panel)
    return Trial(
        kind=one.library.kind,
        number=one.number,
        class_id=one.sensor.id,
        treatment=treatment,
        terms=terms,
        truth=np.array([one.truth[name] for name in terms]),
        effect=np.array([reference.effect([name], one.truth) for name in terms]),
        groups=groups,
        group_effect=np.array([reference.effect([terms[k] for k in g], one.truth) for g in groups]),
        methods=(DECISION, SURE, *(name for name in panel.votes.methods if name != OWN)),
        keeps=keeps,
        strength=strength,
        verdict=_verdicts(selection, terms),
        missing=missing,
    )


def _asked(
    one: Subject, runs: Sequence[Run], lib: Library, white: bool, resamples: int
) -> tuple[Selection, Panel]:
    """Give the decision, and the panel of the other methods."""
    rules = {run.name: NoiseRule("white") for run in runs} if white else {}
    rows = [linear_of(run, lib) for run in runs]
    summary = summarize(runs, lib, sensor=one.sensor, rules=rules, rows=rows)
    prior = ScalePrior(class_sd(one.sensor, lib))
    selection = select(summary, prior)
    rng = np.random.default_rng([*one.seed, 3])
    return selection, panel_of(summary, prior, rows, selection, rng=rng, resamples=resamples, widths=(1.0,))


def _ballots(selection: Selection, panel: Panel) -> tuple[FloatArray, FloatArray]:
    """Return what each method keeps, and how strongly, with the decision's own rows first."""
    said = panel.votes
    verdicts = {term.name: term for term in selection.terms}
    kept = [float(name in selection.model) for name in said.terms]
    sure = [float(verdicts[name].verdict == "needed") for name in said.terms]
    inclusion = [verdicts[name].inclusion for name in said.terms]
    others = [k for k, name in enumerate(said.methods) if name != OWN]
    # what a method cannot have is not in its model
    keeps = np.vstack((kept, sure, np.nan_to_num(said.keeps[others])))
    return keeps, np.vstack((inclusion, np.full(len(sure), np.nan), said.strength[others]))


def _verdicts(selection: Selection, terms: Sequence[str]) -> FloatArray:
    """1 for needed, 0 for not needed, NaN for whatever leaves a term open: (t,)."""
    sides = {"needed": 1.0, "not needed": 0.0}
    said = {term.name: sides.get(term.verdict, np.nan) for term in selection.terms}
    return np.array([said[name] for name in terms])


def _exact_groups(selection: Selection, terms: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    """Indices of the terms whose columns cancel to rounding; cancellations that share a term are one."""
    found: list[set[str]] = []
    for group in (set(g.terms) for g in selection.observability.groups if g.exact):
        shared = [other for other in found if other & group]
        found = [other for other in found if not other & group] + [group.union(*shared)]
    return tuple(tuple(k for k, name in enumerate(terms) if name in group) for group in found)
