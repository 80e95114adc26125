"""Exact draws of a component's coefficients, from the posterior and from the prior."""

from __future__ import annotations

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.selection.decision import Selection
from imubayes.selection.mixture import draw
from imubayes.selection.models import Models


def posterior_draws(selection: Selection, size: int, rng: np.random.Generator) -> FloatArray:
    """Independent draws (size, p) in the order of the verdicts; a term that a draw's model lacks is zero.

    Terms that the test never excited are drawn from their prior, with the inclusion that the others suggest.
    """
    models = selection.models
    drawn = _model_draws(models, size, rng)
    columns = {name: drawn[:, j] for j, name in enumerate(models.candidates.columns)}
    out = np.empty((size, len(selection.terms)))
    for j, (term, name) in enumerate(zip(selection.terms, selection.carriers, strict=True)):
        out[:, j] = columns[name] if name in columns else _sparse(term.inclusion, term.prior_sd, size, rng)
    return out[:, _carried(selection)]


def _carried(selection: Selection) -> list[int]:
    """Place (p,) of the coefficient that each is."""
    return [selection.columns.index(name) for name in selection.carriers]


def _model_draws(models: Models, size: int, rng: np.random.Generator) -> FloatArray:
    """Draws of the candidates' columns; over draws of the noise each has as many as it counts."""
    if not models.parts:
        return draw(models.candidates, models.components, size, rng)
    counts = rng.multinomial(size, [share for share, _ in models.parts])
    parts = zip(models.parts, counts.tolist(), strict=True)
    drawn = [draw(part.candidates, part.components, count, rng) for (_, part), count in parts if count]
    return rng.permutation(np.concatenate(drawn))


def prior_draws(selection: Selection, size: int, rng: np.random.Generator) -> FloatArray:
    """Draws (size, p) of the prior: the share of terms in the model is uniform, coefficients are normal."""
    share = rng.random(size)
    inside = rng.random((size, len(selection.terms))) < share[:, None]
    sd = np.array([term.prior_sd for term in selection.terms])
    return np.where(inside, rng.standard_normal(inside.shape) * sd, 0.0)[:, _carried(selection)]


def _sparse(inclusion: float, sd: float, size: int, rng: np.random.Generator) -> FloatArray:
    return np.where(rng.random(size) < inclusion, sd * rng.standard_normal(size), 0.0)
