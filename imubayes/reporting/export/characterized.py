"""A result that was written, as an IMU to be exported, and what every exported file says of itself.

What a format needs and the result lacks is an `InputError`, as is a model that cannot be inverted over the
range that was tested.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import imubayes
from imubayes.algebra import FloatArray
from imubayes.errors import DataError, InputError
from imubayes.reporting.posterior import POSTERIOR
from imubayes.reporting.result import Exportable
from imubayes.reporting.result.entries import Scene, Sensor, SensorsResult, Term
from imubayes.reporting.result.file import Written, read, written
from imubayes.rig.recordings import CASES
from imubayes.rig.simulate import library_of
from imubayes.sensors.imu import COMPONENTS, Component, Imu, case_channel, imu_of
from imubayes.sensors.imu_range import TEMPERATURES, UNLIMITED, InputRange, contraction, described
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import REFERENCE_TEMPERATURE
from imubayes.units import STANDARD_GRAVITY

BEST, NEEDED, FULL, BASIC = "best", "needed", "full", "basic"
"""Models that every result has, the first being that of the others which predicts best; scenes are more."""

ALONE: dict[str, str] = {"accelerometer": "ax", "gyroscope": "gx"}
"""Place in the case of a component whose id names none."""

OWN: dict[str, str] = {"f": "accelerometer", "w": "gyroscope"}
"""Kind that a quantity is the own input of."""

QUANTITIES = ("f", "w", "dw")
"""Inputs that have axes: i, j, k of a component, or x, y, z of the case."""

HELD = 1.1 * STANDARD_GRAVITY
"""m/s^2 along any axis of the case that a test in the hand is valid for, with a margin for bias and noise."""

BIAS_AT = {
    "start": "that at the start of the record",
    "mean": "the mean over the record",
    "end": "that at the end of the record",
}
"""Which bias is exported, in words."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportedComponent:
    """One component of an exported model: its entry in the result, its terms and their posterior means.

    The covariance (p, p) is of the posterior's draws, and has the variances alone unless it is `joint`;
    N, B and K are the largest over the runs that `noise_runs` names, and `interval`, s, is of their samples.
    """

    sensor: Sensor
    component: Component
    covariance: FloatArray
    joint: bool
    noise: Noise
    noise_runs: tuple[str, ...]
    interval: float


@dataclass(frozen=True, slots=True, eq=False)
class Characterized:
    """An IMU out of a result: parts by component, ``ax`` to ``gz``; those that are missing are ideal.

    `within` has the largest inputs of the runs, UNLIMITED where no term depends on an input; `left_out`
    is the rms error of the output that the model of a scene leaves, SI, by component.
    """

    name: str
    model: str
    parts: Mapping[str, ExportedComponent]
    within: InputRange
    source: Written
    left_out: Mapping[str, float]
    bias_at: str = "mean"

    @property
    def imu(self) -> Imu:
        """Model of the six components."""
        return imu_of({name: part.component for name, part in self.parts.items()})

    @property
    def rejected(self) -> tuple[str, ...]:
        """Ids of the components whose model the data reject."""
        sensors = [part.sensor for part in self.parts.values()]
        return tuple(
            sensor["id"] for sensor in sensors if any(term.get("conditional") for term in sensor["terms"])
        )


def characterized(
    path: Path | str,
    *,
    sensor: str = "",
    model: str = BEST,
    bias_at: str = "mean",
    accept_misfit: bool = False,
) -> Characterized:
    """Read an IMU, or one component, from a ``result.json``.

    Entries whose ids end in ``.ax`` to ``.gz`` and start alike make one IMU; an entry without such an end
    stands alone along the x axis of its case.

    Parameters
    ----------
    path : of the file, or of the folder that holds it.
    sensor : id of the IMU or component; may be left out where there is one.
    model : ``needed`` has the terms that the data show and resolve, ``full`` all terms that were tested,
        ``basic`` bias, scale and misalignment; ``best`` of these the one that predicts best what is left out.
        Smaller models have the posterior of the full one projected on their terms. A result from before had
        no such entries: its ``best`` and ``needed`` have terms more probable than not, at averaged means. The
        name of a scene has what that requires.
    bias_at : ``start``, ``mean`` or ``end`` of the record: whose bias, where it walks with the noise.
    accept_misfit : whether a model that the data reject will do.

    Raises
    ------
    InputError : if it is no result of sensors, or lacks the sensor or the model; if the data reject that.
    """
    source = written(Path(path))
    result = read(source, SensorsResult, "coefficients of a sensor")
    groups: dict[str, dict[str, Sensor]] = {}
    for entry in result["sensors"]:
        first, dot, place = entry["id"].rpartition(".")
        if not dot or place not in COMPONENTS:
            first, place = entry["id"], ALONE[entry["kind"]]
        groups.setdefault(first, {})[place] = entry
    name = sensor or next(iter(groups))
    if name not in groups or (len(groups) > 1 and not sensor):
        asked = f"sensor '{sensor}' is not in it" if sensor else f"it holds {len(groups)} sensors"
        raise InputError(
            f"{source.path}: {asked}: name one of {', '.join(groups)} with --sensor; components make one IMU"
            " where their ids start alike and end in .ax, .ay, .az, .gx, .gy, .gz"
        )
    scene = _scene_entries(source, result, model)
    parts = {place: _part(source, own, (model, bias_at), scene) for place, own in groups[name].items()}
    left_out = {
        place: scene[own["id"]]["left_out_rms"] for place, own in groups[name].items() if own["id"] in scene
    }
    exported = Characterized(name, model, parts, _range(parts, groups[name]), source, left_out, bias_at)
    if exported.rejected and not accept_misfit:
        raise InputError(
            f"{source.path}: {_rejected(exported)} (the report says where it shows). Mend the test or the"
            " library, or take it as it is with --accept-misfit"
        )
    return exported


def _scene_entries(source: Written, result: SensorsResult, model: str) -> dict[str, Scene]:
    """What a scene says of each component, by its id; empty for the models that are no scenes."""
    if model in (BEST, NEEDED, FULL, BASIC):
        return {}
    asked = model.replace("_", "-")
    scenes = {
        scene["sensor"]: scene for scene in result["scenes"] if scene["name"].replace("_", "-") == asked
    }
    if not scenes:
        known = dict.fromkeys((BEST, NEEDED, FULL, BASIC, *(scene["name"] for scene in result["scenes"])))
        raise InputError(f"{source.path}: has no model '{model}': expected one of {', '.join(known)}")
    return scenes


def _part(
    source: Written, sensor: Sensor, asked: tuple[str, str], scene: Mapping[str, Scene]
) -> ExportedComponent:
    model, bias_at = asked
    bias = sensor.get("bias") if bias_at != "mean" else None
    if (used := _compensation(sensor, model)) is not None:
        names, mean, joint = list(used["terms"]), np.array(used["mean"]), True
        covariance = np.array(used["covariance"]).reshape(len(names), len(names))
    elif model == BASIC:
        raise InputError(
            f"{source.path}: {sensor['id']} has no model '{BASIC}': its test has too few positions to predict"
            f" each from the others; choose {NEEDED} or {FULL}, or run the study again if an earlier version"
            " wrote it"
        )
    else:
        terms = _terms(sensor, model, scene.get(sensor["id"]))
        names = [term["name"] for term in terms]
        keys = ("full_mean", "full_sd") if model == FULL else ("mean", "sd")
        mean, spread = (np.nan_to_num(np.array([term[key] for term in terms], dtype=float)) for key in keys)
        alone = model == FULL or (bias and "b0" in names)  # the draws are of the mean bias
        drawn = None if alone else posterior_covariance(source.path, sensor["id"], names)
        covariance, joint = np.diag(spread**2) if drawn is None else drawn, drawn is not None
    lib = library_of(sensor["kind"], names)
    places = [names.index(name) for name in lib.names]
    theta, covariance = mean[places], covariance[np.ix_(places, places)]
    if bias and "b0" in lib.names:
        # a model's b0 may take up what it leaves out, beside the bias itself
        b0, here, middle = lib.names.index("b0"), bias[bias_at], bias["mean"]
        covariance, joint = np.diag(np.diag(covariance)), False
        theta[b0] += here["mean"] - middle["mean"]
        covariance[b0, b0] = max(covariance[b0, b0] + here["sd"] ** 2 - middle["sd"] ** 2, 0.0)
    runs, noise = _noise(sensor)
    return ExportedComponent(
        sensor=sensor,
        component=Component(lib, theta),
        covariance=covariance,
        joint=joint,
        noise=noise,
        noise_runs=runs,
        interval=float(np.median([run["sampling"] for run in sensor["runs"]])),
    )


def _compensation(sensor: Sensor, model: str) -> Exportable | None:
    """Coefficients of a model as the result has them, the best one first; None of a scene, or without any."""
    return next(
        (
            compensation
            for compensation in sensor.get("compensations", ())
            if model in (BEST, compensation["model"])
        ),
        None,
    )


def _terms(sensor: Sensor, model: str, scene: Scene | None) -> list[Term]:
    """Terms of the model; what was never excited, or is as the prior, has no value of the data's own."""
    silent = ("untested",) if model == FULL else ("untested", "unresolved")
    names = sensor["model"] if scene is None else scene["model"]
    told = [term for term in sensor["terms"] if term["verdict"] not in silent]
    return told if model == FULL else [term for term in told if term["name"] in names]


def _noise(sensor: Sensor) -> tuple[tuple[str, ...], Noise]:
    """Largest N, B and K over the static runs, or over all where there is none: posterior means, if drawn."""
    static = [run["name"] for run in sensor["runs"] if run["procedure"] == "static"]
    draws = sensor["noise_posterior"].items()
    known = sensor["noise"] | {run: {key: sizes[key]["mean"] for key in "NBK"} for run, sizes in draws}
    sizes = [(name, known[name]) for name in static or known if name in known]
    N, B, K = (max((own[key] for _, own in sizes if math.isfinite(own[key])), default=0.0) for key in "NBK")
    return tuple(name for name, _ in sizes), Noise(N, B, K)


def posterior_covariance(result: Path, id: str, names: Sequence[str]) -> FloatArray | None:
    """Covariance (p, p) of the named terms over the model-averaged draws."""
    file = result.with_name(POSTERIOR)
    if not file.exists():
        return None
    from h5py import File

    try:
        with File(file) as whole:
            group: Any = whole["posterior"]
            for name, variable in group.items():
                if variable.attrs.get("sensor") == id and f"{name}_term" in group:
                    terms = list(group[f"{name}_term"].asstr())
                    if not set(names) <= set(terms):
                        return None
                    draws = variable[()].reshape(-1, len(terms))[:, [terms.index(term) for term in names]]
                    return np.atleast_2d(np.cov(draws, rowvar=False)).reshape(len(names), len(names))
    except (OSError, KeyError, TypeError, RuntimeError) as error:
        raise DataError(f"{file}: cannot be read ({error}): remove it, or run the study again") from None
    return None


def _range(parts: Mapping[str, ExportedComponent], entries: Mapping[str, Sensor]) -> InputRange:
    used = {
        case_channel(place, factor.channel)
        for place, part in parts.items()
        for term in part.component.library.terms
        for factor in term.factors
    }
    tested = _tested(entries)

    def size(channel: str) -> float:
        ends = tested.get(channel, ())
        return max(map(abs, ends), default=0.0) if channel in used else UNLIMITED

    f, w, dw = (tuple(size(f"{quantity}_{axis}") for axis in "xyz") for quantity in ("f", "w", "dw"))
    heat = tested.get("T", [REFERENCE_TEMPERATURE])
    low, high = (min(heat), max(heat)) if "T" in used else TEMPERATURES
    within = InputRange(
        (f[0], f[1], f[2]), (w[0], w[1], w[2]), (dw[0], dw[1], dw[2]), (low, high), size("dT")
    )
    if not any(run["procedure"] in CASES for sensor in entries.values() for run in sensor["runs"]):
        return within
    # positions in the hand are all over the sphere of 1 g, and an axis is upright in none of them exactly
    x, y, z = (max(end, HELD) for end in f)
    wide = replace(within, f=(x, y, z))
    imu = imu_of({place: part.component for place, part in parts.items()})
    return wide if contraction(imu, wide) < 1.0 else within


def _tested(entries: Mapping[str, Sensor]) -> dict[str, list[float]]:
    """Lowest and highest values over the runs, by channel of the case.

    How far a force was known is a matter of the accelerometers, and a rate of the gyroscopes: what the others
    saw counts where these are missing.
    """
    values: dict[str, dict[str, list[float]]] = {}
    for place, sensor in entries.items():
        for channel, ends in (item for run in sensor["runs"] for item in run["ranges"].items()):
            quantity, _, axis = channel.rpartition("_")
            if channel in COMPONENTS:  # output of a triad: that of its input, nearly
                name = f"{'f' if channel[0] == 'a' else 'w'}_{channel[1]}"
            elif channel in ("T", "dT") or (quantity in QUANTITIES and axis in "ijk"):
                name = case_channel(place, channel)
            elif quantity in QUANTITIES:
                name = channel
            else:
                continue
            values.setdefault(name, {}).setdefault(sensor["kind"], []).extend(filter(math.isfinite, ends))
    return {
        name: of_kind.get(OWN.get(name[:1], ""), [end for ends in of_kind.values() for end in ends])
        for name, of_kind in values.items()
    }


UNITS = "m/s^2, rad/s, rad/s^2, K, K/s (SI)"
AXES = (
    "right-handed case axes x, y, z; (i, j, k) of the x component are (x, y, z), of y (y, z, x), of z"
    " (z, x, y); specific force is +g upwards at rest, rates are inertial and count counter-clockwise"
)
MEANING = (
    "output = input + sum of coefficient times regressor; coefficients are errors, so b1 is that of the gain"
)


def identifier(sensor: Characterized) -> str:
    """Name of the exported model as an identifier of ASCII letters, digits and underscores."""
    name = re.sub(r"\W+", "_", sensor.name, flags=re.ASCII).strip("_").lower()
    return name if name[:1].isalpha() else f"imu_{name}".rstrip("_")


def provenance(sensor: Characterized) -> dict[str, Any]:
    """Where a model comes from and what it means, as plain values."""
    walks = any(part.sensor.get("bias") for part in sensor.parts.values())
    return {
        "imubayes": imubayes.__version__,
        "result": sensor.source.path.name,
        "sha256": sensor.source.sha256,
        "result_written_by": sensor.source.version,
        "study": sensor.source.study,
        "sensor": sensor.name,
        "model": sensor.model,
        "units": UNITS,
        "axes": AXES,
        "meaning": MEANING,
        "left_out_rms": dict(sensor.left_out),
        "bias_at": sensor.bias_at if walks else None,
        "valid": validity(sensor),
        "rejected": list(sensor.rejected),
    }


def _rejected(sensor: Characterized) -> str:
    return f"the data reject the model of {', '.join(sensor.rejected)}: what it lacks may pass for a term"


def validity(sensor: Characterized) -> dict[str, Any]:
    """Largest inputs that were tested, SI; null where no term depends on an input."""
    within = sensor.within
    ends = {"f": within.f, "w": within.w, "dw": within.dw}
    sizes = {key: [None if size >= UNLIMITED else size for size in of] for key, of in ends.items()}
    heat = None if within.T == TEMPERATURES else list(within.T)
    return {**sizes, "T": heat, "dT": None if within.warming >= UNLIMITED else within.warming}


def heading(sensor: Characterized) -> tuple[str, ...]:
    """Lines for the top of an exported file."""
    about = provenance(sensor)
    ids = ", ".join(f"{place} ({part.sensor['id']})" for place, part in sensor.parts.items())
    missing = ", ".join(name for name in COMPONENTS if name not in sensor.parts)
    lines = (
        f"{sensor.name}: {_model_words(sensor)}",
        f"Components: {ids}.",
        f"Beware: {_rejected(sensor)}." if sensor.rejected else "",
        f"Not in the result, and taken as ideal: {missing}." if missing else "",
        f"Bias: it walks with the noise; this one is {BIAS_AT[sensor.bias_at]}." if about["bias_at"] else "",
        f"Equation: {MEANING}.",
        f"Units: {UNITS}.",
        f"Axes: {AXES}.",
        f"Valid for: {described(sensor.within)} (largest inputs of the runs along x, y, z; 'any': no term"
        " depends on it).",
        f"From: {about['result']}, sha256 {about['sha256']}, study '{about['study']}'.",
        f"Written by imubayes {about['imubayes']}; the result by imubayes {about['result_written_by']}.",
    )
    return tuple(" ".join(line.split()) for line in lines if line)


def _model_words(sensor: Characterized) -> str:
    chosen = {place: _compensation(part.sensor, sensor.model) for place, part in sensor.parts.items()}
    if any(chosen.values()):
        told = "; ".join(
            f"{place} {choice['model']} ({', '.join(choice['terms'])}), {choice['held_out']:.3g} over"
            f" {choice['positions']} positions"
            for place, choice in chosen.items()
            if choice
        )
        return (
            f"of each component the model {sensor.model}, and the rms error of what was left out, SI: {told}"
        )
    if sensor.model == FULL:
        return "every term that was tested, under the full library"
    if sensor.model in (BEST, NEEDED):
        return "the terms that the data show to be more probable than not, at their model-averaged means"
    left = ", ".join(f"{place} {size:.3g}" for place, size in sensor.left_out.items())
    required = f"the terms that the scene {sensor.model} requires"
    return f"{required}; rms of what is left out, SI: {left or 'not known'}"
