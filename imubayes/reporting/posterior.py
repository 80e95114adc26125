"""The posterior in ArviZ's netCDF layout, for both lines of ArviZ, as xarray would write it.

A component of a study is a set of variables named by its id, here ``A``. All variables of a group share the
dimensions ``chain`` and ``draw``:

- ``posterior`` and ``prior``: ``A`` (term) model-averaged coefficients, zero where a draw's model has no such
  term; of components with chains also ``A_full`` (column) under the full library with the columns that are
  no terms, and ``A_noise`` (run, noise) the N, B, K of each run.
- of components with chains: ``sample_stats`` with ``A_lp``, ``log_likelihood`` with ``A`` (dwell),
  ``posterior_predictive`` with ``A`` (dwell), the mean of each dwell without its noise, and ``observed_data``
  with ``A`` (dwell).

Values are SI; the unit of each term or column is a coordinate beside it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

import imubayes
from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult
from imubayes.inference.mcmc import Chains
from imubayes.reporting.rounding import NOISE, OUTPUT_SI
from imubayes.study import StudyResult

Variable = tuple[str, tuple[str, ...], Any, str, dict[str, Any]]
"""End of the name, dimensions (a component's own begin with an underscore), values, what they are, others."""

POSTERIOR = "posterior.nc"
"""Name of the file."""

DRAWN = ("chain", "draw")

SUFFIXES = (
    "", "_term", "_unit", "_full", "_column", "_column_unit", "_noise", "_run", "_noise_unit", "_lp",
    "_dwell", "_dwell_run", "_dwell_start", "_dwell_stop",
)  # fmt: skip
"""What follows a component's name in the names of its variables and coordinates."""

LARGEST = 16_000_000
"""bytes of all draws, about: a file that can be sent around."""

RESERVED = ("chain", "draw", "noise")
"""Dimensions that all components share."""


def write_posterior(result: StudyResult, folder: Path) -> Path:
    """Write the draws of every component to the file ``posterior.nc`` of a folder, where it replaces another.

    Components with different numbers of chains or draws are cut to the smallest: chains from the first,
    draws evenly over each chain. Exact draws are independent and are dealt out to the chains in their order.
    A study of so many components that their draws would take more than `LARGEST` keeps fewer of each.
    """
    # a report is written without it; xarray takes as long to import, and h5netcdf to write six times as long
    from h5py import File

    with File(path := folder / POSTERIOR, "w", track_order=True) as file:
        for name, group in posterior_groups(result):
            _write(file.create_group(name, track_order=True), *group)
    return path


Dataset = tuple[dict[str, Any], dict[str, Any], dict[str, str]]
"""Variables and coordinates as xarray's `Dataset` takes them, and what is said of the whole."""


def _write(group: Any, variables: dict[str, Any], coordinates: dict[str, Any], about: dict[str, str]) -> None:
    """Write variables and coordinates; a variable names those beside its dimensions, as CF has it.

    A dimension is the HDF5 scale of its coordinate, which netCDF asks for and every dimension has.
    """
    from h5py import string_dtype

    given = {key: own if isinstance(own, tuple) else (key, own) for key, own in coordinates.items()}
    beside = {key: own[0] for key, own in given.items() if own[0] != key}
    group.attrs.update(about)
    for key, (named, values, *told) in {**given, **variables}.items():
        dims, array = (named,) if isinstance(named, str) else named, np.asarray(values)
        kind = string_dtype() if array.dtype.kind == "U" else array.dtype
        made = group.create_dataset(key, data=array.astype(kind, copy=False), dtype=kind)
        if dims == (key,):
            made.make_scale(key)
        for axis, dim in enumerate(() if dims == (key,) else dims):
            made.dims[axis].attach_scale(group[dim])
        along = [name for name, dim in beside.items() if dim in dims]
        made.attrs.update(told[0] if told else {})
        if key in variables and along:
            made.attrs["coordinates"] = " ".join(along)


def posterior_groups(result: StudyResult) -> Iterator[tuple[str, Dataset]]:
    """Each group, and the draws of every component there."""
    sampled = any(sensor.chains is not None for sensor in result.sensors)
    for group in ("posterior", "prior", *(_OF_CHAINS if sampled else ())):
        layout, variables, coordinates = _layout(result, group), dict[str, Any](), dict[str, Any]()
        for name, sensor in zip(variable_names(result), result.sensors, strict=True):
            along: set[str] = set()
            for suffix, dims, values, what, more in _variables(group, sensor, layout):
                dims = tuple(f"{name}{dim}" if dim.startswith("_") else dim for dim in dims)
                about = {"long_name": f"{what}: {sensor.id}", "sensor": sensor.id, "kind": sensor.kind}
                variables[name + suffix] = dims, values, about | more
                along.update(dims)
            coordinates |= _coordinates(name, sensor, along)
        if group != "observed_data":
            coordinates |= {dim: np.arange(n) for dim, n in zip(DRAWN, layout, strict=True)}
        about = {"inference_library": "imubayes", "inference_library_version": imubayes.__version__}
        yield group, (variables, coordinates, about)


def written_draws(result: StudyResult) -> int:
    """Count the posterior draws that the file holds of every component."""
    return math.prod(_layout(result, "posterior"))


def _layout(result: StudyResult, group: str) -> tuple[int, int]:
    """Chains and draws that every component has, so few that all variables together stay small."""
    sensors, sampled = result.sensors, [sensor.chains for sensor in result.sensors if sensor.chains]
    values = 2 * sum(len(sensor.selection.terms) for sensor in sensors)
    values += 2 * sum(len(chains.names) + 3 * len(chains.runs) + len(chains.dwells) for chains in sampled)
    most = LARGEST // (8 * values)
    if group == "prior":
        lengths = [length for drawn in sampled for length in (len(drawn.prior_theta), len(drawn.prior_noise))]
        return 1, min(most, *lengths, *(len(sensor.prior_draws) for sensor in sensors))
    chains = min((drawn.theta.shape[0] for drawn in sampled), default=1)
    lengths = [drawn.theta.shape[1] for drawn in sampled]
    lengths += [len(sensor.draws) // chains for sensor in sensors]
    return chains, min(most // chains, *lengths)


_OF_CHAINS = ("sample_stats", "log_likelihood", "posterior_predictive", "observed_data")
"""Groups that components with chains alone have."""


def _variables(group: str, sensor: SensorResult, layout: tuple[int, int]) -> Iterator[Variable]:
    chains, (n, m) = sensor.chains, layout
    if group in _OF_CHAINS:
        if chains:
            yield _of_chains(group, sensor, chains, layout)
        return
    if group == "posterior":
        averaged = sensor.draws[: n * m].reshape(n, m, -1)
        full = chains and (_thinned(chains.theta, layout), _thinned(chains.noise, layout))
    else:
        averaged = sensor.prior_draws[np.newaxis, :m]
        full = chains and (chains.prior_theta[np.newaxis, :m], chains.prior_noise[np.newaxis, :m])
    units = _units((term.name, term.unit) for term in sensor.selection.terms)
    yield "", (*DRAWN, "_term"), averaged, "coefficients, averaged over the models", units
    if chains and full:
        what = "coefficients under the full library, and what else moves the output"
        units = _units(zip(chains.names, chains.units, strict=True))
        yield "_full", (*DRAWN, "_column"), full[0], what, units
        units = _units((name, NOISE[sensor.kind][name][1]) for name in "NBK")
        yield "_noise", (*DRAWN, "_run", "noise"), full[1], "noise N, B, K by run", units


def _units(named: Iterable[tuple[str, str]]) -> dict[str, str]:
    return {"units": ", ".join(f"{name}: {unit}" for name, unit in named)}


def _of_chains(group: str, sensor: SensorResult, chains: Chains, layout: tuple[int, int]) -> Variable:
    output, by_dwell = {"units": OUTPUT_SI[sensor.kind]}, (*DRAWN, "_dwell")
    if group == "sample_stats":
        mixing = chains.diagnostics
        about = {
            "sampler": chains.sampler,
            "acceptance": mixing.acceptance,
            "converged": int(mixing.converged),
        }
        about |= {name: getattr(mixing, name) for name in ("walkers", "steps", "text")}
        return "_lp", DRAWN, _thinned(chains.log_density, layout), "log of the posterior density", about
    if group == "log_likelihood":
        what = "log likelihood of each dwell, given those before it in its run"
        return "", by_dwell, _thinned(chains.log_likelihood, layout), what, {}
    if group == "posterior_predictive":
        what = "mean output minus input of each dwell by the model, without noise"
        return "", by_dwell, _thinned(chains.predicted, layout), what, output
    return "", ("_dwell",), chains.observed, "mean output minus input of each dwell", output


def _thinned(values: FloatArray, layout: tuple[int, int]) -> FloatArray:
    """Draws evenly over each chain, first to last; no copy where all are kept."""
    if layout[1] == values.shape[1]:
        return values[: layout[0]]
    kept = np.linspace(0, values.shape[1] - 1, layout[1]).round().astype(np.int64)
    return values[: layout[0], kept]


def _coordinates(name: str, sensor: SensorResult, dimensions: set[str]) -> dict[str, Any]:
    """Labels and units along the dimensions that a group uses of a component."""
    terms, chains = sensor.selection.terms, sensor.chains
    labels: dict[str, Any] = {
        f"{name}_term": [term.name for term in terms],
        f"{name}_unit": (f"{name}_term", [term.unit for term in terms]),
    }
    if chains:
        dwell = f"{name}_dwell"
        run, start, stop = zip(*chains.dwells, strict=True) if chains.dwells else ((), (), ())
        labels |= {
            f"{name}_column": list(chains.names),
            f"{name}_column_unit": (f"{name}_column", list(chains.units)),
            f"{name}_run": list(chains.runs),
            "noise": list("NBK"),
            f"{name}_noise_unit": ("noise", [NOISE[sensor.kind][name][1] for name in "NBK"]),
            dwell: np.arange(len(chains.dwells)),
            f"{dwell}_run": (dwell, list(run)),
            f"{dwell}_start": (dwell, np.array(start, dtype=float), {"units": "s"}),
            f"{dwell}_stop": (dwell, np.array(stop, dtype=float), {"units": "s"}),
        }
    return {
        key: value
        for key, value in labels.items()
        if (value[0] if isinstance(value, tuple) else key) in dimensions
    }


def variable_names(result: StudyResult) -> tuple[str, ...]:
    """Name of each component's variable in the file: its id, made safe and unique."""
    taken, names = set(RESERVED), []
    for sensor in result.sensors:
        name = re.sub(r"\W", "_", sensor.id, flags=re.ASCII) or "sensor"
        tries = chain((name,), (f"{name}_{k}" for k in count(2)))
        free = next(f for f in tries if taken.isdisjoint(f + suffix for suffix in SUFFIXES))
        taken |= {free + suffix for suffix in SUFFIXES}
        names.append(free)
    return tuple(names)
