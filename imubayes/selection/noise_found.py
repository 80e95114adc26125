"""The noise processes of a run by both routes: evidence, and a fit of the Allan variance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.allan import AllanCurve, AllanFit, allan_curve, fit_allan
from imubayes.inference.linear import Linear, residuals
from imubayes.inference.noise_model import span
from imubayes.rig.inputs import between_gaps
from imubayes.selection.noise_choice import NoiseChoice, identify_noise
from imubayes.sensors.noise_processes import OPTIONAL, Process
from imubayes.sensors.sensor_class import SensorClass
from imubayes.units import Key

SHORTEST = 100
"""Samples below which a run tells nothing of its noise processes."""


@dataclass(frozen=True, slots=True)
class NoiseQuestion:
    """Which runs are asked for their noise processes."""

    identify: Annotated[
        Literal["static", "all", "none"],
        Key(
            "which runs are asked for their noise processes: `static` (quiet logs), `all` (tests too; of a"
            " triad or a whole IMU the samples at rest), or `none` ([docs/noise.md](noise.md))",
            "all",
        ),
    ] = "static"
    candidates: Annotated[
        tuple[Process, ...],
        Key("processes beside white noise that a run may show", ["B", "K", "Q"]),
    ] = OPTIONAL

    def asks(self, rows: Linear) -> bool:
        """Whether a run is asked."""
        wanted = self.identify == "all" or (self.identify == "static" and rows.procedure == "static")
        return wanted and len(rows) >= SHORTEST


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFound:
    """Noise processes of one run.

    Attributes
    ----------
    choice : by evidence.
    curve : Allan deviation of the residuals beside the processes; None for too short a run.
    fit : by the weighted fit of the Allan variance; None where gaps interrupt the run.
    """

    choice: NoiseChoice
    curve: AllanCurve | None
    fit: AllanFit | None


def processes_of(
    asked: NoiseQuestion,
    runs: Sequence[Linear],
    sensor: SensorClass | None,
    *,
    rng: np.random.Generator,
    theta: FloatArray | None = None,
    tell: Callable[[str], None] = lambda message: None,
) -> tuple[NoiseFound, ...]:
    """Identify the noise processes of the runs that are asked for them.

    Parameters
    ----------
    asked : which runs, and for which processes.
    runs : rows of each.
    sensor, rng, theta : as `noise_of` takes them.
    tell : is told what goes on.
    """
    found = []
    for rows in runs:
        if asked.asks(rows):
            tell(f"noise processes of {rows.name}")
            found.append(noise_of(rows, theta, sensor, rng=rng, candidates=asked.candidates))
    return tuple(found)


def noise_of(
    rows: Linear,
    theta: FloatArray | None,
    sensor: SensorClass | None,
    *,
    rng: np.random.Generator,
    candidates: Sequence[str] = OPTIONAL,
) -> NoiseFound:
    """Identify the noise processes of a run.

    Parameters
    ----------
    rows : of the run.
    theta : (p,) coefficients whose residuals the Allan deviation is of, None for those that fit the run alone
        best by least squares; the evidence needs none.
    sensor : class whose priors hold; None takes wide ones.
    rng : of the importance draws.
    candidates : processes beside white noise.
    """
    choice = identify_noise(rows, sensor, rng=rng, candidates=candidates)
    left = _left(rows) if theta is None else residuals(rows, theta)
    curve = allan_curve(left, rows.t, rows.interval, choice.noise)
    if curve is None or len(between_gaps(rows.t, rows.interval)) > 1:
        return NoiseFound(choice, curve, None)
    names = ("N", *choice.noise.present, *(["tau"] if choice.noise.G > 0.0 else []))
    if rows.stream is not None:
        # averages over blocks are too long to show it
        names = tuple(name for name in names if name != "Q")
    if len(names) >= len(curve.tau):
        return NoiseFound(choice, curve, None)
    return NoiseFound(choice, curve, fit_allan(curve, choice.noise, names, (len(rows), rows.interval)))


def _left(rows: Linear) -> FloatArray:
    """Response (n,) less its projection on the columns."""
    basis = span(rows.columns(0, len(rows)))
    return np.asarray(rows.y - basis @ (basis.T @ rows.y), dtype=np.float64)
