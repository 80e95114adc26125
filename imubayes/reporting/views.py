"""What the report's template shows, ready to print."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

from imubayes.reporting import figures, fit_figures
from imubayes.reporting.chain_views import SampledView, sampled_view
from imubayes.reporting.chain_words import unconverged_sentence
from imubayes.reporting.method_views import BesideView, beside_view
from imubayes.reporting.noise_views import ProcessView, process_views
from imubayes.reporting.rounding import NOISE_UNITS, Measured, pretty
from imubayes.reporting.rows import (
    NoiseRow,
    TermRow,
    fit_scale,
    noise_floor,
    noise_row,
    own_groups,
    range_texts,
    term_rows,
)
from imubayes.reporting.scene_views import SceneView, scene_view
from imubayes.reporting.scene_words import scene_sentences
from imubayes.reporting.standard_views import StandardView, standard_views
from imubayes.reporting.words import answer, averaged_text, fit_sentence, sensor_groups, weighed_text
from imubayes.selection.verdicts import listed

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult, StudyResult
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.inference.summary import RunSummary
    from imubayes.reporting.canvas import Panel
    from imubayes.selection.relevance import Relevance
    from imubayes.sensors.terms import Kind

MOST_CURVE_POINTS = 9000
"""Points over all curves of a report, so that it stays below 2 MB."""

MOST_RUNS, MOST_RUNS_OF_MANY = 8, 3
"""Runs whose residuals are drawn: of one or two components, and of each of more."""

MANY = 12
"""Components whose figures and answers a report holds; of more, each answer stands with its component, and
figures are drawn of `MOST_DRAWN` only."""

MOST_DRAWN = 3
"""Components of many that have figures: those whose rows fit worst."""


@dataclass(frozen=True, slots=True)
class RunView:
    """Residual figures of one run."""

    name: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class FitView:
    """What the residuals say of one component.

    Attributes
    ----------
    sentence : the verdict in words.
    runs, inputs : figures; none where another component has the same residuals.
    twin : (anchor, id) of that component: the rows of a reference-free tumble belong to all three.
    """

    sentence: str
    runs: tuple[RunView, ...]
    inputs: tuple[Panel, ...]
    twin: tuple[str, str] | None


@dataclass(frozen=True, slots=True)
class SensorView:
    """What the report shows of one component.

    Attributes
    ----------
    anchor : id of its section.
    sensor : the component.
    answer : first paragraph, by sentence.
    groups : rows of the term table by part of the model equation; without figures only of excited terms.
    digits : decimals of the longest value and of the longest sd, which align the columns.
    floor : noise floor beside which effects stand.
    confounded : each group of confounded terms, in words.
    reasons : (verdict, reason, names) of the terms without a yes or a no.
    fit, choice, posterior, correlations : figures and words.
    models : in words, how many were weighed.
    averaged : in words, those that the values are averaged over.
    noise, noise_units : rows of the noise table; a run whose processes are told has its sizes there.
    processes : noise processes of the runs that were asked for them.
    about_noise : whether these are all that was asked: every run is at rest.
    drawn : whether there are figures; not of every component where they are many.
    doubtful : whether the answer needs a warning: a run that does not fit, a library that misses something,
        chains that have not converged.
    sampled : what stands beside the exact posterior.
    beside : other methods, what the library misses, groups.
    standards : values in the symbols of the standards that apply.
    required : what each scene requires, in words.
    scenes : the same with tables and figures; empty where there are none.
    """

    anchor: str
    sensor: SensorResult
    answer: tuple[str, ...]
    groups: tuple[tuple[str, tuple[TermRow, ...]], ...]
    digits: tuple[int, int]
    floor: Measured
    confounded: tuple[str, ...]
    reasons: tuple[tuple[str, str, tuple[str, ...]], ...]
    fit: FitView
    choice: tuple[Panel, ...]
    models: str
    averaged: str
    posterior: tuple[Panel, ...]
    correlations: Panel | None
    noise: tuple[NoiseRow, ...]
    noise_units: tuple[str, str, str]
    processes: tuple[ProcessView, ...]
    about_noise: bool
    drawn: bool
    doubtful: bool
    sampled: SampledView
    beside: BesideView
    standards: tuple[StandardView, ...]
    required: tuple[str, ...]
    scenes: tuple[SceneView, ...]


def sensor_views(result: StudyResult) -> tuple[SensorView, ...]:
    """Prepare every component for the template."""
    drawn = _drawn(result.sensors)
    first: dict[tuple[int, ...], int] = {}
    views = []
    for k, sensor in enumerate(result.sensors):
        earliest = first.setdefault(tuple(map(id, sensor.checks)), k)
        if k not in drawn:
            fit = FitView(fit_sentence(sensor), (), (), None)
        elif earliest in drawn and earliest != k and sensor.checks:
            fit = FitView(fit_sentence(sensor), (), (), (_anchor(earliest), result.sensors[earliest].id))
        else:
            fit = _fit_view(sensor, _anchor(k), len(drawn))
        sampled = sampled_view(sensor, _anchor(k), len(drawn) if k in drawn else 0)
        views.append(_view(result, k, fit, sampled, drawn=k in drawn))
    return tuple(views)


def _anchor(k: int) -> str:
    return f"s{k + 1}"


def _drawn(sensors: Sequence[SensorResult]) -> set[int]:
    """Components that have figures: all of a few; of many the worst ones, no two of the same rows."""
    if len(sensors) <= MANY:
        return set(range(len(sensors)))
    rows = {tuple(map(id, sensor.checks)): k for k, sensor in reversed(list(enumerate(sensors)))}
    return set(sorted(rows.values(), key=lambda k: _trust(sensors[k]))[:MOST_DRAWN])


def _trust(sensor: SensorResult) -> tuple[bool, float]:
    """Order components from the worst: chains that have not converged or runs that do not fit come first."""
    return not _is_doubtful(sensor), -abs(math.log(max(fit_scale(sensor), 1e-12)))


def _is_doubtful(sensor: SensorResult) -> bool:
    misses = sensor.misfit is not None and bool(sensor.misfit.found)
    return misses or not all(check.fits for check in sensor.checks) or bool(unconverged_sentence(sensor))


def _view(result: StudyResult, k: int, fit: FitView, sampled: SampledView, *, drawn: bool) -> SensorView:
    sensor, key = result.sensors[k], _anchor(k)
    rows, selection = term_rows(sensor), sensor.selection
    scenes = [found for owner, found in result.scenes if owner == sensor.id]
    if not drawn:
        rows = tuple(row for row in rows if row.verdict.verdict != "untested")
    sizes = [row.size for row in rows if row.size]
    weighed = {found.choice.run for found in sensor.processes}
    return SensorView(
        anchor=key,
        sensor=sensor,
        answer=answer(sensor),
        groups=tuple((name, tuple(part)) for name, part in groupby(rows, key=lambda row: row.verdict.group)),
        digits=(_decimals([size.value for size in sizes]), _decimals([size.sd for size in sizes])),
        floor=noise_floor(sensor),
        confounded=sensor_groups(sensor, own_groups(selection)),
        reasons=tuple(_reasons(sensor)),
        fit=fit,
        choice=_choice(sensor, key) if drawn else (),
        models=weighed_text(selection.models),
        averaged=averaged_text(selection.models),
        posterior=tuple(figures.posteriors(sensor, key)) if drawn else (),
        correlations=figures.correlations(sensor, f"{key}d") if drawn else None,
        noise=tuple(
            noise_row(run, sensor.kind, sensor.chains) for run in sensor.runs if run.name not in weighed
        ),
        noise_units=NOISE_UNITS[sensor.kind],
        processes=process_views(sensor, key, drawn=drawn),
        about_noise=bool(weighed) and all(run.procedure == "static" for run in sensor.runs),
        drawn=drawn,
        doubtful=_is_doubtful(sensor),
        sampled=sampled,
        beside=beside_view(sensor, key, drawn=drawn, own_rows=fit.twin is None),
        standards=standard_views(result.study, sensor) if drawn else (),
        required=tuple(pretty(" ".join(scene_sentences(found, sensor.id))) for found in scenes),
        scenes=tuple(_scenes(scenes, sensor, key)) if drawn else (),
    )


def _scenes(scenes: Sequence[Relevance], sensor: SensorResult, key: str) -> Iterator[SceneView]:
    symbols = {term.name: term.symbol for term in sensor.selection.terms}
    for k, found in enumerate(scenes):
        yield scene_view(found, sensor.id, symbols, f"{key}w{k}")


def _decimals(texts: list[str]) -> int:
    return max((len(text.partition(".")[2]) for text in texts), default=0)


def _reasons(sensor: SensorResult) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    # the groups say it better for what is inseparable
    for verdict in ("undecided", "unresolved", "untested"):
        having = [term for term in sensor.selection.terms if term.verdict == verdict]
        for reason in dict.fromkeys(term.reason for term in having):
            yield verdict, reason, tuple(term.name for term in having if term.reason == reason)


def _choice(sensor: SensorResult, key: str) -> tuple[Panel, ...]:
    return (
        figures.inclusion(sensor, f"{key}a"),
        figures.best_models(sensor, f"{key}b"),
        figures.model_size(sensor, f"{key}c"),
    )


def _fit_view(sensor: SensorResult, key: str, sensors: int) -> FitView:
    most_runs = MOST_RUNS if sensors <= 2 else MOST_RUNS_OF_MANY
    inputs = {channel for check in sensor.checks for channel in check.inputs}
    curves = sensors * (min(len(sensor.checks), most_runs) + len(inputs))
    points = max(60, min(fit_figures.MOST_POINTS, MOST_CURVE_POINTS // max(curves, 1)))
    runs = tuple(
        RunView(check.run, tuple(_run_panels(check, sensor.kind, f"{key}r{n}", points)))
        for n, check in enumerate(fit_figures.shown_runs(sensor, most_runs))
    )
    return FitView(fit_sentence(sensor), runs, tuple(fit_figures.against_inputs(sensor, key, points)), None)


def _run_panels(check: ResidualCheck, kind: Kind, key: str, points: int) -> Iterator[Panel]:
    yield fit_figures.over_time(check, f"{key}t", points)
    yield fit_figures.autocorrelation(check, f"{key}c")
    deviation = fit_figures.allan(check, kind, f"{key}a")
    if deviation:
        yield deviation


def overview(result: StudyResult) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Verdicts of the components by term; empty where a component has no such term."""
    names = dict.fromkeys(term.name for sensor in result.sensors for term in sensor.selection.terms)
    verdicts = [{term.name: term.verdict for term in sensor.selection.terms} for sensor in result.sensors]
    return tuple((name, tuple(column.get(name, "") for column in verdicts)) for name in names)


@dataclass(frozen=True, slots=True)
class RunGroup:
    """Runs with their printed ranges, and the components that share them."""

    title: str
    runs: tuple[tuple[RunSummary, tuple[tuple[str, str, str, str], ...]], ...]


def run_groups(result: StudyResult) -> tuple[RunGroup, ...]:
    """Gather the runs of every component, once where components share them."""
    sharing: dict[tuple[int, ...], list[SensorResult]] = {}
    for sensor in result.sensors:
        sharing.setdefault(tuple(map(id, sensor.runs)), []).append(sensor)
    return tuple(
        RunGroup(
            listed([sensor.id for sensor in sensors]),
            tuple((run, range_texts(run, sensors[0].kind)) for run in sensors[0].runs),
        )
        for sensors in sharing.values()
    )


def sources(result: StudyResult) -> tuple[dict[str, Any], ...]:
    """Each file once, with the columns that all components take from it."""
    files: dict[tuple[str, str], dict[str, Any]] = {}
    for source in (run.source for sensor in result.sensors for run in sensor.runs):
        entry = {"file": source.file, "sha256": source.sha256, "columns": {}}
        files.setdefault((source.file, source.sha256), entry)["columns"] |= dict.fromkeys(source.columns)
    return tuple(files.values())
