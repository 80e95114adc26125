"""Names, numbers and answers of lots and fleets as their reports print them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from imubayes.campaign import Mission
from imubayes.inference import Share
from imubayes.population import needs, statements
from imubayes.population.lots import Against, LotResult
from imubayes.population.needs import MissionFound, MissionTerm, PopulationTerm
from imubayes.reporting import rounding
from imubayes.reporting.blocks import parted
from imubayes.reporting.scene_words import budget_unit
from imubayes.selection.verdicts import listed
from imubayes.sensors import SensorClass
from imubayes.sensors.equations import symbols
from imubayes.sensors.equations.basic import TERMS
from imubayes.sensors.terms import Kind, Library
from imubayes.units import counted

GRADES = ("consumer", "industrial", "tactical", "navigation", "strategic")
"""Words of a class's id that go first in a sentence."""

SPELLED = frozenset({"mems", "fog", "ifog", "rlg", "hrg", "vba", "piga", "sdf", "rig", "dtg", "cvg"})
"""Words of a class's id that are spelled in capitals."""

FEW_WORDS = 15
"""Words of its last sentence, which says what is not needed, before it names classes only."""

MOST_NAMES = 3
"""Classes, or scenes, that a sentence names."""

MOST_SCENES = 5
"""Scenes that the answer to what scenes require names."""

TAKEN_UP = "not needed: taken up"
"""What a page says of a term that most models of a scene do without, though it takes the budget alone."""

Said = tuple[str, str]
"""A sentence, and the anchor of the numbers behind it."""


def class_name(entry: SensorClass) -> str:
    """Name of a class in a sentence.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> [class_name(sensor(name, kind="gyroscope")) for name in ("mems_tactical", "mech_sdf_rig")]
    ['tactical MEMS', 'SDF RIG']
    """
    words = [word for word in entry.id.split("_") if word != "mech"]
    grades = [word for word in words if word in GRADES]
    rest = [word.upper() if word in SPELLED else word for word in words if word not in GRADES]
    return " ".join((*grades, *rest))


def slug(*parts: str) -> str:
    """Anchor of classes, scenes and terms.

    Examples
    --------
    >>> slug("mems_tactical", "uav hover", "b0*T")
    'mems_tactical-uav-hover-b0-T'
    """
    return "-".join(re.sub(r"[^\w]+", "-", part).strip("-") for part in parts)


def capitalised(text: str) -> str:
    """Text that begins a sentence: ``Consumer MEMS``."""
    return f"{text[:1].upper()}{text[1:]}"


def scene_name(name: str) -> str:
    """Name of a scene in a sentence."""
    return name.replace("_", " ")


def of_budget(taken: float, scene: MissionFound | None = None) -> str:
    r"""Share of a budget in words, of that of a scene no more than its linear propagation tells.

    Examples
    --------
    >>> of_budget(0.0004), of_budget(0.62), of_budget(7.3)
    ('below 0.1\xa0% of the budget', '62\xa0% of the budget', '7.3 times the budget')
    """
    text, more = _printed(taken, scene)
    text = text.replace(" %", f"{rounding.NARROW}%")
    return f"{text} the budget{more}" if text.endswith("times") else f"{text} of the budget{more}"


def _printed(taken: float, scene: MissionFound | None) -> tuple[str, str]:
    """Share of a budget, and " or more" where the linear propagation has ended."""
    least = min(scene.beyond) if scene else math.inf
    return rounding.share(min(taken, least)), " or more" if taken >= least else ""


def in_scene(term: MissionTerm) -> str:
    """Answer of a class on a term in a scene, as a page says it."""
    return TAKEN_UP if term.answer == needs.NOT_NEEDED and term.share.value >= 1.0 else term.answer


def share_in(scene: MissionFound, taken: float) -> str:
    """Share of a scene's budget in a table, no more than its linear propagation tells."""
    return "".join(_printed(taken, scene))


def ranged_in(scene: MissionFound, term: MissionTerm) -> str:
    """Share of a scene's budget with its range; what a term that is not shown takes at most."""
    if term.answer in (needs.UNTOLD, needs.WOULD_MATTER):
        most = share_in(scene, term.most_of_budget)
        return most if most.startswith("below") else f"up to {most}"
    value, low, high = (
        share_in(scene, share) for share in (term.share.value, term.share.low, term.share.high)
    )
    return value if value.endswith("more") else f"{value} ({low} to {high})"


def budget(mission: Mission, kind: Kind) -> str:
    """Duration, draws and budget of a scene in words."""
    quantity, limit = mission.budget.quantity, mission.budget.limit
    unit, size = budget_unit(quantity, kind)
    what = "rms error of the output" if quantity == "output" else quantity
    times = len(mission.scene.draws)
    counting = "all rows" if quantity == "output" else "the largest error"
    drawn = f"{counting} of {times} draws, " if times > 1 else ""
    lasts = rounding.duration(mission.scene.duration)
    return f"{lasts}, {drawn}budget {limit / size:.4g} {rounding.pretty(unit)} of {what}"


def amid(share: Share) -> str:
    """Median count of terms, with the range of 90 % of the units: ``12.5 (9 to 14)``."""
    return f"{share.value:.3g} ({share.low:.3g} to {share.high:.3g})"


def found_of(told: statements.Judged, classes: Sequence[needs.ClassFound]) -> tuple[str, str]:
    """What a study finds of the classes that a published statement is about, and the verdict.

    Where classes differ, the verdict names those for which it is as it is.
    """
    names = {grade.sensor_class.id: class_name(grade.sensor_class) for grade in classes}
    owners = {
        word: [names[id] for id, verdict in told.classes.items() if verdict == word]
        for word in (statements.CONFIRMED, statements.CONTRADICTED, statements.BEYOND)
    }
    mixed = len(owners[told.verdict]) < len(told.classes)
    verdict = f"{told.verdict} ({listed(owners[told.verdict])})" if mixed else told.verdict
    if told.why:
        return told.why, verdict
    if told.claims == "needed":
        words = zip(("shown", "not needed", "cannot tell"), owners.values(), strict=True)
        return "; ".join(f"{word}: {listed(of)}" for word, of in words if of), verdict
    said = [
        f"{names[id]}: {_small(low, high)}"
        if told.claims == "small"
        else f"{names[id]}: {plain(low)} to {plain(high)} {rounding.pretty(told.unit)}"
        for id, (low, high) in told.sizes.items()
    ]
    return "; ".join(said), verdict


def _small(taken: float, most: float) -> str:
    """What a median unit takes of a budget, and how much it may be; beyond the budget no figure matters."""
    if taken > 1.0:
        return "more than the budget"
    return f"{of_budget(taken)}, {'may be more' if most > 1.0 else f'at most {rounding.share(most)}'}"


def headline(result: LotResult) -> Said:
    """Answer what the study asks (`LotStudy.asks`) by naming terms, in at most `MOST_WORDS` words."""
    asks = result.study.asks
    last, anchor = "", "needed-terms"
    if isinstance(asks, Against):
        said = _against(result, asks)
    elif asks == "scenes":
        said, anchor = _of_scenes(result), "scenes"
    elif asks == "triad":
        said, anchor = _of_triad(result), "basic"
    elif result.study.missions:
        said, last = _over_scenes(result), _shown(result)
    else:
        needed = {class_name(grade.sensor_class): grade.answered(needs.NEEDED) for grade in result.classes}
        said, last = _by_owner(result, needed, ("class", "classes", "need")), _rest(result.classes)
    return short(map(capitalised, said), last), anchor


def short(sentences: Iterable[str], last: str = "") -> str:
    """As many sentences, the first ones first, as leave room for the last one in an answer.

    Examples
    --------
    >>> short(["Nothing is needed.", "a " * 57 + "a.", "More."], "No more.")
    'Nothing is needed. No more.'
    """
    return " ".join((*parted(sentences, last)[0], last)).rstrip()


def _over_scenes(result: LotResult) -> list[str]:
    """Which classes need which terms in some scene."""
    needed = {
        class_name(grade.sensor_class): [n for n, told in over_scenes(grade).items() if needs.NEEDED in told]
        for grade in result.classes
    }
    first, *more = _by_owner(result, needed, ("class", "classes", "need"))
    count = len(result.study.missions)
    where = f"one or more of {count} scenes" if count > 1 else "the scene"
    return [f"in {where} {first}", *more]


def _shown(result: LotResult) -> str:
    """How many terms the tests show of classes, which scenes need or do not."""
    counts = sorted(len(grade.answered(needs.NEEDED)) for grade in result.classes)
    many = f"{counts[0]} to {counts[-1]}" if counts[0] < counts[-1] else f"{counts[0]}"
    return f"The tests show {many} of {counted(len(result.study.library.terms), 'term')} of a class."


def _rest(classes: Sequence[needs.ClassFound]) -> str:
    """What classes do not need, where it is little, and that of the others the tests cannot tell."""
    idle = {class_name(grade.sensor_class): grade.answered(needs.NOT_NEEDED) for grade in classes}
    without = [f"{name} {listed(terms)}" for name, terms in idle.items() if terms]
    told = f"Not needed: {'; '.join(without)}" if without else "No term is shown not to be needed"
    if len(told.split()) > FEW_WORDS:
        told = f"{capitalised(listed(name for name, terms in idle.items() if terms))} do without others"
    untold = any(grade.answered(needs.UNTOLD) for grade in classes)
    return f"{told}; of the rest the tests cannot tell." if untold else f"{told}."


def _by_owner(
    result: LotResult,
    needed: Mapping[str, Collection[str]],
    words: tuple[str, str, str],
    most: int = MOST_NAMES,
) -> list[str]:
    """Sentences on who needs which terms, those that most need first; up to `most` owners are named."""
    (single, many, need), groups = words, dict[tuple[str, ...], list[str]]()
    for name in result.study.library.names:
        owners = tuple(owner for owner, terms in needed.items() if name in terms)
        groups.setdefault(owners, []).append(name)
    groups.pop((), None)

    def who(owners: Sequence[str]) -> str:
        missing = [name for name in needed if name not in owners]
        if not missing and len(owners) > 1:
            return f"every {single} {need}s"
        if len(owners) <= most:
            return f"{listed(owners)} {need}{'s' if len(owners) == 1 else ''}"
        if len(missing) <= most:
            return f"all but {listed(missing)} {need}"
        return f"{len(owners)} of {len(needed)} {many} {need}"

    ordered = sorted(groups.items(), key=lambda group: (-len(group[0]), -len(group[1])))
    said = [f"{who(owners)} {listed(terms)}." for owners, terms in ordered]
    return said or [f"no {single} is shown to {need} any term."]


def _of_scenes(result: LotResult) -> list[str]:
    needed = dict[str, list[str]]()
    for k, mission in enumerate(result.study.missions):
        votes = Counter(name for grade in result.classes for name in grade.missions[k].answered(needs.NEEDED))
        most = [name for name, count in votes.items() if 2 * count >= len(result.classes)]
        needed[scene_name(mission.name)] = most
    first, *said = _by_owner(result, needed, ("scene", "scenes", "require"), MOST_SCENES)
    idle = [name for name, terms in needed.items() if not terms]
    none = [f"{listed(idle)} {'require' if len(idle) > 1 else 'requires'} none."] if idle else []
    return [f"of half of the classes or more: {first}", *said, *none]


def _of_triad(result: LotResult) -> list[str]:
    """Whether the triad is enough, where it is not, and which terms are needed there beside its own."""
    pairs = [(grade, scene) for grade in result.classes for scene in grade.missions]
    short = sorted((p for p in pairs if p[1].basic_share > 1.0), key=lambda p: -p[1].basic_share)
    if not short:
        return [f"Yes, in all {len(pairs)} pairs of class and scene: it leaves less than the budget."]
    missed = {class_name(grade.sensor_class): set[str]() for grade, _ in short}
    for grade, scene in short:
        missed[class_name(grade.sensor_class)] |= {*scene.answered(needs.NEEDED)} - {*TERMS}
    where = listed(
        f"{class_name(own.sensor_class)} in {scene_name(scene.name)} ({of_budget(scene.basic_share, scene)})"
        for own, scene in short[:MOST_NAMES]
    )
    worst = "worst are " if len(short) > MOST_NAMES else ""
    more = _by_owner(result, missed, ("class", "classes", "need"))
    needed = "; ".join(text.removesuffix(".") for text in more)
    return [
        f"for the median unit yes in {len(pairs) - len(short)} of {len(pairs)} pairs of class and scene,"
        f" no in {len(short)}: {worst}{where}.",
        f"there {needed}, too." if any(missed.values()) else "no other term is shown to be needed there.",
    ]


def _against(result: LotResult, asks: Against) -> list[str]:
    """What some classes all need, by whether the others do; then what only the others need.

    In the study's scenes, where it has some: of themselves classes need what their tests can show.
    """
    mine, others = (
        [grade for grade in result.classes if grade.sensor_class.id in ids]
        for ids in (asks.needed_by, asks.not_by)
    )
    own, their = ([over_scenes(grade) for grade in classes] for classes in (mine, others))
    me, them, names = _called(mine), _called(others), result.study.library.names
    wanted = [n for n in names if all(needs.NEEDED in answers[n] for answers in own)]
    theirs = [n for n in names if any(needs.NEEDED in answers[n] for answers in their)]
    only = [n for n in wanted if all({*answers[n]} == {needs.NOT_NEEDED} for answers in their)]
    both = [n for n in wanted if n in theirs]
    more = [n for n in theirs if n not in wanted]
    untold = [
        n
        for n in more
        if any(needs.NEEDED not in answers[n] and {*answers[n]} != {needs.NOT_NEEDED} for answers in own)
    ]
    need = f"some {them} need" if len(others) > 1 else f"{them} needs"
    alone = [n for n in wanted if n not in (*only, *both)]
    groups = (
        (only, f"{me} needs {{}}, and {them} does not."),
        (both, f"{me} needs {{}}, and {need} them too."),
        (alone, f"{me} needs {{}}; of {them} the tests cannot tell."),
        ([n for n in more if n not in untold], f"{need} {{}}, and {me} does not."),
        (untold, f"{need} {{}}; of {me} the tests cannot tell."),
    )
    said = [] if only else [f"none is shown to be needed by {me} alone."]
    said += [text.format(listed(terms)) for terms, text in groups if terms]
    scenes = [scene_name(mission.name) for mission in result.study.missions]
    if scenes and len(scenes) <= MOST_NAMES:
        said[0] = f"in the scenes {listed(scenes)} {said[0]}"
    return said


def over_scenes(grade: needs.ClassFound) -> dict[str, list[str]]:
    """Answers of a class on each term, one in each scene; without scenes what it says of itself."""
    return {
        term.name: [scene.terms[j].answer for scene in grade.missions] or [term.answer]
        for j, term in enumerate(grade.terms)
    }


def _called(classes: Sequence[needs.ClassFound]) -> str:
    """Name of some classes together: the words that all of them share (``MEMS``), else their names."""
    names = [class_name(grade.sensor_class) for grade in classes]
    shared = [word for word in names[0].split() if all(word in name.split() for name in names)]
    return " ".join(shared) or listed(names)


def status(result: LotResult) -> str:
    """How many answers there are of each kind, over the terms of all classes."""
    classes, terms = len(result.classes), len(result.study.library.terms)
    counts = (
        f"{sum(len(grade.answered(answer)) for grade in result.classes)} {of_tests(result, answer)}"
        for answer in (needs.NEEDED, needs.NOT_NEEDED, needs.UNTOLD)
    )
    each = "each of " if classes > 1 else ""
    return f"{' · '.join(counts)} ({counted(terms, 'term')} of {each}{counted(classes, 'class')})"


def of_tests(result: LotResult, answer: str) -> str:
    """Word for what the tests of a class say, where it is not what its scenes need of it."""
    return "shown" if answer == needs.NEEDED and result.study.missions else answer


def simulated(result: LotResult) -> str:
    """That it is simulated, from how many units, and how many answers hang on which units these were."""
    units, lots, kind = result.study.units, result.study.lots, result.study.kind
    every = [term for grade in result.classes for term in grade.terms]
    loose = f"{sum(map(needs.could_change, every))} of the {len(every)} answers could change (90 % intervals)"
    many = f"{units} {kind}s of each class"
    if lots > 1:
        drawn = "with magnitudes drawn over the class's range"
        return f"Simulated: {lots} lots of {many}, {drawn}. With other lots {loose}."
    others = "other lots may differ by more"
    return f"Simulated: one lot of {many}. With other units of these lots {loose}; {others}."


def population_cells(
    terms: Sequence[PopulationTerm], lib: Library, *, true: bool
) -> Iterator[tuple[str, ...]]:
    """Each term, its symbol, mean and spread of the population, unit, and shares needed and open.

    Mean and spread are beside those of the simulated lot where `true`. A mean is zero where it is nothing but
    rounding beside the spread, as of a term that no test excites.
    """
    spelt = symbols(lib)
    for term, known in zip(lib.terms, terms, strict=True):
        _, size = rounding.unit_of(term)
        truth = [(plain(value / size),) if true else () for value in (known.true_mean, known.true_spread)]
        nothing = max(map(abs, known.mean)) < rounding.DUST * known.spread.value
        mean = "0" if nothing else rounding.ranged(known.mean, size=size)
        spread = rounding.ranged(known.spread, size=size)
        shares = rounding.pretty(term.printed), rounding.percents(known.needed), rounding.percent(known.open)
        yield known.name, spelt[term.name], mean, *truth[0], spread, *truth[1], *shares


def plain(value: float, unit: str = "") -> str:
    """Text of a number of two digits, with a real minus sign."""
    return str(rounding.measured(value, 0.0, unit))
