"""Figures of speed: everybody's time on one axis, and time against size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.ladder.trade import unbeaten
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    WARNING,
    Axes,
    Drawing,
    Room,
    dots,
    draw,
    log_scale,
    plain_logs,
    rows_of,
)
from imubayes.reporting.rounding import duration
from imubayes.reporting.trade_figures import HEIGHT, LEAST, SPACE, Point, error_text, named_points, time_axis
from imubayes.units import counted
from studies.speed.words import count_text, law_title, wrong

if TYPE_CHECKING:
    from collections.abc import Sequence

    from studies.speed.growth import Law
    from studies.speed.measure import Found, Place

ROW = 22
"""px of an entrant's row."""


def contest_panel(found: Found, key: str) -> Drawing:
    """Time of everybody who took part: shortest as a dot, up to the longest as a stick."""
    order = [place for place in found.places if place.seconds][::-1]

    def paint(axes: Axes) -> None:
        for row, place in enumerate(order):
            color = _color(found, place)
            axes.plot([place.fastest, max(place.seconds)], [row, row], color=color, linewidth=1.5)
            dots(axes, np.array([place.fastest]), np.array([float(row)]), color=color, size=7.0)
        axes.set_yticks(range(len(order)), [_label(found, place) for place in order])
        axes.set(ylim=(-0.6, len(order) - 0.4))
        low, high = min(p.fastest for p in order), max(max(p.seconds) for p in order)
        axes.set_xlim(0.5 * low, 2.0 * high)
        log_scale(axes, "x", 5)
        axes.xaxis.set_major_formatter(_ticked)
        axes.tick_params(axis="y", length=0)

    alt = f"{found.title}, time: " + "; ".join(
        f"{_label(found, place)} {duration(place.fastest)}" for place in order[::-1]
    )
    height = ROW * len(order) + 40
    return draw(paint, title=found.title, alt=alt, key=key, room=Room(height=height, left=140, bottom=26))


def peers_panel(contests: Sequence[Found]) -> Drawing:
    """Time of the others over ours, a row for each contest that has some."""
    shown = [
        (found, others)
        for found in contests
        if (others := [place for place in found.places if not place.ours and place.seconds])
    ]
    ratios = [found.ratio(place) for found, others in shown for place in others if not wrong(found, place)]
    slower = sum(ratio > 1.0 for ratio in ratios)

    def paint(axes: Axes) -> None:
        axes.axvline(1.0, color=GREY, linewidth=0.8)
        for row, (found, others) in enumerate(shown):
            for place in others:
                ratio = np.array([found.ratio(place)])
                dots(axes, ratio, np.array([float(row)]), color=_color(found, place), size=7.0)
        rows_of(axes, [found.title for found, _ in shown])
        axes.set(xlabel="time over ours")
        log_scale(axes, "x", 6)

    alt = "; ".join(
        f"{found.title}: " + ", ".join(f"{_label(found, one)} {found.ratio(one):.3g}" for one in others)
        for found, others in shown
    )
    title = f"Of {counted(len(ratios), 'right answer')} of others {slower} took longer than ours"
    alt, height = f"Time over ours: {alt}", ROW * len(shown) + 50
    return draw(paint, title=title, alt=alt, key="peers", room=Room(width=760, height=height, left=400))


def front_panel(found: Found, key: str) -> Drawing:
    """Error against time of the rungs, whose front is a stair, and of others."""
    shown = [place for place in found.places if place.seconds]
    points = [
        Point(one.fastest, max(one.error, LEAST), _label(found, one), ACCENT if one.ours else GREY)
        for one in shown
    ]
    front = unbeaten(points, lambda point: point.seconds, lambda point: point.error)

    def paint(axes: Axes) -> None:
        stair = [one.seconds for one in front], [one.error for one in front]
        axes.step(*stair, where="post", color=INK, linewidth=1.0)
        low, high = time_axis(points)
        axes.set_xlim(0.2 * low, high)
        named_points(axes, front, up=False)
        named_points(axes, [one for one in points if one not in front])
        errors = [one.error for one in points]
        axes.set(xlabel="s", ylabel="posterior sd", ylim=(0.02 * min(errors), 60.0 * max(errors)))
        plain_logs(axes)

    alt = "; ".join(f"{one.name} {duration(one.fastest)}, {error_text(one.error)} sd" for one in shown)
    alt = f"{found.title}, error against time: {alt}"
    return draw(paint, title=found.title, alt=alt, key=key, room=Room(height=HEIGHT, right=SPACE))


def _ticked(value: float, _: float) -> str:
    return duration(value)


def _color(found: Found, place: Place) -> str:
    return ACCENT if place.ours else WARNING if wrong(found, place) else GREY


def _label(found: Found, place: Place) -> str:
    name = place.name.removeprefix("imubayes, ") if place.name != "imubayes" else place.name
    return f"{name} (wrong)" if wrong(found, place) else name


def law_panel(law: Law, key: str) -> Drawing:
    """Time against size on log-log axes, with the fitted power."""

    def paint(axes: Axes) -> None:
        own = law.sizes[law.used]
        axes.plot(own, law.at_one * own**law.exponent, color=GREY, linewidth=1.2)
        for size, seconds in zip(law.sizes, law.seconds, strict=True):
            axes.plot([size, size], [seconds.min(), seconds.max()], color=ACCENT, linewidth=1.5)
        dots(axes, law.sizes, law.fastest, color=ACCENT, size=7.0)
        axes.set(xlabel=law.ladder.quantity)
        axes.set_xlim(0.7 * law.sizes[0], 1.4 * law.sizes[-1])
        plain_logs(axes)
        axes.xaxis.set_major_formatter(lambda value, _: count_text(value))
        axes.yaxis.set_major_formatter(_ticked)

    alt = f"Time against {law.ladder.quantity}: " + "; ".join(
        f"{size:,.0f} {duration(seconds)}" for size, seconds in zip(law.sizes, law.fastest, strict=True)
    )
    return draw(paint, title=law_title(law), alt=alt, key=key, room=Room(height=210))
