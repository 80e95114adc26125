"""What sessions of a unit, and units of a class, have in common, as it is published."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imubayes.reporting.result.entries import Population, PopulationTerm, Sessions
from imubayes.reporting.result.values import published

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.population.classes import ClassInCommon, TermInClass
    from imubayes.population.sessions import Repeatability
    from imubayes.reporting.result.entries import Spread


def published_sessions(found: Repeatability) -> Sessions:
    """One parameter in several sessions; null where a unit lacks a session."""
    between = dict(zip(("mean", "q05", "q95"), found.between, strict=True))
    return published(Sessions, found, printed_unit=found.printed, between=between)


def published_population(found: ClassInCommon) -> Population:
    """One class and kind."""
    return published(Population, found, terms=tuple(map(_term, found.terms)), **{"class": found.class_id})


def _term(term: TermInClass) -> PopulationTerm:
    found, need = term.spreads, term.need
    return published(
        PopulationTerm,
        found,
        parameter=term.parameter.name,
        term=term.term,
        component=term.component,
        unit=term.parameter.unit,
        printed_unit=term.parameter.printed,
        class_size=term.size,
        mean={"sd": found.mean_sd, **_spread(found.mean)},
        unit_to_unit=_spread(found.unit),
        turn_on=_spread(found.turn_on),
        turn_on_own=_spread(found.own),
        turn_on_common=_spread(found.common),
        common_share=_spread(found.common_share),
        next_unit=_spread(found.next_unit),
        session_shift={"sessions": term.sessions, "mean": found.shift, "sd": found.shift_sd},
        measurement={"noise": found.noise, "alias": found.alias},
        verdict=need.verdict,
        reason=need.reason,
        answers=need.answers,
        needed={"share": need.share.value, "q05": need.share.low, "q95": need.share.high},
        pooled_inclusion=need.pooled,
    )


def _spread(found: Share) -> Spread:
    return {"median": found.value, "q05": found.low, "q95": found.high}
