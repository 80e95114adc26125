"""What the report shows of repeatability: the same parameters in several sessions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imubayes.reporting.canvas import GREY, SERIES, Axes, Margins, Panel, draw, few_ticks, sticks
from imubayes.reporting.rounding import Measured, measured, per_unit, pretty
from imubayes.reporting.session_words import amount, session_sentence, together
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import StudyResult
    from imubayes.inference.sessions import Repeatability


MOST_DRAWN = 12
"""Parameters that are drawn: those that change most between sessions."""

MOST_ROWS = 30
"""Rows of the table."""

SHAPES = ("o", "s", "^", "D", "v", "P")
"""Marker of each session, so that colour is not alone."""

LETTER = 6.5
"""px of a letter."""


@dataclass(frozen=True, slots=True)
class SessionRow:
    """Repeatability of one parameter as it is printed.

    Attributes
    ----------
    parameter : its name.
    posterior : typical sd of a session's posterior.
    pull, where : largest difference of two sessions in sd, and of which unit and sessions.
    p_value : of the scatter.
    between, low, high : sd between sessions, with the ends of its 90 % interval.
    exceeds : whether the scatter exceeds what the posteriors allow.
    """

    parameter: str
    posterior: Measured
    pull: float
    where: str
    p_value: float
    between: Measured
    low: Measured
    high: Measured
    exceeds: bool


@dataclass(frozen=True, slots=True)
class SessionView:
    """The section on repeatability.

    Attributes
    ----------
    sentence : the finding.
    rows, left_out : of the table, and how many parameters are in result.json only.
    panels : means by session.
    sessions : (shape, colour, name) of each session in the panels.
    """

    sentence: str
    rows: tuple[SessionRow, ...]
    left_out: int
    panels: tuple[Panel, ...]
    sessions: tuple[tuple[str, str, str], ...]


def session_view(result: StudyResult) -> SessionView | None:
    """Prepare the comparison of sessions; None where the study has none."""
    if not result.sessions:
        return None
    told = [one for one in result.sessions if not math.isnan(one.p_value)]
    ranked = sorted(together(told), key=lambda one: (one.p_value, -largest_pull(one)[0]))
    shown = ranked[:MOST_ROWS]
    sessions = tuple(dict.fromkeys(name for one in result.sessions for name in one.sessions))
    signs = ("●", "■", "▲", "◆", "▼", "✚")
    return SessionView(
        sentence=session_sentence(result.sessions),
        rows=tuple(_row(one) for one in shown),
        left_out=len(result.sessions) - len(shown),
        panels=tuple(_panel(one, f"q{n}", sessions) for n, one in enumerate(ranked[:MOST_DRAWN])),
        sessions=tuple(
            (signs[n % len(signs)], SERIES[n % len(SERIES)], name) for n, name in enumerate(sessions)
        ),
    )


def largest_pull(one: Repeatability) -> tuple[float, str]:
    """Largest difference of two sessions in sd, and of which unit between which sessions."""
    size = np.nan_to_num(np.abs(one.pulls))
    if not size.size or not size.any():
        return 0.0, ""
    u, a, b = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
    first, second = sorted((a, b))
    return float(size[u, a, b]), f"{one.units[u]}, {one.sessions[first]} to {one.sessions[second]}"


def _row(one: Repeatability) -> SessionRow:
    unit = per_unit(one.printed, one.unit)
    pull, where = largest_pull(one)
    between, low, high = (measured(value / unit, 0.0, one.printed) for value in one.between)
    typical = measured(float(np.nanmedian(one.sd)) / unit, 0.0, one.printed)
    return SessionRow(one.parameter, typical, pull, where, one.p_value, between, low, high, bool(one.exceeds))


def _panel(one: Repeatability, key: str, sessions: tuple[str, ...]) -> Panel:
    """Draw each session's mean with its error bar, as the distance from the unit's mean over the sessions."""
    found = (
        f"between sessions {pretty(amount(one))}, largest pull {largest_pull(one)[0]:.0f} sd"
        if one.exceeds
        else "within the error bars"
    )
    return draw(
        lambda axes: _paint(axes, one, sessions),
        title=f"{one.parameter}: {found}",
        alt=f"{one.parameter} of {counted(len(one.units), 'unit')}"
        f" in {counted(len(one.sessions), 'session')}: {found}",
        key=key,
        height=170,
        margins=Margins(left=54),
    )


def _paint(axes: Axes, one: Repeatability, sessions: tuple[str, ...]) -> None:
    unit = per_unit(one.printed, one.unit)
    away = (one.mean - np.nanmean(one.mean, axis=1, keepdims=True)) / unit
    sd = one.sd / unit
    places = np.arange(len(one.units), dtype=float)
    step = 0.7 / len(one.sessions)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    for s, name in enumerate(one.sessions):
        n = sessions.index(name)
        known = np.isfinite(away[:, s])
        x = (places + step * (s - 0.5 * (len(one.sessions) - 1)))[known]
        y, half = away[known, s], 2.0 * sd[known, s]
        sticks(axes, x, y - half, y + half, SERIES[n % len(SERIES)])
        axes.plot(x, y, SHAPES[n % len(SHAPES)], color=SERIES[n % len(SERIES)], markersize=4)
    axes.set(xlim=(-0.6, len(places) - 0.4), ylabel=f"from mean, {pretty(one.printed)}")
    few_ticks(axes, 5, 4)
    _unit_ticks(axes, one.units)


def _unit_ticks(axes: Axes, units: tuple[str, ...]) -> None:
    """Names of the units where they fit below the axis, else their numbers."""
    room = 280.0 / len(units)
    if max(len(name) for name in units) * LETTER < room:
        axes.set_xticks(range(len(units)), units)
        axes.set_xlabel("unit")
    else:
        every = max(1, math.ceil(16.0 / room))
        axes.set_xticks(range(0, len(units), every), [f"{k + 1}" for k in range(0, len(units), every)])
        axes.set_xlabel(f"unit, 1 {units[0]} to {len(units)} {units[-1]}")
    axes.tick_params(axis="x", length=0)
