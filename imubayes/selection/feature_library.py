"""The candidate terms as a feature library of pysindy: for its users, and for its whole toolbox."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pysindy.feature_library.base import BaseFeatureLibrary, x_sequence_or_item
from pysindy.utils import AxesArray, comprehend_axes
from sklearn.utils.validation import check_is_fitted

from imubayes.errors import TermError
from imubayes.sensors.terms import CHANNELS, Library, columns


def feature_library(lib: Library, channels: Sequence[str] = ()) -> TermLibrary:
    """Candidate terms as a feature library, to be fitted with ``x_dot = output - input``.

    Parameters
    ----------
    lib : candidate terms.
    channels : the input channel in each column of x, SI. By default those that the terms need, in the order
        of the model equation: they are `channels` of the library that is returned.

    Raises
    ------
    TermError : if a channel is not known or comes twice.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> features = feature_library(library("gyroscope", powers=2, asymmetry=0))
    >>> features.channels
    ('f_i', 'f_j', 'f_k', 'w_i', 'w_j', 'w_k')
    >>> features.fit(np.zeros((5, 6))).get_feature_names()[:4]
    ['b0', 'b1', 'b2', 'b0p']
    """
    needed = {factor.channel for term in lib.terms for factor in term.factors}
    named = tuple(channels) or tuple(name for name in CHANNELS if name in needed)
    wrong = [name for i, name in enumerate(named) if name not in CHANNELS or name in named[:i]]
    if wrong:
        raise TermError(
            f"channel '{wrong[0]}' is not known, or comes twice: expected each at most once of"
            f" {', '.join(CHANNELS)}"
        )
    return TermLibrary(lib, named)


class TermLibrary(BaseFeatureLibrary):
    """Regressors of the candidate terms (pysindy's own interface, hence a class that inherits).

    Attributes
    ----------
    library : candidate terms.
    channels : the input channel in each column of x, SI; a channel that is not there is zero.
    """

    def __init__(self, library: Library, channels: tuple[str, ...]) -> None:
        self.library = library
        self.channels = channels

    @x_sequence_or_item
    def fit(self, x_full: Sequence[AxesArray], y: object = None) -> TermLibrary:
        """Take the numbers of channels and of terms; there is nothing else to fit.

        Raises
        ------
        TermError : if x has not one column for each channel.
        """
        for x in x_full:
            self._check(x)
        self.n_features_in_ = len(self.channels)
        self.n_output_features_ = len(self.library.terms)
        return self

    @x_sequence_or_item
    def transform(self, x_full: Sequence[AxesArray]) -> list[AxesArray]:
        """Regressors (n, p) of every term at the inputs x (n, channels).

        Raises
        ------
        TermError : if x has not one column for each channel.
        """
        check_is_fitted(self)
        found = []
        for x in x_full:
            self._check(x)
            inputs = np.asarray(x, dtype=np.float64)
            X = columns(self.library, dict(zip(self.channels, inputs.T, strict=True)), len(inputs))
            found.append(AxesArray(X, comprehend_axes(X)))
        return found

    def get_feature_names(self, input_features: Sequence[str] | None = None) -> list[str]:
        """Names of the terms, whatever the channels are called."""
        return list(self.library.names)

    def _check(self, x: AxesArray) -> None:
        if x.ndim != 2 or x.shape[1] != len(self.channels):
            raise TermError(
                f"x must have a column for each of the {len(self.channels)} channels"
                f" {', '.join(self.channels)}: got an array of shape {x.shape}"
            )
