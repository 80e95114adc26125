"""Every submodel of a factor at a few nanoseconds each: one tree, 32 subtrees of it side by side.

The tree decides a column at each depth. Including the leading column of the trailing factor costs nothing:
its row is explained. Excluding it leaves an upper Hessenberg block that Givens rotations make triangular
again. Deep blocks are small and most nodes are deep, so a model costs a constant number of operations,
whatever p (the dropping-columns tree of Gatu and Kontoghiorghes, 2003). Prior rows stacked under the data's
before the walk need no care: with its column, a prior row becomes zero and rotates away.

The first `LANE_BITS` columns are decided for each lane, and the same steps then serve all lanes at once, as
vector instructions: all subtrees have the same shape. A few more columns are decided for each of the pieces
that threads share. Determinants are carried as products, which takes no logarithm a model; weights that these
cannot hold (`storable`) are made of the logarithms of `walk`.

A model's number is its mask, as in `model_sets`: the piece's bits, then the outer columns', and those of the
leaves, the last columns, whose 2^q models are a block that stays in the cache; the lane's are the lowest, so
that a block is written as it stands.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.compiled import compiled, inlined, inner
from imubayes.selection.kernels import exponentials, ones, places, reduce
from imubayes.selection.model_sets import Needs, pieces, subset_sums

LANE_BITS = 5
"""Columns that the lanes decide: 32 numbers are four to eight registers, and the leaves' factors fit in the
first cache. Of 8, 16, 32, 64 and 128 lanes this is the fastest: 4.2 ns a model where one lane takes 28."""

PIECE_BITS = 6
"""Most columns that the pieces decide: 64 pieces keep up to 16 threads busy."""

ALONE = 16
"""Candidates up to which there is one piece: less than a millisecond's work is not worth a thread."""

LEAF_BITS = 7
"""Columns of a block of leaves: 2^7 models in 32 lanes are 32 kB."""

FEWEST = 8
"""Candidates from which on there are leaves enough for the lanes; columns without data make up for fewer."""

SMALL = 1e-300
"""Where products of inverse pivots begin: of columns of unit size none is below one, and many are large."""

DEEPEST = -600.0
"""Smallest logarithm that a product may reach: exp(-708) is the least normal number."""

Kernel = tuple[int, int, int]
"""(piece, leaf, candidates): how the columns after the lanes' are shared."""


def shape_of(p: int) -> Kernel:
    """Columns that pieces, and leaves, decide of p candidates.

    Examples
    --------
    >>> shape_of(26), shape_of(8)
    ((6, 7, 26), (0, 3, 8))
    """
    left = p - LANE_BITS
    leaf = min(LEAF_BITS, left)
    return min(PIECE_BITS, max(p - ALONE, 0)), leaf, p


def order_of(p: int) -> list[int]:
    """Numbers of p columns in the order in which they are decided.

    Examples
    --------
    >>> order_of(8)
    [4, 3, 2, 1, 0, 7, 6, 5]
    """
    return [*range(LANE_BITS - 1, -1, -1), *range(p - 1, LANE_BITS - 1, -1)]


def ready(R: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factor and widths as the walk takes them: in the order of `order_of`, columns of about unit size.

    The units are powers of two, which round nothing, and leave the residual as it was. Columns of ones on the
    diagonal come beside fewer than `FEWEST`: the models with one of them have the last masks.
    """
    p, order = len(width), order_of(max(len(width), FEWEST))
    own = [place for place, column in enumerate(order) if column < p]
    kept = [order[place] for place in own]
    turned = np.asarray(np.linalg.qr(R[:, [*kept, p]], mode="r"))
    size = np.frexp(np.linalg.norm(turned[:, :-1], axis=0))[1]
    whole, widths, places = np.eye(len(order) + 1), np.ones(len(order)), [*own, len(order)]
    whole[np.ix_(places, places)] = np.ldexp(turned, -np.append(size, 0))
    widths[own] = np.ldexp(width[kept], -size)
    return whole, widths


def storable(R: FloatArray, width: FloatArray) -> bool:
    """Whether every product of widths over pivots stays within what a number can hold."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(width / np.linalg.norm(R[:, :-1], axis=0))
    return bool(np.all(np.isfinite(ratio)) and ratio.sum() > DEEPEST and np.isfinite(R).all())


def add_weights(
    weight: FloatArray,
    R: FloatArray,
    width: FloatArray,
    by_size: FloatArray,
    *,
    log_factor: float,
    needs: Needs = (),
) -> float:
    """Add to every model's weight what it has at one noise scale; return the sum of what was added.

    A model's weight is ``exp(log_factor + by_size_k - (rss - least)/2) * prod(width_j / |r_jj|)``, with r its
    own triangular factor and `least` the residual sum of squares of the model with every column.

    Parameters
    ----------
    weight : (2^p,) to add to, by mask.
    R : (p + 1, p + 1) triangular factor in units of the noise, prior rows included; `ready`, `storable`.
    width : (p,) of the columns: prior rows, in the same units.
    by_size : (p + 1,) log prior probability of one model of each size.
    log_factor : common to all models.
    needs : (child, parent): a model that has a child without its parent gets nothing.
    """
    kernel = shape_of(len(R) - 1)
    lane_sizes = np.array([number.bit_count() for number in range(1 << LANE_BITS)])
    sizes = np.arange(kernel[2] - LANE_BITS + 1)[:, None] + lane_sizes
    table = np.exp(np.append(by_size, np.full(len(R) - len(by_size), -np.inf)))[sizes]
    links = np.array(needs, dtype=np.int64).reshape(-1, 2)
    added, factor = weight if len(by_size) == len(R) else np.zeros(1 << kernel[2]), math.exp(log_factor)
    sums = pieces(
        lambda piece: _visit(R, width, piece, kernel, factor, table, links, added, added[:0], _room(kernel)),
        1 << kernel[0],
    )
    if added is weight:
        return math.fsum(sums)
    weight += added[: len(weight)]
    return float(added[: len(weight)].sum())


def walk(R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residual sum of squares and log determinant of every submodel.

    R (p + 1, p + 1) is the triangular factor of ``[X y]``, prior rows included. What is returned (2^p,) is
    indexed by the mask of included columns; the log determinant is the sum of ``ln |r_jj|`` over the model's
    own triangular factor.

    Examples
    --------
    >>> rss, log_det = walk(np.array([[2.0, 1.0], [0.0, 3.0]]))
    >>> rss.round(9).tolist(), (log_det / math.log(2)).round(9).tolist()
    ([10.0, 9.0], [0.0, 1.0])
    """
    p = len(R) - 1
    turned, unit = ready(R, np.ones(p))
    rss, product = np.empty((2, 1 << max(p, FEWEST)))
    _keep(turned, rss, product)
    own, log_det = np.argsort(order_of(len(unit)))[:p], product[: 1 << p]
    with np.errstate(divide="ignore"):
        np.log(log_det, out=log_det)
    log_det += subset_sums(np.log(unit[own]))
    return rss[: 1 << p], np.subtract(math.log(SMALL), log_det, out=log_det)


def residuals(R: FloatArray) -> FloatArray:
    """Residual sum of squares of every submodel (2^p,), as `walk` has it, without the determinants."""
    p = len(R) - 1
    rss = np.empty(1 << max(p, FEWEST))
    _keep(ready(R, np.ones(p))[0], rss, rss[:0])
    return rss[: 1 << p]


def _keep(R: FloatArray, rss: FloatArray, product: FloatArray) -> None:
    """Write every model's residual sum of squares, and where there is room its product of inverse pivots."""
    p = len(R) - 1
    kernel, table, links = shape_of(p), np.empty((0, 0)), np.empty((0, 2), np.int64)
    ones = np.ones(p)
    pieces(
        lambda piece: _visit(R, ones, piece, kernel, SMALL, table, links, rss, product, _room(kernel)),
        1 << kernel[0],
    )


def _room(kernel: Kernel) -> tuple[Any, ...]:
    """Room of a piece to work in: its state (see `started`), its leaves, and for the model it starts at."""
    piece_bits, leaf, p = kernel
    lanes, m = 1 << LANE_BITS, p - LANE_BITS - piece_bits + 1
    factors, inverse, own = np.empty((m, m, m, lanes)), np.empty((m, m, lanes)), np.empty((3, m, lanes))
    bits = np.empty(lanes << leaf, dtype=np.int64)
    leaves = (*np.empty((2, len(bits))), bits, bits.view(np.float64), np.zeros(lanes))
    state = (factors, inverse, np.zeros(m, dtype=np.int64), *own, np.empty((2, lanes)))
    return state, leaves, (np.empty(p, dtype=np.bool_), places(p + 1))


@compiled
def _visit(R, width, piece, kernel, factor, table, links, out, products, room):
    """Add the weights of one piece to `out`, and return their sum.

    Without a table of weights by size (m, lanes) put residual sums of squares there, and products of inverse
    pivots in `products` unless that is empty.
    """
    piece_bits, leaf, p = kernel
    state, (rss, product, bits, power, totals), start = room
    started(R, width, piece, kernel, factor, state, start)
    widths = width[LANE_BITS + piece_bits :]
    end, inner, many = len(widths) - leaf, leaf - 2, 1 << (leaf + LANE_BITS)
    least, total = R[p, p] * R[p, p], 0.0
    for mask in range((1 << (end + inner)) - 1, -1, -1):
        decide(state, widths, mask)
        leaf_models(state, widths, mask & ((1 << inner) - 1), rss, product)
        if mask & ((1 << inner) - 1):
            continue
        high = (piece << end) | (mask >> inner)
        start, above = high * many, ones(high)
        if len(table) == 0:
            for i in range(many):
                out[start + i] = rss[i]
            if len(products) > 0:
                for i in range(many):
                    products[start + i] = product[i]
            continue
        for n in range(len(links)):  # nothing for a child without its parent
            for i in range(many):
                if ((start + i) >> links[n, 0]) & 1 > ((start + i) >> links[n, 1]) & 1:
                    product[i] = 0.0
        exponentials(rss, -0.5, least, bits, power)
        for i in range(1 << leaf):
            size, at = above + ones(i), i << LANE_BITS
            for lane in range(1 << LANE_BITS):
                added = product[at + lane] * rss[at + lane] * table[size, lane]
                out[start + at + lane] += added
                totals[lane] += added
    for lane in range(1 << LANE_BITS):
        total += totals[lane]
    return total


@inner
def started(R, width, piece, kernel, factor, state, start):
    """Put what follows the columns of lanes and piece in the state.

    `start` is room for which columns are inside, and for their `imubayes.selection.kernels.submodel`.
    ``state[0][block[d]]`` and ``state[1][block[d]]`` are the factors that depth d looks at and their inverse
    pivots, ``state[3]`` and ``state[4]`` the residuals and products so far; the last are room to work in.
    """
    piece_bits, _, p = kernel
    blocks, inverse, _, left, product, _, _ = state
    inside, own = start
    T, columns = own
    top = LANE_BITS + piece_bits
    for lane in range(1 << LANE_BITS):
        mask, logs = (lane << piece_bits) | piece, 0.0
        for d in range(p):
            inside[d] = d >= top or mask >> (top - 1 - d) & 1
        first, added = reduce(R, inside, own)
        for d in range(first, top):
            logs += math.log(width[columns[d]] / T[d, d])
        left[0, lane], product[0, lane] = R[p, p] * R[p, p] + added, factor * math.exp(logs)
        for d in range(top, p):
            inverse[0, d - top, lane] = 1.0 / T[d, d]
            for k in range(d, p + 1):
                blocks[0, d - top, k - top, lane] = T[d, k]


@inner
def leaf_models(state, width, number, rss, product):
    """Residuals and products (2^q lanes,) of the four models of the last two columns, which share a rotation.

    Their block of leaves has them under four times the `number`.
    """
    blocks, inverse, block, left, so_far = state[:5]
    p, lanes = len(width), left.shape[1]
    at, none = block[p - 2], 4 * number * lanes
    second, first, both = none + lanes, none + 2 * lanes, none + 3 * lanes
    for lane in range(lanes):
        shared, z = blocks[at, p - 2, p - 1, lane], blocks[at, p - 2, p, lane]
        a, end = blocks[at, p - 1, p - 1, lane], blocks[at, p - 1, p, lane]
        base, weight = left[p - 2, lane], so_far[p - 2, lane]
        norm = math.sqrt(shared * shared + a * a)
        each = 1.0 / norm
        c, t = (a * each, shared * each) if norm > 0.0 else (1.0, 0.0)
        out, kept = c * z - t * end, c * end + t * z
        with_first = weight * width[p - 2] * inverse[at, p - 2, lane]
        rss[both + lane] = base
        product[both + lane] = with_first * width[p - 1] * inverse[at, p - 1, lane]
        rss[first + lane], product[first + lane] = base + end * end, with_first
        rss[second + lane], product[second + lane] = base + out * out, weight * width[p - 1] * each
        rss[none + lane], product[none + lane] = base + out * out + kept * kept, weight


@inlined
def decide(state, width, mask):
    """Go on to the next mask of all but the last two columns; masks come from all-included down.

    Only what lies below the deepest bit that changed is done again: that column is excluded, those after it
    are included.
    """
    blocks, inverse, block, left, product, carry, turn = state
    depth, end, lanes = 0, len(width) - 2, left.shape[1]
    if mask + 1 < 1 << end:
        depth, bit = end - 1, 1
        while (mask + 1) & bit == 0:
            depth, bit = depth - 1, bit << 1
        _exclude(blocks, inverse, block[depth], depth, carry, turn)
        depth += 1
        for lane in range(lanes):
            left[depth, lane] = left[depth - 1, lane] + carry[-1, lane] * carry[-1, lane]
            product[depth, lane] = product[depth - 1, lane]
        block[depth] = depth
    for d in range(depth, end):
        source = block[d]
        block[d + 1] = source
        for lane in range(lanes):
            left[d + 1, lane] = left[d, lane]
            product[d + 1, lane] = product[d, lane] * width[d] * inverse[source, d, lane]


@inlined
def _exclude(blocks, inverse, source, d, carry, turn):
    """Make block d + 1 from a source by excluding column d; the row that lost its pivot ends in `carry`."""
    p, lanes, to = blocks.shape[1] - 1, blocks.shape[3], d + 1
    for k in range(d + 1, p + 1):
        for lane in range(lanes):
            carry[k, lane] = blocks[source, d, k, lane]
    for i in range(d + 1, p):
        for lane in range(lanes):
            a, b = carry[i, lane], blocks[source, i, i, lane]
            norm = math.sqrt(a * a + b * b)
            each = 1.0 / norm
            blocks[to, i, i, lane], inverse[to, i, lane] = norm, each
            turn[0, lane] = b * each if norm > 0.0 else 1.0
            turn[1, lane] = a * each if norm > 0.0 else 0.0
        for k in range(i + 1, p + 1):
            for lane in range(lanes):
                u, v = carry[k, lane], blocks[source, i, k, lane]
                blocks[to, i, k, lane] = turn[0, lane] * v + turn[1, lane] * u
                carry[k, lane] = turn[0, lane] * u - turn[1, lane] * v
