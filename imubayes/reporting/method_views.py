"""What the other methods say of the terms, in words and as blocks of the report."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from imubayes.campaign import SensorResult
from imubayes.population import STEPS
from imubayes.population.lots import DECISION, Agreement, LotResult, LotStudy, agreements
from imubayes.reporting.blocks import Block, Prose, Section, Table, Text, quiet, strong, verdict
from imubayes.reporting.lots_words import class_name
from imubayes.reporting.rounding import in_unit, minus, models_text, on_output, percent
from imubayes.reporting.rows import in_own_names, sentence
from imubayes.selection.compensations import Reduced
from imubayes.selection.decision import Selection
from imubayes.selection.panel import Panel as Methods
from imubayes.selection.panel import Unasked, Votes
from imubayes.selection.sensitivity import Sensitivity
from imubayes.selection.verdicts import Costs, listed
from imubayes.sensors.terms import Kind
from imubayes.units import counted

METHODS = {
    "evidence": "evidence",
    "g-prior": "g-prior",
    "aic": "AIC",
    "aicc": "AICc",
    "bic": "BIC",
    "hqc": "HQC",
    "ebic": "EBIC",
    "waic": "WAIC",
    "loo": "dwell left out",
    "leave_one_run_out": "run left out",
    "stlsq": "STLSQ",
    "sr3": "SR3",
    "ssr": "SSR",
    "frols": "FROLS",
    "collapsed": "emcee",
}
"""How a method is called in print."""

FEW = 3
"""Terms that a title names."""

MOST_DISAGREEMENTS = 12
"""Disagreements that the report explains."""

CRITERIA_HEAD = ("criterion", "best subset", "value", "lead", "effective samples", "compared")

SPARSE_HEAD = (
    "sparse regression", "chosen support", "stable support", "frequency from", "false terms, at most",
)  # fmt: skip

VOTES = (
    "● a term in the method's own model, ○ one that is not, – a method that says nothing of it; ≠ where the"
    " method does not share the decision, or takes a side where the test cannot tell. How strongly each"
    " method is for a term is in result.json."
)

REDUCED = (
    "What is lost is the rms difference over the test's inputs from what the whole posterior predicts. It is"
    " a summary for use, not another verdict: a term that is needed may matter little for predictions."
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


def called(method: str) -> str:
    """Name of a method in print; one that is not known keeps its own."""
    return METHODS.get(method, method.replace("_", " "))


def spoken(text: str) -> str:
    """Put the methods' printed names into a sentence."""
    told = _NAMES.sub(lambda match: METHODS[match[0]], text)
    return told[:1].upper() + told[1:]


_NAMES = re.compile(r"\b(" + "|".join(METHODS) + r")\b")

UNTOLD = {"inseparable": "the test sees only in combination with others", "unresolved": "the noise hides"}
"""Verdicts that are no decision on a term, and why there is none."""


def untold(selection: Selection) -> dict[str, str]:
    """Verdict of the terms that the test excites and cannot tell, by name."""
    return {term.name: term.verdict for term in selection.terms if term.verdict in UNTOLD}


def decided(selection: Selection) -> tuple[str, ...]:
    """Terms that the decision keeps, without those that the test cannot tell."""
    open_to = {*untold(selection), *(t.name for t in selection.terms if t.verdict == "untested")}
    return tuple(name for name in selection.model if name not in open_to)


def votes_title(votes: Votes, selection: Selection) -> str:
    """Say on what the methods agree, and on which terms they do not, of those that the test can tell."""
    told = ~np.isnan(votes.keeps)
    voters = int(told.any(axis=1).sum())
    clear = np.array([name not in untold(selection) for name in votes.terms], dtype=bool)
    count, kept = told.sum(axis=0), np.nansum(votes.keeps, axis=0)
    common = int(((kept == count) & (count > 0) & clear).sum())
    split = [j for j in range(len(votes.terms)) if clear[j] and 0 < kept[j] < count[j]]
    kept_by_all = counted(common, "term") if common else "no terms"
    agreed = f"All {voters} methods keep {'' if split or not common else 'the same '}{kept_by_all}"
    parts = [f"{agreed} in common" if split else agreed]
    if len(split) == 1:
        parts.append(f"{kept[split[0]]:.0f} of {count[split[0]]} keep {votes.terms[split[0]]}")
    elif split:
        few = listed(votes.terms[j] for j in split) if len(split) <= FEW else f"{len(split)} others"
        parts.append(f"they differ on {few}")
    if not clear.all():
        parts.append(f"the test cannot tell {(~clear).sum()} more")
    return "; ".join(parts)


def disagreement_sentences(votes: Votes, selection: Selection) -> tuple[str, ...]:
    """Say why methods do not share the decision; terms that the test cannot tell are put together."""
    unclear = untold(selection)
    alike: dict[tuple[tuple[str, ...], str], list[str]] = {}
    for disagreement in votes.disagreements:
        if disagreement.term in unclear:
            alike.setdefault((disagreement.methods, unclear[disagreement.term]), []).append(disagreement.term)
    return (
        *(sentence(spoken(vote.text)) for vote in votes.disagreements if vote.term not in unclear),
        *(
            spoken(f"{listed(methods)} {'keeps' if len(methods) == 1 else 'keep'} {listed(terms)}, which")
            + f" {UNTOLD[verdict]}."
            for (methods, verdict), terms in alike.items()
        ),
    )


def difference(model: Sequence[str], decided: Sequence[str]) -> str:
    """Write a model as its difference from the decision's.

    >>> difference(["b0", "c_ij"], ["b0", "b3"])
    '+ c_ij, - b3'
    >>> difference(["b0"], ["b0"])
    'as decided'
    """
    more = [f"+ {name}" for name in model if name not in decided]
    less = [f"- {name}" for name in decided if name not in model]
    return ", ".join([*more, *less]) or "as decided"


def prior_sentence(sensitivity: Sensitivity, costs: Costs) -> str:
    """Say whether a verdict hangs on the prior's width, and what the g-prior thinks."""
    swing = sensitivity.swing
    said = ["No verdict depends on the prior: none changes between a third and three times its width."]
    if swing:
        cross = "crosses" if len(swing) == 1 else "cross"
        lines = f"{costs.not_needed:.2g}, {costs.keep:.2g} or {costs.needed:.2g}"
        wide = f"Between a third and three times the prior's width {_few(swing)} {cross} a threshold of"
        said = [f"{wide} inclusion ({lines})."]
    nominal = sensitivity.inclusion[int(np.argmin(np.abs(np.log(sensitivity.widths))))]
    known = np.isfinite(sensitivity.g_prior)
    if known.any():
        differs = known & ((sensitivity.g_prior >= costs.keep) != (nominal >= costs.keep))
        apart = [sensitivity.names[j] for j in np.flatnonzero(differs)]
        told = f"differs on {_few(apart)}" if apart else "keeps the same terms"
        said.append(f"As a second opinion, the hyper-g prior {told}.")
    if sensitivity.left_out:
        without = _few(sensitivity.left_out)
        said.append(f"It cannot have {without}, which the test sees only in combination with others.")
    return " ".join(said)


def _few(names: Sequence[str]) -> str:
    return listed(names) if len(names) <= 2 * FEW else counted(len(names), "term")


def unasked_sentences(unasked: Sequence[Unasked]) -> tuple[str, ...]:
    """Say which opinions are left out and why, a sentence for each reason.

    >>> from imubayes.selection.panel import Unasked
    >>> unasked_sentences([Unasked("ssr", "ValueError, nothing to drop")])
    ('Left out: SSR (ValueError, nothing to drop).',)
    """
    methods: dict[str, list[str]] = {}
    for opinion in unasked:
        methods.setdefault(opinion.reason, []).append(called(opinion.method))
    return tuple(f"Left out: {listed(names)} ({reason})." for reason, names in methods.items())


def reduced_sentence(reduced: Reduced, kind: Kind) -> str:
    """Say how small a model predicts the test as well as the whole posterior does."""
    lost, budget = (in_unit(on_output(size, kind)) for size in (reduced.lost, reduced.budget))
    if not reduced.terms:
        return (
            f"No term is worth keeping for predictions: without any, {lost} rms is lost of {budget} allowed."
        )
    single = len(reduced.terms) == 1
    count, together = (
        ("1 term predicts", "loses") if single else (f"{len(reduced.terms)} terms predict", "together lose")
    )
    return (
        f"{count} the test as well as the whole posterior: {listed(reduced.terms)} {together} {lost} rms, "
        f"of {budget} that the posterior itself leaves open."
    )


def methods_sections(sensor: SensorResult, panel: Methods, *, drawn: bool) -> Iterator[Section]:
    """What the methods of a panel say; without their tables where a component has no figures."""
    selection, panel = sensor.selection, in_own_names(panel, sensor.selection)
    votes, reasons = panel.votes, disagreement_sentences(panel.votes, selection)
    more = len(reasons) - MOST_DISAGREEMENTS
    left = [f"{more} more are in result.json."] if more > 0 else []
    said = Prose([*reasons[:MOST_DISAGREEMENTS], *left], "list")
    blocks: list[Block] = [Prose(f"{votes_title(votes, selection)}."), said]
    if drawn and votes.terms:
        blocks[1:1] = [vote_table(votes, selection)]
        blocks += opinion_tables(sensor.id, panel, decided(selection))
    yield Section("What other methods say", blocks)
    prior = Prose(prior_sentence(panel.sensitivity, selection.costs))
    yield Section("How much the prior matters", [prior])
    if panel.reduced:
        note = Prose(REDUCED if drawn else "", "note")
        said = Prose(reduced_sentence(panel.reduced, sensor.kind))
        yield Section("The smallest model that predicts as well", [said, note])


def vote_table(votes: Votes, selection: Selection) -> Table:
    """What every method says of every term that the test excites."""
    verdicts = {term.name: term.verdict for term in selection.terms}
    apart = {
        (method, disagreement.term) for disagreement in votes.disagreements for method in disagreement.methods
    }
    rows: list[tuple[Text, ...]] = []
    for name, keeps in zip(votes.terms, votes.keeps.T.tolist(), strict=True):
        marks = ["–" if math.isnan(keep) else "●" if keep else "○" for keep in keeps]
        told = zip(votes.methods, marks, strict=True)
        cells = [strong(f"≠ {mark}") if (method, name) in apart else mark for method, mark in told]
        rows.append((name, *cells, verdict(verdicts.get(name, ""))))
    head = ("term", *map(called, votes.methods), "verdict")
    return Table("Votes of the methods by term", head, rows, f"t{'m' * len(votes.methods)}t", VOTES)


def opinion_tables(sensor: str, panel: Methods, kept: tuple[str, ...]) -> Iterator[Table]:
    """Criteria and sparse regressions; subsets are differences from the terms that the decision keeps."""
    rows = []
    for criterion in panel.criteria:
        count = criterion.compared
        model = _support(difference(criterion.model, kept)) if count else "–"
        value, lead = (minus(_number(size, ",.1f")) for size in (criterion.value, criterion.lead))
        several = f"all {models_text(count)}" if criterion.exact else f"{count:,} likely ones"
        told = (model, value, lead, _number(criterion.samples, ",.0f"), several if count else "none")
        rows.append((called(criterion.name), *told))
    if rows:
        notes = (
            sentence(spoken(f"{criterion.name}: {criterion.note}"))
            for criterion in panel.criteria
            if criterion.note
        )
        note = re.sub(r"(?<![\w-])-(?=\d)", "−", " ".join((CRITERIA, *notes)))
        yield Table(f"Criteria on {sensor}", CRITERIA_HEAD, rows, "tfnnnt", note)
    rows = []
    for sparse in panel.sindy:
        supports = (_support(difference(names, kept)) for names in (sparse.model, sparse.stable))
        bound = _number(sparse.false_bound, ".2g") if sparse.false_bound < len(sparse.stable) else "no bound"
        rows.append((called(sparse.optimizer), *supports, _number(sparse.cut, ".2f"), bound))
    if rows:
        yield Table(f"Sparse regressions on {sensor}", SPARSE_HEAD, rows, "tffn", SPARSE)


def _support(text: str) -> str:
    return quiet(text) if text == "as decided" else minus(text)


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "–"


METHODS_NOTE = (
    "The share of the decision's sure answers, a term of a unit each, that a method shares. Keeps more, keeps"
    " fewer: terms that it keeps and the decision says are not needed, and the other way round, with the"
    " number of units. By the truth, of all terms that the test excites: false, kept of those below one"
    " posterior sd of the test; missed, left out of those above eight. emcee keeps what is not zero with 95 %"
    " under the full library."
)

MOST_DISPUTED = 4
"""Terms that a cell names."""


def methods_beside(result: LotResult) -> Iterator[Section]:
    """What the other methods say of the units that they were asked about; nothing where they were not."""
    names, classes = result.study.library.names, result.classes
    every = agreements([unit for grade in classes for unit in grade.units], names)
    if not every:
        return
    each = [{told.method: told for told in agreements(grade.units, names)} for grade in classes]
    rows = []
    for agreement in every:
        method = "the decision" if agreement.method == DECISION else called(agreement.method)
        beside = [*(own.get(agreement.method) for own in each), agreement]
        shares = (percent(told.share.value) if told and told.of else "–" for told in beside)
        wrong = ("{} of {}".format(*pair) for pair in (agreement.false, agreement.missed))
        rows.append((method, *shares, _most(agreement.keeps), _most(agreement.drops), *wrong))
    names_of = (class_name(grade.sensor_class) for grade in classes)
    head = ("method", *names_of, "all", "keeps more", "keeps fewer", "false", "missed")
    table = Table("Methods beside the decision", head, rows, f"t{'n' * (len(classes) + 1)}ttn", METHODS_NOTE)
    rhats = [unit.rhat for grade in classes for unit in grade.units if not math.isnan(unit.rhat)]
    said = Prose(_methods_sentence(result.study, every, rhats))
    yield Section("Do the methods agree?", [said, table], "methods")


def _most(terms: Mapping[str, int]) -> str:
    """Terms on which a method differs most often, with the number of units: ``b2 (3), c_ij and 2 more``."""
    return listed((f"{name} ({count})" for name, count in terms.items()), MOST_DISPUTED) if terms else "–"


def _methods_sentence(study: LotStudy, methods: Sequence[Agreement], rhats: Sequence[float]) -> str:
    """Say about how many units other methods were asked, and how far they share the decision.

    `rhats` are those of the units that chains were asked about.
    """
    others = [agreement for agreement in methods if agreement.method != DECISION]
    whole = study.units * study.lots * len(study.specs)
    most = max(agreement.units for agreement in methods)
    asked = f"{counted(len(others), 'other method')} were asked about {most} of the {whole} units"
    which = "the first of each lot" if study.methods == 1 else f"the first {study.methods} of each lot"
    told = [agreement for agreement in others if agreement.of]
    if not told:
        return f"{asked} ({which}), and have no answer beside the decision's."
    chains = (
        f" Of these units chains, with the noise sampled, were asked about {len(rhats)}, the first of each"
        f" class that they can be run for; their R-hat is {max(rhats):.3f} at most, after {STEPS} steps or"
        " before."
        if rhats
        else ""
    )
    low, *_, high = sorted((told[0], *told), key=lambda agreement: agreement.share.value)
    same, of = (
        sum(round(agreement.share.value * agreement.of) for agreement in told),
        sum(agreement.of for agreement in told),
    )
    return (
        f"{asked} ({which}). They share {percent(same / of)} of the decision's sure answers on a term of a"
        f" unit: least {called(low.method)} with {percent(low.share.value)}, most {called(high.method)} with"
        f" {percent(high.share.value)}. What the decision leaves open is not counted.{chains}"
    )
