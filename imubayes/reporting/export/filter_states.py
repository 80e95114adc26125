"""What a Kalman filter needs of the sensors: error states, their process noise and initial covariance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from imubayes.reporting.export.characterized import Characterized, Part
from imubayes.reporting.export.heading import identifier, provenance
from imubayes.reporting.export.noise_models import check_noise, floor_process
from imubayes.reporting.export.source_texts import regressor
from imubayes.reporting.result.file import json_text

OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}

EQUATIONS = (
    "error of a compensated component: -sum over its states of state times regressor, plus white noise;"
    " dx/dt = decay x + w, E[w w'] = diag(q) (continuous time); x(0) ~ N(0, P0)"
)


def filter_files(found: Characterized) -> dict[str, str]:
    """Text of the list of states by its file name."""
    return {f"{identifier(found)}_filter.json": json_text(filter_record(found))}


def filter_record(found: Characterized) -> dict[str, Any]:
    """States of all components, one after another, as plain values, SI.

    Each coefficient of the model is a state: what the calibration does not know of it. That of the bias walks
    with K; another one of each component is the Gauss-Markov process that stands for B. White noise N goes
    to the mechanization: N^2 of the accelerometer drives velocity, that of the gyroscope attitude.

    Raises
    ------
    InputError : if the noise of a component is not known.
    """
    check_noise(found)
    blocks = [_covariance(part) for part in found.parts.values()]
    return {
        "provenance": provenance(found),
        "equations": EQUATIONS,
        "states": [state for place, part in found.parts.items() for state in _states(place, part)],
        "P0": np.asarray(block_diag(*blocks)).tolist(),
        "P0_of": {
            place: "draws of the posterior" if part.joint else "variances alone"
            for place, part in found.parts.items()
        },
        "white": {
            place: {"N": part.noise.N, "q": part.noise.N**2, "unit": f"({OUTPUT[part.sensor.kind]})^2/Hz"}
            for place, part in found.parts.items()
        },
    }


def _states(place: str, part: Part) -> Iterator[dict[str, Any]]:
    terms = part.component.library.terms
    for term in terms if part.component.library.names[:1] == ("b0",) else (None, *terms):
        name = "b0" if term is None else term.name
        yield {
            "name": f"{place}.{name}",
            "unit": OUTPUT[part.sensor.kind] if term is None else term.unit,
            "regressor": "1" if term is None else regressor(place, term),
            "process": "random walk" if name == "b0" else "constant",
            "decay": 0.0,
            "q": part.noise.K**2 if name == "b0" else 0.0,
        }
    sd, tau = floor_process(part.noise)
    yield {
        "name": f"{place}.B",
        "unit": OUTPUT[part.sensor.kind],
        "regressor": "1",
        "process": "first-order Gauss-Markov",
        "sd": sd,
        "tau": tau,
        "decay": -1.0 / tau,
        "q": 2.0 * sd**2 / tau,
    }


def _covariance(part: Part) -> np.ndarray:
    """Initial covariance in the order of the states; a bias that the model lacks starts from zero."""
    lacking = [] if part.component.library.names[:1] == ("b0",) else [[[0.0]]]
    sd, _ = floor_process(part.noise)
    return np.asarray(block_diag(*lacking, *([part.covariance] if len(part.covariance) else []), [[sd**2]]))
