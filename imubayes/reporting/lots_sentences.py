"""What a class-level study says, in sentences made from its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import compress

from imubayes.inference import Rate, Share
from imubayes.population.lots import COUNTS, LINEAR, SEEN, Check, LotResult
from imubayes.population.needs import HALF, NEEDED, NOT_NEEDED, UNTOLD, WOULD_MATTER, ClassFound, MissionFound
from imubayes.population.statements import BEYOND, CONFIRMED, CONTRADICTED, Judged
from imubayes.reporting import lots_words
from imubayes.reporting.rounding import NARROW, percent, percents, share
from imubayes.scenes.relevance import MATTERS
from imubayes.selection.verdicts import listed
from imubayes.sensors.equations.basic import TERMS
from imubayes.units import counted

MOST_TERMS = 8
"""Terms that a sentence names."""

LITTLE = 1e-3
"""Share of a budget below which no digits are printed."""

ASKED = 0.95
"""Precision and recall that a class-level answer should reach."""

COVERING = (0.86, 0.94)
"""Share of the truths that 90 % intervals should hold."""

UNSHOWN = "The tests cannot tell, and by the catalogue it would matter"

SIMULATED = (
    "All of it stands on simulated campaigns: the sizes are the catalogue's, many of them orders of"
    " magnitude. No measured data stand behind what is said of inputs beyond 1 g{gyroscopes}."
)


def lots_answer(result: LotResult) -> tuple[lots_words.Said, ...]:
    """First paragraphs of the report, by sentence: the answer to its title, then what stands beside it."""
    each = "; ".join(
        f"{lots_words.class_name(grade.sensor_class)} {lots_words.of_tests(result, NEEDED)}"
        f" {len(grade.answered(NEEDED))}, cannot tell {len(grade.answered(UNTOLD))}"
        for grade in result.classes
    )
    counts = f"Of {counted(len(result.study.library.terms), 'term')}, by the tests: {each}."
    said = [lots_words.headline(result), (counts, "needed-terms")]
    divided = [
        (sharp, terms, text, mission.name)
        for k, mission in enumerate(result.study.missions)
        for sharp, terms, text in contrasts(result, k)
        if sharp > 0.0
    ]
    # that a bias or a scale counts surprises nobody
    if telling := [division for division in divided if not set(division[1]) & set(TERMS)] or divided:
        *_, text, scene = max(telling, key=lambda division: division[0])
        said.append((f"In the scene {lots_words.scene_name(scene)} {text}", lots_words.slug("scene", scene)))
    pairs = [(grade, scene) for grade in result.classes for scene in grade.missions]
    if result.study.basic and pairs:
        fine = sum(scene.basic_share <= 1.0 for _, scene in pairs)
        worst, where = max(pairs, key=lambda pair: pair[1].basic_share)
        most = f"{lots_words.class_name(worst.sensor_class)} in {lots_words.scene_name(where.name)}"
        enough = (
            f"What the basic triad of 12 parameters lacks stays within the budget in {fine} of {len(pairs)}"
            f" pairs of class and scene, in the median unit; its worst is {most},"
            f" {lots_words.of_budget(where.basic_share, where)}."
        )
        said.append((enough, "basic"))
    return (*said, (check_sentences(result)[0], "check")) if pairs else tuple(said)


def contrasts(result: LotResult, k: int) -> Iterator[tuple[float, tuple[str, ...], str]]:
    """Terms of the k-th scene by the classes that need them, most classes first; none that no class needs.

    Each with how sharply classes part on it and what is said of it. They part where it is little to some:
    below `MATTERS` of the budget in 95 % of the units, whose tests tell it in most units. How sharply is the
    smallest share of the budget among those that need it, median over units, over the largest among these.
    """
    classes, scenes = result.classes, [grade.missions[k] for grade in result.classes]
    told = [[term.answer for term in scene.terms] for scene in scenes]
    patterns: dict[tuple[bool, ...], list[int]] = {}
    for j in range(len(scenes[0].terms)):
        patterns.setdefault(tuple(answers[j] == NEEDED for answers in told), []).append(j)
    patterns.pop((False,) * len(classes), None)
    for pattern, terms in sorted(patterns.items(), key=lambda item: -sum(item[0])):
        groups: dict[str, list[str]] = {kind: [] for kind in ("needing", "without", "untold", "between")}
        most = 0.0
        for grade, scene, own, needs in zip(classes, scenes, told, pattern, strict=True):
            largest, answers = max(scene.terms[j].share.high for j in terms), {own[j] for j in terms}
            kind = "needing" if needs else "untold" if answers & {UNTOLD, WOULD_MATTER} else "between"
            if kind == "between" and largest < MATTERS:
                kind, most = "without", max(most, largest)
            groups[kind].append(lots_words.class_name(grade.sensor_class))
        names = tuple(scenes[0].terms[j].name for j in terms)
        least = min(mission.terms[j].share.value for mission in compress(scenes, pattern) for j in terms)
        sharp = least / max(most, LITTLE) if groups["without"] else 0.0
        # a bias is as sharp in every scene that it passes through alike: no rounding picks one of these
        yield float(f"{sharp:.6g}"), names, _contrast(names, groups, most)


def _contrast(terms: Sequence[str], groups: Mapping[str, Sequence[str]], most: float) -> str:
    """Say who needs what, and how little it is to the others."""
    needing, without, untold, between = groups.values()
    if not without and not untold and not between:
        return f"every class needs {listed(terms, MOST_TERMS)}."
    text = f"{listed(needing)} {'needs' if len(needing) == 1 else 'need'} {listed(terms, MOST_TERMS)}"
    if without:
        text += (
            f"; {listed(without)} {'does' if len(without) == 1 else 'do'} not: in 95{NARROW}% of the units"
            f" {'it' if len(terms) == 1 else 'each'} takes less than"
            f" {lots_words.of_budget(max(most, LITTLE))}"
        )
    if untold:
        text += f"; of {listed(untold)} the test cannot tell"
    return f"{text}; in between: {listed(between)}." if between else f"{text}."


def scene_sentences(result: LotResult, k: int) -> tuple[str, ...]:
    """Say what a scene requires of the classes."""
    said = [lots_words.capitalised(text) for _, _, text in contrasts(result, k)]
    said = said or ["No term is in the smallest model of half of the units of any class."]
    would = [
        f"{lots_words.class_name(grade.sensor_class)} {listed(terms)}"
        for grade in result.classes
        if (terms := grade.missions[k].answered(WOULD_MATTER))
    ]
    if would:
        said.append(f"{UNSHOWN}: {'; '.join(would)}.")
    scenes = [(lots_words.class_name(grade.sensor_class), grade.missions[k]) for grade in result.classes]
    if beyond := [name for name, scene in scenes if scene.within < HALF]:
        said.append(
            f"For most units of {listed(beyond)} the test leaves more than the budget open, whatever is"
            " modelled."
        )
    loud = [
        f"{name} ({lots_words.of_budget(mission.noise_share, mission)})"
        for name, mission in scenes
        if mission.noise_share > 1.0
    ]
    if loud:
        said.append(f"Noise alone is more than the budget: {listed(loud)}.")
    return tuple(said)


def class_sentences(grade: ClassFound, count: int) -> tuple[str, ...]:
    """Say what a class needs, and what its tests cannot tell."""
    needed, idle, hidden = map(grade.answered, (NEEDED, NOT_NEEDED, UNTOLD))
    who = "The tests show" if grade.missions else "The class needs"
    said = [f"{who} {listed(needed) if needed else 'no term'}, {len(needed)} of {count} terms."]
    if idle:
        said.append(f"Not needed: {listed(idle)}.")
    if hidden:
        said.append(f"Of {len(hidden)} the tests cannot tell: {listed(hidden)}.")
    every = [{term.name: term.most_of_budget for term in scene.terms} for scene in grade.missions]
    if harmless := [name for name in hidden if every and all(scene[name] < MATTERS for scene in every)]:
        # even at the size below which all units together hold them
        said.append(
            f"Whatever they are, {listed(harmless)} {'takes' if len(harmless) == 1 else 'take'} less than"
            f" {percent(MATTERS)} of every scene's budget: the units together leave no more open."
        )
    said.append(
        f"Of a single unit the test shows {lots_words.amid(grade.order)} (median, and 90{NARROW}% of the"
        " units): units differ in what they have, and in what their tests tell."
    )
    return tuple(said)


def own_scene_sentences(scene: MissionFound) -> tuple[str, ...]:
    """Say what a scene requires of a class, how its units differ, and what they leave of the budget."""
    needed, would = map(scene.answered, (NEEDED, WOULD_MATTER))
    said = [
        f"The class needs {listed(needed)} here ({len(needed)}), which its tests show, and the smallest model"
        " of half of the units or more has."
        if needed
        else "No term that the tests show is in the smallest model of half of the units or more."
    ]
    if taken := [term.name for term in scene.terms if lots_words.in_scene(term) == lots_words.TAKEN_UP]:
        each = "alone takes" if len(taken) == 1 else "each alone take"
        said.append(
            f"{listed(taken)} {each} the budget or more; models do without where other terms take that up."
        )
    if would:
        said.append(f"{UNSHOWN}: {listed(would)}.")
    said.append(
        f"Counted unit by unit, the smallest model has {lots_words.amid(scene.order)} terms (median, and"
        f" 90{NARROW}% of the units), shown or not; with a calibration over the inputs of the test"
        f" {lots_words.amid(scene.tested_order)}."
    )
    text = f"{percent(scene.within)} of the units have a model that stays within the budget with 95{NARROW}%"
    if scene.within < 1.0:
        text += "; of the others the calibration alone exceeds it, and the smallest model leaves out less"
    said.append(f"Noise comes to {lots_words.of_budget(scene.noise_share, scene)}; {text}.")
    return tuple(said)


def check_sentences(result: LotResult) -> tuple[str, ...]:
    """Hold the answers against the simulated truth, in words."""
    check = result.check
    cells, true = check.cells
    good = check.precision.value >= ASKED and check.recall.value >= ASKED
    low, high = COVERING
    calibrated = low <= check.population_spread.share.value <= high
    more = f" Of {check.untold:,} more cells the tests cannot tell." if check.untold else ""
    flown = any(mission.budget.quantity != "output" for mission in result.study.missions)
    return (
        f"Against the simulated truth{', flown by a full navigator' if flown else ''}, over {cells:,} cells"
        f" of class, term and scene that the tests tell, of which {true:,} truly take {percent(MATTERS)} of"
        f" the budget or more, precision is {_bounded(check.precision)} and recall"
        f" {_bounded(check.recall)}.{more}",
        f"{'Both reach' if good else 'Not both reach'} the {ASKED:g} that was asked of them.",
        f"The 90{NARROW}% intervals hold the population spread in {_covered(check.population_spread)}; asked"
        f" were {100 * low:.0f} to {percent(high)}{'' if calibrated else ', which this is outside of'}."
        f" They hold the population mean in {_covered(check.population_mean)}.",
        *_of_shares(check),
    )


def _of_shares(check: Check) -> tuple[str, ...]:
    """Say how often shares of budgets hold the true ones, and how far apart the two ways to them are."""
    if not check.shares.of:
        return ()
    low, units = COVERING[0], check.unit_shares
    short, linear = units.share.value < low, check.linear_shares.share
    why = ": it does not hold what the linear propagation is off" if units.share.high < linear.low else ""
    said = [
        f"Where a term takes {100.0 * COUNTS:g}{NARROW}% of the budget or more, the range of its share over"
        f" the units holds the true one in {_covered(check.shares)}, and a unit's own 90{NARROW}% interval"
        f" its own in {_covered(units)}{f', too few{why}' if short else ''}; by the linear propagation, which"
        f" all other shares are by, the same truth in {_covered(check.linear_shares)}."
    ]
    median, most = check.off
    if not math.isnan(median):
        said.append(
            f"There the linear propagation is off the full navigator by {share(median)} in the median,"
            f" {share(most)} at most."
        )
    if check.beyond:
        said.append(
            f"In {counted(check.beyond, 'more cell')} it has ended, being off by more than"
            f" {percent(LINEAR)}: shares are given as the least that the navigator makes of such, or more."
        )
    if linear.value < low and check.seen_shares.of:
        lean = "; the others lean on a prior of the class's typical size, and may have several times that"
        said.append(
            f"Where the unit's test leaves less than {percent(SEEN)} of the prior's width open, its interval"
            f" holds the truth by the linear propagation in {_covered(check.seen_shares)}"
            f"{lean if check.seen_shares.share.value >= low else ''}."
        )
    return tuple(said)


def statements_sentence(told: Sequence[Judged]) -> str:
    """Count the verdicts on published statements, and say for what they hold."""
    each = [
        f"{count} {'is' if count == 1 else 'are'} {verdict}"
        for verdict in (CONFIRMED, CONTRADICTED, BEYOND)
        if (count := sum(statement.verdict == verdict for statement in told))
    ]
    return (
        f"Of {counted(len(told), 'published statement')} on these classes {listed(each)}. The units are drawn"
        " from the catalogue, some of whose sizes stand on the same data sheets: all of it holds for sensors"
        " of these sizes, by these tests and in these scenes."
    )


def _covered(rate: Rate) -> str:
    return f"{rate.events:,} of {rate.of:,} cases, {percents(rate.share)}"


def _bounded(interval: Share) -> str:
    if math.isnan(interval.value):
        return "undefined"
    return f"{interval.value:.3f} ({interval.low:.3f} to {interval.high:.3f})"
