"""Several components in one case, as one linear problem that each of them is judged on.

The noise of a component is judged by what it said at rest. In a still nothing but the noise changes. How the
case lies there is known to no better than the noise, if at all (a free tumble has |f| = g, a hand against a
table a degree), so each still has a mean of its own in an accelerometer's rows, and takes with it what drifts
from still to still. The gyroscopes hardly depend on how the case lies: their rows have the columns of their
terms, and drift from still to still counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import (
    VANISHED,
    Factor,
    add,
    noise_scale,
    posterior,
    reorder,
    triangular,
    with_prior_rows,
)
from imubayes.inference.linear import Extra, Linear, among
from imubayes.inference.prior import ScalePrior
from imubayes.inference.robust import Distrusted
from imubayes.inference.stills import find_stills, means_of, still_rows
from imubayes.inference.summary import Rules, RunSummary, Summary, joined
from imubayes.inference.triad import Angle, Triad
from imubayes.rig.inputs import Facts, Run
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library


@dataclass(frozen=True, slots=True, eq=False)
class TriadSpec:
    """What is asked of the triad of one kind: candidate terms of a component, and their prior.

    Attributes
    ----------
    prior : of the triad's terms, in the order of `triad.triad_of(library).names`.
    sensor, rules : class whose noise prior steers the estimate of the noise, and how that is known, by run.
    reference : sd in SI of each error of the bench that is allowed for, where inputs are known.
    """

    library: Library
    prior: ScalePrior
    sensor: SensorClass | None = None
    rules: Rules | None = None
    reference: Mapping[str, float] = field(default_factory=dict)

    def rule(self, run: str) -> NoiseRule:
        """How the noise of a run is known."""
        return (self.rules or {}).get(run, NoiseRule())


@dataclass(frozen=True, slots=True, eq=False)
class CaseComponent:
    """One component of a case, or the only one that there is.

    Its name is ``ax`` ... ``gz``, or empty where it is in no case; `facts` are what its inputs have in
    common, and `parts` the indices of the summary's runs that it takes part in.
    """

    name: str
    library: Library
    facts: Facts
    parts: tuple[int, ...]

    def column(self, term: str) -> str:
        """Name that the summary has a term of the library under."""
        return f"{self.name}.{term}" if self.name else term


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Components of a case after their runs are summarized.

    Attributes
    ----------
    summary : one factor over the terms of all components, then the extras.
    rows : of each of the summary's runs.
    components : in the order of the columns.
    triads : accelerometers, and gyroscopes where there are some, at the coefficients of the full library.
    theta : (p,) coefficients of all columns, SI.
    inputs : channels (n,) of each of the summary's runs, for the figures and the search for what is missing.
    angles : how the axes of triads lie, where directions were known.
    distrusted : dwells that a component goes on without, by the names of the summary's runs.
    runs : of each of the summary's runs what its component said, where inputs were known.
    """

    summary: Summary
    rows: tuple[Linear, ...]
    components: tuple[CaseComponent, ...]
    triads: tuple[Triad, ...]
    theta: FloatArray
    inputs: tuple[dict[str, FloatArray], ...]
    angles: tuple[Angle, ...] = ()
    distrusted: tuple[Distrusted, ...] = ()
    runs: tuple[Run, ...] = ()


class Told(NamedTuple):
    """What a run, or a part of it, says: its summary, rows, channels (n,) that moved, and components."""

    run: RunSummary
    rows: Linear
    inputs: dict[str, FloatArray]
    of: Sequence[str]


def case_of(
    told: Sequence[Told],
    triads: Sequence[Triad],
    facts: Mapping[str, Facts],
    extras: tuple[Extra, ...],
    *,
    sd: FloatArray,
    theta: FloatArray | None = None,
) -> Case:
    """Case of rows over the columns of all components and the extras, which are no terms.

    `facts` are of each component; `sd` and `theta` (p,) prior sds and coefficients of all columns, SI, these
    by default the posterior mean of the rows.
    """
    components = [
        CaseComponent(name, lib, facts[name], tuple(k for k, one in enumerate(told) if name in one.of))
        for triad in triads
        for name, lib in zip(triad.components, triad.libraries, strict=True)
    ]
    first = components[0]
    summary = joined([one.run for one in told], first.library, first.facts, extras)
    theta = posterior(summary.factor, sd)[0] if theta is None else theta
    ends = np.cumsum([len(triad.theta) for triad in triads])
    return Case(
        summary=summary,
        rows=tuple(one.rows for one in told),
        components=tuple(components),
        triads=tuple(replace(t, theta=part) for t, part in zip(triads, np.split(theta, ends), strict=False)),
        theta=theta,
        inputs=tuple(one.inputs for one in told),
    )


def components_of(case: Case | None, summary: Summary) -> tuple[CaseComponent, ...]:
    """Components of a case; without one the only component, which all runs of a summary are of."""
    if case is not None:
        return case.components
    return (CaseComponent("", summary.candidates, summary.facts, tuple(range(len(summary.runs)))),)


def along(quantity: str, values: FloatArray) -> dict[str, FloatArray]:
    """Channels (n,) of vectors (n, 3) along the case axes."""
    return {f"{quantity}_{axis}": values[:, k] for k, axis in enumerate("ijk")}


class Apart(NamedTuple):
    """A component by itself, over the w columns that its own runs or its own terms move.

    Summary, prior sds (w,) and rows are of its own runs; the summary's factor is of their rows and of what
    the other runs say of these columns, which is `known`, or None where there are no others.
    """

    summary: Summary
    sd: FloatArray
    rows: tuple[Linear, ...]
    known: Factor | None


def apart(
    summary: Summary, sd: FloatArray, rows: Sequence[Linear], parts: Sequence[int], columns: Sequence[str]
) -> Apart:
    """Set a component apart: its own runs, and what all other runs say, as one factor.

    Columns that the component's own runs do not move are integrated out of the others' factor under their
    priors, so that the posterior of all that is left is what it is in the whole problem.

    Summary, rows and prior sds are of the joint problem; the component takes part in the runs of the indices
    `parts`, and its candidates `columns` are kept in any case.
    """
    own = [summary.runs[k] for k in parts]
    moved = np.max([run.reach for run in own], axis=0) > 0.0
    kept = tuple(name for name, there in zip(summary.names, moved, strict=True) if there or name in columns)
    known = _elsewhere(summary, sd, [k for k in range(len(summary.runs)) if k not in parts], kept)
    factors = [reorder(run.factor, kept) for run in own]
    where = [summary.names.index(name) for name in kept]
    runs = tuple(replace(run, factor=f, reach=run.reach[where]) for run, f in zip(own, factors, strict=True))
    whole = add(*factors, *([known] if known else []))
    return Apart(
        summary=replace(
            summary,
            factor=whole,
            runs=runs,
            reach={name: summary.reach[name] for name in kept if name in summary.reach},
            extras=tuple(extra for extra in summary.extras if extra.name in kept),
        ),
        sd=sd[where],
        rows=tuple(among(rows[k], kept) for k in parts),
        known=known,
    )


def _elsewhere(
    summary: Summary, sd: FloatArray, others: Sequence[int], kept: tuple[str, ...]
) -> Factor | None:
    """What the other runs say of the columns `kept`, the rest integrated out under their priors.

    As many rows as say something of them, beside what the elimination rounds: how well the other runs are
    fitted is no matter of the component.
    """
    if not others:
        return None
    gone = tuple(name for name in summary.names if name not in kept)
    width = dict(zip(summary.names, sd.tolist(), strict=True))
    scale = noise_scale(summary.factor, sd)
    f = reorder(add(*(summary.runs[k].factor for k in others)), (*gone, *kept))
    prior = np.array([scale / width[name] for name in gone] + [0.0] * len(kept))
    R, size = with_prior_rows(f.R, prior)[len(gone) : -1, len(gone) :], f.column_norms[len(gone) :]
    # where columns depend on each other, what is left of the fit is in every row, and not in the last alone
    U, d, _ = np.linalg.svd(R[:, :-1] / np.where(size > 0.0, size, 1.0))
    told = U[:, d > VANISHED].T @ R
    return Factor(kept, triangular((told,), len(kept) + 1), len(told))


def rows_at_rest(runs: Sequence[Run], case: Case) -> dict[str, tuple[Linear, ...]]:
    """All samples of the stills: of each component, by its name, a `Linear` for each run.

    Where inputs are known no still is looked for: all rows of a component, with its own columns. The case is
    solved, for the directions of its stills and its libraries.
    """
    found: dict[str, list[Linear]] = {one.name: [] for one in case.components}
    for run in runs:
        for name, rows in () if run.known else _of_run(run, case):
            found[name].append(rows)
    if all(run.known for run in runs):
        extras = {extra.name for extra in case.summary.extras}
        for one in case.components:
            names = [n for n in case.summary.names if n in extras or n.startswith(f"{one.name}.")]
            found[one.name] = [among(case.rows[k], names) for k in one.parts]
    return {name: tuple(rows) for name, rows in found.items()}


def _of_run(run: Run, case: Case) -> Iterator[tuple[str, Linear]]:
    """Rows of every component of one run; of gyroscopes alone, too, each section has a mean of its own."""
    if run.procedure == FREE_TUMBLE:
        stills = find_stills(run)
        force = case.triads[0].compensate(means_of(run, run.force, stills)) if run.force.size else None
    else:
        at_rest = sorted(
            (section for section in run.sections if section.angle == 0.0), key=lambda section: section.start
        )
        stills = tuple((section.start, section.stop) for section in at_rest)
        force = run.gravity * np.array([section.direction for section in at_rest])
    columns = tuple(f"still {k + 1}" for k in range(len(stills)))
    for triad in case.triads:
        X: Sequence[FloatArray] = [np.eye(len(stills))] * 3
        names = [columns] * 3
        if triad.kind == "gyroscope" and force is not None:
            X = triad.regressors(np.zeros_like(force), force)
            names = [lib.names for lib in triad.libraries]
        for k, (name, said) in enumerate(zip(triad.components, run.triad(triad.kind).T, strict=True)):
            yield name, still_rows(run, stills, name, names[k], said, X[k])
