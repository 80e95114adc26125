"""What the other methods say, in words made from their numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.misfit import HYSTERESIS, TIME
from imubayes.inference.residuals import SUSPECT
from imubayes.reporting.chain_words import sentence
from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    measured,
    per_unit,
    pretty,
    probability,
)
from imubayes.selection.verdicts import listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.misfit import Dependence, Misfit
    from imubayes.selection.decision import Selection
    from imubayes.selection.panel import Unasked
    from imubayes.selection.reduced import Reduced
    from imubayes.selection.sensitivity import Sensitivity
    from imubayes.selection.verdicts import Costs
    from imubayes.selection.votes import Votes
    from imubayes.sensors.terms import Kind


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
}
"""How a method is called in print."""

FEW = 3
"""Terms that a title names."""


def called(method: str) -> str:
    """Name of a method in print; one that is not known keeps its own."""
    return METHODS.get(method, method.replace("_", " "))


def spoken(text: str) -> str:
    """Put the methods' printed names into a sentence.

    Examples
    --------
    >>> spoken("evidence and leave_one_run_out keep b3")
    'Evidence and run left out keep b3'
    """
    told = _NAMES.sub(lambda found: METHODS[found[0]], text)
    return told[:1].upper() + told[1:]


_NAMES = re.compile(r"\b(" + "|".join(METHODS) + r")\b")


UNTOLD = {
    "inseparable": "the test sees only in combination with others",
    "unresolved": "the noise hides",
}
"""Verdicts that are no decision on a term, and why there is none."""


def untold(selection: Selection) -> dict[str, str]:
    """Verdict of the terms that the test excites and cannot tell, by name."""
    return {term.name: term.verdict for term in selection.terms if term.verdict in UNTOLD}


def decided(selection: Selection) -> tuple[str, ...]:
    """Terms that the decision keeps, without those that the test cannot tell."""
    open_to = {*untold(selection), *(t.name for t in selection.terms if t.verdict == "untested")}
    return tuple(name for name in selection.model if name not in open_to)


def votes_title(votes: Votes, selection: Selection, names: Mapping[str, str]) -> str:
    """Say on what the methods agree, and on which terms they do not, of those that the test can tell.

    Parameters
    ----------
    names : of the terms in print, by the names that the votes have.
    """
    told = ~np.isnan(votes.keeps)
    voters = int(told.any(axis=1).sum())
    terms = [names.get(name, name) for name in votes.terms]
    clear = np.array([name not in untold(selection) for name in terms], dtype=bool)
    count, kept = told.sum(axis=0), np.nansum(votes.keeps, axis=0)
    common = int(((kept == count) & (count > 0) & clear).sum())
    split = [j for j in range(len(terms)) if clear[j] and 0 < kept[j] < count[j]]
    agreed = f"All {voters} methods keep {'' if split or not common else 'the same '}{_terms(common)}"
    parts = [f"{agreed} in common" if split else agreed, *_dispute(split, terms, kept, count)]
    if not clear.all():
        parts.append(f"the test cannot tell {(~clear).sum()} more")
    return "; ".join(parts)


def _dispute(
    split: Sequence[int], terms: Sequence[str], kept: FloatArray, count: NDArray[np.int64]
) -> Iterator[str]:
    if len(split) == 1:
        yield f"{kept[split[0]]:.0f} of {count[split[0]]} keep {terms[split[0]]}"
    elif split:
        few = listed(terms[j] for j in split) if len(split) <= FEW else f"{len(split)} others"
        yield f"they differ on {few}"


def disagreement_sentences(votes: Votes, selection: Selection) -> tuple[str, ...]:
    """Say why methods do not share the decision; terms that the test cannot tell are put together."""
    unclear = untold(selection)
    alike: dict[tuple[tuple[str, ...], str], list[str]] = {}
    for one in votes.disagreements:
        if one.term in unclear:
            alike.setdefault((one.methods, unclear[one.term]), []).append(one.term)
    return (
        *(sentence(spoken(one.text)) for one in votes.disagreements if one.term not in unclear),
        *(
            spoken(f"{listed(methods)} {'keeps' if len(methods) == 1 else 'keep'} {listed(terms)}, which")
            + f" {UNTOLD[verdict]}."
            for (methods, verdict), terms in alike.items()
        ),
    )


def _terms(count: int) -> str:
    return counted(count, "term") if count else "no terms"


def difference(model: Sequence[str], decided: Sequence[str]) -> str:
    """Write a model as its difference from the decision's.

    Examples
    --------
    >>> difference(["b0", "c_ij"], ["b0", "b3"])
    '+ c_ij, - b3'
    >>> difference(["b0"], ["b0"])
    'as decided'
    """
    more = [f"+ {name}" for name in model if name not in decided]
    less = [f"- {name}" for name in decided if name not in model]
    return ", ".join([*more, *less]) or "as decided"


def depending(sensitivity: Sensitivity, selection: Selection, names: Mapping[str, str]) -> tuple[int, ...]:
    """Pick the candidates that are undecided or change their verdict with the prior, widest range first."""
    undecided = {term.name for term in selection.terms if term.verdict == "undecided"}
    shown = [
        j
        for j, name in enumerate(sensitivity.names)
        if name in sensitivity.swing or names.get(name, name) in undecided
    ]
    reach = np.ptp(sensitivity.inclusion, axis=0)
    return tuple(sorted(shown, key=lambda j: -reach[j]))


def prior_sentence(sensitivity: Sensitivity, costs: Costs, names: Mapping[str, str]) -> str:
    """Say whether a verdict hangs on the prior's width, and what the g-prior thinks.

    Parameters
    ----------
    costs : of the decision, which give its thresholds.
    """
    swing = [names.get(name, name) for name in sensitivity.swing]
    lines = f"{costs.not_needed:.2g}, {costs.keep:.2g} or {costs.needed:.2g}"
    cross = "crosses" if len(swing) == 1 else "cross"
    found = (
        f"Between a third and three times the prior's width {_few(swing)} {cross} a threshold of inclusion "
        f"({lines})."
        if swing
        else "No verdict depends on the prior: none changes between a third and three times its width."
    )
    return " ".join([found, *_second_opinion(sensitivity, costs.keep, names)])


def _second_opinion(sensitivity: Sensitivity, keep: float, names: Mapping[str, str]) -> Iterator[str]:
    nominal = sensitivity.inclusion[int(np.argmin(np.abs(np.log(sensitivity.widths))))]
    known = np.isfinite(sensitivity.g_prior)
    if known.any():
        differs = known & ((sensitivity.g_prior >= keep) != (nominal >= keep))
        apart = [names.get(sensitivity.names[j], sensitivity.names[j]) for j in np.flatnonzero(differs)]
        told = f"differs on {_few(apart)}" if apart else "keeps the same terms"
        yield f"As a second opinion, the hyper-g prior {told}."
    if sensitivity.left_out:
        without = [names.get(name, name) for name in sensitivity.left_out]
        yield f"It cannot have {_few(without)}, which the test sees only in combination with others."


def _few(names: Sequence[str]) -> str:
    return listed(names) if len(names) <= 2 * FEW else counted(len(names), "term")


def unasked_sentences(unasked: Sequence[Unasked]) -> tuple[str, ...]:
    """Say which opinions are left out and why, a sentence for each reason.

    Examples
    --------
    >>> from imubayes.selection.panel import Unasked
    >>> unasked_sentences([Unasked("ssr", "ValueError, nothing to drop")])
    ('Left out: SSR (ValueError, nothing to drop).',)
    """
    methods: dict[str, list[str]] = {}
    for one in unasked:
        methods.setdefault(one.reason, []).append(called(one.method))
    return tuple(f"Left out: {listed(names)} ({reason})." for reason, names in methods.items())


def reduced_sentence(reduced: Reduced, kind: Kind) -> str:
    """Say how small a model predicts the test as well as the whole posterior does."""
    lost, budget = (_output(size, kind) for size in (reduced.lost, reduced.budget))
    if not reduced.terms:
        return (
            f"No term is worth keeping for predictions: without any, {lost} rms is lost of {budget} allowed."
        )
    one = len(reduced.terms) == 1
    count, together = (
        ("1 term predicts", "loses") if one else (f"{len(reduced.terms)} terms predict", "together lose")
    )
    return (
        f"{count} the test as well as the whole posterior: {listed(reduced.terms)} {together} {lost} rms, "
        f"of {budget} that the posterior itself leaves open."
    )


def _output(size: float, kind: Kind) -> str:
    unit = OUTPUT_UNIT[kind]
    return pretty(str(measured(size / per_unit(unit, OUTPUT_SI[kind]), 0.0, unit)))


def group_sentences(selection: Selection) -> tuple[str, ...]:
    """Say of each group of inseparable terms how probable it is that at least one of them is there."""
    return tuple(
        f"At least one of {listed(terms)} is in the model with probability {probable(chance)}."
        for terms, chance in dict.fromkeys(selection.groups)
    )


def probable(chance: float) -> str:
    """Probability to three digits, never as a bare one or zero.

    Examples
    --------
    >>> probable(0.99997), probable(0.4321), probable(2e-5)
    ('above 0.999', '0.432', 'below 0.001')
    """
    if chance > 0.9995:
        return "above 0.999"
    return "below 0.001" if chance < 0.0005 else f"{chance:.3f}"


def dependence_words(one: Dependence) -> str:
    """Where a dependence shows: ``f_i in run arm``, ``T between heating and cooling in run ramp``."""
    if one.input.startswith(HYSTERESIS):
        return f"{channel_of(one)} between {listed(branches(one))} in run {one.run}"
    return f"{'time' if one.input == TIME else one.input} in run {one.run}"


def left_words(misfit: Misfit, channel: str, kind: Kind) -> str:
    """What the search for what is missing says of one input: the same as the sentence on what it found."""
    if found := [one for one in misfit.found if channel_of(one) == channel]:
        between = f" between {listed(branches(found[0]))}" if found[0].input != channel else ""
        return f"{_output(found[0].size, kind)} rms are left{between}"
    tested = [one.p for one in misfit.dependences if channel_of(one) == channel]
    if not tested:
        return "not tested by itself"
    if min(tested) < SUSPECT:
        return "what is left goes with what is found elsewhere"
    return f"nothing is left beyond chance (p {probability(min(tested))})"


def temperature_sentence(sensor: SensorResult) -> str:
    """Answer whether a polynomial in temperature is enough; empty where none was tested."""
    misfit = sensor.misfit
    tested = [t.name.partition("*")[2] for t in sensor.selection.terms if t.verdict != "untested"]
    degree = max((int(power[1:] or 1) for power in tested if power[:1] == "T"), default=0)
    if misfit is None or not degree or all(channel_of(one) != "T" for one in misfit.dependences):
        return ""
    beside = " beside its rate" if any(power.startswith("dT") for power in tested) else ""
    model = f"a polynomial of degree {degree} in T{beside}"
    left = [one for one in misfit.found if channel_of(one) in ("T", "dT")]
    if not left:
        return f"{sensor.id}: {model} is enough: nothing is left against T or its rate beyond chance."
    shows = listed(f"{_output(one.size, sensor.kind)} rms in {dependence_words(one)}" for one in left)
    return f"{sensor.id}: {model} is not enough: it leaves {shows}."


def channel_of(one: Dependence) -> str:
    """Input channel of a dependence, without what is said of its branches."""
    return one.input.removeprefix(HYSTERESIS)


def branches(one: Dependence) -> tuple[str, str]:
    """Names of the branches on which an input rises and falls."""
    return ("heating", "cooling") if channel_of(one) == "T" else ("rising", "falling")


def missing_sentence(misfit: Misfit | None, *, fits: bool, assumed: Collection[str] = ()) -> str:
    """Say in the first paragraph that the library misses something; empty where it does not.

    Parameters
    ----------
    fits : whether every run's residuals are of the noise's size.
    assumed : names of the runs whose noise was not estimated.
    """
    if misfit is None or not misfit.found:
        return ""
    where = list(dict.fromkeys(dependence_words(one) for one in misfit.found))
    more = f" and {len(where) - FEW} more" if len(where) > FEW else ""
    named = "; ".join(where[:FEW])
    yet = "Yet the" if fits else "The"
    said = f"{yet} data hold something the library does not contain: it shows in {named}{more}."
    if any(one.run in assumed for one in misfit.found):
        return f"{said} Or the noise that was assumed is wrong: let it be estimated."
    return said


def found_sentence(misfit: Misfit, kind: Kind) -> str:
    """Say in printed units where the residuals show that something is missing, or that nothing is."""
    if not misfit.found:
        return misfit.text
    shows = [f"{dependence_words(one)} ({_output(one.size, kind)} rms)" for one in misfit.found]
    return f"There is something the library does not contain: it shows in {'; '.join(shows)}."


def predictive_sentence(misfit: Misfit) -> str:
    """Say whether runs that the posterior predicts would leave residuals of the size of those seen."""
    known = {run: p for run, p in misfit.predictive_p.items() if math.isfinite(p)}
    if not known:
        return ""
    odd = [f"{run} (p {_tail(p)})" for run, p in known.items() if not misfit.level < p < 1.0 - misfit.level]
    if odd:
        return f"Replicated by the posterior, residuals would be of another size in {listed(odd)}."
    ends = " to ".join(dict.fromkeys(f"{p:.2f}" for p in (min(known.values()), max(known.values()))))
    return f"Replicated by the posterior, residuals are of the size of those seen (p {ends})."


def _tail(p: float) -> str:
    return "below 0.001" if p < 0.001 else "above 0.999" if p > 0.999 else f"{p:.3f}"
