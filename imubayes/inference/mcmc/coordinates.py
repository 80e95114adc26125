"""Coordinates of the coefficients in which Gram matrices are harmless."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, invert_triangular, with_prior_rows


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Coefficients ``theta = origin + inverse phi``: standard normal at the estimated noise.

    Attributes
    ----------
    origin : (p,) posterior mean.
    inverse : (p, p) upper triangular, of the factor of rows and prior.
    prior : (p + 1, p + 1) Gram matrix of the prior's rows in these coordinates.
    log_volume : log determinant of `inverse`.
    """

    origin: FloatArray
    inverse: FloatArray
    prior: FloatArray
    log_volume: float

    def gram(self, R: FloatArray) -> FloatArray:
        """Gram matrix (p + 1, p + 1) of rows with the factor R, their response taken relative to `origin`."""
        T = np.column_stack((R[:, :-1] @ self.inverse, R[:, -1] - R[:, :-1] @ self.origin))
        return T.T @ T


def coordinates(f: Factor, sd: FloatArray) -> Coordinates:
    """Coordinates of the posterior under prior sds (p,) at the noise that whitened the factor."""
    T = with_prior_rows(f.R, 1.0 / sd)
    inverse = invert_triangular(T[:-1, :-1])
    origin = inverse @ T[:-1, -1]
    volume = float(np.sum(np.log(np.abs(np.diag(inverse)))))
    bare = Coordinates(origin, inverse, np.zeros((0, 0)), volume)
    rows = np.column_stack((np.diag(1.0 / sd), np.zeros(len(sd))))
    return Coordinates(origin, inverse, bare.gram(rows), volume)
