"""What every exported file says of itself: model, units, axes, validity, and the result it came from."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import imubayes
from imubayes.reporting.export.characterized import FULL, NEEDED, UNLIMITED, Characterized
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.terms import Term

UNITS = "m/s^2, rad/s, rad/s^2, K, K/s (SI)"
AXES = (
    "right-handed case axes x, y, z; (i, j, k) of the x component are (x, y, z), of y (y, z, x), of z"
    " (z, x, y); specific force is +g upwards at rest, rates are inertial and count counter-clockwise"
)
MEANING = (
    "output = input + sum of coefficient times regressor; coefficients are errors, so b1 is that of the gain"
)


def heading(found: Characterized) -> tuple[str, ...]:
    """Lines for the top of an exported file."""
    return tuple(" ".join(line.split()) for line in _lines(found))


def identifier(found: Characterized) -> str:
    """Name of the exported model as an identifier of ASCII letters, digits and underscores."""
    name = re.sub(r"\W+", "_", found.name, flags=re.ASCII).strip("_").lower()
    return name if name[:1].isalpha() else f"imu_{name}".rstrip("_")


def provenance(found: Characterized) -> dict[str, Any]:
    """Where a model comes from and what it means, as plain values."""
    return {
        "imubayes": imubayes.__version__,
        "result": found.source.path.name,
        "sha256": found.source.sha256,
        "result_written_by": found.source.version,
        "study": found.source.study,
        "sensor": found.name,
        "model": found.model,
        "units": UNITS,
        "axes": AXES,
        "meaning": MEANING,
        "left_out_rms": dict(found.left_out),
        "valid": validity(found),
    }


def validity(found: Characterized) -> dict[str, Any]:
    """Largest inputs that were tested, SI; null where no term depends on an input."""
    within = found.within
    sizes = {key: [_limit(end) for end in getattr(within, key)] for key in ("f", "w", "dw")}
    depends = any(f.channel == "T" for t in _terms(found) for f in t.factors)
    return {**sizes, "T": list(within.T) if depends else None, "dT": _limit(within.warming)}


def _lines(found: Characterized) -> Iterator[str]:
    about = provenance(found)
    yield f"{found.name}: {_model_words(found)}"
    yield f"Components: {', '.join(f'{place} ({part.sensor.id})' for place, part in found.parts.items())}."
    if missing := [name for name in COMPONENTS if name not in found.parts]:
        yield f"Not in the result, and taken as ideal: {', '.join(missing)}."
    yield f"Equation: {MEANING}."
    yield f"Units: {UNITS}."
    yield f"Axes: {AXES}."
    yield f"Valid for: {_valid_words(found)}."
    yield f"From: {about['result']}, sha256 {about['sha256']}, study '{about['study']}'."
    yield f"Written by imubayes {about['imubayes']}; the result by imubayes {about['result_written_by']}."


def _model_words(found: Characterized) -> str:
    if found.model == FULL:
        return "every term that was tested, under the full library"
    if found.model == NEEDED:
        return "the terms that the data show to be more probable than not, at their model-averaged means"
    left = ", ".join(f"{place} {size:.3g}" for place, size in found.left_out.items())
    return (
        f"the terms that the scene {found.model} requires; rms of what is left out, SI: {left or 'not known'}"
    )


def _valid_words(found: Characterized) -> str:
    named = {"f": "m/s^2", "w": "rad/s", "dw": "rad/s^2"}
    known = validity(found)
    parts = [f"|{key}| up to ({_numbers(known[key])}) {unit} along x, y, z" for key, unit in named.items()]
    if known["T"]:
        parts.append(f"T from {found.within.T[0]:g} to {found.within.T[1]:g} K")
    if known["dT"] is not None:
        parts.append(f"|dT/dt| up to {known['dT']:g} K/s")
    return "; ".join(parts) + " (largest inputs of the runs; 'any': no term depends on it)"


def _numbers(sizes: list[float | None]) -> str:
    return ", ".join("any" if size is None else f"{size:.6g}" for size in sizes)


def _limit(size: float) -> float | None:
    return None if size >= UNLIMITED else size


def _terms(found: Characterized) -> Iterator[Term]:
    for part in found.parts.values():
        yield from part.component.library.terms
