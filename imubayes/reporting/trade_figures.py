"""Figures of a trade: error against time with the front, and what repeats say, rung by rung."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.ladder.trade.plan import DEFAULT
from imubayes.ladder.trade.recommend import SURE, allowed
from imubayes.ladder.trade.score import INTERVAL
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    WARNING,
    Axes,
    Margins,
    Panel,
    dots,
    draw,
    few_ticks,
    log_scale,
    plain_logs,
)
from imubayes.reporting.rounding import duration
from imubayes.reporting.trade_words import error_text

if TYPE_CHECKING:
    from imubayes.ladder.trade.record import Place, Traded

HEIGHT = 270
"""px."""

NEAR, SIMILAR, ALIKE = 0.06, 3.0, 0.25
"""Share of the time axis, and ratio of heights or share of a linear axis, in which names would overlap."""

SLANT = 62
"""deg; names of rungs whose times are close stand beside each other."""

SPACE = Margins(right=34)
"""Room for the last one's name."""

LEAST = 0.01
"""Error in posterior sd, or of an inclusion, below which nothing is drawn lower."""


def trade_panels(found: Traded) -> tuple[Panel, ...]:
    """Coefficients and inclusions on the study's own data, coverage and wrong verdicts on repeats."""
    return (pareto_panel(found), inclusion_panel(found), *repeat_panels(found))


def pareto_panel(found: Traded) -> Panel:
    """Error of the worst coefficient against time: the front, the Monte Carlo floor, sticks to the rms."""
    floor = max(found.floor[0], LEAST)
    height: dict[RungName, float] = {one.rung: max(one.largest, LEAST) for one in found.places}
    height[found.best] = floor

    def paint(axes: Axes) -> None:
        for one in found.places:
            ends = [min(max(one.rms, LEAST), height[one.rung]), height[one.rung]]
            axes.plot([one.whole_seconds] * 2, ends, color=PALE, linewidth=2.0)
        front = [one for one in found.places if one.rung in found.front]
        _stairs(axes, front, [max(height[one.rung], floor) for one in front])
        _points(axes, found.places, height, hollow=found.best)
        axes.axhline(allowed(found.floor[0]), color=WARNING, linewidth=1.0, linestyle=(0, (4, 3)))
        most = max(max(one.largest for one in found.places), 2.0 * allowed(found.floor[0]))
        least = min(max(one.rms, LEAST) for one in found.places)
        axes.set(xlabel="s", ylabel="posterior sd", ylim=(0.5 * min(least, floor), 12.0 * most))
        axes.set_xlim(*_wide(found.places))
        axes.axhspan(axes.get_ylim()[0], floor, color=PALE, alpha=0.5, linewidth=0.0)
        plain_logs(axes)

    told = "; ".join(
        f"{one.rung} {duration(one.whole_seconds)}, {error_text(one.rms)} rms,"
        f" {error_text(one.largest)} at most"
        for one in found.places
    )
    title = f"Coefficients: {_front_words(found)}"
    return draw(
        paint, title=title, alt=f"Error against time: {told}", key="pareto", height=HEIGHT, margins=SPACE
    )


def _front_words(found: Traded) -> str:
    last = found.place(found.front[-1])
    if last is None or len(found.front) == 1:
        return "the cheapest rung is as good as any"
    return f"errors fall until {last.rung}, {duration(last.whole_seconds)}"


def inclusion_panel(found: Traded) -> Panel:
    """Largest difference of an inclusion against time."""
    height: dict[RungName, float] = {one.rung: max(one.inclusion, LEAST) for one in found.places}

    def paint(axes: Axes) -> None:
        _points(axes, found.places, height, hollow=found.best)
        axes.axhline(SURE, color=WARNING, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.set(xlabel="s", ylabel="difference of inclusion", ylim=(0.5 * LEAST, 10.0))
        axes.set_xlim(*_wide(found.places))
        plain_logs(axes)

    wrong = [k for k, one in enumerate(found.places) if one.inclusion > SURE]
    good = found.places[wrong[-1] + 1].rung if wrong and found.places[wrong[-1] + 1 :] else found.best
    title = f"Inclusions are right from {good} on" if wrong else "Inclusions are right by every rung"
    told = "; ".join(f"{one.rung} {error_text(one.inclusion)}" for one in found.places)
    alt = f"Largest difference of an inclusion against time: {told}"
    return draw(
        paint,
        title=title,
        alt=alt,
        key="inclusion",
        height=HEIGHT,
        margins=SPACE,
    )


def repeat_panels(found: Traded) -> tuple[Panel, ...]:
    """Coverage and wrong verdicts on repeats against time; none where nothing was repeated."""
    places = [one for one in found.places if found.score(one.rung)]
    return (_coverage_panel(found, places), _cost_panel(found, places)) if places else ()


def _coverage_panel(found: Traded, places: Sequence[Place]) -> Panel:
    scores = [one for one in found.scores if found.place(one.rung)]
    height: dict[RungName, float] = {one.rung: one.coverage.share.value for one in scores}

    def paint(axes: Axes) -> None:
        for place, one in zip(places, scores, strict=True):
            share = one.coverage.share
            axes.plot([place.whole_seconds] * 2, [share.low, share.high], color=GREY, linewidth=1.5)
        axes.axhline(INTERVAL, color=WARNING, linewidth=1.0, linestyle=(0, (4, 3)))
        _points(axes, places, height, linear=1.6)
        axes.set(xlabel="s", ylabel="share of the truths held", ylim=(0.0, 1.6), yticks=(0.0, 0.5, 0.9, 1.0))
        axes.set_xlim(*_wide(found.places))
        log_scale(axes, "x")

    short = [one.rung for one in scores if one.coverage.share.high < INTERVAL]
    title = (
        f"90 % intervals are too short: {', '.join(short)}"
        if short
        else "90 % intervals hold what they should"
    )
    told = "; ".join(f"{one.rung} {one.coverage.share.value:.0%}" for one in scores)
    return draw(
        paint,
        title=title,
        alt=f"Coverage of 90 % intervals: {told}",
        key="coverage",
        height=HEIGHT,
        margins=SPACE,
    )


def _cost_panel(found: Traded, places: Sequence[Place]) -> Panel:
    scores = [one for one in found.scores if found.place(one.rung)]
    height: dict[RungName, float] = {one.rung: one.cost for one in scores}

    def paint(axes: Axes) -> None:
        high = 1.4 * max(*height.values(), 0.5)
        _points(axes, places, height, linear=high)
        axes.set(xlabel="s", ylabel="wrong verdicts a sensor", ylim=(-0.06 * high, high))
        axes.set_xlim(*_wide(found.places))
        few_ticks(axes)
        log_scale(axes, "x")

    least = min(scores, key=lambda one: one.cost)
    told = "; ".join(f"{one.rung} {one.cost:.2f}" for one in scores)
    most = max(height.values())
    return draw(
        paint,
        title=f"Wrong verdicts a sensor: {least.cost:.2f} by {least.rung}, {most:.2f} at most",
        alt=f"Wrong verdicts a sensor against time: {told}",
        key="cost",
        height=HEIGHT,
        margins=SPACE,
    )


def _stairs(axes: Axes, places: Sequence[Place], heights: Sequence[float]) -> None:
    """The front: to be better takes the next one's time."""
    x = [one.whole_seconds for one in places]
    axes.step(x, heights, where="post", color=ACCENT, linewidth=1.2)


def _points(
    axes: Axes,
    places: Sequence[Place],
    height: Mapping[RungName, float],
    hollow: RungName | None = None,
    *,
    linear: float | None = None,
) -> None:
    """Every rung as a dot with its name: the default's in the accent, hollow one that has no error.

    `linear` is how high the axis reaches where it is not logarithmic.
    """
    for one in places:
        at = np.array([one.whole_seconds]), np.array([height[one.rung]])
        dots(axes, *at, color=_colour(one), size=8.0)
        if one.rung == hollow:
            dots(axes, *at, color="white", size=5.0)
    for group in _close(places, height, linear):
        axes.annotate(
            ", ".join(one.rung for one in group),
            (group[-1].whole_seconds, height[group[-1].rung]),
            xytext=(5, 6),
            textcoords="offset points",
            rotation=SLANT,
            rotation_mode="anchor",
            color=_colour(group[-1]),
        )


def _colour(place: Place) -> str:
    return ACCENT if place.rung == DEFAULT else INK


def _close(
    places: Sequence[Place], height: Mapping[RungName, float], linear: float | None
) -> list[list[Place]]:
    """Rungs by time, those together whose names would stand on each other."""
    low, high = _wide(places)
    groups: list[list[Place]] = []
    for one in sorted(places, key=lambda place: place.whole_seconds):
        last = groups[-1][-1] if groups else None
        if last is not None and one.whole_seconds < last.whole_seconds * (high / low) ** NEAR:
            pair = sorted((height[last.rung], height[one.rung]))
            if pair[1] - pair[0] <= ALIKE * linear if linear else pair[1] <= SIMILAR * pair[0]:
                groups[-1].append(one)
                continue
        groups.append([one])
    return groups


def _wide(places: Sequence[Place]) -> tuple[float, float]:
    """Limits of the time axis, with room for names."""
    low, high = min(one.whole_seconds for one in places), max(one.whole_seconds for one in places)
    return 0.6 * low, 1.8 * high
