"""Does this kind of component need a term: one model for several alike components.

Components x, y, z of a triad have coefficients of their own, but if they have the same model, its evidence is
the product of theirs. Terms that not all of them have (accelerometers without a reference lack some
misalignments) are averaged over, each component by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.selection.decision import Selection
from imubayes.selection.masks import fold, sizes
from imubayes.selection.model_prior import log_model_prior
from imubayes.selection.models import Models
from imubayes.selection.spaces import Every
from imubayes.sensors.terms import Kind


def pooled_inclusion(selections: Sequence[Selection]) -> Mapping[str, float]:
    """Inclusion of each term in a model that several components share.

    Parameters
    ----------
    selections : of components of one kind, whose terms have the same names.

    Returns
    -------
    inclusion of each term that is weighed in all of them, by name; empty where one of them has so many terms
    that its models were searched for, and not all weighed.
    """
    weighed = [
        (one.models, dict(zip(one.columns, (term.name for term in one.terms), strict=True)))
        for one in selections
    ]
    if not all(isinstance(models.space, Every) for models, _ in weighed):
        return {}
    local = [[names[column] for column in models.candidates.names] for models, names in weighed]
    shared = [name for name in local[0] if all(name in others for others in local)]
    if not shared:
        return {}
    total = log_model_prior("beta-binomial", len(shared))[sizes(len(shared))]
    for (models, _), names in zip(weighed, local, strict=True):
        total += _log_evidence(models, names, shared)
    sums, whole = fold(np.exp(total - total.max()), len(shared))
    return dict(zip(shared, np.minimum(sums / whole, 1.0).tolist(), strict=True))


def pooled_by_kind(
    kinds: Sequence[Kind], selections: Sequence[Selection]
) -> Mapping[Kind, Mapping[str, float]]:
    """`pooled_inclusion` of the components of each kind, of which `kinds` are those of the selections."""
    return {
        kind: pooled_inclusion([one for one, own in zip(selections, kinds, strict=True) if own == kind])
        for kind in dict.fromkeys(kinds)
    }


def _log_evidence(models: Models, names: Sequence[str], shared: Sequence[str]) -> FloatArray:
    """Log evidence, up to a constant, of each set of the shared terms (2^q,), averaged over the others."""
    p = len(names)
    prior = np.exp(log_model_prior("beta-binomial", p))[sizes(p)]
    kept = [names.index(name) for name in shared]
    weight, weight_of_prior = _margin(models.weight, kept, p), _margin(prior, kept, p)
    return np.log(np.maximum(weight, np.finfo(float).tiny)) - np.log(weight_of_prior)


def _margin(weight: FloatArray, kept: Sequence[int], p: int) -> FloatArray:
    """Sums (2^q,) of weights (2^p,) over the candidates not kept; bit k is then candidate kept[k]."""
    # the last axis runs fastest: it is bit 0
    axes = [p - 1 - bit for bit in kept]
    summed = weight.reshape((2,) * p).sum(axis=tuple(axis for axis in range(p) if axis not in axes))
    left = sorted(axes)
    return summed.transpose([left.index(axis) for axis in reversed(axes)]).ravel()
