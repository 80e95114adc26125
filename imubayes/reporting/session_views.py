"""Repeatability in words and numbers: the same parameters in several sessions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from imubayes.population.sessions import SUSPECT
from imubayes.reporting.blocks import Block, Prose, Section, Table
from imubayes.reporting.rounding import pretty, probability, signed, sized
from imubayes.selection.verdicts import listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import StudyResult
    from imubayes.population.sessions import Repeatability

COMMON = 0.5
"""Share of the scatter that all units have in common from which one cause for all is likely."""

MOST_NAMES = 6
"""Parameters that a sentence names."""

MOST_ROWS = 30
"""Rows of the table."""

HEAD = (
    "parameter", "sd of one session", "sd between sessions", "90 % interval", "unit", "largest pull", "of",
    "by chance, p", "repeats",
)  # fmt: skip

NOTE = (
    "A pull is the difference of two sessions over the sd of that difference. A parameter repeats when"
    " the scatter of its sessions about each unit's mean is what their posteriors allow (p at or above"
    " the level stated above); the sd between sessions is what has to be added to a session's own error"
    " bar when its result is used in another one."
)


def session_section(result: StudyResult) -> Section | None:
    """Comparison of sessions; None where the study has none."""
    if not result.sessions:
        return None
    told = [one for one in result.sessions if not math.isnan(one.p_value)]
    shown = sorted(together(told), key=lambda one: (one.p_value, -largest_pull(one)[0]))[:MOST_ROWS]
    blocks: list[Block] = [Prose(pretty(session_sentence(result.sessions)))]
    if shown:
        left = len(result.sessions) - len(shown)
        more = f" {left} more parameters are in result.json." if left else ""
        rows = [_row(one) for one in shown]
        blocks.append(Table("Repeatability between sessions", HEAD, rows, "tnnntntnt", f"{NOTE}{more}"))
    return Section("Between sessions", blocks, "sessions")


def largest_pull(one: Repeatability) -> tuple[float, str]:
    """Largest difference of two sessions in sd, and of which unit between which sessions."""
    size = np.nan_to_num(np.abs(one.pulls))
    if not size.size or not size.any():
        return 0.0, ""
    u, a, b = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
    first, second = sorted((a, b))
    return float(size[u, a, b]), f"{one.units[u]}, {one.sessions[first]} to {one.sessions[second]}"


def _row(one: Repeatability) -> tuple[str, ...]:
    pull, where = largest_pull(one)
    typical, between, low, high = (signed(sized(one, x)) for x in (float(np.nanmedian(one.sd)), *one.between))
    spread = (typical, between, f"{low} to {high}", pretty(one.printed))
    chance = (f"{pull:.1f} sd", where, probability(one.p_value), "✗ no" if one.exceeds else "✓ yes")
    return (one.parameter, *spread, *chance)


def together(found: list[Repeatability]) -> list[Repeatability]:
    """Leave a triad's axes to the parameter that holds them all together."""
    names = {one.parameter for one in found}
    return [
        one
        for one in found
        if "." not in one.parameter or one.parameter.rpartition(".")[2] not in names
    ]  # fmt: skip


def session_sentence(found: tuple[Repeatability, ...]) -> str:
    """Say which parameters change between sessions by more than their posteriors allow; units in ASCII."""
    every = together(list(found))
    told = [one for one in every if not math.isnan(one.p_value)]
    moving = sorted((one for one in told if one.exceeds), key=lambda one: one.p_value)
    silent = [one.parameter for one in every if math.isnan(one.p_value)]
    count = counted(len(told), "parameter")
    if moving:
        text = f"{len(moving)} of {count} change{'s' if len(moving) == 1 else ''} {_moving(moving)}"
    elif told:
        text = f"Of {count} none changes between sessions by more than its error bars allow."
    else:
        text = "The sessions cannot be compared."
    if told:
        text += (
            f" Each test alarms below p {told[0].level:.1g}, so that chance alone makes"
            f" {100 * SUSPECT:.0f} % of studies at most do so."
        )
    return text + (f" The sessions cannot tell of {listed(silent)}." if silent else "")


def _moving(moving: list[Repeatability]) -> str:
    most = listed(f"{one.parameter} (sd {sized(one, one.between[0])})" for one in moving[:MOST_NAMES])
    others = f", and {len(moving) - MOST_NAMES} more" if len(moving) > MOST_NAMES else ""
    text = (
        f"between sessions by more than the error bars allow: {most}{others}."
        " What one session finds holds for the next only within these sds."
    )
    alike = [one for one in moving if one.shared > COMMON and one.shared > 2.0 / len(one.units)]
    if not alike:
        return text
    shares = listed(f"{one.shared:.0%} of the scatter of {one.parameter}" for one in alike[:MOST_NAMES])
    return f"{text} All units have {shares} in common, as temperature would make it."
