"""Priors on coefficients: the physical one of a class, and the g-family that others publish with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imubayes.algebra import FloatArray
from imubayes.errors import TermError
from imubayes.sensors.catalogue import SensorClass, prior_sd
from imubayes.sensors.terms import Library


@dataclass(frozen=True, slots=True, eq=False, init=False)
class ScalePrior:
    """``theta_j ~ N(0, sd_j^2)``, in the coefficients' own units, independent of the noise scale.

    Attributes
    ----------
    sd : (p,) one standard deviation a candidate, or a single one for all of them.
    """

    sd: FloatArray

    def __init__(self, sd: ArrayLike) -> None:
        values = np.atleast_1d(np.asarray(sd, dtype=float))
        refused = values[~(np.isfinite(values) & (values > 0.0))]
        if len(refused):
            raise TermError(f"a prior sd must be positive and finite: got {refused[0]}")
        object.__setattr__(self, "sd", values)


LARGEST_SCALE = 1e6
"""Of a Zellner-Siow prior, and its inverse the smallest: beyond, g leaves the range that is integrated."""


@dataclass(frozen=True, slots=True)
class GPrior:
    """Zellner's prior, ``theta ~ N(0, g sigma^2 (X'X)^-1)`` with `g` fixed."""

    g: float

    def __post_init__(self) -> None:
        if not 0.0 < self.g < math.inf:
            raise TermError(f"a g-prior needs a finite g > 0: got {self.g}")


@dataclass(frozen=True, slots=True)
class HyperG:
    """Mixture of g-priors with ``p(g) = (a - 2)/2 (1 + g)^(-a/2)`` (Liang et al., JASA 2008)."""

    a: float = 3.0

    def __post_init__(self) -> None:
        if not 2.0 < self.a < math.inf:
            raise TermError(f"a hyper-g prior is proper for a > 2 only, and finite: got {self.a}")


@dataclass(frozen=True, slots=True)
class ZellnerSiow:
    """Mixture of g-priors with ``g ~ inverse-gamma(1/2, n scale^2 / 2)``: Cauchy coefficients."""

    scale: float = 1.0

    def __post_init__(self) -> None:
        if not 1.0 / LARGEST_SCALE <= self.scale <= LARGEST_SCALE:
            raise TermError(f"a Zellner-Siow prior needs a scale of 1e-6 to 1e6: got {self.scale}")


GFamily = GPrior | HyperG | ZellnerSiow
Prior = ScalePrior | GFamily


def prior(sensor: SensorClass, lib: Library) -> ScalePrior:
    """Physical prior of every term of a library, from a class of the catalogue.

    The terms count as independent. Those that a lever arm alone drives are one coefficient where the library
    ties them (`catalogue.coupled`); S_ij and s_k, which it drives among others, are taken for independent,
    which leaves their error bars right, but wider than need be.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> from imubayes.sensors.terms import library
    >>> prior(sensor("mems_tactical", kind="accelerometer"), library("accelerometer")).sd[1]
    np.float64(0.0003)
    """
    return ScalePrior(class_sd(sensor, lib))


def class_sd(sensor: SensorClass, lib: Library) -> FloatArray:
    """Prior sd (p,) of every term: the class's typical magnitude (see `catalogue.prior_sd`), SI."""
    return np.array([prior_sd(sensor, term)[0] for term in lib.terms])


def weak_sd(reach: FloatArray, swing: float) -> FloatArray:
    """Prior sd (p,) for a sensor without a class: each term alone may move the output by its range, SI.

    `reach` (p,) is the largest size of each term's column, of which one of zeros gets a sd that nothing will
    test, and `swing` that of output minus input.
    """
    return (swing or 1.0) / np.where(reach > 0.0, reach, 1.0)


LOG_G = (-40.0, 90.0)
"""Range of ln g: what a Bayes factor takes from outside is below 1e-15 of it."""

WIDEST_STEP, NARROW = 0.2, 0.7
"""Step of ln g: the first, or the second over the square root of the power of g that an integrand falls with.
The trapezoid rule is then exact to 1e-11 (see `g_step_error`): the integrands are smooth and decay."""

MOST_COLUMNS, FINEST = 26, 100.0
"""Columns of the largest model, and the square root of that power beyond which the step gets no finer."""


def _power(prior: GFamily, columns: int) -> float:
    """How fast an integrand over ln g falls in the end, as a power of g."""
    return 0.5 * (columns + (prior.a if isinstance(prior, HyperG) else 3.0)) - 1.0


def _step(prior: GFamily) -> float:
    return min(WIDEST_STEP, NARROW / min(math.sqrt(_power(prior, MOST_COLUMNS)), FINEST))


def g_step_error(prior: GFamily, columns: int) -> float:
    """Relative error that the steps of `g_nodes` leave in a Bayes factor of so many columns.

    Of an integrand like an inverse gamma density of shape s in g, sharper than which none is, the trapezoid
    rule of step h in ln g misses ``2 |Gamma(s + 2 pi i/h)| / Gamma(s)``.

    Examples
    --------
    >>> g_step_error(HyperG(3.0), 26) < 1e-11
    True
    """
    from scipy.special import loggamma

    s, frequency = _power(prior, columns), 2.0 * math.pi / _step(prior)
    return 2.0 * math.exp(float((loggamma(s + 1j * frequency) - loggamma(s)).real))


def g_nodes(prior: GFamily, n: int) -> tuple[FloatArray, FloatArray]:
    """Nodes of g and the logarithms of their prior weights; the Zellner-Siow scale refers to n rows.

    Examples
    --------
    >>> g, log_weight = g_nodes(HyperG(3.0), 50)
    >>> bool(abs(np.exp(log_weight).sum() - 1.0) < 1e-9)
    True
    """
    if isinstance(prior, GPrior):
        return np.array([prior.g]), np.zeros(1)
    step = _step(prior)
    log_g = np.arange(*LOG_G, step)
    g = np.exp(log_g)
    if isinstance(prior, HyperG):
        density = math.log(prior.a / 2.0 - 1.0) - prior.a / 2.0 * np.log1p(g)
        beyond = (1.0 - prior.a / 2.0) * math.log1p(g[-1])
    else:
        beta = n * prior.scale**2 / 2.0
        density = 0.5 * math.log(beta / math.pi) - 1.5 * log_g - beta / g
        beyond = math.log(2.0) + 0.5 * math.log(beta / math.pi) - 0.5 * log_g[-1]
    log_weight = density + log_g + math.log(step)
    # only the null model sees the tail, to which it is indifferent: others have long decayed there
    log_weight[-1] = np.logaddexp(log_weight[-1] - math.log(2.0), beyond)
    return g, log_weight
