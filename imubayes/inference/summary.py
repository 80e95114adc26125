"""From runs to one triangular factor: noise, whitening, and the only step that costs O(n)."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from imubayes.algebra import FloatArray
from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import (
    FAINT,
    Factor,
    LeastSquares,
    invert_triangular,
    noise_scale,
    posterior_root,
    with_prior_rows,
)
from imubayes.errors import InputError, StudyError, TermError, UnobservableError
from imubayes.inference.dwells import always, stacked, whitened_factor
from imubayes.inference.linear import Extra, Linear, linear_of, reach_of, with_columns
from imubayes.inference.noise_model import (
    NoiseEstimate,
    estimate,
    hides_white,
    noise_blocks,
    noise_rows,
    scatter,
    span,
)
from imubayes.rig.inputs import UNKNOWN, Facts, Run, Source, facts_of
from imubayes.sensors.catalogue import SensorClass, typical_noise
from imubayes.sensors.noise import Noise, NoiseRule, noise_prior
from imubayes.sensors.terms import Library
from imubayes.units import counted

Rules = Mapping[str, NoiseRule]

VAGUE = math.log(30.0)
"""Sd of the logarithm of a white noise of which nothing is known: a factor of 30 either way."""


@dataclass(frozen=True, slots=True, eq=False)
class RunSummary:
    """What a run was, and its noise.

    Attributes
    ----------
    name, procedure : of the run.
    samples : rows.
    duration : s, first to last sample.
    interval : averaging time of a sample, s.
    found : the noise that whitens the run, and how it came about.
    ranges : (smallest, largest) of each excited channel and of ``output``, SI.
    source : file, columns, notes.
    factor : of the run's whitened rows.
    reach : (p,) largest size of each column, SI.
    stills : (start, stop) in s of each still that a free tumble uses; empty otherwise.
    sampling : s, of the record whose averages the rows are; 0 where the rows are its samples.
    """

    name: str
    procedure: str
    samples: int
    duration: float
    interval: float
    found: NoiseEstimate
    ranges: dict[str, tuple[float, float]]
    source: Source
    factor: Factor
    reach: FloatArray
    stills: tuple[tuple[float, float], ...] = ()
    sampling: float = 0.0

    @property
    def noise(self) -> Noise:
        """The noise that whitens the run, SI."""
        return self.found.noise

    @property
    def noise_run(self) -> str:
        """The run whose noise it is: another one where the origin says so."""
        return self.found.run or self.name


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
    extras : columns of the factor beyond the terms, which come after them.
    """

    factor: Factor
    runs: tuple[RunSummary, ...] = ()
    library: Library | None = None
    facts: Facts = UNKNOWN
    reach: Mapping[str, float] = field(default_factory=dict)
    extras: tuple[Extra, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return self.factor.names

    @property
    def candidates(self) -> Library:
        """Candidate terms of the component; a `TermError` for arrays from elsewhere."""
        if self.library is None:
            raise TermError("a summary of plain arrays has no library: give the library of its columns")
        return self.library

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
        InputError : if a name is there twice, or the numbers are complex or masked.

        Examples
        --------
        >>> s = Summary.from_arrays([[1.0], [1.0], [1.0]], [1.0, 2.0, 6.0], ("mean",))
        >>> s.least_squares().mean.tolist(), s.least_squares().dof
        ([3.0], 2)
        """
        for name, values in (("X", X), ("y", y)):
            if np.ma.isMaskedArray(values) or np.iscomplexobj(values):
                raise InputError(
                    f"{name}: expected plain real numbers, got masked or complex ones: leave out the rows"
                    " that are masked, and give real and imaginary parts as rows of their own"
                )
        rows, response = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
        if rows.ndim != 2 or response.shape != rows.shape[:1] or rows.shape[1] != len(names):
            raise UnobservableError(
                f"X must be (n, p), y (n,) and names p long: got {rows.shape}, {response.shape} and"
                f" {len(names)}"
            )
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(response))):
            raise UnobservableError("X and y must be finite: take out or mend the rows that are not")
        check_names(names)
        return cls(algebra.factor_of(rows, response, tuple(names)))

    def least_squares(self) -> LeastSquares:
        """Ordinary (whitened) least squares over all terms."""
        return algebra.least_squares(self.factor)


def check_names(names: Sequence[str]) -> None:
    """Refuse a name that two columns share: whatever is asked of it would be told of the first alone.

    Raises
    ------
    InputError : naming it.
    """
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(
                f"names: '{name}' is there twice, in columns {names.index(name)} and {k}: expected a name of"
                " its own for each column; rename one, or leave one out"
            )


def summarize(
    runs: Sequence[Run],
    lib: Library,
    *,
    sensor: SensorClass | None = None,
    rules: Rules | None = None,
    rows: Sequence[Linear] = (),
    extras: tuple[Extra, ...] = (),
    known: Sequence[NoiseEstimate] = (),
    bench: Mapping[str, float] | None = None,
) -> Summary:
    """Noise, whitening and factor of runs with known inputs.

    Parameters
    ----------
    runs : of one component.
    lib : candidate terms.
    sensor : class whose noise prior steers the estimate; None takes a vague one.
    rules : how the noise is known, by run; a run that is not named is estimated.
    rows : of each run, where they have further columns than the library's.
    extras : those columns.
    known : noise of each run where it was judged before; the scale of white noise follows from the residuals.
    bench : prior sds, SI, of columns that are errors of the bench, by name; those of the extras by default.

    Raises
    ------
    UnobservableError : if the runs have fewer rows than the terms that they excite.
    StudyError : if a rule takes the noise from a run that is not there.
    """
    excited = {name for run in runs for name in run.inputs.channels}
    tested = tuple(t.name for t in lib.terms if all(f.channel in excited for f in t.factors))
    if (count := sum(run.samples for run in runs)) <= len(tested):
        raise UnobservableError(
            f"{count} rows in {counted(len(runs), 'run')} are too few for {len(tested)} terms: record more,"
            " or choose a smaller library (powers, asymmetry)",
            tested,
        )
    rules, bench = rules or {}, bench or {extra.name: extra.sd for extra in extras}
    linear = {part.name: part for part in rows or [linear_of(run, lib) for run in runs]}
    judged = dict(zip(linear, known, strict=False))
    done: dict[str, RunSummary] = {}
    for run in sorted(runs, key=lambda run: rules.get(run.name, NoiseRule()).like is not None):
        part, rule = linear[run.name], rules.get(run.name, NoiseRule())
        found = judged.get(run.name) or _noise(part, sensor, rule, done, bench)
        done[run.name] = _summarize_run(run, part, found, sharp=not extras)
    facts = facts_of([run.extremes for run in runs], lib.kind)
    return joined([done[run.name] for run in runs], lib, facts, extras)


def joined(runs: Sequence[RunSummary], library: Library, facts: Facts, extras: tuple[Extra, ...]) -> Summary:
    """All that runs say, whose factors have the same columns."""
    reach, factors = np.max([run.reach for run in runs], axis=0), [run.factor for run in runs]
    return Summary(
        # errors of the bench have a prior, which holds columns apart
        factor=stacked([always(f) for f in factors]) if extras else algebra.add(*factors),
        runs=tuple(runs),
        library=library,
        facts=facts,
        reach=dict(zip(runs[0].factor.names, reach.tolist(), strict=True)),
        extras=extras,
    )


def run_summary(
    rows: Linear,
    found: NoiseEstimate,
    source: Source,
    ranges: dict[str, tuple[float, float]],
    *,
    sharp: bool = False,
) -> RunSummary:
    """Summary of rows of a run, or of a part of it, whose noise is known; `sharp` as in `whitened_factor`.

    The rows are taken for samples, which last from the first to the last.
    """
    made, reach = whitened_factor(rows, found.noise, sharp=sharp), reach_of(rows)
    return RunSummary(
        name=rows.name,
        procedure=rows.procedure,
        samples=rows.samples,
        duration=float(rows.t[-1] - rows.t[0]),
        interval=rows.sampling,
        found=found,
        ranges=ranges,
        source=source,
        factor=made,
        reach=reach,
    )


def _summarize_run(run: Run, rows: Linear, found: NoiseEstimate, *, sharp: bool) -> RunSummary:
    white = found.origin == "white"
    unit = replace(found, noise=Noise(1.0, 0.0, 0.0)) if white else found
    ranges = {name: (float(v.min()), float(v.max())) for name, v in run.extremes.items()}
    sampling = run.inputs.sampling
    made = replace(
        run_summary(rows, unit, run.source, ranges, sharp=sharp),
        samples=round(float(rows.duration.sum()) / sampling) if sampling else run.samples,
        duration=float(run.inputs.t[-1] - run.inputs.t[0]),
        sampling=sampling,
    )
    if not white:
        return made
    factor, noise = _to_unit_residuals(made.factor, unit.noise)
    return replace(made, factor=factor, found=replace(found, noise=noise, steering={"N": (noise.N, VAGUE)}))


def noise_by_rule(
    averages: Linear, rule: NoiseRule, sensor: SensorClass | None, sd: FloatArray | None = None
) -> NoiseEstimate:
    """Noise of a run as its rule says: given, or estimated, of which white noise is the part N.

    Of an output that never moves it is the class's typical one. `averages` and `sd` are as
    `noise_model.estimate` takes them; the noise prior of the class steers the estimate.
    """
    prior = noise_prior(sensor) if sensor else {}
    if rule.value is not None:
        return NoiseEstimate(rule.value, prior=prior, origin="given")
    if sensor and np.ptp(averages.y) == 0.0:  # steps too coarse for the output to move
        return NoiseEstimate(typical_noise(sensor), prior=prior, origin="class")
    found = estimate(averages, prior, sd)
    if rule.rule == "white":
        return NoiseEstimate(Noise(found.noise.N, 0.0, 0.0), prior=found.prior, origin="white")
    return found


def _noise(
    rows: Linear,
    sensor: SensorClass | None,
    rule: NoiseRule,
    done: Mapping[str, RunSummary],
    bench: Mapping[str, float],
) -> NoiseEstimate:
    """Noise of a run with known inputs by its rule; white noise is scaled by what the fit leaves."""
    prior = noise_prior(sensor) if sensor else {}
    if rule.rule == "white":
        return NoiseEstimate(Noise(1.0, 0.0, 0.0), prior=prior, origin="white")
    if rule.like is None:
        found = noise_by_rule(blocks := noticed(noise_blocks(rows), bench), rule, sensor)
        if found.origin == "REML" and hides_white(blocks, found.noise):
            return noise_by_rule(noticed(noise_rows(rows)[0], bench), rule, sensor)
        return found
    if rule.like not in done:
        raise StudyError(
            f"run '{rows.name}' takes its noise from run '{rule.like}', which the sensor does not have"
        )
    return replace(done[rule.like].found, prior=prior, origin=f"run {rule.like}", run=rule.like)


def noticed(rows: Linear, sds: Mapping[str, float], least: float = FAINT) -> Linear:
    """Rows without columns that do less than the `least`, in sds of the noise, at these prior sds.

    They are rounding, as of a mount that turns about the input axis, or next to nothing, and least squares
    would take out a direction for each.
    """
    if sds.keys().isdisjoint(rows.names):
        return rows
    X, basis = rows.X, span(rows.X)
    # of what all columns leave: where each row is at another input, that is no noise
    level = least * scatter(rows.y - basis @ (basis.T @ rows.y), rows.duration)
    size = np.linalg.norm(X * np.sqrt(rows.duration)[:, None], axis=0).tolist()
    idle = [name in sds and sds[name] * one <= level for name, one in zip(rows.names, size, strict=True)]
    return with_columns(rows, np.where(idle, 0.0, X)) if any(idle) else rows


def rules_among(rules: Rules, names: Collection[str]) -> dict[str, NoiseRule]:
    """Rules of some runs: one whose noise was to be that of a run which is not among them has its own."""
    return {name: rule if (rule.like or name) in names else NoiseRule() for name, rule in rules.items()}


def _to_unit_residuals(f: Factor, noise: Noise) -> tuple[Factor, Noise]:
    basis, z = span(f.R[:, :-1]), f.R[:, -1]
    dof = f.n - basis.shape[1]
    if dof < 1:
        raise UnobservableError(
            f"{f.n} rows leave nothing to judge white noise by beside {basis.shape[1]} combinations of terms:"
            " record more, give the noise, or choose a smaller library",
            f.names,
        )
    scale = float(np.linalg.norm(z - basis @ (basis.T @ z))) / math.sqrt(dof) or 1.0
    scaled = replace(f, R=f.R / scale, rest=f.rest / scale, log_det=f.log_det + 2.0 * f.n * math.log(scale))
    return scaled, Noise(noise.N * scale, 0.0, 0.0)


def correlation(f: Factor, sd: FloatArray, names: Sequence[str]) -> FloatArray:
    """Correlation (q, q) of the q named coefficients under a normal prior, sds (p,), in units of the noise.

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros(2), ("a", "b"))
    >>> correlation(f, np.full(2, 1e9), ("a", "b")).round(3).tolist()
    [[1.0, -0.707], [-0.707, 1.0]]
    """
    rows = invert_triangular(with_prior_rows(f.R, 1.0 / sd)[:-1, :-1])
    rows = rows[[f.names.index(name) for name in names]]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return rows @ rows.T


def pulls(f: Factor, sd: FloatArray, names: Sequence[str]) -> Mapping[str, FloatArray]:
    """What each column's coefficient does to the q named ones, for one of its prior sds (p,).

    With the posterior's covariance C, the posterior mean of j takes over ``-C_jk / sd_k^2`` of coefficient k.

    Returns
    -------
    by column, ``C_jk / sd_k`` (q,), in the coefficients' units.

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.ones((4, 2)), np.array([1.0, -1.0, 1.0, -1.0]), ("a", "b"))
    >>> {name: pull.round(2).tolist() for name, pull in pulls(f, np.array([3.0, 1.0]), ("a",)).items()}
    {'a': [0.39], 'b': [-0.87]}
    """
    _, root = posterior_root(f, sd, noise_scale(f, sd))
    rows = root[[f.names.index(name) for name in names]]
    return dict(zip(f.names, (rows @ root.T / sd).T, strict=True))
