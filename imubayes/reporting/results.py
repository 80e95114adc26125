"""The results as plain values for ``result.json``: SI units, finite numbers or null."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

import imubayes
from imubayes.reporting.case_views import case_records
from imubayes.reporting.ladder_words import choice_record
from imubayes.reporting.method_results import methods_block
from imubayes.reporting.noise_views import process_record
from imubayes.reporting.population_results import class_entry
from imubayes.reporting.rows import best_models, candidates, own_groups, own_names, plug_in_inclusion
from imubayes.reporting.sampled_results import (
    column_moments,
    distrusted_entry,
    extra_entry,
    mcmc_block,
    noise_posterior,
    session_entry,
)
from imubayes.reporting.scene_views import scene_record
from imubayes.reporting.standard_views import standards_record

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult, Study, StudyResult
    from imubayes.inference.observability import Confounded
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.inference.summary import RunSummary
    from imubayes.selection.verdicts import TermVerdict


def result_dict(result: StudyResult) -> dict[str, Any]:
    """Everything a script needs, as plain values in SI units; what is not finite becomes None."""
    document = {
        "imubayes": imubayes.__version__,
        "study": result.study.title,
        "seed": result.study.seed,
        "sensors": [_sensor(result.study, sensor) for sensor in result.sensors],
        "scenes": [scene_record(found, sensor) for sensor, found in result.scenes],
        "sessions": [session_entry(found) for found in result.sessions],
        "population": [class_entry(found) for found in result.classes],
        "cases": case_records(result),
        "appendices": [{"title": a.title, "command": a.command} for a in result.study.appendices],
        "provenance": provenance(result.study),
    }
    return _plain(document)


def result_json(result: StudyResult) -> str:
    """Text of ``result.json``: the same bytes for the same result."""
    return json.dumps(result_dict(result), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def provenance(study: Study) -> dict[str, Any]:
    """Collect what it takes to repeat a study: the study file, the command and the versions."""
    return {
        "study_file": str(study.path),
        "study_text": study.text,
        "command": command(study),
        "versions": versions(),
    }


def command(study: Study) -> str:
    """Command that repeats the study, with what was asked for beyond its file."""
    sampling = study.sampling
    options = "" if sampling.method == "auto" else f" --method {sampling.method}"
    if sampling.budget is not None:
        options = f' --budget "{sampling.budget:g} s"'
    elif sampling.accuracy is not None:
        options = f" --accuracy {sampling.accuracy:g}"
    return f"imubayes run {study.path}{options}"


@cache
def versions() -> dict[str, str]:
    """Versions of imubayes, of Python and of what computes the numbers."""
    return {
        "imubayes": imubayes.__version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in ("numpy", "celerite2", "numba", "emcee")},
    }


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "unknown"


def _sensor(study: Study, sensor: SensorResult) -> dict[str, Any]:
    selection = sensor.selection
    moments, plug_in = column_moments(sensor), plug_in_inclusion(selection)
    return {
        "id": sensor.id,
        "kind": sensor.kind,
        "class": sensor.class_id or None,
        "samples": sensor.samples,
        "noise": {run.name: {"N": run.noise.N, "B": run.noise.B, "K": run.noise.K} for run in sensor.runs},
        "noise_posterior": noise_posterior(sensor.chains),
        "noise_processes": process_record(sensor),
        "method": sensor.method,
        "method_reason": sensor.method_reason,
        "choice": choice_record(sensor.choice),
        "terms": [
            _term(term) | _sampled_term(moments.get(term.name), plug_in.get(term.name))
            for term in selection.terms
        ],
        "model": list(selection.model),
        "log_evidence": selection.log_evidence,
        **methods_block(sensor),
        "mcmc": mcmc_block(sensor),
        "extras": [extra_entry(entry) for entry in sensor.extras],
        "distrusted": [distrusted_entry(dwell) for dwell in sensor.distrusted],
        "n_models": selection.models.n_models,
        "drawn_models": selection.models.drawn,
        "missing": selection.models.missing,
        "inclusion_error": selection.models.error,
        "best_models": [{"terms": list(names), "probability": p} for names, p in best_models(selection)],
        "by_size": selection.models.by_size,
        "candidates": list(candidates(selection)),
        "inclusion_by_width": {f"{width:.3g}": inclusion for width, inclusion in selection.by_width},
        "confounded": [_confounded(group) for group in own_groups(selection)],
        "observability": _observability(sensor),
        "residuals": [_check(check) for check in sensor.checks],
        "runs": [_run(run) for run in sensor.runs],
        "prior_source": sensor.prior_source,
        "calibration": sensor.calibration,
        "digits": None if selection.digits is None else asdict(selection.digits),
        "pooled_inclusion": sensor.pooled,
        "standards": standards_record(study, sensor),
        "seconds": sensor.seconds,
    }


def _term(term: TermVerdict) -> dict[str, Any]:
    return {
        "name": term.name,
        "symbol": term.symbol,
        "unit": term.unit,
        "mean": term.mean,
        "sd": term.sd,
        "q05": term.q05,
        "q95": term.q95,
        "full_mean": term.full_mean,
        "full_sd": term.full_sd,
        "prior_sd": term.prior_sd,
        "inclusion": term.inclusion,
        "inclusion_range": list(term.inclusion_range),
        "limit95": term.limit95,
        "verdict": term.verdict,
        "reason": term.reason,
        "confounded_with": list(term.confounded_with),
        "group": term.group,
        "printed_unit": term.printed,
        "effect": term.effect,
    }


def _sampled_term(moments: tuple[float, float] | None, plug_in: float | None) -> dict[str, Any]:
    """Add what the chains say of a term; null where there are none."""
    mean, sd = moments or (None, None)
    return {"plug_in_inclusion": plug_in, "mcmc_mean": mean, "mcmc_sd": sd}


def _confounded(group: Confounded) -> dict[str, Any]:
    return {
        "terms": list(group.terms),
        "direction": list(group.direction),
        "seen": group.seen,
        "exact": group.exact,
        "reason": group.reason,
        "remedy": group.remedy,
    }


def _observability(sensor: SensorResult) -> dict[str, Any]:
    seen, names = sensor.selection.observability, own_names(sensor.selection)
    return {
        name: {
            "tested": bool(seen.tested[j]),
            "ratio": seen.ratio[j],
            "alone": seen.alone[j],
            "vif": seen.vif[j],
        }
        for column, name in names.items()
        for j in [seen.names.index(column)]
    }


def _check(check: ResidualCheck) -> dict[str, Any]:
    return {
        "run": check.run,
        "scale": check.scale,
        "whiteness_p": check.whiteness_p,
        "normality_p": check.normality_p,
        "sample_scale": check.sample_scale,
        "sample_whiteness_p": check.sample_whiteness_p,
        "fits": bool(check.fits),
        "level": check.level,
        "outliers": [{"start": start, "stop": stop, "size": size} for start, stop, size in check.outliers],
    }


def _run(run: RunSummary) -> dict[str, Any]:
    return {
        "name": run.name,
        "procedure": run.procedure,
        "samples": run.samples,
        "duration": run.duration,
        "interval": run.interval,
        "sampling": run.sampling or run.interval,
        "noise_origin": run.noise_origin,
        "noise_log_sd": dict(zip("NBK", run.noise_sd, strict=True)),
        "ranges": {channel: list(ends) for channel, ends in run.ranges.items()},
        "file": run.source.file,
        "sha256": run.source.sha256 or None,
        "columns": [
            {"column": c, "channel": channel, "unit": unit} for c, channel, unit in run.source.columns
        ],
        "notes": list(run.source.notes),
        "stills": [list(still) for still in run.stills],
    }


def _plain(value: Any) -> Any:
    """Turn arrays and numpy scalars into plain values, and what is not finite into None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
