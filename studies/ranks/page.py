"""The report on the ranks of simulated truths: one page and its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import binom

from imubayes.reporting.blocks import Figure, Page, Prose, Section, Table, answer, repeat
from imubayes.reporting.canvas import ACCENT, GREY, PALE, Axes, Drawing, draw
from studies.command import recorded

if TYPE_CHECKING:
    from studies.ranks.measure import Ranks

TITLE = "Is the posterior calibrated?"

QUESTION = (
    "Simulated truths among the draws of their posteriors: where these are right, every rank is as likely."
)

DOUBTFUL = 0.01
"""p-value below which the ranks of a quantity are called uneven."""

CHANCE = (0.005, 0.995)
"""Shares of what chance gives between which the grey band lies."""

COUNTED = (
    "Each campaign draws coefficients from the prior of a tactical MEMS accelerometer, and N, B and K of its"
    " two runs, a tumble and a centrifuge, from the class's log-normals. Noise is the model's own, averaged"
    " over each row. The truth is then ranked among evenly thinned draws of the sampled posterior (Talts and"
    " others, 2018).",
    "p: of a chi-square test that the ranks are uniform.",
)


BARS = (
    "Bars: campaigns by the rank of the truth among the draws, from below all (0) to above all (1). Grey:"
    " what chance gives in 99 % of cases; line: an even share. First stands the quantity whose ranks are"
    " least even."
)


def ranks_page(found: Ranks) -> Page:
    """Page of the report."""
    rows = [(name, f"{found.p_value(name):.2f}") for name in found.ranks]
    panels = [rank_panel(found, name, f"r{k}") for k, name in enumerate(found.ranks)]
    least = min(found.ranks, key=found.p_value)
    said = f"Seed {found.study.seed}, {found.study.processes} processes."
    return Page(
        TITLE,
        QUESTION,
        first=(answer(ranks_answer(found)), Figure((rank_panel(found, least, "first"),), BARS)),
        data="simulated",
        blocks=(
            Section(
                "Ranks", (Figure(panels), Table("p-values", ("quantity", "p"), rows)), "ranks", brief=True
            ),
            Section("What was counted", (Prose(COUNTED, "list"),), "meaning"),
            repeat(found.study.command, "", said),
        ),
    )


def ranks_answer(found: Ranks) -> tuple[str, ...]:
    """Say whether the ranks are uniform, and of which quantity the least."""
    p = {name: found.p_value(name) for name in found.ranks}
    least = min(p, key=lambda name: p[name])
    uneven = [name for name in p if p[name] < DOUBTFUL]
    is_even = f"not uniform for {', '.join(uneven)}" if uneven else f"uniform for all {len(p)} quantities"
    return (
        f"The truth's rank is {is_even}, as far as {found.study.campaigns} simulated campaigns can tell.",
        f"The smallest p-value is {p[least]:.2f}, of {least}.",
    )


def rank_panel(found: Ranks, name: str, key: str) -> Drawing:
    """Campaigns by the rank of the truth of a quantity."""
    campaigns, bins, counts = found.study.campaigns, found.study.bins, found.counts(name)
    low, high = (float(binom.ppf(q, campaigns, 1.0 / bins)) for q in CHANCE)

    def paint(axes: Axes) -> None:
        axes.axhspan(low, high, color=PALE, linewidth=0)
        axes.axhline(campaigns / bins, color=GREY, linewidth=0.8)
        axes.bar((np.arange(bins) + 0.5) / bins, counts, width=0.9 / bins, color=ACCENT)
        axes.set_xticks([0.2, 0.4, 0.6, 0.8, 1.0])
        axes.set(xlabel="rank of the truth", ylabel="campaigns", xlim=(0.0, 1.0))

    alt = f"Campaigns by rank of {name}: " + "; ".join(str(count) for count in counts)
    return draw(paint, title=f"{name}: p = {found.p_value(name):.2f}", alt=alt, key=key)


def ranks_record(found: Ranks) -> dict[str, Any]:
    """Values of ``result.json``: how many ranks of each quantity fall into each bin."""
    quantities = [
        {"name": name, "p_value": found.p_value(name), "counts": found.counts(name)} for name in found.ranks
    ]
    return recorded(found, TITLE, ranks_answer(found), campaigns=found.study.campaigns, quantities=quantities)
