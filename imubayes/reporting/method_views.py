"""What the report shows of the other methods, of the prior, of the reduced model and of what is missing."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.reporting import method_figures
from imubayes.reporting.chain_words import sentence
from imubayes.reporting.method_glance import glance
from imubayes.reporting.method_words import (
    called,
    decided,
    depending,
    difference,
    disagreement_sentences,
    found_sentence,
    group_sentences,
    predictive_sentence,
    prior_sentence,
    reduced_sentence,
    spoken,
    unasked_sentences,
    votes_title,
)
from imubayes.reporting.rows import own_names
from imubayes.reporting.words import models_text

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.reporting.canvas import Panel
    from imubayes.selection.criteria import Criterion
    from imubayes.selection.panel import Panel as Methods
    from imubayes.selection.sindy import Sparse

MOST_CURVES = 6
"""Terms whose inclusion is drawn over prior widths: those that it moves most."""

MOST_DEPENDENCES = 3
"""Inputs against which a misfit is drawn: the worst."""

MOST_DISAGREEMENTS = 12
"""Disagreements that the report explains."""

ON_THRESHOLDS = ("stlsq", "sr3")
"""Optimizers whose path goes over a threshold."""


@dataclass(frozen=True, slots=True)
class CriterionRow:
    """A criterion as it is printed; its best subset as the difference from the decision's model."""

    name: str
    model: str
    value: str
    lead: str
    samples: str
    compared: str
    note: str


@dataclass(frozen=True, slots=True)
class SparseRow:
    """A sparse regression as it is printed: supports as differences from the decision's model."""

    name: str
    model: str
    stable: str
    cut: str
    false_bound: str


@dataclass(frozen=True, slots=True)
class MethodsView:
    """The other methods on one component.

    Attributes
    ----------
    glance : every method's vote on every term; None where figures are not drawn.
    title : its finding, where it is not drawn.
    disagreements, more_disagreements : in words, and how many more there are.
    criteria, sparse : rows of the tables.
    paths : coefficients against threshold.
    prior : does a verdict hang on the prior, in words.
    widths : inclusion over prior widths; None where nothing depends on them, or without figures.
    reduced, reduced_path : the reduced model in words and as a figure.
    unasked : what is left out and why, in words.
    """

    glance: Panel | None
    title: str
    disagreements: tuple[str, ...]
    more_disagreements: int
    criteria: tuple[CriterionRow, ...]
    sparse: tuple[SparseRow, ...]
    paths: tuple[Panel, ...]
    prior: str
    widths: Panel | None
    reduced: str
    reduced_path: Panel | None
    unasked: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MisfitView:
    """What the residuals hold that the library does not: in words, and the worst dependences drawn."""

    sentences: tuple[str, ...]
    panels: tuple[Panel, ...]
    more: int


@dataclass(frozen=True, slots=True)
class BesideView:
    """What stands beside the exact posterior over the models of one component.

    Attributes
    ----------
    methods : None where no other method was run.
    misfit : None where it was not looked for.
    groups : how probable it is that one of a group is in the model.
    """

    methods: MethodsView | None
    misfit: MisfitView | None
    groups: tuple[str, ...]


def beside_view(sensor: SensorResult, key: str, *, drawn: bool, own_rows: bool) -> BesideView:
    """Prepare what stands beside the posterior over the models.

    Parameters
    ----------
    key : identifier of the component in the page.
    drawn : whether the component has figures.
    own_rows : whether its residuals are drawn with it, and not with another component.
    """
    return BesideView(
        methods=methods_view(sensor, sensor.panel, key, drawn=drawn) if sensor.panel else None,
        misfit=misfit_view(sensor, key, drawn=drawn and own_rows),
        groups=group_sentences(sensor.selection),
    )


def methods_view(sensor: SensorResult, panel: Methods, key: str, *, drawn: bool) -> MethodsView:
    """Prepare the methods of a panel; without figures where none are drawn."""
    own, kept = own_names(sensor.selection), decided(sensor.selection)
    votes, thresholds = panel.votes, [one for one in panel.sindy if one.optimizer in ON_THRESHOLDS]
    shown = depending(panel.sensitivity, sensor.selection, own)[:MOST_CURVES]
    reasons = disagreement_sentences(votes, sensor.selection)
    draws_widths = drawn and bool(shown)
    return MethodsView(
        glance=glance(votes, sensor.selection, own, f"{key}g") if drawn and votes.terms else None,
        title=votes_title(votes, sensor.selection, own),
        disagreements=reasons[:MOST_DISAGREEMENTS],
        more_disagreements=max(len(reasons) - MOST_DISAGREEMENTS, 0),
        criteria=tuple(criterion_row(one, kept, own) for one in panel.criteria),
        sparse=tuple(sparse_row(one, kept, own) for one in panel.sindy),
        paths=tuple(
            method_figures.threshold_path(one, kept, own, f"{key}h{n}") for n, one in enumerate(thresholds)
        )
        if drawn
        else (),
        prior=prior_sentence(panel.sensitivity, sensor.selection.costs, own),
        widths=method_figures.prior_widths(panel.sensitivity, shown, sensor.selection.costs, own, f"{key}p")
        if draws_widths
        else None,
        reduced=reduced_sentence(panel.reduced, sensor.kind) if panel.reduced else "",
        reduced_path=method_figures.reduced_path(panel.reduced, sensor.kind, f"{key}e")
        if drawn and panel.reduced and panel.reduced.path
        else None,
        unasked=unasked_sentences(panel.unasked),
    )


def criterion_row(one: Criterion, kept: tuple[str, ...], own: Mapping[str, str]) -> CriterionRow:
    """Print a criterion."""
    model = [own.get(name, name) for name in one.model]
    return CriterionRow(
        name=called(one.name),
        model=difference(model, kept) if one.compared else "–",
        value=_number(one.value, ",.1f"),
        lead=_number(one.lead, ",.1f"),
        samples=_number(one.samples, ",.0f"),
        compared=_compared(one),
        note=_remark(one),
    )


def _remark(one: Criterion) -> str:
    """Note with its criterion's name in front, as a sentence with the real sign of minus."""
    note = re.sub(r"(?<![\w-])-(?=\d)", "−", one.note)
    return sentence(spoken(f"{one.name}: {note}")) if note else ""


def _compared(one: Criterion) -> str:
    if not one.compared:
        return "none"
    return f"all {models_text(one.compared)}" if one.exact else f"{one.compared:,} likely ones"


def sparse_row(one: Sparse, kept: tuple[str, ...], own: Mapping[str, str]) -> SparseRow:
    """Print a sparse regression."""
    return SparseRow(
        name=called(one.optimizer),
        model=difference([own.get(name, name) for name in one.model], kept),
        stable=difference([own.get(name, name) for name in one.stable], kept),
        cut=_number(one.cut, ".2f"),
        false_bound=_number(one.false_bound, ".2g") if one.false_bound < len(one.stable) else "no bound",
    )


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "–"


def misfit_view(sensor: SensorResult, key: str, *, drawn: bool) -> MisfitView | None:
    """Prepare what the residuals hold that the library does not; None where it was not looked for."""
    if sensor.misfit is None:
        return None
    found = sensor.misfit.found
    shown = found[:MOST_DEPENDENCES] if drawn else ()
    sentences = (found_sentence(sensor.misfit, sensor.kind), predictive_sentence(sensor.misfit))
    return MisfitView(
        sentences=tuple(text for text in sentences if text),
        panels=tuple(
            method_figures.dependence(one, sensor.kind, f"{key}m{n}") for n, one in enumerate(shown)
        ),
        more=len(found) - len(shown) if drawn else 0,
    )
