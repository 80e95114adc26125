"""From runs to one triangular factor: noise, whitening, and the only step that costs O(n)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imubayes import factor as algebra
from imubayes.errors import StudyError, UnobservableError
from imubayes.factor import Factor, LeastSquares
from imubayes.rig.inputs import UNKNOWN, Facts, Run, Source, durations, facts_of
from imubayes.sensors.catalogue import SensorClass, noise_prior
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, columns

if TYPE_CHECKING:
    from imubayes.inference.reml import Blocks

FloatArray = NDArray[np.float64]
Rules = Mapping[str, NoiseRule]

CHUNK = 200_000
"""Rows whose columns are held at a time while blocks are averaged or residuals taken."""


@dataclass(frozen=True, slots=True, eq=False)
class RunSummary:
    """What a run was, and its noise.

    Attributes
    ----------
    name, procedure : of the run.
    samples : rows.
    duration : s, first to last sample.
    interval : averaging time of a sample, s.
    noise : the noise that whitens the run, SI.
    noise_sd : sd of ln N, ln B, ln K (posterior of REML with the class's prior); 0 where it was given.
    noise_prior : (median, sd of the logarithm) of N, B, K under the class; empty without a class.
    noise_origin : ``REML``, ``white``, ``given`` or ``run <name>``.
    ranges : (smallest, largest) of each excited channel and of ``output``, SI.
    source : file, columns, notes.
    factor : of the run's whitened rows.
    reach : (p,) largest size of each column, SI.
    stills : (start, stop) in s of each still that a free tumble uses; empty otherwise.
    """

    name: str
    procedure: str
    samples: int
    duration: float
    interval: float
    noise: Noise
    noise_sd: tuple[float, float, float]
    noise_prior: tuple[tuple[float, float], ...]
    noise_origin: str
    ranges: dict[str, tuple[float, float]]
    source: Source
    factor: Factor
    reach: FloatArray
    stills: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """All that the runs say of a linear Gaussian model.

    Attributes
    ----------
    factor : of all whitened rows.
    runs : each run's noise and own factor; empty for arrays from elsewhere.
    library : candidate terms of the component; None for arrays from elsewhere.
    facts : what the inputs of the runs have in common.
    reach : largest size of each term's column over the runs, SI.
    """

    factor: Factor
    runs: tuple[RunSummary, ...] = ()
    library: Library | None = None
    facts: Facts = UNKNOWN
    reach: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return self.factor.names

    @classmethod
    def from_arrays(cls, X: ArrayLike, y: ArrayLike, names: Sequence[str]) -> Summary:
        """Summary of arrays that came from elsewhere, with white noise of unknown scale.

        Parameters
        ----------
        X : (n, p) regressors; a constant is a column like any other.
        y : (n,) response.
        names : p names.

        Raises
        ------
        UnobservableError : if the shapes do not agree or a value is not finite.

        Examples
        --------
        >>> s = Summary.from_arrays([[1.0], [1.0], [1.0]], [1.0, 2.0, 6.0], ("mean",))
        >>> s.least_squares().mean.tolist(), s.least_squares().dof
        ([3.0], 2)
        """
        rows, response = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
        if rows.ndim != 2 or response.shape != rows.shape[:1] or rows.shape[1] != len(names):
            raise UnobservableError(
                f"X must be (n, p), y (n,) and names p long: got {rows.shape}, {response.shape} and"
                f" {len(names)}"
            )
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(response))):
            raise UnobservableError("X and y must be finite: take out or mend the rows that are not")
        return cls(algebra.factor_of(rows, response, tuple(names)))

    def least_squares(self) -> LeastSquares:
        """Ordinary (whitened) least squares over all terms."""
        return algebra.least_squares(self.factor)


def summarize(
    runs: Sequence[Run], lib: Library, *, sensor: SensorClass | None = None, rules: Rules | None = None
) -> Summary:
    """Noise, whitening and factor of runs with known inputs.

    Parameters
    ----------
    runs : of one component.
    lib : candidate terms.
    sensor : class whose noise prior steers the estimate; None takes a vague one.
    rules : how the noise is known, by run; a run that is not named is estimated.

    Raises
    ------
    UnobservableError : if the runs have fewer rows than the terms that they excite.
    StudyError : if a rule takes the noise from a run that is not there.
    """
    _check_rows(runs, lib)
    rules = rules or {}
    done: dict[str, RunSummary] = {}
    for run in sorted(runs, key=lambda run: rules.get(run.name, NoiseRule()).like is not None):
        done[run.name] = _summarize_run(run, lib, sensor, rules.get(run.name, NoiseRule()), done)
    summaries = tuple(done[run.name] for run in runs)
    reach = np.max([s.reach for s in summaries], axis=0)
    return Summary(
        factor=reduce(algebra.add, (s.factor for s in summaries)),
        runs=summaries,
        library=lib,
        facts=facts_of([run.inputs.channels for run in runs], lib.kind),
        reach=dict(zip(lib.names, reach.tolist(), strict=True)),
    )


def blocks_of(run: Run, lib: Library) -> Blocks:
    """Averages of a run over short blocks; columns are made a part of the run at a time."""
    from imubayes.inference.reml import Blocks, block_edges
    from imubayes.inference.whiten import Rows

    t, n = run.inputs.t, len(run.inputs)
    edges = block_edges(t, run.inputs.interval)
    counts = np.diff(np.append(edges, n))
    lasting = np.add.reduceat(durations(t, run.inputs.interval), edges)
    X = np.empty((len(edges), len(lib.terms)))
    per_part = max(1, CHUNK // int(counts.max()))
    for first in range(0, len(edges), per_part):
        inside = slice(first, min(first + per_part, len(edges)))
        a, b = int(edges[first]), int(edges[inside.stop]) if inside.stop < len(edges) else n
        X[inside] = np.add.reduceat(library_rows(run, lib, a, b), edges[inside] - a, axis=0)
    X /= counts[:, None]
    y = np.add.reduceat(deviation(run, lib), edges) / counts
    rows = Rows(np.add.reduceat(t, edges) / counts, lasting)
    return Blocks(rows, X, y)


def library_rows(run: Run, lib: Library, start: int = 0, stop: int | None = None) -> FloatArray:
    """Columns of the library for a part of a run: (rows, p)."""
    part = {name: values[start:stop] for name, values in run.inputs.channels.items()}
    return columns(lib, part, len(run.inputs.t[start:stop]))


def deviation(run: Run, lib: Library) -> FloatArray:
    """Output minus own input, (n,), SI."""
    return run.output - run.inputs.channels.get(lib.own, 0.0)


def _summarize_run(
    run: Run, lib: Library, sensor: SensorClass | None, rule: NoiseRule, done: Mapping[str, RunSummary]
) -> RunSummary:
    noise, sd, prior, origin = _noise(run, lib, sensor, rule, done)
    made, noise, reach = _whitened_factor(run, lib, noise, unknown_scale=rule.rule == "white")
    channels = {**run.inputs.channels, "output": run.output}
    return RunSummary(
        name=run.name,
        procedure=run.procedure,
        samples=len(run.inputs),
        duration=float(run.inputs.t[-1] - run.inputs.t[0]),
        interval=run.inputs.interval,
        noise=noise,
        noise_sd=sd,
        noise_prior=prior,
        noise_origin=origin,
        ranges={name: (float(v.min()), float(v.max())) for name, v in channels.items()},
        source=run.source,
        factor=made,
        reach=reach,
    )


def _noise(
    run: Run, lib: Library, sensor: SensorClass | None, rule: NoiseRule, done: Mapping[str, RunSummary]
) -> tuple[Noise, tuple[float, float, float], tuple[tuple[float, float], ...], str]:
    """Noise of a run by its rule: (noise, sd of the logarithms, class's prior, origin)."""
    from imubayes.inference.reml import estimate

    none, prior = (0.0, 0.0, 0.0), noise_prior(sensor) if sensor else None
    if rule.rule == "white":
        return Noise(1.0, 0.0, 0.0), none, prior or (), "white"
    if rule.rule == "fixed" and rule.value is not None:
        return rule.value, none, prior or (), "given"
    if rule.like is not None:
        if rule.like not in done:
            raise StudyError(
                f"run '{run.name}' takes its noise from run '{rule.like}', which the sensor does not have"
            )
        return done[rule.like].noise, done[rule.like].noise_sd, prior or (), f"run {rule.like}"
    found = estimate(blocks_of(run, lib), prior)
    return found.noise, found.sd, prior or (), "REML"


def _whitened_factor(
    run: Run, lib: Library, noise: Noise, *, unknown_scale: bool
) -> tuple[Factor, Noise, FloatArray]:
    """Factor of a run's whitened rows, its noise, and the reach of its columns.

    With an unknown scale the rows are scaled to unit residuals, and the noise with them.
    """
    from imubayes.inference.whiten import Rows, whiten, whitener

    n, p = len(run.inputs), len(lib.terms)
    rows = np.empty((n, p + 1))
    columns(lib, run.inputs.channels, n, out=rows[:, :p])
    rows[:, p] = deviation(run, lib)
    parts = tuple(algebra.row_blocks(n))
    reach = np.max([np.abs(rows[i:j, :p]).max(axis=0) for i, j in parts], axis=0)
    w = whitener(noise, Rows(run.inputs.t, durations(run.inputs.t, run.inputs.interval)))
    whiten(w, rows)
    R = algebra.triangular((rows[i:j] for i, j in parts), p + 1)
    made = Factor(lib.names, R, n, w.log_det)
    return (*(_to_unit_residuals(made, noise) if unknown_scale else (made, noise)), reach)


def _to_unit_residuals(f: Factor, noise: Noise) -> tuple[Factor, Noise]:
    from imubayes.inference.reml import span

    basis, z = span(f.R[:, :-1]), f.R[:, -1]
    dof = f.n - basis.shape[1]
    if dof < 1:
        raise UnobservableError(
            f"{f.n} rows leave nothing to judge white noise by beside {basis.shape[1]} combinations of terms:"
            " record more, give the noise, or choose a smaller library",
            f.names,
        )
    scale = float(np.linalg.norm(z - basis @ (basis.T @ z))) / np.sqrt(dof)
    scale = scale if scale > 0.0 else 1.0
    scaled = replace(f, R=f.R / scale, log_det=f.log_det + 2.0 * f.n * float(np.log(scale)))
    return scaled, Noise(noise.N * scale, 0.0, 0.0)


def _check_rows(runs: Sequence[Run], lib: Library) -> None:
    rows = sum(len(run.inputs) for run in runs)
    excited = {name for run in runs for name in run.inputs.channels}
    tested = tuple(t.name for t in lib.terms if all(f.channel in excited for f in t.factors))
    if rows <= len(tested):
        raise UnobservableError(
            f"{rows} rows in {len(runs)} runs are too few for {len(tested)} terms: record more, or choose a"
            " smaller library (powers, asymmetry)",
            tested,
        )
