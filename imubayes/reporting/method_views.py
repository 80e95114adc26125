"""What the report shows of the other methods, of the prior, of the reduced model and of what is missing."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from imubayes.reporting import method_figures
from imubayes.reporting.blocks import Block, Figure, Prose, Section, Table, quiet
from imubayes.reporting.chain_words import sentence
from imubayes.reporting.method_glance import glance
from imubayes.reporting.method_words import (
    called,
    decided,
    depending,
    difference,
    disagreement_sentences,
    found_sentence,
    predictive_sentence,
    prior_sentence,
    reduced_sentence,
    spoken,
    unasked_sentences,
    votes_title,
)
from imubayes.reporting.rounding import minus
from imubayes.reporting.rows import own_names
from imubayes.reporting.words import models_text

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
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


CRITERIA_HEAD = ("criterion", "best subset", "value", "lead", "effective samples", "compared")

SPARSE_HEAD = (
    "sparse regression", "chosen support", "stable support", "frequency from", "false terms, at most",
)  # fmt: skip

GLANCE = (
    "A row a term, a column a method, at the right the verdict. The darker a cell, the more the method is"
    " for the term: a probability for the evidence and the g-prior, a weight for the criteria, a"
    " frequency over resampled campaigns for the sparse regressions. A dot is a term in the method's own"
    " model; a dash is a method that says nothing of it. Framed in vermilion, with ≠ at the end of the"
    " row: the method does not share the decision, or takes a side where the test cannot tell."
)

PATHS = (
    "From left to right the threshold rises and terms drop out where their lines end. A detectable effect"
    " is the size at which the noise hides a term, so one threshold means the same for all. Blue: in the"
    " support that is chosen at the dashed line; black: kept by the decision only; grey: in neither."
)

REDUCED = (
    "Each row adds a term to those above it, or is another set of terms (“best 3”); what is lost is the"
    " rms difference over the test's inputs from what the whole posterior predicts. It is a summary for"
    " use, not another verdict: a term that is needed may matter little for predictions."
)

CRITERIA = (
    "Subsets are written as their difference from the terms that the decision keeps, without those that"
    " the test cannot tell. Values are on the deviance scale, smaller is better; the lead is how much"
    " worse the next subset is, and below 2 it says little. Effective samples are what rows of coloured"
    " noise are worth in a criterion's penalty."
)

SPARSE = (
    "Stable terms are chosen in at least this share of random halves of the dwells; the last column"
    " bounds how many of them are expected to be false. Frequencies are not probabilities."
)

MISFIT = (
    "What the residuals hold beyond the library, with ± 2 sd, where the input has that value; p is"
    " corrected for the number of inputs that were looked at and for the other residual tests of the"
    " study, and says something below 0.01."
)


def methods_sections(sensor: SensorResult, panel: Methods, key: str, *, drawn: bool) -> Iterator[Section]:
    """What the methods of a panel say; without figures where none are drawn.

    Parameters
    ----------
    key : identifier of the component in the page.
    drawn : whether the component has figures.
    """
    own, selection = own_names(sensor.selection), sensor.selection
    yield Section("What other methods say", [*_votes(sensor, panel, key, drawn=drawn)])
    shown = depending(panel.sensitivity, selection, own)[:MOST_CURVES]
    widths = (
        [method_figures.prior_widths(panel.sensitivity, shown, selection.costs, own, f"{key}p")]
        if drawn and shown
        else []
    )
    prior = Prose(prior_sentence(panel.sensitivity, selection.costs, own))
    yield Section("How much the prior matters", [prior, Figure(widths)])
    if panel.reduced:
        path = [method_figures.reduced_path(panel.reduced, sensor.kind, f"{key}e")]
        figure = [Figure(path, REDUCED)] if drawn and panel.reduced.path else []
        said = Prose(reduced_sentence(panel.reduced, sensor.kind))
        yield Section("The smallest model that predicts as well", [said, *figure])


def _votes(sensor: SensorResult, panel: Methods, key: str, *, drawn: bool) -> Iterator[Block]:
    """Every method's vote on every term, where they disagree and why, and each method in numbers."""
    own, kept = own_names(sensor.selection), decided(sensor.selection)
    votes = panel.votes
    is_drawn = drawn and bool(votes.terms)
    if is_drawn:
        yield Figure([glance(votes, sensor.selection, own, f"{key}g")], GLANCE)
    else:
        yield Prose(f"{votes_title(votes, sensor.selection, own)}.")
    reasons = list(disagreement_sentences(votes, sensor.selection))
    more = len(reasons) - MOST_DISAGREEMENTS
    left = [f"{more} more are in result.json."] if more > 0 else []
    yield Prose(reasons[:MOST_DISAGREEMENTS] + left, "list")
    if is_drawn:
        yield from _tables(sensor, panel, kept, own)
        thresholds = [one for one in panel.sindy if one.optimizer in ON_THRESHOLDS]
        paths = [
            method_figures.threshold_path(one, kept, own, f"{key}h{n}") for n, one in enumerate(thresholds)
        ]
        if paths:
            yield Figure(paths, PATHS)
    yield Prose(unasked_sentences(panel.unasked))


def _tables(
    sensor: SensorResult, panel: Methods, kept: tuple[str, ...], own: Mapping[str, str]
) -> Iterator[Table]:
    if panel.criteria:
        rows = [criterion_row(one, kept, own) for one in panel.criteria]
        note = " ".join([CRITERIA, *filter(None, map(_remark, panel.criteria))])
        yield Table(f"Criteria on {sensor.id}", CRITERIA_HEAD, rows, "tfnnnt", note)
    if panel.sindy:
        rows = [sparse_row(one, kept, own) for one in panel.sindy]
        yield Table(f"Sparse regressions on {sensor.id}", SPARSE_HEAD, rows, "tffn", SPARSE)


def criterion_row(one: Criterion, kept: tuple[str, ...], own: Mapping[str, str]) -> tuple[str, ...]:
    """Print a criterion; its best subset as the difference from the decision's model."""
    model = difference([own.get(name, name) for name in one.model], kept) if one.compared else "–"
    value, lead = (minus(_number(size, ",.1f")) for size in (one.value, one.lead))
    return (called(one.name), _support(model), value, lead, _number(one.samples, ",.0f"), _compared(one))


def _support(text: str) -> str:
    return quiet(text) if text == "as decided" else minus(text)


def _remark(one: Criterion) -> str:
    """Note with its criterion's name in front, as a sentence with the real sign of minus."""
    note = re.sub(r"(?<![\w-])-(?=\d)", "−", one.note)
    return sentence(spoken(f"{one.name}: {note}")) if note else ""


def _compared(one: Criterion) -> str:
    if not one.compared:
        return "none"
    return f"all {models_text(one.compared)}" if one.exact else f"{one.compared:,} likely ones"


def sparse_row(one: Sparse, kept: tuple[str, ...], own: Mapping[str, str]) -> tuple[str, ...]:
    """Print a sparse regression; supports as differences from the decision's model."""
    supports = ([own.get(name, name) for name in names] for names in (one.model, one.stable))
    chosen, stable = (_support(difference(names, kept)) for names in supports)
    bound = _number(one.false_bound, ".2g") if one.false_bound < len(one.stable) else "no bound"
    return (called(one.optimizer), chosen, stable, _number(one.cut, ".2f"), bound)


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "–"


def misfit_sections(sensor: SensorResult, key: str, *, drawn: bool) -> Iterator[Section]:
    """What the residuals hold that the library does not; nothing where it was not looked for."""
    if sensor.misfit is None:
        return
    found = sensor.misfit.found
    sentences = (found_sentence(sensor.misfit, sensor.kind), predictive_sentence(sensor.misfit))
    blocks: list[Block] = [Prose(" ".join(filter(None, sentences)))]
    shown = found[:MOST_DEPENDENCES] if drawn else ()
    if shown:
        left = len(found) - len(shown)
        more = f" {left} more are in result.json." if left else ""
        panels = [method_figures.dependence(one, sensor.kind, f"{key}m{n}") for n, one in enumerate(shown)]
        blocks.append(Figure(panels, f"{MISFIT}{more}"))
    yield Section("Does the library miss something?", blocks)
