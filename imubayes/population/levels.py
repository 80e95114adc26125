"""Likelihood of what units of a class have in common: sessions of units, with errors that are known.

Unit u in session s has the coefficient ``mu + a_u + c_s + d_us``, and its test gives::

    y_us = mu + a_u + c_s + d_us + L_us z_u + e_us

    a_u ~ N(0, unit^2)      what the unit is
    c_s ~ N(0, common^2)    what a session does to all units alike, as temperature would
    d_us ~ N(0, own^2)      what a turn-on does to one unit by itself
    e_us ~ N(0, noise^2)    what the noise of the test leaves, known
    z_u ~ N(0, I)           other coefficients of the unit, in units of their priors' sds

The noise and L are known from the posterior: where the test sees a coefficient only beside others, what
these are is booked to it alike in all sessions of the unit. An error that does not change between sessions
must not count against a change, nor be taken for the scatter of the units.

mu comes in flat; it is integrated out exactly, as are a, c, d and z: unit by unit, then over the sessions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import invert_triangular, with_prior_rows
from imubayes.inference import Share, of_cells

TOLD = 0.19
"""Share of the posterior's precision that must come from the data for a session to tell: less is an sd above
0.9 prior sds, which the verdicts call unresolved."""

NOISELESS = 1e-4
"""Smallest share of an error's variance that is left to the noise, against rounding."""

THREE = (0.185, 0.63, 0.185)
"""Weights of the 5, 50 and 95 % points of a distribution that stand for it (Keefer and Bodily, Management
Science 29, 1983)."""

REACH, APART = 3.5, 0.75
"""Sds of each part of an error that all units share over which it is integrated, and least step in sds of the
mean over units."""

FAINT = 0.1
"""Part of a unit's error by which the size of what others book to a coefficient makes no difference."""

UNTOLD = 100.0
"""Error over the prior's sd above which tests say nothing of a coefficient."""

EXCITED = 1e-6
"""Least part of a prior's precision that a test is taken to add."""

EDGE = 1e5
"""How far the grid of the sd between sessions reaches below the smallest scale of a problem and above its
largest."""

STEP = 0.01
"""Step of the grid in its logarithm; the posterior's own width there is 0.1 at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Likelihoods:
    """One coefficient of several units, session by session, without its own prior, SI.

    `value` (u, s) is NaN where a unit lacks a session, or a session cannot tell. `noise` (u, s) is the sd
    that the noise of the test leaves, `alias` (u, s, k) the error for one prior sd of each of k other
    coefficients.
    """

    value: FloatArray
    noise: FloatArray
    alias: FloatArray

    @property
    def error(self) -> FloatArray:
        """Sd (u, s) of each session's estimate."""
        total = np.hypot(self.noise, np.linalg.norm(self.alias, axis=-1))
        return np.where(np.isfinite(self.value), total, math.nan)

    @property
    def told(self) -> int:
        """Units of which a session tells."""
        return int(np.isfinite(self.value).any(axis=1).sum())


class Version(NamedTuple):
    """What tests may say of n units: estimates and variances (n,), and the sd of an error that all share.

    The weights of several versions sum to one.
    """

    weight: float
    estimate: FloatArray
    variance: FloatArray
    common: float


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Likelihood of the levels of the sessions at each (own, unit): information q and precision M.

    ``log p(y | g) = (log_det - scatter) / 2 + q' g - g' M g / 2`` up to a constant, for the levels g (s,).
    """

    log_det: FloatArray
    scatter: FloatArray
    information: FloatArray
    precision: FloatArray


def without_prior(mean: FloatArray, sd: FloatArray, prior_sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and sd of the likelihood: the posterior divided by its zero-mean prior.

    NaN where the posterior is hardly narrower than the prior (see `TOLD`): the data then cannot tell.

    Examples
    --------
    >>> value, error = without_prior(np.array([1.0, 0.0]), np.array([0.6, 0.99]), np.array([1.0, 1.0]))
    >>> value.round(4).tolist(), error.round(4).tolist()
    ([1.5625, nan], [0.75, nan])
    """
    share = 1.0 - (sd / prior_sd) ** 2
    share = np.where(share >= TOLD, share, math.nan)
    return mean / share, sd / np.sqrt(share)


def likelihoods(mean: FloatArray, sd: FloatArray, prior_sd: FloatArray, pull: FloatArray) -> Likelihoods:
    """Take a coefficient's own prior out of its posteriors (u, s), and split the error that is left.

    `pull` (u, s, k) is the covariance of the coefficient with each of k others, over their priors' sds.

    Examples
    --------
    >>> found = likelihoods(*np.array([[[1.0]], [[0.6]], [[1.0]]]), np.array([[[0.3]]]))
    >>> found.value.round(4).tolist(), found.alias.round(4).tolist(), found.noise.round(4).tolist()
    ([[1.5625]], [[[0.4688]]], [[0.5855]])
    """
    value, error = without_prior(mean, sd, prior_sd)
    share = np.where(np.isfinite(value), 1.0 - (sd / prior_sd) ** 2, math.inf)
    alias = pull / share[..., None]
    known = np.minimum((alias**2).sum(axis=-1), (1.0 - NOISELESS) * error**2)
    return Likelihoods(value, np.sqrt(error**2 - known), alias)


def block_of(likelihood: Likelihoods, own: FloatArray, unit: FloatArray) -> Block:
    """Integrate out what the units are and what their tests book to the coefficient."""
    sessions = likelihood.value.shape[1]
    shape = (len(own), len(unit))
    log_det, scatter = np.zeros(shape), np.zeros(shape)
    information, precision = np.zeros((*shape, sessions)), np.zeros((*shape, sessions, sessions))
    for y, noise, alias in zip(likelihood.value, likelihood.noise, likelihood.alias, strict=True):
        known = np.flatnonzero(np.isfinite(y))
        if not len(known):
            continue
        W, own_log_det = _of_unit(np.diag(noise[known] ** 2) + alias[known] @ alias[known].T, own, unit)
        Wy = W @ y[known]
        log_det += own_log_det
        scatter += Wy @ y[known]
        information[..., known] += Wy
        precision[..., known[:, None], known] += W
    return Block(log_det, scatter, information, precision)


def _of_unit(error: FloatArray, own: FloatArray, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Precision (own, unit, r, r) of r sessions of a unit, and its log determinant."""
    eigenvalues, vectors = np.linalg.eigh(error)
    rest = 1.0 / (eigenvalues + own[:, None] ** 2)
    inverse = (vectors * rest[:, None, :]) @ vectors.T
    ones = inverse.sum(axis=-1)
    total = ones.sum(axis=-1)[:, None]
    gain = 1.0 / (unit**-2.0 + total)
    W = inverse[:, None] - gain[..., None, None] * (ones[:, :, None] * ones[:, None, :])[:, None]
    return W, np.log(rest).sum(axis=-1)[:, None] - np.log1p(unit**2 * total)


def over_sessions(block: Block, common: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density (own, unit, common) with sessions and mu integrated out, and mean and variance of mu."""
    eigenvalues, vectors = np.linalg.eigh(block.precision)
    precision = np.maximum(eigenvalues, 0.0)[..., None, :]
    of_one = vectors.sum(axis=-2)[..., None, :]
    of_data = np.einsum("...ij,...i->...j", vectors, block.information)[..., None, :]
    variance = common[:, None] ** 2
    growth = 1.0 + variance * precision
    a = (of_one**2 * precision / growth).sum(axis=-1)
    b = (of_one * of_data / growth).sum(axis=-1)
    explained = (variance * of_data**2 / growth).sum(axis=-1) + b**2 / a
    log = (block.log_det - block.scatter)[..., None] + explained - np.log(a) - np.log(growth).sum(axis=-1)
    return 0.5 * log, b / a, 1.0 / a


def of_units(likelihood: Likelihoods, own: Share, common: Share) -> tuple[FloatArray, ...]:
    """Weights (m,) of m versions of what its sessions say of each unit: estimates (m, n), variances (m, n).

    Versions are of the sd of what a turn-on does to a unit by itself (`own`), and of what all units have in
    common: of a session's effect (`common`), whose differences between sessions are taken off, the mean; of
    other coefficients half of their variance, as units have their means in common (see `pooled`).
    """
    told = np.isfinite(likelihood.value).any(axis=1)
    kept = Likelihoods(*(values[told] for values in (likelihood.value, likelihood.noise, likelihood.alias)))
    return _joined((share, *_shifted(kept, size, common)) for share, size in _three(own))


def _joined(parts: Iterable[tuple[float, FloatArray, FloatArray, FloatArray]]) -> tuple[FloatArray, ...]:
    """All versions of some cases of these weights."""
    each = [(share * weight, estimate, variance) for share, weight, estimate, variance in parts]
    return tuple(np.concatenate(values) for values in zip(*each, strict=True))


def _three(share: Share) -> list[tuple[float, float]]:
    """Weights and values of three points of a distribution; nothing where it is unknown."""
    if math.isnan(share.value):
        return [(1.0, 0.0)]
    return list(zip(THREE, (share.low, share.value, share.high), strict=True))


def _shifted(likelihood: Likelihoods, own: float, common: Share) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (m,), estimates and variances (m, n) at m values of the error that all units share."""
    known, alias = np.isfinite(likelihood.value), np.nan_to_num(likelihood.alias)
    weight = np.where(known, 1.0 / (likelihood.noise**2 + own**2), 0.0)
    n, each, total = len(weight), weight.sum(axis=1), weight.sum(axis=0)
    smallest = NOISELESS / math.sqrt(float(weight.max()))

    def solved(size: float) -> tuple[FloatArray, float]:
        of_session = np.diag(total + 1.0 / max(size, smallest) ** 2)
        cov = np.linalg.inv(np.block([[np.diag(each), weight], [weight.T, of_session]]))
        alike = float(cov[:n, :n].sum() - np.trace(cov[:n, :n])) / max(n * (n - 1), 1)
        return cov[:n], max(alike, 0.0)

    cov, alike = solved(0.0 if math.isnan(common.value) else common.value)
    weighed = weight * np.nan_to_num(likelihood.value)
    estimate = cov @ np.append(weighed.sum(axis=1), weighed.sum(axis=0))
    booked = np.einsum("us,usk->uk", weight, alias) / each[:, None]
    variance = np.diagonal(cov) - alike + 0.5 * (booked**2).sum(axis=1)
    mean = 0.5 * float((booked.mean(axis=0) ** 2).sum())
    shared = [(share, math.sqrt(solved(size)[1] + mean)) for share, size in _three(common)]
    return _over_shared(shared, estimate, variance)


def of_tests(
    R: Sequence[FloatArray], prior_sd: FloatArray, shared: FloatArray, sizes: FloatArray
) -> list[list[Version]]:
    """What the tests of n units say of each of p terms without its own prior: versions of it.

    R (p + 1, p + 1) is the whitened factor of each. The other terms are normal in the units of a lot, which
    share the part `shared` (p,) of their variance. `sizes` (m, p) are sds that they may have in it, each row
    as likely; a version stands for a row. Apart from each other the units are known beside what the others
    are in each by itself; their mean beside the mean of the others, with a variance n times as large as that
    for the error of one test: the more units, the less it leans on priors.
    """
    n, by_size = len(R), list[tuple[FloatArray, FloatArray, FloatArray]]()
    for sd in sizes:
        value, variance, about, error = _of_each(R, np.sqrt(1.0 - shared) * sd)
        _, _, mean, of_mean = _of_each(R, np.sqrt(n * shared + 1.0 - shared) * sd)
        by_size.append((value - about + mean, variance, np.sqrt(np.maximum(of_mean - error, 0.0))))
    each = 1.0 / len(by_size)
    every = [
        [Version(each, t[:, j], v[:, j], float(c[j])) for t, v, c in by_size] for j in range(len(prior_sd))
    ]
    return [_different(versions, sd) for versions, sd in zip(every, prior_sd.tolist(), strict=True)]


def _of_each(R: Sequence[FloatArray], sd: FloatArray) -> tuple[FloatArray, ...]:
    """Value and variance (n, p) of each unit, beside others of these sds, and (p,) of the mean of all."""
    value, variance = np.moveaxis(np.array([without_own(root, sd) for root in R]), 1, 0)
    precision = 1.0 / variance
    total = precision.sum(axis=0)
    return value, variance, (precision * value).sum(axis=0) / total, 1.0 / total


def without_own(R: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value and variance (p,) of each coefficient without its own prior, beside those of the others."""
    T = with_prior_rows(R, 1.0 / sd)
    inverse = invert_triangular(T[:-1, :-1])
    variance = (inverse**2).sum(axis=1)
    share = np.maximum(1.0 - variance / sd**2, EXCITED)
    return inverse @ T[:-1, -1] / share, variance / share


def _different(versions: list[Version], prior_sd: float) -> list[Version]:
    """Versions of a term; the middle one where the others' size makes no difference, or nothing is told."""
    middle = versions[len(versions) // 2]
    sd = np.sqrt(middle.variance)
    if sd.min() > UNTOLD * prior_sd:
        return [middle._replace(weight=1.0, common=0.0)]
    moved = max(float(np.max(np.abs(version.estimate - middle.estimate) / sd)) for version in versions)
    grown = max(float(np.max(np.abs(version.variance / middle.variance - 1.0))) for version in versions)
    common = max(version.common for version in versions) * math.sqrt(float((1.0 / middle.variance).sum()))
    return [middle._replace(weight=1.0)] if max(moved, grown, common) < FAINT else versions


def of_versions(versions: Iterable[Version]) -> tuple[FloatArray, ...]:
    """Versions as `of_units` has them: of each more, by what the shared error may be."""
    return _joined(
        (version.weight, *_over_shared([(1.0, version.common)], version.estimate, version.variance))
        for version in versions
    )


def _over_shared(
    shared: Sequence[tuple[float, float]], estimate: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (m,), estimates and variances (m, n) of units at values of an error that they share.

    The error is a mixture of normals about zero, of these weights and sds. The values are dense over each of
    them, where it would bring a unit to zero, and where all of them.
    """
    share, size = np.array(shared).T
    sd, precision = np.sqrt(variance), 1.0 / variance
    fine = APART / math.sqrt(float(precision.sum()))
    if size.max() < fine:
        return np.ones(1), estimate[None], variance[None]
    near = estimate[:, None] + sd[:, None] * np.arange(-4.0, 5.0, 2.0)
    middle = float(precision @ estimate / precision.sum()) + fine * np.arange(-6.0, 7.0, 2.0)
    values = np.sort(np.concatenate([*np.outer(size, np.linspace(-REACH, REACH, 15)), *near]))
    cell = np.floor(values / (APART * min(float(sd.min()), max(float(size.min()), fine))))
    values = np.sort(np.append(values[np.append(True, cell[1:] > cell[:-1])], middle))
    values = values[np.abs(values) <= REACH * size.max()]
    size = np.maximum(size, fine)
    weight = np.gradient(values) * (np.exp(-0.5 * (values[:, None] / size) ** 2) @ (share / size))
    return weight / weight.sum(), estimate - values[:, None], np.tile(variance, (len(values), 1))


def scatter_p(blocks: Sequence[Likelihoods]) -> float:
    """Chi-square probability of the scatter of the sessions about their units' means."""
    from scipy.special import gammaincc

    freedom = sum(int(np.isfinite(likelihood.value).sum()) - likelihood.told for likelihood in blocks)
    if not freedom:
        return math.nan
    anywhere, nothing = np.array([math.inf]), np.zeros(1)
    total = sum(
        float(block_of(_about_units(likelihood), nothing, anywhere).scatter[0, 0]) for likelihood in blocks
    )
    return float(gammaincc(0.5 * freedom, 0.5 * total))


def _about_units(likelihood: Likelihoods) -> Likelihoods:
    """Sessions about the means of their units, which keeps the digits of a scatter far below these."""
    known = np.isfinite(likelihood.value)
    mean = np.sum(likelihood.value, axis=1, where=known) / np.maximum(known.sum(axis=1), 1)
    return replace(likelihood, value=likelihood.value - mean[:, None])


def between_sd(likelihood: Likelihoods, scale: float) -> tuple[float, float, float]:
    """Mean, 5 % and 95 % points of the posterior of the sd between sessions, as if units were anywhere.

    Of some unit there are two sessions at least that tell. The prior of tau is half-Cauchy (Gelman, Bayesian
    Analysis 2006). Its `scale` is the prior sd of the parameter: a coefficient that changed by more than its
    class's size at every power-up would not be called one. It is flat for the much smaller changes that
    sensors have, and its tail keeps the posterior proper where two sessions of one unit are all there is.
    """
    about = _about_units(likelihood)
    sizes = [
        scale,
        float(np.nanmin(likelihood.error)),
        float(np.nanmax(likelihood.error)),
        float(np.nanmax(np.abs(about.value))),
    ]
    low, high = math.log(min(sizes[:3]) / EDGE), math.log(max(sizes) * EDGE)
    tau = np.exp(np.linspace(low, high, math.ceil((high - low) / STEP)))
    seen = block_of(about, tau, np.array([max(sizes) * EDGE**2]))
    log = 0.5 * (seen.log_det - seen.scatter)[:, 0] - np.log1p((tau / scale) ** 2) + np.log(tau)
    weight = np.exp(log - log.max())
    share = of_cells(tau, weight)
    return float(weight @ tau / weight.sum()), share.low, share.high
