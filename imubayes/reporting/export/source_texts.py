"""Exported source texts: the compensation in C (in single precision too), Python and MATLAB (Octave)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imubayes.reporting.blocks import environment
from imubayes.reporting.export.characterized import Characterized, heading, identifier
from imubayes.sensors.imu import CASE_CHANNELS, COMPONENTS, Imu, case_channel, forward, signals
from imubayes.sensors.imu_compensation import ROUNDING, split_jumps
from imubayes.sensors.imu_range import UNLIMITED, rounds
from imubayes.sensors.terms import REFERENCE_TEMPERATURE, Term


@dataclass(frozen=True, slots=True)
class Language:
    """How a language writes a product: its coefficient, and inputs by their number in `CASE_CHANNELS`."""

    number: Callable[[float], str]
    channel: Callable[[int], str]
    sign: Callable[[str], str]
    times: str = " * "


PYTHON = Language(lambda value: repr(float(value)), lambda column: f"u[{column}]", lambda x: f"np.sign({x})")
MATLAB = Language(
    lambda value: repr(float(value)), lambda column: f"u({column + 1}, :)", lambda x: f"sign({x})", " .* "
)


def lines(imu: Imu, language: Language) -> dict[str, list[dict[str, str]]]:
    """Terms of each component, ``ax`` to ``gz``: coefficient times regressor, and what it is."""
    texts: dict[str, list[dict[str, str]]] = {name: [] for name in COMPONENTS}
    for name, component in zip(COMPONENTS, imu.components, strict=True):
        for term, theta in zip(component.library.terms, component.theta, strict=True):
            factors = [language.number(theta)]
            for factor in term.factors:
                x = language.channel(CASE_CHANNELS.index(case_channel(name, factor.channel)))
                factors += [x] * factor.power + ([language.sign(x)] if factor.signed else [])
            product = language.times.join(factors)
            texts[name].append({"name": term.name, "unit": term.unit, "product": product})
    return texts


def regressor(name: str, term: Term) -> str:
    """Regressor of a component's term along the case axes, for people.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer")
    >>> [regressor("ay", lib.terms[k]) for k in (0, 3, 5, 9)]
    ['1', 'f_y^3', 'sgn(f_y) f_y', 'f_y f_z']
    """
    parts: list[str] = []
    for factor in term.factors:
        channel = case_channel(name, factor.channel)
        channel = {"T": "(T - T0)", "dT": "dT/dt"}.get(channel, channel)
        parts += [f"sgn({channel})"] if factor.signed else []
        parts += [channel if factor.power == 1 else f"{channel}^{factor.power}"] if factor.power else []
    return " ".join(parts) or "1"


def rendered(template: str, values: Mapping[str, Any]) -> str:
    """Text of a template beside this module."""
    # source texts, not HTML
    texts = environment().overlay(autoescape=False, keep_trailing_newline=True)
    return texts.get_template(f"export/{template}").render(**values)


def model_values(sensor: Characterized, language: Language) -> dict[str, Any]:
    """What the templates of compensations say: terms by component, ends of the range, steps."""
    smooth, jumps = split_jumps(sensor.imu)
    return {
        "heading": heading(sensor),
        "name": identifier(sensor),
        "components": lines(smooth, language),
        "jumps": lines(jumps, language),
        "index": {name: c for c, name in enumerate(COMPONENTS)},
        "uses_sign": any(f.signed for c in smooth.components for t in c.library.terms for f in t.factors),
        "jumping": any(component.library.terms for component in jumps.components),
        "ends": [language.number(end) for end in sensor.within.ends],
        "rounds": rounds(smooth, sensor.within),
        "reference": language.number(REFERENCE_TEMPERATURE),
        "rounding": language.number(ROUNDING),
    }


def python_files(sensor: Characterized) -> dict[str, str]:
    """Text of the module by its file name; its docstring cannot be ended by what the result says."""
    values = model_values(sensor, PYTHON)
    values["heading"] = [line.replace("\\", "/").replace('"""', "'''") for line in values["heading"]]
    return {f"{identifier(sensor)}_compensation.py": rendered("compensation.py.j2", values)}


def compiled(sensor: Characterized) -> dict[str, Any]:
    """Names that the exported module defines: ``compensate``, ``forward``."""
    names: dict[str, Any] = {}
    for name, text in python_files(sensor).items():
        exec(compile(text, name, "exec"), names)
    return names


def matlab_files(sensor: Characterized) -> dict[str, str]:
    """Text of the function by its file name."""
    name = f"{identifier(sensor)}_imu"
    parts = [
        {
            "place": place,
            "id": quoted(part.sensor["id"]),
            "names": ", ".join(map(quoted, part.component.library.names)),
            "units": ", ".join(quoted(term.unit) for term in part.component.library.terms),
            "coefficients": ", ".join(map(MATLAB.number, part.component.theta)),
            "sd": ", ".join(map(MATLAB.number, np.sqrt(np.diag(part.covariance)))),
            "noise": part.noise,
        }
        for place, part in sensor.parts.items()
    ]
    values = model_values(sensor, MATLAB) | {"function": name, "parts": parts}
    return {f"{name}.m": rendered("imu.m.j2", values)}


def quoted(text: str) -> str:
    """Text as a literal of MATLAB.

    Examples
    --------
    >>> quoted("it's")
    "'it''s'"
    """
    return "'" + " ".join(text.split()).replace("'", "''") + "'"


ROWS = 20_000
"""Random inputs over the range, from which the error of single precision is measured."""

USUAL = (10.0, 1.0, 1.0)
"""Sizes of f, w and dw, SI, where no term depends on them, so that no range was needed."""

PRECISIONS: tuple[Mapping[str, str], ...] = (
    {"type": "double", "suffix": "", "file": "", "settled": "1e-15", "slack": "1e-9"},
    {"type": "float", "suffix": "f", "file": "_f32", "settled": "2e-7f", "slack": "1e-6f"},
)
"""Floating-point types of C: name, suffix of constants, that of files and functions, relative step at which
the iteration ends, and relative excess over the range that rounding may cause."""


def c_files(sensor: Characterized) -> dict[str, str]:
    """Texts of the headers and sources by file name."""
    error = single_precision_error(sensor)
    texts = {}
    for precision in PRECISIONS:
        values = model_values(sensor, _c(precision["suffix"])) | {"precision": precision, "error": error}
        for ending in ("h", "c"):
            file = f"{identifier(sensor)}_compensation{precision['file']}.{ending}"
            texts[file] = rendered(f"compensation.{ending}.j2", values)
    return texts


def single_precision_error(sensor: Characterized) -> tuple[float, float]:
    """Largest errors of f, m/s^2, and w, rad/s, of the compensation in single precision.

    Over `ROWS` inputs at random in the range, against double precision; the same arithmetic, in the same
    order, as the C source.
    """
    rng, within = np.random.default_rng(0), sensor.within
    f, w, dw = (
        rng.uniform(-1.0, 1.0, (ROWS, 3)) * [usual if end >= UNLIMITED else end for end in ends]
        for ends, usual in zip((within.f, within.w, within.dw), USUAL, strict=True)
    )
    T, warming = rng.uniform(*within.T, ROWS), 0.0 if within.warming >= UNLIMITED else within.warming
    inputs = signals(f, w, dw=dw, T=T, warming=warming * rng.uniform(-1.0, 1.0, ROWS))
    outputs = forward(sensor.imu, inputs)
    module = compiled(sensor)
    errors = []
    for dtype in (np.float32, np.float64):
        arrays = [getattr(outputs, key).astype(dtype) for key in ("f", "w", "dw", "T", "warming")]
        errors.append(module["compensate"](*arrays, check=False))
    (f_single, w_single), (f, w) = errors
    return float(np.abs(f_single - f).max()), float(np.abs(w_single - w).max())


def _c(suffix: str) -> Language:
    def number(value: float) -> str:
        shortest = str(np.float32(value)) if suffix else repr(float(value))
        return (shortest if "e" in shortest or "." in shortest else f"{shortest}.0") + suffix

    return Language(number, lambda column: f"u[{column}]", lambda x: f"sign_of({x})")
