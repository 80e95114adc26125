"""Covariance of a component's coefficients, from the draws in ``posterior.nc`` beside a result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import DataError

POSTERIOR = "posterior.nc"
"""Name of the file in a folder of results."""


def posterior_covariance(result: Path, id: str, names: Sequence[str]) -> NDArray[np.float64] | None:
    """Covariance (p, p) of the named terms over the model-averaged draws.

    Parameters
    ----------
    result : path of the ``result.json``.
    id : of the component.

    Returns
    -------
    the covariance, or None where there is no file of draws, or it is of another result.

    Raises
    ------
    DataError : if the file cannot be read.
    """
    file = result.with_name(POSTERIOR)
    if not file.exists():
        return None
    from xarray import open_dataset

    try:
        with open_dataset(file, group="posterior", engine="h5netcdf") as group:
            for name, variable in group.data_vars.items():
                if variable.attrs.get("sensor") == id and variable.dims[-1] == f"{name}_term":
                    terms = [str(term) for term in group[f"{name}_term"].values]
                    return _covariance(np.asarray(variable.values), terms, names)
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error}): remove it, or run the study again") from None
    return None


def _covariance(
    draws: NDArray[np.float64], terms: Sequence[str], names: Sequence[str]
) -> NDArray[np.float64] | None:
    if not set(names) <= set(terms):
        return None
    values = draws.reshape(-1, draws.shape[-1])[:, [terms.index(name) for name in names]]
    return np.atleast_2d(np.cov(values, rowvar=False)).reshape(len(names), len(names))
