"""The report on a trade of speed for accuracy: one page, and its numbers."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from itertools import takewhile

import imubayes
from imubayes.ladder import LADDER
from imubayes.ladder.trade import RungTotals, Standing, Traded, allowed, faults
from imubayes.ladder.trade.components import DEFAULT, NAMES
from imubayes.ladder.trade.measurement import Measured
from imubayes.reporting.blocks import Block, Both, Figure, Page, Prose, Section, Table, repeat, strong
from imubayes.reporting.result import published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.plans import Component, ComponentRung, TradeResult
from imubayes.reporting.rounding import duration, percents, times
from imubayes.reporting.trade_figures import error_text, trade_panel

HEADS = ("rung", "time", Both("processor", None), "memory", "off, rms", "largest", Both("Monte Carlo", None),
         Both("foresaw", None), "inclusion off", "other verdicts")  # fmt: skip

SCORE_HEADS = ("rung", "sensors", "90 % intervals hold", "error", "false needed", "false not needed",
               "missed", "cost a sensor")  # fmt: skip

COMPONENT_HEADS = ("component", "rung", "time", "off, rms", "largest", "in", "inclusion off",
                   "other verdicts")  # fmt: skip

OWN_PROCESS = (
    "Each rung has a process of its own, warmed up on a small problem, so that imports and compilation do not"
    " count. Of a rung that takes less than two seconds the fastest of up to five turns counts. Memory is the"
    " peak of the first turn, beside what the process held before."
)

COUNTED = (
    "Intervals are counted over the terms that the test can tell. Error: rms of coefficients under the"
    " full library against the truth, in posterior sd of the best rung that answered the same sensor."
    " False needed: of terms that are zero or below one posterior sd. False not needed: of terms above a"
    " tenth of their prior sd. Missed: left out of the model though above eight posterior sd. Beside a"
    " rate stands its 90 % interval, by the Beta posterior, as if terms were independent."
)


def trade_page(traded: Traded) -> Page:
    """Page of a trade."""
    first, *rest = trade_answer(traded)
    on = ", and on sensors simulated from what was found" if traded.scores else ""
    what = "component" if len(traded.standings) == 1 else f"{len(traded.standings)} components"
    heads = (*COMPONENT_HEADS, *(["other needs of scenes"] if traded.trade.missions else []))
    components = [
        _component_row(standing, m)[: len(heads)] for standing in traded.standings for m in standing.measured
    ]
    by_component = Table("Component by component", heads, components, "ttnnntnw")
    return Page(
        f"Which rung is enough for {traded.trade.path.stem}?",
        f"Speed for accuracy: every method of the ladder on the study’s own {what}{on}. The study:"
        f" {traded.trade.title}",
        first=[Prose(strong(first), "answer"), _figure(traded)],
        data="simulated" if any(subject.lot is not None for subject in traded.trade.subjects) else "",
        blocks=[
            Section("The rungs", [Prose(rest, "list"), *_rungs(traded)], "rungs", brief=True),
            *(
                [Section("Simulated repeats", [_scores(traded)], "repeats", brief=True)]
                if traded.scores
                else []
            ),
            Section("Component by component", [by_component], "components"),
            Section("How to read this", [_meaning(traded)], "meaning"),
            _repeat(traded),
        ],
    )


def _figure(traded: Traded) -> Figure:
    best = traded.best
    return Figure(
        [trade_panel(traded)],
        f"The dot is the coefficient that differs most from {best}’s, the stick goes down to"
        f" the rms of all; {best} itself is hollow and stands at its own Monte Carlo error, below which"
        " (shaded) a difference means nothing. The default has the other colour. The stairs are the"
        " front: no rung beside it is faster and no worse. Dashed: what is good enough. A singular rung is"
        " not drawn.",
    )


def _rungs(traded: Traded) -> Iterator[Block]:
    scenes, head = "", HEADS
    if traded.trade.missions:
        head = (*HEADS, "budgets off", "terms off")
        scenes = (
            " Budgets off: largest change of what a term takes of a scene’s budget, in such budgets; terms"
            " off: by how many terms the models that the scenes require differ, over all components."
        )
    yield Table(
        "The rungs",
        head,
        [_row(place)[: len(head)] for place in traded.places],
        note=f"Off: coefficients against {traded.best}’s, in its posterior sd, the rms and the largest over"
        " tested terms; singular: the rung’s equations have no solution, and its other numbers say little."
        " Monte Carlo: what the rung’s own few draws leave, rms. Foresaw: what a rung says itself that the"
        f" next one would change, at most.{scenes} Times of chains that were cut short are extrapolated to"
        " what was asked of them and marked “about”.",
    )
    told = []
    for place in traded.places:
        title, lacks = LADDER[place.rung]
        told.append(Both(strong(place.rung) + f": {title}" + (f"; it {lacks}" if lacks else "."), None))
    yield Prose(told, "list")


def _row(place: RungTotals) -> tuple[str, ...]:
    """Cells of a rung, and those that need scenes last."""
    return (
        f"{place.rung} (default)" if place.rung == DEFAULT else place.rung,
        seconds_of(place),
        f"{place.processor_seconds:.2g} s",
        bytes_text(place.memory),
        *map(error_text, (place.rms, place.largest, place.monte_carlo, place.foreseen, place.inclusion)),
        str(place.verdicts),
        error_text(place.scene_share),
        str(place.scene_terms),
    )


def _scores(traded: Traded) -> Table:
    if any(subject.lot is not None for subject in traded.trade.subjects):
        drawn = "The simulated sensors are further units of the lots, each on a bench with errors of its own."
    else:
        drawn = (
            "The simulated sensors have coefficients and noise that are drawn from the posterior of"
            f" {traded.standings[0].best}, each by itself, and go through the same tests."
        )
    head = (*SCORE_HEADS, *(["terms off a scene"] if traded.trade.missions else []))
    rows = []
    for score in traded.scores:
        counts = (score.false_needed, score.false_not_needed, score.missed_large)
        wrong = (f"{rate.events} of {rate.of}" for rate in counts)
        right = (score.rung, str(score.repeats), percents(score.coverage.share), error_text(score.error))
        rows.append((*right, *wrong, f"{score.cost:.2f}", f"{score.scene_terms:.1f}")[: len(head)])
    return Table("Simulated repeats", head, rows, note=f"{drawn} {COUNTED}")


def _component_row(standing: Standing, trial: Measured) -> tuple[str, ...]:
    apart, off = trial.difference, ("", "", "", "", "held against")
    if trial.rung != standing.best:
        verdicts = "; ".join(f"{name}: {said}, not {right}" for name, said, right in apart.verdicts)
        rms, largest, inclusion = map(error_text, (apart.rms, apart.largest, apart.inclusion))
        off = (rms, largest, apart.worst, inclusion, verdicts)
    needs = "; ".join(f"{scene.scene}: {', '.join(scene.terms)}" for scene in apart.scenes if scene.terms)
    return standing.subject, trial.rung, f"{trial.seconds:.2g} s", *off, needs


def _meaning(traded: Traded) -> Prose:
    good = (
        f"Good enough: no coefficient off by more than {allowed(traded.floor[0]):.2g} posterior sd (a"
        " tenth, or twice the Monte Carlo error of a difference), no inclusion by more than 0.1, and 90 %"
        " intervals that hold 90 % of the truths, or more."
    )
    best = (
        f"The rungs are compared with {traded.best}, the highest with long enough chains. What all of them"
        " take for granted, that the model is linear and the noise is made of N, B and K, is not tested"
        " here."
    )
    return Prose([OWN_PROCESS, good, best], "list")


def _repeat(traded: Traded) -> Section:
    machine = traded.machine
    load = "" if math.isnan(machine.load) else f" Load at the end: {machine.load:.1f}."
    said = (
        f"{machine.processor}, {machine.cores} cores; {machine.system}.{load} It took"
        f" {duration(traded.seconds)}. Seed {traded.trade.seed}."
    )
    versions = {"imubayes": imubayes.__version__, **machine.versions}
    return repeat(command(traded), traded.trade.text, said, made_with=versions)


def command(traded: Traded) -> str:
    """The command that made it; only what is not the usual is said."""
    trade = traded.trade
    parts = ["imubayes trade", shlex.quote(str(trade.path)), f"--repeats {trade.repeats}"]
    parts += [f"--only {shlex.quote(','.join(trade.only))}"] if trade.only else []
    parts += [f"--rungs {','.join(trade.rungs)}"] if trade.rungs != NAMES else []
    return " ".join([*parts, f'--limit "{trade.limit:g} s"'])


def trade_json(traded: Traded) -> str:
    """Text of ``result.json``: every number, SI; what is not finite becomes null."""
    trade, components = traded.trade, []
    for standing in traded.standings:
        rungs, skipped = tuple(map(_component_rung, standing.measured)), dict(standing.skipped)
        told = {
            "id": standing.subject,
            "monte_carlo_floor": standing.floor,
            "skipped": skipped,
            "rungs": rungs,
        }
        components.append(published(Component, standing, **told))
    document = published(
        TradeResult,
        traded,
        trade,
        imubayes=imubayes.__version__,
        study=trade.title,
        answer=trade_answer(traded),
        default=DEFAULT,
        monte_carlo_floor=traded.floor,
        good_enough=allowed(traded.floor[0]),
        rungs=traded.places,
        components=components,
        provenance={"study_file": str(trade.path), "study_text": trade.text, "command": command(traded)},
    )
    return result_text(document)


def _component_rung(trial: Measured) -> ComponentRung:
    columns = (trial.names, trial.mean, trial.full_mean, trial.full_sd, trial.inclusion, trial.verdicts)
    return published(
        ComponentRung,
        trial,
        seconds_to_what_was_asked=trial.whole_seconds,
        foreseen_change_sd=trial.foreseen[0],
        foreseen_change_inclusion=trial.foreseen[1],
        terms=tuple(zip(*columns, strict=True)),
    )


def trade_answer(traded: Traded) -> tuple[str, ...]:
    """The recommendation with its reasons, and the place of the default."""
    return (_recommendation(traded), *_cheaper(traded), *_default(traded), *_best(traded))


def _recommendation(traded: Traded) -> str:
    place, score = traded.place(traded.recommended), traded.score(traded.recommended)
    name = f"Take {traded.recommended} ({LADDER[traded.recommended][0]})"
    if place is None:
        return f"{name}."
    if reasons := [*faults(place, score, traded.floor[0])]:
        return (
            f"{name}: no rung is good enough, and it is the best that was measured; {' and '.join(reasons)}."
        )
    if place.rung == traded.best:
        floor = f", with a Monte Carlo error of up to {traded.floor[0]:.2g} posterior sd"
        off = f"the others are held against it{floor if traded.floor[0] > 0.0 else ''}"
    else:
        off = (
            f"no coefficient is off by more than {place.largest:.2g} posterior sd"
            f" ({allowed(traded.floor[0]):.2g} is allowed), no inclusion by more than {place.inclusion:.2g}"
        )
    held = f", and its 90 % intervals hold {percents(score.coverage.share)} of the truths" if score else ""
    return f"{name}: the cheapest that is good enough, {seconds_of(place)}; {off}{held}."


def _cheaper(traded: Traded) -> Iterator[str]:
    cheaper = takewhile(lambda place: place.rung != traded.recommended, traded.places)
    said = [
        f"{total.rung} ({seconds_of(total)}): {wrong}"
        for total in cheaper
        if (wrong := _worst(traded, total))
    ]
    if said:
        yield f"Not cheaper: {'; '.join(said)}."


def _worst(traded: Traded, place: RungTotals) -> str:
    return next(faults(place, traded.score(place.rung), traded.floor[0]), "")


def _default(traded: Traded) -> Iterator[str]:
    place = traded.place(DEFAULT)
    if place is None:
        return
    if traded.recommended == DEFAULT:
        yield f"That is what a run takes without being asked{_above(traded, place)}."
        return
    how = _worst(traded, place) or "it is good enough too"
    recommended = traded.place(traded.recommended)
    ratio = place.whole_seconds / recommended.whole_seconds if recommended else math.nan
    much = "about" if 0.85 < ratio < 1.15 else f"{times(ratio)} times"
    yield (
        f"A run takes {DEFAULT} without being asked: {much} the recommended rung's time; {how}"
        f"{_above(traded, place)}."
    )


def _above(traded: Traded, place: RungTotals) -> str:
    names = [total.rung for total in traded.places]
    above = traded.places[names.index(place.rung) + 1 :]
    if not above:
        return ""
    if place.rms <= traded.floor[1]:
        gain = "nothing that can be told from Monte Carlo error"
    else:
        gain = f"{place.rms:.2g} posterior sd rms (Monte Carlo error {traded.floor[1]:.2g})"
    more = times(above[-1].whole_seconds / place.whole_seconds)
    return f"; {above[-1].rung} would take {more} times as long and change {gain}"


def _best(traded: Traded) -> Iterator[str]:
    for standing in traded.standings:
        for trial in standing.measured:
            if trial.wanting > 1.0:
                yield (
                    f"{standing.subject}: {trial.rung} ran for {duration(trial.seconds)} and has"
                    f" {trial.ess:,.0f} effective draws ({traded.trade.ess:,.0f} are asked for); until its"
                    f" chains count as converged it would take about {duration(trial.whole_seconds)}, by the"
                    " measured seconds a step."
                )
        for rung, reason in standing.skipped:
            yield f"{standing.subject}: {rung} was left out: {reason}."
    there = {standing.subject for standing in traded.standings}
    missing = [subject.name for subject in traded.trade.subjects if subject.name not in there]
    if missing:
        yield f"No time was left to measure {', '.join(missing)}: give a larger --limit."
    for name, reason in traded.trade.left_out:
        yield f"{name} was left out: {reason}."
    if traded.dear:
        yield f"Simulated repeats did not afford {', '.join(traded.dear)}."


def seconds_of(place: RungTotals) -> str:
    """Wall time of a rung; what is extrapolated says so."""
    text = duration(place.whole_seconds)
    return f"about {text}" if place.whole_seconds > 1.01 * place.seconds else text


def bytes_text(size: float) -> str:
    """Write bytes in MB or GB.

    Examples
    --------
    >>> bytes_text(6.7e6), bytes_text(2.4e9), bytes_text(float("nan"))
    ('6.7 MB', '2.4 GB', '')
    """
    if math.isnan(size):
        return ""
    unit, scale = ("GB", 1e9) if size >= 1e9 else ("MB", 1e6)
    return f"{size / scale:.{0 if size / scale >= 100.0 else 1}f} {unit}"
