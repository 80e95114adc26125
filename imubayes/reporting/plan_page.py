"""The report on a plan: one page and its numbers, the answer in words, and the dwells for the bench."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import count, groupby

import numpy as np
from markupsafe import Markup

from imubayes.planning import starts
from imubayes.planning.proposal import Outcome, Proposal
from imubayes.reporting import blocks, canvas
from imubayes.reporting.lots_words import capitalised
from imubayes.reporting.result import published
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.plans import Plan, PlanFound, PlanResult
from imubayes.reporting.rounding import measured, percent, pretty, unit_of
from imubayes.selection.verdicts import listed
from imubayes.units import counted

AIMS = {
    "worst": "the worst-determined of the needed terms",
    "D": "the volume of what is left open of the needed terms",
    "scene": "what the calibration leaves open in the scene",
}
"""What a plan makes small, in words."""

ROW = 19
"""px of a term's row."""

CALLED = {"even": "evenly", "same": "same equipment", "best": "best plan"}
"""Plans by their names, in the order in which they are told."""

DWELL_HEAD = ("no.", "record from", "set to", "record for")
NEXT_HEAD = ("run", "mount", "set to", "record for", "takes", "left open")

ORDER = (
    "Times are from the start of the work; the order matters, for it keeps drift apart from the terms. Axes"
    " are those of the case{}. In a plane the first axis is up at 0 deg and the second one at 90 deg."
)
OWN = ": i the input axis, j and k with it right-handed"


def plan_page(proposal: Proposal) -> blocks.Page:
    """Page of a plan."""
    time = lasting(proposal.study.time)
    order = ORDER.format(OWN if "" in proposal.study.libraries else "")
    (first, rest), best = blocks.parted(plan_answer(proposal)), proposal.best
    made = Markup(
        "It took {:.0f} s. Beside this page, plan.toml holds the planned runs as a study:"
        " <code>imubayes run plan.toml</code> simulates and analyses them. Seed {}."
    ).format(proposal.seconds, proposal.study.seed)
    return blocks.Page(
        proposal.study.title,
        f"A plan for {time}, made before the test: what it will tell, and what to set, dwell by dwell.",
        first=[blocks.answer(first), _predicted(proposal)],
        counts=f"{counted(len(best.steps), 'dwell')} in {lasting(best.seconds)}",
        data="planned",
        blocks=[
            blocks.Section(
                "What it will tell", [blocks.Prose(" ".join(rest)), *_terms(proposal)], "terms", brief=True
            ),
            blocks.Section("What the data cannot tell apart", [*_open(proposal)], "open"),
            blocks.Section(
                "The plan", [blocks.Prose(blocks.Both(order, None)), *_mounts(proposal)], "plan", brief=True
            ),
            blocks.Section("The next dwell", [*_next(proposal)], "next"),
            blocks.repeat(f"imubayes plan {proposal.study.path}", proposal.study.text, made),
        ],
    )


def _terms(proposal: Proposal) -> Iterator[blocks.Block]:
    names, done = [CALLED[name] for name in proposal.outcomes], _done(proposal)
    known = f" What the runs {done} say is known already." if done else ""
    told = "; ".join(
        f"{capitalised(name)}: {counted(len(outcome.steps), 'dwell')} in {lasting(outcome.seconds)}"
        for name, outcome in zip(names, proposal.outcomes.values(), strict=True)
    )
    yield blocks.Prose(f"The plan makes small: {AIMS[proposal.study.aim]}.{known} {told}.")
    head = ["term", "", "unit", "prior sd", *(["known"] if done else []), *names]
    yield blocks.Table(
        "Predicted sd of every term",
        [*head, *(["scene's need"] if np.isfinite(proposal.need).any() else []), "simulated / predicted"],
        term_rows(proposal),
        note="Predicted sd of each term in its unit, the errors of the bench and the drift of the sensor"
        " allowed for. The last column is the root mean square error of the best plan's estimates over"
        f" {proposal.study.units} simulated units, drawn from the prior and sampled with the noise of the"
        " class, over the predicted sd. Where the prediction is right it is 1, give or take"
        f" {(2 * proposal.study.units) ** -0.5:.2f} (one standard error).",
    )


def _predicted(proposal: Proposal) -> blocks.Figure:
    names, scene = [CALLED[name] for name in proposal.outcomes], np.isfinite(proposal.need).any()
    same = f"; squares, the best with the {names[1]}" if len(names) > 2 else ""
    need = "; bars, the sd at which a term has a tenth of the scene's budget" if scene else ""
    return blocks.Figure(
        [predicted_panel(proposal, "p0")],
        "Sd that each plan will leave, over the sd of the class's prior, on a scale of decades; further"
        " left is better, and 1 is as if nothing had been measured. Circles,"
        f" {names[0]}{same}; diamonds, the {names[-1]}{need}.",
    )


def _open(proposal: Proposal) -> Iterator[blocks.Block]:
    if apart := inseparable(proposal, proposal.best):
        yield blocks.Prose(apart, "list")
    else:
        yield blocks.Prose("Nothing: the best plan sees every term that it drives by itself.")
    if before := inseparable(proposal, proposal.even):
        yield blocks.Section("If the positions were gone through evenly", [blocks.Prose(before, "list")])


def _mounts(proposal: Proposal) -> Iterator[blocks.Section]:
    """Dwells of the best plan, and what is to do before them, mount by mount."""
    last, clock, begin = -1, 0.0, starts(proposal.menus, proposal.best.steps).tolist()
    entries = zip(count(1), begin, proposal.best.steps, strict=False)
    for (offer, mount), part in groupby(entries, lambda entry: (entry[2].menu, proposal.words(entry[2])[1])):
        dwells, menu = list(part), proposal.menus[offer]
        todo = [f"set up {lasting(menu.setup)}"] if offer != last and menu.setup else []
        todo += [f"mount {lasting(menu.remount)}"] if menu.remount else []
        todo += [f"settle {lasting(menu.settle)} before every dwell"] if menu.settle else []
        before = f": {', '.join(todo)}" if todo else ""
        rows = [
            (str(number), at_clock(start), proposal.words(step)[2], lasting(step.dwell))
            for number, start, step in dwells
        ]
        _, start, step = dwells[-1]
        end, run = start + step.dwell, proposal.words(step)[0]
        said = blocks.Prose(f"{counted(len(dwells), 'dwell')} in {lasting(end - clock)}{before}.", "note")
        table = blocks.Table(f"Dwells of {run} {mount}", DWELL_HEAD, rows, "n", brief=False)
        yield blocks.Section(f"{run}: {mount}" if mount else run, [said, table], brief=True)
        last, clock = offer, end


def _next(proposal: Proposal) -> Iterator[blocks.Block]:
    after = " after the runs that are done" if _done(proposal) else ""
    yield blocks.Prose(
        f"If there were time for one dwell only{after}, these gain most in the time that they take, handling"
        " included. The last column is the size of what is left open, in the terms of the plan's aim."
    )
    rows = [
        (*proposal.words(step), lasting(step.dwell), lasting(cost), f"{value:.4g}")
        for step, cost, value in proposal.following
    ]
    yield blocks.Table("Best next dwells", NEXT_HEAD, rows)


def predicted_panel(proposal: Proposal, key: str) -> canvas.Drawing:
    """Posterior over prior sd of every term that a plan can tell, and what the scene needs."""
    names = list(proposal.study.terms)
    ratios = np.array([outcome.sd / proposal.prior_sd for outcome in proposal.outcomes.values()])
    shown = [k for k, name in enumerate(names) if name in proposal.needed or ratios[:, k].min() < 0.95]
    y = np.arange(len(shown))[::-1]
    styles = {"even": ("o", canvas.GREY), "same": ("s", canvas.SERIES[1]), "best": ("D", canvas.ACCENT)}
    need = (proposal.need / proposal.prior_sd)[shown]

    def paint(axes: canvas.Axes) -> None:
        for row in y:
            axes.axhline(row, color=canvas.PALE, linewidth=0.8, zorder=0)
        axes.axvline(1.0, color=canvas.GREY, linewidth=0.8, zorder=0)
        for name, ratio in zip(proposal.outcomes, ratios[:, shown], strict=True):
            (marker, color), label = styles[name], CALLED[name]
            axes.plot(ratio, y, marker, color=color, markersize=5, linestyle="none", label=label)
        inside = np.isfinite(need) & (need < 10.0)
        if inside.any():
            mark = {"color": canvas.WARNING, "markersize": 12, "linestyle": "none", "label": "scene's need"}
            axes.plot(need[inside], y[inside], "|", **mark)
        axes.set_yticks(y, [names[k] for k in shown])
        axes.set(xlabel="predicted sd over prior sd", ylim=(-0.7, len(shown) + 1.6))
        canvas.log_scale(axes, "x", 6)
        axes.legend(frameon=False, labelcolor=canvas.INK, fontsize=11, loc="upper left", ncols=2,
                    borderpad=0.0, columnspacing=0.8, handletextpad=0.1)  # fmt: skip

    term, ratio = proposal.worst(proposal.best)
    other, even = proposal.worst(proposal.even)
    of_prior = f"{percent(ratio)} of its prior sd"
    title = f"The worst needed term, {term}, is left {of_prior}; evenly {other} {percent(even)}"
    alt = "Predicted over prior sd, " + "; ".join(
        f"{names[k]} "
        + ", ".join(f"{CALLED[o]} {r:.2g}" for o, r in zip(proposal.outcomes, ratios[:, k], strict=True))
        for k in shown
    )
    height = ROW * (len(shown) + 2) + 46
    return canvas.draw(
        paint, title=title, alt=alt, key=key, room=canvas.Room(height=height, left=52, bottom=40)
    )


def _done(proposal: Proposal) -> str:
    return ", ".join(run.name for run in proposal.study.spec.runs)


def term_rows(proposal: Proposal) -> list[blocks.Row]:
    """Predicted sd of every term in printed units: before, after each plan, and what the scene needs."""
    rows = []
    for k, (name, term) in enumerate(proposal.study.terms.items()):
        _, unit = unit_of(term)
        before = [proposal.prior_sd[k], *([proposal.known_sd[k]] if proposal.study.spec.runs else [])]
        values = [*before, *(outcome.sd[k] for outcome in proposal.outcomes.values())]
        need = [proposal.need[k]] if np.isfinite(proposal.need).any() else []
        texts = [str(measured(v / unit, math.nan)) if math.isfinite(v) else "–" for v in (*values, *need)]
        mark = "needed" if name in proposal.needed else ""
        ratio = f"{proposal.best.simulated[k] / proposal.best.sd[k]:.2f}"
        told = "" in proposal.study.libraries or bool(mark)  # of a whole IMU a terminal has what is needed
        rows.append(blocks.Row((name, mark, pretty(term.printed), *texts, ratio), brief=told))
    return rows


def plan_json(proposal: Proposal) -> str:
    """Text of ``result.json``: SI; what is not finite becomes null."""
    study = proposal.study
    sizes: list[Iterable[object]] = [proposal.prior_sd, proposal.known_sd, proposal.need]
    for name in CALLED:
        told, nothing = proposal.outcomes.get(name), [None] * len(proposal.need)
        sizes.append(list(zip(told.sd, told.simulated, strict=True)) if told else nothing)
    plan = published(
        Plan,
        study,
        sensor=study.spec.id,
        kind="imu" if study.spec.gyroscope else study.spec.kind,
        needed=proposal.needed,
        terms=[
            (name, term.unit, *own) for (name, term), *own in zip(study.terms.items(), *sizes, strict=True)
        ],
        plans=[_plan_found(proposal, *outcome) for outcome in proposal.outcomes.items()],
    )
    head = blocks.header(study, f"imubayes plan {study.path}")
    return result_text(published(PlanResult, proposal, **head, answer=plan_answer(proposal), plan=plan))


def _plan_found(proposal: Proposal, name: str, outcome: Outcome) -> PlanFound:
    worst, ratio = proposal.worst(outcome)
    steps = []
    for step, start in zip(outcome.steps, starts(proposal.menus, outcome.steps).tolist(), strict=True):
        run, *setting = proposal.words(step)
        steps.append((run, start, step.setting, *setting, step.dwell))
    return published(
        PlanFound,
        outcome,
        name=name,
        worst=worst,
        worst_ratio=ratio,
        confounded=outcome.seen.groups,
        steps=steps,
    )


def plan_answer(proposal: Proposal) -> tuple[str, ...]:
    """Sentences that say what the plan gains."""
    study, best = proposal.study, proposal.best
    term, ratio = proposal.worst(best)
    even_term, even_ratio = proposal.worst(proposal.even)
    of = f"of {'what the scene needs' if np.isfinite(proposal.need).any() else 'its prior sd'}"
    sentences = [
        f"{study.spec.id}: {counted(len(best.steps), 'dwell')} in {lasting(best.seconds)} leave {term} worst"
        f" known of {counted(len(proposal.needed), 'needed term')}, to {ratio:.2g} {of}.",
        f"Going evenly through '{study.offers[study.even].run}' for {lasting(proposal.even.seconds)}"
        f" leaves {even_term} at {even_ratio:.2g}; the plan's worst sd is {_compared(ratio, even_ratio)}.",
    ]
    if same := proposal.outcomes.get("same"):
        term, alone = proposal.worst(same)
        sentences.append(
            f"The best plan with that run alone leaves {term} at {alone:.2g}, {_compared(alone, even_ratio)}."
        )
    if study.mission is not None:
        sentences.append(
            f"What the calibration leaves open comes to {best.share_of_budget:.2g} of the budget in"
            f" {study.mission.name}; evenly, to {proposal.even.share_of_budget:.2g}."
        )
    return (*sentences, checked(proposal))


def _compared(ratio: float, even: float) -> str:
    off = round(100.0 * (ratio / even - 1.0))
    return f"{abs(off)} % {'lower' if off < 0 else 'higher'}" if off else "the same"


def checked(proposal: Proposal) -> str:
    """Sentence that holds the prediction for each plan against simulated units."""
    where = [k for k, name in enumerate(proposal.study.terms) if name in proposal.needed]
    ratios = [(o.simulated / o.sd)[where] for o in (proposal.best, proposal.even)]
    best, even = (f"{ratio.min():.2f} to {ratio.max():.2f}" for ratio in ratios)
    return (
        f"Over {proposal.study.units} simulated units the rms errors of the needed terms are {best} of what"
        f" is predicted for the plan, and {even} of what is predicted evenly."
    )


def inseparable(proposal: Proposal, outcome: Outcome) -> tuple[str, ...]:
    """Sentences, one a cause, on what the data of a plan see only in combination."""
    causes: dict[tuple[str, str, bool], list[str]] = {}
    for group in outcome.seen.groups:
        terms = [name for name in group.terms if name in proposal.study.terms]
        bench = len(terms) < len(group.terms)
        why = group.reason.partition(" on the output ")[0] if bench else group.reason
        causes.setdefault((why, group.remedy, bench), []).append(listed(terms))
    said = []
    for (why, remedy, bench), members in causes.items():
        told = "; ".join(dict.fromkeys(members))
        if bench:
            said.append(f"{capitalised(why)} on the output like {told}: {remedy} further.")
        else:
            cause = f", for {why}" if why else ""
            said.append(f"Seen only in combination{cause}: {told}. {capitalised(remedy)}.")
    return tuple(said)


def lasting(seconds: float) -> str:
    """Time in words.

    Examples
    --------
    >>> lasting(60.0), lasting(14340.0), lasting(0.5), lasting(176.6)
    ('1 min', '3 h 59 min', '0.5 s', '177 s')
    """
    if seconds < 60.0 or (seconds < 600.0 and seconds % 60.0):
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60.0)
    hours, rest = divmod(minutes, 60)
    return " ".join(filter(None, (f"{hours} h" if hours else "", f"{rest} min" if rest or not hours else "")))


def at_clock(seconds: float) -> str:
    """Time since the start as on a clock."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
