"""The report of a class-level study: one page and its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from markupsafe import Markup

from imubayes.population import needs, statements
from imubayes.population.lots import COUNTS, LotResult, agreements
from imubayes.population.needs import MissionFound
from imubayes.reporting import lots_sentences, rounding
from imubayes.reporting.blocks import (
    Block,
    Both,
    Figure,
    Page,
    Prose,
    Row,
    Section,
    Table,
    answer,
    header,
    joined,
    link,
    parted,
    repeat,
    strong,
    swatch,
)
from imubayes.reporting.lots_figures import scene_matrix, slide
from imubayes.reporting.lots_words import (
    Said,
    amid,
    budget,
    capitalised,
    class_name,
    found_of,
    in_scene,
    of_tests,
    plain,
    population_cells,
    ranged_in,
    scene_name,
    share_in,
    simulated,
    slug,
    status,
)
from imubayes.reporting.method_views import methods_beside
from imubayes.reporting.result import published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.many import Class, ClassInScene, ClassTermInScene, Lots, LotsResult
from imubayes.reporting.scene_words import HISTORY_NOTE, history_figure
from imubayes.sensors.catalogue import prior_sd

SLIDE_KEY = (
    "A row is a class. By scene: terms needed, and with +? those that would matter there by the catalogue, of"
    " which its tests cannot tell. By term: over the scenes."
)

BESIDE = " The same picture is beside this report, as slide.svg and slide.png."

ORDER_NOTE = (
    "Counted unit by unit: median unit, and 90 % of the units. Shown: terms that the unit's test shows"
    " to be there; in a scene: terms of the unit's smallest model for its budget, shown or not. Units"
    " need different terms, so that this is not the count of what the class needs. 0: without any term"
    " the error stays within the budget."
)

SCENES_KEY = Markup(
    "A square is a term's share of the budget in the median unit, its side a logarithm: a point below 1"
    " %, {}below 10 %, {}below the budget, {}the budget or more. A frame: needed, which the tests show,"
    " and the smallest model of half of the units or more has it; without one other terms can take it up."
    " Hatched, and ?: the tests cannot tell;"
    " hatched, it would matter by the sizes of the catalogue. A term whose share is below 1 % in every"
    " class is left out."
).format(*map(swatch, ("#7d838c", "#0072B2", "#D55E00")))

TRIAD = (
    "Bias, scale and misalignment take up what the other terms do over a scene as well as they can; the"
    " table has what is left, as a share of the budget, in the median unit. What the test does not know of"
    " the triad itself is not in it: the larger model does not know it either."
)

POPULATION_HEAD = ("term", "symbol", "mean", "true", "spread", "true", "unit", "typical", "shown", "open",
                   "together", "limit", "class")  # fmt: skip

POPULATION_NOTE = (
    "Mean and spread of the units of a lot, a hierarchical posterior with 90 % intervals; of several lots the"
    " middle one's, the lowest and the highest; true: of what was simulated; typical: size in the catalogue;"
    " shown, open: shares of the units, over lots; together: probability that units have the term, by all"
    " at once; limit: the size that a further unit's stays below with 95 %, none where by these odds it has"
    " no such term; class: what all of that says."
)

STATEMENTS_NOTE = (
    "Confirmed: what is said to be there, if the tests show it of classes; what is said not to be, if"
    " a further unit's stays below 10 % of every scene's budget with 95 %; a size, if units of the class can"
    " have it. Contradicted: if it is otherwise for one of the classes."
)

SCENE_NOTE = (
    "Rms of the effect on the output, and share of the budget: median unit, and 5 to 95 % of the units;"
    " required: share of the units whose smallest model has the term, shown or not. Up to: of a term that"
    " the tests leave open, at the size that a further unit's stays below with 95 %. Shares are of the term"
    " alone; taken up: models do without it where other terms take it up. Or more: there the linear"
    " propagation ends, and a full navigator makes at least that of it. Terms that no unit requires and that"
    " take below 1 % are left out."
)


def lots_page(result: LotResult) -> Page:
    """Page of a class-level study."""
    study, answers = result.study, lots_sentences.lots_answer(result)
    scenes = [_scene(result, k) for k in range(len(study.missions))]
    said = f"It took {rounding.duration(result.seconds)} with {study.processes} processes. Seed {study.seed}."
    return Page(
        study.title,
        f"{study.lots * study.units} simulated {study.kind}s of each of {len(result.classes)} classes, each"
        " through a test campaign with coloured noise and an imperfect bench.",
        first=[
            Prose(_linked([(strong(answers[0][0]), answers[0][1])]), "answer"),
            Figure([slide(result, "slide")], SLIDE_KEY + BESIDE, "tiles of each class by scene and by term"),
            Prose(simulated(result), "note"),
        ],
        counts=status(result),
        data="simulated",
        blocks=[
            Section(
                "Which terms each class needs", [*_needed(result, answers[1:])], "needed-terms", brief=True
            ),
            *([Section("Which terms each scene requires", scenes, "scenes")] if scenes else []),
            *([_basic(result)] if study.basic else []),
            _check(result),
            *_published_statements(result),
            *methods_beside(result),
            Section("The classes", [_class(result, k) for k in range(len(result.classes))], "classes"),
            repeat(f"imubayes run {study.path}", study.text, said),
        ],
    )


def _linked(answers: Sequence[Said]) -> Both:
    """Sentences, each with a link to the numbers behind it."""
    parts = (part for text, anchor in answers for part in (text, link("numbers", anchor)))
    return Both(joined(*parts), joined(*(text for text, _ in answers)))


def _needed(result: LotResult, answers: Sequence[Said]) -> Iterator[Block]:
    yield Prose(_linked(answers))
    shown = (
        link(of_tests(result, needs.NEEDED), "needed-terms"),
        *(amid(grade.order) for grade in result.classes),
    )
    rows = [Row(shown, "order-shown"), *_by_scene(result, "order", lambda scene: amid(scene.order))]
    head, label = ("terms", *map(_name, result.classes)), "Size of the models by class and scene"
    table = Table(label, head, rows, "tn", ORDER_NOTE, beside=True)
    yield Section("Size of the models", [table], "order", brief=True)


def _name(grade: needs.ClassFound) -> str:
    return class_name(grade.sensor_class)


def _by_scene(result: LotResult, what: str, told: Callable[[MissionFound], str]) -> Iterator[Row]:
    for k, mission in enumerate(result.study.missions):
        name = link(scene_name(mission.name), slug("scene", mission.name))
        cells = (name, *(told(grade.missions[k]) for grade in result.classes))
        yield Row(cells, slug(what, mission.name))


def _scene(result: LotResult, k: int) -> Page:
    mission, panel = result.study.missions[k], scene_matrix(result, k, f"scene{k}")
    name, anchor = scene_name(mission.name), slug("scene", mission.name)
    owners = ((_name(grade), slug("class", grade.sensor_class.id, mission.name)) for grade in result.classes)
    links = Markup(", ").join(link(*owner) for owner in owners)
    first, rest = parted(lots_sentences.scene_sentences(result, k))
    return Page(
        capitalised(name),
        f"Which terms does the scene {name} require? {capitalised(budget(mission, result.study.kind))}.",
        first=[answer(first), Figure([panel], joined(SCENES_KEY, Markup("Numbers: {}.").format(links)))],
        data="simulated",
        blocks=[
            *([Section("Further", [Prose(rest, "list")], f"{anchor}-further")] if rest else []),
            Section(
                "The motion",
                [Prose(HISTORY_NOTE, "note"), history_figure(mission, f"met{k}")],
                f"{anchor}-motion",
            ),
        ],
        anchor=anchor,
    )


def _basic(result: LotResult) -> Section:
    rows = list(_by_scene(result, "basic", lambda scene: share_in(scene, scene.basic_share)))
    table = Table("What the basic triad leaves", ("scene", *map(_name, result.classes)), rows, beside=True)
    said = [Prose(TRIAD), table]
    return Section("What the basic triad of 12 parameters costs", said, "basic", listed="The basic triad")


def _check(result: LotResult) -> Section:
    """Answers against the simulated truth: what, how many are counted, and the share."""
    check = result.check
    cells, true = check.cells
    covered = {
        "population mean": check.population_mean,
        "population spread": check.population_spread,
        "share of a budget, over units": check.shares,
        "share of a budget, each unit": check.unit_shares,
    }
    rows = [
        ("precision", f"{cells:,} cells", rounding.percents(check.precision)),
        ("recall", f"{true:,} required", rounding.percents(check.recall)),
        *(
            (what, f"{rate.events:,} of {rate.of:,} held", rounding.percents(rate.share))
            for what, rate in covered.items()
        ),
    ]
    linked = [Row((link(what, "check"), *told), slug("check", what)) for what, *told in rows]
    table = Table("Answers against the simulated truth", ("", "counted", "share (90 %)"), linked)
    said = Prose(f"{' '.join(lots_sentences.check_sentences(result))} Intervals are meant to hold 90 %.")
    turning = result.study.library.kind == "gyroscope"
    gyroscopes = ", or of fibre-optic and laser gyroscopes" if turning else ""
    simulated = Prose(lots_sentences.SIMULATED.format(gyroscopes=gyroscopes))
    title, parts = "Against the simulated truth", [said, table, simulated]
    return Section(title, parts, "check", listed="Against the truth", brief=True)


def _published_statements(result: LotResult) -> Iterator[Section]:
    """Statements of the literature on the study's classes, each with what the study makes of it."""
    told = statements.judged(result.study.kind, result.classes)
    if not told:
        return
    rows = [(statement.text, statement.source, *found_of(statement, result.classes)) for statement in told]
    head = ("published statement", "source", "in this study", "verdict")
    table = Table("Published statements", head, rows, "wwwt", STATEMENTS_NOTE)
    said = [Prose(lots_sentences.statements_sentence(told)), table]
    yield Section("Against what is published", said, "published", listed="Against the literature")


def _class(result: LotResult, k: int) -> Page:
    grade, lib = result.classes[k], result.study.library
    entry, title = grade.sensor_class, capitalised(_name(grade))
    alone, examples = replace(result, classes=(grade,)), ", ".join(entry.examples[:3])
    first, rest = parted(lots_sentences.class_sentences(grade, len(lib.terms)))
    rows = _population_rows(result, grade)
    table = Table(f"Population of {title}", POPULATION_HEAD, rows, "ttn", POPULATION_NOTE)
    return Page(
        title,
        f"Which terms does this class need? {entry.technology}, {entry.grade} ({examples}).",
        first=[
            answer(first),
            Figure([slide(alone, f"slide{k}")], SLIDE_KEY, "tiles of the class by scene and by term"),
        ],
        counts=status(alone),
        data="simulated",
        blocks=[
            Section("The population", [Prose(" ".join(rest)), table], slug("class", entry.id, "population")),
            *(_own_scene(result, grade, m) for m in range(len(grade.missions))),
        ],
        anchor=slug("class", entry.id),
    )


def _population_rows(result: LotResult, grade: needs.ClassFound) -> list[Row]:
    entry = grade.sensor_class
    lib = replace(result.study.library, technology=entry.technology)
    rows, cells = [], population_cells(grade.terms, lib, true=True)
    for term, population, (name, *about, needed, open_) in zip(lib.terms, grade.terms, cells, strict=True):
        _, size = rounding.unit_of(term)
        typical = plain(prior_sd(entry, term)[0] / size)
        limit = plain(population.pooled.limit / size) if population.pooled.limit else "none"
        answer = of_tests(result, population.answer)
        told = (needed, open_, f"{population.pooled.inclusion:.3f}", limit, answer)
        row = (link(name, "needed-terms"), *about, typical, *told)
        rows.append(Row(row, slug("class", entry.id, name)))
    return rows


def _own_scene(result: LotResult, grade: needs.ClassFound, k: int) -> Section:
    mission, scene, kind = result.study.missions[k], grade.missions[k], result.study.kind
    unit, size = rounding.output_unit(kind)
    rows = [
        (
            link(term.name, slug("scene", mission.name)),
            plain(term.rms / size),
            ranged_in(scene, term),
            rounding.share(term.true_share),
            rounding.percent(term.required),
            in_scene(term),
        )
        for term in scene.terms
        if term.required > 0.0
        or max(term.share.high, term.true_share) >= COUNTS
        or term.answer == needs.WOULD_MATTER
    ]
    name = scene_name(scene.name)
    label = f"{capitalised(_name(grade))} in the scene {name}"
    head = ("term", f"rms, {rounding.pretty(unit)}", "share of the budget", "true share", "required", "class")
    parts: list[Block] = [Prose(" ".join(lots_sentences.own_scene_sentences(scene)))]
    if rows:
        parts.append(Table(label, head, rows))
    if scene is grade.missions[-1]:
        parts.append(Prose(SCENE_NOTE, "note"))
    anchor = slug("class", grade.sensor_class.id, scene.name)
    return Section(capitalised(name), parts, anchor, budget(mission, kind))


def lots_json(result: LotResult) -> str:
    """Text of ``result.json`` of a class-level study."""
    return result_text(published_lots(result))


def published_lots(result: LotResult) -> LotsResult:
    """Publish what a class-level study found."""
    study, names = result.study, result.study.library.names
    return LotsResult(
        **header(study, f"imubayes run {study.path}"),
        answer=tuple(text for text, _ in lots_sentences.lots_answer(result)),
        status=status(result),
        simulated=simulated(result),
        scenes=tuple(_published_scene(grade, scene) for grade in result.classes for scene in grade.missions),
        lots=published(
            Lots,
            study,
            terms=names,
            classes=tuple(_published_class(grade, names) for grade in result.classes),
            methods=agreements([unit for grade in result.classes for unit in grade.units], names),
            check=result.check,
            statements=statements.judged(study.kind, result.classes),
        ),
    )


def _published_scene(grade: needs.ClassFound, scene: MissionFound) -> ClassInScene:
    terms = tuple(
        published(
            ClassTermInScene,
            term,
            share_of_budget=term.share.value,
            share_range=(term.share.low, term.share.high),
            true_share_of_budget=term.true_share,
            linear_share_of_budget=term.linear_share,
        )
        for term in scene.terms
    )
    end, least = scene.beyond
    return published(
        ClassInScene,
        scene,
        beyond=None if math.isinf(end) else (end, least),
        sensor=grade.sensor_class.id,
        model=scene.answered(needs.NEEDED),
        would_matter=scene.answered(needs.WOULD_MATTER),
        cannot_tell=scene.answered(needs.UNTOLD),
        terms=terms,
        noise_share_of_budget=scene.noise_share,
        basic_share_of_budget=scene.basic_share,
    )


def _published_class(grade: needs.ClassFound, names: tuple[str, ...]) -> Class:
    return published(
        Class,
        grade,
        id=grade.sensor_class.id,
        needed=grade.answered(needs.NEEDED),
        not_needed=grade.answered(needs.NOT_NEEDED),
        cannot_tell=grade.answered(needs.UNTOLD),
        methods=agreements(grade.units, names),
    )
