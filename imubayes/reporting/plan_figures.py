"""Figure of a plan: predicted sd by term, for going evenly and for the best plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    WARNING,
    Axes,
    Margins,
    Panel,
    draw,
    log_scale,
)

if TYPE_CHECKING:
    from imubayes.planning.proposal import Outcome, Proposal

ROW = 19
"""px of a term's row."""

CALLED = {"even": "evenly", "same": "same equipment", "best": "best plan"}
"""Plans by their names in an outcome."""


def outcomes(found: Proposal) -> tuple[Outcome, ...]:
    """Plans that are told: `same` only where there is other equipment."""
    return (found.even, found.same, found.best) if len(found.menus) > 1 else (found.even, found.best)


def predicted_panel(found: Proposal, key: str) -> Panel:
    """Posterior over prior sd of every term that a plan can tell, and what the scene needs."""
    names = list(found.study.terms)
    told = outcomes(found)
    ratios = np.array([o.sd / found.prior_sd for o in told])
    shown = [k for k, name in enumerate(names) if name in found.needed or ratios[:, k].min() < 0.95]
    y = np.arange(len(shown))[::-1]
    styles = {"even": ("o", GREY), "same": ("s", SERIES[1]), "best": ("D", ACCENT)}
    need = (found.need / found.prior_sd)[shown]

    def paint(axes: Axes) -> None:
        for row in y:
            axes.axhline(row, color=PALE, linewidth=0.8, zorder=0)
        axes.axvline(1.0, color=GREY, linewidth=0.8, zorder=0)
        for outcome, ratio in zip(told, ratios[:, shown], strict=True):
            marker, color = styles[outcome.name]
            label = CALLED[outcome.name]
            axes.plot(ratio, y, marker, color=color, markersize=5, linestyle="none", label=label)
        inside = np.isfinite(need) & (need < 10.0)
        if inside.any():
            mark = {"color": WARNING, "markersize": 12, "linestyle": "none", "label": "scene's need"}
            axes.plot(need[inside], y[inside], "|", **mark)
        axes.set_yticks(y, [names[k] for k in shown])
        axes.set(xlabel="predicted sd over prior sd", ylim=(-0.7, len(shown) + 1.6))
        log_scale(axes, "x", 6)
        axes.legend(frameon=False, labelcolor=INK, fontsize=11, loc="upper left", ncols=2, borderpad=0.0,
                    columnspacing=0.8, handletextpad=0.1)  # fmt: skip

    term, ratio = found.worst(found.best)
    even = found.worst(found.even)[1]
    title = f"The worst needed term ({term}) has {100.0 * (1.0 - ratio / even):.0f} % less sd than evenly"
    alt = "Predicted over prior sd, " + "; ".join(
        f"{names[k]} "
        + ", ".join(f"{CALLED[o.name]} {r:.2g}" for o, r in zip(told, ratios[:, k], strict=True))
        for k in shown
    )
    margins = Margins(left=52, bottom=40)
    return draw(paint, title=title, alt=alt, key=key, height=ROW * (len(shown) + 2) + 46, margins=margins)
