"""The bias over a record whose noise has a random walk: at its start, on average, at its end.

A run's walk W begins with the run, so that the coefficient b0 is the bias there. Its mean over the record is
``b0 + m``, m the mean of W, and with the whitened columns X, response y and covariance c of the rows with m::

    E[m | y, theta] = c'(y - X theta),    Var[m | y, theta] = Var[m] - c'c

so that it is normal together with the coefficients, and linear in them; so is the bias at the end. Of
several runs, each with a walk of its own from the same b0, the mean is over all, the end that of the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import noise_scale, posterior_root
from imubayes.inference.linear import Linear, blocks_of
from imubayes.inference.summary import Summary
from imubayes.inference.whiten import whiten
from imubayes.sensors.noise import Noise

MATTERS = 0.1
"""Sd of the walk's mean over that of b0 below which b0 is the bias throughout."""

ALIKE = 1e-9
"""Share by which a row's weight of b0 may differ from that of the component's noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Bias of a component on average over the record and at its end: ``b0 + level - slope theta + root z``.

    Level (2,), slope (2, p), and root (2, 2) for standard normal z (2,), SI, are over p columns `names`, of
    which `b0` is the component's own. `full` (3, 2) has the bias at the start, on average and at the end,
    mean and sd under the full library; `walk` is the sd of what the walk strays in the last run:
    ``K sqrt(T)``.
    """

    names: tuple[str, ...]
    b0: str
    level: FloatArray
    slope: FloatArray
    root: FloatArray
    full: FloatArray
    walk: float

    def bias(self, names: Sequence[str], theta: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Bias (m, 3) at the start, on average, at the end, of coefficients (m, k) of some columns.

        Those of the other columns are zero; what the walk adds is drawn.
        """
        start, slope = theta[:, [names.index(self.b0)]], self.slope[:, [self.names.index(n) for n in names]]
        strayed = rng.standard_normal((len(theta), 2)) @ self.root.T
        return np.hstack((start, start + self.level - theta @ slope.T + strayed))


def drift_of(summary: Summary, rows: Sequence[Linear], sd: FloatArray, column: str) -> Drift | None:
    """Bias of a component over its runs; None where no walk of theirs counts beside what is known of b0.

    Summary, rows and prior sds (p,), SI, are over all columns; `column` is the component's b0.
    """
    if column not in summary.names:
        return None
    own, p = summary.names.index(column), len(summary.names)
    scale = noise_scale(summary.factor, sd)
    blocks = [blocks_of(part) for part in rows]
    taken = [(k, share) for k, part in enumerate(blocks) if (share := _share(part, own)) is not None]
    whole = sum(blocks[k].rows.span for k, _ in taken)
    level, slope, cov = np.zeros(2), np.zeros((2, p)), np.zeros((2, 2))
    for k, share in taken:
        weights = np.array([blocks[k].rows.span / whole, float(k == taken[-1][0])])
        seen = _seen(blocks[k], summary.runs[k].noise, share)
        level += weights * seen[0]
        slope += weights[:, None] * seen[1]
        cov += np.outer(weights, weights) * seen[2]
    mean, root = posterior_root(summary.factor, sd, scale)
    spans = np.array([blocks[k].rows.span for k, _ in taken])
    walks = np.array([summary.runs[k].noise.K for k, _ in taken])
    # sd of the walks' mean before the data: K sqrt(T / 3) of a single run
    before = float(np.sqrt(np.sum((spans / whole) ** 2 * walks**2 * spans / 3.0))) if taken else 0.0
    if not before > MATTERS * float(np.linalg.norm(root[own])):
        return None
    unit = np.eye(p)[own]
    ways = np.vstack((unit, unit - slope))
    spread = np.sum((ways @ root) ** 2, axis=1) + scale**2 * np.append(0.0, np.diag(cov))
    full = np.column_stack((ways @ mean + np.append(0.0, level), np.sqrt(spread)))
    power, vectors = np.linalg.eigh(cov)
    root = scale * vectors * np.sqrt(np.maximum(power, 0.0))
    last = taken[-1][0]
    strays = scale * summary.runs[last].noise.K * float(np.sqrt(blocks[last].rows.span))
    return Drift(summary.names, column, level, slope, root, full, strays)


def _share(blocks: Linear, own: int) -> FloatArray | None:
    """Weight (n,) of the component's noise in each row; None where b0 does not enter as that noise does."""
    column = blocks.X[:, own]
    each = np.ones((len(column), 1)) if blocks.axes is None else blocks.axes
    alike = np.abs(each - column[:, None]).max(axis=0) <= ALIKE * max(float(np.abs(column).max()), ALIKE)
    return each[:, int(np.argmax(alike))] if alike.any() else None


def _seen(blocks: Linear, noise: Noise, share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What a run says of its walk's mean and end: level (2,), slope (2, p), covariance (2, 2)."""
    p, T = len(blocks.names), blocks.rows.span
    since = blocks.t - (blocks.t[0] - 0.5 * blocks.duration[0])
    mean = since - (since**2 + blocks.duration**2 / 12.0) / (2.0 * T)
    table = np.column_stack((blocks.X, blocks.y, noise.K**2 * share * mean, noise.K**2 * share * since))
    whiten(noise, blocks.rows, table)
    c = table[:, p + 1 :]
    known = noise.K**2 * np.array([[T / 3.0, T / 2.0], [T / 2.0, T]])
    return c.T @ table[:, p], c.T @ table[:, :p], known - c.T @ c
