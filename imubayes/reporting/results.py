"""A study's result as it is published: from what the stages found to the frozen `SensorsResult`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import imubayes
from imubayes.reporting.case_views import published_cases
from imubayes.reporting.ladder_words import published_choice
from imubayes.reporting.method_results import opinions
from imubayes.reporting.noise_views import published_processes
from imubayes.reporting.population_results import published_population, published_sessions
from imubayes.reporting.provenance import provenance
from imubayes.reporting.result.entries import Appendix, Confounded, Digits, DistrustedDwell, Noise, Residuals
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.sensors import Run, Sensor, SensorsResult, Term
from imubayes.reporting.result.values import published
from imubayes.reporting.rows import best_models, candidates, own_groups, own_names, plug_in_inclusion
from imubayes.reporting.sampled_results import (
    column_moments,
    noise_posterior,
    published_chains,
    published_extra,
)
from imubayes.reporting.scene_views import published_scene
from imubayes.reporting.standard_views import published_standards

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult, Study, StudyResult
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.inference.summary import RunSummary
    from imubayes.reporting.result.entries import Observed


def published_result(result: StudyResult) -> SensorsResult:
    """Publish what a study of sensors found."""
    study = result.study
    return SensorsResult(
        imubayes=imubayes.__version__,
        study=study.title,
        seed=study.seed,
        sensors=tuple(_sensor(study, sensor) for sensor in result.sensors),
        scenes=tuple(published_scene(found, sensor) for sensor, found in result.scenes),
        sessions=tuple(map(published_sessions, result.sessions)),
        population=tuple(map(published_population, result.classes)),
        cases=tuple(published_cases(result)),
        appendices=tuple(published(Appendix, one) for one in study.appendices),
        provenance=provenance(study, command(study)),
    )


def result_json(result: StudyResult) -> str:
    """Text of ``result.json``: the same bytes for the same result."""
    return result_text(published_result(result))


def command(study: Study) -> str:
    """Command that repeats the study, with what was asked for beyond its file."""
    sampling = study.sampling
    options = "" if sampling.method == "auto" else f" --method {sampling.method}"
    if sampling.budget is not None:
        options = f' --budget "{sampling.budget:g} s"'
    elif sampling.accuracy is not None:
        options = f" --accuracy {sampling.accuracy:g}"
    return f"imubayes run {study.path}{options}"


def _sensor(study: Study, sensor: SensorResult) -> Sensor:
    selection, models = sensor.selection, sensor.selection.models
    return published(
        Sensor,
        sensor,
        class_=sensor.class_id or None,
        noise={run.name: published(Noise, run.noise) for run in sensor.runs},
        noise_posterior=noise_posterior(sensor.chains),
        noise_processes=published_processes(sensor),
        choice=published_choice(sensor.choice),
        terms=_terms(sensor),
        model=selection.model,
        log_evidence=selection.log_evidence,
        **opinions(sensor),
        mcmc=published_chains(sensor),
        extras=tuple(map(published_extra, sensor.extras)),
        distrusted=tuple(published(DistrustedDwell, dwell) for dwell in sensor.distrusted),
        n_models=models.n_models,
        drawn_models=models.drawn,
        missing=models.missing,
        inclusion_error=models.error,
        best_models=[{"terms": names, "probability": p} for names, p in best_models(selection)],
        by_size=models.by_size,
        candidates=candidates(selection),
        inclusion_by_width={f"{width:.3g}": inclusion for width, inclusion in selection.by_width},
        confounded=tuple(published(Confounded, group) for group in own_groups(selection)),
        observability=_observability(sensor),
        residuals=tuple(map(_residuals, sensor.checks)),
        runs=tuple(map(_run, sensor.runs)),
        digits=selection.digits and published(Digits, selection.digits),
        pooled_inclusion=sensor.pooled,
        standards=published_standards(study, sensor),
    )


def _terms(sensor: SensorResult) -> tuple[Term, ...]:
    """Terms, with what the chains say of each where there are any."""
    moments, plug_in = column_moments(sensor), plug_in_inclusion(sensor.selection)
    return tuple(
        published(
            Term,
            term,
            printed_unit=term.printed,
            plug_in_inclusion=plug_in.get(term.name),
            **dict(zip(("mcmc_mean", "mcmc_sd"), moments.get(term.name, (None, None)), strict=True)),
        )
        for term in sensor.selection.terms
    )


def _observability(sensor: SensorResult) -> dict[str, Observed]:
    seen, names = sensor.selection.observability, own_names(sensor.selection)
    columns = {name: seen.names.index(column) for column, name in names.items()}
    return {
        name: {"tested": seen.tested[j], "ratio": seen.ratio[j], "alone": seen.alone[j], "vif": seen.vif[j]}
        for name, j in columns.items()
    }


def _residuals(check: ResidualCheck) -> Residuals:
    outliers = [{"start": start, "stop": stop, "size": size} for start, stop, size in check.outliers]
    return published(Residuals, check, outliers=outliers)


def _run(run: RunSummary) -> Run:
    return published(
        Run,
        run,
        sampling=run.sampling or run.interval,
        noise_log_sd=dict(zip("NBK", run.noise_sd, strict=True)),
        file=run.source.file,
        sha256=run.source.sha256 or None,
        columns=[
            {"column": column, "channel": channel, "unit": unit}
            for column, channel, unit in run.source.columns
        ],
        notes=run.source.notes,
    )
