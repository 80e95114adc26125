"""Every model's evidence: added up over noise scales, or with the scale integrated under the g-family.

Over noise scales weights are added up by products where doubles hold them, else by logs.

Under the g-family the scale is integrated analytically. Of the data a model's Bayes factor takes its share u
of unexplained squares and its size, so that with a prior on g one curve by size, over ln u, serves all
models. With many rows all of it happens near u = 1: the curves are followed in steps of ``ln(1 - dof ln u)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray, IntArray
from imubayes.algebra.digits import HALF_UNIT
from imubayes.inference.prior import GFamily, g_step_error
from imubayes.selection.mixture import Candidates, log_flat
from imubayes.selection.model_sets import BLOCK_BITS, Needs, Space, admissible, pieces, sizes, subset_sums

FAR = 300.0
"""Logarithm by which a scale may stand above the level of the sums before they are brought to it."""

NOTHING = 100.0
"""Log by which a scale may fall below the highest before it is nothing beside it: 4e-44."""


@dataclass(slots=True, eq=False)
class Sums:
    """Sums over noise scales, ``weight * exp(level)`` by mask (2^p,); `by_size` is a model's log prior.

    The height is the largest logarithm of what all models have together at a scale so far.
    """

    candidates: Candidates
    by_size: FloatArray
    needs: Needs
    weight: FloatArray
    level: float = math.nan
    height: float = -math.inf

    def add(self, scale: float, log_share: float = 0.0) -> float:
        """Add every model at a noise scale, by its share; return the log of what they have there together.

        By products, a few nanoseconds a model, where the models that matter are far from what a number cannot
        hold; else by logarithms, an order slower. No model has more than the fit of all of them would have
        without the cost of its width: where that is nothing beside other scales it is returned, and not
        added.
        """
        from imubayes.selection import lanes

        c, a, T = self.candidates, len(self.candidates.always), self.candidates.at(scale)
        found, common = -math.inf, log_flat(c, T, scale) + log_share
        factor = common - 0.5 * (float(T[-1, -1]) / scale) ** 2
        if factor - log_share < self.height - NOTHING:
            return factor - log_share
        R, width = lanes.ready(T[a:, a:] / scale, 1.0 / c.sd[a:])
        if lanes.storable(R, width):
            self._raise_to(factor, FAR)
            log_factor = factor - self.level
            added = lanes.add_weights(
                self.weight, R, width, self.by_size, log_factor=log_factor, needs=self.needs
            )
            found = self.level + math.log(added) if added > 0.0 else -math.inf
        if not found > self.level + lanes.DEEPEST:
            rss, log_det = lanes.walk(T[a:, a:])
            logs = common - rss / (2.0 * scale**2) - log_det
            logs += subset_sums(np.log(scale / c.sd[a:])) + self.by_size[sizes(len(c.names))]
            logs[~admissible(Space(len(c.names)), self.needs)] = -math.inf
            most = float(logs.max())
            self._raise_to(most, 0.0)
            added = np.exp(logs - self.level)
            self.weight += added
            found = self.level + math.log(total) if (total := float(added.sum())) > 0.0 else most
        self.height = max(self.height, found - log_share)
        return found - log_share

    def clear(self) -> None:
        """Take back all that was added."""
        self.weight[:], self.level, self.height = 0.0, math.nan, -math.inf

    def _raise_to(self, level: float, far: float) -> None:
        """Take another level where what comes stands that far above the sums."""
        if math.isnan(self.level):
            self.level = level
        if level > self.level + far:
            self.weight *= math.exp(max(self.level - level, -700.0))
            self.level = level


POINTS = 2**10
"""Of a curve: its cubics are off by 1e-8 at most."""

BETWEEN = 97
"""Places between the points of a curve at which its error is taken."""

ROUNDINGS = 4.0
"""Of a logarithm of a Bayes factor, in units of half a unit of ``dof ln(1 + g)``."""

LEAST_POWER = 0.5
"""Power of g that the integrand of a model with a candidate falls with at least, at both ends of ln g."""

FLAT = 1e-12
"""Of g u: below, u no longer changes the Bayes factor."""


CHUNK_BITS = 12
"""Weights that stay in the first cache, with what exponentials of them need."""


class Curves(NamedTuple):
    """What the integrals over g make of a model, by its size k and its share u of unexplained squares.

    Attributes
    ----------
    at : least ln u, and step of the cubics in ``t = ln(1 - dof ln u)``; 1/(1 + g) of the largest g.
    cubics : (p + 1, points - 1, 5, 4) of the log Bayes factor plus ``dof/2 ln r``, r at the largest g, the
        mean of s, its variance over r^2, and the means of ``s r`` and r over it (see `kernels.g_integrals`):
        what is followed hardly changes, and of a single g not at all.
    dof, off : rows minus forced columns; largest error of a log Bayes factor.
    """

    dof: float
    at: tuple[float, float, float]
    cubics: FloatArray
    off: float


def log_bayes_factors(
    rss: FloatArray, c: Candidates, curves: Curves, by_size: FloatArray, needs: Needs
) -> float:
    """Put the log joint probability of each model, up to the null's evidence, in the place of its rss (2^p,).

    A model with a child without its parent gets -inf. Returns the largest.
    """
    from imubayes.selection import kernels

    p, total, factor = len(c.names), float(rss[0]), np.ascontiguousarray(curves.cubics[:, :, 0])
    bits, links = min(BLOCK_BITS, p), np.array(needs, dtype=np.int64).reshape(-1, 2)
    count, n = sizes(bits), 1 << min(kernels.CHUNK_BITS, bits)

    def take_logs(k: int) -> float:
        x, powers = np.empty(2 * n), np.empty(2 * n, dtype=np.int64)
        room = x, x.view(np.int64), x[:n], powers
        return kernels.log_factors(rss, k, count, total, curves.dof, curves.at, factor, links, by_size, room)

    return max(pieces(take_logs, 1 << (p - bits)))


def integration_error(
    prior: GFamily, nodes: tuple[FloatArray, FloatArray], least: float, columns: int, dof: float
) -> float:
    """Bound on the error of every log Bayes factor: of the steps of g, of where it ends, and of rounding.

    `nodes` are those of g with the logarithms of their weights, `least` is the smallest share of unexplained
    squares, that of all candidates, of which there are `columns`; `dof` are rows minus forced columns.
    """
    g, log_weight = nodes
    usual = min(float(g.max()), dof / least if least > 0.0 else math.inf)
    rounding = ROUNDINGS * HALF_UNIT * dof * math.log1p(usual)
    if len(g) == 1 or not columns:
        return rounding
    step = math.log(g[1] / g[0])
    ends = 0.0
    for size, u in product((1, columns), (least, 1.0)):
        terms = 0.5 * (dof - size) * np.log1p(g) - 0.5 * dof * np.log1p(g * u) + log_weight
        weights = np.exp(terms - terms.max())
        ends = max(ends, float((weights[0] + weights[-1]) / weights.sum()) / (step * LEAST_POWER))
    return rounding + g_step_error(prior, columns) + ends


def weights_of(logs: FloatArray, p: int, peak: float) -> FloatArray:
    """Put ``exp(logs - peak)`` in the place of logarithms (2^p,)."""
    from imubayes.selection.kernels import exponentials

    bits = min(BLOCK_BITS, p)
    blocks = logs.reshape(1 << (p - bits), -1, 1 << min(CHUNK_BITS, bits))

    def exponentiate(block: FloatArray) -> None:
        powers = np.empty(block.shape[1], dtype=np.int64)
        for chunk in block:
            exponentials(chunk, 1.0, peak, powers, powers.view(np.float64))

    pieces(lambda k: exponentiate(blocks[k]), len(blocks))
    return logs


def g_curves(least: float, p: int, dof: float, nodes: tuple[FloatArray, FloatArray]) -> Curves:
    """Follow the integrals over g of all models (see `integration_error` for what is given)."""
    from scipy.interpolate import CubicSpline

    start = math.log(max(least, FLAT / float(nodes[0].max())) * (1.0 - 1e-9))
    floor = 1.0 / (1.0 + float(nodes[0].max()))
    t, step = np.linspace(0.0, math.log1p(-dof * start), POINTS, retstep=True)
    spline = CubicSpline(t, _curves(t, np.arange(p + 1), dof, nodes), axis=1)
    between = t[:: POINTS // BETWEEN][:-1] + 0.5 * step
    some = np.array([1, p])
    off = float(np.abs(spline(between)[some] - _curves(between, some, dof, nodes))[:, :, 0].max())
    cubics = np.moveaxis(spline.c * (step ** np.arange(3, -1, -1))[:, None, None, None], (0, 2), (3, 0))
    return Curves(dof, (start, float(step), floor), cubics, off)


def integrals_at(curves: Curves, u: FloatArray, size: IntArray) -> FloatArray:
    """Read (m, 5) as `kernels.g_integrals` has them off the curves, at shares u of models of these sizes."""
    log_u = np.clip(np.log(np.maximum(u, np.finfo(float).tiny)), curves.at[0], 0.0)
    x, r = np.log1p(-curves.dof * log_u) / curves.at[1], _left(log_u, curves.at[2])
    place = np.minimum(x.astype(np.int64), curves.cubics.shape[1] - 1)
    powers = (x - place)[:, None] ** np.arange(3.0, -1.0, -1.0)
    found = np.einsum("mij,mj->mi", curves.cubics[size, place], powers)
    found[:, 0] -= 0.5 * curves.dof * np.log(r)
    found[:, 2:] *= np.column_stack((r**2, r, r))
    return found


def _left(log_u: FloatArray, floor: float) -> FloatArray:
    """``r = (1 + g u)/(1 + g)`` where 1/(1 + g) is the floor."""
    u = np.exp(log_u)
    return u + floor * (1.0 - u)


def _curves(t: FloatArray, size: IntArray, dof: float, nodes: tuple[FloatArray, FloatArray]) -> FloatArray:
    """What is interpolated (k, t, 5) of the integrals of the models of some sizes (k,)."""
    from imubayes.selection.kernels import g_integrals

    log_u = -np.expm1(t) / dof
    r = _left(log_u, 1.0 / (1.0 + float(nodes[0].max())))
    each = g_integrals(np.repeat(np.exp(log_u), len(size)), np.tile(size, len(t)), dof, *nodes)
    found = each.reshape(len(t), len(size), 5).swapaxes(0, 1)
    found[:, :, 0] = np.where(size[:, None] > 0, found[:, :, 0] + 0.5 * dof * np.log(r), 0.0)
    found[:, :, 2:] /= np.column_stack((r**2, r, r))
    return found
