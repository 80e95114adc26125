"""Recorded units, session by session: what changes from one to the next, and what units have in common.

Posteriors of two sessions share their prior, and are drawn to zero by it together. What a session says by
itself is its likelihood, which is the Gaussian posterior divided by the prior; pulls, scatter and the sd
between sessions are those of the likelihoods. Of unit u in session s::

    y_us = mu_u + delta_us + e_us,    delta_us ~ N(0, tau^2),    e_us ~ N(0, sd_us^2)

with mu_u integrated out flat and tau alike for all units. Whatever changes from one power-up to the next is
in tau: the turn-on of the sensor, and the temperature where nothing holds it.

Where a test sees a term only beside others, these move it alike in all sessions of a unit, and count for
nothing against a change (see `population.levels`): which of them has changed, the scatter does not say. What
moves all units alike, as temperature does, is seen as often as there are sessions, not units: see
`Repeatability.shared`.

Units of a class may have a term or not. Components x, y, z of a triad have coefficients of their own, but all
have the term or none. Of terms that not all of them have (accelerometers without a reference lack some
misalignments) nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult, SensorSpec
from imubayes.errors import StudyError
from imubayes.population.levels import (
    Likelihoods,
    between_sd,
    likelihoods,
    of_units,
    scatter_p,
    without_prior,
)
from imubayes.population.needs import Need, class_need, unit_answer
from imubayes.population.pooled import ALL, Pooled, pooled
from imubayes.population.spreads import FEWEST, SUSPECT, Spreads, lot_spreads, spreads
from imubayes.selection.decision import Selection
from imubayes.selection.verdicts import TermVerdict
from imubayes.sensors.terms import Kind

Tested = Sequence[tuple[SensorSpec, Sequence[SensorResult]]]
"""Each sensor of a study with the results of its components."""


TESTED = 1e-6
"""Share above which a session excited a parameter at all."""


@dataclass(frozen=True, slots=True)
class SessionVerdict:
    """What one session says of one term of a unit; one without a name has that of its sensor.

    `component` is that of a triad (``ax``), empty for a single one. Sessions are compared by the full-library
    posterior of the `term`. `pulls` say how it leans on the columns of others, by name: covariance over the
    prior's sd of each, SI.
    """

    unit: str
    session: str
    component: str
    term: TermVerdict
    pulls: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Repeatability:
    """One parameter of u units that were tested in several of s sessions.

    Attributes
    ----------
    parameter : term, and component of a triad where there is one (``ax.b0``); ``b0`` for all axes together.
    unit, printed : SI unit, and the one people use.
    mean, sd : (u, s) posterior of the full library, SI; NaN where a unit lacks a session.
    pulls : (u, s, s) difference of two sessions over the sd of their difference, without the prior; NaN where
        a session lacks or cannot tell.
    p_value : probability of so large a scatter if nothing but the posteriors' sds separated the sessions; NaN
        where the sessions cannot tell.
    between : (mean, q05, q95) of the sd between sessions, SI, from its posterior, as if units moved
        independently; NaN as above.
    exceeds : whether the scatter exceeds what the posteriors allow: `p_value` is below `level`.
    shared : share of the scatter about the units' means that all units have in common, of all axes together
        axis by axis: one over their number by chance, 1 for a cause that moves them alike, such as
        temperature, of which `between` then knows less than it says; NaN with fewer than two complete units.
    level : probability of a false alarm of this test: `SUSPECT` over the number of parameters tested.
    """

    parameter: str
    unit: str
    printed: str
    units: tuple[str, ...]
    sessions: tuple[str, ...]
    mean: FloatArray
    sd: FloatArray
    pulls: FloatArray
    p_value: float
    between: tuple[float, float, float]
    exceeds: bool = False
    shared: float = math.nan
    level: float = SUSPECT


def in_session(spec: SensorSpec, result: SensorResult) -> Iterator[SessionVerdict]:
    """What one component of a unit says of every term in one session."""
    for j, term in enumerate(result.selection.terms):
        # errors of the bench are of one session
        apart = {result.selection.carriers[j], *(error.extra.name for error in result.extras)}
        pulls = {name: pull[j] for name, pull in result.pulls.items() if name not in apart}
        component = result.id.removeprefix(spec.id).removeprefix(".")
        yield SessionVerdict(spec.unit or spec.id, spec.session, component, term, pulls)


def between_sessions(results: Tested) -> tuple[Repeatability, ...]:
    """Compare the units of a study that were tested in several sessions."""
    named = [(spec, result) for spec, sensors in results if spec.unit for result in sensors]
    return repeatability(row for spec, result in named for row in in_session(spec, result))


def arranged(
    rows: Sequence[SessionVerdict], sessions: Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[str, ...], FloatArray]:
    """Names of units and sessions, and mean, sd and prior sd (3, u, s), SI; NaN where a unit lacks a session.

    The rows are of one term and component; of several components each is a unit (``A.ax``). `sessions` are
    those to arrange by, if not those of the rows. It is a `StudyError` if a session of a unit is there twice.
    """
    cells: dict[tuple[str, str], SessionVerdict] = {}
    for row, cell in zip(rows, _cells(rows), strict=True):
        if cell in cells:
            raise StudyError(
                f"session '{row.session}' of unit '{row.unit}' is there twice: expected one sensor for each"
                " session of a unit; give them different sessions, or put their runs into one sensor"
            )
        cells[cell] = row
    units, own = (tuple(dict.fromkeys(cell[k] for cell in cells)) for k in (0, 1))
    sessions = tuple(sessions) or own
    table = np.full((3, len(units), len(sessions)), math.nan)
    for (unit, session), row in cells.items():
        moments = row.term.full_mean, row.term.full_sd, row.term.prior_sd
        table[:, units.index(unit), sessions.index(session)] = moments
    return units, sessions, table


def _cells(rows: Sequence[SessionVerdict]) -> list[tuple[str, str]]:
    """Unit and session of each row; of several components each is a unit."""
    several = len({row.component for row in rows}) > 1
    return [(joined(row.unit, row.component) if several else row.unit, row.session) for row in rows]


def _parameters(rows: Sequence[SessionVerdict]) -> Iterator[tuple[str, list[SessionVerdict]]]:
    """Rows of each parameter: of a term for all axes of a triad together, then for each of them."""
    for term in dict.fromkeys(row.term.name for row in rows):
        alike = [row for row in rows if row.term.name == term]
        each = _by_component(alike)
        if len(each) > 1:
            yield term, alike
        yield from ((joined(component, term), group) for component, group in each.items())


def _by_component(rows: Iterable[SessionVerdict]) -> dict[str, list[SessionVerdict]]:
    """Rows of each component, in the order in which they come."""
    groups: dict[str, list[SessionVerdict]] = {}
    for row in rows:
        groups.setdefault(row.component, []).append(row)
    return groups


def repeatability(verdicts: Iterable[SessionVerdict]) -> tuple[Repeatability, ...]:
    """Compare the sessions of every parameter that a session excited.

    In the order of the verdicts: each term for all axes of a triad together, then for each of them. Terms of
    which the data say too little are there, without a p-value.
    """
    tested = [
        verdict for verdict in verdicts if 1.0 - (verdict.term.full_sd / verdict.term.prior_sd) ** 2 > TESTED
    ]
    parameters = [_compared(name, group) for name, group in _parameters(tested)]
    repeated = [parameter for parameter in parameters if np.any(np.isfinite(parameter.mean).sum(axis=1) >= 2)]
    level = level_among([parameter.p_value for parameter in repeated])
    return tuple(replace(parameter, level=level, exceeds=parameter.p_value < level) for parameter in repeated)


def level_among(p_values: Iterable[float]) -> float:
    """Level at which tests have one probability `SUSPECT` of a false alarm together; NaN is no test.

    Examples
    --------
    >>> level_among([0.2, 0.001, math.nan])
    0.005
    """
    return SUSPECT / max(sum(not math.isnan(p) for p in p_values), 1)


def _shared(values: Sequence[FloatArray]) -> float:
    """Share of the scatter that is the mean over the units, of those with all sessions, axis by axis."""
    whole = [value[np.isfinite(value).all(axis=1)] for value in values]
    left = [value - value.mean(axis=1, keepdims=True) for value in whole if len(value) > 1]
    total = sum(float((scatter**2).sum()) for scatter in left)
    if total == 0.0:
        return math.nan
    return sum(len(scatter) * float((scatter.mean(axis=0) ** 2).sum()) for scatter in left) / total


def _compared(name: str, group: Sequence[SessionVerdict]) -> Repeatability:
    """Pulls, scatter and sd between sessions of one parameter."""
    units, sessions, (mean, sd, prior), likelihood = _told(group)
    value, rows = likelihood.value, np.isfinite(likelihood.value).sum(axis=1) >= 2
    apart = np.linalg.norm(likelihood.alias[:, :, None] - likelihood.alias[:, None], axis=-1)
    error = np.sqrt(likelihood.noise[:, :, None] ** 2 + likelihood.noise[:, None] ** 2 + apart**2)
    nothing = (math.nan, math.nan, math.nan)
    # the axes of a case share their sessions, but not what these do to them
    axes = tuple(dict.fromkeys(row.component for row in group))
    ends = [unit.rpartition(".")[2] for unit in units]
    parts = [[end == axis for end in ends] for axis in axes] if len(axes) > 1 else [[True] * len(units)]
    return Repeatability(
        parameter=name,
        unit=group[0].term.unit,
        printed=group[0].term.printed,
        units=units,
        sessions=sessions,
        mean=mean,
        sd=sd,
        pulls=(value[:, :, None] - value[:, None, :]) / error,
        p_value=scatter_p([likelihood]),
        between=between_sd(likelihood, float(np.nanmedian(prior))) if rows.any() else nothing,
        shared=_shared([value[part] for part in parts]),
    )


def _told(
    rows: Sequence[SessionVerdict], sessions: Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[str, ...], FloatArray, Likelihoods]:
    """Rows as they are `arranged`, and what they say without the prior, leaning on each other's columns."""
    units, sessions, table = arranged(rows, sessions)
    columns = tuple(dict.fromkeys(column for row in rows for column in row.pulls))
    pull = np.zeros((*table.shape[1:], len(columns)))
    for row, (unit, session) in zip(rows, _cells(rows), strict=True):
        pull[units.index(unit), sessions.index(session)] = [row.pulls.get(column, 0.0) for column in columns]
    mean, sd, prior = table
    return units, sessions, table, likelihoods(mean, sd, prior, pull)


def joined(first: str, second: str) -> str:
    """Names that a dot joins, where both are there: ``ax.b0``."""
    return ".".join(part for part in (first, second) if part)


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
        for sensor in components:
            if sensor.class_id:
                groups.setdefault((sensor.class_id, sensor.kind), []).append((spec, sensor))
    for (class_id, kind), alike in groups.items():
        if len({spec.unit or spec.id for spec, _ in alike}) >= FEWEST:
            yield _of_class(class_id, kind, alike)


def _of_class(class_id: str, kind: Kind, alike: Sequence[tuple[SensorSpec, SensorResult]]) -> ClassInCommon:
    rows, sizes = list[SessionVerdict](), dict[str, tuple[float, float]]()
    for spec, result in alike:
        rows += in_session(spec, result)
        sizes |= _sizes(spec.of(kind), result.selection.terms)
    components = tuple(dict.fromkeys(row.component for row in rows))
    units, sessions = (
        tuple(dict.fromkeys(each)) for each in zip(*((r.unit, r.session) for r in rows), strict=True)
    )
    every = [_term(name, group, sessions, sizes[group[0].term.name]) for name, group in _parameters(rows)]
    level = level_among([term.spreads.p_value for term in every])
    terms = tuple(replace(term, spreads=replace(term.spreads, level=level)) for term in every)
    return ClassInCommon(class_id, kind, units, sessions, components, terms)


def _sizes(spec: SensorSpec, terms: Sequence[TermVerdict]) -> dict[str, tuple[float, float]]:
    """Smallest and largest spread of each of the terms, by its prior in the study; none without a class."""
    priors = {term.name: term.prior_sd for term in terms}
    ends = lot_spreads(spec.sensor_class, spec.library, priors) if spec.sensor_class else {}
    # of a triad not every component has all terms of the library
    return {name: sizes for name, sizes in ends.items() if name in priors}


def _term(
    name: str, rows: Sequence[SessionVerdict], sessions: Sequence[str], sizes: tuple[float, float]
) -> TermInClass:
    term, parts = rows[0].term, list(_by_component(rows).values())
    several = len(parts) > 1
    blocks = [_told(part, sessions)[3] for part in parts]
    units = [(unit, part) for part in parts for unit in dict.fromkeys(row.unit for row in part)]
    scatter = spreads(blocks, term.prior_sd)
    answers = [unit_answer([row.term.verdict for row in part if row.unit == unit]) for unit, part in units]
    return TermInClass(
        name=name,
        unit=term.unit,
        printed=term.printed,
        term=term.name,
        component="" if several else rows[0].component,
        class_size=term.prior_sd,
        spreads=scatter,
        units=tuple(f"{unit}.{part[0].component}" if several else unit for unit, part in units),
        sessions=tuple(sessions),
        value=np.concatenate([likelihood.value for likelihood in blocks]),
        error=np.concatenate([likelihood.error for likelihood in blocks]),
        need=class_need(answers, _together(blocks, scatter, sizes)),
    )


def _together(
    blocks: Sequence[Likelihoods], population: Spreads, sizes: tuple[float, float]
) -> Pooled | None:
    """What all units say of a term, each component a lot by itself; None where too few tell of it."""
    if math.isnan(population.unit_to_unit.value):
        return None
    own = population.turn_on if math.isnan(population.turn_on_own.value) else population.turn_on_own
    told = [of_units(likelihood, own, population.turn_on_common) for likelihood in blocks if likelihood.told]
    weights, estimates, variances = zip(*told, strict=True)
    return pooled(estimates, variances, sizes, weights)


def pooled_by_kind(
    spec: SensorSpec, kinds: Sequence[Kind], selections: Sequence[Selection]
) -> Mapping[Kind, Mapping[str, float]]:
    """Probability of each term that all components of a kind have it, where none would be the other case.

    Of the terms that all of them have, by name; the components are those of one case, `kinds` says which.
    """
    inclusions: dict[Kind, Mapping[str, float]] = {}
    for kind in dict.fromkeys(kinds):
        own = [selection.terms for selection, its in zip(selections, kinds, strict=True) if its == kind]
        sizes, tables = _sizes(spec.of(kind), own[0]), [{term.name: term for term in terms} for terms in own]
        inclusion: dict[str, float] = {}
        for name in (name for name in sizes if all(name in table for table in tables)):
            terms = [table[name] for table in tables]
            value, error = without_prior(*np.array([(t.full_mean, t.full_sd, t.prior_sd) for t in terms]).T)
            told = np.isfinite(value)
            lots = list(value[told][:, None]), list(error[told][:, None] ** 2)
            inclusion[name] = pooled(*lots, sizes[name], shares=ALL).inclusion if told.any() else 0.5
        inclusions[kind] = inclusion
    return inclusions
