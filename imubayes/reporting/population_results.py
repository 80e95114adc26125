"""What units of a class have in common, as plain values in SI units for ``result.json``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.selection.class_needs import ClassInCommon, Need, TermInClass


def class_entry(found: ClassInCommon) -> dict[str, Any]:
    """One class and kind."""
    return {
        "class": found.class_id,
        "kind": found.kind,
        "units": list(found.units),
        "sessions": list(found.sessions),
        "components": list(found.components),
        "terms": [_term(term) for term in found.terms],
    }


def _term(term: TermInClass) -> dict[str, Any]:
    found = term.spreads
    return {
        "parameter": term.parameter.name,
        "term": term.term,
        "component": term.component,
        "unit": term.parameter.unit,
        "printed_unit": term.parameter.printed,
        "class_size": term.size,
        "mean": {"sd": found.mean_sd, **_interval(found.mean)},
        "unit_to_unit": _interval(found.unit),
        "turn_on": _interval(found.turn_on),
        "turn_on_own": _interval(found.own),
        "turn_on_common": _interval(found.common),
        "p_value": found.p_value,
        "level": found.level,
        "common_share": _interval(found.common_share),
        "next_unit": _interval(found.next_unit),
        "session_shift": {"sessions": list(term.sessions), "mean": found.shift, "sd": found.shift_sd},
        "measurement": {"noise": found.noise, "alias": found.alias},
        **_need(term.need),
    }


def _interval(found: Share) -> dict[str, float]:
    return {"median": found.value, "q05": found.low, "q95": found.high}


def _need(need: Need) -> dict[str, Any]:
    return {
        "verdict": need.verdict,
        "reason": need.reason,
        "answers": dict(need.answers),
        "needed": {"share": need.share.value, "q05": need.share.low, "q95": need.share.high},
        "pooled_inclusion": math.nan if need.pooled is None else need.pooled,
    }
