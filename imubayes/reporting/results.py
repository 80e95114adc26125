"""A study's result as it is published: from what the stages found to the frozen `SensorsResult`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.reporting.blocks import header
from imubayes.reporting.case_views import KNOWN, cases_of, pooled_rows, root_mean_square
from imubayes.reporting.chain_views import exact_evidence, published_choice
from imubayes.reporting.noise_views import published_processes
from imubayes.reporting.result import Pooled, Sensitivity, SparseSupport, Votes, entries, published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.many import Population, PopulationTerm, Sessions
from imubayes.reporting.rows import in_own_names, own_groups
from imubayes.reporting.scene_words import published_scene
from imubayes.reporting.standard_views import standards

if TYPE_CHECKING:
    from collections.abc import Iterator

    from imubayes.campaign import ExtraPosterior, SensorResult, Study
    from imubayes.inference.known_quantities import Recovered
    from imubayes.inference.mcmc import Chains
    from imubayes.inference.summary import RunSummary
    from imubayes.population.sessions import TermInClass
    from imubayes.reporting.result import NoiseDraws
    from imubayes.selection.panel import Panel
    from imubayes.study import StudyResult


def published_result(result: StudyResult) -> entries.SensorsResult:
    """Publish what a study of sensors found."""
    study = result.study
    return published(
        entries.SensorsResult,
        study,
        **header(study, command(study)),
        sensors=tuple(_sensor(study, sensor) for sensor in result.sensors),
        scenes=tuple(published_scene(relevance, sensor) for sensor, relevance in result.scenes),
        sessions=tuple(
            published(Sessions, repeated, printed_unit=repeated.printed) for repeated in result.sessions
        ),
        population=tuple(
            published(
                Population, grade, terms=tuple(map(_in_class, grade.terms)), **{"class": grade.class_id}
            )
            for grade in result.classes
        ),
        cases=tuple(_cases(result)),
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


def _sensor(study: Study, sensor: SensorResult) -> entries.Sensor:
    selection, models = sensor.selection, sensor.selection.models
    seen = in_own_names(selection.observability, selection)
    place = {term.name: seen.names.index(term.name) for term in selection.terms}
    return published(
        entries.Sensor,
        sensor,
        selection,
        models,
        **_of_panel(in_own_names(sensor.panel, selection)),
        **{"class": sensor.class_id or None},
        noise={run.name: run.noise for run in sensor.runs},
        noise_posterior=noise_posterior(sensor.chains),
        noise_processes=published_processes(sensor),
        choice=published_choice(sensor.choice),
        terms=_terms(sensor),
        mcmc=_chains(sensor),
        extras=tuple(map(_extra, sensor.extras)),
        reproducibility=sensor.spreads or None,
        absorbed=sensor.absorbed and sensor.absorbed.text,
        drawn_models=models.drawn,
        inclusion_error=models.error,
        best_models=in_own_names(models.best, selection),
        candidates=in_own_names(models.candidates.names, selection),
        inclusion_by_width={f"{width:.3g}": inclusion for width, inclusion in selection.by_width},
        confounded=own_groups(selection),
        observability={
            name: tuple(x[j] for x in (seen.tested, seen.ratio, seen.alone, seen.vif))
            for name, j in place.items()
        },
        residuals=sensor.checks,
        runs=tuple(map(_run, sensor.runs)),
        pooled_inclusion=sensor.pooled,
        compensations=sensor.compensations or None,
        standards=standards(study, sensor),
    )


def _terms(sensor: SensorResult) -> tuple[entries.Term, ...]:
    moments, terms = column_moments(sensor), sensor.selection.terms
    plug_in = sensor.selection.plug_in or [None] * len(terms)
    return tuple(
        published(
            entries.Term,
            term,
            conditional=sensor.conditional or None,
            verdict_by=term.voices and term.voices._asdict(),
            printed_unit=term.printed,
            plug_in_inclusion=at_estimate,
            **dict(zip(("mcmc_mean", "mcmc_sd"), moments.get(term.name, (None, None)), strict=True)),
        )
        for term, at_estimate in zip(terms, plug_in, strict=True)
    )


def _run(run: RunSummary) -> entries.Run:
    return published(
        entries.Run,
        run,
        run.source,
        sampling=run.sampling or run.interval,
        noise_origin=run.found.origin,
        noise_log_sd=run.found.sd,
        sha256=run.source.sha256 or None,
    )


def _of_panel(panel: Panel | None) -> dict[str, Any]:
    """Criteria, sparse regressions, other priors, votes and reduced model."""
    if panel is None:
        nothing = dict.fromkeys(("sensitivity", "votes", "reduced"))
        return {"criteria": {}, "sindy": {}, "unasked": (), **nothing}
    other, votes = panel.sensitivity, panel.votes
    inclusion, g_prior = (dict(zip(other.names, x, strict=True)) for x in (other.inclusion.T, other.g_prior))
    strength, keeps = (dict(zip(votes.methods, x, strict=True)) for x in (votes.strength, votes.keeps))
    return {
        "criteria": {criterion.name: criterion for criterion in panel.criteria},
        "sindy": {
            sparse.optimizer: published(SparseSupport, sparse, strength=sparse.strength[sparse.chosen])
            for sparse in panel.sindy
        },
        "sensitivity": published(Sensitivity, other, inclusion=inclusion, g_prior=g_prior),
        "votes": published(Votes, votes, strength=strength, keeps=keeps),
        "reduced": panel.reduced,
        "unasked": panel.unasked,
    }


def _chains(sensor: SensorResult) -> entries.Mcmc:
    if sensor.chains:
        return _of_chains(sensor, sensor.chains)
    m = len(sensor.draws)
    return entries.Mcmc(
        sampler="exact",
        draws=m,
        ess_min=m,
        rhat_max=1.0,
        acceptance=1.0,
        seconds=sensor.seconds,
        converged=True,
        text="independent draws from the exact posterior: there is nothing to accept or to mix",
        tau_max=1.0,
        steps=m,
        walkers=1,
        ensembles=1,
        worst=None,
        interpolation_error=0.0,
        log_evidence=None,
    )


def _of_chains(sensor: SensorResult, chains: Chains) -> entries.Mcmc:
    """Of Markov chains; the evidence is of the full library, ``exact`` at the estimated noise."""
    mixing = chains.diagnostics
    return published(
        entries.Mcmc,
        mixing,
        chains,
        draws=int(np.prod(chains.theta.shape[:2])),
        ess_min=np.min(mixing.ess),
        rhat_max=np.max(mixing.rhat),
        tau_max=np.max(mixing.tau),
        worst=mixing.parameters[int(np.argmin(mixing.ess))],
        log_evidence=(*chains.log_evidence, exact_evidence(sensor)),
    )


def column_moments(sensor: SensorResult) -> dict[str, tuple[float, float]]:
    """Mean and sd of each column by a component's chains, under the full library; empty if exact."""
    if sensor.chains is None:
        return {}
    names = in_own_names(sensor.chains.names, sensor.selection)
    draws = sensor.chains.theta.reshape(-1, len(names)).T
    return {
        name: (float(draw.mean()), float(draw.std(ddof=1))) for name, draw in zip(names, draws, strict=True)
    }


def noise_posterior(chains: Chains | None) -> dict[str, NoiseDraws]:
    """Posterior of N, B, K of each run that has a noise of its own; empty without chains."""
    if chains is None:
        return {}
    posteriors: dict[str, Any] = {run: {} for run in chains.runs}
    for g, run in enumerate(chains.runs):
        for k, letter in enumerate("NBK"):
            draws = chains.noise[:, :, g, k].ravel()
            low, high = np.quantile(draws, (0.05, 0.95)).tolist()
            mean, sd = float(draws.mean()), float(draws.std(ddof=1))
            posteriors[run][letter] = {"mean": mean, "sd": sd, "q05": low, "q95": high}
    return posteriors


def _extra(entry: ExtraPosterior) -> entries.Extra:
    return published(
        entries.Extra,
        entry,
        entry.extra,
        prior_sd=entry.extra.sd,
        confounded_with=entry.partners,
        printed_unit=entry.extra.printed,
    )


def _in_class(term: TermInClass) -> PopulationTerm:
    spreads = term.spreads
    return published(
        PopulationTerm,
        term,
        spreads,
        term.need,
        parameter=term.name,
        printed_unit=term.printed,
        mean=(spreads.mean_sd, *spreads.mean),
        session_shift=(term.sessions, spreads.shift, spreads.shift_sd),
        measurement=(spreads.noise, spreads.alias),
        needed=term.need.share,
    )


def _cases(result: StudyResult) -> Iterator[entries.Case]:
    """Publish the cases of a study: errors in SI, verdicts of each kind."""
    for name, sensors in cases_of(result).items():
        kinds = pooled_rows(sensors, result.study.costs)
        pooled = {
            kind: {term: Pooled(inclusion=inclusion, verdict=word) for term, _, inclusion, word in rows}
            for kind, rows in kinds.items()
        }
        errors = tuple(map(_recovered, sensors[0].recovered))
        own = (relevance for case, relevance in result.case_scenes if case == name)
        scenes = tuple(published(entries.CaseInScene, relevance) for relevance in own)
        yield entries.Case(id=name, recovered=errors, pooled=pooled, scenes=scenes)


def _recovered(recovered: Recovered) -> entries.RecoveredErrors:
    sizes = ("before", "after", "flown", "fitted", "fresh")
    return published(
        entries.RecoveredErrors,
        recovered,
        unit=KNOWN[recovered.what].si,
        count=len(recovered.after),
        rms={size: root_mean_square(getattr(recovered, size), recovered.what) for size in sizes},
        within_2_sd=recovered.inside,
        of=recovered.after.size,
        errors=recovered.after,
        sd=recovered.expected,
    )
