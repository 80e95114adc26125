"""What a parameter does from session to session, and from unit to unit of a class: in words, and a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np
from markupsafe import Markup

from imubayes.inference import Share
from imubayes.population.sessions import ClassInCommon, Repeatability, TermInClass
from imubayes.population.spreads import SUSPECT
from imubayes.reporting.blocks import Prose, Section, Table, Text, joined, quiet, verdict
from imubayes.reporting.rounding import (
    NARROW,
    below,
    percent,
    percents,
    pretty,
    probability,
    ranged,
    signed,
    sized,
    unit_of,
)
from imubayes.selection.verdicts import listed
from imubayes.study import StudyResult
from imubayes.units import counted

RESOLVED = 0.25
"""Low end of a spread's interval over its median from which the spread is there: where the data only say how
large it may be, that is 0.1."""

COMMON = 0.5
"""Share of what scatters between sessions that all units have in common from which it is said."""

STANDS_OUT = 2.0
"""Standard deviations from the mean of the sessions beyond which a session is named."""

MOST_NAMES, MOST_ROWS = 6, 30
"""Spreads or parameters that a sentence names, and rows of the table of sessions."""

LIKE = {"some need it": "undecided", "cannot tell": "unresolved"}
"""Verdicts of a unit whose shape and colour answers on a class have that are none themselves."""


def resolved(share: Share) -> bool:
    """Whether a spread is there, and not only below something."""
    return share.low > RESOLVED * share.value


def changes(term: TermInClass) -> bool:
    """Whether a term's sessions scatter by more than their errors allow."""
    return term.spreads.p_value < term.spreads.level


def spread_text(term: TermInClass, which: Literal["unit_to_unit", "turn_on"]) -> str:
    """Sd from unit to unit or between sessions, with its interval; what it is below where it is not there."""
    share: Share = getattr(term.spreads, which)
    if math.isnan(share.value):
        return "unknown"
    if not (changes(term) if which == "turn_on" else resolved(share)):
        return f"below {below(share.high, *unit_of(term))}"
    return ranged(share, *unit_of(term))


def whole(grade: ClassInCommon) -> tuple[TermInClass, ...]:
    """Each term once: for all axes of a triad together where there are several."""
    names = dict.fromkeys(term.term for term in grade.terms)
    return tuple(next(term for term in grade.terms if term.term == name) for name in names)


def shown(grade: ClassInCommon) -> tuple[TermInClass, ...]:
    """Terms that have a row: those of which the units' tests tell."""
    told = {term.term for term in grade.terms if term.told and term.need.verdict != "cannot tell"}
    return tuple(term for term in grade.terms if term.term in told and term.told)


def class_sentences(grade: ClassInCommon) -> tuple[str, ...]:
    """Findings on the units of a class: needs, what cannot be told, spreads, turn-on, what is common."""
    sessions = [name for name in grade.sessions if name]
    over = f", in {len(sessions)} sessions" if len(sessions) > 1 else ""
    return (
        f"{len(grade.units)} {grade.kind}s of class {grade.class_id}{over}.",
        *_needs(grade),
        *_silent(grade),
        *_spreads(grade),
        *_turn_on(grade),
        *_common(grade),
    )


def _needs(grade: ClassInCommon) -> Iterator[str]:
    said: dict[str, list[str]] = {}
    for first in whole(grade):
        each = parts(grade.terms, first)
        answers = {part.need.verdict for part in each}
        for part in [first] if len(answers) == 1 else each:
            said.setdefault(part.need.verdict, []).append(part.name)
    for told, words in (
        ("needed", "The class needs {}."),
        ("some need it", "Some units need {}, others do not."),
        ("not needed", "It does not need {}."),
        ("undecided", "The units leave {} undecided."),
    ):
        if names := said.get(told):
            yield words.format(listed(names))


def parts(terms: Iterable[TermInClass], first: TermInClass) -> tuple[TermInClass, ...]:
    """A term by component: what stands for all of them is left out; or the term itself where it is alone."""
    alike = tuple(term for term in terms if term.term == first.term)
    return alike[1:] if len(alike) > 1 and not alike[0].component else alike


def _silent(grade: ClassInCommon) -> Iterator[str]:
    reasons: dict[str, list[str]] = {}
    for term in whole(grade):
        if all(part.need.verdict == "cannot tell" for part in (term, *parts(grade.terms, term))):
            word = max(term.need.answers, key=lambda answer: term.need.answers[answer])
            reasons.setdefault(word, []).append(term.name)
    if reasons:
        told = "; ".join(f"{listed(names)} ({WHY.get(word, word)})" for word, names in reasons.items())
        yield f"This test cannot tell of {told}, nor do all units together."


WHY = {
    "inseparable": "seen only in combination",
    "unresolved": "too small beside the noise",
    "untested": "not excited",
}
"""Why a test cannot tell, in a few words."""


def _spreads(grade: ClassInCommon) -> Iterator[str]:
    told = [term for term in whole(grade) if term in shown(grade) and resolved(term.spreads.unit_to_unit)]
    if told:
        single = all(math.isnan(term.spreads.turn_on.value) for term in grade.terms)
        several = ", both what a unit is and what a turn-on does" if single else ""
        yield f"From unit to unit (sd{several}) {_listed(told, 'unit_to_unit', ' differs by ')}."


def _listed(terms: Sequence[TermInClass], which: Literal["unit_to_unit", "turn_on"], verb: str) -> str:
    return listed(f"{term.name}{verb}{spread_text(term, which)}" for term in terms[:MOST_NAMES])


def _turn_on(grade: ClassInCommon) -> Iterator[str]:
    told = [term for term in whole(grade) if term in shown(grade)]
    known = [term for term in told if not math.isnan(term.spreads.turn_on.value)]
    moving = [term for term in known if changes(term)]
    steady = [term for term in known if not changes(term)]
    if moving:
        yield f"From one session to the next {_listed(moving, 'turn_on', ' changes by ')}."
    if steady:
        rest = "The rest" if moving else "Everything"
        sizes = _listed(steady, "turn_on", " ")
        yield f"{rest} comes back within the error bars: the sd between sessions is {sizes}."
    if wide := [term.name for term in steady if term.spreads.p_value > 1.0 - term.spreads.level]:
        told = "agree better than by chance: from session to session these error bars are too wide"
        yield f"The sessions of {listed(wide)} {told}."


def _common(grade: ClassInCommon) -> Iterator[str]:
    alike = []
    for term in shown(grade):
        spreads, alone = term.spreads, term.component or len(grade.components) == 1
        if not (alone and changes(term) and spreads.common_share.value > COMMON):
            continue
        off = [
            f"session {name} by {sized(term, shift, sd)}"
            for name, shift, sd in zip(term.sessions, spreads.shift, spreads.shift_sd, strict=True)
            if abs(shift) > STANDS_OUT * sd
        ]
        of = counted(len(term.sessions), "session")
        named = f" ({len(off)} of {of} off their mean: {', '.join(off)})" if off else ""
        share = percents(spreads.common_share).replace(NARROW, " ")
        alike.append(f"{share} of that of {term.name}{named}")
    if alike:
        yield (
            f"Of the variance between sessions all units have in common, as temperature would make it:"
            f" {'; '.join(alike)}."
        )


CLASS_HEAD = ("term", "the class", "needed in", "together", "have it", "limit", "mean ± sd", "unit to unit")

CLASS_NOTE = (
    "Intervals are meant to hold 90 %."
    " The spreads are sds, each apart from the others: from unit to unit, between"
    " sessions of a unit, and the error bar of one session, with what the test books to a term in place"
    " of another. A unit needs a term where its sessions say so and none says the opposite; the interval"
    " of the share reaches as far as the units that cannot tell may be either. Together: probability that"
    " units of the class have the term, by all units and sessions at once, with what sessions do to each unit"
    " and to all of them counted as errors; have it: share of the units that do, if any does; limit: the size"
    " that a further unit's stays below with 95 %. The class needs what more than half of its units need;"
    " where most of them cannot tell, what half of them or more have, if the class has it with 0.95 or more."
)

REPEATED = (
    " Common is the share of the variance between sessions that all units have together; that is seen as"
    " often as there are sessions, so that the interval is wider than if units moved independently."
)

ONCE = " With one session of each unit, what a turn-on changes is in the sd from unit to unit."


def class_title(grade: ClassInCommon) -> str:
    """Class and kind."""
    return f"{grade.class_id}, {grade.kind}s"


def class_needs(grade: ClassInCommon) -> tuple[str, ...]:
    """What the class needs, a sentence each."""
    first, *rest = _needs(grade)
    return f"{class_title(grade)}: {first[:1].lower()}{first[1:]}", *rest


def class_section(grade: ClassInCommon, k: int) -> Section:
    """What the units of the k-th class have in common."""
    terms, repeated, title = shown(grade), sum(map(bool, grade.sessions)) > 1, class_title(grade)
    between = ("between sessions", "common") if repeated else ()
    left = len(grade.terms) - len(terms)
    more = f" {left} more parameters are in result.json." if left else ""
    table = Table(
        f"Population of {title}",
        (*CLASS_HEAD, *between, "error bar", "unit"),
        [_class_row(term, grade, repeated=repeated) for term in terms],
        "ttnnnnnnnnnt" if repeated else "ttnnnnnnnt",
        f"{CLASS_NOTE}{REPEATED if repeated else ONCE}{more}",
        brief=False,
    )
    said, common = Prose(class_sentences(grade), "list"), "What units of this class have in common"
    blocks = [said, table] if terms else [said]
    return Section(common, blocks, f"class-{k + 1}", title, listed=f"Units of {title}", brief=True)


def _class_row(term: TermInClass, grade: ClassInCommon, *, repeated: bool) -> tuple[Text, ...]:
    printed, spreads, need = pretty(term.printed), term.spreads, term.need
    together = not term.component and len(grade.components) > 1 and len(term.units) > len(grade.units)
    answers = {part.need.verdict for part in grade.terms if part.term == term.term and part is not term}
    needing = f"{need.answers.get('needed', 0)} of {sum(need.answers.values())}"
    share = quiet(f"({100.0 * need.share.low:.0f} to {percent(need.share.high)})")
    mean = None if together else sized(term, spreads.mean.value, spreads.mean_sd)
    between = (
        spread_text(term, "turn_on").removesuffix(f" {printed}"),
        percents(spreads.common_share) if changes(term) else "",
    )
    told = ("",) * 3
    if all_units := need.pooled:
        limit = signed(below(all_units.limit, *unit_of(term)))
        told = (f"{all_units.inclusion:.3f}", percents(all_units.share), limit)
    return (
        Markup("{}{}").format(term.name, quiet(", all") if together else ""),
        "by axis"
        if together and len(answers) > 1
        else verdict(need.verdict, reason=need.reason, like=LIKE.get(need.verdict, "")),
        joined(needing, share),
        *told,
        signed(mean),
        spread_text(term, "unit_to_unit").removesuffix(f" {printed}"),
        *(between if repeated else ()),
        quiet(signed(sized(term, math.hypot(spreads.noise, spreads.alias)))),
        printed,
    )


SESSION_HEAD = (
    "parameter", "sd of one session", "sd between sessions", "90 % interval", "unit", "largest pull", "of",
    "by chance, p", "repeats",
)  # fmt: skip

SESSION_NOTE = (
    "A pull is the difference of two sessions over the sd of that difference. A parameter repeats when"
    " the scatter of its sessions about each unit's mean is what their posteriors allow (p at or above"
    " the level stated above); the sd between sessions is what has to be added to a session's own error"
    " bar when its result is used in another one."
)


def session_section(result: StudyResult) -> Section | None:
    """Comparison of sessions; None where the study has none."""
    if not result.sessions:
        return None
    told = [row for row in result.sessions if not math.isnan(row.p_value)]
    shown = sorted(together(told), key=lambda row: (row.p_value, -largest_pull(row)[0]))[:MOST_ROWS]
    left = len(result.sessions) - len(shown)
    note = f"{SESSION_NOTE} {left} more parameters are in result.json." if left else SESSION_NOTE
    rows = []
    for repeated in shown:
        pull, where = largest_pull(repeated)
        typical, *ends = (
            signed(sized(repeated, x)) for x in (float(np.nanmedian(repeated.sd)), *repeated.between)
        )
        spread = (typical, ends[0], f"{ends[1]} to {ends[2]}", pretty(repeated.printed))
        chance = (
            f"{pull:.1f} sd",
            where,
            probability(repeated.p_value),
            "✗ no" if repeated.exceeds else "✓ yes",
        )
        rows.append((repeated.parameter, *spread, *chance))
    label = "Repeatability between sessions"
    table = Table(label, SESSION_HEAD, rows, "tnnntntnt", note, brief=False)
    said = Prose(session_sentence(result.sessions))
    return Section("Between sessions", [said, table] if rows else [said], "sessions", brief=True)


def largest_pull(repeated: Repeatability) -> tuple[float, str]:
    """Largest difference of two sessions in sd, and of which unit between which sessions."""
    size = np.nan_to_num(np.abs(repeated.pulls))
    if not size.size or not size.any():
        return 0.0, ""
    u, a, b = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
    first, second = sorted((a, b))
    return float(
        size[u, a, b]
    ), f"{repeated.units[u]}, {repeated.sessions[first]} to {repeated.sessions[second]}"


def together(parameters: Sequence[Repeatability]) -> list[Repeatability]:
    """Leave a triad's axes to the parameter that holds them all together."""
    names = {repeated.parameter for repeated in parameters}
    return [
        repeated
        for repeated in parameters
        if "." not in repeated.parameter or repeated.parameter.rpartition(".")[2] not in names
    ]


def session_sentence(parameters: tuple[Repeatability, ...]) -> str:
    """Say which parameters change between sessions by more than their posteriors allow."""
    every = together(parameters)
    told = [repeated for repeated in every if not math.isnan(repeated.p_value)]
    moving = sorted(
        (repeated for repeated in told if repeated.exceeds), key=lambda repeated: repeated.p_value
    )
    silent = [repeated.parameter for repeated in every if math.isnan(repeated.p_value)]
    count = counted(len(told), "parameter")
    if moving:
        change = f"change{'s' if len(moving) == 1 else ''}"
        text = f"In these sessions {len(moving)} of {count} {change} {_moving(moving)}"
    elif told:
        text = f"Of {count} none changes between sessions by more than its error bars allow."
    else:
        text = "The sessions cannot be compared."
    if told:
        text += (
            f" Each test alarms below p {told[0].level:.1g}, so that chance alone makes"
            f" {100 * SUSPECT:.0f} % of studies at most do so."
        )
    return text + (f" The sessions cannot tell of {listed(silent)}." if silent else "")


def _moving(moving: Sequence[Repeatability]) -> str:
    most = listed(
        f"{repeated.parameter} (sd {sized(repeated, repeated.between[0])})"
        for repeated in moving[:MOST_NAMES]
    )
    others = f", and {len(moving) - MOST_NAMES} more" if len(moving) > MOST_NAMES else ""
    text = (
        f"between sessions by more than the error bars allow: {most}{others}."
        " What one session finds holds for the next only within these sds."
    )
    alike = [repeated for repeated in moving if repeated.shared > max(COMMON, 2.0 / len(repeated.units))]
    if not alike:
        return text
    shares = listed(
        f"{percent(repeated.shared)} of the scatter of {repeated.parameter}"
        for repeated in alike[:MOST_NAMES]
    )
    return f"{text} There all units have {shares} in common, as temperature would make it."
