"""A decision in the report's form, of a method that has models and coefficients but not every submodel."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import BoolArray
from imubayes.inference.observability import Observability, carried
from imubayes.selection.decision import WIDTHS, Selection
from imubayes.selection.mixture import Components, limit, probability_within, quantiles
from imubayes.selection.model_prior import hierarchy
from imubayes.selection.models import Models
from imubayes.selection.verdicts import (
    TENTH,
    Costs,
    Evidence,
    TermVerdict,
    decide,
    median_model,
    untested,
    with_tied,
)
from imubayes.sensors.equations.standards import symbols
from imubayes.sensors.terms import Library, Term

Moments = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What a decision is about, besides the models.

    Attributes
    ----------
    library : candidate terms.
    sd : prior sds by name, SI.
    reach : largest size of each column, by name, SI.
    seen : what the test can tell.
    costs : of wrong choices.
    full : mean and sd of each term under the full library; a term that it lacks has its prior's.
    doubt : range of the inclusion of a term that the test sees only in combination with others, from what
        the method gave.
    why : how the method came to it: ends every reason.
    """

    library: Library
    sd: Mapping[str, float]
    reach: Mapping[str, float]
    seen: Observability
    costs: Costs
    full: Mapping[str, Moments]
    doubt: Callable[[float], tuple[float, float]]
    why: str


def decided(basis: Basis, models: Models) -> Selection:
    """Give a verdict on every term of the library."""
    inclusion = dict(zip(models.names, models.inclusion.tolist(), strict=True))
    by_candidate = np.array([inclusion[name] for name in models.candidates.names])
    # given how many others are in, every size of the model being as likely as another
    alone = float(by_candidate.sum() + 1.0) / (len(by_candidate) + 2.0)
    terms = tuple(
        _tested(basis, models, term, inclusion[term.name])
        if term.name in models.candidates.names
        else _untested(basis, term, alone)
        for term in basis.library.terms
    )
    terms = with_tied(terms, basis.library.tied)
    carriers = dict(zip(basis.library.names, basis.library.carriers, strict=True))
    return Selection(
        terms=terms,
        columns=basis.library.names,
        model=median_model(terms, basis.costs),
        log_evidence=models.log_evidence,
        models=models,
        by_width=tuple((width, by_candidate) for width in WIDTHS),
        observability=carried(basis.seen, carriers),
        free=np.array([term.full_mean for term in terms]),
        ties=basis.library.tied,
        costs=basis.costs,
    )


def allowed(inside: BoolArray, names: Sequence[str], hierarchical: bool) -> BoolArray:
    """Which models (m, p) hold what each of their terms calls for: (m,); all if not `hierarchical`."""
    needs = hierarchy(names) if hierarchical else ()
    column = {name: j for j, name in enumerate(names)}
    sound = np.ones(len(inside), dtype=bool)
    for child, parent in needs:
        if child in column and parent in column:
            sound &= ~inside[:, column[child]] | inside[:, column[parent]]
    return sound


def _tested(basis: Basis, models: Models, term: Term, inclusion: float) -> TermVerdict:
    parts, column = models.components, models.candidates.columns.index(term.name)
    mean, sd = (float(moment[models.names.index(term.name)]) for moment in (models.mean, models.sd))
    partners = tuple(n for n in basis.seen.partners(term.name) if n in models.candidates.names)
    spread = basis.doubt(inclusion) if partners else (inclusion, inclusion)
    evidence = Evidence(
        inclusion=inclusion,
        range=spread,
        small=probability_within(parts, column, TENTH * basis.sd[term.name]),
        ratio=float(basis.seen.ratio[basis.seen.names.index(term.name)]),
        pull=abs(mean) / sd if sd > 0.0 else 0.0,
        partners=partners,
        remedy=next((group.remedy for group in basis.seen.groups if term.name in group.terms), ""),
    )
    verdict, reason = decide(evidence, basis.costs)
    tails = quantiles(parts, column, (0.05, 0.95))
    return _verdict(
        basis, term, (mean, sd), evidence, ((tails[0], tails[1]), _limit(basis, parts, column, term)),
        (verdict, f"{reason}; {basis.why}"),
    )  # fmt: skip


def _limit(basis: Basis, parts: Components, column: int, term: Term) -> float:
    """Size that it stays below with 95 % where it is in the model; without one, under the full library."""
    found = limit(parts, column)
    mean, sd = basis.full.get(term.name, (0.0, basis.sd[term.name]))
    return found if math.isfinite(found) else abs(mean) + 1.96 * sd


def _untested(basis: Basis, term: Term, inclusion: float) -> TermVerdict:
    """What the prior says of a term that was never excited."""
    sd = basis.sd[term.name]
    none = Evidence(inclusion, (inclusion, inclusion), 0.0, 1.0, 0.0, (), "")
    return _verdict(
        basis, term, (0.0, sd), none, ((-1.645 * sd, 1.645 * sd), 1.96 * sd), untested(term)
    )  # fmt: skip


def _verdict(
    basis: Basis,
    term: Term,
    moments: Moments,
    e: Evidence,
    ends: tuple[tuple[float, float], float],
    words: tuple[str, str],
) -> TermVerdict:
    full_mean, full_sd = basis.full.get(term.name, (0.0, basis.sd[term.name]))
    return TermVerdict(
        name=term.name,
        symbol=symbols(basis.library)[term.name],
        unit=term.unit,
        printed=term.printed,
        group=term.group,
        mean=moments[0],
        sd=moments[1],
        q05=ends[0][0],
        q95=ends[0][1],
        full_mean=full_mean,
        full_sd=full_sd,
        prior_sd=basis.sd[term.name],
        inclusion=e.inclusion,
        inclusion_range=e.range,
        limit95=ends[1],
        effect=abs(moments[0]) * basis.reach[term.name],
        verdict=words[0],
        reason=words[1],
        confounded_with=e.partners,
    )
