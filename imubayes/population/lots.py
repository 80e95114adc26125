"""A class-level study: lots of simulated units, put together, weighed in scenes, held against the truth.

Other methods share the decision on simulated units or don't (`agreements`): they are held against it where it
is sure, needed or not needed. By the truth, of all terms that the test excites, a term kept is *false* where
the posterior sd of the test is larger than the true coefficient, and one left out is *missed* where that sd
is far smaller; what is between may be either.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.campaign import Mission, SensorSpec
from imubayes.inference import Rate, Share, frequency, rate
from imubayes.inference.prior import class_sd
from imubayes.population import Record, Unit, alone, record_of
from imubayes.population.needs import (
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    ClassFound,
    MissionFound,
    MissionTerm,
    PopulationTerm,
)
from imubayes.population.spreads import over_units, population
from imubayes.scenes.effects import SURE, Knowledge, SceneEffects
from imubayes.scenes.relevance import MATTERS, Exposure, Relevance, basic_left, exposure, weigh
from imubayes.sensors import SensorClass
from imubayes.sensors.lots import Lot, draw_lot
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Kind, Library
from imubayes.units import Key, Name
from imubayes.work import Progress, shared, silent

COUNTS = 0.1 * MATTERS
"""Share of a budget from which a term is looked at."""

SEEN = 0.2
"""What a test leaves open of a coefficient, over its prior's sd, below which the prior has hardly a say."""

LINEAR = 0.2
"""Part by which the linear propagation may be off the navigator where it says how often a budget is taken."""

DRAWS = 500
"""Posterior draws of a unit: quantiles over them scatter by less than units do."""


@dataclass(frozen=True, slots=True)
class Against:
    """The question which terms some classes need that others do not: ids of the classes."""

    needed_by: Annotated[
        tuple[Name, ...], Key("the first of two groups: which terms these need", ["fog_tactical"])
    ]
    not_by: Annotated[tuple[Name, ...], Key("and these do not", ["mems_tactical"])]


@dataclass(frozen=True, slots=True, eq=False)
class LotStudy:
    """A class-level study.

    `specs` are of a unit of each class, in the order of the report: class, library as the class couples it,
    the test campaign that each unit goes through, and the sd of each error of the bench, which is drawn for
    each unit, and allowed for in its analysis. `library` has the candidate terms, without couplings.
    `units` are simulated of each lot, `lots` drawn of each class; about the first `methods` units of each lot
    the other methods are asked, too, chains only about the first of a class. `asks` is what the report
    answers first: what each of the classes needs, what the scenes require, whether the triad is enough, or
    what some classes need and others do not; `basic`, whether it says what the twelve-parameter triad costs.
    """

    title: str
    seed: int
    kind: Kind
    specs: tuple[SensorSpec, ...]
    units: int
    library: Library
    missions: tuple[Mission, ...]
    basic: bool
    processes: int
    path: Path
    text: str
    asks: Literal["classes", "scenes", "triad"] | Against = "classes"
    lots: int = 1
    methods: int = 0

    @property
    def classes(self) -> tuple[SensorClass, ...]:
        """Class of each of the specs."""
        return tuple(spec.sensor_class for spec in self.specs if spec.sensor_class)


@dataclass(frozen=True, slots=True)
class Check:
    """The class-level answers against the simulated truth.

    Attributes
    ----------
    precision, recall : of "required in this scene by this class", over all terms, classes and scenes.
    cells : how many of these the tests tell, and how many of them are truly required.
    population_mean, population_spread : how many of the lots' means and spreads their 90 % intervals hold.
    shares, unit_shares : of the cells of `COUNTS` or more that the tests tell, in how many the range over
        units of a share of the budget holds the true one of the median unit; and how many units' own 90 %
        intervals hold theirs.
    linear_shares : as `unit_shares`, with the truth by the linear propagation.
    seen_shares : as `linear_shares`, of the units whose test leaves less than `SEEN` of the prior open.
    off : part by which the linear propagation is off the navigator, in cells of `COUNTS` or more: in the
        median cell, and at most. NaN where no cell is.
    untold : cells beside these, which the tests cannot tell.
    beyond : cells in which the linear propagation has ended (`linear_end`); shares and `off` leave them out.
    """

    precision: Share
    recall: Share
    cells: tuple[int, int]
    population_mean: Rate
    population_spread: Rate
    shares: Rate
    unit_shares: Rate
    linear_shares: Rate
    seen_shares: Rate
    off: tuple[float, float]
    untold: int = 0
    beyond: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class LotResult:
    """Result of a class-level study."""

    study: LotStudy
    classes: tuple[ClassFound, ...]
    check: Check
    seconds: float


def measure(study: LotStudy, *, progress: Progress = silent) -> LotResult:
    """Measure what the classes of a study need; `progress` is told how many units are done."""
    start = time.perf_counter()
    drawn = [[lot_of(study, k, number) for number in range(study.lots)] for k in range(len(study.specs))]
    lots = _units(study, drawn, progress)
    progress("scenes")
    exposed = exposures(study.missions, study.library)
    true = [flown(seen, [np.concatenate([lot.theta for lot in own]) for own in drawn]) for seen in exposed]
    classes: list[ClassFound] = []
    for k, entry in enumerate(study.classes):
        units = tuple(unit for lot in lots[k] for unit in lot)
        terms = population(lots[k], entry, study.library, drawn[k])
        cases = zip(study.missions, exposed, [shares[k] for shares in true], strict=True)
        sd = class_sd(entry, study.library)
        scenes = tuple(in_mission(units, terms, *case, sd, basic=study.basic) for case in cases)
        order = over_units([unit.verdicts.count(NEEDED) for unit in units])
        classes.append(ClassFound(entry, units, terms, order, scenes))
    ends = [linear_end([grade.missions[m] for grade in classes]) for m in range(len(study.missions))]
    classes = [
        replace(
            grade, missions=tuple(map(lambda scene, end: replace(scene, beyond=end), grade.missions, ends))
        )
        for grade in classes
    ]
    return LotResult(study, tuple(classes), check(classes), time.perf_counter() - start)


def linear_end(scenes: Sequence[MissionFound]) -> tuple[float, float]:
    """Where the linear propagation of a scene ends: shares of its budget, by what classes make of it.

    It is off the navigator by more than `LINEAR` from the first on, as of a term of one of the classes that
    takes the budget or more by it; of these the navigator makes the second at least. Infinite where it does
    not end.
    """
    off = [
        (term.linear_share, term.true_share)
        for scene in scenes
        for term in scene.terms
        if term.linear_share > 1.0 and abs(term.linear_share - term.true_share) > LINEAR * term.true_share
    ]
    return min((a for a, _ in off), default=math.inf), min((b for _, b in off), default=math.inf)


def lot_of(study: LotStudy, class_index: int, number: int = 0) -> Lot:
    """Draw one of the lots of one class of a study."""
    rng = np.random.default_rng([study.seed, class_index, 0, *([number] if number else [])])
    return draw_lot(study.classes[class_index], study.library, study.units, rng)


def _units(
    study: LotStudy, drawn: Sequence[Sequence[Lot]], progress: Progress
) -> list[list[tuple[Record, ...]]]:
    """Units of each lot of each class; scenes stay behind, as no unit needs them and they are large."""
    slim = replace(study, missions=())
    jobs = [
        (slim, k, number, lots[number // study.units])
        for k, lots in enumerate(drawn)
        for number in range(study.lots * study.units)
    ]
    records = iter(shared(unit_of, jobs, study.processes, things="units", progress=progress))
    return [[tuple(next(records) for _ in range(study.units)) for _ in lots] for lots in drawn]


def unit_of(study: LotStudy, class_index: int, number: int, lot: Lot) -> Record:
    """Test and analyse one unit of a lot of a class, by its number in the class."""
    spec, place = study.specs[class_index], number % study.units
    asked = {"methods": place < study.methods, "chains": number == 0}
    unit = Unit(number, spec.id, lot=alone(lot, place))
    return record_of(unit, spec, (study.seed, class_index, 1, number), draws=DRAWS, **asked)


def check(classes: Sequence[ClassFound]) -> Check:
    """Hold the class-level answers against the simulated truth.

    A cell is a term of a class in a scene. It is *required* where its median share of the budget over the
    units is `relevance.MATTERS` or more: of the estimates for what the study says, of the simulated
    coefficients for the truth. Cells that the tests cannot tell (`needs.MissionTerm`) are counted apart. The
    coverage of means and of spreads is that of the terms that the test excites: of the others the interval is
    the prior's.
    """
    every = [
        (term.answer, term, len(grade.units), term.linear_share < scene.beyond[0])
        for grade in classes
        for scene in grade.missions
        for term in scene.terms
    ]
    told = [cell for cell in every if cell[0] not in (UNTOLD, WOULD_MATTER)]
    cells = [(term.share.value >= MATTERS, term.true_share >= MATTERS) for _, term, _, _ in told]
    both = sum(said and true for said, true in cells)
    said, true = (sum(cell[k] for cell in cells) for k in (0, 1))
    large = [
        (term, n)
        for _, term, n, linear in told
        if linear and max(term.share.value, term.true_share) >= COUNTS
    ]
    units = sum(n for _, n in large)
    off = [
        abs(term.linear_share / term.true_share - 1.0)
        for _, term, _, linear in every
        if linear and term.true_share >= COUNTS
    ]
    tested = [
        lot
        for grade in classes
        for j, term in enumerate(grade.terms)
        for lot in term.lots
        if any(unit.verdicts[j] != "untested" for unit in grade.units)
    ]
    return Check(
        precision=frequency(both, said),
        recall=frequency(both, true),
        cells=(len(cells), true),
        population_mean=_coverage([(term.mean, term.true_mean) for term in tested]),
        population_spread=_coverage([(term.spread, term.true_spread) for term in tested]),
        shares=_coverage([(term.share, term.true_share) for term, _ in large]),
        unit_shares=rate(sum(term.held[0] for term, _ in large), units),
        linear_shares=rate(sum(term.held[1] for term, _ in large), units),
        seen_shares=rate(sum(term.seen[1] for term, _ in large), sum(term.seen[0] for term, _ in large)),
        off=(float(np.median(off)), max(off)) if off else (math.nan, math.nan),
        untold=len(every) - len(cells),
        beyond=sum(not linear for *_, linear in every),
    )


def _coverage(pairs: Sequence[tuple[Share, float]]) -> Rate:
    """Count the truths that lie within their intervals."""
    return rate(sum(share.low <= truth <= share.high for share, truth in pairs), len(pairs))


def exposures(scenes: Sequence[Mission], lib: Library) -> tuple[Exposure, ...]:
    """Work out the effects of the library's terms in each scene, once for all classes."""
    return tuple(exposure(m.scene, lib, m.budget, axis=m.axis) for m in scenes)


def in_mission(
    units: Sequence[Record],
    terms: Sequence[PopulationTerm],
    mission: Mission,
    seen: Exposure,
    true: FloatArray,
    sd: FloatArray,
    *,
    basic: bool,
) -> MissionFound:
    """Weigh the units of one class in a scene, with what it makes of the library's terms (`exposures`).

    `terms` are what the units say together, `true` their true shares (n, p) of the budget (`flown`), `sd`
    (p,) of the class's prior. What the triad of twelve parameters leaves is worked out where `basic` asks for
    it.
    """
    weighed = [
        weigh(
            seen,
            # limits, and draws, are those of all models together
            Knowledge(unit.draws, unit.inclusion, np.quantile(np.abs(unit.draws), SURE, axis=0)),
            noise=Noise(*unit.noise),
            tested=SceneEffects(seen.lib.names, unit.R[:-1, :-1]),
        )
        for unit in units
    ]
    limit = mission.budget.limit
    left = [basic_left(seen, unit.draws) / limit for unit in units] if basic else [math.nan]
    return MissionFound(
        name=mission.name,
        terms=_terms(units, terms, weighed, seen, true, sd),
        order=over_units([len(relevance.model) for relevance in weighed]),
        tested_order=over_units([len(relevance.tested_model or ()) for relevance in weighed]),
        within=float(np.mean([relevance.within_budget for relevance in weighed])),
        noise_share=float(np.median([math.hypot(*relevance.noise) for relevance in weighed])) / limit,
        basic_share=float(np.median(left)),
    )


def _terms(
    units: Sequence[Record],
    terms: Sequence[PopulationTerm],
    weighed: Sequence[Relevance],
    seen: Exposure,
    true: FloatArray,
    sd: FloatArray,
) -> tuple[MissionTerm, ...]:
    rows = np.array(
        [
            [(t.rms, t.kept, t.share_q05, t.share_of_budget, t.share_q95) for t in relevance.terms]
            for relevance in weighed
        ]
    )
    rms, kept, low, share, high = np.moveaxis(rows, -1, 0)
    linear = seen.budgeted.single(np.array([unit.truth for unit in units])) / seen.budget.limit
    held = [(low <= size) & (size <= high) for size in (true, linear)]
    clear = np.array([unit.full_sd for unit in units]) < SEEN * sd
    by_flight, by_line, known, of_known = np.sum([*held, clear, clear & held[1]], axis=1).tolist()
    most = seen.budgeted.single(np.array([term.pooled.limit for term in terms])) / seen.budget.limit
    return tuple(
        MissionTerm(
            known=term,
            rms=float(np.median(rms[:, j])),
            share=over_units(share[:, j]),
            required=float(kept[:, j].mean()),
            true_share=float(np.median(true[:, j])),
            most_of_budget=float(most[j]),
            linear_share=float(np.median(linear[:, j])),
            held=(by_flight[j], by_line[j]),
            seen=(known[j], of_known[j]),
        )
        for j, term in enumerate(terms)
    )


def flown(seen: Exposure, truths: Sequence[FloatArray]) -> list[FloatArray]:
    """Share (n, p) of the budget that coefficients (n, p) of classes take, each alone, by a full navigator.

    The median unit of each class is flown; where its error is so large that it is no longer in proportion to
    the coefficient, those of the other units are taken to be so all the same.
    """
    from imubayes.scenes.navigator import flown_sizes

    median = np.median(np.abs(truths), axis=1)
    shares = flown_sizes(seen.scene, seen.lib, seen.budget, median, seen.axis) / seen.budget.limit
    each = zip(truths, median, shares, strict=True)
    return [np.abs(truth) * share / np.where(size > 0.0, size, 1.0) for truth, size, share in each]


SMALL = 1.0
"""Posterior sd below which a coefficient is too small for the test, so that 'needed' is a false alarm."""

LARGE = 8.0
"""Posterior sd above which no method should leave a term out."""

DECISION = "evidence"
"""Method that is the decision itself."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """One method over some units.

    Attributes
    ----------
    method : its name; that of the decision is `DECISION`.
    units : how many it was asked about.
    of : terms of units on which it has an answer, and the decision is sure.
    share : of these, those on which they agree.
    keeps, drops : how often it keeps what the decision drops, and drops what that keeps, by term.
    false, missed : how many terms it keeps that are in truth below `SMALL` sd of the test, and leaves out
        that are above `LARGE`; and how many such terms there are.
    """

    method: str
    units: int
    of: int
    share: Share
    keeps: Mapping[str, int]
    drops: Mapping[str, int]
    false: tuple[int, int]
    missed: tuple[int, int]


def agreements(units: Sequence[Record], names: tuple[str, ...]) -> tuple[Agreement, ...]:
    """Hold every method against the decision and the truth, over the units of simulated lots that have votes.

    `names` are the library's terms; without votes there is nothing.
    """
    asked = [unit for unit in units if unit.votes is not None]
    methods = dict.fromkeys(method for unit in asked if unit.votes for method in unit.votes.methods)
    size = np.array([np.abs(unit.truth) / unit.full_sd for unit in asked]).reshape(-1, len(names))
    # whether each keeps each term of each unit (n, p): 1 or 0, NaN where it says nothing
    told = {method: np.full((len(asked), len(names)), np.nan) for method in methods}
    for k, votes in enumerate(unit.votes for unit in asked if unit.votes):
        for method, keeps in zip(votes.methods, votes.keeps, strict=True):
            told[method][k, [names.index(term) for term in votes.terms]] = keeps
    verdicts = np.array([unit.verdicts for unit in asked]).reshape(-1, len(names))
    decided = np.where(verdicts == NEEDED, 1.0, np.where(verdicts == NOT_NEEDED, 0.0, np.nan))
    told[DECISION] = decided
    size[verdicts == "untested"] = np.nan
    return tuple(
        _agreement(method, names, answers, decided, size)
        for method, answers in told.items()
        if not np.isnan(answers).all()
    )


def _agreement(
    method: str, names: tuple[str, ...], answers: FloatArray, decided: FloatArray, size: FloatArray
) -> Agreement:
    both = ~np.isnan(answers) & ~np.isnan(decided)
    kept, same = answers == 1.0, both & (answers == decided)
    small, large = size < SMALL, size > LARGE
    of, alike = int(both.sum()), int(same.sum())
    return Agreement(
        method=method,
        units=int((~np.isnan(answers)).any(axis=1).sum()),
        of=of,
        share=frequency(alike, of),
        keeps=_by_term(both & ~same & kept, names),
        drops=_by_term(both & ~same & ~kept, names),
        false=(int((small & kept).sum()), int(small.sum())),
        missed=(int((large & (answers == 0.0)).sum()), int(large.sum())),
    )


def _by_term(where: BoolArray, names: tuple[str, ...]) -> dict[str, int]:
    counts = Counter(dict(zip(names, where.sum(axis=0).tolist(), strict=True)))
    return {name: count for name, count in counts.most_common() if count}
