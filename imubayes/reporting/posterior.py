"""The exact posterior's draws in ArviZ's netCDF layout, for both lines of ArviZ.

Groups ``posterior`` and ``prior`` with the dimensions ``chain`` (1), ``draw`` and one of terms per component.
Both lines read it by ``arviz.from_netcdf``; it is written by xarray alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import imubayes

if TYPE_CHECKING:
    import xarray

    from imubayes.campaign import SensorResult, StudyResult


def write_posterior(result: StudyResult, path: Path) -> None:
    """Write the draws of every component.

    Parameters
    ----------
    path : file to write; replaced where it exists.

    Notes
    -----
    A variable is named by its component's id (what is not a letter, a digit or ``_`` becomes ``_``), with
    the dimensions (chain, draw, ``<variable>_term``) in SI units; the coordinate ``<variable>_unit`` has the
    unit of each term. A draw is zero where its model has no such term.
    """
    from xarray import DataTree

    groups = {f"/{group}": _dataset(result, group) for group in ("posterior", "prior")}
    DataTree.from_dict(groups).to_netcdf(path, mode="w", engine="h5netcdf")


def _dataset(result: StudyResult, group: str) -> xarray.Dataset:
    from xarray import Dataset

    variables, coordinates = {}, {}
    sizes = {len(_draws(sensor, group)) for sensor in result.sensors}
    for name, sensor in zip(variable_names(result), result.sensors, strict=True):
        draws = _draws(sensor, group)[: min(sizes)]
        dimension = f"{name}_term"
        variables[name] = (("chain", "draw", dimension), draws[np.newaxis], _attributes(sensor))
        coordinates |= _coordinates(name, dimension, sensor)
    coordinates |= {"chain": [0], "draw": np.arange(min(sizes))}
    return Dataset(
        variables,
        coordinates,
        {"inference_library": "imubayes", "inference_library_version": imubayes.__version__},
    )


def _draws(sensor: SensorResult, group: str) -> np.ndarray:
    return sensor.draws if group == "posterior" else sensor.prior_draws


def _coordinates(name: str, dimension: str, sensor: SensorResult) -> dict[str, object]:
    terms = sensor.selection.terms
    return {
        dimension: [term.name for term in terms],
        f"{name}_unit": (dimension, [term.unit for term in terms]),
    }


def _attributes(sensor: SensorResult) -> dict[str, str]:
    units = ", ".join(f"{term.name}: {term.unit}" for term in sensor.selection.terms)
    return {
        "long_name": f"coefficients of {sensor.id}",
        "sensor": sensor.id,
        "kind": sensor.kind,
        "units": units,
    }


def variable_names(result: StudyResult) -> tuple[str, ...]:
    """Name of each component's variable in the file: its id, made safe and unique."""
    return tuple(
        _unique([re.sub(r"\W", "_", sensor.id, flags=re.ASCII) or "sensor" for sensor in result.sensors])
    )


def _unique(names: list[str]) -> Iterator[str]:
    taken: set[str] = set()
    for name in names:
        free = next(f for f in (name, *(f"{name}_{k}" for k in range(2, len(names) + 2))) if f not in taken)
        taken.add(free)
        yield free
