"""What a class-level study says, in sentences made from its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING

from imubayes.reporting.lots_words import (
    MAJORITY,
    class_name,
    covered,
    of_budget,
    required,
    scene_name,
    slug,
)
from imubayes.reporting.rounding import NARROW, percent
from imubayes.selection.class_needs import CANNOT_TELL
from imubayes.selection.relevance import MATTERS
from imubayes.selection.verdicts import listed
from imubayes.sensors.equations.basic import TERMS

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.lots.answers import ClassFound, LotResult, MissionFound

MOST_TERMS = 8
"""Terms that a sentence names."""

LITTLE = 1e-3
"""Share of a budget below which no digits are printed."""

ASKED = 0.95
"""Precision and recall that a class-level answer should reach."""

COVERING = (0.86, 0.94)
"""Share of the truths that 90 % intervals should hold."""

SIMULATED = (
    "All of it stands on simulated campaigns: the sizes are the catalogue's, many of them orders of"
    " magnitude. No measured data stand behind what is said of inputs beyond 1 g, or of fibre-optic and laser"
    " gyroscopes."
)


@dataclass(frozen=True, slots=True)
class Said:
    """A sentence, and the anchor of the numbers behind it."""

    text: str
    anchor: str


@dataclass(frozen=True, slots=True)
class Contrast:
    """Terms that the same classes need in a scene.

    Attributes
    ----------
    mission : name of the scene.
    terms : that these classes need, and no other.
    needing : names of the classes.
    without : names of those to which each term is little: below `MATTERS` of the budget in 95 % of the units,
        whose tests tell it in most units.
    untold : names of those whose tests leave one of the terms open in half of the units or more.
    between : names of the rest.
    least : smallest share of the budget among those that need them, median over units.
    most : largest share of the budget among those without, 95 % of the units below it.
    """

    mission: str
    terms: tuple[str, ...]
    needing: tuple[str, ...]
    without: tuple[str, ...]
    untold: tuple[str, ...]
    between: tuple[str, ...]
    least: float
    most: float


def lots_answer(result: LotResult) -> tuple[Said, ...]:
    """First paragraph of the report, by sentence."""
    said = [_orders(result), _open(result)]
    divided = _divided(result)
    # that a bias or a scale counts surprises nobody
    telling = [one for one in divided if not set(one.terms) & set(TERMS)] or divided
    sharpest = max(telling, key=lambda one: one.least / max(one.most, 1e-3), default=None)
    if sharpest:
        where = f"In the scene {scene_name(sharpest.mission)}"
        said.append(Said(f"{where} {contrast_sentence(sharpest)}", slug("scene", sharpest.mission)))
    checked = (Said(check_sentences(result)[0], "check"),) if result.study.missions else ()
    return (*said, *basic_answer(result), *checked)


def _orders(result: LotResult) -> Said:
    count = len(result.study.library.terms)
    each = listed(f"{class_name(one.sensor_class)} {one.order.value:.0f}" for one in result.classes)
    return Said(f"Of {count} terms the test shows that the median unit needs: {each}.", "order")


def _open(result: LotResult) -> Said:
    """How much the test cannot tell, by class."""
    each = listed(f"{class_name(one.sensor_class)} {_untold(one)}" for one in result.classes)
    return Said(f"It cannot tell, in half of the units or more, of: {each}.", "needed-terms")


def _untold(found: ClassFound) -> int:
    """Terms of which the test cannot tell in half of the units or more."""
    hidden = [[verdict in CANNOT_TELL for verdict in unit.verdicts] for unit in found.units]
    return sum(sum(column) >= MAJORITY * len(hidden) for column in zip(*hidden, strict=True))


def _divided(result: LotResult) -> list[Contrast]:
    """Contrasts of all scenes that divide the classes."""
    every = (one for k in range(len(result.study.missions)) for one in contrasts(result, k))
    return [one for one in every if one.needing and one.without]


def contrasts(result: LotResult, k: int) -> tuple[Contrast, ...]:
    """Terms of the k-th scene by the classes that need them, most classes first; none that no class needs."""
    found = [one.missions[k] for one in result.classes]
    patterns: dict[tuple[bool, ...], list[int]] = {}
    for j in range(len(found[0].terms)):
        pattern = tuple(scene.terms[j].required >= MAJORITY for scene in found)
        if any(pattern):
            patterns.setdefault(pattern, []).append(j)
    ordered = sorted(patterns.items(), key=lambda item: -sum(item[0]))
    return tuple(_contrast(result.classes, found, pattern, terms) for pattern, terms in ordered)


def _contrast(
    classes: Sequence[ClassFound],
    found: Sequence[MissionFound],
    pattern: tuple[bool, ...],
    terms: Sequence[int],
) -> Contrast:
    names = [class_name(one.sensor_class) for one in classes]
    hidden = [any(one.terms[j].open >= MAJORITY for j in terms) for one in classes]
    largest = [max(one.terms[j].share.high for j in terms) for one in found]
    untold = [not needs and unseen for needs, unseen in zip(pattern, hidden, strict=True)]
    told = [not needs and not unseen for needs, unseen in zip(pattern, hidden, strict=True)]
    little = [seen and most < MATTERS for seen, most in zip(told, largest, strict=True)]
    between = [seen and not small for seen, small in zip(told, little, strict=True)]
    return Contrast(
        mission=found[0].mission,
        terms=tuple(found[0].terms[j].name for j in terms),
        needing=tuple(compress(names, pattern)),
        without=tuple(compress(names, little)),
        untold=tuple(compress(names, untold)),
        between=tuple(compress(names, between)),
        least=min(one.terms[j].share.value for one in compress(found, pattern) for j in terms),
        most=max(compress(largest, little), default=0.0),
    )


def contrast_sentence(one: Contrast) -> str:
    """Say who needs what, and how little it is to the others."""
    named = listed(one.terms)
    if len(one.terms) > MOST_TERMS:
        named = f"{', '.join(one.terms[:MOST_TERMS])} and {len(one.terms) - MOST_TERMS} more"
    if not one.without and not one.untold and not one.between:
        return f"every class needs {named}."
    text = f"{listed(one.needing)} {'needs' if len(one.needing) == 1 else 'need'} {named}"
    if one.without:
        each = "it" if len(one.terms) == 1 else "each"
        text += (
            f"; {listed(one.without)} {'does' if len(one.without) == 1 else 'do'} not: in 95{NARROW}% of the"
            f" units {each} takes less than {of_budget(max(one.most, LITTLE))}"
        )
    if one.untold:
        text += f"; of {listed(one.untold)} the test cannot tell"
    return f"{text}; in between: {listed(one.between)}." if one.between else f"{text}."


def scene_sentences(result: LotResult, k: int) -> tuple[str, ...]:
    """Say what a scene requires of the classes."""
    said = [text[:1].upper() + text[1:] for text in map(contrast_sentence, contrasts(result, k))]
    said = said or ["No class needs any term."]
    open_classes = [one for one in result.classes if one.missions[k].within < MAJORITY]
    if open_classes:
        names = listed(class_name(one.sensor_class) for one in open_classes)
        said.append(
            f"For most units of {names} the test leaves more than the budget open, whatever is modelled."
        )
    loud = [one for one in result.classes if one.missions[k].noise_share > 1.0]
    if loud:
        names = listed(
            f"{class_name(one.sensor_class)} ({of_budget(one.missions[k].noise_share)})" for one in loud
        )
        said.append(f"Noise alone is more than the budget: {names}.")
    return tuple(said)


def class_sentences(found: ClassFound, count: int) -> tuple[str, ...]:
    """Say what a class needs, shows and leaves open, and what its scenes require."""
    of = found.terms
    always = [term.name for term in of if term.needed.value >= ASKED]
    never = [term.name for term in of if term.needed.value == 0.0 and term.open < MAJORITY]
    hidden = [term.name for term in of if term.open >= MAJORITY]
    said = [
        f"The median unit needs {found.order.value:.0f} of {count} terms (90{NARROW}% of the units:"
        f" {found.order.low:.0f} to {found.order.high:.0f})."
    ]
    if always:
        said.append(f"Needed in {percent(ASKED)} of the units or more: {listed(always)}.")
    if never:
        said.append(f"Needed in none: {listed(never)}.")
    if hidden:
        said.append(f"In half of the units or more the test leaves open {listed(hidden)}.")
    return (*said, *(_required(one) for one in found.missions))


def _required(found: MissionFound) -> str:
    needed = required(found)
    what = f"requires {listed(needed)}" if needed else "requires no term"
    return f"The scene {scene_name(found.mission)} {what}."


def basic_answer(result: LotResult) -> tuple[Said, ...]:
    """Say where the triad of twelve parameters is enough; nothing where it was not asked."""
    pairs = [(one, scene) for one in result.classes for scene in one.missions]
    if not result.study.basic or not pairs:
        return ()
    fine = sum(scene.basic_share <= 1.0 for _, scene in pairs)
    general = sum(scene.within >= MAJORITY for _, scene in pairs)
    worst, where = max(pairs, key=lambda pair: pair[1].basic_share)
    text = (
        f"The basic triad of 12 parameters leaves less than the budget in {fine} of {len(pairs)} pairs of"
        f" class and scene, a model of the generalized terms in {general}; the triad's worst is"
        f" {class_name(worst.sensor_class)} in {scene_name(where.mission)}, {of_budget(where.basic_share)}."
    )
    return (Said(text, "basic"),)


def basic_sentences(result: LotResult) -> tuple[str, ...]:
    """Say class by class where the triad is not enough."""
    said = []
    for one in result.classes:
        short = [
            f"{scene_name(s.mission)} ({of_budget(s.basic_share)})"
            for s in one.missions
            if s.basic_share > 1.0
        ]
        name = class_name(one.sensor_class)
        text = f"is not enough in {listed(short)}" if short else "is enough in every scene"
        said.append(f"{name[:1].upper()}{name[1:]}: the triad {text}.")
    return tuple(said)


def check_sentences(result: LotResult) -> tuple[str, ...]:
    """Hold the answers against the simulated truth, in words."""
    check = result.check
    cells, true = check.cells
    good = check.precision.value >= ASKED and check.recall.value >= ASKED
    low, high = COVERING
    calibrated = low <= check.population_spread.share.value <= high
    more = f" Of {check.untold:,} more cells the tests cannot tell." if check.untold else ""
    return (
        f"Against the simulated truth, over {cells:,} cells of class, term and scene that the tests tell, of"
        f" which {true:,} truly take {percent(MATTERS)} of the budget or more, precision is"
        f" {_bounded(check.precision)} and recall {_bounded(check.recall)}.{more}",
        f"{'Both reach' if good else 'Not both reach'} the {ASKED:g} that was asked of them.",
        f"The 90{NARROW}% intervals hold the population spread in {covered(check.population_spread)}; asked"
        f" were {100 * low:.0f} to {percent(high)}{'' if calibrated else ', which this is outside of'}."
        f" They hold the population mean in {covered(check.population_mean)}.",
    )


def _bounded(found: Share) -> str:
    if math.isnan(found.value):
        return "undefined"
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f})"
