"""The published results of many units: sessions, what a class has in common, lots and a fleet; SI."""

from __future__ import annotations

from typing import Annotated, NotRequired

from typing_extensions import TypedDict

from imubayes.reporting.result import (
    Count,
    Flag,
    Headed,
    Interval,
    Matrix,
    Names,
    Noise,
    Number,
    Numbers,
    Provenance,
    says,
)
from imubayes.sensors.terms import Kind

# fmt: off
BetweenSessions = TypedDict("BetweenSessions", {"mean": Number, "q05": Number, "q95": Number})
Spread = TypedDict("Spread", {"median": Number, "q05": Number, "q95": Number})
PopulationMean = TypedDict("PopulationMean", {"sd": Number, "median": Number, "q05": Number, "q95": Number})
SessionShift = TypedDict("SessionShift", {"sessions": Names, "mean": Numbers, "sd": Numbers})
Measurement = TypedDict("Measurement", {"noise": Number, "alias": Number})
NeededShare = TypedDict("NeededShare", {"share": Number, "q05": Number, "q95": Number})
PooledUnits = TypedDict("PooledUnits", {"inclusion": Number, "share": Interval, "limit": Number})
Coverage = TypedDict("Coverage", {"held": Count, "of": Count, "share": Interval})
Check = TypedDict("Check", {
    "precision": Interval, "recall": Interval, "cells": tuple[Count, Count], "population_mean": Coverage,
    "population_spread": Coverage, "untold": Count, "shares": NotRequired[Coverage],
    "unit_shares": NotRequired[Coverage], "linear_shares": NotRequired[Coverage],
    "seen_shares": NotRequired[Coverage],
    "off": NotRequired[tuple[Number, Number]], "beyond": NotRequired[Count],
})
Worst = TypedDict("Worst", {"unit": str, "term": str, "value": Number, "pull": Number, "outlier": Flag})
Broken = TypedDict("Broken", {"number": Count, "name": str, "error": str})
NoiseIntervals = TypedDict("NoiseIntervals", {"N": Interval, "B": Interval, "K": Interval})
PopulationTerm = TypedDict("PopulationTerm", {
    "parameter": Annotated[str, says("as in `sessions`")],
    "term": Annotated[str, says("of the library")],
    "component": Annotated[str, says("empty for all axes together")],
    "unit": Annotated[str, says("SI")],
    "printed_unit": Annotated[str, says("the unit that people use")],
    "class_size": Annotated[Number, says(
        "size that the class gives the coefficient: the scale of the spreads' priors"
    )],
    "mean": Annotated[PopulationMean, says(
        "of the population, with its `sd`; each axis has its own, so that there is none for all "
        "together"
    )],
    "unit_to_unit": Annotated[Spread, says(
        "sd from unit to unit; with one session each it holds what a turn-on does, too"
    )],
    "turn_on": Annotated[Spread, says("sd between sessions of a unit: all of it")],
    "turn_on_own": Annotated[Spread, says("what the unit does by itself")],
    "turn_on_common": Annotated[Spread, says("what all units do together")],
    "p_value": Annotated[Number, says(
        "probability of so large a scatter between sessions if they differed by their errors alone"
    )],
    "level": Annotated[Number, says("of this test: 1 % over the number of terms tested")],
    "common_share": Annotated[Spread, says(
        "share of the variance between sessions that all units have in common"
    )],
    "next_unit": Annotated[Spread, says("where a further unit is in a further session")],
    "session_shift": Annotated[SessionShift, says(
        "of each session, what all units are off the mean of the sessions, with its sd"
    )],
    "measurement": Annotated[Measurement, says(
        "median sd of one session by its noise, and by what the test books to the term in place of "
        "others (`alias`), alike in all sessions"
    )],
    "verdict": Annotated[str, says(
        "`needed` where more than half of the units need it; `not needed` where more than half do not, "
        "none does and the class has it with one half or less (`pooled`); `some need it`; `undecided`; "
        "where most units cannot tell, `needed` if the class has it with 0.95 or more and half of the "
        "units or more do, else `cannot tell`"
    )],
    "reason": Annotated[str, says("in words")],
    "answers": Annotated[dict[str, Count], says(
        "units by answer (what a unit's sessions say, `undecided` where they contradict each other)"
    )],
    "needed": Annotated[NeededShare, says(
        "share of the units that answer, with an interval that reaches over those that do not"
    )],
    "pooled": Annotated[PooledUnits | None, says(
        "what all units say together, as of simulated lots: `inclusion`, the probability that units of the "
        "class have the term; `share` of the units that have it, if any has; `limit`, the size, SI, that a "
        "further unit's coefficient stays below with 95 %; null where too few units tell of it"
    )],
})
Population = TypedDict("Population", {
    "class": Annotated[str, says("of the catalogue")],
    "kind": Annotated[Kind, says("accelerometer or gyroscope")],
    "units": Annotated[Names, says("that are put together; a sensor without `unit` is a unit of its own")],
    "sessions": Annotated[Names, says("of the units")],
    "components": Annotated[Names, says("of each unit")],
    "terms": Annotated[tuple[PopulationTerm, ...], says(
        "each term, of a triad for all its axes together and for each of them"
    )],
})
Sessions = TypedDict("Sessions", {
    "parameter": Annotated[str, says("term, of a triad with its component (`ax.b0`) or over all three")],
    "unit": Annotated[str, says("SI")],
    "printed_unit": Annotated[str, says("the unit that people use")],
    "units": Annotated[Names, says("rows of what follows")],
    "sessions": Annotated[Names, says("columns of what follows")],
    "mean": Annotated[Matrix, says(
        "posterior with all candidate terms; `null` where a unit lacks a session"
    )],
    "sd": Annotated[Matrix, says("the same")],
    "pulls": Annotated[tuple[Matrix, ...], says(
        "of each unit, session against session: difference over its sd"
    )],
    "p_value": Annotated[Number, says(
        "probability of so large a scatter if sessions differed by their posteriors' sds alone"
    )],
    "level": Annotated[Number, says("of this test: 1 % over the number of parameters tested")],
    "between": Annotated[BetweenSessions, says("sd between sessions: `mean`, `q05`, `q95`")],
    "exceeds": Annotated[Flag, says("whether `p_value` is below `level`")],
    "shared": Annotated[Number, says(
        "share of the scatter that all units have in common: one over their number by chance, 1 for a "
        "cause that moves them alike"
    )],
})
class TermOfUnits(TypedDict):
    """A term over many units."""

    name: Annotated[str, says("of the term")]
    needed: Annotated[Interval, says("share of the units in which it is needed")]
    open: Annotated[Number, says("share of the units whose test cannot tell, or leaves it undecided")]
    mean: Annotated[Interval, says(
        "of the population: a hierarchical posterior over units; of several lots the middle one's, the "
        "lowest and the highest"
    )]
    spread: Annotated[Interval, says("sd from unit to unit, the same way")]
    true_mean: Annotated[Number, says(
        "of the lot that was simulated, of several the middle one's; null for recorded units"
    )]
    true_spread: Annotated[Number, says("the same")]


class FleetTerm(TermOfUnits):
    """A term over the units of a fleet."""

    symbol: Annotated[str, says("in the IEEE standard")]
    unit: Annotated[str, says("SI")]
    verdicts: Annotated[dict[str, Count], says("units by verdict")]


Fleet = TypedDict("Fleet", {
    "kind": Annotated[Kind, says("accelerometer or gyroscope")],
    "class": Annotated[str, says("of the catalogue")],
    "units": Annotated[Count, says("of the study")],
    "read": Annotated[Count, says("units that could be read")],
    "samples": Annotated[Count, says("rows that were used")],
    "terms": Annotated[tuple[FleetTerm, ...], says("of the library")],
    "order": Annotated[Interval, says("number of needed terms of a unit: median and 90 % range over units")],
    "noise": Annotated[NoiseIntervals, says("N, B, K: median and 90 % range over units")],
    "outliers": Annotated[Count, says("number of units that are farther from the population than expected")],
    "limit": Annotated[Number, says("pull from which that is")],
    "worst": Annotated[tuple[Worst, ...], says(
        "units farthest from the population: `unit`, `term` (or `N`), `value`, `pull` (distance over "
        "its expected sd), whether that is an `outlier`"
    )],
    "broken": Annotated[tuple[Broken, ...], says("units that could not be read: `number`, `name`, `error`")],
})


class ClassTermInScene(TypedDict):
    """What a term does in a scene, over the units of a class."""

    name: Annotated[str, says("of the term")]
    rms: Annotated[Number, says("effect on the output, median over units")]
    share_of_budget: Annotated[Number, says("median over units")]
    share_range: Annotated[Numbers, says("5 % and 95 % points over units")]
    required: Annotated[Number, says(
        "share of the units whose smallest model for the scene has it, shown by the test or not"
    )]
    true_share_of_budget: Annotated[Number, says(
        "of the simulated truth, median over units, by a full navigator that flies the scene with the error"
        " and without it"
    )]
    linear_share_of_budget: NotRequired[Annotated[Number, says(
        "the same by the linear propagation that the other shares are by"
    )]]
    answer: Annotated[str, says("`needed`, `not needed`, `would matter` or `cannot tell`")]
    most_of_budget: NotRequired[Annotated[Number, says("at the `limit` that all units together set")]]


class ClassInScene(TypedDict):
    """A class in a scene, with the keys of a component's: `sensor` is the class, `model` what it needs."""

    name: Annotated[str, says("of the scene")]
    sensor: Annotated[str, says("the class")]
    model: Annotated[Names, says("terms that the class needs there")]
    would_matter: Annotated[Names, says("terms that only the catalogue says would")]
    cannot_tell: Annotated[Names, says("terms that the tests of most units leave open")]
    terms: Annotated[tuple[ClassTermInScene, ...], says("of the library")]
    order: Annotated[Interval, says(
        "number of terms that a unit's own smallest model has: median and 90 % range over units"
    )]
    within: Annotated[Number, says("share of the units for which a model within the budget was found")]
    noise_share_of_budget: Annotated[Number, says("noise's, median over units")]
    basic_share_of_budget: Annotated[Number, says(
        "that a triad of twelve parameters leaves, median over units; null where not asked"
    )]
    tested_order: NotRequired[Annotated[Interval | None, says(
        "as `order`, where the terms kept take up the others over the inputs of the unit's test"
    )]]
    beyond: NotRequired[Annotated[tuple[Number, Number] | None, says(
        "share of the budget from which the linear propagation is off the full navigator by more than 20 %, "
        "and the least that that makes of such shares; null where it is not"
    )]]


class ClassTerm(TermOfUnits):
    """A term over the units of a class."""

    answer: Annotated[str, says("`needed`, `not needed` or `cannot tell`")]
    needed_by_lot: NotRequired[Annotated[Numbers, says(
        "share of the units of each lot in which it is needed"
    )]]
    pooled: NotRequired[Annotated[PooledUnits, says(
        "what all units say together: `inclusion`, the probability that units of the class have the term; "
        "`share` of the units that have it, if any has; `limit`, the size, SI, that a further unit's "
        "coefficient stays below with 95 %"
    )]]


class Unit(TypedDict):
    """A simulated unit: coefficients in the order of the terms."""

    number: Annotated[Count, says("in its class")]
    truth: Annotated[Numbers, says(
        "coefficients that were simulated, in the order of the terms like all that follows"
    )]
    mean: Annotated[Numbers, says("averaged over models")]
    sd: Annotated[Numbers, says("the same")]
    inclusion: Annotated[Numbers, says("probability that the term is in the model")]
    full_mean: Annotated[Numbers, says("with all candidate terms, without the term's own prior")]
    full_sd: Annotated[Numbers, says("the same")]
    verdicts: Annotated[Names, says("see [verdicts](#verdicts)")]
    noise: Annotated[Noise, says("N, B, K")]


class Agreement(TypedDict):
    """A method beside the decision, over the terms of units."""

    method: Annotated[str, says("as in `votes`; `evidence` is the decision itself")]
    units: Annotated[Count, says("about which it was asked")]
    of: Annotated[Count, says("terms of units on which it has an answer, and the decision is sure")]
    share: Annotated[Interval, says("of these, those on which they agree")]
    keeps: Annotated[dict[str, Count], says("units in which it keeps what is `not needed`, by term")]
    drops: Annotated[dict[str, Count], says("units in which it drops what is `needed`, by term")]
    false: Annotated[tuple[Count, Count], says(
        "terms kept of which the truth is below one posterior sd, and how many such terms there are"
    )]
    missed: Annotated[tuple[Count, Count], says(
        "terms left out of which the truth is above eight posterior sds, and how many such terms there are"
    )]


class Class(TypedDict):
    """A class of a lot study; `order` counts the needed terms of a unit."""

    id: Annotated[str, says("of the catalogue")]
    order: Annotated[Interval, says("number of needed terms of a unit: median and 90 % range over units")]
    needed: Annotated[Names, says("terms that the class needs")]
    not_needed: Annotated[Names, says("terms that it does not")]
    cannot_tell: Annotated[Names, says("terms that the tests of most units leave open")]
    terms: Annotated[tuple[ClassTerm, ...], says("of the library")]
    units: Annotated[tuple[Unit, ...], says("of the lots, one lot after the other")]
    methods: NotRequired[Annotated[tuple[Agreement, ...], says("beside the decision, where they were asked")]]


class Statement(TypedDict):
    """A published statement on classes of sensors, and what the study makes of it."""

    text: Annotated[str, says("in words of our own")]
    source: Annotated[str, says("where it stands")]
    claims: Annotated[str, says("`needed`, `small`, `size` or `open`")]
    verdict: Annotated[str, says("`confirmed`, `contradicted` or `beyond the test`")]
    classes: Annotated[dict[str, str], says("verdict by class")]
    sizes: Annotated[dict[str, tuple[Number, Number]], says(
        "by class: of `small` the largest share of a budget in the median unit, and that which further units "
        "stay below with 95 %; of `size` lowest and highest, in `unit`"
    )]
    unit: Annotated[str, says("of the sizes")]
    why: Annotated[str, says("why no study can tell; empty where one can")]


class Lots(TypedDict):
    """Lots of simulated units of each class."""

    kind: Annotated[Kind, says("accelerometer or gyroscope")]
    units: Annotated[Count, says("of each lot")]
    lots: NotRequired[Annotated[Count, says("of each class")]]
    methods: NotRequired[Annotated[tuple[Agreement, ...], says("over the units of all classes")]]
    terms: Annotated[Names, says("of the library")]
    classes: Annotated[tuple[Class, ...], says("of the study")]
    check: Annotated[Check, says(
        'of what is said against the simulated truth: `precision` and `recall` of "required in this '
        'scene by this class", how many `cells` the tests tell and how many of them are truly '
        "required, cells that are `untold`, and what the 90 % intervals hold of the lots' means and "
        "spreads (`population_mean`, `population_spread`), and true shares of budgets, by their range over "
        "units (`shares`) and by each unit's own (`unit_shares`; `linear_shares`: of truths by linear "
        "propagation; `seen_shares`: of these where the test knows the coefficient well); `off`: part by "
        "which that is off the full navigator, median and most, but for the cells `beyond` where it holds"
    )]
    statements: NotRequired[Annotated[tuple[Statement, ...], says(
        "published on the study's classes, and whether it bears them out"
    )]]


class LotsResult(Headed):
    """Result of a class-level study."""

    answer: Annotated[Names, says("to the title's question, in sentences")]
    status: Annotated[str, says("the answer in a line")]
    simulated: Annotated[str, says("how many lots of how many units, in words")]
    scenes: Annotated[tuple[ClassInScene, ...], says("of each class and scene")]
    lots: Annotated[Lots, says("what the units say of their classes")]
    provenance: Annotated[Provenance, says("the study file and its text, the command, versions")]


class FleetResult(Headed):
    """Result of a study of a fleet."""

    answer: Annotated[Names, says("what the units say together, in sentences")]
    fleet: Annotated[Fleet, says("what they say, in numbers")]
    engine: Annotated[str, says("what computed the units, in words")]
    resumed: Annotated[Count, says("units that an earlier run had finished")]
    seconds: Annotated[Number, says("of computing")]
    provenance: Annotated[Provenance, says("the study file and its text, the command, versions")]
# fmt: on
