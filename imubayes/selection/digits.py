"""Digits of a posterior over submodels that can be trusted, from its full library and what was left out.

The logarithm of a model's joint probability changes by ``rho e / sigma^2`` with the rounding of its residual
and that of its determinant (`imubayes.algebra.digits`); an inclusion changes by no more than that. The full
library bounds every submodel: its columns are the least independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.digits import HALF_UNIT, Bounds, Digits, bounds, digits_within, rounding_of
from imubayes.selection.mixture import Candidates, Components

LARGEST = 50.0
"""Error of a logarithm beyond which its size no longer matters: nothing is claimed then."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What the digits of a posterior are judged by.

    Attributes
    ----------
    candidates : what was weighed.
    components : the mixture behind the moments.
    inclusion : (p,) of each candidate.
    log_evidence : of the data.
    error : bound on the error of the logarithms by the integration over the noise scale.
    missing : what the inclusions may be off by because models were not visited.
    """

    candidates: Candidates
    components: Components
    inclusion: FloatArray
    log_evidence: float
    error: float
    missing: float


def trustworthy_digits(judged: Judged, backing: FloatArray | float = 1.0) -> Digits:
    """Digits of coefficients, sds, log evidence and inclusions that rounding leaves.

    Parameters
    ----------
    judged : a posterior over submodels.
    backing : size of each column and of the response before they were whitened over that after, which
        rounding grows by: (a + p + 1,), 1 where the rows were given as white.
    """
    c = judged.candidates
    scale = _middle_scale(judged)
    T = c.at(scale)
    found = bounds(T, rounding_of(c.dof, len(c.columns)) * np.maximum(backing, 1.0))
    log_error = _log_error(judged, found, abs(float(T[-1, -1])), scale)
    sampled = _sampled(judged)
    against = _full_size(T, scale)
    moved = math.expm1(min(2.0 * log_error, LARGEST))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = float(np.max(found.coefficients / against, initial=0.0)) + moved * _spread(judged)
    sd = float(np.max(found.sd, initial=0.0)) + moved
    share = judged.inclusion * (1.0 - judged.inclusion)
    return Digits(
        coefficients=digits_within(mean + float(np.max(sampled / np.sqrt(_least(judged)), initial=0.0))),
        sd=digits_within(sd + float(np.max(0.5 * sampled / _least(judged), initial=0.0))),
        log_evidence=digits_within(
            (log_error + judged.missing) / max(abs(judged.log_evidence), 1.0) + 8.0 * HALF_UNIT
        ),
        inclusion=digits_within(moved * float(np.max(share, initial=0.0)) + judged.missing + 8.0 * HALF_UNIT),
    )


def _spread(judged: Judged) -> float:
    """Largest sd over the larger of size and sd: what a change of the weights of models can move."""
    mean, sd = judged.components.moments()
    size = np.maximum(np.abs(mean), sd)
    known = np.isfinite(size) & (size > 0.0)
    return float(np.max(sd[known] / size[known], initial=0.0)) if known.all() else 1.0


def _middle_scale(judged: Judged) -> float:
    """Posterior mean of the noise scale, in the units of the candidates."""
    parts = judged.components
    peak = float(parts.scale.max())
    return math.ldexp(peak * float(parts.weight @ (parts.scale / peak)), -judged.candidates.response_unit)


def _log_error(judged: Judged, found: Bounds, left: float, scale: float) -> float:
    counted = HALF_UNIT * (judged.candidates.dof + 1.0)
    misfit = (left / scale) * (found.response / scale)
    return misfit + found.log_det + counted + judged.error


def _full_size(T: FloatArray, scale: float) -> FloatArray:
    """Larger of size and sd (a + p,) of each coefficient under the full library."""
    from imubayes.algebra.factor import invert_triangular

    inverse = invert_triangular(T[:-1, :-1])
    return np.maximum(np.abs(inverse @ T[:-1, -1]), scale * np.linalg.norm(inverse, axis=1))


def _sampled(judged: Judged) -> FloatArray:
    """How far the mixture's own inclusions (p,) are from those of all models."""
    return np.abs(judged.components.weight @ judged.components.inside - judged.inclusion)


def _least(judged: Judged) -> FloatArray:
    return np.maximum(judged.inclusion, np.finfo(float).tiny)
