"""Figures on the fit: what the residuals still hold, and the noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.misfit import HYSTERESIS, TIME
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    SERIES,
    WARNING,
    Axes,
    Panel,
    dots,
    draw,
    few_ticks,
    plain_logs,
    sticks,
    time_unit,
)
from imubayes.reporting.rounding import (
    in_unit,
    on_output,
    output_unit,
    pretty,
    probability,
)
from imubayes.reporting.rows import channel_unit
from imubayes.units import counted, factor, offset

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.allan import AllanCurve
    from imubayes.inference.misfit import Dependence
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.selection.noise_choice import NoiseFound
    from imubayes.sensors.terms import Kind


MOST_POINTS = 300
"""Points a curve; more are not seen in 350 px."""

COLOURS = dict(zip("NBKQRG", (*SERIES[1:], *SERIES[1:]), strict=True))
"""Colour of each noise process; its symbol stands at its line."""

ROOM = 3.0
"""Factor below the lowest dot down to which noise processes are drawn."""


def shown_runs(sensor: SensorResult, most: int) -> tuple[ResidualCheck, ...]:
    """Pick at most `most` runs, those that fit worst, in the study's order."""
    worst = sorted(sensor.checks, key=lambda check: (check.fits, -abs(math.log(max(check.scale, 1e-12)))))[
        :most
    ]
    return tuple(check for check in sensor.checks if any(check is chosen for chosen in worst))


def over_time(check: ResidualCheck, key: str, most: int = MOST_POINTS) -> Panel:
    """Whitened residuals of a run over time, with the blocks that stand out."""
    count = len(check.outliers)
    found = (
        f"{counted(count, 'block')} stand{'' if count > 1 else 's'} out" if count else "nothing stands out"
    )
    return draw(
        lambda axes: _paint_time(axes, check, most),
        title=f"Residual over noise {check.scale:.2f}; {found}",
        alt=f"Whitened residuals over time, rms {check.scale:.2f}; {found}",
        key=key,
    )


def _paint_time(axes: Axes, check: ResidualCheck, most: int) -> None:
    unit, scale = time_unit(float(check.t[-1] - check.t[0])) if len(check.t) else ("s", 1.0)
    kept = np.unique(np.linspace(0, len(check.t) - 1, min(len(check.t), most)).astype(np.int64))
    axes.axhspan(-2.0, 2.0, color=PALE, alpha=0.45, linewidth=0.0)
    dots(axes, check.t[kept] / scale, check.shown[kept], INK)
    for start, stop, size in check.outliers[:10]:
        axes.axvspan(start / scale, stop / scale, color=WARNING, alpha=0.35, linewidth=1.0)
        axes.text(
            0.5 * (start + stop) / scale,
            0.98,
            f"{size:.0f} sd",
            color=INK,
            ha="center",
            va="top",
            transform=axes.get_xaxis_transform(),
        )
    axes.set(xlabel=f"time, {unit}", ylabel="residual, sd")
    reach = max(4.0, 1.1 * float(np.nanmax(np.abs(check.shown), initial=0.0)))
    axes.set_ylim(-reach, reach)
    few_ticks(axes, 5, 4)


def autocorrelation(check: ResidualCheck, key: str) -> Panel:
    """Autocorrelation of the whitened residuals, block by block, with the band of white noise."""
    band = 1.96 / math.sqrt(max(len(check.shown), 1))
    white = "White" if check.white else "Not white"

    def paint(axes: Axes) -> None:
        lags = np.asarray(check.lags, dtype=float)
        axes.axhspan(-band, band, color=PALE, alpha=0.6, linewidth=0.0)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        sticks(axes, lags, np.zeros(len(lags)), check.autocorrelation, ACCENT, 2.0)
        reach = max(2.5 * band, 1.15 * float(np.nanmax(np.abs(check.autocorrelation), initial=0.0)))
        axes.set(xlabel="lag, blocks", ylabel="autocorrelation", ylim=(-reach, reach))
        few_ticks(axes, 5, 4)

    return draw(
        paint,
        title=f"{white}: Ljung-Box p {probability(check.whiteness_p)}",
        alt=f"Autocorrelation of the whitened residuals by lag; 95 % of white noise is within ±{band:.3f}",
        key=key,
    )


def allan(check: ResidualCheck, kind: Kind, key: str) -> Panel | None:
    """Draw the Allan deviation of the residuals against the noise model; None for too short a run."""
    known = (check.deviation > 0.0) & (check.expected > 0.0)
    if not known.any():
        return None
    name, unit = output_unit(kind)
    off = float(np.exp(np.max(np.abs(np.log(check.deviation[known] / check.expected[known])))))

    def paint(axes: Axes) -> None:
        axes.plot(check.tau, check.expected / unit, color=ACCENT)
        axes.plot(check.tau, check.deviation / unit, "o", color=INK, markersize=3)
        axes.set(
            xscale="log", yscale="log", xlabel="averaging time, s", ylabel=f"Allan deviation, {pretty(name)}"
        )
        plain_logs(axes)

    return draw(
        paint,
        title=f"Allan deviation within a factor {off:.2f} of the noise model",
        alt="Allan deviation of the residuals and of the fitted noise against averaging time",
        key=key,
    )


def channel_of(one: Dependence) -> str:
    """Input channel of a dependence, without what is said of its branches."""
    return one.input.removeprefix(HYSTERESIS)


def dependence_words(one: Dependence) -> str:
    """Where a dependence shows: ``f_i in run arm``, ``T between heating and cooling in run ramp``."""
    if one.input.startswith(HYSTERESIS):
        channel = channel_of(one)
        branches = "heating and cooling" if channel == "T" else "rising and falling"
        return f"{channel} between {branches} in run {one.run}"
    return f"{'time' if one.input == TIME else one.input} in run {one.run}"


def dependence(one: Dependence, kind: Kind, key: str) -> Panel:
    """Draw the mean residual against an input, by branch where the way up differs from the way down."""
    found = (
        f"{in_unit(on_output(one.size, kind))} rms, {one.share:.0%} of the residual, p {probability(one.p)}"
    )
    where, (along, x) = dependence_words(one), _input(one, kind)
    name, unit = output_unit(kind)
    mean, sd = one.mean / unit, one.sd / unit

    def paint(axes: Axes) -> None:
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for sign, colour, shape in ((0.0, ACCENT, "o"), (1.0, SERIES[1], "^"), (-1.0, ACCENT, "v")):
            part = np.flatnonzero(np.sign(one.branch) == sign)
            part = part[np.argsort(x[part], kind="stable")]
            if len(part):
                sticks(axes, x[part], mean[part] - 2.0 * sd[part], mean[part] + 2.0 * sd[part], colour)
                axes.plot(x[part], mean[part], f"{shape}-", color=colour, markersize=4.5, linewidth=0.9)
        axes.set(xlabel=along, ylabel=f"residual, {pretty(name)}")
        few_ticks(axes, 5, 4)

    return draw(
        paint,
        title=f"{where}: {found}",
        alt=f"What the residuals hold beyond the library, with ± 2 sd, against {where}: {found}",
        key=key,
        height=200,
        left=54,
    )


def _input(one: Dependence, kind: Kind) -> tuple[str, FloatArray]:
    channel = channel_of(one)
    if channel == TIME:
        unit, scale = time_unit(float(np.ptp(one.x)))
        return f"time, {unit}", one.x / scale
    unit, si = channel_unit(channel, kind)
    return f"{channel}, {pretty(unit)}", (one.x - offset(unit, si)) / factor(unit, like=si)


def allan_panel(found: NoiseFound, kind: Kind, key: str) -> Panel | None:
    """Draw the Allan deviation with its 90 % band, the fitted curve and the share of each process."""
    curve = found.curve
    if curve is None:
        return None
    inside = float(((curve.low <= curve.fitted) & (curve.fitted <= curve.high)).mean())
    name, unit = output_unit(kind)
    lowest = int(curve.deviation.argmin())
    least = f"{curve.deviation[lowest] / unit:.3g} {pretty(name)} at {curve.tau[lowest]:.3g} s"
    return draw(
        lambda axes: _paint_processes(axes, curve, unit, pretty(name)),
        title=f"Lowest {least}; {inside:.0%} of the fitted curve within the 90 % band",
        alt=f"Allan deviation against averaging time with {', '.join(curve.shares)}; lowest {least}",
        key=key,
        height=280,
        right=18,
    )


def _paint_processes(axes: Axes, curve: AllanCurve, unit: float, name: str) -> None:
    axes.fill_between(curve.tau, curve.low / unit, curve.high / unit, color=PALE, linewidth=0.0)
    floor = float(curve.deviation.min()) / unit / ROOM
    for symbol, share in curve.shares.items():
        shown = share / unit >= floor
        if not shown.any():
            continue
        tau, values = curve.tau[shown], share[shown] / unit
        axes.plot(tau, values, color=COLOURS[symbol], linewidth=1.2, linestyle=(0, (5, 2)))
        end = 0 if values[0] < values[-1] or symbol == "B" else -1
        axes.text(
            tau[end], values[end], f" {symbol}", color=INK, va="bottom", ha="left" if end == 0 else "center"
        )
    axes.plot(curve.tau, curve.fitted / unit, color=ACCENT, linewidth=1.6)
    axes.plot(curve.tau, curve.deviation / unit, "o", color=INK, markersize=3)
    axes.set(xscale="log", yscale="log", xlabel="averaging time, s", ylabel=f"Allan deviation, {name}")
    plain_logs(axes)
