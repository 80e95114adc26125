"""The posterior in ArviZ's netCDF layout, for both lines of ArviZ; written by xarray alone.

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

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import imubayes
from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.rounding import NOISE_SI, OUTPUT_SI

if TYPE_CHECKING:
    import xarray

    from imubayes.campaign.study import SensorResult, StudyResult
    from imubayes.inference.mcmc.chains import Chains

Variable = tuple[tuple[str, ...], Any, dict[str, Any]]
"""Dimensions, values and attributes, as xarray takes them."""

SUFFIXES = (
    "", "_term", "_unit", "_full", "_column", "_column_unit", "_noise", "_run", "_noise_unit", "_lp",
    "_dwell", "_dwell_run", "_dwell_start", "_dwell_stop",
)  # fmt: skip
"""What follows a component's name in the names of its variables and coordinates."""

LARGEST = 16_000_000
"""bytes of all draws, about: a file that can be sent around."""

RESERVED = ("chain", "draw", "noise")
"""Dimensions that all components share."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """How many chains and draws a group's variables have."""

    chains: int
    draws: int


def write_posterior(result: StudyResult, path: Path) -> None:
    """Write the draws of every component.

    Parameters
    ----------
    path : file to write; replaced where it exists.

    Notes
    -----
    Components with different numbers of chains or draws are cut to the smallest: chains from the first,
    draws evenly over each chain. Exact draws are independent and are dealt out to the chains in their order.
    A study of so many components that their draws would take more than `LARGEST` keeps fewer of each.
    """
    from xarray import DataTree

    sampled = any(sensor.chains is not None for sensor in result.sensors)
    names = ("posterior", "prior", *(_OF_CHAINS if sampled else ()))
    groups = {f"/{group}": _dataset(result, group) for group in names}
    DataTree.from_dict(groups).to_netcdf(path, mode="w", engine="h5netcdf")


def _dataset(result: StudyResult, group: str) -> xarray.Dataset:
    from xarray import Dataset

    layout = _prior_layout(result) if group == "prior" else _layout(result)
    variables: dict[str, Variable] = {}
    coordinates: dict[str, Any] = {}
    for name, sensor in zip(variable_names(result), result.sensors, strict=True):
        found = dict(_VARIABLES[group](name, sensor, layout))
        variables |= found
        coordinates |= _coordinates(name, sensor, {d for dims, _, _ in found.values() for d in dims})
    if group != "observed_data":
        coordinates |= {"chain": np.arange(layout.chains), "draw": np.arange(layout.draws)}
    about = {"inference_library": "imubayes", "inference_library_version": imubayes.__version__}
    return Dataset(variables, coordinates, about)


def written_draws(result: StudyResult) -> int:
    """Count the posterior draws that the file holds of every component."""
    layout = _layout(result)
    return layout.chains * layout.draws


def _layout(result: StudyResult) -> _Layout:
    sampled = [sensor.chains.theta.shape for sensor in result.sensors if sensor.chains]
    chains = min((shape[0] for shape in sampled), default=1)
    lengths = [*(shape[1] for shape in sampled), *(len(sensor.draws) // chains for sensor in result.sensors)]
    return _Layout(chains, min(*lengths, _most_draws(result) // chains))


def _most_draws(result: StudyResult) -> int:
    """Draws of all variables together that stay below `LARGEST`, prior and posterior alike."""
    sensors, sampled = result.sensors, [sensor.chains for sensor in result.sensors if sensor.chains]
    values = 2 * sum(len(sensor.selection.terms) for sensor in sensors)
    values += 2 * sum(len(chains.names) + 3 * len(chains.runs) + len(chains.dwells) for chains in sampled)
    return LARGEST // (8 * values)


def _prior_layout(result: StudyResult) -> _Layout:
    sampled = [sensor.chains for sensor in result.sensors if sensor.chains]
    lengths = [
        *(len(sensor.prior_draws) for sensor in result.sensors),
        *(length for chains in sampled for length in (len(chains.prior_theta), len(chains.prior_noise))),
    ]
    return _Layout(1, min(*lengths, _most_draws(result)))


def _posterior(name: str, sensor: SensorResult, layout: _Layout) -> Iterator[tuple[str, Variable]]:
    averaged = sensor.draws[: layout.chains * layout.draws].reshape(layout.chains, layout.draws, -1)
    yield from _coefficients(name, sensor, averaged)
    if chains := sensor.chains:
        full, noise = _thinned(chains.theta, layout), _thinned(chains.noise, layout)
        yield from _full(name, sensor, chains, full, noise)


def _prior(name: str, sensor: SensorResult, layout: _Layout) -> Iterator[tuple[str, Variable]]:
    yield from _coefficients(name, sensor, sensor.prior_draws[np.newaxis, : layout.draws])
    if chains := sensor.chains:
        full, noise = chains.prior_theta[: layout.draws], chains.prior_noise[: layout.draws]
        yield from _full(name, sensor, chains, full[np.newaxis], noise[np.newaxis])


def _coefficients(name: str, sensor: SensorResult, draws: FloatArray) -> Iterator[tuple[str, Variable]]:
    about = _about(sensor, "coefficients, averaged over the models")
    about["units"] = ", ".join(f"{term.name}: {term.unit}" for term in sensor.selection.terms)
    yield name, (("chain", "draw", f"{name}_term"), draws, about)


def _full(
    name: str, sensor: SensorResult, chains: Chains, theta: FloatArray, noise: FloatArray
) -> Iterator[tuple[str, Variable]]:
    about = _about(sensor, "coefficients under the full library, and what else moves the output")
    about["units"] = ", ".join(f"{c}: {unit}" for c, unit in zip(chains.names, chains.units, strict=True))
    yield f"{name}_full", (("chain", "draw", f"{name}_column"), theta, about)
    about = _about(sensor, "noise N, B, K by run")
    about["units"] = ", ".join(f"{x}: {u}" for x, u in zip("NBK", NOISE_SI[sensor.kind], strict=True))
    yield f"{name}_noise", (("chain", "draw", f"{name}_run", "noise"), noise, about)


def _sample_stats(name: str, sensor: SensorResult, layout: _Layout) -> Iterator[tuple[str, Variable]]:
    if chains := sensor.chains:
        found = chains.diagnostics
        about = _about(sensor, "log of the posterior density") | {
            "sampler": chains.sampler,
            "acceptance": found.acceptance,
            "converged": int(found.converged),
            "walkers": found.walkers,
            "steps": found.steps,
            "text": found.text,
        }
        yield f"{name}_lp", (("chain", "draw"), _thinned(chains.log_density, layout), about)


def _log_likelihood(name: str, sensor: SensorResult, layout: _Layout) -> Iterator[tuple[str, Variable]]:
    if chains := sensor.chains:
        about = _about(sensor, "log likelihood of each dwell, given those before it in its run")
        values = _thinned(chains.log_likelihood, layout)
        yield name, (("chain", "draw", f"{name}_dwell"), values, about)


def _predictive(name: str, sensor: SensorResult, layout: _Layout) -> Iterator[tuple[str, Variable]]:
    if chains := sensor.chains:
        about = _about(sensor, "mean output minus input of each dwell by the model, without noise")
        about["units"] = OUTPUT_SI[sensor.kind]
        yield name, (("chain", "draw", f"{name}_dwell"), _thinned(chains.predicted, layout), about)


def _observed(name: str, sensor: SensorResult, _: _Layout) -> Iterator[tuple[str, Variable]]:
    if chains := sensor.chains:
        about = _about(sensor, "mean output minus input of each dwell") | {"units": OUTPUT_SI[sensor.kind]}
        yield name, ((f"{name}_dwell",), chains.observed, about)


_VARIABLES: dict[str, Callable[[str, SensorResult, _Layout], Iterator[tuple[str, Variable]]]] = {
    "posterior": _posterior,
    "prior": _prior,
    "sample_stats": _sample_stats,
    "log_likelihood": _log_likelihood,
    "posterior_predictive": _predictive,
    "observed_data": _observed,
}
_OF_CHAINS = tuple(group for group in _VARIABLES if group not in ("posterior", "prior"))


def _thinned(values: FloatArray, layout: _Layout) -> FloatArray:
    """Draws evenly over each chain, first to last."""
    kept = np.linspace(0, values.shape[1] - 1, layout.draws).round().astype(np.int64)
    return values[: layout.chains, kept]


def _about(sensor: SensorResult, what: str) -> dict[str, Any]:
    return {"long_name": f"{what}: {sensor.id}", "sensor": sensor.id, "kind": sensor.kind}


def _coordinates(name: str, sensor: SensorResult, dimensions: set[str]) -> dict[str, Any]:
    """Labels and units along the dimensions that a group uses of a component."""
    terms, chains = sensor.selection.terms, sensor.chains
    found: dict[str, Any] = {
        f"{name}_term": [term.name for term in terms],
        f"{name}_unit": (f"{name}_term", [term.unit for term in terms]),
    }
    if chains:
        dwell = f"{name}_dwell"
        run, start, stop = zip(*chains.dwells, strict=True) if chains.dwells else ((), (), ())
        found |= {
            f"{name}_column": list(chains.names),
            f"{name}_column_unit": (f"{name}_column", list(chains.units)),
            f"{name}_run": list(chains.runs),
            "noise": list("NBK"),
            f"{name}_noise_unit": ("noise", list(NOISE_SI[sensor.kind])),
            dwell: np.arange(len(chains.dwells)),
            f"{dwell}_run": (dwell, list(run)),
            f"{dwell}_start": (dwell, np.array(start, dtype=float), {"units": "s"}),
            f"{dwell}_stop": (dwell, np.array(stop, dtype=float), {"units": "s"}),
        }
    return {key: value for key, value in found.items() if _along(key, value) in dimensions}


def _along(key: str, value: Any) -> str:
    return value[0] if isinstance(value, tuple) else key


def variable_names(result: StudyResult) -> tuple[str, ...]:
    """Name of each component's variable in the file: its id, made safe and unique."""
    return tuple(
        _unique([re.sub(r"\W", "_", sensor.id, flags=re.ASCII) or "sensor" for sensor in result.sensors])
    )


def _unique(names: list[str]) -> Iterator[str]:
    taken = set(RESERVED)
    for name in names:
        tries = (name, *(f"{name}_{k}" for k in range(2, len(names) + len(RESERVED) + 2)))
        free = next(f for f in tries if taken.isdisjoint(f + suffix for suffix in SUFFIXES))
        taken |= {free + suffix for suffix in SUFFIXES}
        yield free
