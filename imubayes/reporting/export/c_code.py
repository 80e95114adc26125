"""The compensation as C99: a header and a source in double precision, and the same in single precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imubayes.reporting.export.characterized import UNLIMITED, Characterized
from imubayes.reporting.export.heading import identifier
from imubayes.reporting.export.source_texts import Language, compiled, model_values, rendered
from imubayes.sensors.imu import Signals, forward, signals

ROWS = 20_000
"""Random inputs over the range, from which the error of single precision is measured."""

USUAL = (10.0, 1.0, 1.0)
"""Sizes of f, w and dw, SI, where no term depends on them, so that no range was needed."""


@dataclass(frozen=True, slots=True)
class Precision:
    """A floating-point type of C.

    Attributes
    ----------
    type : its name.
    suffix : of its constants; `file` of the files' names and the functions.
    settled : relative step at which the iteration ends.
    slack : relative excess over the range that rounding may cause.
    """

    type: str
    suffix: str
    file: str
    settled: str
    slack: str


DOUBLE = Precision("double", "", "", "1e-15", "1e-9")
SINGLE = Precision("float", "f", "_f32", "2e-7f", "1e-6f")


def c_files(found: Characterized) -> dict[str, str]:
    """Texts of the headers and sources by file name.

    Raises
    ------
    InputError : if the model cannot be inverted over the range that was tested.
    """
    error = single_precision_error(found)
    texts = {}
    for precision in (DOUBLE, SINGLE):
        values = model_values(found, _language(precision)) | {"precision": precision, "error": error}
        for ending in ("h", "c"):
            file = f"{identifier(found)}_compensation{precision.file}.{ending}"
            texts[file] = rendered(f"compensation.{ending}.j2", values)
    return texts


def single_precision_error(found: Characterized) -> tuple[float, float]:
    """Largest errors of f, m/s^2, and w, rad/s, of the compensation in single precision.

    Over `ROWS` inputs at random in the range, against double precision; the same arithmetic, in the same
    order, as the C source.
    """
    inputs = _inputs(found)
    outputs = forward(found.imu, inputs)
    module = compiled(found)
    errors = []
    for dtype in (np.float32, np.float64):
        arrays = [getattr(outputs, key).astype(dtype) for key in ("f", "w", "dw", "T", "warming")]
        errors.append(module["compensate"](*arrays, check=False))
    (f_single, w_single), (f, w) = errors
    return float(np.abs(f_single - f).max()), float(np.abs(w_single - w).max())


def _inputs(found: Characterized) -> Signals:
    rng = np.random.default_rng(0)
    within = found.within
    f, w, dw = (
        rng.uniform(-1.0, 1.0, (ROWS, 3)) * [usual if end >= UNLIMITED else end for end in ends]
        for ends, usual in zip((within.f, within.w, within.dw), USUAL, strict=True)
    )
    warming = 0.0 if within.warming >= UNLIMITED else within.warming
    return signals(
        f, w, dw=dw, T=rng.uniform(*within.T, ROWS), warming=warming * rng.uniform(-1.0, 1.0, ROWS)
    )  # fmt: skip


def _language(precision: Precision) -> Language:
    def number(value: float) -> str:
        shortest = str(np.float32(value)) if precision.suffix else repr(float(value))
        return (shortest if "e" in shortest or "." in shortest else f"{shortest}.0") + precision.suffix

    return Language(number, lambda column: f"u[{column}]", lambda x: f"sign_of({x})")
