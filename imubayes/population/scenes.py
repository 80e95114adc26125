"""What a class needs in each scene: every unit weighed there, and its truth by the same effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.campaign.study import Mission
from imubayes.errors import UnobservableError
from imubayes.inference.intervals import Share
from imubayes.population.records import Record
from imubayes.population.spreads import over_units
from imubayes.scenes.relevance import SURE, Exposure, Knowledge, Relevance, exposure, weigh
from imubayes.sensors.equations.basic import TERMS, project
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library


@dataclass(frozen=True, slots=True)
class MissionTerm:
    """One term of a class in one scene.

    Attributes
    ----------
    name : of the term.
    rms : median over units of its rms effect on the output, SI.
    share : median over units of its share of the budget, and the 5 % and 95 % quantiles over units.
    required : share of the units whose smallest model for the scene has it, shown by the test or not.
    true_share : median over units of the share of the budget of the simulated truth.
    """

    name: str
    rms: float
    share: Share
    required: float
    true_share: float


@dataclass(frozen=True, slots=True, eq=False)
class MissionFound:
    """A class in one scene.

    Attributes
    ----------
    mission : name of the scene.
    terms : every term of the library.
    order : number of terms that a unit's own smallest model has: median and 90 % range over units.
    within : share of the units for which a model within the budget was found.
    noise_share : noise's share of the budget, median over units.
    basic_share : median share of the budget that a triad of twelve parameters leaves; NaN where not asked.
    """

    mission: str
    terms: tuple[MissionTerm, ...]
    order: Share
    within: float
    noise_share: float
    basic_share: float


def exposures(scenes: Sequence[Mission], lib: Library) -> tuple[Exposure, ...]:
    """Work out the effects of the library's terms in each scene, once for all classes."""
    return tuple(exposure(m.scene, lib, m.budget, axis=m.axis) for m in scenes)


def missions(
    units: Sequence[Record], scenes: Sequence[Mission], exposed: Sequence[Exposure], *, basic: bool
) -> tuple[MissionFound, ...]:
    """Weigh the units of one class in every scene.

    Parameters
    ----------
    units : of one class.
    scenes, exposed : each, and what it makes of the library's terms (see `exposures`).
    basic : whether it is asked what the triad of twelve parameters leaves.
    """
    pairs = zip(scenes, exposed, strict=True)
    return tuple(_mission(units, mission, seen, basic) for mission, seen in pairs)


def _mission(units: Sequence[Record], mission: Mission, seen: Exposure, basic: bool) -> MissionFound:
    weighed = [weigh(seen, _knowledge(unit), noise=Noise(*unit.noise)) for unit in units]
    limit = mission.budget.limit
    left = [basic_left(seen, unit.mean, unit.draws) / limit for unit in units] if basic else [math.nan]
    return MissionFound(
        mission=mission.name,
        terms=_terms(units, weighed, seen),
        order=over_units([len(one.model) for one in weighed]),
        within=float(np.mean([one.met for one in weighed])),
        noise_share=float(np.median([math.hypot(*one.noise) for one in weighed])) / limit,
        basic_share=float(np.median(left)),
    )


def _knowledge(unit: Record) -> Knowledge:
    """What is known of a unit; its limits, and draws, are those of all models together."""
    return Knowledge(unit.draws, unit.inclusion, np.quantile(np.abs(unit.draws), SURE, axis=0))


def _terms(units: Sequence[Record], weighed: Sequence[Relevance], seen: Exposure) -> tuple[MissionTerm, ...]:
    rms, share, kept = (
        np.array([[value(term) for term in one.terms] for one in weighed])
        for value in (lambda t: t.rms, lambda t: t.share[1], lambda t: t.kept)
    )
    true = seen.budgeted.single(np.array([unit.truth for unit in units])) / seen.budget.limit
    return tuple(
        MissionTerm(
            name=name,
            rms=float(np.median(rms[:, j])),
            share=over_units(share[:, j]),
            required=float(kept[:, j].mean()),
            true_share=float(np.median(true[:, j])),
        )
        for j, name in enumerate(seen.lib.names)
    )


def basic_left(seen: Exposure, theta: FloatArray, draws: FloatArray) -> float:
    """Size that the error of a triad of twelve parameters stays below in a scene with 95 %, SI of the budget.

    Bias, scale and misalignment of the triad are those found, and take up what they can of the other terms'
    rms over the scene. The error is what they leave, and what the test does not know of any term.

    Parameters
    ----------
    seen : what the scene makes of the terms.
    theta : (p,) coefficients that were found, SI.
    draws : (m, p) of their posterior.
    """
    names = seen.lib.names
    left = np.array([0.0 if name in TERMS else value for name, value in zip(names, theta, strict=True)])
    for name, taken in _taken_up(seen, left).items():
        left[names.index(name)] = -taken
    return float(np.quantile(seen.budgeted.size(left + draws - theta), SURE))


def _taken_up(seen: Exposure, others: FloatArray) -> dict[str, float]:
    """What bias, scale and misalignment take up of the other terms.

    A scene in which one of them does what others do as well has one less of them.
    """
    lib, R = seen.lib, seen.output.rows
    columns, kept = np.pad(R, ((0, len(lib.terms) + 1 - len(R)), (0, 1))), list(TERMS)
    while True:
        alone = columns.copy()
        for name in set(TERMS) - set(kept):
            alone[:, lib.names.index(name)] = 0.0
        try:
            found = project(lib, others, Factor(lib.names, alone, 1))[1].coefficients
            return {name: found[name] for name in kept}
        except UnobservableError as error:
            kept = [name for name in kept if name not in error.terms]
