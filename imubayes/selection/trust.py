"""Digits of a posterior over submodels that can be trusted, from its full library and what was left out.

The logarithm of a model's joint probability changes by ``rho e / sigma^2`` with the rounding of its residual
and that of its determinant (`imubayes.algebra.digits`); an inclusion changes by no more than that. The full
library bounds every submodel: its columns are the least independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.digits import HALF_UNIT, Bounds, Digits, bounds, digits_within, norms, rounding_of
from imubayes.selection.mixture import Candidates, Components

if TYPE_CHECKING:
    from imubayes.inference.summary import Summary
    from imubayes.selection.models import Models


PEAK = 6.0
"""Standard deviations of white noise that its largest sample reaches."""

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


def digits_of(models: Models, summary: Summary | None = None) -> Digits:
    """Digits of a posterior that the arithmetic leaves, the fewest at any noise that it is averaged over.

    Parameters
    ----------
    models : the posterior.
    summary : of the runs behind it; None where the rows were given as white.
    """
    before = 1.0 if summary is None else backing(summary, models)
    found = [trustworthy_digits(_judged(part), before) for _, part in models.parts or ((1.0, models),)]
    return Digits(
        coefficients=min(one.coefficients for one in found),
        sd=min(one.sd for one in found),
        log_evidence=min(one.log_evidence for one in found),
        inclusion=min(one.inclusion for one in found),
    )


def _judged(models: Models) -> Judged:
    inclusion = dict(zip(models.names, models.inclusion.tolist(), strict=True))
    return Judged(
        candidates=models.candidates,
        components=models.components,
        inclusion=np.array([inclusion[name] for name in models.candidates.names]),
        log_evidence=models.log_evidence,
        error=models.quadrature,
        missing=1.0 if math.isnan(models.missing) else models.missing + models.error,
    )


def backing(summary: Summary, models: Models) -> FloatArray | float:
    """Size of each column, and of the response, before whitening over that after, at least 1.

    Whitening takes differences of neighbours, so that it keeps the rounding of what it takes away.

    Parameters
    ----------
    summary : of runs; arrays from elsewhere were white as they came.
    models : whose columns these are.
    """
    f, runs = summary.factor, [run for run in summary.runs if run.noise.N > 0.0]
    if not runs:
        return 1.0
    theta = dict(zip(models.names, np.abs(models.mean).tolist(), strict=True))
    explained = np.array([theta.get(name, 0.0) for name in f.names])
    parts = []
    for run in runs:
        white = run.noise.N / math.sqrt(run.interval)
        largest = np.append(run.reach, run.reach @ explained + PEAK * white)
        parts.append(math.sqrt(run.samples) / white * largest)
    after = norms(f.R)
    ratio = np.linalg.norm(parts, axis=0) / np.where(after > 0.0, after, np.inf)
    return np.maximum(ratio, 1.0)[[*(f.names.index(name) for name in models.candidates.columns), f.p]]


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
