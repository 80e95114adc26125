"""Figures on the fit: what the residuals still hold."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.canvas import (
    ACCENT,
    GREY,
    INK,
    PALE,
    WARNING,
    Axes,
    Panel,
    dots,
    draw,
    few_ticks,
    plain_logs,
    sticks,
)
from imubayes.reporting.method_words import left_words
from imubayes.reporting.rounding import OUTPUT_SI, OUTPUT_UNIT, per_unit, pretty, probability
from imubayes.reporting.rows import channel_unit
from imubayes.units import counted, factor, offset

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.sensors.terms import Kind


MOST_POINTS = 300
"""Points a curve; more are not seen in 350 px."""

BINS = 12
"""Bins of equal count in which the residual against an input is averaged."""


def shown_runs(sensor: SensorResult, most: int) -> tuple[ResidualCheck, ...]:
    """Pick at most `most` runs, those that fit worst, in the study's order."""
    worst = sorted(sensor.checks, key=_goodness)[:most]
    return tuple(check for check in sensor.checks if any(check is chosen for chosen in worst))


def _goodness(check: ResidualCheck) -> tuple[bool, float]:
    return check.fits, -abs(math.log(max(check.scale, 1e-12)))


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
    kept = _thinned(len(check.t), most)
    axes.axhspan(-2.0, 2.0, color=PALE, alpha=0.45, linewidth=0.0)
    dots(axes, check.t[kept] / scale, check.shown[kept], INK)
    for start, stop, size in check.outliers[:10]:
        axes.axvspan(start / scale, stop / scale, color=WARNING, alpha=0.35, linewidth=1.0)
        axes.text(
            0.5 * (start + stop) / scale,
            0.98,
            f"{size:.0f} sd",
            color=WARNING,
            ha="center",
            va="top",
            transform=axes.get_xaxis_transform(),
        )
    axes.set(xlabel=f"time, {unit}", ylabel="residual, sd")
    reach = max(4.0, 1.1 * float(np.nanmax(np.abs(check.shown), initial=0.0)))
    axes.set_ylim(-reach, reach)
    few_ticks(axes, 5, 4)


def time_unit(duration: float) -> tuple[str, float]:
    """Unit in which a duration in s is shown, and how many s it has."""
    return ("s", 1.0) if duration < 600.0 else ("min", 60.0) if duration < 36000.0 else ("h", 3600.0)


def _thinned(count: int, most: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64)) if count else np.arange(0)


def autocorrelation(check: ResidualCheck, key: str) -> Panel:
    """Autocorrelation of the whitened residuals, block by block, with the band of white noise."""
    band = 1.96 / math.sqrt(max(len(check.shown), 1))
    white = "White" if check.white else "Not white"
    return draw(
        lambda axes: _paint_autocorrelation(axes, check, band),
        title=f"{white}: Ljung-Box p {probability(check.whiteness_p)}",
        alt=f"Autocorrelation of the whitened residuals by lag; 95 % of white noise is within ±{band:.3f}",
        key=key,
    )


def _paint_autocorrelation(axes: Axes, check: ResidualCheck, band: float) -> None:
    lags = np.asarray(check.lags, dtype=float)
    axes.axhspan(-band, band, color=PALE, alpha=0.6, linewidth=0.0)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    sticks(axes, lags, np.zeros(len(lags)), check.autocorrelation, ACCENT, 2.0)
    reach = max(2.5 * band, 1.15 * float(np.nanmax(np.abs(check.autocorrelation), initial=0.0)))
    axes.set(xlabel="lag, blocks", ylabel="autocorrelation", ylim=(-reach, reach))
    few_ticks(axes, 5, 4)


def allan(check: ResidualCheck, kind: Kind, key: str) -> Panel | None:
    """Draw the Allan deviation of the residuals against the noise model; None for too short a run."""
    known = (check.deviation > 0.0) & (check.expected > 0.0)
    if not known.any():
        return None
    unit = per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    off = float(np.exp(np.max(np.abs(np.log(check.deviation[known] / check.expected[known])))))
    return draw(
        lambda axes: _paint_allan(axes, check, unit, pretty(OUTPUT_UNIT[kind])),
        title=f"Allan deviation within a factor {off:.2f} of the noise model",
        alt="Allan deviation of the residuals and of the fitted noise against averaging time",
        key=key,
    )


def _paint_allan(axes: Axes, check: ResidualCheck, unit: float, name: str) -> None:
    axes.plot(check.tau, check.expected / unit, color=ACCENT)
    axes.plot(check.tau, check.deviation / unit, "o", color=INK, markersize=3)
    axes.set(xscale="log", yscale="log", xlabel="averaging time, s", ylabel=f"Allan deviation, {name}")
    plain_logs(axes)


def against_inputs(sensor: SensorResult, key: str, most: int = MOST_POINTS) -> list[Panel]:
    """Whitened residuals of all runs together against each excited input."""
    channels = dict.fromkeys(channel for check in sensor.checks for channel in check.inputs)
    misfit = sensor.misfit
    panels = []
    for number, channel in enumerate(channels):
        having = [check for check in sensor.checks if channel in check.inputs]
        x = np.concatenate([check.inputs[channel] for check in having])
        y = np.concatenate([check.shown for check in having])
        if 0 < len(x) == len(y) and np.ptp(x) > 0.0:
            said = left_words(misfit, channel, sensor.kind) if misfit else ""
            panels.append(_against((channel, said), x, y, sensor.kind, f"{key}i{number}", most))
    return panels


def _against(
    channel: tuple[str, str], x: FloatArray, y: FloatArray, kind: Kind, key: str, most: int
) -> Panel:
    """Draw residuals over an input, whose name comes with what the tests say of it."""
    name, said = channel
    unit, si = channel_unit(name, kind)
    x = (x - offset(unit, si)) / factor(unit, like=si)
    means = binned_means(x, y)
    found = f": {said}" if said else ""
    return draw(
        lambda axes: _paint_against(axes, (x, y), means, f"{name}, {pretty(unit)}", most),
        title=f"Against {name}{found}",
        alt=f"Whitened residuals against {name} with means of bins{found}",
        key=key,
    )


def binned_means(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of `y`, of unit variance, in at most `BINS` bins of equal count along `x`.

    Returns
    -------
    (centre, mean, sd) : of each bin; sd of the mean is 1/sqrt(count).
    """
    order = np.argsort(x, kind="stable")
    bins = [part for part in np.array_split(order, BINS) if len(part)]
    count = np.array([len(part) for part in bins], dtype=float)
    centre = np.array([x[part].mean() for part in bins])
    return centre, np.array([y[part].mean() for part in bins]), 1.0 / np.sqrt(count)


def _paint_against(
    axes: Axes,
    points: tuple[FloatArray, FloatArray],
    means: tuple[FloatArray, FloatArray, FloatArray],
    label: str,
    most: int,
) -> None:
    x, y = points
    centre, mean, sd = means
    kept = _thinned(len(x), most)
    dots(axes, x[kept], y[kept], PALE)
    sticks(axes, centre, mean - 2.0 * sd, mean + 2.0 * sd, ACCENT)
    axes.plot(centre, mean, "o", color=ACCENT, markersize=4)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set(xlabel=label, ylabel="residual, sd")
    few_ticks(axes, 5, 4)
