"""Reference-free tumble: a triad in the hand, of which only |f| = g is known while it rests.

At rest the compensated output has the length g, so each still gives one equation. Linearised about the
current coefficients theta_0 it is a row of an ordinary linear model: with the compensated output f of the
still, ``F(f) = y``, its direction ``u = f/|f|`` and ``w = u' (I + M)^-1``::

    w . (y_t - y) + |f| - g + x theta_0 = x theta + w . noise_t,      x_(c,k) = w_c phi_k(f)

so that rows, noise, factor and selection are those of every other test. A rotation of the case axes leaves
all lengths alone; the gain matrix I + M is therefore taken upper triangular: the sensor's z axis is the
case's, and its y axis lies in the case's y-z plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.factor import Factor, add, row_blocks, solve_triangular, triangular, with_prior_rows
from imubayes.inference.prior import ScalePrior
from imubayes.inference.reml import Blocks, block_edges, estimate
from imubayes.inference.stills import find_stills
from imubayes.inference.summary import Rules, RunSummary, Summary
from imubayes.inference.whiten import Rows, whiten, whitener
from imubayes.rig.inputs import Facts, TriadRun
from imubayes.sensors.catalogue import SensorClass, noise_prior
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Library, columns

FloatArray = NDArray[np.float64]

COMPONENTS = ("ax", "ay", "az")

PERMUTATION = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Case axes of (i, j, k) of each component."""

BELOW_DIAGONAL = ((), ("m_k",), ("m_j", "m_k"))
"""Misalignments that the choice of the case axes sets to zero."""

FEWEST = 9
"""Stills below which bias, scale factor and non-orthogonality (9 parameters) are not determined."""

SETTLED = 1e-6
"""Change of a coefficient, in posterior sd, at which the linearisation has settled."""

ROUNDS = 50
"""Most relinearisations; three to six are usual."""

NOISE_ROUND = 2
"""Round from which the rows are good enough to judge the noise by."""


@dataclass(frozen=True, slots=True, eq=False)
class Triad:
    """Model of the three components at known coefficients.

    Attributes
    ----------
    libraries : of ax, ay, az.
    theta : (p,) coefficients of all three, SI.
    """

    libraries: tuple[Library, Library, Library]
    theta: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """``ax.b0`` ... ``az.c_kk``."""
        return tuple(f"{c}.{n}" for c, lib in zip(COMPONENTS, self.libraries, strict=True) for n in lib.names)

    def regressors(self, f: FloatArray) -> tuple[FloatArray, ...]:
        """Columns of each component at specific forces f (m, 3) along the case axes: three (m, p_c)."""
        return tuple(
            columns(
                lib, {f"f_{axis}": f[:, column] for axis, column in zip("ijk", order, strict=True)}, len(f)
            )
            for lib, order in zip(self.libraries, PERMUTATION, strict=True)
        )

    def parts(self) -> list[FloatArray]:
        """Coefficients of each component."""
        ends = np.cumsum([len(lib.terms) for lib in self.libraries])[:-1]
        return np.split(self.theta, ends)

    def deviation(self, f: FloatArray) -> FloatArray:
        """Output minus input (m, 3) at specific forces f (m, 3)."""
        parts = zip(self.regressors(f), self.parts(), strict=True)
        return np.column_stack([X @ theta for X, theta in parts])

    def compensate(self, y: FloatArray) -> FloatArray:
        """Specific force (m, 3) of outputs y (m, 3), by fixed-point iteration.

        Raises
        ------
        ConvergenceError : if it does not settle: the nominal scale is far off, or the coefficients are.
        """
        f = y
        for _ in range(ROUNDS):
            new = y - self.deviation(f)
            if np.max(np.abs(new - f)) <= 1e-13 * np.max(np.abs(y)):
                return new
            f = new
        raise ConvergenceError(
            "the compensation of the triad does not settle: check scale and offset of its columns", f
        )

    def gain(self) -> FloatArray:
        """I + M, (3, 3): the linear response along the case axes."""
        matrix = np.eye(3)
        for row, (lib, theta, order) in enumerate(
            zip(self.libraries, self.parts(), PERMUTATION, strict=True)
        ):
            for name, axis in zip(("b1", "m_j", "m_k"), order, strict=True):
                if name in lib.names:
                    matrix[row, axis] += theta[lib.names.index(name)]
        return matrix


def triad_of(lib: Library) -> Triad:
    """Triad of three alike components, with the rotation fixed and all coefficients zero."""
    libraries = tuple(
        Library(lib.kind, tuple(t for t in lib.terms if t.name not in dropped)) for dropped in BELOW_DIAGONAL
    )
    x, y, z = libraries
    return Triad((x, y, z), np.zeros(sum(len(part.terms) for part in libraries)))


@dataclass(frozen=True, slots=True, eq=False)
class FreeTumble:
    """Outcome of a reference-free tumble.

    Attributes
    ----------
    summary : factor over the terms of all three components, named ``ax.b0`` and so on.
    triad : at the coefficients that the rows are linearised about.
    residuals : of each run: (residuals in m/s^2, rows, compensated force (n, 3)) for the checks.
    """

    summary: Summary
    triad: Triad
    residuals: tuple[tuple[FloatArray, Rows, FloatArray], ...]


def solve_free_tumble(
    runs: Sequence[TriadRun],
    lib: Library,
    prior: ScalePrior,
    *,
    sensor: SensorClass | None = None,
    rules: Rules | None = None,
) -> FreeTumble:
    """Linearise free tumbles of one triad until they settle.

    Parameters
    ----------
    runs : of one triad.
    lib : candidate terms of a component.
    prior : of the triad's terms, in the order of `triad_of(lib).names`.
    sensor : class whose noise prior steers the estimate.
    rules : how the noise is known, by run.

    Raises
    ------
    UnobservableError : if there are fewer than 9 stills.
    ConvergenceError : if the linearisation does not settle; it carries the triad so far.
    """
    stills = [find_stills(run) for run in runs]
    if sum(map(len, stills)) < FEWEST:
        raise UnobservableError(
            f"{sum(map(len, stills))} stills are too few: {FEWEST} directions at least, 20 or more are usual"
        )
    triad, rules = triad_of(lib), rules or {}
    noises = [
        _given(rules.get(run.name, NoiseRule())) or _start(run, s)
        for run, s in zip(runs, stills, strict=True)
    ]
    sds: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)] * len(runs)
    for turn in range(ROUNDS):
        rows = [_rows(triad, run, s, blocks=True) for run, s in zip(runs, stills, strict=True)]
        if turn == NOISE_ROUND:
            for i, run in enumerate(runs):
                if rules.get(run.name, NoiseRule()).rule == "estimate":
                    found = estimate(rows[i], noise_prior(sensor) if sensor else None, prior.sd)
                    noises[i], sds[i] = found.noise, found.sd
        T = with_prior_rows(_whitened(rows, noises, triad.names).R, 1.0 / prior.sd)
        new = solve_triangular(T[:-1, :-1], T[:-1, -1])
        sd = np.linalg.norm(solve_triangular(T[:-1, :-1], np.eye(len(new))), axis=1)
        settled = turn > NOISE_ROUND and bool(np.all(np.abs(new - triad.theta) <= SETTLED * sd))
        triad = replace(triad, theta=new)
        if settled:
            break
    else:
        raise ConvergenceError(f"the free tumble did not settle in {ROUNDS} rounds", triad)
    return _outcome(runs, stills, triad, noises, sds, sensor, rules)


def calibration(triad: Triad, nominal: Sequence[tuple[float, float]]) -> tuple[dict[str, object], ...]:
    """Compensation of each component, as calibration tools publish it.

    With raw numbers r, ``f = T K (r - bias)``: K is diagonal, T upper triangular with ones on its diagonal,
    from ``T K = (I + M)^-1 diag(scale)``. This is imu_tk's form, and its signs.

    Parameters
    ----------
    triad : at the coefficients to publish.
    nominal : (scale in SI per file unit, offset in file units) that made SI outputs of each column.

    Returns
    -------
    for ax, ay, az: ``scale`` (SI per file unit), ``bias`` (file units), ``nonorthogonality`` (rad, by the
    term that causes it), ``convention``.
    """
    T = np.linalg.inv(triad.gain())
    parts = zip(triad.parts(), triad.libraries, strict=True)
    bias = [float(theta[lib.names.index("b0")]) for theta, lib in parts]
    rows = []
    for c, ((scale, offset), order) in enumerate(zip(nominal, PERMUTATION, strict=True)):
        names = [(name, axis) for name, axis in zip(("m_j", "m_k"), order[1:], strict=True) if axis > c]
        rows.append(
            {
                "scale": float(T[c, c]) * scale,
                "bias": offset + bias[c] / scale,
                "nonorthogonality": {name: float(T[c, axis] / T[axis, axis]) for name, axis in names},
                "convention": CONVENTION,
            }
        )
    return tuple(rows)


CONVENTION = (
    "f = T K (raw - bias), K diagonal (scale), T upper triangular with ones on the diagonal: the sensor's"
    " z axis is the case's, its y axis lies in the case's y-z plane. Entries of T have the opposite sign of"
    " the misalignments m of the model, which go from force to output."
)


def _given(rule: NoiseRule) -> Noise | None:
    return rule.value if rule.rule == "fixed" else None


def _start(run: TriadRun, stills: Sequence[tuple[int, int]]) -> Noise:
    """White noise from the scatter within the stills, to start from (and all there is, with ``white``)."""
    within = [run.output[a:b] - run.output[a:b].mean(axis=0) for a, b in stills]
    variance = sum(float(np.sum(part**2)) for part in within) / sum(part.size - 3 for part in within)
    return Noise(float(np.sqrt(variance * run.interval)), 0.0, 0.0)


def _rows(triad: Triad, run: TriadRun, stills: Sequence[tuple[int, int]], *, blocks: bool) -> Blocks:
    """Linearised rows of the stills, per block or per sample."""
    means = np.array([run.output[a:b].mean(axis=0) for a, b in stills])
    f = triad.compensate(means)
    length = np.linalg.norm(f, axis=1)
    w = np.linalg.solve(triad.gain().T, (f / length[:, None]).T).T
    X = np.hstack([w[:, [c]] * phi for c, phi in enumerate(triad.regressors(f))])
    base = length - run.gravity + X @ triad.theta
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    still = np.repeat(np.arange(len(stills)), [b - a for a, b in stills])
    y = base[still] + np.einsum("na,na->n", w[still], run.output[index] - means[still])
    t = run.t[index]
    if not blocks:
        return Blocks(Rows(t, np.full(len(t), run.interval), w[still]), X[still], y)
    edges = block_edges(t, run.interval)
    counts = np.diff(np.append(edges, len(t)))
    rows = Rows(np.add.reduceat(t, edges) / counts, counts * run.interval, w[still[edges]])
    return Blocks(rows, X[still[edges]], np.add.reduceat(y, edges) / counts)


def _whitened(rows: Sequence[Blocks], noises: Sequence[Noise], names: tuple[str, ...]) -> Factor:
    return reduce(add, (_factor(part, noise, names) for part, noise in zip(rows, noises, strict=True)))


def _factor(part: Blocks, noise: Noise, names: tuple[str, ...]) -> Factor:
    w = whitener(noise, part.rows)
    white = whiten(w, np.column_stack((part.X, part.y)))
    R = triangular((white[i:j] for i, j in row_blocks(len(white))), white.shape[1])
    return Factor(names, R, len(white), w.log_det)


def _outcome(
    runs: Sequence[TriadRun],
    stills: Sequence[Sequence[tuple[int, int]]],
    triad: Triad,
    noises: Sequence[Noise],
    sds: Sequence[tuple[float, float, float]],
    sensor: SensorClass | None,
    rules: Rules,
) -> FreeTumble:
    """Summary on all samples of the stills, at the settled linearisation."""
    rows = [_rows(triad, run, s, blocks=False) for run, s in zip(runs, stills, strict=True)]
    factors = [_factor(part, noise, triad.names) for part, noise in zip(rows, noises, strict=True)]
    reach = [np.abs(part.X).max(axis=0) for part in rows]
    summaries = tuple(
        RunSummary(
            name=run.name,
            procedure=run.procedure,
            samples=len(part.y),
            duration=float(run.t[-1] - run.t[0]),
            interval=run.interval,
            noise=noise,
            noise_sd=sd,
            noise_prior=noise_prior(sensor) if sensor else (),
            noise_origin={"estimate": "REML", "fixed": "given"}.get(
                rules.get(run.name, NoiseRule()).rule, "white"
            ),
            ranges={
                c: (float(v.min()), float(v.max())) for c, v in zip(COMPONENTS, run.output.T, strict=True)
            },
            source=run.source,
            factor=factor,
            reach=largest,
            stills=tuple((float(run.t[a]), float(run.t[b - 1])) for a, b in s),
        )
        for run, s, part, noise, sd, factor, largest in zip(
            runs, stills, rows, noises, sds, factors, reach, strict=True
        )
    )
    summary = Summary(
        factor=reduce(add, factors),
        runs=summaries,
        library=triad.libraries[0],
        facts=Facts("accelerometer", constant_force=True, one_sided=False, reference_free=True),
        reach=dict(zip(triad.names, np.max(reach, axis=0).tolist(), strict=True)),
    )
    residuals = tuple(
        (part.y - part.X @ triad.theta, part.rows, _forces(triad, run, s))
        for part, run, s in zip(rows, runs, stills, strict=True)
    )
    return FreeTumble(summary, triad, residuals)


def _forces(triad: Triad, run: TriadRun, stills: Sequence[tuple[int, int]]) -> FloatArray:
    """Compensated specific force (n, 3) of each sample's still."""
    f = triad.compensate(np.array([run.output[a:b].mean(axis=0) for a, b in stills]))
    return np.repeat(f, [b - a for a, b in stills], axis=0)
