"""The IMU as a MATLAB (and Octave) function that returns a struct: coefficients, noise, range, models."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from imubayes.reporting.export.characterized import Characterized
from imubayes.reporting.export.equations import Language
from imubayes.reporting.export.heading import identifier
from imubayes.reporting.export.templating import model_values, rendered

MATLAB = Language(
    lambda value: repr(float(value)), lambda column: f"u({column + 1}, :)", lambda x: f"sign({x})", " .* "
)


def matlab_files(found: Characterized) -> dict[str, str]:
    """Text of the function by its file name.

    Raises
    ------
    InputError : if the model cannot be inverted over the range that was tested.
    """
    name = f"{identifier(found)}_imu"
    values = model_values(found, MATLAB)
    return {f"{name}.m": rendered("imu.m.j2", values | {"function": name, "parts": _parts(found)})}


def _parts(found: Characterized) -> list[dict[str, object]]:
    return [
        {
            "place": place,
            "id": quoted(part.id),
            "names": ", ".join(quoted(name) for name in part.component.library.names),
            "units": ", ".join(quoted(term.unit) for term in part.component.library.terms),
            "coefficients": _row(part.component.theta),
            "sd": _row(np.sqrt(np.diag(part.covariance))),
            "noise": part.noise,
        }
        for place, part in found.parts.items()
    ]


def quoted(text: str) -> str:
    """Text as a literal of MATLAB.

    Examples
    --------
    >>> quoted("it's")
    "'it''s'"
    """
    return "'" + " ".join(text.split()).replace("'", "''") + "'"


def _row(values: Iterable[float]) -> str:
    return ", ".join(repr(float(value)) for value in values)
