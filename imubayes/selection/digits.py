"""Digits of a posterior over submodels that can be trusted, from its full library and what was left out.

The logarithm of a model's joint probability changes by ``rho e / sigma^2`` with the rounding of its residual
and that of its determinant (`imubayes.algebra.digits`); an inclusion changes by no more than that. The full
library bounds every submodel: its columns are the least independent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.digits import HALF_UNIT, Digits, bounds, digits_within, norms, rounding_of
from imubayes.algebra.factor import invert_triangular
from imubayes.inference.summary import Summary
from imubayes.selection.mixture import Components

if TYPE_CHECKING:
    from imubayes.selection.models import Models

LARGEST = 50.0
"""Error of a logarithm beyond which its size no longer matters: nothing is claimed then."""

TINY = np.finfo(float).tiny
"""In place of an inclusion of zero."""

PEAK = 6.0
"""Standard deviations of white noise that its largest sample reaches."""


def digits_of(models: Models, summary: Summary | None = None) -> Digits:
    """Digits of a posterior that the arithmetic leaves, the fewest at any noise that it is averaged over.

    Parameters
    ----------
    models : the posterior.
    summary : of the runs behind it; None where the rows were given as white.
    """
    before = 1.0 if summary is None else backing(summary, models)
    found = [_trustworthy(part, before) for _, part in models.parts or ((1.0, models),)]
    return Digits(
        coefficients=min(one.coefficients for one in found),
        sd=min(one.sd for one in found),
        log_evidence=min(one.log_evidence for one in found),
        inclusion=min(one.inclusion for one in found),
    )


def _trustworthy(models: Models, backing: FloatArray | float) -> Digits:
    """Digits of coefficients, sds, log evidence and inclusions that rounding leaves, at one noise.

    The mixture's own inclusions may be off from those of all models, where it holds some that stand for all.
    """
    c, parts = models.candidates, models.components
    inclusion = models.inclusion[[models.names.index(name) for name in c.names]]
    peak = float(parts.scale.max())  # the posterior mean of the noise scale, in the units of the candidates
    scale = math.ldexp(peak * float(parts.weight @ (parts.scale / peak)), -c.response_unit)
    T = c.at(scale)
    found = bounds(T, rounding_of(c.dof, len(c.columns)) * np.maximum(backing, 1.0))
    misfit = (abs(float(T[-1, -1])) / scale) * (found.response / scale)
    log_error = misfit + found.log_det + HALF_UNIT * (c.dof + 1.0) + models.quadrature
    missing = 1.0 if math.isnan(models.missing) else models.missing + models.error
    sampled, least = np.abs(parts.weight @ parts.inside - inclusion), np.maximum(inclusion, TINY)
    moved = math.expm1(min(2.0 * log_error, LARGEST))
    inverse = invert_triangular(T[:-1, :-1])
    size = np.maximum(np.abs(inverse @ T[:-1, -1]), scale * np.linalg.norm(inverse, axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = found.coefficients / size
        mean = float(np.max(relative, initial=0.0)) + moved * _spread(parts)
    sd = float(np.max(found.sd, initial=0.0)) + moved
    share = float(np.max(inclusion * (1.0 - inclusion), initial=0.0))
    return Digits(
        coefficients=digits_within(mean + float(np.max(sampled / np.sqrt(least), initial=0.0))),
        sd=digits_within(sd + float(np.max(0.5 * sampled / least, initial=0.0))),
        log_evidence=digits_within(
            (log_error + missing) / max(abs(models.log_evidence), 1.0) + 8.0 * HALF_UNIT
        ),
        inclusion=digits_within(moved * share + missing + 8.0 * HALF_UNIT),
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


def _spread(parts: Components) -> float:
    """Largest sd over the larger of size and sd: what a change of the weights of models can move."""
    mean, sd = parts.moments()
    size = np.maximum(np.abs(mean), sd)
    known = np.isfinite(size) & (size > 0.0)
    return float(np.max(sd[known] / size[known], initial=0.0)) if known.all() else 1.0
