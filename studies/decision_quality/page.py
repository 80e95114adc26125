"""The report on how good the decision is: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from imubayes.reporting.blocks import Both, Figure, Page, Prose, Section, Table, Text, answer, parted, repeat
from imubayes.reporting.method_views import called
from imubayes.reporting.rounding import duration, percent
from imubayes.selection.verdicts import EQUAL
from studies.command import recorded
from studies.decision_quality.faults import FAULTS
from studies.decision_quality.figures import (
    LABELLED,
    calibration_panel,
    cost_panel,
    drops_panel,
    ratio_panel,
    treatments_panel,
)
from studies.decision_quality.scores import CLIP, EDGES
from studies.decision_quality.subjects import PARTIAL
from studies.decision_quality.trials import DECISION, EVIDENCE, MISSING, OWN, TRUSTED, WHITE
from studies.decision_quality.words import bins, quality_answer, shares

if TYPE_CHECKING:
    from studies.decision_quality.measure import Quality
    from studies.decision_quality.questions import Interval
    from studies.decision_quality.scores import MethodScore, Scores, Treated, Verdicts

TITLE = "How good is the decision?"

QUESTION = (
    "Simulated sensors with known truth and coloured noise: how often the decision is wrong, and whether"
    " another method is better."
)

SCORES = (
    "method",
    "false keeps",
    Both("drops above 8 sd", "drops > 8 sd"),
    Both("wrong a sensor", "cost"),
    Both("more than decision", None),
    Both("cost with open terms", None),
    "Brier",
    Both("log score", "log"),
)
BY_METHOD = (Both("zero terms called needed", "false needed"), Both("zero terms", "of"))
VERDICTS = (
    Both("treatment, and who judges", "verdicts"),
    Both("zero terms called needed", "false"),
    Both("true terms called not needed", "missed"),
    Both("those above 8 sd", "> 8 sd"),
    Both("left open", "open"),
    Both("rms pull", "rms"),
    Both("largest pull", "most"),
)
SHORT = {DECISION: "decision", EVIDENCE: "alone", TRUSTED: "trusting"}

TREATED = (
    "A fault is in what the sensor says, and the analysis knows nothing of it; where noise is assumed white,"
    " or a term is missing, it is the analysis that is wrong. The evidence alone allows for errors of the"
    " bench that it finds; if it trusts the bench, for none. Of the other methods, what their strengths put"
    f" above {EQUAL.needed:g} counts as needed."
)

PULLS = (
    "A pull is the mean less the truth, over the sd: model-averaged of what is needed, with all candidates of"
    " what is not needed. Left open is what is undecided, inseparable or unresolved."
)

WRONG = {
    **FAULTS,
    WHITE: "N alone, estimated from the residuals",
    MISSING: "a term above 8 sd, drawn by lot, is not in the library (the bias always is); sensors without"
    " such a term are left out",
}

PICTURE = (
    "Zero terms called needed: blue, by the decision; grey, by evidence that trusts the bench; with 95 %. The"
    " line is what is asked."
)

FIGURES = (
    "Drops: blue, the decision with its intervals; in colour, one method of each family; grey, the others."
    " Cost at equal costs: dots with 95 %. Cost over the decision’s: below 1 another method would be"
    " cheaper; the decision moves its threshold with the costs, the others know of none. Calibration: dots"
    " on the line are probabilities that come true as often as they say."
)

DRAWN = (
    "Sensors of every class of the catalogue take turns. Each has a share of the terms, uniform over"
    " sensors; their sizes are normal with the class's typical magnitudes, and N, B and K log-normal over"
    " the class. An accelerometer is tested by a tumble in three planes and a centrifuge, a gyroscope by"
    f" rate steps in nine mounts and a tumble; one accelerometer of {PARTIAL} has no centrifuge. Terms that"
    " no run excites are left out."
)

COUNTED = (
    Markup(
        "A <em>false keep</em> is a term that is zero and in the method's model; a <em>false drop</em> one"
        " that is not zero and not in it. The decision's model holds what costs less kept than dropped, at"
        " equal costs inclusion of one half or more."
    ),
    Markup(
        "The decision may leave a term <em>open</em>: undecided, inseparable or unresolved. At a twentieth"
        " of a wrong term's cost the thresholds of its verdicts, 0.95 and 0.05, cost least (Chow, 1970). The"
        " other methods are given the same option: what their strengths put between the two thresholds is"
        " left open."
    ),
    "As modelled, the truth is drawn from the very priors that the decision has: there it is at its best. The"
    " treatments show what happens where the test or the analysis is wrong.",
    Markup(
        "<em>Effect over noise</em> is the size of the coefficient over its standard deviation under the full"
        " library, without a prior and with the noise estimated: what the test could tell of it at best."
    ),
    Markup(
        "The <em>Brier score</em> is the mean squared difference of a method's strength (inclusion, weight,"
        " or frequency over resampled campaigns) from the truth; the <em>log score</em> the mean of −ln of"
        f" what it gave the truth, with strengths {CLIP} from 0 and 1 at least. Lower is better. What a"
        " method says nothing of is not in its model, and is left out of these two."
    ),
    "Intervals are bootstrapped over sensors; those of rates hold Clopper and Pearson's too.",
)


def quality_page(quality: Quality) -> Page:
    """Page of the report."""
    counted = (Prose(DRAWN), Prose(COUNTED, "list"))
    said = f"It took {duration(quality.seconds)} with {quality.study.processes} processes."
    first, rest = parted(quality_answer(quality))
    return Page(
        TITLE,
        QUESTION,
        first=(answer(first), Figure([treatments_panel(quality.treated, "t")], note=PICTURE)),
        data="simulated",
        blocks=(
            Prose(" ".join(rest)),
            _treatments(quality),
            _section(quality.scores),
            Section("What was counted", counted, "meaning"),
            repeat(quality.study.command, "", f"{said} Seed {quality.study.seed}."),
        ),
    )


def _treatments(quality: Quality) -> Section:
    """The verdicts of all methods, and what else is asked of the decision, under each treatment."""
    told = quality.treated
    # the decision's other rows are in the second table
    shown = [k for k, said in enumerate(told[0].verdicts) if said.method not in OWN[1:]]
    needed = [(one.treatment, f"{one.zero:,}", *(_seldom(one.verdicts[k]) for k in shown)) for one in told]
    names = [told[0].verdicts[k].method for k in shown]
    head = *BY_METHOD, *(_where_shown(name, called(name)) for name in names)
    verdicts = [
        (Both(f"{one.treatment}: {name}", f"{one.treatment}: {SHORT[name]}"), *_judged(one.of(name)))
        for one in told
        for name in OWN
    ]
    return Section(
        "Where test or analysis is wrong",
        (
            Prose((TREATED, *_refused(told))),
            Table("False verdicts by treatment", head, needed),
            Table("The decision by treatment", VERDICTS, verdicts, note=PULLS),
            Prose([f"{name[:1].upper()}{name[1:]}: {text}." for name, text in WRONG.items()], "list"),
        ),
        "treatments",
        brief=True,
    )


def _refused(told: Sequence[Treated]) -> Iterator[str]:
    """Say how many sensors the analysis refused, and why the first of them."""
    for one in told:
        if one.refused:
            yield (
                f"Under {one.treatment} {len(one.refused)} of {one.sensors} sensors were refused, and all of "
                f"their terms left open: {one.refused[0]}."
            )


def _where_shown(method: str, said: str) -> Both:
    """Cell of a method; a terminal has one of each family beside the decision."""
    return Both(said, SHORT.get(said, said) if method in (*OWN, *LABELLED) else None)


def _seldom(said: Verdicts) -> Both:
    found = said.false_keeps
    cell = _where_shown(said.method, percent(found.value) if found.of else "")
    return replace(cell, page=f"{found.events} ({cell.page})" if found.events else "0" if found.of else "")


def _judged(said: Verdicts) -> tuple[Text, ...]:
    rates = (said.false_keeps, said.missed, said.false_drops, said.left)
    return (
        *(Both(f"{r.events} of {r.of:,}: {shares(r)}", percent(r.value)) if r.of else "" for r in rates),
        f"{said.rms:.2f}" if said.pulls else "",
        f"{said.largest:.1f}" if said.pulls else "",
    )


def _section(told: Scores) -> Section:
    """Where all is as modelled."""
    title = f"{told.treatment[:1].upper()}{told.treatment[1:]}"
    paints = (drops_panel, cost_panel, ratio_panel, calibration_panel)
    said = (
        f"{told.sensors} sensors, {told.zero:,} terms that are zero and {told.true:,} that are not."
        " Intervals are meant to hold 95 %. In the table every method must choose."
    )
    scores = [(called(score.method), *_cells(score)) for score in told.methods]
    drops = [(called(score.method), *map(shares, score.false_drops)) for score in told.methods]
    by_effect = Table(f"False drops by effect over noise, {title}", ("method", *bins()), drops)
    return Section(
        title,
        (
            Prose(said),
            Table(f"Scores of the methods, {title}", SCORES, scores),
            Figure([paint(told, f"q{n}") for n, paint in enumerate(paints)], note=FIGURES),
            Section("False drops by effect over noise", (by_effect,)),
        ),
        "modelled",
        brief=True,
    )


def _cells(score: MethodScore) -> tuple[Both, ...]:
    keeps, drops = score.false_keeps, score.false_drops[-1]
    return (
        Both(shares(keeps), percent(keeps.value) if keeps.of else ""),
        Both(shares(drops), percent(drops.value) if drops.of else ""),
        _number(score.cost),
        _number(score.excess) if score.method != DECISION else Both("", ""),
        _number(score.opened),
        _number(score.brier, 3, "–"),
        _number(score.log, 3, "–"),
    )


def _number(found: Interval, digits: int = 2, between: str = " to ") -> Both:
    """Value with its interval, which a terminal leaves out; nothing where there is none."""
    if math.isnan(found.value):
        return Both("", "")
    value, low, high = (f"{x:.{digits}f}".replace("-", "−") for x in (found.value, found.low, found.high))
    return Both(f"{value} ({low}{between}{high})", value)


def quality_record(quality: Quality) -> dict[str, Any]:
    """Values of ``result.json``: scores with their intervals."""
    return recorded(
        quality,
        TITLE,
        quality_answer(quality),
        sensors_per_kind=quality.study.sensors,
        misspecified_per_kind=quality.study.misspecified,
        effect_edges=EDGES[:-1],
        scores=[asdict(quality.scores)],
        treated=[asdict(told) for told in quality.treated],
    )
