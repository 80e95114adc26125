"""Figures of a trade: error against time with the front, and what repeats say, rung by rung."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.ladder.trade.score import INTERVAL
from imubayes.ladder.trade.subjects import DEFAULT
from imubayes.ladder.trade.table import SURE, allowed
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

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.ladder.trade.score import Score
    from imubayes.ladder.trade.table import Place, Traded

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
    places = [one for one in found.places if found.score(one.rung)]
    scores = [one for one in found.scores if found.place(one.rung)]
    repeats = (_coverage(found, places, scores), _cost(found, places, scores)) if places else ()
    return (_pareto(found), _inclusion(found), *repeats)


def _panel(found: Traded, paint: Callable[[Axes], None], title: str, alt: str, key: str) -> Panel:
    """Panel over the time that rungs take."""

    def painted(axes: Axes) -> None:
        axes.set_xlim(*_wide(found.places))
        paint(axes)

    return draw(painted, title=title, alt=alt, key=key, height=HEIGHT, margins=SPACE)


def _pareto(found: Traded) -> Panel:
    """Error of the worst coefficient against time: the front, the Monte Carlo floor, sticks to the rms."""
    floor, good = max(found.floor[0], LEAST), allowed(found.floor[0])
    height: dict[RungName, float] = {one.rung: max(one.largest, LEAST) for one in found.places}
    height[found.best] = floor

    def paint(axes: Axes) -> None:
        for one in found.places:
            ends = [min(max(one.rms, LEAST), height[one.rung]), height[one.rung]]
            axes.plot([one.whole_seconds] * 2, ends, color=PALE, linewidth=2.0)
        front = [one for one in found.places if one.rung in found.front]
        steps = [max(height[one.rung], floor) for one in front]  # to be better takes the next one's time
        axes.step([one.whole_seconds for one in front], steps, where="post", color=ACCENT, linewidth=1.2)
        _points(axes, found.places, height, hollow=found.best)
        _limit(axes, good)
        most = max(max(one.largest for one in found.places), 2.0 * good)
        least = min(max(one.rms, LEAST) for one in found.places)
        axes.set(xlabel="s", ylabel="posterior sd", ylim=(0.5 * min(least, floor), 12.0 * most))
        axes.axhspan(axes.get_ylim()[0], floor, color=PALE, alpha=0.5, linewidth=0.0)
        plain_logs(axes)

    told = "; ".join(
        f"{one.rung} {duration(one.whole_seconds)}, {error_text(one.rms)} rms,"
        f" {error_text(one.largest)} at most"
        for one in found.places
    )
    last = found.place(found.front[-1])
    said = "the cheapest rung is as good as any"
    if last is not None and len(found.front) > 1:
        said = f"errors fall until {last.rung}, {duration(last.whole_seconds)}"
    return _panel(found, paint, f"Coefficients: {said}", f"Error against time: {told}", "pareto")


def _inclusion(found: Traded) -> Panel:
    """Largest difference of an inclusion against time."""
    height: dict[RungName, float] = {one.rung: max(one.inclusion, LEAST) for one in found.places}

    def paint(axes: Axes) -> None:
        _points(axes, found.places, height, hollow=found.best)
        _limit(axes, SURE)
        axes.set(xlabel="s", ylabel="difference of inclusion", ylim=(0.5 * LEAST, 10.0))
        plain_logs(axes)

    wrong = [k for k, one in enumerate(found.places) if one.inclusion > SURE]
    good = found.places[wrong[-1] + 1].rung if wrong and found.places[wrong[-1] + 1 :] else found.best
    title = f"Inclusions are right from {good} on" if wrong else "Inclusions are right by every rung"
    told = "; ".join(f"{one.rung} {error_text(one.inclusion)}" for one in found.places)
    return _panel(
        found, paint, title, f"Largest difference of an inclusion against time: {told}", "inclusion"
    )


def _coverage(found: Traded, places: Sequence[Place], scores: Sequence[Score]) -> Panel:
    """Share of the truths of repeats that 90 % intervals hold, with its own interval."""
    shares: dict[RungName, Share] = {one.rung: one.coverage.share for one in scores}

    height: dict[RungName, float] = {one.rung: one.coverage.share.value for one in scores}

    def paint(axes: Axes) -> None:
        for place in places:
            share = shares[place.rung]
            axes.plot([place.whole_seconds] * 2, [share.low, share.high], color=GREY, linewidth=1.5)
        _limit(axes, INTERVAL)
        _points(axes, places, height, linear=1.6)
        axes.set(xlabel="s", ylabel="share of the truths held", ylim=(0.0, 1.6), yticks=(0.0, 0.5, 0.9, 1.0))
        log_scale(axes, "x")

    short = [rung for rung, share in shares.items() if share.high < INTERVAL]
    title = "90 % intervals hold what they should"
    if short:
        title = f"90 % intervals are too short: {', '.join(short)}"
    told = "; ".join(f"{rung} {share.value:.0%}" for rung, share in shares.items())
    return _panel(found, paint, title, f"Coverage of 90 % intervals: {told}", "coverage")


def _cost(found: Traded, places: Sequence[Place], scores: Sequence[Score]) -> Panel:
    """Wrong verdicts a sensor on repeats, weighed by their costs."""
    height: dict[RungName, float] = {one.rung: one.cost for one in scores}

    def paint(axes: Axes) -> None:
        high = 1.4 * max(*height.values(), 0.5)
        _points(axes, places, height, linear=high)
        axes.set(xlabel="s", ylabel="wrong verdicts a sensor", ylim=(-0.06 * high, high))
        few_ticks(axes)
        log_scale(axes, "x")

    least, most = min(scores, key=lambda one: one.cost), max(height.values())
    title = f"Wrong verdicts a sensor: {least.cost:.2f} by {least.rung}, {most:.2f} at most"
    told = "; ".join(f"{rung} {cost:.2f}" for rung, cost in height.items())
    return _panel(found, paint, title, f"Wrong verdicts a sensor against time: {told}", "cost")


def _limit(axes: Axes, value: float) -> None:
    """What is good enough."""
    axes.axhline(value, color=WARNING, linewidth=1.0, linestyle=(0, (4, 3)))


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
        dots(axes, *at, color=ACCENT if one.rung == DEFAULT else INK, size=8.0)
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
            color=ACCENT if group[-1].rung == DEFAULT else INK,
        )


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


def error_text(value: float) -> str:
    """Write an error in posterior sd: two digits, and no more than hundredths.

    Examples
    --------
    >>> error_text(1384.0), error_text(11.18), error_text(0.162), error_text(0.0004), error_text(0.0)
    ('1,400', '11', '0.16', '<0.01', '0')
    """
    if math.isnan(value):
        return ""
    if value == 0.0:
        return "0"
    if value < 1.0:
        return "<0.01" if value < 0.005 else f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{float(f'{value:.2g}'):,.0f}"
