"""Noise of a run by restricted maximum likelihood, with the full library in the mean.

What the library can explain is projected out before the noise is judged, so that a coefficient is not
mistaken for drift nor drift for a coefficient. The rows are averages over short blocks: the model is linear,
so averages of its columns are exact, and only the noise within a block is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.linear import Linear, Rows, averages, blocks_of, linear_of, with_columns
from imubayes.inference.whiten import Processes, processes, whiten, whitener
from imubayes.rig.inputs import Stream
from imubayes.sensors.noise import Noise

LogNormal = tuple[float, float]

VAGUE = math.log(30.0)
"""Prior sd of ln N, ln B, ln K where no class is known: a factor of 30 either way."""

RANK = 1e-10
"""Singular values of the scaled mean's columns below this share of the largest are left out."""

REACH = 6.0
"""Prior sds of ln N, ln B, ln K within which the maximum is sought."""

STEP = 0.05
"""Step of the second differences in ln N, ln B, ln K."""


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """Noise of rows: at the maximum of its restricted posterior, or as a rule says.

    Attributes
    ----------
    noise : N, B, K, SI.
    sd : of ln N, ln B, ln K (from the curvature); 0 where the noise was given.
    prior : (median, sd of the logarithm) of the class for each; empty without a class.
    steering : the same of the prior that the estimate was made under, with a class or without.
    origin : ``REML``, ``white``, ``given`` or ``run <name>``.
    run : the other run whose noise it is; empty for the run's own.
    """

    noise: Noise
    sd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    prior: tuple[LogNormal, ...] = ()
    steering: tuple[LogNormal, ...] = ()
    origin: str = "REML"
    run: str = ""


def estimate(
    blocks: Linear, prior: tuple[LogNormal, LogNormal, LogNormal] | None = None, sd: FloatArray | None = None
) -> NoiseEstimate:
    """Noise parameters at the maximum of their restricted posterior.

    Parameters
    ----------
    blocks : averaged rows of one run.
    prior : (median, sd of the logarithm) of N, B, K; vague and from the data if None.
    sd : (p,) prior sds of the coefficients; None takes the whole span of the columns out (REML). With fewer
        rows than columns need, only a proper prior leaves anything to judge the noise by.
    """
    from scipy.optimize import minimize

    steering = prior or _vague(blocks)
    center = np.log([median for median, _ in steering])
    width = np.array([spread for _, spread in steering])
    columns = span(blocks.X) if sd is None else blocks.X * sd
    stacked = np.column_stack((columns, blocks.y))
    parts = processes(blocks.rows)

    def cost(x: FloatArray) -> float:
        pull = 0.5 * float(np.sum(((x - center) / width) ** 2))
        return pull - _log_likelihood(np.exp(x), blocks.rows, parts, stacked, proper=sd is not None)

    start = center.copy()
    start[0] = math.log(_first_white(blocks))
    bounds = [
        (min(c, s) - REACH * w, max(c, s) + REACH * w) for c, s, w in zip(center, start, width, strict=True)
    ]
    best = minimize(cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60, "ftol": 1e-10}).x
    return NoiseEstimate(
        Noise(*np.exp(best).tolist()), _curvature_sd(cost, best, width), prior or (), steering
    )


def _log_likelihood(
    values: FloatArray, rows: Rows, parts: Processes, stacked: FloatArray, *, proper: bool
) -> float:
    """Restricted log likelihood, up to a constant; columns with a unit normal prior if `proper`."""
    w = whitener(Noise(*values.tolist()), rows, parts)
    white = whiten(w, stacked.copy())
    width = white.shape[1]
    # without a prior, a row of zeros: with no more rows than columns the residual is zero, not a column
    white = np.concatenate((white, np.eye(width - 1, width) if proper else np.zeros((1, width))))
    R = np.linalg.qr(white, mode="r")
    diagonal = np.abs(np.diag(R))
    return -0.5 * w.log_det - float(np.sum(np.log(diagonal[:-1]))) - 0.5 * float(diagonal[-1] ** 2)


def span(X: FloatArray) -> FloatArray:
    """Orthonormal basis (m, rank) of the columns' span; REML depends on nothing else."""
    norms = np.linalg.norm(X, axis=0)
    U, s, _ = np.linalg.svd(X[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    return U[:, s > RANK * s[0]] if len(s) else U


def _first_white(blocks: Linear) -> float:
    """White noise from the scatter of neighbouring blocks, robust to steps between dwells."""
    steps = np.diff(blocks.y) * np.sqrt(blocks.rows.duration[1:])
    spread = float(np.median(np.abs(steps)))
    largest = float(np.max(np.abs(blocks.y))) * math.sqrt(float(blocks.rows.duration[0]))
    return max(spread / (0.6745 * math.sqrt(2.0)), np.finfo(float).eps * largest, np.finfo(float).tiny)


def _vague(blocks: Linear) -> tuple[LogNormal, LogNormal, LogNormal]:
    """Wide prior without a class: B and K as large as would just show beside the white noise in this run."""
    white, span = _first_white(blocks), blocks.rows.span
    middle = math.sqrt(float(blocks.rows.duration.min()) * span)
    return (white, VAGUE), (white / math.sqrt(middle), VAGUE), (white / middle, VAGUE)


def _curvature_sd(cost, best: FloatArray, width: FloatArray) -> tuple[float, float, float]:
    """Posterior sd of the logarithms from second differences; at most the prior's."""
    eye = STEP * np.eye(3)
    middle = cost(best)
    single = [(cost(best + e), cost(best - e)) for e in eye]
    H = np.diag([(up + down - 2.0 * middle) / STEP**2 for up, down in single])
    for i in range(3):
        for j in range(i):
            both = cost(best + eye[i] + eye[j]) + cost(best - eye[i] - eye[j])
            H[i, j] = H[j, i] = (both - sum(single[i]) - sum(single[j]) + 2.0 * middle) / (2.0 * STEP**2)
    values, vectors = np.linalg.eigh(H)
    variance = (vectors**2) @ (1.0 / np.maximum(values, 1.0 / np.max(width) ** 2))
    sds = np.minimum(np.sqrt(variance), width)
    return float(sds[0]), float(sds[1]), float(sds[2])


RUNGS = 192
"""Averages of one length in the ladder: each rung tells the noise there to 5 %."""

RATIO = 4
"""Length of the averages of a rung over that of the rung before."""


def noise_blocks(rows: Linear) -> Linear:
    """Averages that the noise of a run is judged by.

    Of a run that is read a part at a time they tell it at all time scales: a ladder of ever longer averages
    over the stretch at full rate, so that white noise is seen where it is larger than bias instability, and
    the blocks beside it.
    """
    stream = rows.stream
    if stream is None:
        return blocks_of(rows)
    fine = linear_of(stream.stretch, stream.library)
    rungs = averages(fine, _ladder(len(fine)))
    before, after = beside_stretch(stream)

    def joined(coarse: FloatArray, ladder: FloatArray) -> FloatArray:
        return np.concatenate((coarse[before], ladder, coarse[after]))

    times = replace(rows, t=joined(rows.t, rungs.t), duration=joined(rows.duration, rungs.duration))
    return with_columns(times, joined(stream.X, rungs.X), joined(rows.y, rungs.y))


def beside_stretch(stream: Stream) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which blocks (m,) end before the stretch at full rate begins, and which begin after its end."""
    begins = np.cumsum(stream.counts) - stream.counts
    ends = begins + stream.counts
    first = stream.stretch_first
    return ends <= first, begins >= first + len(stream.stretch.inputs)


def _ladder(n: int) -> NDArray[np.int64]:
    """First rows of averages over `n` rows whose length grows.

    Examples
    --------
    >>> _ladder(1000)[[0, 1, 191, 192, 193]].tolist()
    [0, 1, 191, 192, 196]
    """
    lengths = [np.full(RUNGS, RATIO**k) for k in range(1 + int(np.ceil(np.emath.logn(RATIO, n))))]
    first = np.cumsum(np.concatenate(([0], *lengths)))
    return first[first < n]
