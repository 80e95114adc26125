"""Small tables of a published result, one on a line, in SI: the key that holds one says what it means."""

from __future__ import annotations

from typing import NotRequired

from typing_extensions import TypedDict

from imubayes.reporting.result.values import Count, Flag, Names, Number, Numbers

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
BetweenSessions = TypedDict("BetweenSessions", {"mean": Number, "q05": Number, "q95": Number})
Spread = TypedDict("Spread", {"median": Number, "q05": Number, "q95": Number})
PopulationMean = TypedDict("PopulationMean", {"sd": Number, "median": Number, "q05": Number, "q95": Number})
SessionShift = TypedDict("SessionShift", {"sessions": Names, "mean": Numbers, "sd": Numbers})
Measurement = TypedDict("Measurement", {"noise": Number, "alias": Number})
NeededShare = TypedDict("NeededShare", {"share": Number, "q05": Number, "q95": Number})
RecoveredRms = TypedDict("RecoveredRms", {
    "before": Number, "after": Number, "flown": Number, "fitted": Number, "fresh": Number,
})
Pooled = TypedDict("Pooled", {"inclusion": Number, "verdict": str})
Appendix = TypedDict("Appendix", {"title": str, "command": str})
Coverage = TypedDict("Coverage", {"held": Count, "of": Count, "share": Interval})
Check = TypedDict("Check", {
    "precision": Interval, "recall": Interval, "cells": tuple[Count, Count], "population_mean": Coverage,
    "population_spread": Coverage, "untold": Count,
})
Worst = TypedDict("Worst", {"unit": str, "term": str, "value": Number, "pull": Number, "outlier": Flag})
Broken = TypedDict("Broken", {"number": Count, "name": str, "error": str})
NoiseIntervals = TypedDict("NoiseIntervals", {"N": Interval, "B": Interval, "K": Interval})
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
