"""The figure of the ranks, and their counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from studies.ranks.measure import Ranks

CHANCE = (0.005, 0.995)
"""Between which shares of what chance gives the grey band lies."""


def write_ranks(found: Ranks, folder: Path) -> tuple[Path, ...]:
    """Write ``ranks.svg`` and ``ranks.json`` into a folder."""
    figure, values = folder / "ranks.svg", folder / "ranks.json"
    _draw(found, figure)
    document = {
        "campaigns": found.study.campaigns,
        "command": found.study.command,
        "p_values": {name: round(found.p_value(name), 4) for name in found.ranks},
        "counts": {name: found.counts(name).tolist() for name in found.ranks},
    }
    values.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return figure, values


def terminal_ranks(found: Ranks) -> str:
    """Lines for a terminal: a quantity each, with the p-value of its uniform ranks."""
    return "\n".join(f"{name:16} p = {found.p_value(name):.2f}" for name in found.ranks)


def _draw(found: Ranks, file: Path) -> None:
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from scipy.stats import binom

    campaigns, bins = found.study.campaigns, found.study.bins
    low, high = (float(binom.ppf(q, campaigns, 1.0 / bins)) for q in CHANCE)
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    axes = figure.subplots(2, 4, sharex=True, sharey=True)
    for ax, name in zip(axes.flat, found.ranks, strict=True):
        ax.axhspan(low, high, color="0.88", lw=0)
        ax.axhline(campaigns / bins, color="0.5", lw=0.8)
        ax.bar((np.arange(bins) + 0.5) / bins, found.counts(name), width=0.9 / bins, color="#0072B2")
        ax.set_title(f"{name}: p = {found.p_value(name):.2f}", fontsize=10)
        ax.spines[["top", "right"]].set_visible(False)
    figure.supxlabel(
        "rank of the truth among the posterior's draws (0: below all, 1: above all)", fontsize=10
    )
    figure.supylabel("campaigns", fontsize=10)
    figure.suptitle(
        f"Ranks of the truth over {campaigns} simulated campaigns; grey: 99 % of what chance gives",
        fontsize=11,
    )
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ranks"}):
        figure.savefig(file, metadata={"Date": None})
