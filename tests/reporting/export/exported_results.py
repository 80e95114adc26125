"""Results as files, made from the catalogue: six components of an IMU, with a posterior beside them."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from published_found import QUICKSTART
from scenes_found import a_relevance
from xarray import Dataset, DataTree

from imubayes.reporting.scene_words import published_scene
from imubayes.sensors.catalogue import draw_unit, prior_sd, sensor, typical_noise
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.terms import CHANNELS, Library, library

ENDS = {"f": 60.0, "w": 4.0, "dw": 30.0, "T": (278.15, 318.15), "dT": 0.02}
"""Largest inputs of the runs."""

MODELS = ("needed", "full", "uav-hover")
"""Of the result that `write_imu` writes, of which the last is a scene's."""

IDENTICAL = 1e-12
"""Relative to the range; two orders of the same sums, iterated."""

SHARE = 0.01
"""Of the prior sd, that the posterior's is."""


def library_for(name: str) -> Library:
    return library(kind_of(name), set="extended", temperature=1)


def ranges(name: str) -> dict[str, list[float]]:
    found = {}
    for channel in CHANNELS[:-1]:  # an IMU has no second thermometer
        quantity = channel.rpartition("_")[0] or channel
        end = ENDS[quantity]
        found[channel] = list(end) if isinstance(end, tuple) else [-end, end]
    return found | {"output": [-70.0, 70.0]}


def coefficients(seed: int = 1) -> dict[str, dict[str, float]]:
    rng = np.random.default_rng(seed)
    classes = {name: sensor("mems_tactical", kind=kind_of(name)) for name in COMPONENTS}
    return {name: draw_unit(classes[name], library_for(name), rng) for name in COMPONENTS}


def entry(id: str, name: str, truth: Mapping[str, float], dropped: Sequence[str] = ()) -> dict[str, object]:
    entry_class = sensor("mems_tactical", kind=kind_of(name))
    noise = typical_noise(entry_class)
    runs = [("tumble", "tumble", 3.0), ("night", "static", 1.0)]
    sd = {term.name: SHARE * prior_sd(entry_class, term)[0] for term in library_for(name).terms}
    base = QUICKSTART["sensors"][0]
    return base | {
        "noise_posterior": {},
        "compensations": [],
        "id": id,
        "kind": kind_of(name),
        "class": "mems_tactical",
        "noise": {run: {"N": k * noise.N, "B": k * noise.B, "K": k * noise.K} for run, _, k in runs},
        "terms": [
            base["terms"][0] | {
                "name": term, "symbol": f"<{term}>", "unit": "", "mean": value, "sd": sd[term],
                "full_mean": 1.001 * value, "full_sd": 1.1 * sd[term],
                "verdict": "untested" if term in dropped else "needed",
            }
            for term, value in truth.items()
        ],
        "model": [term for term in truth if not term.endswith("p")],
        "runs": [
            base["runs"][0]
            | {"name": run, "procedure": procedure, "sampling": 0.01, "ranges": ranges(name)}
            for run, procedure, _ in runs
        ],
    }  # fmt: skip


def write_imu(
    folder: Path, names: Sequence[str] = COMPONENTS, *, title: str = "an IMU", id: str = "U-1"
) -> Path:
    """Write a ``result.json`` of an IMU; its needed model has no asymmetries, its full one has."""
    truths = coefficients()
    sensors = [entry(f"{id}.{name}", name, truths[name]) for name in names]
    scenes = [
        json.loads(json.dumps(published_scene(a_relevance(), f"{id}.{name}")))
        | {"name": "uav-hover", "model": ["b0", "b1"], "left_out_rms": 0.25}
        for name in names
    ]
    document = QUICKSTART | {"study": title, "sensors": sensors, "scenes": scenes}
    path = folder / "result.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def edited(path: Path, edit: Callable[[dict], object]) -> Path:
    """Change what a result says."""
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))
    return path


def no_noise(*names: str) -> Callable[[dict], None]:
    """Change a result so that no run has noise of these names."""

    def change(document: dict) -> None:
        for run in (run for one in document["sensors"] for run in one["noise"].values()):
            run.update(dict.fromkeys(names, 0.0))

    return change


def write_draws(result: Path, id: str, names: Sequence[str], draws: np.ndarray) -> None:
    """Write draws (m, p) of one component as the posterior's file has them."""
    data = Dataset(
        {"A": (("chain", "draw", "A_term"), draws[np.newaxis], {"sensor": id})}, {"A_term": list(names)}
    )
    DataTree.from_dict({"/posterior": data}).to_netcdf(result.with_name("posterior.nc"), engine="h5netcdf")


def rows_inside(seed: int, n: int) -> dict[str, np.ndarray]:
    """Inputs at random within the runs' ranges."""
    rng = np.random.default_rng(seed)
    low, high = ENDS["T"]
    return {
        **{q: rng.uniform(-ENDS[q], ENDS[q], (n, 3)) for q in ("f", "w", "dw")},
        "T": rng.uniform(low, high, n),
        "warming": rng.uniform(-ENDS["dT"], ENDS["dT"], n),
    }
