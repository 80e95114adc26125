"""Values of a published result, and its small tables: SI; what is not finite is nan, and null in the file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from types import NoneType, SimpleNamespace, UnionType
from typing import Annotated, Any, NotRequired, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BeforeValidator, Field, Strict
from pydantic.fields import FieldInfo
from pydantic_core import core_schema
from typing_extensions import TypedDict, is_typeddict


class _Real:
    """A number, or null where it is not finite."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        absent = core_schema.no_info_after_validator_function(lambda _: math.nan, core_schema.none_schema())
        return core_schema.union_schema(
            [core_schema.float_schema(strict=True), absent],
            mode="left_to_right",
            custom_error_type="number",
            custom_error_message="expected a number or null",
        )


def _listed(value: Any) -> Any:
    """Numpy's arrays and scalars as Python has them."""
    return value.tolist() if hasattr(value, "tolist") else value


def plain(value: Any) -> Any:
    """Values of any form as Python has them, with null for what is not finite."""
    value = _listed(value)
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def says(meaning: str) -> FieldInfo:
    """What a key of a result means, and its unit where it isn't SI's: the documentation is made of it."""
    return Field(description=meaning)


Number = Annotated[float, _Real()]
Count = Annotated[int, BeforeValidator(_listed), Strict()]
Flag = Annotated[bool, BeforeValidator(_listed), Strict()]
Names = tuple[str, ...]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(_listed)]
Matrix = Annotated[tuple[Numbers, ...], BeforeValidator(_listed)]
Loose = dict[str, Any]
"""A table whose keys depend on what was tested."""

_Published = TypeVar("_Published")
_hints = cache(get_type_hints)


def published(kind: type[_Published], /, *sources: object, **other: Any) -> _Published:
    """Publish what stages found: fields of the same name, each of the first source that has it, and others.

    What a field holds is published alike, one or several; a tuple has its values in the order of the fields.
    A field that may be left out, and has no null, is left out where it is None.
    """
    *others, last = sources
    given = other | {
        key: getattr(next((source for source in others if hasattr(source, key)), last), key)
        for key in _hints(kind).keys() - other.keys()
    }
    absent = {name for name in _optional(kind) if given[name] is None}
    return kind(
        **{name: _of_form(form, given[name]) for name, form in _hints(kind).items() if name not in absent}
    )


@cache
def _optional(kind: type) -> tuple[str, ...]:
    """Fields that may be left out and have no null."""
    full = get_type_hints(kind, include_extras=True)
    return tuple(
        name
        for name, form in _hints(kind).items()
        if get_origin(full[name]) is NotRequired and NoneType not in get_args(form)
    )


def _of_form(form: Any, value: Any) -> Any:
    """Publish a value where its form is a published one, a row or a table of these; else leave it."""
    kinds = get_args(form)
    if value is None or isinstance(value, str):
        return value
    if get_origin(form) is UnionType:
        return _of_form(kinds[0], value)
    if get_origin(form) is tuple and kinds[-1] is Ellipsis and is_typeddict(kinds[0]):
        return tuple(_of_form(kinds[0], each) for each in value)
    if get_origin(form) is dict and is_typeddict(kinds[1]):
        return {key: _of_form(kinds[1], each) for key, each in value.items()}
    if not is_typeddict(form) or isinstance(value, Mapping):
        return value
    if isinstance(value, tuple):
        value = SimpleNamespace(**dict(zip(_hints(form), value, strict=True)))
    return published(form, value)


class Headed(TypedDict):
    """What every result begins with."""

    imubayes: Annotated[str, says("version")]
    study: Annotated[str, says("title")]
    seed: Annotated[Count, says("of the study")]


# fmt: off
Provenance = TypedDict("Provenance", {
    "study_file": str, "study_text": str, "command": str, "versions": NotRequired[dict[str, str]],
})
Noise = TypedDict("Noise", {"N": Number, "B": Number, "K": Number})
Moments = TypedDict("Moments", {"mean": Number, "sd": Number, "q05": Number, "q95": Number})
NoiseDraws = TypedDict("NoiseDraws", {"N": Moments, "B": Moments, "K": Moments})
ProcessSet = TypedDict("ProcessSet", {"processes": Names, "probability": Number})
Allan = TypedDict("Allan", {
    "values": dict[str, Number], "log_sd": dict[str, Number], "chi2": Number, "dof": Count,
})
Step = TypedDict("Step", {"rung": str, "change_sd": Number, "change_inclusion": Number})
NextRung = TypedDict("NextRung", {
    "rung": str, "seconds": Number, "change_sd": Number, "change_inclusion": Number, "foreseen_by": str,
})
RungChoice = TypedDict("RungChoice", {
    "rung": str, "asked": str, "met": Flag, "seconds": Number, "foreseen_seconds": Number,
    "climbed": tuple[Step, ...], "next": NextRung | None,
})
SparseSupport = TypedDict("SparseSupport", {
    "model": Names, "inclusion": dict[str, Number], "strength": Number, "stable": Names, "cut": Number,
    "false_bound": Number,
})
Sensitivity = TypedDict("Sensitivity", {
    "widths": Numbers, "inclusion": dict[str, Numbers], "g_prior": dict[str, Number], "left_out": Names,
    "swing": Names,
})
Disagreement = TypedDict("Disagreement", {"term": str, "methods": Names, "cause": str, "text": str})
Votes = TypedDict("Votes", {
    "terms": Names, "strength": dict[str, Numbers], "keeps": dict[str, Numbers],
    "disagreements": tuple[Disagreement, ...],
})
Loss = TypedDict("Loss", {"terms": Names, "lost": Number})
Reduced = TypedDict("Reduced", {
    "terms": Names, "coefficients": Numbers, "budget": Number, "lost": Number, "path": tuple[Loss, ...],
})
Unasked = TypedDict("Unasked", {"method": str, "reason": str})
Dependence = TypedDict("Dependence", {"run": str, "input": str, "p": Number, "share": Number, "size": Number})
Misfit = TypedDict("Misfit", {
    "text": str, "found": tuple[Dependence, ...], "dependences": tuple[Dependence, ...],
    "predictive_p": dict[str, Number], "level": Number,
})
Size = TypedDict("Size", {"mean": Number, "sd": Number})
Exportable = TypedDict("Exportable", {
    "model": str, "terms": Names, "mean": Numbers, "covariance": Matrix, "held_out": Number,
    "positions": Count,
})
Bias = TypedDict("Bias", {"start": Size, "mean": Size, "end": Size, "drift": Size})
TermGroup = TypedDict("TermGroup", {"terms": Names, "any_inclusion": Number})
Evidence = TypedDict("Evidence", {"value": Number, "sd": Number, "exact": Number})
DistrustedDwell = TypedDict("DistrustedDwell", {
    "run": str, "start": Number, "stop": Number, "probability": Number, "offset": Number, "sd": Number,
})
ModelProbability = TypedDict("ModelProbability", {"terms": Names, "probability": Number})
Confounded = TypedDict("Confounded", {
    "terms": Names, "direction": Numbers, "seen": Number, "exact": Flag, "reason": str, "remedy": str,
})
Observed = TypedDict("Observed", {"tested": Flag, "ratio": Number, "alone": Number, "vif": Number})
Outlier = TypedDict("Outlier", {"start": Number, "stop": Number, "size": Number})
Column = TypedDict("Column", {"column": str, "channel": str, "unit": str})
Digits = TypedDict("Digits", {"coefficients": Count, "sd": Count, "log_evidence": Count, "inclusion": Count})
AbsorbedTerms = TypedDict("AbsorbedTerms", {
    "terms": Names, "inputs": str, "rms": Number, "left": Number, "printed_unit": str,
})
Budget = TypedDict("Budget", {"quantity": str, "limit": Number})
ErrorSize = TypedDict("ErrorSize", {"median": Number, "q95": Number})
Interval = TypedDict("Interval", {"value": Number, "low": Number, "high": Number})
Drop = TypedDict("Drop", {"terms": Count, "dropped": str, "error": Number})
RecoveredRms = TypedDict("RecoveredRms", {
    "before": Number, "after": Number, "flown": Number, "fitted": Number, "fresh": Number,
})
Pooled = TypedDict("Pooled", {"inclusion": Number, "verdict": str})
Appendix = TypedDict("Appendix", {"title": str, "command": str})
Process = TypedDict("Process", {
    "unit": str, "printed_unit": str, "inclusion": Number, "mean": Number, "sd": Number, "q05": Number,
    "q50": Number, "q95": Number, "limit95": Number, "detection_limit": Number, "verdict": str,
    "reason": str, "confounded_with": Names,
})
Processes = TypedDict("Processes", {
    "identified": Names, "prior_source": str, "rows": Count, "processes": dict[str, Process],
    "sets": tuple[ProcessSet, ...], "allan": Allan | None,
})
Criterion = TypedDict("Criterion", {
    "model": Names, "value": Number, "lead": Number, "inclusion": dict[str, Number], "samples": Number,
    "compared": Count, "exact": Flag, "pareto_k": Number, "note": str,
})
Residuals = TypedDict("Residuals", {
    "run": str, "scale": Number, "whiteness_p": Number, "normality_p": Number, "sample_scale": Number,
    "sample_whiteness_p": Number, "fits": Flag, "level": Number, "outliers": tuple[Outlier, ...],
})
Symbol = TypedDict("Symbol", {
    "symbol": str, "value": Number, "sd": Number, "unit": str, "printed_unit": str, "term": str,
    "verdict": str, "note": str,
})
Standard = TypedDict("Standard", {
    "title": str, "values": tuple[Symbol, ...], "untested": Names, "absent": Names, "exact": str,
    "standard_only": Names, "general_only": Names, "absorbed": AbsorbedTerms | None, "trouble": str,
})
# fmt: on
