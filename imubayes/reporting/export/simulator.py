"""An IMU for simulators: everything as JSON, and the error parameters in gnss-ins-sim's form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from imubayes.reporting.export.characterized import Characterized, Part
from imubayes.reporting.export.heading import heading, identifier, provenance
from imubayes.reporting.export.noise_models import floor_process
from imubayes.reporting.export.source_texts import regressor
from imubayes.reporting.result.file import json_text
from imubayes.sensors.imu import ACCELEROMETERS, GYROSCOPES
from imubayes.sensors.noise import Noise

DEGREES_AN_HOUR = math.degrees(3600.0)
"""deg/h in a rad/s; a density in rad/s/sqrt(Hz) times a sixtieth of it is in deg/sqrt(h)."""


def json_files(found: Characterized) -> dict[str, str]:
    """Texts by file name: the model as JSON, and a module that defines gnss-ins-sim's ``imu_err``."""
    name = identifier(found)
    return {
        f"{name}_model.json": json_text(model_record(found)),
        f"{name}_gnss_ins_sim.py": _gnss_ins_sim(found),
    }


def model_record(found: Characterized) -> dict[str, Any]:
    """Everything that a simulator needs, as plain values, SI."""
    return {
        "provenance": provenance(found),
        "components": {place: _part_record(place, part) for place, part in found.parts.items()},
    }


def _part_record(place: str, part: Part) -> dict[str, Any]:
    sd = np.sqrt(np.diag(part.covariance))
    terms = zip(part.component.library.terms, part.symbols, part.component.theta, sd, strict=True)
    floor, tau = floor_process(part.noise)
    return {
        "id": part.sensor.id,
        "kind": part.sensor.kind,
        "class": part.sensor.class_,
        "terms": [
            {
                "name": term.name, "symbol": symbol, "unit": term.unit, "value": float(value),
                "regressor": regressor(place, term), "sd": float(spread),
            }
            for term, symbol, value, spread in terms
        ],
        "covariance": part.covariance,
        "covariance_of": "draws of the posterior" if part.joint else "variances alone",
        "noise": {"N": part.noise.N, "B": part.noise.B, "K": part.noise.K, "runs": part.noise_runs},
        "gauss_markov": {"sd": floor, "tau": tau, "stands_for": "B"},
        "interval": part.interval,
    }  # fmt: skip


def _gnss_ins_sim(found: Characterized) -> str:
    rows = [
        *(f"# {line}" for line in heading(found)),
        "# For gnss_ins_sim.sim.imu_model.IMU(accuracy=imu_err, axis=6), which knows bias, white noise and a",
        "# Gauss-Markov bias of sd b_stability and time constant b_corr; all terms are in the JSON file.",
        "# Body axes are those of the case; its z often points down: an accelerometer at rest then reads -g.",
        "import numpy as np",
        "",
        "imu_err = {",
        *(f"    {row}" for row in _rows(found)),
        "}",
    ]
    return "\n".join(rows) + "\n"


def _rows(found: Characterized) -> list[str]:
    angle, rate = DEGREES_AN_HOUR, DEGREES_AN_HOUR / 60.0
    gyro = (("gyro", "gyro_arw", GYROSCOPES, angle, rate, "deg/h", "deg/sqrt(h)"),)
    accel = (("accel", "accel_vrw", ACCELEROMETERS, 1.0, 60.0, "m/s^2", "m/s/sqrt(h)"),)
    rows = []
    for stem, walk, places, size, density, unit, walk_unit in gyro + accel:
        noise = [found.parts[p].noise if p in found.parts else Noise(0.0, 0.0, 0.0) for p in places]
        floors = [floor_process(one) for one in noise]
        rows += [
            _array(f"{stem}_b", [size * _bias(found, place) for place in places], unit),
            _array(walk, [density * one.N for one in noise], walk_unit),
            _array(f"{stem}_b_stability", [size * sd for sd, _ in floors], unit),
            _array(f"{stem}_b_corr", [tau for _, tau in floors], "s"),
        ]
    return rows


def _bias(found: Characterized, place: str) -> float:
    part = found.parts.get(place)
    if part is None or "b0" not in part.component.library.names:
        return 0.0
    return float(part.component.theta[part.component.library.names.index("b0")])


def _array(key: str, values: list[float], unit: str) -> str:
    return f'"{key}": np.array([{", ".join(f"{value:.9g}" for value in values)}]),  # {unit}'
