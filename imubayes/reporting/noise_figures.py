"""The Allan deviation of a run beside its noise processes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from imubayes.reporting.canvas import ACCENT, INK, PALE, SERIES, Axes, Margins, Panel, draw, plain_logs
from imubayes.reporting.rounding import OUTPUT_SI, OUTPUT_UNIT, per_unit, pretty

if TYPE_CHECKING:
    from imubayes.inference.allan_fit import AllanCurve
    from imubayes.selection.noise_found import NoiseFound
    from imubayes.sensors.terms import Kind

HEIGHT = 280
"""px."""

COLOURS = dict(zip("NBKQRG", (*SERIES[1:], *SERIES[1:]), strict=True))
"""Colour of each process; its symbol stands at its line."""

ROOM = 3.0
"""Factor below the lowest dot down to which the processes are drawn."""


def allan_panel(found: NoiseFound, kind: Kind, key: str) -> Panel | None:
    """Draw the Allan deviation with its 90 % band, the fitted curve and the share of each process."""
    curve = found.curve
    if curve is None:
        return None
    inside = float(((curve.low <= curve.fitted) & (curve.fitted <= curve.high)).mean())
    unit = per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    lowest = int(curve.deviation.argmin())
    least = f"{curve.deviation[lowest] / unit:.3g} {pretty(OUTPUT_UNIT[kind])} at {curve.tau[lowest]:.3g} s"
    return draw(
        lambda axes: _paint(axes, curve, unit, pretty(OUTPUT_UNIT[kind])),
        title=f"Lowest {least}; {inside:.0%} of the fitted curve within the 90 % band",
        alt=f"Allan deviation against averaging time with {', '.join(curve.shares)}; lowest {least}",
        key=key,
        height=HEIGHT,
        margins=Margins(right=18),
    )


def _paint(axes: Axes, curve: AllanCurve, unit: float, name: str) -> None:
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
