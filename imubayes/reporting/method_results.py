"""What stands beside the posterior over the models, as it is published."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from imubayes.reporting.result.entries import (
    Criterion,
    Dependence,
    Disagreement,
    Misfit,
    Reduced,
    Sensitivity,
    SparseSupport,
    Unasked,
    Votes,
)
from imubayes.reporting.result.values import published
from imubayes.reporting.rows import own_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from imubayes.campaign.study import SensorResult
    from imubayes.selection.panel import Panel

_NOTHING: dict[str, Any] = {
    "criteria": {},
    "sindy": {},
    "sensitivity": None,
    "votes": None,
    "reduced": None,
    "unasked": (),
}


def opinions(sensor: SensorResult) -> dict[str, Any]:
    """Criteria, sparse regressions, other priors, votes, reduced model, misfit and groups of a component.

    Terms have the component's own names. Where no other method was run, the first two are empty and the
    others None.
    """
    groups = [{"terms": terms, "any_inclusion": chance} for terms, chance in sensor.selection.groups]
    told = _of_panel(sensor.panel, own_names(sensor.selection)) if sensor.panel else _NOTHING
    return {**told, "misfit": _misfit(sensor), "groups": groups}


def _of_panel(panel: Panel, own: Mapping[str, str]) -> dict[str, Any]:
    def named(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(own.get(name, name) for name in names)

    def by_term(names: Iterable[str], values: Iterable[Any]) -> dict[str, Any]:
        return dict(zip(named(names), values, strict=True))

    other, votes, small = panel.sensitivity, panel.votes, panel.reduced
    return {
        "criteria": {
            one.name: published(
                Criterion,
                one,
                model=named(one.model),
                inclusion=by_term(one.inclusion, one.inclusion.values()),
            )
            for one in panel.criteria
        },
        "sindy": {
            one.optimizer: published(
                SparseSupport,
                one,
                model=named(one.model),
                inclusion=by_term(one.inclusion, one.inclusion.values()),
                strength=one.strength[one.chosen],
                stable=named(one.stable),
            )
            for one in panel.sindy
        },
        "sensitivity": published(
            Sensitivity,
            other,
            inclusion=by_term(other.names, other.inclusion.T),
            g_prior=by_term(other.names, other.g_prior),
            left_out=named(other.left_out),
            swing=named(other.swing),
        ),
        "votes": published(
            Votes,
            votes,
            terms=named(votes.terms),
            strength=dict(zip(votes.methods, votes.strength, strict=True)),
            keeps=dict(zip(votes.methods, votes.keeps, strict=True)),
            disagreements=[
                published(Disagreement, one, term=own.get(one.term, one.term)) for one in votes.disagreements
            ],
        ),
        "reduced": small
        and published(Reduced, small, path=[{"terms": terms, "lost": lost} for terms, lost in small.path]),
        "unasked": [published(Unasked, one) for one in panel.unasked],
    }


def _misfit(sensor: SensorResult) -> Misfit | None:
    found = sensor.misfit
    return found and published(
        Misfit,
        found,
        found=[published(Dependence, one) for one in found.found],
        dependences=[published(Dependence, one) for one in found.dependences],
    )
