"""What a class needs in each scene: every unit weighed there, and its truth by the same effects."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.campaign.study import Mission
from imubayes.errors import UnobservableError
from imubayes.inference.intervals import Share
from imubayes.population.lots.answers import MissionFound, MissionTerm, UnitFound
from imubayes.population.lots.plan import LotStudy
from imubayes.selection.relevance import SURE, Exposure, Knowledge, Relevance, exposure, weigh
from imubayes.sensors.equations.basic import TERMS, project
from imubayes.sensors.noise import Noise

RANGE = (0.5, 0.05, 0.95)
"""Quantiles over units: median and 90 % range."""


def exposures(study: LotStudy) -> tuple[Exposure, ...]:
    """Work out the effects of the library's terms in each scene, once for all classes."""
    return tuple(exposure(m.scene, study.library, m.budget, axis=m.axis) for m in study.missions)


def missions(
    units: Sequence[UnitFound], study: LotStudy, exposed: Sequence[Exposure]
) -> tuple[MissionFound, ...]:
    """Weigh the units of one class in every scene of a study.

    Parameters
    ----------
    units : of one class.
    study : names the scenes, and says whether it is asked what the triad of twelve parameters leaves.
    exposed : what each scene makes of the library's terms (see `exposures`).
    """
    pairs = zip(study.missions, exposed, strict=True)
    return tuple(_mission(units, mission, seen, study.basic) for mission, seen in pairs)


def _mission(units: Sequence[UnitFound], mission: Mission, seen: Exposure, basic: bool) -> MissionFound:
    weighed = [weigh(seen, _knowledge(unit), noise=Noise(*unit.noise)) for unit in units]
    limit = mission.budget.limit
    left = [basic_left(seen, unit.average, unit.draws) / limit for unit in units] if basic else [math.nan]
    return MissionFound(
        mission=mission.name,
        terms=_terms(units, weighed, seen),
        order=over_units([len(one.model) for one in weighed]),
        within=float(np.mean([one.met for one in weighed])),
        noise_share=float(np.median([math.hypot(*one.noise) for one in weighed])) / limit,
        basic_share=float(np.median(left)),
    )


def over_units(values: Sequence[float] | FloatArray) -> Share:
    """Median and 90 % range over units."""
    return Share(*np.quantile(values, RANGE).tolist())


def _knowledge(unit: UnitFound) -> Knowledge:
    """What is known of a unit; its limits, and draws, are those of all models together."""
    return Knowledge(unit.draws, unit.inclusion, np.quantile(np.abs(unit.draws), SURE, axis=0))


def _terms(
    units: Sequence[UnitFound], weighed: Sequence[Relevance], seen: Exposure
) -> tuple[MissionTerm, ...]:
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
