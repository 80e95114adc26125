"""Results that were written, read back: of ``result.json`` what a comparison needs, checked."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imubayes.errors import DataError

RESULT = "result.json"
"""Name of the file in a folder of results."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A term in one result.

    Attributes
    ----------
    name, symbol, unit, printed : of the term; SI unit, and the unit that people use.
    mean, sd : under the full library, SI; nan where the file has none.
    inclusion : posterior probability that the term is there.
    verdict : of the decision.
    """

    name: str
    symbol: str
    unit: str
    printed: str
    mean: float
    sd: float
    inclusion: float
    verdict: str


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """One of N, B, K of a run: SI, and the sd of its logarithm; zero where it was given."""

    value: float
    log_sd: float


@dataclass(frozen=True, slots=True)
class ComponentFile:
    """A component in one result.

    Attributes
    ----------
    id, kind, class_id : of the component; the class is empty where there was none.
    terms : by name.
    noise : (run, letter) to its estimate.
    model : terms of the chosen model.
    """

    id: str
    kind: str
    class_id: str
    terms: Mapping[str, Estimate]
    noise: Mapping[tuple[str, str], NoiseEstimate]
    model: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One ``result.json``.

    Attributes
    ----------
    path : of the file.
    sha256 : of its bytes.
    study : title.
    version : of imubayes that wrote it.
    components : in the file's order.
    """

    path: Path
    sha256: str
    study: str
    version: str
    components: tuple[ComponentFile, ...]


def read_result(path: Path) -> ResultFile:
    """Read a ``result.json`` that ``imubayes run`` wrote.

    Parameters
    ----------
    path : of the file, or of the folder that holds it.

    Raises
    ------
    DataError : if there is none, or it is not the result of a study of sensors.
    """
    file = path / RESULT if path.is_dir() else path
    try:
        content = file.read_bytes()
        raw = json.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise DataError(f"{file}: there is no such file: expected a {RESULT} or its folder") from None
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror}): check its permissions") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError):
        raise _no_result(file, "it is not JSON") from None
    if not isinstance(raw, dict) or "imubayes" not in raw:
        raise _no_result(file, "it lacks the key 'imubayes'")
    if not isinstance(raw.get("sensors"), list) or not raw["sensors"]:
        raise _no_result(file, "it holds no sensors, as of another kind of study")
    digest = hashlib.sha256(content).hexdigest()
    try:
        found = tuple(map(_component, raw["sensors"]))
        return ResultFile(file, digest, str(raw.get("study", "")), str(raw["imubayes"]), found)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        key = f"the key {error} is missing" if isinstance(error, KeyError) else f"a value is wrong: {error}"
        raise _no_result(file, key) from None


def _no_result(file: Path, why: str) -> DataError:
    return DataError(f"{file}: is no result of 'imubayes run' on a study of sensors ({why}): expected one")


def _component(raw: Mapping[str, Any]) -> ComponentFile:
    kind = raw["kind"]
    if kind not in ("accelerometer", "gyroscope"):
        raise ValueError(f"kind '{kind}'")
    return ComponentFile(
        id=str(raw["id"]),
        kind=kind,
        class_id=str(raw.get("class") or ""),
        terms={str(term["name"]): _term(term) for term in raw["terms"]},
        noise=_noise(raw),
        model=tuple(map(str, raw.get("model", ()))),
    )


def _term(raw: Mapping[str, Any]) -> Estimate:
    unit = str(raw["unit"])
    return Estimate(
        name=str(raw["name"]),
        symbol=str(raw.get("symbol", "-")),
        unit=unit,
        printed=str(raw.get("printed_unit", unit)),
        mean=_number(raw["full_mean"]),
        sd=_number(raw["full_sd"]),
        inclusion=_number(raw["inclusion"]),
        verdict=str(raw["verdict"]),
    )


def _noise(raw: Mapping[str, Any]) -> dict[tuple[str, str], NoiseEstimate]:
    """Noise of every run: by the chains where it was sampled, else as it was estimated or given."""
    spreads = {run["name"]: run.get("noise_log_sd", {}) for run in raw.get("runs", ())}
    sampled = raw.get("noise_posterior") or {}
    found: dict[tuple[str, str], NoiseEstimate] = {}
    for run, values in raw["noise"].items():
        for letter in "NBK":
            estimate = NoiseEstimate(_number(values[letter]), _number(spreads.get(run, {}).get(letter)))
            if run in sampled:
                estimate = _of_draws(
                    _number(sampled[run][letter]["mean"]), _number(sampled[run][letter]["sd"])
                )
            found[run, letter] = estimate
    return found


def _of_draws(mean: float, sd: float) -> NoiseEstimate:
    """Log-normal value of the same mean and sd."""
    return NoiseEstimate(mean, math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan)


def _number(value: Any) -> float:
    """Number of a file; null is not finite."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, came {value!r:.40}")
    return float(value)
