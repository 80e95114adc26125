"""Branch and bound over submodels: those that carry the mass are listed, the rest has a certified bound.

The include/exclude tree is walked depth first. What is below a node is bounded as `selection.bounds` says,
and the node is closed where the bound is below the threshold. What is decided next is chosen anew at each
node: the strongest anchor, or the column to which the bound gives most, so that columns that stand for each
other are settled early and the rest is nearly orthogonal, where the bound is nearly exact. Columns so like
others that their m says nothing are anchors too: on 49 columns that took 370,000 nodes to 3,000.

A node without anchors lists its own model and those with one more column, whose evidence is exact for the
price of the bound; what remains is bounded by the coefficients from the second order on. So the last level of
the tree, which is most of it, is never built: about one node a model listed, 25 us each with 49 columns. The
walk is repeated with lower thresholds rather than best first: a node needs the blocks of one path only, not
20 kB each in a heap, and all passes together take twice the time of the last.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.compiled import compiled, inlined, inner
from imubayes.selection.bounds import (
    FAR,
    TreeProblem,
    additions,
    bring,
    curvature,
    drop,
    has_bit,
    log_sum,
    put_bit,
    put_words,
    within,
)

LOOSE = 1.15
"""Where a decided column had m below its own G^-1 by this factor, m is worked out anew."""

EXCESS = 1.0
"""Log by which a column's bound may exceed what it adds alone; beyond, it becomes an anchor."""

MISSING, NODES, MODELS, DEPTH = range(4)
"""Places in `Listing.sums`."""


class Levels(NamedTuple):
    """The path from the root to a node, one row a level.

    `block` (p + 1, p + 1, p + 1) is the free columns' factor in its first ``free + 1`` rows and columns,
    `column` their numbers, `low` the m of the bound, `tight` m times the diagonal of G^-1; `anchors` how many
    of the leading columns are anchors; `size`, `log_det`, `inside`, `outside` describe what is decided.
    """

    block: FloatArray
    column: NDArray[np.int64]
    low: FloatArray
    tight: FloatArray
    free: NDArray[np.int64]
    anchors: NDArray[np.int64]
    size: NDArray[np.int64]
    log_det: FloatArray
    inside: NDArray[np.uint64]
    outside: NDArray[np.uint64]
    stale: NDArray[np.int64]
    stage: NDArray[np.int64]
    bound: FloatArray


class Listing(NamedTuple):
    """Models listed so far, two words and the log joint of each.

    `sums` (4,): joint probability that is not listed over exp(least), nodes visited, models listed, and the
    level at which the walk stands, -1 at its end.
    """

    words: NDArray[np.uint64]
    log_joint: FloatArray
    sums: FloatArray


def levels(T: FloatArray) -> Levels:
    """Root of the tree over the factor T (p + 1, p + 1), whose columns have prior rows of 1."""
    p = T.shape[0] - 1
    block = np.zeros((p + 1, p + 1, p + 1))
    block[0] = T
    column = np.zeros((p + 1, p), np.int64)
    column[0] = np.arange(p)
    integer, real = np.zeros((5, p + 1), np.int64), np.zeros((2, p + 1))
    integer[0, 0] = p
    integer[3, 0] = 1
    tight = np.zeros((p + 1, p))
    low = np.zeros((p + 1, p))
    words = np.zeros((2, p + 1, 2), np.uint64)
    free, anchors, size, stale, stage = integer
    return Levels(
        block, column, low, tight, free, anchors, size, real[0], words[0], words[1], stale, stage, real[1]
    )


@compiled
def _anchor(problem, levels, d, g, norm2):
    """Move columns that the data want, at least one to one, behind the anchors; return how many there are."""
    A, r, k = levels.block[d], levels.free[d], levels.anchors[d]
    while True:
        additions(A, r, k, g, norm2)
        at = levels.size[d] + k
        best, chosen = 0.0, np.int64(-1)
        for j in range(k, r):
            step = problem.log_prior[at + 1] - problem.log_prior[at]
            odds = g[j] * g[j] / norm2[j] / problem.spread - 0.5 * math.log(norm2[j]) + step
            if odds > best:
                best, chosen = odds, j
        if chosen < 0:
            levels.anchors[d] = k
            return k
        _bring_with(levels, d, chosen, k)
        k += 1


@inner
def _soften(problem, levels, d, g, norm2):
    """Work out m anew and choose the anchors anew: also columns whose m is so low that h^2/m says nothing."""
    r, low = levels.free[d], levels.low[d]
    curvature(levels.block[d], r, low, levels.tight[d])
    levels.anchors[d] = levels.stale[d] = 0
    k = _anchor(problem, levels, d, g, norm2)
    while k < r:
        worst, chosen = EXCESS, np.int64(-1)
        for j in range(k, r):
            excess = g[j] * g[j] * (1.0 / low[j] - 1.0 / norm2[j]) / problem.spread
            if excess > worst:
                worst, chosen = excess, j
        if chosen < 0:
            break
        _bring_with(levels, d, chosen, k)
        k += 1
        additions(levels.block[d], r, k, g, norm2)
    levels.anchors[d] = k


@inner
def _bring_with(levels, d, q, t):
    """Move column q of the node to position t, with all that is known of it."""
    if q == t:
        return
    bring(levels.block[d], levels.free[d], q, t)
    column, low, tight = levels.column[d, q], levels.low[d, q], levels.tight[d, q]
    for k in range(q, t, -1):
        _copy(levels, d, k - 1, d, k)
    levels.column[d, t], levels.low[d, t], levels.tight[d, t] = column, low, tight


@inlined
def _copy(levels, d, k, to, j):
    """Write what is known of column k of node d to place j of node `to`."""
    levels.column[to, j] = levels.column[d, k]
    levels.low[to, j], levels.tight[to, j] = levels.low[d, k], levels.tight[d, k]


@inner
def _bound(problem, levels, d, g, poly, weight):
    """Fill the polynomial of the bound; return the logarithm of its factor.

    ``weight`` (r,) becomes the logarithm of what including each column counts against excluding it.
    """
    A, r, k = levels.block[d], levels.free[d], levels.anchors[d]
    unexplained = 0.0
    for i in range(k, r):
        unexplained += A[i, r] * A[i, r]
    factor = -(unexplained + A[r, r] * A[r, r]) / problem.spread - levels.log_det[d]
    poly[: r + 1] = 0.0
    poly[0] = 1.0
    for j in range(k - 1, -1, -1):
        total = A[j, r]
        for i in range(j + 1, k):
            total -= A[j, i] * weight[i]
        weight[j] = total / A[j, j]
    for j in range(r):
        inside, outside = -math.log(abs(A[j, j])), 0.0
        if j < k:
            outside = -levels.low[d, j] * weight[j] * weight[j] / problem.spread
        else:
            inside += min(g[j] * g[j] / levels.low[d, j], unexplained) / problem.spread
        larger = max(inside, outside)
        factor += larger
        x, y = math.exp(max(inside - larger, FAR)), math.exp(max(outside - larger, FAR))
        for i in range(j + 1, 0, -1):
            poly[i] = y * poly[i] + x * poly[i - 1]
        poly[0] *= y
        weight[j] = inside - outside
    return factor


@inner
def _list(problem, levels, d, g, norm2, least, listing):
    """List a node's model and those with one more column; return the sum of those below `least`."""
    A, r, size = levels.block[d], levels.free[d], levels.size[d]
    rss = A[r, r] * A[r, r]
    for i in range(r):
        rss += A[i, r] * A[i, r]
    own = -rss / problem.spread - levels.log_det[d]
    small = _put(listing, levels.inside[d], np.int64(-1), own + problem.log_prior[size], least)
    for j in range(r):
        column = levels.column[d, j]
        if not within(problem.parents[column], levels.inside[d]):
            continue
        log_joint = own + g[j] * g[j] / norm2[j] / problem.spread - 0.5 * math.log(norm2[j])
        small += _put(listing, levels.inside[d], column, log_joint + problem.log_prior[size + 1], least)
    return small


@compiled
def _put(listing, words, column, log_joint, least):
    """List one model, or return its joint probability over exp(least) where it is smaller."""
    if log_joint < least:
        return math.exp(max(log_joint - least, FAR))
    m = int(listing.sums[MODELS])
    put_words(words, listing.words[m])
    if column >= 0:
        put_bit(listing.words[m], column)
    listing.log_joint[m] = log_joint
    listing.sums[MODELS] += 1
    return 0.0


@inner
def _branch_on(problem, levels, d, weight):
    """Bring the column to decide next to the front: the strongest anchor, or what the bound gives most.

    A column whose parent is undecided waits for its parent.
    """
    r, k = levels.free[d], levels.anchors[d]
    chosen = np.int64(0)
    for j in range(1, k if k else r):
        if weight[j] > weight[chosen]:
            chosen = j
    waits = True
    while waits:
        waits = False
        parents = problem.parents[levels.column[d, chosen]]
        for j in range(r):
            if has_bit(parents, levels.column[d, j]):
                chosen, waits = j, True
                break
    if chosen >= k:
        levels.anchors[d] += 1
    _bring_with(levels, d, chosen, np.int64(0))


@inner
def _examine(problem, levels, d, least, listing, scratch):
    """Close a node by its bound or by listing it, or choose the next column; return whether it is closed."""
    g, norm2, poly, weight = scratch
    r = levels.free[d]
    _anchor(problem, levels, d, g, norm2)
    for attempt in range(2):  # the second time with an m of its own
        factor = _bound(problem, levels, d, g, poly, weight)
        tail = problem.log_prior[levels.size[d] : levels.size[d] + r + 1]
        levels.bound[d] = factor + log_sum(poly[: r + 1], np.int64(0), tail)
        if levels.bound[d] < least:
            listing.sums[MISSING] += math.exp(max(levels.bound[d] - least, FAR))
            return True
        rest = factor + log_sum(poly[: r + 1], np.int64(2), tail)
        if levels.anchors[d] == 0 and rest < least:
            listing.sums[MISSING] += math.exp(max(rest - least, FAR))
            listing.sums[MISSING] += _list(problem, levels, d, g, norm2, least, listing)
            return True
        if attempt or not levels.stale[d]:
            break
        _soften(problem, levels, d, g, norm2)
    _branch_on(problem, levels, d, weight)
    return False


@inner
def _begin(levels, d, skip):
    """Begin a child of node d, of its columns from `skip` on."""
    n = levels.free[d] - skip
    for j in range(n):
        _copy(levels, d, skip + j, d + 1, j)
    levels.free[d + 1] = n
    levels.anchors[d + 1] = max(levels.anchors[d] - skip, 0)
    levels.log_det[d + 1] = levels.log_det[d]
    levels.size[d + 1] = levels.size[d]
    put_words(levels.inside[d], levels.inside[d + 1])
    put_words(levels.outside[d], levels.outside[d + 1])
    levels.stale[d + 1] = levels.stale[d] or levels.tight[d, 0] * LOOSE < 1.0
    levels.stage[d + 1] = 0


@inner
def _include(levels, d):
    """Child with the leading column included: the block without its first row and column."""
    r = levels.free[d]
    _begin(levels, d, np.int64(1))
    for i in range(r):
        for j in range(r):
            levels.block[d + 1, i, j] = levels.block[d, i + 1, j + 1]
    levels.log_det[d + 1] += math.log(abs(levels.block[d, 0, 0]))
    levels.size[d + 1] += 1
    put_bit(levels.inside[d + 1], levels.column[d, 0])


@compiled
def _exclude(levels, d, parents):
    """Child without the leading column, and without those that need it."""
    r = levels.free[d]
    _begin(levels, d, np.int64(0))
    _drop_with(levels, d + 1, np.int64(0), levels.block[d])
    outside = levels.outside[d + 1]
    for j in range(r - 2, -1, -1):
        a, b = parents[levels.column[d + 1, j]]
        if (a & outside[0]) != 0 or (b & outside[1]) != 0:
            _drop_with(levels, d + 1, j, levels.block[d + 1])


@inner
def _drop_with(levels, d, q, A):
    """Take column q out of node d, whose block is still in A, with all that is known of it."""
    r, column = levels.free[d], levels.column[d, q]
    drop(A, r, q, levels.block[d])
    for k in range(q, r - 1):
        _copy(levels, d, k + 1, d, k)
    put_bit(levels.outside[d], column)
    levels.free[d] = r - 1
    if q < levels.anchors[d]:
        levels.anchors[d] -= 1


@compiled
def explore(problem, levels, least, budget, listing):
    """Walk on through the tree, depth first, closing every node whose bound is below `least`.

    It begins at the root, or where the last call left `levels`, and visits `budget` nodes at most. Returns
    whether it came to its end: it did not where the budget or the room for the listing was used up.
    """
    d = int(listing.sums[DEPTH])
    p = levels.column.shape[1]
    scratch = (np.empty(p + 1), np.empty(p + 1), np.empty(p + 1), np.empty(p + 1))
    room, last = len(listing.log_joint) - p - 1, listing.sums[NODES] + budget
    while d >= 0:
        if levels.stage[d] == 0:
            if listing.sums[NODES] >= last or listing.sums[MODELS] > room:
                break
            listing.sums[NODES] += 1
            if _examine(problem, levels, d, least, listing, scratch):
                d -= 1
                continue
            _include(levels, d)
        elif levels.stage[d] == 1:
            _exclude(levels, d, problem.parents)
        else:
            d -= 1
            continue
        levels.stage[d] += 1
        d += 1
    listing.sums[DEPTH] = d
    return d < 0


def best_guess(problem: TreeProblem, levels: Levels) -> float:
    """Log joint probability of a good model, for a first threshold: the root's anchors."""
    scratch = np.zeros((2, levels.column.shape[1] + 1))
    k, A = _anchor(problem, levels, 0, *scratch), levels.block[0]
    log_det = float(np.sum(np.log(np.abs(np.diag(A)[:k]))))
    return float(problem.log_prior[k] - np.sum(A[k:, -1] ** 2) / problem.spread) - log_det


def missing(levels: Levels, listing: Listing, least: float) -> float:
    """Log of a bound on all models that are not listed: what is still open counts with its parent's bound."""
    d = int(listing.sums[DEPTH])
    if d == 0:
        return math.inf
    still_open = [levels.bound[e] for e in range(d) if levels.stage[e] == 1 or e == d - 1]
    with np.errstate(divide="ignore"):
        closed = least + np.log(listing.sums[MISSING])
    return float(np.logaddexp.reduce(np.array([closed, *still_open])))
