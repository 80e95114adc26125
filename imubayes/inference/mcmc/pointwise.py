"""Log likelihood of each dwell under each draw, and what the draws make of its mean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import Linear, blocks_of
from imubayes.inference.whiten import mattering, whiten
from imubayes.sensors.noise import Noise


@dataclass(frozen=True, slots=True, eq=False)
class Pointwise:
    """Dwells of all runs.

    Attributes
    ----------
    dwells : q dwells: (run, start in s, stop in s).
    observed : (q,) mean response, SI.
    predicted : (draws, q) what the coefficients make of it.
    log_likelihood : (draws, q) of the averages over each dwell's blocks, given those before it in its run.
    """

    dwells: tuple[tuple[str, float, float], ...]
    observed: FloatArray
    predicted: FloatArray
    log_likelihood: FloatArray


def by_dwell(
    rows: Sequence[Linear], estimated: Sequence[Noise], theta: FloatArray, noise: FloatArray
) -> Pointwise:
    """Score every dwell.

    Parameters
    ----------
    rows : of g runs.
    estimated : noise of each run that its whitening was made for: it says which processes matter.
    theta : (m, p) draws of the coefficients, SI.
    noise : (m, g, 3) draws of N, B, K.
    """
    parts = [_run(r, e, theta, noise[:, k]) for k, (r, e) in enumerate(zip(rows, estimated, strict=True))]
    return Pointwise(
        dwells=tuple(dwell for part in parts for dwell in part.dwells),
        observed=np.concatenate([part.observed for part in parts]),
        predicted=np.hstack([part.predicted for part in parts]),
        log_likelihood=np.hstack([part.log_likelihood for part in parts]),
    )


def _run(rows: Linear, estimated: Noise, theta: FloatArray, noise: FloatArray) -> Pointwise:
    dwells, blocks = dwells_of(rows), blocks_of(rows)
    parts = mattering(estimated, rows.rows)
    # a block belongs to the dwell that its middle lies in; its centre is never on the border of two
    owner = np.clip(
        np.searchsorted(dwells.start, blocks.rows.t, side="right") - 1, 0, len(dwells.means.y) - 1
    )
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    residuals = blocks.y - theta @ blocks.X.T
    scores = np.empty((len(theta), len(first)))
    for k, (left, values) in enumerate(zip(residuals, noise, strict=True)):
        white, d = whiten(Noise(*values.tolist()), blocks.rows, left[:, None].copy(), parts)
        scores[k] = np.add.reduceat(-0.5 * (white[:, 0] ** 2 + np.log(d) + math.log(2.0 * math.pi)), first)
    index = owner[first]
    return Pointwise(
        dwells=tuple((rows.name, float(dwells.start[d]), float(dwells.stop[d])) for d in index),
        observed=dwells.means.y[index],
        predicted=theta @ dwells.means.X[index].T,
        log_likelihood=scores,
    )
