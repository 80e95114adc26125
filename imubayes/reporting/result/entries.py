"""The published result of a study of sensors: what ``result.json`` holds, in SI, and what each key means."""

from __future__ import annotations

from typing import Annotated, NotRequired

from typing_extensions import TypedDict

from imubayes.reporting.result import (
    Appendix,
    Bias,
    Budget,
    Column,
    Confounded,
    Count,
    Criterion,
    Digits,
    DistrustedDwell,
    Drop,
    ErrorSize,
    Evidence,
    Exportable,
    Flag,
    Headed,
    Loose,
    Matrix,
    Misfit,
    ModelProbability,
    Names,
    Noise,
    NoiseDraws,
    Number,
    Numbers,
    Observed,
    Pooled,
    Processes,
    Provenance,
    RecoveredRms,
    Reduced,
    Residuals,
    RungChoice,
    Sensitivity,
    SparseSupport,
    Standard,
    TermGroup,
    Unasked,
    Votes,
    says,
)
from imubayes.reporting.result.many import Population, Sessions
from imubayes.sensors.terms import Kind

# fmt: off
Extra = TypedDict("Extra", {
    "name": Annotated[str, says("such as `fixture_j.tumble.2`, about j in mount 2 of run `tumble`")],
    "kind": Annotated[str, says("key of `[sensor.reference]`")],
    "unit": Annotated[str, says("SI")],
    "prior_sd": Annotated[Number, says("sd of the prior")],
    "mean": Annotated[Number, says("posterior with all candidate terms")],
    "sd": Annotated[Number, says("the same")],
    "confounded_with": Annotated[Names, says(
        "terms and extras that the test sees only in combination with it"
    )],
    "text": Annotated[str, says("in words")],
    "printed_unit": Annotated[str, says("the unit that people use")],
})
Voices = TypedDict("Voices", {
    "evidence": Annotated[str, says("verdict of the evidence alone")],
    "part": Annotated[str, says("part of the test without which the coefficient moves farthest")],
    "change": Annotated[Number, says("by how much, in sds of what chance allows")],
    "sparse": Annotated[Number, says(
        "share of resampled campaigns in which sparse regressions keep the term, on average over them"
    )],
})  # fmt: skip

Reproducibility = TypedDict("Reproducibility", {
    "kind": Annotated[str, says("key of `[sensor.reference]`")],
    "count": Annotated[Count, says("errors of this kind")],
    "mean": Annotated[Number, says("of the posterior of their sd, SI")],
    "sd": Annotated[Number, says("the same")],
})
Mcmc = TypedDict("Mcmc", {
    "sampler": Annotated[str, says("`exact` (the draws are independent), `collapsed` or `full`")],
    "draws": Annotated[Count, says("kept in `posterior.nc`")],
    "ess_min": Annotated[Number, says("smallest effective sample size of a parameter")],
    "rhat_max": Annotated[Number, says("largest split R-hat")],
    "acceptance": Annotated[Number, says("share of accepted proposals")],
    "seconds": Annotated[Number, says("of computing, interrupted runs included")],
    "converged": Annotated[Flag, says(
        "whether every parameter has the asked effective sample size and a split R-hat below 1.01"
    )],
    "text": Annotated[str, says("why the chains ended, in words")],
    "tau_max": Annotated[Number, says("longest autocorrelation time, in steps")],
    "steps": Annotated[Count, says("of each walker")],
    "walkers": Annotated[Count, says("of each ensemble")],
    "ensembles": Annotated[Count, says("that are independent")],
    "worst": Annotated[str | None, says("the parameter with the smallest effective sample size")],
    "interpolation_error": Annotated[Number, says("largest error of the log density, in nats")],
    "log_evidence": Annotated[Evidence | None, says(
        "`value` and Monte Carlo `sd` of that of the full library, by bridge sampling: a check of the "
        "`exact` one; `null` without chains"
    )],
})
RecoveredErrors = TypedDict("RecoveredErrors", {
    "run": Annotated[str, says("of the quantities")],
    "what": Annotated[str, says(
        "`gravity` (length of the force in a still minus local g), `rate` (length of the rate in a "
        "section minus the table's), `rest` (rates in a still), `closure` "
        "(sine of the angle by which up, carried through a turn, misses up in the next still) or "
        "`turn` (angle of a known turn minus that)"
    )],
    "unit": Annotated[str, says("SI")],
    "count": Annotated[Count, says("of stills or turns")],
    "rms": Annotated[RecoveredRms, says(
        "of the raw output (`before`), compensated under the full library (`after`) and by the kept "
        "terms (`flown`, what `imubayes export` writes); sd that the joint posterior and the noise "
        "over a still or turn give `after` (`fitted`), and new stills and turns (`fresh`)"
    )],
    "within_2_sd": Annotated[Count, says("errors that lie within 2 sd of zero")],
    "of": Annotated[Count, says("how many")],
    "saturated": Annotated[Flag, says(
        "whether the fit has a coefficient for each error; the sd is then that of new ones"
    )],
    "errors": Annotated[Matrix, says("each error of `after`")],
    "sd": Annotated[Matrix, says("of each")],
})
CaseInScene = TypedDict("CaseInScene", {
    "scene": Annotated[str, says("its name")],
    "duration": Annotated[Number, says("s")],
    "budget": Annotated[Budget, says("`quantity` and `limit`")],
    "models": Annotated[dict[str, Names], says("terms to keep of each component, by its id")],
    "candidates": Annotated[Count, says("terms of all components")],
    "within_budget": Annotated[Flag, says("whether the calibrations let such models do so with 95 %")],
    "left_out": Annotated[ErrorSize, says("error (`median`, `q95`) of the terms left out")],
    "left": Annotated[ErrorSize, says("error with these models")],
    "calibrated": Annotated[ErrorSize, says("error with every term kept")],
    "uncompensated": Annotated[ErrorSize, says("error with none")],
    "noise": Annotated[Noise, says("sd that N, B and K of all components bring about")],
})
Case = TypedDict("Case", {
    "id": Annotated[str, says("of the sensor whose components these are")],
    "recovered": Annotated[tuple[RecoveredErrors, ...], says(
        "known quantities of runs in the hand or with sections, raw and compensated"
    )],
    "pooled": Annotated[dict[str, dict[str, Pooled]], says(
        "of each kind and term: `inclusion` in one model for all components, `verdict` (`cannot tell` "
        "where no component's test can; else by the inclusion, but `undecided` where that is against "
        "what every component that tells says)"
    )],
    "scenes": NotRequired[Annotated[tuple[CaseInScene, ...], says(
        "what each scene requires of all components together, their errors added as vectors"
    )]],
})


class Term(TypedDict):
    """A term of a component; `printed_unit` is the one that people use."""

    name: Annotated[str, says("of the term")]
    symbol: Annotated[str, says(
        "in the IEEE standard of the class's technology (`-` where it has none, as for a gyroscope "
        "without a class)"
    )]
    unit: Annotated[str, says("SI")]
    mean: Annotated[Number, says(
        "averaged over models (for a confounded term, over those that contain its partners); where "
        "more than 2,000 models count, over so many that are drawn from them: right to about 0.02 `sd`"
    )]
    sd: Annotated[Number, says("of the same posterior")]
    q05: Annotated[Number, says("its 5 % point")]
    q95: Annotated[Number, says("its 95 % point")]
    full_mean: Annotated[Number, says("with all candidate terms")]
    full_sd: Annotated[Number, says("the same")]
    prior_sd: Annotated[Number, says("sd of the prior")]
    inclusion: Annotated[Number, says("probability that the term is in the model")]
    inclusion_range: Annotated[Numbers, says("its range over prior widths x 1/3, 1, 3")]
    limit95: Annotated[Number, says("the term's size, were it in the model, stays below this with 95 %")]
    verdict: Annotated[str, says("see [verdicts](#verdicts)")]
    conditional: NotRequired[Annotated[Flag, says(
        "`true` where the data reject the model (a run that does not fit, or something that the library does "
        "not contain): the verdict holds if what is missing touches no term; else left out"
    )]]
    verdict_by: NotRequired[Annotated[Voices, says(
        "what each family contributed: who objects to the evidence makes the verdict `undecided`, and the "
        "reason says why; left out where the other families were not asked"
    )]]
    reason: Annotated[str, says("in words")]
    confounded_with: Annotated[Names, says("terms that the test sees only in combination with it")]
    group: Annotated[str, says("part of the model equation")]
    printed_unit: Annotated[str, says("the unit that people use")]
    effect: Annotated[Number, says("largest effect over the test at `mean`, m/s^2 or rad/s")]
    plug_in_inclusion: Annotated[Number, says(
        "`inclusion` with the noise at its best estimate, where it is averaged over the chains' noise; "
        "else `null`"
    )]
    mcmc_mean: Annotated[Number, says("with all candidate terms, by the chains; else `null`")]
    mcmc_sd: Annotated[Number, says("the same")]


class Run(TypedDict):
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


Sensor = TypedDict("Sensor", {
    "id": Annotated[str, says("of the component")],
    "kind": Annotated[Kind, says("accelerometer or gyroscope")],
    "class": Annotated[str | None, says("of the catalogue; null without one")],
    "samples": Annotated[Count, says("that were used")],
    "noise": Annotated[dict[str, Noise], says("N, B, K of each run")],
    "noise_posterior": Annotated[dict[str, NoiseDraws], says(
        "the same by the chains (mean, sd, 5 % and 95 % points); empty without chains"
    )],
    "noise_processes": Annotated[dict[str, Processes], says(
        "of each run that was asked: processes `identified`; of each process inclusion, mean, sd and "
        "quantiles over the sets that have it, `limit95`, `detection_limit` (size that a run of this "
        "length finds with 95 %), verdict; the best `sets`; the fit of the Allan variance (`allan`)"
    )],
    "method": Annotated[str, says("how the posterior was computed")],
    "method_reason": Annotated[str, says("why so")],
    "choice": Annotated[RungChoice | None, says(
        "where `--budget` or `--accuracy` chose the method, else null: the `rung` taken, what was "
        "`asked`, whether that was `met`, its `seconds` and what was foreseen (`foreseen_seconds`), "
        "what each step `climbed` changed (`change_sd`, `change_inclusion`), and the `next` one with "
        "what it would take and change"
    )],
    "terms": Annotated[tuple[Term, ...], says("of the library")],
    "bias": NotRequired[Annotated[Bias, says(
        "`mean` and `sd` of the bias, SI, averaged over models, at the `start` of the record, on "
        "average over it (`mean`, which `b0` is) and at its `end`, and its `drift` from start to end; "
        "left out where no random walk of the noise counts: it is then the same throughout"
    )]],
    "compensations": NotRequired[Annotated[tuple[Exportable, ...], says(
        "coefficients that `imubayes export` writes, the best `model` first: `full` (every tested term), "
        "`needed`, `basic` (bias, scale, misalignment); those of a smaller model are the posterior of the "
        "full one projected on its `terms` over the inputs of the test: `mean` and `covariance`, SI. "
        "`held_out`: rms error of the output, SI, on average over each of the `positions`, predicted from "
        "all others. Left out where none could be"
    )]],
    "model": Annotated[Names, says(
        "excited terms with inclusion 0.5 or more (median probability model; with `[decision]` costs, "
        "from their threshold on). No term that is `untested` or `not needed` is in it"
    )],
    "log_evidence": Annotated[Number, says("of the data, averaged over all models")],
    "criteria": Annotated[dict[str, Criterion], says(
        "of each information criterion and predictive score: its best subset `model`, `value` "
        "(deviance scale: smaller is better), `lead` over the next subset, weight of each term "
        "(`inclusion`), effective `samples` of the coloured noise, subsets that were `compared` and "
        "whether that is all of them (`exact`), tail of importance sampling (`pareto_k`), `note`; "
        "empty without `compare`"
    )],
    "sindy": Annotated[dict[str, SparseSupport], says(
        "of each sparse regression: the support `model`, the `strength` (threshold in detectable "
        "effects, or number of terms) that it is chosen at, frequency of each term over resampled "
        "campaigns (`inclusion`), terms that are `stable` at the frequency `cut`, and how many of "
        "these are false at most, on average (`false_bound`)"
    )],
    "sensitivity": Annotated[Sensitivity | None, says(
        "inclusion of each term over prior `widths`, under a hyper-g prior (`g_prior`; not of terms "
        "that are `left_out`), and terms whose inclusion crosses a threshold between 1/3 and 3 "
        "(`swing`); like the next two `null` without `compare`"
    )],
    "votes": Annotated[Votes | None, says(
        "for each of the `terms` that the test excites, in their order, how strongly each method is "
        "for it (`strength`) and whether its model has it (`keeps`: 1 or 0, `null` where it says "
        "nothing); `disagreements` with the decision: `term`, `methods`, `cause`, `text`"
    )],
    "reduced": Annotated[Reduced | None, says(
        "smallest model whose predictions over the test's inputs stay within the `budget` (rms, SI): "
        "`terms`, `coefficients`, the rms that is `lost`, and the `path` of smaller and larger models"
    )],
    "unasked": Annotated[tuple[Unasked, ...], says(
        "opinions that are left out because they could not be had, each with its `method` and the "
        "`reason`; they have `null` in the votes"
    )],
    "misfit": Annotated[Misfit | None, says(
        "what the residuals say (each run against each input and time; rising against falling for T "
        "and the own input; all runs, where `run` is empty, against each term that is no candidate) that the "
        "library does not contain: `text`, dependences that chance does "
        "not explain (`found`) and all of them (`dependences`: `run`, `input`, `p`, `share` of the "
        "residuals' variance, `size` in SI), posterior predictive p-value of each run "
        "(`predictive_p`), and how near to 0 or 1 that is odd (`level`); `p` is corrected for all "
        "residual tests of the study, and something is found below 0.01"
    )],
    "groups": Annotated[tuple[TermGroup, ...], says(
        "of each group of terms that the test sees in one combination only: `terms`, and the "
        "probability that at least one of them is in the model (`any_inclusion`)"
    )],
    "mcmc": Annotated[Mcmc, says("of the draws in `posterior.nc`")],
    "extras": Annotated[tuple[Extra, ...], says("errors of the test bench")],
    "reproducibility": NotRequired[Annotated[tuple[Reproducibility, ...], says(
        "sds that the data tell, SI: of each `kind` of error of the bench from mount to mount (`fixture`), "
        "of the dwells of a run beyond the noise of its samples (`dwell.<run>`), and of functions and terms "
        "that the library lacks (`lack.f_i`, `lack.f_i^3`, `lack.f_i*f_k`); posterior `mean` and `sd`, and "
        "of how many errors (`count`); left out where none was told"
    )]],
    "absorbed": NotRequired[Annotated[str, says(
        "what the residuals showed before functions of the inputs stood beside the library; left out where "
        "they do not"
    )]],
    "distrusted": Annotated[tuple[DistrustedDwell, ...], says(
        "dwells that are left out because they are contaminated, or pull too hard for what is known of "
        "them: `run`, `start` and `stop` in s, `probability`, `offset` and its `sd`"
    )],
    "n_models": Annotated[Count, says("number of models")],
    "drawn_models": Annotated[Count, says(
        "where more models count than `mean` and `sd` can be averaged over: how many are drawn from "
        "them for that; else 0"
    )],
    "missing": Annotated[Number, says(
        "bound on the probability of the models that were not weighed (`null` where there is none); 0 "
        "up to 26 candidates, and `null` where a cheap method picked the models"
    )],
    "inclusion_error": Annotated[Number, says(
        "largest standard error of an inclusion where models were drawn; 0 and `null` like `missing`"
    )],
    "best_models": Annotated[tuple[ModelProbability, ...], says("the ten most probable: terms, probability")],
    "by_size": Annotated[Numbers, says("log evidence by number of terms")],
    "candidates": Annotated[Names, says("terms that the test excites")],
    "inclusion_by_width": Annotated[dict[str, Numbers], says("their inclusion at prior widths x 1/3, 1, 3")],
    "confounded": Annotated[tuple[Confounded, ...], says(
        "groups of terms that the test cannot separate, with reason and remedy"
    )],
    "observability": Annotated[dict[str, Observed], says(
        "of each term, whether it was tested, posterior over prior sd (`ratio`; `alone`, if it were "
        "the only one), variance inflation (null if untested or in an exact cancellation)"
    )],
    "residuals": Annotated[tuple[Residuals, ...], says(
        "of each run: scale over noise, p values of whiteness and normality (null where the fit leaves too "
        "little to tell), whether it `fits`, blocks "
        "that stand out, and the `level` that each test is held against: all residual tests of a study "
        "together give a false alarm with 1 % at most (Bonferroni)"
    )],
    "runs": Annotated[tuple[Run, ...], says(
        "of each run: origin and sd of the noise (of its logarithm), averaging time of a row "
        "(`interval`) and of a sample of the record (`sampling`), ranges of its inputs (of a triad in "
        "the hand the compensated ones of the stills and turns), file, SHA-256, columns, notes, stills "
        "of a free tumble"
    )],
    "prior_source": Annotated[str, says("where the priors come from, in words")],
    "calibration": Annotated[Loose | None, says(
        "of a free tumble and of an IMU: scale, bias, non-orthogonality, and their convention; "
        "`angles` where directions were known: rotation and non-orthogonality of each triad, mean and "
        "sd in rad"
    )],
    "digits": Annotated[Digits | None, says(
        "trustworthy decimal digits of `coefficients`, `sd`, `log_evidence` and `inclusion` against "
        "rounding: no more than are right; null where they were not judged"
    )],
    "pooled_inclusion": Annotated[dict[str, Number], says(
        "of components in one case: probability that all of their kind have a term, where none would be the "
        "other case, from the estimates with all candidate terms; empty for a single component"
    )],
    "standards": Annotated[dict[str, Standard], says(
        "of each standard that speaks of the class's technology (`ieee1293`, `ieee952`, ..., and the "
        "`basic` triad): `title`, `values` (`symbol`, `value` and `sd` in SI, with all candidate terms "
        "and their correlations; `unit`, `printed_unit`, the `term` it comes from and its `verdict`, "
        "`note`), symbols whose terms are `untested` or `absent` from the library, where the mapping "
        "is `exact`, what is `standard_only` and `general_only`, what the values take over of the "
        "latter (`absorbed`: the `terms` that the test excites, the `inputs` that least squares was "
        "over, the `rms` of what they do there and of what is `left`, SI; null where there is "
        "nothing), and why there are no values (`trouble`)"
    )],
    "seconds": Annotated[Number, says("of computing")],
})


class TermInScene(TypedDict):
    """What a term does in a scene, and its share of the budget."""

    name: Annotated[str, says("of the term")]
    rms: Annotated[Number, says("effect on the output")]
    effect: Annotated[Number, says("on what is budgeted")]
    share_of_budget: Annotated[Number, says("median")]
    share_q05: Annotated[Number, says("its 5 % point")]
    share_q95: Annotated[Number, says("its 95 % point")]
    share_at_limit95: Annotated[Number, says("share at the term's limit")]
    share_unknown: Annotated[Number, says("share of its posterior sd")]
    inclusion: Annotated[Number, says("probability that the term is in the model")]
    kept: Annotated[Flag, says("whether the scene's model has it")]
    quadrant: Annotated[str, says("what inclusion and relevance say together")]


class Scene(TypedDict):
    """A component in a scene."""

    name: Annotated[str, says("of the scene")]
    sensor: Annotated[str, says("the component")]
    axis: Annotated[str, says("case axis of its input")]
    duration: Annotated[Number, says("s")]
    budget: Annotated[Budget, says("`quantity` and `limit`")]
    model: Annotated[Names, says("smallest model that stays within the budget with 95 %")]
    within_budget: Annotated[Flag, says(
        "whether the calibration lets one; else `model` is the smallest whose left-out terms stay "
        "within it"
    )]
    terms: Annotated[tuple[TermInScene, ...], says("of the library")]
    left_out_rms: Annotated[Number, says("rms effect on the output of the terms that are left out")]
    left_out: Annotated[ErrorSize, says("error (`median`, `q95`) of the terms left out")]
    left: Annotated[ErrorSize, says("error with this model")]
    calibrated: Annotated[ErrorSize, says("error with every term kept")]
    uncompensated: Annotated[ErrorSize, says("error with none")]
    path: Annotated[tuple[Drop, ...], says(
        "from all `terms` to none: term that was `dropped`, bound of the `error` with 95 %"
    )]
    noise: Annotated[Noise, says("sd that N, B and K bring about in what is budgeted")]
    tested_model: NotRequired[Annotated[Names | None, says(
        "smallest model where the terms kept take up the others over the test's inputs; null where these "
        "are not known"
    )]]
    tested_left_out: NotRequired[Annotated[ErrorSize | None, says("error of the terms that it leaves out")]]
    notes: Annotated[Names, says(
        "how the scene was made, which run's noise it is, which terms it does not drive"
    )]


class SensorsResult(Headed):
    """Result of a study of sensors."""

    sensors: Annotated[tuple[Sensor, ...], says(
        "of each component; of a triad `<id>.ax`, `<id>.ay`, `<id>.az`"
    )]
    scenes: Annotated[tuple[Scene, ...], says("of each scene and component")]
    sessions: Annotated[tuple[Sessions, ...], says(
        "of each parameter of units that were tested in several sessions"
    )]
    population: Annotated[tuple[Population, ...], says(
        "of each class and kind of which the study has four units or more"
    )]
    cases: Annotated[tuple[Case, ...], says("of each triad or whole IMU")]
    appendices: Annotated[tuple[Appendix, ...], says("title and command of the tables from elsewhere")]
    provenance: Annotated[Provenance, says("the study file and its text, the command, versions")]
# fmt: on
