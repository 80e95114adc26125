"""Figure of a trade: error against time with the front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from imubayes.ladder import RungName, trade
from imubayes.ladder.trade.components import DEFAULT
from imubayes.reporting.canvas import ACCENT, INK, PALE, WARNING, Axes, Drawing, Room, dots, draw, plain_logs
from imubayes.reporting.rounding import duration
from imubayes.units import counted

HEIGHT = 270
"""px."""

NEAR, SIMILAR = 0.06, 3.0
"""Share of the time axis, and ratio of heights, in which names would overlap."""

SLANT = 62
"""deg; names of rungs whose times are close stand beside each other."""

SPACE = 34
"""px to the right, for the last one's name."""

LEAST = 0.01
"""Error in posterior sd below which nothing is drawn lower."""


def trade_panel(traded: trade.Traded) -> Drawing:
    """Error of the worst coefficient against time: the front, the Monte Carlo floor, sticks to the rms.

    Rungs that are singular are not drawn.
    """
    floor, good = max(traded.floor[0], LEAST), trade.allowed(traded.floor[0])
    places = [total for total in traded.places if total.largest < trade.UNSOLVED] or traded.places
    height: dict[RungName, float] = {total.rung: max(total.largest, LEAST) for total in places}
    height[traded.best] = floor
    points = [
        Point(total.whole_seconds, height[total.rung], total.rung, ACCENT if total.rung == DEFAULT else INK)
        for total in places
    ]

    def paint(axes: Axes) -> None:
        for total in places:
            ends = [min(max(total.rms, LEAST), height[total.rung]), height[total.rung]]
            axes.plot([total.whole_seconds] * 2, ends, color=PALE, linewidth=2.0)
        front = [total for total in places if total.rung in traded.front]
        steps = [max(height[total.rung], floor) for total in front]  # to be better takes the next one's time
        axes.step([total.whole_seconds for total in front], steps, where="post", color=ACCENT, linewidth=1.2)
        axes.set_xlim(*time_axis(points))
        named_points(axes, points)
        for point in points:
            if point.name == traded.best:
                dots(axes, np.array([point.seconds]), np.array([point.error]), color="white", size=5.0)
        axes.axhline(good, color=WARNING, linewidth=1.0, linestyle=(0, (4, 3)))
        most = max(max(total.largest for total in places), 2.0 * good)
        least = min(max(total.rms, LEAST) for total in places)
        above = max(12.0, (most / least) ** 0.25)  # for names above
        axes.set(xlabel="s", ylabel="posterior sd", ylim=(0.5 * min(least, floor), above * most))
        axes.axhspan(axes.get_ylim()[0], floor, color=PALE, alpha=0.5, linewidth=0.0)
        plain_logs(axes)

    told = "; ".join(
        f"{total.rung} {duration(total.whole_seconds)}, {error_text(total.rms)} rms,"
        f" {error_text(total.largest)} at most"
        for total in traded.places
    )
    near = sum(total.largest <= good and total.rung != traded.best for total in traded.places)
    title = f"{near} of {counted(len(traded.places) - 1, 'other rung')} within {good:.2g} sd of {traded.best}"
    alt = f"Error against time: {told}"
    return draw(paint, title=title, alt=alt, key="pareto", room=Room(height=HEIGHT, right=SPACE))


class Point(NamedTuple):
    """Somebody's time, s, and error, with the name and colour that they are shown with."""

    seconds: float
    error: float
    name: str
    color: str


def named_points(axes: Axes, points: Sequence[Point], *, up: bool = True) -> None:
    """Draw points with their names above or below; those that would stand on each other have one together."""
    for point in points:
        dots(axes, np.array([point.seconds]), np.array([point.error]), color=point.color, size=8.0)
    for group in _close(points, *axes.get_xlim()):
        last = group[-1]
        axes.annotate(
            ", ".join(point.name for point in group),
            (last.seconds, last.error),
            xytext=(5, 6) if up else (-2, -9),
            textcoords="offset points",
            rotation=SLANT,
            rotation_mode="anchor",
            ha="left" if up else "right",
            color=last.color,
        )


def _close(points: Sequence[Point], low: float, high: float) -> list[list[Point]]:
    """Points by time, those together whose names would stand on each other on an axis from low to high."""
    groups: list[list[Point]] = []
    for point in sorted(points, key=lambda point: point.seconds):
        last = groups[-1][-1] if groups else None
        if last is not None and point.seconds < last.seconds * (high / low) ** NEAR:
            pair = sorted((last.error, point.error))
            if pair[1] <= SIMILAR * pair[0]:
                groups[-1].append(point)
                continue
        groups.append([point])
    return groups


def time_axis(points: Sequence[Point]) -> tuple[float, float]:
    """Ends of a time axis, s, that leave room about all points."""
    return 0.6 * min(point.seconds for point in points), 1.8 * max(point.seconds for point in points)


def error_text(value: float) -> str:
    """Write an error in posterior sd: two digits, no more than hundredths; or that it is a singular one.

    Examples
    --------
    >>> error_text(2.31e16), error_text(1384.0), error_text(11.18), error_text(0.162), error_text(0.0004)
    ('singular', '1,400', '11', '0.16', '<0.01')
    """
    if math.isnan(value):
        return ""
    if value == 0.0:
        return "0"
    if value < 1.0:
        return "<0.01" if value < 0.005 else f"{value:.2f}"
    if value >= trade.UNSOLVED:
        return "singular"
    return f"{value:.1f}" if value < 9.95 else f"{float(f'{value:.2g}'):,.0f}"
