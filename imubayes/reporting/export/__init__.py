"""From a result to something to fly: compensation, simulator models, filter parameters.

Parameters are written here, Kalibr's file, PX4's, JSON, gnss-ins-sim's form and a filter's states; programs
in `source_texts`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from imubayes.errors import InputError
from imubayes.reporting.export.characterized import (
    Characterized,
    ExportedComponent,
    characterized,
    heading,
    identifier,
    provenance,
)
from imubayes.reporting.export.source_texts import c_files, matlab_files, python_files, regressor
from imubayes.reporting.result.file import json_text
from imubayes.rig.recordings import OUTPUT_UNIT
from imubayes.selection.verdicts import listed
from imubayes.sensors.equations.basic import TERMS
from imubayes.sensors.imu import ACCELEROMETERS, GYROSCOPES
from imubayes.sensors.noise import FLOOR, Noise

PEAK = 0.61736
"""Allan deviation of a first-order Gauss-Markov process at its peak, over the process's sd."""

PEAK_AT = 1.8926
"""Averaging time of that peak, over the process's time constant."""

TYPICAL = 100.0
"""s; time constant where N or K is zero, so that nothing tells where the floor lies."""


def kalibr_files(sensor: Characterized) -> dict[str, str]:
    """Text of Kalibr's (and ROS tools') ``imu.yaml`` by its file name.

    Kalibr has one figure for a triad: the largest over the axes. It refuses a random walk of zero: where the
    result has none, it is that of the process that stands for the bias instability, below its time constant.
    """
    check_noise(sensor)
    kinds = triads(sensor)
    rows = [
        *(f"# {line}" for line in heading(sensor)),
        "# Continuous-time figures, the largest over the axes and runs. Kalibr has no bias instability:",
    ]
    for kind, parts in kinds.items():
        rows.append(f"# B of the {kind}s is {max(part.noise.B for part in parts):.6g} {_unit(parts[0])}.")
    for kind, parts in kinds.items():
        unit = _unit(parts[0])
        walk, source = _walk(sensor, kind, parts)
        rows += [
            f"{kind}_noise_density: {max(p.noise.N for p in parts):.9e} # N, {unit}/sqrt(Hz)",
            f"{kind}_random_walk: {walk:.9e} # {source}, {unit}/s/sqrt(Hz) (the same as {unit}/sqrt(s))",
        ]
    rate = 1.0 / min(part.interval for part in sensor.parts.values())
    rows += ["rostopic: /imu0 # set to yours", f"update_rate: {rate:.6g} # Hz, of the runs"]
    return {f"{identifier(sensor)}_imu.yaml": "\n".join(rows) + "\n"}


def floor_process(noise: Noise) -> tuple[float, float]:
    """Sd and time constant, s, of the Gauss-Markov process that has B's floor of the Allan deviation.

    Its peak ``0.617 sd`` is ``sqrt(2 ln 2 / pi) B`` high, and lies where N and K cross, at ``sqrt(3) N/K``.

    Examples
    --------
    >>> sd, tau = floor_process(Noise(1e-3, 1e-4, 1e-5))
    >>> f"{sd:.3e} {tau:.1f}"
    '1.076e-04 91.5'
    """
    crossing = math.sqrt(3.0) * noise.N / noise.K if noise.N > 0.0 and noise.K > 0.0 else PEAK_AT * TYPICAL
    return FLOOR / PEAK * noise.B, crossing / PEAK_AT


def triads(sensor: Characterized) -> dict[str, list[ExportedComponent]]:
    """Parts by kind."""
    kinds = {
        kind: [p for p in sensor.parts.values() if p.sensor["kind"] == kind]
        for kind in ("accelerometer", "gyroscope")
    }
    for kind, parts in kinds.items():
        if not parts:
            raise InputError(
                f"{sensor.source.path}: {sensor.name} has no {kind}: expected both kinds, of one IMU,"
                " with ids that start alike and end in .ax to .gz; choose another format, or such a result"
            )
    return kinds


def check_noise(sensor: Characterized) -> None:
    """Refuse a result that does not say what the noise of a component is."""
    silent = [part.sensor["id"] for part in sensor.parts.values() if not part.noise.N > 0.0]
    if silent:
        raise InputError(
            f"{sensor.source.path}: says nothing of the noise of {', '.join(silent)}: expected N of a run of"
            " each; add a static run to the study, or choose a format that needs no noise"
        )


def _walk(sensor: Characterized, kind: str, parts: list[ExportedComponent]) -> tuple[float, str]:
    """K of a triad, or that of B's process over times below its time constant.

    ``dx/dt = -x/tau + w`` with ``E[w w'] = 2 sd^2/tau`` walks with ``K = sd sqrt(2/tau)`` at first.
    """
    walk = max(part.noise.K for part in parts)
    if walk > 0.0:
        return walk, "K of the bias"
    walk = max(sd * math.sqrt(2.0 / tau) for sd, tau in (floor_process(part.noise) for part in parts))
    if walk > 0.0:
        return walk, "no K was found: that of the process that stands for B"
    raise InputError(
        f"{sensor.source.path}: the {kind}s have neither a random walk K nor a bias instability B, and Kalibr"
        " takes no random walk of zero: let the study estimate the noise of a run, or choose another format"
    )


def _unit(part: ExportedComponent) -> str:
    return OUTPUT_UNIT[part.sensor["kind"]]


def px4_files(imu: Characterized) -> dict[str, str]:
    """Text of a parameter file of PX4, as QGroundControl loads it, by its file name.

    PX4 corrects along each axis of the sensor ``(output - OFF) * SCALE``, and of a gyroscope ``output - OFF``
    (``src/lib/sensor_calibration`` of PX4-Autopilot).

    Raises
    ------
    InputError : if the model has more than bias, scale and misalignment: without what it takes to such terms
        its offsets would be wrong.
    """
    more = [f"{place}.{name}" for place, part in imu.parts.items()
            for name in part.component.library.names if name not in TERMS]  # fmt: skip
    if more:
        raise InputError(
            f"{imu.source.path}: PX4 has no parameter for {listed(more, 4)}, without which offset and scale"
            " would be wrong: choose --model basic, which has bias, scale and misalignment alone"
        )
    rows = [
        *(f"# {line}" for line in heading(imu)),
        "# Axes: those of the outputs of PX4's driver, before SENS_BOARD_ROT. m/s^2 and rad/s.",
    ]
    left: list[str] = []
    for place, part in imu.parts.items():
        terms = dict(zip(part.component.library.names, part.component.theta.tolist(), strict=True))
        sensor, values = "GYRO", {"OFF": terms.pop("b0", 0.0)}
        if place in ACCELEROMETERS:
            sensor, values["SCALE"] = "ACC", 1.0 / (1.0 + terms.pop("b1", 0.0))
        for name, value in values.items():
            rows.append(f"1\t1\tCAL_{sensor}0_{place[1].upper()}{name}\t{value:.9g}\t{REAL32}")
        left += [f"{place}.{name}" for name, value in terms.items() if value]
    if left:
        rows.append(f"# PX4 has no parameter for {', '.join(left)}: these are left out.")
    return {f"{identifier(imu)}_px4.params": "\n".join(rows) + "\n"}


REAL32 = 9
"""MAVLink's number of a parameter's type."""

DEGREES_AN_HOUR = math.degrees(3600.0)
"""deg/h in a rad/s; a density in rad/s/sqrt(Hz) times a sixtieth of it is in deg/sqrt(h)."""


def json_files(sensor: Characterized) -> dict[str, str]:
    """Texts by file name: the model as JSON, and a module that defines gnss-ins-sim's ``imu_err``."""
    name = identifier(sensor)
    parts = {place: _part_record(place, part) for place, part in sensor.parts.items()}
    return {
        f"{name}_model.json": json_text({"provenance": provenance(sensor), "components": parts}),
        f"{name}_gnss_ins_sim.py": _gnss_ins_sim(sensor),
    }


def _part_record(place: str, part: ExportedComponent) -> dict[str, Any]:
    sd = np.sqrt(np.diag(part.covariance))
    terms = zip(part.component.library.terms, part.component.theta, sd, strict=True)
    symbols = {term["name"]: term["symbol"] for term in part.sensor["terms"]}
    floor, tau = floor_process(part.noise)
    return {
        "id": part.sensor["id"],
        "kind": part.sensor["kind"],
        "class": part.sensor["class"],
        "terms": [
            {
                "name": term.name, "symbol": symbols[term.name], "unit": term.unit, "value": float(value),
                "regressor": regressor(place, term), "sd": float(spread),
            }
            for term, value, spread in terms
        ],
        "covariance": part.covariance,
        "covariance_of": "the joint posterior" if part.joint else "variances alone",
        "noise": {"N": part.noise.N, "B": part.noise.B, "K": part.noise.K, "runs": part.noise_runs},
        "gauss_markov": {"sd": floor, "tau": tau, "stands_for": "B"},
        "interval": part.interval,
    }  # fmt: skip


def _gnss_ins_sim(sensor: Characterized) -> str:
    lines = [
        *(f"# {line}" for line in heading(sensor)),
        "# For gnss_ins_sim.sim.imu_model.IMU(accuracy=imu_err, axis=6), which knows bias, white noise and a",
        "# Gauss-Markov bias of sd b_stability and time constant b_corr; all terms are in the JSON file.",
        "# Body axes are those of the case; its z often points down: an accelerometer at rest then reads -g.",
        "import numpy as np",
        "",
        "imu_err = {",
    ]
    bias = {
        place: dict(zip(part.component.library.names, part.component.theta, strict=True)).get("b0", 0.0)
        for place, part in sensor.parts.items()
    }
    for stem, walk, places, size, density, unit, walk_unit in (
        ("gyro", "gyro_arw", GYROSCOPES, DEGREES_AN_HOUR, DEGREES_AN_HOUR / 60.0, "deg/h", "deg/sqrt(h)"),
        ("accel", "accel_vrw", ACCELEROMETERS, 1.0, 60.0, "m/s^2", "m/s/sqrt(h)"),
    ):
        noise = [sensor.parts[p].noise if p in sensor.parts else Noise(0.0, 0.0, 0.0) for p in places]
        floors = [floor_process(process) for process in noise]
        for key, values, of in (
            (f"{stem}_b", [size * bias.get(place, 0.0) for place in places], unit),
            (walk, [density * process.N for process in noise], walk_unit),
            (f"{stem}_b_stability", [size * sd for sd, _ in floors], unit),
            (f"{stem}_b_corr", [tau for _, tau in floors], "s"),
        ):
            lines.append(f'    "{key}": np.array([{", ".join(f"{value:.9g}" for value in values)}]),  # {of}')
    return "\n".join([*lines, "}"]) + "\n"


EQUATIONS = (
    "error of a compensated component: -sum over its states of state times regressor, plus white noise;"
    " dx/dt = decay x + w, E[w w'] = diag(q) (continuous time); x(0) ~ N(0, P0)"
)


def filter_files(sensor: Characterized) -> dict[str, str]:
    """Text of the list of states by its file name: of all components, one after another, SI.

    Each coefficient of the model is a state: what the calibration does not know of it. That of the bias walks
    with K; another one of each component is the Gauss-Markov process that stands for B. White noise N goes
    to the mechanization: N^2 of the accelerometer drives velocity, that of the gyroscope attitude.
    """
    check_noise(sensor)
    blocks: list[Any] = []
    for part in sensor.parts.values():
        if part.component.library.names[:1] != ("b0",):  # a bias that the model lacks starts from zero
            blocks.append([[0.0]])
        if len(part.covariance):
            blocks.append(part.covariance)
        blocks.append([[floor_process(part.noise)[0] ** 2]])
    record = {
        "provenance": provenance(sensor),
        "equations": EQUATIONS,
        "states": [state for place, part in sensor.parts.items() for state in _states(place, part)],
        "P0": block_diag(*blocks),
        "P0_of": {
            place: "the joint posterior" if part.joint else "variances alone"
            for place, part in sensor.parts.items()
        },
        "white": {
            place: {"N": part.noise.N, "q": part.noise.N**2, "unit": f"({_unit(part)})^2/Hz"}
            for place, part in sensor.parts.items()
        },
    }
    return {f"{identifier(sensor)}_filter.json": json_text(record)}


def _states(place: str, part: ExportedComponent) -> Iterator[dict[str, Any]]:
    terms = part.component.library.terms
    for term in terms if part.component.library.names[:1] == ("b0",) else (None, *terms):
        name = "b0" if term is None else term.name
        yield {
            "name": f"{place}.{name}",
            "unit": _unit(part) if term is None else term.unit,
            "regressor": "1" if term is None else regressor(place, term),
            "process": "random walk" if name == "b0" else "constant",
            "decay": 0.0,
            "q": part.noise.K**2 if name == "b0" else 0.0,
        }
    sd, tau = floor_process(part.noise)
    yield {
        "name": f"{place}.B",
        "unit": _unit(part),
        "regressor": "1",
        "process": "first-order Gauss-Markov",
        "sd": sd,
        "tau": tau,
        "decay": -1.0 / tau,
        "q": 2.0 * sd**2 / tau,
    }


FORMATS: Mapping[str, Callable[[Characterized], dict[str, str]]] = {
    "kalibr": kalibr_files,
    "px4": px4_files,
    "c": c_files,
    "python": python_files,
    "matlab": matlab_files,
    "json": json_files,
    "filter": filter_files,
}
"""Texts by file name, of each format."""


def exported(path: Path | str, to: str, **which: Any) -> dict[str, str]:
    """Texts by file name of a result in one of `FORMATS`; `which` are the options of `characterized`.

    Raises
    ------
    InputError : if the format, sensor or model is not known, the format needs what the result lacks, or the
        data reject the model.
    """
    if to not in FORMATS:
        raise InputError(f"format '{to}' is not known: expected one of {', '.join(FORMATS)}")
    return FORMATS[to](characterized(path, **which))
