"""Plain values for ``result.json`` of what stands beside the posterior over the models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from imubayes.reporting.rows import own_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from imubayes.campaign.study import SensorResult
    from imubayes.inference.misfit import Dependence, Misfit
    from imubayes.selection.criteria import Criterion
    from imubayes.selection.panel import Panel
    from imubayes.selection.reduced import Reduced
    from imubayes.selection.sensitivity import Sensitivity
    from imubayes.selection.sindy import Sparse
    from imubayes.selection.votes import Votes


def methods_block(sensor: SensorResult) -> dict[str, Any]:
    """Criteria, sparse regressions, other priors, votes, reduced model, misfit and groups of a component.

    Terms have the component's own names. Where no other method was run, the first two are empty and the
    others None.
    """
    own = own_names(sensor.selection)
    return {
        **(_of_panel(sensor.panel, own) if sensor.panel else _NOTHING),
        "misfit": _misfit(sensor.misfit) if sensor.misfit else None,
        "groups": [
            {"terms": list(terms), "any_inclusion": chance} for terms, chance in sensor.selection.groups
        ],
    }


_NOTHING: dict[str, Any] = {
    "criteria": {},
    "sindy": {},
    "sensitivity": None,
    "votes": None,
    "reduced": None,
    "unasked": [],
}


def _of_panel(panel: Panel, own: Mapping[str, str]) -> dict[str, Any]:
    return {
        "criteria": {one.name: _criterion(one, own) for one in panel.criteria},
        "sindy": {one.optimizer: _sparse(one, own) for one in panel.sindy},
        "sensitivity": _sensitivity(panel.sensitivity, own),
        "votes": _votes(panel.votes, own),
        "reduced": _reduced(panel.reduced) if panel.reduced else None,
        "unasked": [{"method": one.method, "reason": one.reason} for one in panel.unasked],
    }


def _named(names: Iterable[str], own: Mapping[str, str]) -> list[str]:
    return [own.get(name, name) for name in names]


def _inclusion(inclusion: Mapping[str, float], own: Mapping[str, str]) -> dict[str, float]:
    return {own.get(name, name): value for name, value in inclusion.items()}


def _criterion(one: Criterion, own: Mapping[str, str]) -> dict[str, Any]:
    return {
        "model": _named(one.model, own),
        "value": one.value,
        "lead": one.lead,
        "inclusion": _inclusion(one.inclusion, own),
        "samples": one.samples,
        "compared": one.compared,
        "exact": bool(one.exact),
        "pareto_k": one.pareto_k,
        "note": one.note,
    }


def _sparse(one: Sparse, own: Mapping[str, str]) -> dict[str, Any]:
    return {
        "model": _named(one.model, own),
        "inclusion": _inclusion(one.inclusion, own),
        "strength": one.strength[one.chosen],
        "stable": _named(one.stable, own),
        "cut": one.cut,
        "false_bound": one.false_bound,
    }


def _sensitivity(found: Sensitivity, own: Mapping[str, str]) -> dict[str, Any]:
    names = _named(found.names, own)
    return {
        "widths": found.widths,
        "inclusion": dict(zip(names, found.inclusion.T, strict=True)),
        "g_prior": dict(zip(names, found.g_prior, strict=True)),
        "left_out": _named(found.left_out, own),
        "swing": _named(found.swing, own),
    }


def _votes(votes: Votes, own: Mapping[str, str]) -> dict[str, Any]:
    return {
        "terms": _named(votes.terms, own),
        "strength": dict(zip(votes.methods, votes.strength, strict=True)),
        "keeps": dict(zip(votes.methods, votes.keeps, strict=True)),
        "disagreements": [
            {
                "term": own.get(one.term, one.term),
                "methods": list(one.methods),
                "cause": one.cause,
                "text": one.text,
            }
            for one in votes.disagreements
        ],
    }


def _reduced(found: Reduced) -> dict[str, Any]:
    return {
        "terms": list(found.terms),
        "coefficients": found.coefficients,
        "budget": found.budget,
        "lost": found.lost,
        "path": [{"terms": list(terms), "lost": lost} for terms, lost in found.path],
    }


def _misfit(found: Misfit) -> dict[str, Any]:
    return {
        "text": found.text,
        "found": [_dependence(one) for one in found.found],
        "dependences": [_dependence(one) for one in found.dependences],
        "predictive_p": found.predictive_p,
        "level": found.level,
    }


def _dependence(one: Dependence) -> dict[str, Any]:
    return {"run": one.run, "input": one.input, "p": one.p, "share": one.share, "size": one.size}
