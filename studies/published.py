"""Figures that others published of the recordings, beside those of the committed results, as tables."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from imubayes.campaign.preparation import nominal_columns
from imubayes.inference.between_stills import directions
from imubayes.inference.stills import resting
from imubayes.inference.triad import Triad, calibration, triad_of
from imubayes.reporting.rounding import measured
from imubayes.sensors.terms import Kind
from imubayes.study.schema import read_runs, read_study

ROOT = Path(__file__).parents[1]

IMU_TK = {
    "scale": ((2.41278e-3, 2.42712e-3, 2.41168e-3), (2.09295e-4, 2.09899e-4, 2.09483e-4)),
    "bias": ((33124.2, 33275.2, 32364.4), (32777.1, 32459.8, 32511.8)),
    "nonorthogonality": (-0.0033593, -0.00890639, -0.0213341),
}
"""Of accelerometers x, y, z in m/s^2 and of gyroscopes in rad/s, by count; T of its model, rad."""

IMUCAL = {
    "scale": ((0.99675, 1.00244, 1.0234), (1.02792, 0.98243, 0.99831)),
    "bias": ((0.537, -0.616, 0.399), (-0.600, -0.370, 0.059)),
}
"""imucal 2.6.0: diagonals of K_a, K_g; biases in m/s^2 and deg/s."""

HEADER = ("figure", "component", "unit", "published", "here, ± sd", "published less here", "in sd")


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """Text of a table."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([HEADER, *rows])
    return stream.getvalue()


class Found:
    """A committed result under the full library, and the run it is of."""

    def __init__(self, study: str) -> None:
        path = ROOT / "studies" / f"{study}.toml"
        (self.spec,) = read_study(path).sensors
        (self.run,) = read_runs(path)
        raw = json.loads((ROOT / "reports" / study / "result.json").read_text())["sensors"]
        self.terms = {
            f"{one['id'].rpartition('.')[2]}.{t['name']}": (t["full_mean"], t["full_sd"])
            for one in raw
            for t in one["terms"]
        }

    def triad(self, kind: Kind) -> Triad:
        """Components of a kind with the coefficients that were found."""
        known = kind == "gyroscope" or self.run.procedure == "ferraris"
        one = triad_of(self.spec.of(kind).library, referenced=known)
        return replace(one, theta=np.array([self.terms[name][0] for name in one.names]))

    def row(
        self, what: str, name: str, unit: str, published: float, here: float, sd: float
    ) -> tuple[str, ...]:
        """A published figure beside ours."""
        size = measured(here, sd, unit)
        digits = len(size.value.partition(".")[2])
        power = 10.0**size.exponent
        label = f"{unit} × 1e{size.exponent}" if size.exponent else unit
        return (
            what,
            name,
            label,
            f"{published / power:.{digits}f}",
            f"{size.value} ± {size.sd}",
            f"{(published - here) / power:+.{digits}f}",
            f"{round((published - here) / sd, 1) + 0.0:+.1f}",
        )


def imu_tk_rows() -> Iterator[tuple[str, ...]]:
    """Scale, bias and non-orthogonality of the Xsens MTi beside imu_tk's."""
    found = Found("imu_tk_xsens")
    force, rate = found.triad("accelerometer"), found.triad("gyroscope")
    nominal = [[nominal_columns(found.spec, name) for name in one.components] for one in (force, rate)]
    tables: Any = [calibration(one, scales) for one, scales in zip((force, rate), nominal, strict=True)]
    for k, (one, unit) in enumerate(((force, "m/s^2/count"), (rate, "rad/s/count"))):
        for c, name in enumerate(one.components):
            sd = nominal[k][c][0] * found.terms[f"{name}.b1"][1]
            yield found.row("scale", name, unit, IMU_TK["scale"][k][c], tables[k][c]["scale"], sd)
    for c, name in enumerate(force.components):
        sd = found.terms[f"{name}.b0"][1] / nominal[0][c][0]
        yield found.row("bias", name, "count", IMU_TK["bias"][0][c], tables[0][c]["bias"], sd)
    yield from _rest_rows(found, force, rate, nominal[1])
    angles = [
        (name, key, a)
        for name, row in zip(force.components, tables[0], strict=True)
        for key, a in row["nonorthogonality"].items()
    ]
    for (name, key, angle), told in zip(angles, IMU_TK["nonorthogonality"], strict=True):
        yield found.row(
            "non-orthogonality", f"{name}.{key}", "rad", told, angle, found.terms[f"{name}.{key}"][1]
        )


def _rest_rows(
    found: Found, force: Triad, rate: Triad, nominal: list[tuple[float, float]]
) -> Iterator[tuple[str, ...]]:
    """imu_tk's bias is the output in the first still: bias and g-sensitivity there."""
    run = resting(found.run)
    f = directions(force, replace(run, stills=run.stills[:1])).f
    X = rate.regressors(np.zeros((1, 3)), f)
    at_rest = [float(x[0] @ theta) for x, theta in zip(X, rate.parts(), strict=True)]
    for c, name in enumerate(rate.components):
        (scale, offset), (_, sd) = nominal[c], found.terms[f"{name}.b0"]
        here = at_rest[c] / scale + offset
        yield found.row("output in the first still", name, "count", IMU_TK["bias"][1][c], here, sd / scale)


def imucal_rows() -> Iterator[tuple[str, ...]]:
    """Scale and bias of the Ferraris session beside imucal's."""
    found = Found("imucal_ferraris")
    for k, (axes, unit, si) in enumerate((("ax ay az", "m/s^2", 1.0), ("gx gy gz", "deg/s", np.pi / 180.0))):
        for c, name in enumerate(axes.split()):
            mean, sd = found.terms[f"{name}.b1"]
            yield found.row(
                "gain less 1", name, "ppm", 1e6 * (IMUCAL["scale"][k][c] - 1.0), 1e6 * mean, 1e6 * sd
            )
        for c, name in enumerate(axes.split()):
            mean, sd = found.terms[f"{name}.b0"]
            yield found.row("bias", name, unit, IMUCAL["bias"][k][c], mean / si, sd / si)
