"""What the posterior of all columns ties together: correlations, and what one coefficient does to others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, invert_triangular, noise_scale, posterior_root, with_prior_rows


def correlation(f: Factor, sd: FloatArray, names: Sequence[str]) -> FloatArray:
    """Correlation (q, q) of the q named coefficients under a normal prior, sds (p,), in units of the noise.

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros(2), ("a", "b"))
    >>> correlation(f, np.full(2, 1e9), ("a", "b")).round(3).tolist()
    [[1.0, -0.707], [-0.707, 1.0]]
    """
    rows = invert_triangular(with_prior_rows(f.R, 1.0 / sd)[:-1, :-1])
    rows = rows[[f.names.index(name) for name in names]]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return rows @ rows.T


def pulls(f: Factor, sd: FloatArray, names: Sequence[str]) -> Mapping[str, FloatArray]:
    """What each column's coefficient does to the q named ones, for one of its prior sds (p,).

    With the posterior's covariance C, the posterior mean of j takes over ``-C_jk / sd_k^2`` of coefficient k.

    Returns
    -------
    by column, ``C_jk / sd_k`` (q,), in the coefficients' units.

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> f = factor_of(np.ones((4, 2)), np.array([1.0, -1.0, 1.0, -1.0]), ("a", "b"))
    >>> {name: pull.round(2).tolist() for name, pull in pulls(f, np.array([3.0, 1.0]), ("a",)).items()}
    {'a': [0.37], 'b': [-0.88]}
    """
    _, root = posterior_root(f, sd, noise_scale(f, sd))
    rows = root[[f.names.index(name) for name in names]]
    return dict(zip(f.names, (rows @ root.T / sd).T, strict=True))
