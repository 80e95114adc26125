"""Results that were written, read back: of ``result.json`` what a comparison needs, checked."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
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
class ShareEstimate:
    """A term's share of a scene's budget: median, 5 % and 95 % quantiles, and whether the model has it."""

    value: float
    low: float
    high: float
    kept: bool


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A component in one scene of one result.

    Attributes
    ----------
    name, sensor : of the scene, and id of the component.
    duration : of the mission, s.
    quantity, limit : of the budget, SI.
    met : whether a model stays within it.
    model : terms that the scene requires.
    shares : of the budget, by term.
    left_out : error of the terms left out, SI of the budget: median and 95 %.
    """

    name: str
    sensor: str
    duration: float
    quantity: str
    limit: float
    met: bool
    model: tuple[str, ...]
    shares: Mapping[str, ShareEstimate]
    left_out: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Written:
    """A ``result.json`` as it is.

    Attributes
    ----------
    path : of the file.
    sha256 : of its bytes.
    study : title.
    version : of imubayes that wrote it.
    raw : its values.
    """

    path: Path
    sha256: str
    study: str
    version: str
    raw: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One ``result.json`` of a study of sensors.

    Attributes
    ----------
    path : of the file.
    sha256 : of its bytes.
    study : title.
    version : of imubayes that wrote it.
    components : in the file's order.
    scenes : in the file's order.
    seed : of the study, which decides the motion of a scene of the catalogue.
    """

    path: Path
    sha256: str
    study: str
    version: str
    components: tuple[ComponentFile, ...]
    scenes: tuple[SceneFile, ...] = ()
    seed: int | None = None


def written(path: Path) -> Written:
    """Read a ``result.json`` that ``imubayes run`` wrote, of whatever kind of study.

    Parameters
    ----------
    path : of the file, or of the folder that holds it.

    Raises
    ------
    DataError : if there is none, or it is no result.
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
        raise no_result(file, "it is not JSON") from None
    if not isinstance(raw, dict) or "imubayes" not in raw:
        raise no_result(file, "it lacks the key 'imubayes'")
    digest = hashlib.sha256(content).hexdigest()
    return Written(file, digest, str(raw.get("study", "")), str(raw["imubayes"]), raw)


def no_result(file: Path, why: str) -> DataError:
    """Error of a file that is no result."""
    return DataError(f"{file}: is no result of 'imubayes run' ({why}): expected one")


@contextmanager
def checked(file: Path) -> Iterator[None]:
    """Blame what is missing or wrong in a result on its file."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        key = f"the key {error} is missing" if isinstance(error, KeyError) else f"a value is wrong: {error}"
        raise no_result(file, key) from None


def sensors_of(one: Written) -> ResultFile:
    """Check the result of a study of sensors.

    Raises
    ------
    DataError : naming what is missing or wrong.
    """
    raw = one.raw
    if not isinstance(raw.get("sensors"), list) or not raw["sensors"]:
        raise no_result(one.path, "it holds no sensors, as of another kind of study")
    with checked(one.path):
        components = tuple(map(_component, raw["sensors"]))
        scenes = tuple(map(_scene, raw.get("scenes", ())))
        seed = raw.get("seed")
    return ResultFile(one.path, one.sha256, one.study, one.version, components, scenes, seed)


def _scene(raw: Mapping[str, Any]) -> SceneFile:
    left_out = raw["left_out"]
    return SceneFile(
        name=str(raw["name"]),
        sensor=str(raw["sensor"]),
        duration=number(raw["duration"]),
        quantity=str(raw["budget"]["quantity"]),
        limit=number(raw["budget"]["limit"]),
        met=bool(raw["within_budget"]),
        model=tuple(map(str, raw["model"])),
        shares={str(term["name"]): _share(term) for term in raw["terms"]},
        left_out=(number(left_out["median"]), number(left_out["q95"])),
    )


def _share(raw: Mapping[str, Any]) -> ShareEstimate:
    value, low, high = (number(raw[key]) for key in ("share_of_budget", "share_q05", "share_q95"))
    return ShareEstimate(value, low, high, bool(raw["kept"]))


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
        mean=number(raw["full_mean"]),
        sd=number(raw["full_sd"]),
        inclusion=number(raw["inclusion"]),
        verdict=str(raw["verdict"]),
    )


def _noise(raw: Mapping[str, Any]) -> dict[tuple[str, str], NoiseEstimate]:
    """Noise of every run: by the chains where it was sampled, else as it was estimated or given."""
    spreads = {run["name"]: run.get("noise_log_sd", {}) for run in raw.get("runs", ())}
    sampled = raw.get("noise_posterior") or {}
    found: dict[tuple[str, str], NoiseEstimate] = {}
    for run, values in raw["noise"].items():
        for letter in "NBK":
            estimate = NoiseEstimate(number(values[letter]), number(spreads.get(run, {}).get(letter)))
            if run in sampled:
                estimate = _of_draws(number(sampled[run][letter]["mean"]), number(sampled[run][letter]["sd"]))
            found[run, letter] = estimate
    return found


def _of_draws(mean: float, sd: float) -> NoiseEstimate:
    """Log-normal value of the same mean and sd."""
    return NoiseEstimate(mean, math.sqrt(math.log1p((sd / mean) ** 2)) if mean > 0.0 else math.nan)


def number(value: Any) -> float:
    """Number of a file; null is not finite."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, came {value!r:.40}")
    return float(value)
