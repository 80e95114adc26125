"""The report on the hours that classes take: a curve for each class, and the limits of what stays open."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from imubayes.planning.hours import REACH, ClassHours, HoursFound, TermHours
from imubayes.reporting import blocks
from imubayes.reporting.canvas import INK, SERIES, Axes, Drawing, Room, draw, log_scale
from imubayes.reporting.lots_words import MOST_NAMES, class_name, scene_name
from imubayes.reporting.result import plans, published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.rounding import below, duration, share, unit_of
from imubayes.scenes.relevance import MATTERS
from imubayes.selection.verdicts import UNRESOLVED, listed
from imubayes.units import counted

FEW_NAMES = 4
"""Terms that the answer names."""

DAYS = f"{REACH / 86400.0:g} days"

RULE = (
    "A term is told from when on at least half of the units of the class would get a verdict of their own,"
    " needed or not needed; all units of a study together may show it sooner. Units are drawn over the"
    " magnitudes that the catalogue gives the class, which makes the hours uncertain by about a tenth, and by"
    " more where drift leaves little to gain. What is known of a term is its posterior sd beside all other"
    " terms, by the analysis that a unit has, under the typical noise of the class.",
    "The test is gone through in its order, dwell by dwell, and then again from its start with the case"
    " mounted anew. What is wrong with a mount averages down over the repetitions, what is wrong with a"
    " machine or the whole bench does not; within a run flicker and random walk limit what a longer dwell"
    " would tell. Hours are those of the runs, waiting and ramps included; mounting comes on top.",
)

CURVES = "Terms that are told, by hours of test on a scale of decades, a curve for each class."


def hours_page(hours: HoursFound) -> blocks.Page:
    """Page of the hours."""
    (first, rest), table = blocks.parted(hours_answer(hours)), hours_table(hours)
    made = f"It took {hours.seconds:.0f} s. Seed {hours.study.seed}."
    rule = blocks.Prose([blocks.Both(text, None) for text in RULE], "note")
    return blocks.Page(
        f"How long are the classes of {hours.study.path.stem} tested until each term is told?",
        f"What their tests tell by the hour, and what {DAYS} leave open. The study: {hours.study.title}",
        first=[blocks.answer(first), blocks.Figure([all_classes(hours, "a0")], CURVES)],
        data="planned",
        blocks=[
            blocks.Section(
                "The hours of every term", [blocks.Prose(" ".join(rest)), table, rule], "hours", brief=True
            ),
            blocks.Section("The tests", [campaigns(hours)], "classes"),
            blocks.Section(f"What {DAYS} leave open", [_open(hours)], "open", brief=True),
            blocks.repeat(f"imubayes plan {hours.study.path}", hours.study.text, made),
        ],
    )


def hours_table(hours: HoursFound) -> blocks.Table:
    """Hours of each term in each class."""

    def cell(term: TermHours) -> str:
        if math.isfinite(term.seconds):
            return duration(term.seconds, 2)
        return "matters" if matters(term) else "–"

    terms = zip(*(grade.terms for grade in hours.classes), strict=True)
    rows = [(own[0].name, *map(cell, own)) for own in terms]
    head = ("term", *(class_name(grade.sensor_class) for grade in hours.classes))
    note = f"Time of test after which each term is told; a dash: not within {DAYS}" + (
        f", and “matters” where the limit that this sets is {share(MATTERS)} of a scene's budget or more."
        if hours.study.missions
        else "."
    )
    return blocks.Table("Hours after which each term is told", head, rows, "tf", note)


def matters(term: TermHours) -> bool:
    """Whether what is open of a term could matter in a scene."""
    return term.share_of_budget >= MATTERS


def campaigns(hours: HoursFound) -> blocks.Table:
    """How long the test of each class takes, and what it tells."""
    rows = [
        (
            class_name(grade.sensor_class),
            duration(grade.seconds, 2),
            ", ".join(f"{name} {duration(seconds, 2)}" for name, seconds in grade.runs),
            str(grade.told(grade.seconds)),
            str(grade.told(REACH)),
        )
        for grade in hours.classes
    ]
    head = ("class", "test", "its runs", "told by it", f"in {DAYS}")
    return blocks.Table(
        "Tests", head, rows, "tnwn", f"Terms that are told, of {len(hours.study.library.names)}."
    )


def _open(hours: HoursFound) -> blocks.Table | blocks.Prose:
    """Terms that no test within reach tells, with their limits."""
    scenes, rows = ("of a budget", "in scene") if hours.study.missions else (), []
    units = {term.name: unit_of(term) for term in hours.study.library.terms}
    for grade in hours.classes:
        for term in left_open(grade):
            cells = (class_name(grade.sensor_class), term.name, str(below(term.limit, *units[term.name])))
            takes = (share(term.share_of_budget), scene_name(term.scene)) if scenes else ()
            rows.append((*cells, *takes, "catalogue" if term.most > UNRESOLVED else "test"))
    if not rows:
        return blocks.Prose("Nothing.")
    return blocks.Table(
        "Limits of what stays open",
        ("class", "term", "below", *scenes, "by"),
        rows,
        "ttntt" if scenes else "ttnt",
        f"Size that a coefficient is known to stay below with 95 % after {DAYS} where its estimate is zero,"
        " and the largest share of a scene's budget that this takes. Where the posterior sd is more than"
        f" {UNRESOLVED:g} of the prior's, the limit is that of the catalogue.",
    )


def left_open(grade: ClassHours) -> list[TermHours]:
    """Terms of a class that no test within reach tells, those first that take most of a budget."""
    terms = [term for term in grade.terms if math.isinf(term.seconds)]
    if math.isnan(grade.terms[0].share_of_budget):
        return terms
    return sorted(terms, key=lambda term: -term.share_of_budget)


def hours_answer(hours: HoursFound) -> tuple[str, ...]:
    """Sentences that say what the tests tell, and whether it matters what they do not."""
    terms, many = len(hours.study.library.names), len(hours.classes) > 1
    once = [(grade.told(grade.seconds), class_name(grade.sensor_class)) for grade in hours.classes]
    reach = [grade.told(REACH) for grade in hours.classes]
    (first, _), then = once[0], str(reach[0])
    if many:
        (least, quickest), (most, slowest) = (pick(once, key=lambda pair: pair[0]) for pick in (min, max))
        first, then = f"{least} ({quickest}) to {most} ({slowest})", f"{min(reach)} to {max(reach)}"
    whose = "a class" if many else f"the class {class_name(hours.classes[0].sensor_class)}"
    said = (
        f"Gone through once, the test of {whose} tells {first} of its {counted(terms, 'term')}; repeated with"
        f" new mounts for {DAYS}, {then}."
    )
    return (said, *_left(hours))


def _left(hours: HoursFound) -> Iterator[str]:
    """Sentence on what stays open."""
    if not any(left_open(grade) for grade in hours.classes):
        return
    if not hours.study.missions:
        yield "Of what then stays open the report has the limits; a [[scene]] would say which of them matter."
        return
    open_ = [(term.name, grade) for grade in hours.classes for term in left_open(grade) if matters(term)]
    if not open_:
        yield f"What then stays open takes less than {share(MATTERS)} of the budget of any scene."
        return
    yield (
        f"Of what then stays open {_named(open_)} could still take {share(MATTERS)} of a scene's budget or"
        " more; all else takes less in every scene."
    )


def _named(open_: Sequence[tuple[str, ClassHours]]) -> str:
    """Terms with the classes that they are open in; where they are many, how many of each class."""
    names = list(dict.fromkeys(name for name, _ in open_))
    if len(names) <= FEW_NAMES:
        where = {
            name: [class_name(grade.sensor_class) for own, grade in open_ if own == name] for name in names
        }
        return listed(
            f"{name} ({', '.join(of) if len(of) <= MOST_NAMES else counted(len(of), 'class')})"
            for name, of in where.items()
        )
    counts = Counter(class_name(grade.sensor_class) for _, grade in open_)
    return listed([f"{counted(n, 'term')} of {name}" for name, n in counts.items()])


def all_classes(hours: HoursFound, key: str) -> Drawing:
    """Number of terms that are told by hours, a curve for each class."""
    names = [class_name(grade.sensor_class) for grade in hours.classes]

    def paint(axes: Axes) -> None:
        for k, grade in enumerate(hours.classes):
            times = sorted(term.seconds / 3600.0 for term in grade.terms if math.isfinite(term.seconds))
            x, y = [*times, REACH / 3600.0], [*range(1, len(times) + 1), len(times)]
            style = ("-", "--", ":", "-.")[k // len(SERIES) % 4]
            axes.step(x, y, where="post", color=SERIES[k % len(SERIES)], linestyle=style, label=names[k])
        axes.set(xlabel="hours of test", ylim=(0.0, len(hours.study.library.names) + 1.0))
        log_scale(axes, "x", 6)
        axes.legend(frameon=False, labelcolor=INK, fontsize=11, loc="upper center", ncols=2, borderpad=0.0,
                    bbox_to_anchor=(0.46, -0.22), columnspacing=1.0, handlelength=1.6)  # fmt: skip

    told = [grade.told(REACH) for grade in hours.classes]
    span = " to ".join(dict.fromkeys((str(min(told)), str(max(told)))))
    title = f"{DAYS} tell {span} of {len(hours.study.library.names)} terms"
    each = zip(names, hours.classes, told, strict=True)
    alt = "; ".join(f"{name} {grade.told(grade.seconds)}, {reach}" for name, grade, reach in each)
    below_axis = 44 + 18 * math.ceil(len(names) / 2)
    alt = f"Terms told by one test and by 10 days of it: {alt}"
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=200 + below_axis, bottom=below_axis))


def hours_json(result: HoursFound) -> str:
    """Text of ``result.json``: SI; what is not finite becomes null."""
    classes = []
    for grade in result.classes:
        each = zip(grade.terms, result.study.library.terms, strict=True)
        terms = [published(plans.TermHours, hours, term) for hours, term in each]
        told = {"told_once": grade.told(grade.seconds), "told": grade.told(REACH)}
        classes.append(published(plans.ClassHours, grade, grade.sensor_class, **told, terms=terms))
    head = blocks.header(result.study, f"imubayes plan {result.study.path}")
    table = published(plans.Hours, result.study, reach=REACH, classes=classes)
    return result_text(published(plans.HoursResult, result, **head, answer=hours_answer(result), hours=table))
