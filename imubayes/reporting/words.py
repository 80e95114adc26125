"""The answer in words, made from the numbers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from imubayes.reporting.chain_views import (
    bias_sentence,
    choice_sentences,
    distrust_sentence,
    export_sentence,
    method_sentence,
    reproducibility_sentence,
    unconverged_sentence,
)
from imubayes.reporting.fit_views import CONDITIONAL, fit_sentence, missing_sentence, temperature_sentence
from imubayes.reporting.method_views import unasked_sentences
from imubayes.reporting.rounding import models_text
from imubayes.reporting.rows import MARKS, label, sentence
from imubayes.rig.checks import faults
from imubayes.rig.reference import LACK
from imubayes.selection.verdicts import STRAINED, listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.linear import Extra
    from imubayes.inference.observability import Confounded
    from imubayes.selection.models import Models
    from imubayes.selection.verdicts import TermVerdict

MOST_STRAINED = 3
"""Terms that the sentence on a disagreement names."""

FEW_DIGITS = 3
"""Digits below which rounding reaches what the report prints."""

MOST_NAMES = 6
"""Names that a sentence holds."""

MOST_ALIKE = 2
"""Errors of the test bench of one kind that a sentence says one by one."""


def answer(sensor: SensorResult) -> tuple[str, ...]:
    """First paragraph on a component by sentence: needed, how that was found, what is not, does it fit."""
    found = {word: [t.name for t in sensor.selection.terms if t.verdict == word] for word in MARKS}
    needed = found.pop("needed")
    others = [f"{len(names)} {_are(names)} {word}" for word, names in found.items() if names]
    kind = f"{sensor.kind}, class {sensor.class_id}" if sensor.class_id else f"{sensor.kind}, no class given"
    count = f"{len(needed)} of {counted(len(sensor.selection.terms), 'term')} {_are(needed)} needed"
    sentences = (
        unconverged_sentence(sensor),
        strain_sentence(sensor),
        temperature_sentence(sensor),
        f"{sensor.id} ({kind}): {count}{f': {listed(needed)}' if needed else ''}.",
        CONDITIONAL if sensor.conditional else "",
        method_sentence(sensor),
        f"{listed(others)}." if others else "",
        bias_sentence(sensor),
        reproducibility_sentence(sensor),
        export_sentence(sensor),
        distrust_sentence(sensor),
        *map(sentence, faults((run.name, run.procedure, run.source) for run in sensor.runs)),
        fit_sentence(sensor),
        digits_sentence(sensor),
        *choice_sentences(sensor.choice),
        *(unasked_sentences(sensor.panel.unasked) if sensor.panel else ()),
        missing_sentence(
            sensor.misfit,
            fits=all(check.fits for check in sensor.checks),
            assumed=[run.name for run in sensor.runs if run.found.origin in ("white", "given")],
        ),
    )
    return tuple(text for text in sentences if text)


def strain_sentence(sensor: SensorResult) -> str:
    """Say where the data contradict the prior: first of all, it is a wrong sign or unit."""
    strained = sorted((t for t in sensor.selection.terms if t.strain > STRAINED), key=lambda t: -t.strain)
    if not strained:
        return ""
    worst = listed(f"{t.name} lies {t.strain:,.0f} prior sd from zero" for t in strained[:MOST_STRAINED])
    return (
        f"{sensor.id}: data and prior disagree: {worst}. Check the sign and the unit of inputs and output,"
        " and that no input column is missing; if this is how the unit is, give [sensor.prior]."
    )


def confounded_sentences(
    groups: Sequence[Confounded], terms: Iterable[TermVerdict], extras: Iterable[Extra] = ()
) -> tuple[str, ...]:
    """Say which terms each group holds, why, and what would tell them apart: a sentence a cause.

    Groups are by the terms' names; terms have symbols, and columns that are no terms words, where given.
    """
    symbols = {term.name: label(term) for term in terms}
    bench = {extra.name: extra for extra in extras}
    causes: dict[str, list[str]] = {}
    for group in groups:
        how = "appear only in one combination" if group.exact else "cannot be told apart above the noise"
        why = f": {group.reason}" if group.reason else ""
        remedy = f" What would tell: {sentence(group.remedy)}" if group.remedy else ""
        causes.setdefault(f"{how}{why}.{remedy}", []).append(_members(group.terms, symbols, bench))
    return tuple(
        f"{'; '.join(members)}{' each ' if len(members) > 1 else ' '}{cause}"
        for cause, members in causes.items()
    )


def _members(names: Sequence[str], symbols: Mapping[str, str], bench: Mapping[str, Extra]) -> str:
    """Name what a group holds: terms with their symbols, errors of the test bench in words.

    Many terms go without symbols; many errors of one kind are counted.
    """
    told = {name: symbols.get(name, name) if len(names) <= MOST_NAMES else name for name in names}
    said = [name if told[name] == name else f"{name} ({told[name]})" for name in names if name not in bench]
    lacking, kinds = dict[str, None](), dict[str, list[str]]()
    for extra in (bench[name] for name in names if name in bench):
        if extra.kind.startswith(LACK):
            lacking[extra.kind.partition(".")[2].partition("^")[0]] = None
        else:
            kinds.setdefault(extra.kind, []).append(f"the {extra.text.removeprefix('the ')}")
    said += [f"what the library lacks of {channel}" for channel in lacking]
    for kind, texts in kinds.items():
        many = f"{len(texts)} errors of the test bench ({kind.replace('_', ' ')})"
        said += [many] if len(texts) > MOST_ALIKE else texts
    return listed(said)


def digits_sentence(sensor: SensorResult) -> str:
    """Say where rounding leaves fewer digits than the report prints."""
    found = sensor.selection.digits
    if found is None or min(found.coefficients, found.sd, found.inclusion) >= FEW_DIGITS:
        return ""
    left = counted(found.coefficients, "digit")
    return (
        f"The arithmetic is sure to leave {left} of every coefficient, beside the larger of its size and sd,"
        f" {found.sd} of every sd and {found.inclusion} of the inclusions: bounds for the worst term, which"
        " say little of the others. Averages over the most probable models alone, columns that are all but"
        " alike, or noise far below what the output resolves do that."
    )


def weighed_text(models: Models) -> str:
    """Say how many models were weighed, and what that leaves out."""
    if models.n_models == 1 << len(models.candidates.names):
        return f"all {models_text(models.n_models)} models"
    of = f"{models.n_models:,} of {models_text(1 << len(models.candidates.names))} models"
    if math.isnan(models.error):
        return f"{of}, picked by the method: how probable the others are is not known"
    if math.isnan(models.missing):
        return f"{of}, drawn by a walk over them: inclusions are right to {models.error:.1g} (1 sd)"
    return f"{of}, searched for: the others carry at most {models.missing:.0e} of the probability"


def _are(names: Collection[str]) -> str:
    return "is" if len(names) == 1 else "are"
