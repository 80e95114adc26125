"""Figures of a component: the choice of terms, the posterior, and what the residuals still hold."""

from __future__ import annotations

import math

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult
from imubayes.inference.misfit import TIME, Dependence
from imubayes.inference.residuals import ResidualCheck
from imubayes.reporting import canvas, rows
from imubayes.reporting.rounding import in_unit, on_output, output_unit, percent, pretty, probability
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, UNSEEN, listed
from imubayes.sensors.terms import Kind
from imubayes.units import counted, factor, offset

ROW = 19
"""px between the rows of a panel that has a row a term."""

NARROWED = 0.1
"""Posterior over prior sd from which a term is counted as known by the test."""

DEEP = 40.0
"""nats below the best size that the evidence panel shows."""

MOST_POINTS = 300
"""Points a curve; more are not seen in 350 px."""

POOR = 2.0
"""Factor from the noise model from which an Allan deviation is called off."""

MOST_NAMED = 5
"""Terms that a title names."""


def inclusion(sensor: SensorResult, key: str) -> canvas.Drawing:
    """Inclusion of every term with its range over prior widths, marked by verdict."""
    terms = sensor.selection.terms
    needed = sum(term.verdict == "needed" for term in terms)
    tested = [term for term in terms if term.verdict != "untested"] or terms
    widest = max(tested, key=lambda term: term.inclusion_range[1] - term.inclusion_range[0])
    low, high = (f"{end:.2f}" for end in widest.inclusion_range)
    most = "for none" if low == high else f"most for {widest.name} ({low} to {high})"
    title = f"{needed} of {counted(len(terms), 'term')} needed; the prior's width matters {most}"
    values = ", ".join(f"{term.name} {term.inclusion:.2f} {term.verdict}" for term in terms)

    def paint(axes: canvas.Axes) -> None:
        seen = [(row, term) for row, term in enumerate(terms) if term.verdict not in UNSEEN]
        canvas.areas(axes, [(0.0, term.inclusion, row - 0.28, row + 0.28) for row, term in seen], canvas.PALE)
        for level in (0.05, 0.5, 0.95):
            axes.axvline(level, color=canvas.PALE, linewidth=0.8, zorder=0)
        _whiskers(axes, np.array([term.inclusion_range for term in terms]), canvas.INK)
        for row, term in enumerate(terms):
            marker, fill = rows.MARKS.get(term.verdict, ("", "", "s", "none"))[2:]
            colour = canvas.VERDICT_COLOURS.get(term.verdict, canvas.GREY)
            axes.plot(term.inclusion, row, marker, fillstyle=fill, color=colour, markersize=7, clip_on=False)
        axes.set(xlim=(0.0, 1.0), xlabel="probability that the term is in the model")
        axes.set_xticks([0.05, 0.5, 0.95], ["0.05", "0.5", "0.95"])
        canvas.rows_of(axes, [term.name for term in terms])

    return canvas.draw(
        paint,
        title=title,
        alt=f"Inclusion probability by term: {values}",
        key=key,
        room=canvas.Room(height=ROW * len(terms) + 44, left=54, right=12),
    )


def model_size(sensor: SensorResult, key: str) -> canvas.Drawing:
    """Evidence against model size."""
    by_size = np.asarray(sensor.selection.models.by_size, dtype=float)
    top = float(np.max(by_size[np.isfinite(by_size)]))
    chance = np.exp(by_size - top)
    chance /= chance.sum()
    best = int(np.argmax(chance))

    def paint(axes: canvas.Axes) -> None:
        size, relative = np.arange(len(by_size)), by_size - top
        shown = relative > -DEEP
        axes.plot(size[shown], relative[shown], "o-", color=canvas.GREY, markersize=4, linewidth=1.0)
        axes.plot(best, relative[best], "o", color=canvas.ACCENT, markersize=8)
        axes.set(xlabel="number of terms in the model", ylabel="ln evidence below best (nats)")
        axes.set_ylim(min(float(relative[shown].min()), -3.0) * 1.08, 1.5)
        axes.set_xlim(-0.5, len(relative) - 0.5)
        canvas.few_ticks(axes, 8, 5, counts=True)

    return canvas.draw(
        paint,
        title=f"Most likely {counted(best, 'term')} ({percent(chance[best])})",
        alt="Log evidence by number of terms, relative to the best: "
        + ", ".join(f"{k}: {value - top:.1f}" for k, value in enumerate(by_size) if value - top > -DEEP),
        key=key,
        room=canvas.Room(height=220),
    )


def best_models(sensor: SensorResult, key: str) -> canvas.Drawing:
    """Draw the ten most probable models as an image: terms down, models across, width by probability.

    A term that but improbable ones of them have, or lack, is none that they disagree on.
    """
    models = sensor.selection.models
    names, best = rows.in_own_names((models.candidates.names, models.best), sensor.selection)
    total = sum(p for _, p in best)
    held = {name: sum(p for model, p in best if name in model) / total for name in names}
    varies = [name for name in names if NOT_NEEDED < held[name] < NEEDED]
    few = "no term by more than 5 %"
    if varies:
        few = listed(varies) if len(varies) <= MOST_NAMED else counted(len(varies), "term")
    title = (
        f"The best model holds {percent(best[0][1])} of the probability"
        if best[0][1] >= NEEDED
        else f"The best {len(best)} models hold {percent(total)} and disagree on {few}"
    )
    each = "; ".join(f"{p:.3f}: {' '.join(model)}" for model, p in best)
    return canvas.draw(
        lambda axes: _paint_models(axes, names, best, set(varies)),
        title=title,
        alt=f"Best models with their probabilities: {each}",
        key=key,
        room=canvas.Room(height=ROW * len(names) + 44, left=54, right=12),
    )


def _paint_models(
    axes: canvas.Axes,
    names: tuple[str, ...],
    best: tuple[tuple[tuple[str, ...], float], ...],
    varies: set[str],
) -> None:
    edges = np.concatenate([[0.0], np.cumsum([p for _, p in best])])
    present = [
        (name in varies, (edges[m], edges[m + 1], row - 0.42, row + 0.42))
        for row, name in enumerate(names)
        for m, (model, _) in enumerate(best)
        if name in model
    ]
    canvas.areas(axes, [box for some, box in present if not some], canvas.GREY)
    canvas.areas(axes, [box for some, box in present if some], canvas.ACCENT)
    for edge in edges[1:-1]:
        axes.axvline(edge, color="white", linewidth=1.0)
    axes.set(xlim=(0.0, edges[-1]), xlabel="probability, models side by side")
    canvas.few_ticks(axes, 5)
    canvas.rows_of(axes, names)


def posterior(sensor: SensorResult, key: str) -> canvas.Drawing | None:
    """Posterior of each kept term beside its prior, in prior sds; None where no term is kept."""
    model = sensor.selection.model
    kept = [
        t
        for t in sensor.selection.terms
        if t.name in model and 0.0 < t.sd < math.inf and math.isfinite(t.mean) and 0.0 < t.prior_sd < math.inf
    ]
    if not kept:
        return None
    mean, sd = (np.array([getattr(t, key) / t.prior_sd for t in kept]) for key in ("mean", "sd"))
    places, narrow = zip(kept, mean, sd, strict=True), int((sd <= NARROWED).sum())
    are = "is" if narrow == 1 else "are"

    def paint(axes: canvas.Axes) -> None:
        axes.axvspan(-2.0, 2.0, color=canvas.PALE, alpha=0.45, linewidth=0.0)
        axes.axvline(0.0, color=canvas.GREY, linewidth=0.8, zorder=0)
        _whiskers(axes, np.column_stack([mean - 2.0 * sd, mean + 2.0 * sd]), canvas.ACCENT)
        axes.plot(mean, np.arange(len(kept)), "o", color=canvas.ACCENT, markersize=4.5)
        reach = max(2.2, 1.1 * float(np.max(np.abs(mean) + 2.0 * sd)))
        axes.set(xlim=(-reach, reach), xlabel="prior sd")
        canvas.few_ticks(axes, 6)
        canvas.rows_of(axes, tuple(t.name for t in kept))

    return canvas.draw(
        paint,
        title=f"{narrow} of {counted(len(kept), 'kept term')} {are} known ten times as well as before",
        alt="Posterior in prior sd: " + ", ".join(f"{t.name} {m:.3g} ± {s:.2g}" for t, m, s in places),
        key=key,
        room=canvas.Room(height=ROW * len(kept) + 44, left=54, right=12),
    )


def _whiskers(axes: canvas.Axes, ends: FloatArray, color: str) -> None:
    """Draw a horizontal line a row between its ends (m, 2)."""
    line = np.column_stack([ends, np.full(len(ends), np.nan)])
    axes.plot(line.ravel(), np.repeat(np.arange(len(ends)), 3), color=color, linewidth=1.2)


def over_time(check: ResidualCheck, key: str, most: int = MOST_POINTS) -> canvas.Drawing:
    """Whitened residuals of a run over time, with the blocks that stand out."""
    count = len(check.outliers)
    out = f"{counted(count, 'block')} stand{'' if count > 1 else 's'} out"
    finding = out if count else "nothing stands out"
    size = "" if math.isnan(check.scale) else f"{check.scale:.2f}"

    def paint(axes: canvas.Axes) -> None:
        unit, scale = canvas.time_unit(float(check.t[-1] - check.t[0])) if len(check.t) else ("s", 1.0)
        kept = np.unique(np.linspace(0, len(check.t) - 1, min(len(check.t), most)).astype(np.int64))
        axes.axhspan(-2.0, 2.0, color=canvas.PALE, alpha=0.45, linewidth=0.0)
        canvas.dots(axes, check.t[kept] / scale, check.shown[kept], canvas.INK)
        top = {"color": canvas.INK, "ha": "center", "va": "top", "transform": axes.get_xaxis_transform()}
        for start, stop, size in check.outliers[:10]:
            axes.axvspan(start / scale, stop / scale, color=canvas.WARNING, alpha=0.35, linewidth=1.0)
            axes.text(0.5 * (start + stop) / scale, 0.98, f"{size:.0f} sd", **top)
        axes.set(xlabel=f"time, {unit}", ylabel="residual, sd")
        reach = max(4.0, 1.1 * float(np.nanmax(np.abs(check.shown), initial=0.0)))
        axes.set_ylim(-reach, reach)
        canvas.few_ticks(axes, 5, 4)

    return canvas.draw(
        paint,
        title=f"Residual over noise {size}; {finding}" if size else finding.capitalize(),
        alt=f"Whitened residuals over time{size and f', rms {size}'}; {finding}",
        key=key,
    )


def autocorrelation(check: ResidualCheck, key: str) -> canvas.Drawing:
    """Autocorrelation of the whitened residuals, block by block, with the band of white noise."""
    band = 1.96 / math.sqrt(max(len(check.shown), 1))
    title = f"{'White' if check.white else 'Not white'}: Ljung-Box p {probability(check.whiteness_p)}"
    title = "Correlated by the fit itself" if math.isnan(check.whiteness_p) else title

    def paint(axes: canvas.Axes) -> None:
        lags = np.asarray(check.lags, dtype=float)
        axes.axhspan(-band, band, color=canvas.PALE, alpha=0.6, linewidth=0.0)
        axes.axhline(0.0, color=canvas.GREY, linewidth=0.8)
        canvas.sticks(axes, lags, np.zeros(len(lags)), check.autocorrelation, canvas.ACCENT, 2.0)
        reach = max(2.5 * band, 1.15 * float(np.nanmax(np.abs(check.autocorrelation), initial=0.0)))
        axes.set(xlabel="lag, blocks", ylabel="autocorrelation", ylim=(-reach, reach))
        canvas.few_ticks(axes, 5, 4)

    return canvas.draw(
        paint,
        title=title,
        alt=f"Autocorrelation of the whitened residuals by lag; 95 % of white noise is within ±{band:.3f}",
        key=key,
    )


def allan(check: ResidualCheck, kind: Kind, key: str) -> canvas.Drawing | None:
    """Draw the Allan deviation of the residuals against the noise model; None for too short a run."""
    known = (check.deviation > 0.0) & (check.expected > 0.0)
    if not known.any():
        return None
    name, unit = output_unit(kind)
    off = float(np.exp(np.max(np.abs(np.log(check.deviation[known] / check.expected[known])))))
    close = f"within a factor {off:.2f} of" if off < POOR else f"off by up to {off:.1f} times from"

    def paint(axes: canvas.Axes) -> None:
        axes.plot(check.tau, check.expected / unit, color=canvas.ACCENT)
        axes.plot(check.tau, check.deviation / unit, "o", color=canvas.INK, markersize=3)
        axes.set(
            xscale="log", yscale="log", xlabel="averaging time, s", ylabel=f"Allan deviation, {pretty(name)}"
        )
        canvas.plain_logs(axes)

    return canvas.draw(
        paint,
        title=f"Allan deviation {close} the noise model",
        alt="Allan deviation of the residuals and of the fitted noise against averaging time",
        key=key,
    )


def dependence(trend: Dependence, kind: Kind, key: str) -> canvas.Drawing:
    """Draw the mean residual against an input, by branch where the way up differs from the way down."""
    size, p = in_unit(on_output(trend.size, kind)), probability(trend.p)
    finding, where = f"{size} rms, {percent(trend.share)} of the residual, p {p}", trend.where
    name, unit = output_unit(kind)
    mean, sd = trend.mean / unit, trend.sd / unit
    if trend.channel == TIME:
        printed, scale = canvas.time_unit(float(np.ptp(trend.x)))
        along, x = f"time, {printed}", trend.x / scale
    else:
        printed, si = rows.channel_unit(trend.channel, kind)
        along = f"{trend.channel}, {pretty(printed)}"
        x = (trend.x - offset(printed, si)) / factor(printed, like=si)

    def paint(axes: canvas.Axes) -> None:
        axes.axhline(0.0, color=canvas.GREY, linewidth=0.8)
        for sign, colour, shape in (
            (0.0, canvas.ACCENT, "o"),
            (1.0, canvas.SERIES[1], "^"),
            (-1.0, canvas.ACCENT, "v"),
        ):
            part = np.flatnonzero(np.sign(trend.branch) == sign)
            part = part[np.argsort(x[part], kind="stable")]
            if len(part):
                canvas.sticks(axes, x[part], mean[part] - 2.0 * sd[part], mean[part] + 2.0 * sd[part], colour)
                axes.plot(x[part], mean[part], f"{shape}-", color=colour, markersize=4.5, linewidth=0.9)
        axes.set(xlabel=along, ylabel=f"residual, {pretty(name)}")
        canvas.few_ticks(axes, 5, 4)

    return canvas.draw(
        paint,
        title=f"{where}: {finding}",
        alt=f"What the residuals hold beyond the library, with ± 2 sd, against {where}: {finding}",
        key=key,
        room=canvas.Room(height=200, left=54),
    )
