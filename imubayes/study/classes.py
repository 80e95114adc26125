"""Units of one class in a study: what their results say together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.campaign.study import SensorResult, SensorSpec, Study, StudyResult
from imubayes.inference.levels import Likelihoods, likelihoods
from imubayes.inference.populations import FEWEST, spreads
from imubayes.inference.sessions import Parameter, level_among
from imubayes.scenes.relevance import Relevance
from imubayes.selection.class_needs import ClassInCommon, TermInClass, class_need, unit_answer
from imubayes.selection.pooled import pooled_inclusion
from imubayes.selection.verdicts import TermVerdict
from imubayes.sensors.terms import Kind
from imubayes.study.sessions import between_sessions


def of_study(
    study: Study,
    results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]],
    scenes: tuple[tuple[str, Relevance], ...],
) -> StudyResult:
    """Put the results of a study together: its components, their sessions, and the classes of its units."""
    components = tuple(one for _, found in results for one in found)
    return StudyResult(study, components, between_sessions(results), scenes, tuple(in_common(results)))


def in_common(results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]]) -> Iterator[ClassInCommon]:
    """What the units of each class have in common, where a study has four or more of one class and kind.

    Units without a class have no sizes to be held against, and are left out.
    """
    tested = [_Tested(spec, result) for spec, components in results for result in components]
    groups: dict[tuple[str, Kind], None] = dict.fromkeys(
        (one.result.class_id, one.result.kind) for one in tested if one.result.class_id
    )
    for class_id, kind in groups:
        alike = [one for one in tested if (one.result.class_id, one.result.kind) == (class_id, kind)]
        if len({one.unit for one in alike}) >= FEWEST:
            yield _of_class(class_id, kind, alike)


@dataclass(frozen=True, slots=True, eq=False)
class _Tested:
    """One component of one unit in one session."""

    spec: SensorSpec
    result: SensorResult

    @property
    def unit(self) -> str:
        """Name of the unit: that of its sensor where the study names none."""
        return self.spec.unit or self.spec.id

    @property
    def component(self) -> str:
        """Of a triad (``ax``); empty for a single component."""
        return self.result.id.removeprefix(self.spec.id).removeprefix(".")

    def said(self, term: str) -> tuple[TermVerdict, Mapping[str, float]] | None:
        """What is said of a term, and how it leans on the columns of the others."""
        for j, one in enumerate(self.result.selection.terms):
            if one.name == term:
                # errors of the bench are of one session
                apart = {self.result.selection.carriers[j], *(e.extra.name for e in self.result.extras)}
                pulls = {name: pull[j] for name, pull in self.result.pulls.items() if name not in apart}
                return one, pulls
        return None


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """One term of one component: the units' sessions."""

    term: TermVerdict
    component: str
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    found: Likelihoods
    answers: tuple[str, ...]


def _of_class(class_id: str, kind: Kind, alike: Sequence[_Tested]) -> ClassInCommon:
    components = tuple(dict.fromkeys(one.component for one in alike))
    sessions = tuple(dict.fromkeys(one.spec.session for one in alike))
    parts = [[one for one in alike if one.component == component] for component in components]
    pooled = [pooled_inclusion([one.result.selection for one in part]) for part in (*parts, alike)]
    names = dict.fromkeys(term.name for one in alike for term in one.result.selection.terms)
    found: list[TermInClass] = []
    for name in names:
        cells = [(_cells(name, part, sessions), k) for k, part in enumerate(parts)]
        there = [(one, pooled[k].get(name)) for one, k in cells if one]
        if len(there) > 1:
            found.append(_term([one for one, _ in there], pooled[-1].get(name)))
        found += [_term([one], inclusion) for one, inclusion in there]
    units = tuple(dict.fromkeys(one.unit for one in alike))
    level = level_among([one.spreads.p_value for one in found])
    terms = tuple(replace(one, spreads=replace(one.spreads, level=level)) for one in found)
    return ClassInCommon(class_id, kind, units, sessions, components, terms)


def _cells(name: str, tested: Sequence[_Tested], sessions: tuple[str, ...]) -> _Cells | None:
    """Arrange what is said of a term by unit and session; None where the component has no such term."""
    told = [(one, said) for one in tested if (said := one.said(name))]
    if not told:
        return None
    units = tuple(dict.fromkeys(one.unit for one, _ in told))
    columns = tuple(dict.fromkeys(column for _, (_, pulls) in told for column in pulls))
    table = np.full((3, len(units), len(sessions)), math.nan)
    pull = np.zeros((len(units), len(sessions), len(columns)))
    verdicts: dict[str, list[str]] = {unit: [] for unit in units}
    for one, (verdict, pulls) in told:
        place = units.index(one.unit), sessions.index(one.spec.session)
        table[:, *place] = verdict.full_mean, verdict.full_sd, verdict.prior_sd
        pull[place] = [pulls.get(column, 0.0) for column in columns]
        verdicts[one.unit].append(verdict.verdict)
    answers = tuple(unit_answer(said) for said in verdicts.values())
    return _Cells(
        told[0][1][0],
        told[0][0].component,
        units,
        sessions,
        likelihoods(table[0], table[1], table[2], pull),
        answers,
    )


def _term(cells: Sequence[_Cells], pooled: float | None) -> TermInClass:
    """One term of one component, or of several together."""
    first, several = cells[0].term, len(cells) > 1
    component = "" if several else cells[0].component
    name = f"{component}.{first.name}" if component else first.name
    return TermInClass(
        parameter=Parameter(name, first.unit, first.printed),
        term=first.name,
        component=component,
        size=first.prior_sd,
        spreads=spreads([one.found for one in cells], first.prior_sd),
        units=tuple(f"{u}.{one.component}" if several else u for one in cells for u in one.units),
        sessions=cells[0].sessions,
        value=np.concatenate([one.found.value for one in cells]),
        error=np.concatenate([one.found.error for one in cells]),
        need=class_need([answer for one in cells for answer in one.answers], pooled),
    )
