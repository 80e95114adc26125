"""Recorded units of one class, and components of one case: what they and their sessions say together.

Units of a class may have a term or not. Components x, y, z of a triad have coefficients of their own, but all
have the term or none. Of terms that not all of them have (accelerometers without a reference lack some
misalignments) nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult, SensorSpec
from imubayes.population.levels import Likelihoods, likelihoods, of_units, without_prior
from imubayes.population.needs import Need, class_need, unit_answer
from imubayes.population.pooled import ALL, Pooled, pooled
from imubayes.population.sessions import SessionVerdict, arranged, in_session, joined, level_among
from imubayes.population.spreads import FEWEST, Spreads, lot_sizes, spreads
from imubayes.selection.decision import Selection
from imubayes.selection.verdicts import TermVerdict
from imubayes.sensors.catalogue import prior_sd
from imubayes.sensors.terms import Kind

Tested = Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
"""Each sensor of a study with the results of its components."""


@dataclass(frozen=True, slots=True, eq=False)
class TermInClass:
    """One term of u units of a class in s sessions.

    Attributes
    ----------
    name : with the component of a triad (``ax.b0``) or for all of its axes together (``b0``).
    unit, printed : SI unit, and the one people use.
    term, component : the two parts of the name; the component is empty for all together.
    class_size : that the class gives the coefficient, SI: the prior's sd.
    spreads : mean and spreads of the population.
    units, sessions : names; of all axes together units have that of their component.
    value, error : (u, s) each session's estimate without the prior, and its sd, SI; NaN where a unit lacks a
        session or a session cannot tell.
    need : whether the class needs the term.
    """

    name: str
    unit: str
    printed: str
    term: str
    component: str
    class_size: float
    spreads: Spreads
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    value: FloatArray
    error: FloatArray
    need: Need

    @property
    def told(self) -> bool:
        """Whether enough units tell of the term for the population to be known."""
        return not math.isnan(self.spreads.unit_to_unit.value)


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
    rows, sizes = list[SessionVerdict](), dict[str, tuple[float, float]]()
    for spec, result in alike:
        rows += in_session(spec, result)
        sizes |= _sizes(spec.of(kind), result.selection.terms)
    components = tuple(dict.fromkeys(row.component for row in rows))
    units, sessions, names = (
        tuple(dict.fromkeys(each))
        for each in zip(*((r.unit, r.session, r.term.name) for r in rows), strict=True)
    )
    found: list[TermInClass] = []
    for name in names:
        parts = [[row for row in rows if (row.term.name, row.component) == (name, one)] for one in components]
        parts = [part for part in parts if part]
        if len(parts) > 1:
            found.append(_term(parts, sessions, sizes[name]))
        found += [_term([part], sessions, sizes[name]) for part in parts]
    level = level_among([one.spreads.p_value for one in found])
    terms = tuple(replace(one, spreads=replace(one.spreads, level=level)) for one in found)
    return ClassInCommon(class_id, kind, units, sessions, components, terms)


def _sizes(spec: SensorSpec, terms: Sequence[TermVerdict]) -> dict[str, tuple[float, float]]:
    """Smallest and largest spread of a term that units of the class can have, by name, SI.

    Where a study has a prior of its own, they are as much larger as that is.
    """
    told, entry = {term.name: term.prior_sd for term in terms}, spec.sensor_class
    if entry is None:
        return {}
    found: dict[str, tuple[float, float]] = {}
    for term, low, high in zip(spec.library.terms, *lot_sizes(entry, spec.library), strict=True):
        if term.name in told:
            wider = told[term.name] / prior_sd(entry, term)[0]
            found[term.name] = wider * float(low) / math.sqrt(2.0), wider * float(high)
    return found


def _term(
    parts: Sequence[Sequence[SessionVerdict]], sessions: Sequence[str], sizes: tuple[float, float]
) -> TermInClass:
    """One term of one component, or of several together."""
    term, several = parts[0][0].term, len(parts) > 1
    component = "" if several else parts[0][0].component
    blocks: list[Likelihoods] = []
    for rows in parts:
        names, _, table = arranged(rows, sessions)
        columns = tuple(dict.fromkeys(column for row in rows for column in row.pulls))
        pull = np.zeros((*table.shape[1:], len(columns)))
        for row in rows:
            leaning = [row.pulls.get(column, 0.0) for column in columns]
            pull[names.index(row.unit), sessions.index(row.session)] = leaning
        mean, sd, prior = table
        blocks.append(likelihoods(mean, sd, prior, pull))
    units = [(unit, part) for part in parts for unit in dict.fromkeys(row.unit for row in part)]
    scatter = spreads(blocks, term.prior_sd)
    answers = [unit_answer([row.term.verdict for row in part if row.unit == unit]) for unit, part in units]
    return TermInClass(
        name=joined(component, term.name),
        unit=term.unit,
        printed=term.printed,
        term=term.name,
        component=component,
        class_size=term.prior_sd,
        spreads=scatter,
        units=tuple(f"{unit}.{part[0].component}" if several else unit for unit, part in units),
        sessions=tuple(sessions),
        value=np.concatenate([one.value for one in blocks]),
        error=np.concatenate([one.error for one in blocks]),
        need=class_need(answers, _together(blocks, scatter, sizes)),
    )


def _together(blocks: Sequence[Likelihoods], found: Spreads, sizes: tuple[float, float]) -> Pooled | None:
    """What all units say of a term, each component a lot by itself; None where too few tell of it."""
    if math.isnan(found.unit_to_unit.value):
        return None
    own = found.turn_on if math.isnan(found.turn_on_own.value) else found.turn_on_own
    told = [of_units(one, own, found.turn_on_common) for one in blocks if one.told]
    weights, estimates, variances = zip(*told, strict=True)
    return pooled(estimates, variances, sizes, weights)


def pooled_by_kind(
    spec: SensorSpec, kinds: Sequence[Kind], selections: Sequence[Selection]
) -> Mapping[Kind, Mapping[str, float]]:
    """Probability of each term that all components of a kind have it, where none would be the other case.

    Of the terms that all of them have, by name; the components are those of one case, `kinds` says which.
    """
    found: dict[Kind, Mapping[str, float]] = {}
    for kind in dict.fromkeys(kinds):
        own = [one.terms for one, its in zip(selections, kinds, strict=True) if its == kind]
        sizes, tables = _sizes(spec.of(kind), own[0]), [{term.name: term for term in terms} for terms in own]
        shared = [name for name in sizes if all(name in table for table in tables)]
        found[kind] = {name: _of_all([table[name] for table in tables], sizes[name]) for name in shared}
    return found


def _of_all(terms: Sequence[TermVerdict], sizes: tuple[float, float]) -> float:
    posterior = np.array([(term.full_mean, term.full_sd, term.prior_sd) for term in terms])
    value, error = without_prior(*posterior.T)
    told = np.isfinite(value)
    lots = list(value[told][:, None]), list(error[told][:, None] ** 2)
    return pooled(*lots, sizes, shares=ALL).inclusion if told.any() else 0.5
