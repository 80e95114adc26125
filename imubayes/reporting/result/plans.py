"""The published results of a plan, and of a trade of speed for accuracy; SI."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from typing_extensions import TypedDict

from imubayes.reporting.result import Confounded, Count, Headed, Interval, Names, Number, Provenance, says
from imubayes.sensors.terms import Kind

# fmt: off
Predicted = TypedDict("Predicted", {"sd": Number, "simulated": Number})
PlannedTerm = TypedDict("PlannedTerm", {
    "name": Annotated[str, says("of the term")],
    "unit": Annotated[str, says("SI")],
    "prior_sd": Annotated[Number, says("by the class")],
    "known_sd": Annotated[Number, says("with the runs that are done")],
    "needed_sd": Annotated[Number, says(
        "at which the term has a tenth of the scene's budget; null without a scene, and where that "
        "does not drive it"
    )],
    "even": Annotated[Predicted, says(
        "going evenly through one run: predicted `sd`, and rms error over `simulated` units"
    )],
    "same": NotRequired[Annotated[Predicted, says(
        "the same of the best plan with that run alone, where several are offered"
    )]],
    "best": Annotated[Predicted, says("the same of the best plan")],
})
PlannedStep = TypedDict("PlannedStep", {
    "run": str, "start": Number, "at": Count, "mount": str, "set_to": str, "dwell": Number,
})
PlanFound = TypedDict("PlanFound", {
    "name": Annotated[str, says("of the plan")],
    "seconds": Annotated[Number, says("that it takes")],
    "size_of_aim": Annotated[Number, says("smaller is better")],
    "worst": Annotated[str, says(
        "needed term with the largest predicted sd over what the scene needs (without a scene: over "
        "its prior sd)"
    )],
    "worst_ratio": Annotated[Number, says("of that term")],
    "share_of_budget": Annotated[Number, says(
        "predicted rms effect of what is not known in the scene; null without a scene"
    )],
    "confounded": Annotated[tuple[Confounded, ...], says(
        "groups of terms that the data will not separate, with reason and remedy"
    )],
    "steps": Annotated[tuple[PlannedStep, ...], says(
        "dwells in their order: `run`, `start` and `dwell` in s, number of the setting (`at`), "
        "`mount`, what it is `set_to`"
    )],
})
Plan = TypedDict("Plan", {
    "sensor": Annotated[str, says("id")],
    "kind": Annotated[Kind | Literal["imu"], says("accelerometer, gyroscope or imu")],
    "time": Annotated[Number, says("that the test may take, s")],
    "aim": Annotated[Literal["worst", "D", "scene"], says("what is made small, as in `[plan]`")],
    "units": Annotated[Count, says("that were simulated")],
    "needed": Annotated[Names, says("terms that the aim is about")],
    "terms": Annotated[tuple[PlannedTerm, ...], says("of the library")],
    "plans": Annotated[tuple[PlanFound, ...], says(
        "`even`, `same` (where several runs are offered) and `best`"
    )],
})
TermHours = TypedDict("TermHours", {
    "name": Annotated[str, says("of the term")],
    "unit": Annotated[str, says("SI")],
    "prior_sd": Annotated[Number, says("by the class")],
    "enough": Annotated[Number, says(
        "posterior over prior sd at which half of the units of the class get a verdict"
    )],
    "seconds": Annotated[Number, says("of test after which it is told; null beyond reach")],
    "run": Annotated[str, says("of the test in which that is; empty beyond reach")],
    "once": Annotated[Number, says("posterior over prior sd after the test")],
    "most": Annotated[Number, says("the same at the end of what is within reach")],
    "limit": Annotated[Number, says(
        "size that it is then known to stay below with 95 % where its estimate is zero"
    )],
    "share_of_budget": Annotated[Number, says(
        "largest share of a scene's budget that the limit takes; null without scenes"
    )],
    "scene": Annotated[str, says("where that is")],
})
RunHours = TypedDict("RunHours", {"name": str, "seconds": Number})
ClassHours = TypedDict("ClassHours", {
    "id": Annotated[str, says("of the class")],
    "seconds": Annotated[Number, says("of its test, gone through once")],
    "runs": Annotated[tuple[RunHours, ...], says(
        "of the test, in order: `name`, `seconds`"
    )],
    "told_once": Annotated[Count, says("terms that the test tells")],
    "told": Annotated[Count, says("terms that are told within reach")],
    "terms": Annotated[tuple[TermHours, ...], says("of the library")],
})
Hours = TypedDict("Hours", {
    "kind": Annotated[Kind, says("accelerometer or gyroscope")],
    "reach": Annotated[Number, says("the longest test that is looked at, s")],
    "classes": Annotated[tuple[ClassHours, ...], says("of the study")],
})
Floor = TypedDict("Floor", {"largest": Number, "rms": Number})
Rate = TypedDict("Rate", {"events": Count, "of": Count, "share": Interval})
Rung = TypedDict("Rung", {
    "rung": Annotated[str, says("by name")],
    "seconds": Annotated[Number, says("wall time, median over components")],
    "whole_seconds": Annotated[Number, says(
        "the same if chains went on until they have reached what was asked of them"
    )],
    "processor_seconds": Annotated[Number, says("over all threads")],
    "memory": Annotated[Number, says("bytes, the largest")],
    "largest": Annotated[Number, says("difference of a coefficient from the best rung's, in posterior sd")],
    "rms": Annotated[Number, says("the same over all terms")],
    "inclusion": Annotated[Number, says("largest difference of one")],
    "verdicts": Annotated[Count, says("how many differ, over all components")],
    "scene_share": Annotated[Number, says("largest change of a share of a scene's budget")],
    "scene_terms": Annotated[Count, says("by how many terms the models that the scenes require differ")],
    "monte_carlo": Annotated[Number, says("rms Monte Carlo error of its own coefficients, in posterior sd")],
    "foreseen": Annotated[Number, says("what it foresees that the next one would change, in posterior sd")],
    "components": Annotated[Count, says("that it was measured on")],
})
RungScore = TypedDict("RungScore", {
    "rung": Annotated[str, says("by name")],
    "repeats": Annotated[Count, says("that it answered")],
    "coverage": Annotated[Rate, says(
        "of its 90 % intervals with all candidate terms: truths that are held (`events`), `of` how "
        "many, the `share` and its 90 % interval"
    )],
    "error": Annotated[Number, says(
        "rms of the coefficients against the truth, in posterior sd of the best rung that answered the "
        "same repeat"
    )],
    "false_needed": Annotated[Rate, says(
        "the same counts for terms that are zero, or below one posterior sd, and called needed"
    )],
    "false_not_needed": Annotated[Rate, says(
        "for terms above a tenth of the prior sd that are called not needed"
    )],
    "missed_large": Annotated[Rate, says(
        "for terms above eight posterior sd that are left out of the model"
    )],
    "cost": Annotated[Number, says("of false verdicts a sensor, as the study weighs them")],
    "scene_terms": Annotated[Number, says(
        "terms a scene by which its model is another than by the truth; null without scenes"
    )],
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
    "rung": Annotated[str, says("by name")],
    "seconds": Annotated[Number, says("wall time, the shortest")],
    "seconds_to_what_was_asked": Annotated[Number, says(
        "until the chains have reached what was asked of them"
    )],
    "processor_seconds": Annotated[Number, says("over all threads")],
    "memory": Annotated[Number, says("bytes")],
    "ess": Annotated[Number, says("least effective sample size of the chains; null without")],
    "foreseen_change_sd": Annotated[Number, says(
        "what the rung itself says that the next one would change, in posterior sd"
    )],
    "foreseen_change_inclusion": Annotated[Number, says("the same of an inclusion")],
    "difference": Annotated[Difference, says(
        "from the best rung: as in `rungs[]`, with the `worst` term, other `verdicts` (term, this "
        "rung's, the best's), and what `scenes` require otherwise"
    )],
    "model": Annotated[Names, says("terms that are kept")],
    "terms": Annotated[tuple[AnsweredTerm, ...], says("coefficients, inclusions and verdicts")],
})
Component = TypedDict("Component", {
    "id": Annotated[str, says("of the component")],
    "best": Annotated[str, says("the rung that the others are held against")],
    "monte_carlo_floor": Annotated[Floor, says("as above, of this component")],
    "skipped": Annotated[dict[str, str], says("rungs that were not measured, with the reason")],
    "rungs": Annotated[tuple[ComponentRung, ...], says("that were measured, from the cheapest")],
})
Machine = TypedDict("Machine", {
    "processor": str, "system": str, "cores": Count, "threads": dict[str, Count], "load": Number,
    "versions": dict[str, str],
})


class PlanResult(Headed):
    """Result of a plan."""

    answer: Annotated[Names, says("what the plan gains, in sentences")]
    plan: Annotated[Plan, says("what it will tell, and what to set")]
    seconds: Annotated[Number, says("of computing")]
    provenance: Annotated[Provenance, says("the study file and its text, the command, versions")]


class HoursResult(Headed):
    """Hours that classes take until their terms are told."""

    answer: Annotated[Names, says("what the tests tell, and what stays open, in sentences")]
    hours: Annotated[Hours, says("of each term of each class")]
    seconds: Annotated[Number, says("of computing")]
    provenance: Annotated[Provenance, says("the study file and its text, the command, versions")]


class TradeResult(Headed):
    """Result of a trade of speed for accuracy."""

    limit: Annotated[Number, says("time of the trade, s")]
    repeats: Annotated[Count, says("simulated sensors that were asked for")]
    answer: Annotated[Names, says("the recommendation and its reasons, in sentences")]
    recommended: Annotated[str, says("the cheapest rung that is good enough")]
    default: Annotated[str, says("the rung of a run that is not asked")]
    best: Annotated[str, says("the rung that the others are held against")]
    front: Annotated[Names, says("rungs that no other beats in time and error together, from the cheapest")]
    monte_carlo_floor: Annotated[Floor, says(
        "largest and rms Monte Carlo error of a difference, in posterior sd"
    )]
    good_enough: Annotated[Number, says("error of a coefficient that is allowed, in posterior sd")]
    rungs: Annotated[tuple[Rung, ...], says("over all components")]
    scores: Annotated[tuple[RungScore, ...], says("of the rungs on simulated repeats")]
    components: Annotated[tuple[Component, ...], says("one by one")]
    machine: Annotated[Machine, says("that the times belong to")]
    seconds: Annotated[Number, says("of all of it")]
    provenance: Annotated[Provenance, says("the study file and its text, the command")]
# fmt: on
