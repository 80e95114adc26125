"""Recorded units of one class: what their sessions say together, and one model for all of them.

Components x, y, z of a triad, and units of a class, have coefficients of their own, but if they have the same
model, its evidence is the product of theirs. Terms that not all of them have (accelerometers without a
reference lack some misalignments) are averaged over, each component by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.campaign.study import SensorResult, SensorSpec
from imubayes.population.levels import Likelihoods, likelihoods, of_units
from imubayes.population.needs import Need, class_need, unit_answer
from imubayes.population.pooled import Pooled, pooled
from imubayes.population.sessions import SessionVerdict, arranged, in_session, joined, level_among
from imubayes.population.spreads import FEWEST, Spreads, lot_sizes, spreads
from imubayes.selection.decision import Selection
from imubayes.selection.model_prior import log_model_prior
from imubayes.selection.model_sets import Every, fold, sizes
from imubayes.selection.models import Models
from imubayes.sensors.catalogue import prior_sd
from imubayes.sensors.terms import Kind

Tested = Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
"""Each sensor of a study with the results of its components."""


@dataclass(frozen=True, slots=True, eq=False)
class TermInClass:
    """One term of the units of a class.

    Attributes
    ----------
    name : with the component of a triad (``ax.b0``) or for all of its axes together (``b0``).
    unit, printed : SI unit, and the one people use.
    term, component : the two parts of that; the component is empty for all together.
    size : that the class gives the coefficient, SI: the prior's sd.
    spreads : mean and spreads of the population.
    units : (u,) names; of all axes together with their component.
    sessions : (s,) names.
    value, error : (u, s) each session's estimate without the prior, and its sd, SI; NaN where a unit lacks a
        session or a session cannot tell.
    need : whether the class needs the term.
    """

    name: str
    unit: str
    printed: str
    term: str
    component: str
    size: float
    spreads: Spreads
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    value: FloatArray
    error: FloatArray
    need: Need

    @property
    def told(self) -> bool:
        """Whether enough units tell of the term for the population to be known."""
        return not math.isnan(self.spreads.unit.value)


@dataclass(frozen=True, slots=True, eq=False)
class ClassInCommon:
    """What the units of a class have in common: each term for all axes of a triad together, then for each.

    The components of single sensors have one empty name.
    """

    class_id: str
    kind: Kind
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    components: tuple[str, ...]
    terms: tuple[TermInClass, ...]


def in_common(results: Tested) -> Iterator[ClassInCommon]:
    """What the units of each class have in common, where a study has four or more of one class and kind.

    Units without a class have no sizes to be held against, and are left out.
    """
    groups: dict[tuple[str, Kind], list[tuple[SensorSpec, SensorResult]]] = {}
    for spec, components in results:
        for one in components:
            if one.class_id:
                groups.setdefault((one.class_id, one.kind), []).append((spec, one))
    for (class_id, kind), alike in groups.items():
        if len({spec.unit or spec.id for spec, _ in alike}) >= FEWEST:
            yield _of_class(class_id, kind, alike)


def _of_class(class_id: str, kind: Kind, alike: Sequence[tuple[SensorSpec, SensorResult]]) -> ClassInCommon:
    rows, selections = list[SessionVerdict](), dict[str, list[Selection]]()
    for spec, result in alike:
        rows += in_session(spec, result)
        selections.setdefault(rows[-1].component, []).append(result.selection)
    sizes = _sizes(alike)
    units, sessions, names = (
        tuple(dict.fromkeys(each))
        for each in zip(*((r.unit, r.session, r.term.name) for r in rows), strict=True)
    )
    found: list[TermInClass] = []
    for name in names:
        parts = [[row for row in rows if (row.term.name, row.component) == (name, one)] for one in selections]
        parts = [part for part in parts if part]
        if len(parts) > 1:
            found.append(_term(parts, sessions, sizes[name]))
        found += [_term([part], sessions, sizes[name]) for part in parts]
    level = level_among([one.spreads.p_value for one in found])
    terms = tuple(replace(one, spreads=replace(one.spreads, level=level)) for one in found)
    return ClassInCommon(class_id, kind, units, sessions, tuple(selections), terms)


def _sizes(alike: Sequence[tuple[SensorSpec, SensorResult]]) -> dict[str, tuple[float, float]]:
    """Smallest and largest spread of a term that units of the class can have, by name, SI.

    Where a study has a prior of its own, they are as much larger as that is.
    """
    found: dict[str, tuple[float, float]] = {}
    for spec, result in alike:
        own, told = spec.of(result.kind), {term.name: term.prior_sd for term in result.selection.terms}
        if own.sensor_class is None or told.keys() <= found.keys():
            continue
        for term, *ends in zip(own.library.terms, *lot_sizes(own.sensor_class, own.library), strict=True):
            if term.name in told:
                wider = told[term.name] / prior_sd(own.sensor_class, term)[0]
                low, high = (wider * float(end) for end in ends)
                found[term.name] = low / math.sqrt(2.0), high
    return found


def _term(
    parts: Sequence[Sequence[SessionVerdict]], sessions: Sequence[str], sizes: tuple[float, float]
) -> TermInClass:
    """One term of one component, or of several together."""
    term, several = parts[0][0].term, len(parts) > 1
    component = "" if several else parts[0][0].component
    blocks = [_likelihoods(part, sessions) for part in parts]
    units = [(unit, part) for part in parts for unit in dict.fromkeys(row.unit for row in part)]
    scatter = spreads(blocks, term.prior_sd)
    answers = [unit_answer([row.term.verdict for row in part if row.unit == unit]) for unit, part in units]
    return TermInClass(
        name=joined(component, term.name),
        unit=term.unit,
        printed=term.printed,
        term=term.name,
        component=component,
        size=term.prior_sd,
        spreads=scatter,
        units=tuple(f"{unit}.{part[0].component}" if several else unit for unit, part in units),
        sessions=tuple(sessions),
        value=np.concatenate([one.value for one in blocks]),
        error=np.concatenate([one.error for one in blocks]),
        need=class_need(answers, _together(blocks, scatter, sizes)),
    )


def _together(blocks: Sequence[Likelihoods], found: Spreads, sizes: tuple[float, float]) -> Pooled | None:
    """What all units say of a term, each component a lot by itself; None where too few tell of it."""
    if math.isnan(found.unit.value):
        return None
    own = found.turn_on if math.isnan(found.own.value) else found.own
    told = [of_units(one, own, found.common) for one in blocks if one.told]
    weights, estimates, variances = zip(*told, strict=True)
    return pooled(estimates, variances, sizes, weights)


def _likelihoods(rows: Sequence[SessionVerdict], sessions: Sequence[str]) -> Likelihoods:
    """Likelihoods of one term of one component, by unit and session."""
    units, _, table = arranged(rows, sessions)
    columns = tuple(dict.fromkeys(column for row in rows for column in row.pulls))
    pull = np.zeros((*table.shape[1:], len(columns)))
    for row in rows:
        leaning = [row.pulls.get(column, 0.0) for column in columns]
        pull[units.index(row.unit), sessions.index(row.session)] = leaning
    mean, sd, prior_sd = table
    return likelihoods(mean, sd, prior_sd, pull)


def pooled_inclusion(selections: Sequence[Selection]) -> Mapping[str, float]:
    """Inclusion of each term in a model that several components of one kind share, by name.

    Of the terms that are weighed in all of them; empty where one of them has so many terms that its models
    were searched for, and not all weighed.
    """
    weighed = [
        (one.models, dict(zip(one.columns, (term.name for term in one.terms), strict=True)))
        for one in selections
    ]
    if not all(isinstance(models.space, Every) for models, _ in weighed):
        return {}
    local = [[names[column] for column in models.candidates.names] for models, names in weighed]
    shared = [name for name in local[0] if all(name in others for others in local)]
    if not shared:
        return {}
    total = log_model_prior("beta-binomial", len(shared))[sizes(len(shared))]
    for (models, _), names in zip(weighed, local, strict=True):
        total += _log_evidence(models, names, shared)
    sums, whole = fold(np.exp(total - total.max()), len(shared))
    return dict(zip(shared, np.minimum(sums / whole, 1.0).tolist(), strict=True))


def pooled_by_kind(
    kinds: Sequence[Kind], selections: Sequence[Selection]
) -> Mapping[Kind, Mapping[str, float]]:
    """`pooled_inclusion` of the components of each kind, of which `kinds` are those of the selections."""
    return {
        kind: pooled_inclusion([one for one, own in zip(selections, kinds, strict=True) if own == kind])
        for kind in dict.fromkeys(kinds)
    }


def _log_evidence(models: Models, names: Sequence[str], shared: Sequence[str]) -> FloatArray:
    """Log evidence, up to a constant, of each set of the shared terms (2^q,), averaged over the others."""
    p = len(names)
    prior = np.exp(log_model_prior("beta-binomial", p))[sizes(p)]
    kept = [names.index(name) for name in shared]
    weight, weight_of_prior = _margin(models.weight, kept, p), _margin(prior, kept, p)
    return np.log(np.maximum(weight, np.finfo(float).tiny)) - np.log(weight_of_prior)


def _margin(weight: FloatArray, kept: Sequence[int], p: int) -> FloatArray:
    """Sums (2^q,) of weights (2^p,) over the candidates not kept; bit k is then candidate kept[k]."""
    # the last axis runs fastest: it is bit 0
    axes = [p - 1 - bit for bit in kept]
    summed = weight.reshape((2,) * p).sum(axis=tuple(axis for axis in range(p) if axis not in axes))
    left = sorted(axes)
    return summed.transpose([left.index(axis) for axis in reversed(axes)]).ravel()
