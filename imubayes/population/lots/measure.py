"""The whole class-level study: every unit of every class tested, put together, and held against the truth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from imubayes.inference.intervals import Share, frequency
from imubayes.population.lots.answers import Check, ClassFound, Coverage, LotResult, UnitFound
from imubayes.population.lots.missions import exposures, missions, over_units
from imubayes.population.lots.needs import UNTOLD, WOULD_MATTER, in_scene
from imubayes.population.lots.plan import LotStudy
from imubayes.population.lots.population import population
from imubayes.population.lots.units import lot_of, unit_of
from imubayes.population.processes import Progress, shared
from imubayes.selection.relevance import MATTERS
from imubayes.sensors.lots import Lot


def measure(study: LotStudy, *, progress: Progress = lambda message: None) -> LotResult:
    """Measure what the classes of a study need.

    Parameters
    ----------
    study : as `config.read` gives it.
    progress : is told how many units are done.
    """
    start = time.perf_counter()
    lots = [lot_of(study, k) for k in range(len(study.classes))]
    units = _units(study, lots, progress)
    progress("scenes")
    exposed = exposures(study)
    classes = tuple(
        ClassFound(
            sensor_class=lot.sensor_class,
            units=own,
            terms=population(own, study.library, lot),
            order=over_units([unit.verdicts.count("needed") for unit in own]),
            missions=missions(own, study, exposed),
        )
        for lot, own in zip(lots, units, strict=True)
    )
    return LotResult(study, classes, check(classes), time.perf_counter() - start)


def _units(study: LotStudy, lots: Sequence[Lot], progress: Progress) -> list[tuple[UnitFound, ...]]:
    """Units of each class; scenes stay behind, as no unit needs them and they are large."""
    slim = replace(study, missions=())
    jobs = [(slim, k, number, lot) for k, lot in enumerate(lots) for number in range(study.units)]
    found = shared(unit_of, jobs, study.processes, things="units", progress=progress)
    return [tuple(found[k * study.units : (k + 1) * study.units]) for k in range(len(lots))]


def check(classes: Sequence[ClassFound]) -> Check:
    """Hold the class-level answers against the simulated truth.

    A cell is a term of a class in a scene. It is *required* where its median share of the budget over the
    units is `relevance.MATTERS` or more: of the estimates for what the study says, of the simulated
    coefficients for the truth. Cells that the tests cannot tell (`needs.in_scene`) are counted apart. The
    coverage of means and of spreads is that of the terms that the test excites: of the others the interval is
    the prior's.
    """
    cells = [
        (term.share.value >= MATTERS, term.true_share >= MATTERS)
        for one in classes
        for scene in one.missions
        for known, term in zip(one.terms, scene.terms, strict=True)
        if in_scene(known, term) not in (UNTOLD, WOULD_MATTER)
    ]
    both = sum(said and true for said, true in cells)
    said, true = (sum(cell[k] for cell in cells) for k in (0, 1))
    tested = [
        term
        for one in classes
        for j, term in enumerate(one.terms)
        if any(unit.verdicts[j] != "untested" for unit in one.units)
    ]
    return Check(
        precision=frequency(both, said),
        recall=frequency(both, true),
        cells=(len(cells), true),
        population_mean=_coverage([(term.mean, term.true_mean) for term in tested]),
        population_spread=_coverage([(term.spread, term.true_spread) for term in tested]),
        untold=sum(len(scene.terms) for one in classes for scene in one.missions) - len(cells),
    )


def _coverage(pairs: Sequence[tuple[Share, float]]) -> Coverage:
    """Count the truths that lie within their intervals."""
    held = sum(found.low <= truth <= found.high for found, truth in pairs)
    return Coverage(held, len(pairs), frequency(held, len(pairs)))
