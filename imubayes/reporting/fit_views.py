"""What the residuals say of a component, as blocks of its report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from imubayes.reporting import fit_figures
from imubayes.reporting.blocks import Block, Figure, Prose, Section, Table, quiet
from imubayes.reporting.rounding import probability
from imubayes.reporting.words import fit_sentence

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.residuals import ResidualCheck
    from imubayes.reporting.canvas import Panel
    from imubayes.sensors.terms import Kind

MOST_CURVE_POINTS = 9000
"""Points over all curves of a report, so that it stays below 2 MB."""

MOST_RUNS, MOST_RUNS_OF_MANY = 8, 3
"""Runs whose residuals are drawn: of one or two components, and of each of more."""

HEAD = (
    "run", "residual over noise", "white, p", "normal, p", "sample by sample", "stands out", "fits",
)  # fmt: skip

RESIDUALS = (
    "Time: each dot is a block of samples in units of the sd that the noise gives it; the band is ± 2 sd."
    " Autocorrelation: sticks inside the band are white noise. Allan deviation: dots are the residuals,"
    " the line is the noise model."
)

INPUTS = (
    "Grey: blocks of samples of all runs. Blue: means of bins with ± 2 sd; what the library explains"
    " leaves them on zero."
)


def check_blocks(sensor: SensorResult, *, drawn: bool) -> Iterator[Block]:
    """Verdict on the fit of each run, in words and numbers."""
    yield Prose(fit_sentence(sensor))
    rows = [_check_cells(check) for check in sensor.checks]
    yield Table(f"Residual checks of {sensor.id}", HEAD, rows, "tnnnntt")
    if drawn and sensor.checks:
        yield Prose(
            "Residuals under the full library, whitened by each run's noise: their rms over blocks of"
            " samples is 1 at the noise floor. A run fits when its blocks are of that size, white (p"
            f" above {sensor.checks[0].level:.1g}) and none stands out. All residual tests of the study"
            " share one level: if its models are right, one study in a hundred gives any false alarm."
            " Sample by sample the same two tests show the sensor's own filter and quantisation, which"
            " need not touch the coefficients.",
            "note",
        )


def _check_cells(check: ResidualCheck) -> tuple[str, ...]:
    out = [f"{start:.4g} to {stop:.4g} s ({abs(size):.1f} sd)" for start, stop, size in check.outliers[:3]]
    more = [f"and {len(check.outliers) - 3} more"] if len(check.outliers) > 3 else []
    samples = quiet(f"{check.sample_scale:.2f}, p {probability(check.sample_whiteness_p)}")
    return (
        check.run,
        f"{check.scale:.2f}",
        probability(check.whiteness_p),
        probability(check.normality_p),
        samples,
        ", ".join([*out, *more]) or "nothing",
        "✓ yes" if check.fits else "✗ no",
    )


def residual_blocks(sensor: SensorResult, key: str, sensors: int) -> Iterator[Block]:
    """Residuals of each run over time, and of all against the inputs.

    Parameters
    ----------
    key : identifier of the component in the page.
    sensors : how many components have figures.
    """
    most_runs = MOST_RUNS if sensors <= 2 else MOST_RUNS_OF_MANY
    channels = {channel for check in sensor.checks for channel in check.inputs}
    curves = sensors * (min(len(sensor.checks), most_runs) + len(channels))
    points = max(60, min(fit_figures.MOST_POINTS, MOST_CURVE_POINTS // max(curves, 1)))
    runs = fit_figures.shown_runs(sensor, most_runs)
    if 0 < len(runs) < len(sensor.checks):
        yield Prose(f"Drawn below: the {len(runs)} runs of {len(sensor.checks)} that fit worst.", "note")
    for n, check in enumerate(runs):
        yield Section(check.run, [Figure([*_run_panels(check, sensor.kind, f"{key}r{n}", points)])])
    yield Prose(RESIDUALS, "note")
    if panels := list(fit_figures.against_inputs(sensor, key, points)):
        yield Section("Against the inputs", [Figure(panels, INPUTS)])


def _run_panels(check: ResidualCheck, kind: Kind, key: str, points: int) -> Iterator[Panel]:
    yield fit_figures.over_time(check, f"{key}t", points)
    yield fit_figures.autocorrelation(check, f"{key}c")
    deviation = fit_figures.allan(check, kind, f"{key}a")
    if deviation:
        yield deviation
