"""Figures of how good the decision is: drops against effect, cost by method, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    Axes,
    Drawing,
    Room,
    dots,
    draw,
    few_ticks,
    log_scale,
    sticks,
)
from imubayes.reporting.method_views import called
from imubayes.reporting.rounding import percent
from studies.decision_quality.scores import RATIOS
from studies.decision_quality.trials import DECISION, STRONG, TRUSTED
from studies.decision_quality.words import ALLOWED, bins, rivals

if TYPE_CHECKING:
    from studies.decision_quality.scores import MethodScore, Scores, Treated

LABELLED = ("ebic", "leave_one_run_out", "stlsq")
"""Methods that the figure of drops names, one of each family."""

ROW = 17
"""px of a method's row."""


def treatments_panel(told: Sequence[Treated], key: str) -> Drawing:
    """Zero terms called needed by the decision, and by evidence that trusts the bench, by treatment."""
    shown = [one for one in reversed(told) if one.zero]
    rows = np.arange(len(shown), dtype=float)
    own, trusting = ([one.of(name).false_keeps for one in shown] for name in (DECISION, TRUSTED))

    def paint(axes: Axes) -> None:
        axes.axvline(100.0 * ALLOWED, color=PALE, linewidth=1.0)
        for found, color, y in ((trusting, GREY, rows - 0.17), (own, ACCENT, rows + 0.17)):
            for row, one in zip(y, found, strict=True):
                axes.plot([100.0 * one.low, 100.0 * one.high], [row, row], color=color, linewidth=1.5)
            dots(axes, np.array([100.0 * one.value for one in found]), y, color=color, size=7.0)
        axes.set_yticks(rows, [one.treatment for one in shown])
        axes.set(xlabel="of the zero terms, %", xlim=(0.0, None))
        axes.tick_params(axis="y", length=0)

    met = sum(one.value <= ALLOWED for one in own)
    title = f"At most {percent(ALLOWED)} false under {met} of {len(shown)} treatments"
    alt = f"Zero terms called needed by the decision, and by the method “{TRUSTED}”: " + "; ".join(
        f"{one.treatment} {percent(a.value)}, {percent(b.value)}"
        for one, a, b in zip(shown, own, trusting, strict=True)
    )
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=ROW * len(shown) + 50, left=164))


def drops_panel(told: Scores, key: str) -> Drawing:
    """False drops against effect over noise: the decision bold, a few others named, the rest grey."""
    names = bins()

    def paint(axes: Axes) -> None:
        x = np.arange(len(names), dtype=float)
        for score in rivals(told):
            if score.method not in LABELLED:
                axes.plot(x, _dropped(score), color=PALE, linewidth=1.0)
        named = [told.of(method) for method in LABELLED]
        for score, color in zip(named, SERIES[1:], strict=False):
            axes.plot(x, _dropped(score), color=color, linewidth=1.2, label=called(score.method))
        own = told.methods[0]
        axes.plot(x, _dropped(own), color=ACCENT, linewidth=2.6, label=DECISION)
        sticks(axes, x, *(100.0 * np.array([[b.low, b.high] for b in own.false_drops]).T), color=ACCENT)
        axes.set_xticks(x, names)
        axes.set(xlabel="effect over noise, sd", ylabel="true terms dropped, %", ylim=(-2.0, 102.0))
        axes.legend(frameon=False, labelcolor=INK, fontsize=11, handlelength=1.2)

    strong = told.methods[0].false_drops[-1]
    title = f"The decision drops {percent(strong.value)} of what is above {STRONG:.0f} sd"
    alt = "Share of true terms that are dropped, by effect over noise: " + "; ".join(
        f"{name} sd {percent(b.value)}"
        for name, b in zip(names, told.methods[0].false_drops, strict=True)
        if b.of
    )
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=260))


def cost_panel(told: Scores, key: str) -> Drawing:
    """Total cost of every method with its interval."""
    order = sorted((told.methods[0], *rivals(told)), key=lambda score: -score.cost.value)

    def paint(axes: Axes) -> None:
        for row, score in enumerate(order):
            color = ACCENT if score.method == DECISION else GREY
            axes.plot([score.cost.low, score.cost.high], [row, row], color=color, linewidth=1.5)
            dots(axes, np.array([score.cost.value]), np.array([float(row)]), color=color, size=7.0)
        axes.set_yticks(range(len(order)), [called(score.method) for score in order])
        axes.set(xlabel="false keeps and false drops a sensor", xlim=(0.0, None))
        axes.tick_params(axis="y", length=0)

    best = called(order[-1].method)
    title = f"{best[:1].upper()}{best[1:]} costs least: {order[-1].cost.value:.2f} wrong terms a sensor"
    alt = "Wrong terms a sensor: " + "; ".join(f"{called(s.method)} {s.cost.value:.2f}" for s in order[::-1])
    height = ROW * len(order) + 50
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=height, left=106))


def ratio_panel(told: Scores, key: str) -> Drawing:
    """Cost of every method over the decision's, against what a false keep costs."""
    # where the decision never errs there is nothing to hold the others against
    own = np.array([c.value or np.nan for c in told.methods[0].weighed])

    def paint(axes: Axes) -> None:
        axes.set(xlabel="cost of a false keep, false drops", ylabel="cost over the decision's")
        for score in rivals(told):
            if score.method not in LABELLED:
                axes.plot(RATIOS, _costs(score) / own, color=PALE, linewidth=1.0)
        for method, color in zip(LABELLED, SERIES[1:], strict=False):
            axes.plot(RATIOS, _costs(told.of(method)) / own, color=color, linewidth=1.2, label=called(method))
        axes.plot(RATIOS, np.ones(len(RATIOS)), color=ACCENT, linewidth=2.6, label=DECISION)
        axes.set_ylim(0.5, 4.0)
        log_scale(axes, "x")
        axes.legend(frameon=False, labelcolor=INK, fontsize=11, handlelength=1.2)

    least = np.min([_costs(score) for score in rivals(told)], axis=0) / own
    won = int(np.sum(~(least < 1.0)))
    title = f"The decision costs least at {won} of {len(RATIOS)} ratios of costs"
    alt = "Cost of the cheapest other method over the decision's: " + "; ".join(
        f"{one:.2f} where a false keep costs {ratio:g}" for ratio, one in zip(RATIOS, least, strict=True)
    )
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=260))


def calibration_panel(told: Scores, key: str) -> Drawing:
    """Share of true terms against the inclusion that the decision gave them."""
    found = told.calibration
    inclusion = np.array([b.inclusion for b in found])
    low, high, true = np.array([[b.true.low, b.true.high, b.true.value] for b in found]).T

    def paint(axes: Axes) -> None:
        axes.plot([0.0, 1.0], [0.0, 1.0], color=PALE, linewidth=1.0)
        sticks(axes, inclusion, low, high, color=ACCENT)
        dots(axes, inclusion, true, color=ACCENT, size=7.0)
        axes.set(xlabel="inclusion", ylabel="share that is true", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
        few_ticks(axes)

    off = [b for b in found if not b.true.low <= b.inclusion <= b.true.high]
    title = (
        "Inclusion is the frequency of truth"
        if not off
        else f"Inclusion is off in {len(off)} of {len(found)} bins"
    )
    alt = "Inclusion against share of true terms: " + "; ".join(
        f"{b.inclusion:.2f} {b.true.value:.2f}" for b in found
    )
    return draw(paint, title=title, alt=alt, key=key, room=Room(height=260))


def _costs(score: MethodScore) -> np.ndarray:
    return np.array([cost.value for cost in score.weighed])


def _dropped(score: MethodScore) -> list[float]:
    return [100.0 * inside.value for inside in score.false_drops]
