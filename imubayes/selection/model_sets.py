"""The models that a posterior is over, their prior, sums over all 2^p, and the threads that share the work.

A space is all subsets of the candidates, numbered by masks (bit j is set where candidate j is in the model),
or a list of those that carry the posterior.

Work on all of them is cut in pieces that do not depend on the threads, and what the pieces give comes back in
their order: the same numbers whatever the threads. Plain threads carry it, since compiled code releases the
interpreter's lock: numba's own threading layers may not be entered from two threads at once, nor after a
fork.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import parent_process
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray, IntArray
from imubayes.errors import TermError


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """Models over p candidates: all 2^p subsets, numbered by masks, or a list of some, inside (m, p).

    The model with every candidate is the last.
    """

    p: int
    inside: BoolArray | None = None

    @classmethod
    def of(cls, inside: BoolArray) -> Space:
        """List of models (m, p)."""
        return cls(inside.shape[1], inside)

    @property
    def every(self) -> bool:
        """Whether all subsets are there."""
        return self.inside is None

    def __len__(self) -> int:
        return 1 << self.p if self.inside is None else len(self.inside)

    def sizes(self) -> IntArray:
        """Candidates in each model: (m,)."""
        return sizes(self.p) if self.inside is None else self.inside.sum(axis=1)

    def sums(self, weight: FloatArray) -> tuple[FloatArray, float]:
        """Sum of the weights of the models with each candidate (p,), and of all."""
        if self.inside is None:
            return tally(weight, self.p)[:2]
        return weight @ self.inside, float(weight.sum())

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape that an array (m,) over the models takes for `where`."""
        return (2,) * self.p if self.inside is None else (len(self.inside),)

    def where(self, there: Collection[int], absent: Collection[int] = ()) -> Any:
        """Index of the models with every one of the candidates `there` and none of the `absent`.

        Examples
        --------
        >>> space = Space(2)
        >>> np.arange(4).reshape(space.shape)[space.where([1])].tolist()
        [2, 3]
        """
        if self.inside is not None:
            return self.inside[:, list(there)].all(axis=1) & ~self.inside[:, list(absent)].any(axis=1)
        return tuple(1 if k in there else 0 if k in absent else slice(None) for k in reversed(range(self.p)))

    def members(self, which: IntArray) -> BoolArray:
        """Which candidates are in the models numbered `which` (k,): (k, p)."""
        if self.inside is not None:
            return self.inside[which]
        return ((which[:, None] >> np.arange(self.p)) & 1).astype(bool)


def admissible(space: Space, needs: Sequence[tuple[int, int]]) -> BoolArray:
    """Which models (m,) of a space hold the parent of every child that they hold, both by number."""
    allowed = np.ones(len(space), dtype=bool)
    for child, parent in needs:
        allowed.reshape(space.shape)[space.where([child], [parent])] = False
    return allowed


def listed(inside: BoolArray, weight: FloatArray) -> tuple[Space, FloatArray]:
    """Models (m, p) and their weights (m,), with the model of every candidate last, if only at weight 0.

    Examples
    --------
    >>> space, weight = listed(np.array([[True, True], [False, True]]), np.array([0.3, 0.7]))
    >>> space.inside.tolist(), weight.tolist()
    ([[False, True], [True, True]], [0.7, 0.3])
    """
    whole = inside.all(axis=1)
    rows = np.vstack((inside[~whole], np.ones((1, inside.shape[1]), dtype=bool)))
    return Space.of(rows), np.append(weight[~whole], weight[whole].sum())


@dataclass(slots=True)
class Union:
    """Models of several spaces over the same candidates, and the sums of what they weigh there.

    The spaces come one by one, and are not kept: all are of every subset, or all are lists.
    """

    level: float = -math.inf
    weight: FloatArray = field(default_factory=lambda: np.zeros(1))
    lists: list[tuple[float, NDArray[np.uint8], FloatArray]] = field(default_factory=list)

    def add(self, space: Space, weight: FloatArray, log: float) -> None:
        """Add weights (m,) times the exponential of a logarithm."""
        top = max(self.level, log)
        if space.inside is None:
            before, self.weight = self.weight, math.exp(log - top) * weight
            self.weight += math.exp(self.level - top) * before
        else:
            self.lists.append((log, np.packbits(space.inside, axis=1), weight))
        self.level = top

    def summed(self, p: int) -> tuple[Space, FloatArray]:
        """One space of all models over p candidates, and their weights, of sum 1."""
        if not self.lists:
            return Space(p), self.weight / self.weight.sum()
        packed, which = np.unique(
            np.concatenate([models for _, models, _ in self.lists]), axis=0, return_inverse=True
        )
        summed = np.zeros(len(packed))
        each = [math.exp(log - self.level) * weight for log, _, weight in self.lists]
        np.add.at(summed, which.ravel(), np.concatenate(each))
        return listed(np.unpackbits(packed, axis=1, count=p).astype(bool), summed / summed.sum())


BLOCK_BITS = 16
"""A block of 2^16 weights stays in the second cache while it is added up."""


class Totals(NamedTuple):
    """Sums of the weights of models: of those with each candidate (p,), of all, and of each size (p + 1,)."""

    having: FloatArray
    total: float
    by_size: FloatArray


def tally(weight: FloatArray, p: int) -> Totals:
    """Sum weights (2^p,) by candidate, by size and in all; threads share blocks, and so get the same sums.

    Examples
    --------
    >>> tally(np.array([1.0, 2.0, 3.0, 4.0]), 2)
    Totals(having=array([6., 7.]), total=10.0, by_size=array([1., 5., 4.]))
    """
    bits = min(BLOCK_BITS, p)
    o, h, k = p - bits, bits - bits // 2, bits // 2
    outer, high, low = _marks(o), _marks(h), _marks(k)
    blocks = weight.reshape(1 << o, 1 << h, 1 << k)
    told = np.array(pieces(lambda b: high.T @ (blocks[b] @ low), len(blocks)))
    every = np.tensordot(outer.T, told, 1)
    having = every[o:, h:, :k].sum((0, 1)), every[o:, :h, k:].sum((0, 2)), every[:o, h:, k:].sum((1, 2))
    by_size = every[o:, h:, k:]
    at = np.indices(by_size.shape).sum(axis=0)
    sums = np.bincount(at.ravel(), by_size.ravel(), p + 1).astype(np.float64)
    return Totals(np.concatenate(having), float(by_size.sum()), sums)


@cache
def _marks(bits: int) -> FloatArray:
    """Which candidates a mask holds, and how many, as marks (2^bits, bits + bits + 1)."""
    inside = Space(bits).members(np.arange(1 << bits))
    return np.hstack((inside, sizes(bits)[:, None] == np.arange(bits + 1))).astype(np.float64)


def heaviest(weight: FloatArray, count: int) -> IntArray:
    """Numbers of the largest of the weights (m,), largest first.

    They lie in as many of its blocks, about as many as a block is long: those whose own largest are largest.

    Examples
    --------
    >>> heaviest(np.array([0.1, 0.4, 0.2, 0.3]), 2).tolist()
    [1, 3]
    """
    block = 1 << len(weight).bit_length() // 2
    blocks = weight.reshape(-1, len(weight) if len(weight) % block else block)
    near = np.argsort(-blocks.max(axis=1), kind="stable")[:count]
    chosen = np.sort(near)[:, None] * blocks.shape[1] + np.arange(blocks.shape[1])
    count = min(count, chosen.size)
    flat = chosen.ravel()
    top = flat[np.argpartition(-weight[flat], count - 1)[:count]]
    return top[np.lexsort((top, -weight[top]))]


def standing_for(weight: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Models that stand for all, about so many: numbers (m,), in order, and weights (m,) of the same sum.

    The models that are heavier than a `count`-th of all have their own weight, and so have the ten heaviest;
    the others are drawn systematically, in proportion to their weight, and share what these have together:
    sums over them are right on average, whatever is summed.
    """
    if len(weight) <= count:
        return np.arange(len(weight)), weight
    top = heaviest(weight, 10)
    limit = min(float(weight.sum()) / count, float(weight[top[-1]]))
    blocks = weight.reshape(-1, min(1 << BLOCK_BITS, len(weight)))
    found = pieces(lambda k: np.flatnonzero(blocks[k] >= limit) + k * blocks.shape[1], len(blocks))
    heavy = np.concatenate(found)
    ticks, each = _systematic(blocks, limit, count)
    light, repeats = np.unique(ticks, return_counts=True)
    every = np.concatenate((heavy, light))
    order = np.argsort(every, kind="stable")
    share = np.concatenate((weight[heavy], each * repeats.astype(np.float64)))
    return every[order], share[order]


def _systematic(blocks: FloatArray, limit: float, count: int) -> tuple[IntArray, float]:
    """Numbers of the weights below a limit at `count` places, evenly, of their running sum; and the step.

    The weights are looked at in rows, of which the sums are taken first.
    """
    from imubayes.selection.kernels import ROW_BITS, light_sums

    rows = blocks.reshape(len(blocks), -1, 1 << ROW_BITS)
    sums = np.empty(rows.shape[:2])
    pieces(lambda k: light_sums(rows[k], limit, sums[k]), len(rows))
    ends = np.cumsum(sums)
    step = float(ends[-1]) / count
    if step == 0.0:
        return np.empty(0, dtype=np.int64), 0.0
    places = (np.arange(count) + 0.5) * step
    which = np.searchsorted(ends, places, side="right")
    near = rows.reshape(sums.size, -1)[which]
    light = np.where(near < limit, near, 0.0)
    before = ends[which] - sums.ravel()[which]
    passed = np.sum(before[:, None] + np.cumsum(light, axis=1) <= places[:, None], axis=1)
    # the sum of a row may round below that of its weights one by one
    last = light.shape[1] - 1 - np.argmax(light[:, ::-1] > 0.0, axis=1)
    return which * light.shape[1] + np.minimum(passed, last), step


def sizes(p: int) -> NDArray[np.int64]:
    """Return the number of included columns of each mask: (2^p,)."""
    return subset_sums(np.ones(p, dtype=np.int64))


def subset_sums(values: NDArray[np.generic]) -> NDArray[Any]:
    """Sum of what is included of values (p,), by mask: (2^p,).

    Examples
    --------
    >>> subset_sums(np.array([1.0, 2.0])).tolist()
    [0.0, 1.0, 2.0, 3.0]
    """
    sums = np.zeros(1 << len(values), dtype=values.dtype)
    for j, value in enumerate(values):
        np.add(sums[: 1 << j], value, out=sums[1 << j : 2 << j])
    return sums


Found = TypeVar("Found")

FEWEST = 2
"""Pieces of a thread, at least: what is cut in no more takes less time than to start another."""

RUNS = 32
"""Runs of pieces that a thread takes, about: a thousand pieces take less time than to hand over each."""


def threads() -> int:
    """Threads that work may be shared by: ``NUMBA_NUM_THREADS``, by default one a core.

    One in a process that another Python started: such processes share the cores already.
    """
    from numba.core import config

    return 1 if parent_process() is not None else int(config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]


def pieces(work: Callable[[int], Found], count: int) -> list[Found]:
    """What a work gives for each of the pieces 0 ... count - 1, in the order of their numbers.

    It is compiled, and without the interpreter's lock where it takes time.

    Examples
    --------
    >>> pieces(lambda k: k * k, 3)
    [0, 1, 4]
    """
    available = min(threads(), count // FEWEST)
    if available < 2:
        return [work(k) for k in range(count)]

    each = max(1, count // (RUNS * available))
    runs = [range(first, min(first + each, count)) for first in range(0, count, each)]
    with ThreadPoolExecutor(available) as pool:
        return [found for run in pool.map(lambda run: [work(k) for k in run], runs) for found in run]


STEPS = 60
"""Most steps on the way to a score's best subset."""


def descended(
    among: BoolArray,
    scores: Callable[[Space], Mapping[str, FloatArray]],
    mended: Callable[[BoolArray], BoolArray],
) -> BoolArray:
    """Subsets of a list (m, p), and all that lie about the way down from the best of them under each score.

    `mended` makes subsets (m, p) admissible.

    Examples
    --------
    >>> empty = np.zeros((1, 3), dtype=bool)
    >>> found = descended(empty, lambda s: {"terms": -s.sizes() * 1.0}, lambda inside: inside)
    >>> bool(found.all(axis=1).any())
    True
    """
    first = mended(among)
    found = [first]
    for name, values in scores(Space.of(first)).items():
        best, least = first[int(np.argmin(values))], float(values.min())
        for _ in range(STEPS):
            flips = best ^ np.eye(len(best), dtype=bool)
            there, away = np.nonzero(best[:, None] & ~best)
            swaps = np.tile(best, (len(there), 1))
            rows = np.arange(len(swaps))
            swaps[rows, there], swaps[rows, away] = False, True
            near = mended(np.concatenate((flips, swaps)))  # one term more or less, or exchanged
            found.append(near)
            around = scores(Space.of(near))[name]
            if not around.min() < least:
                break
            best, least = near[int(np.argmin(around))], float(around.min())
    return np.unique(np.concatenate(found), axis=0)


ModelPrior = str | float
Needs = Sequence[tuple[int, int]]
"""(child, parent) by number: a model with the child must have the parent. A child has one parent."""


def log_model_prior(model_prior: ModelPrior, p: int, needs: Needs = ()) -> FloatArray:
    """Log prior probability of one admissible model of each size 0 ... p.

    The model prior is ``beta-binomial`` (every size equally likely where all models are admissible),
    ``uniform``, or the prior probability of each candidate. The probabilities of the admissible models sum
    to 1.

    Raises
    ------
    TermError : if the prior is none of these.

    Examples
    --------
    >>> np.exp(log_model_prior("uniform", 2)).tolist()
    [0.25, 0.25, 0.25]
    >>> np.exp(log_model_prior("uniform", 2, [(1, 0)])).round(6).tolist()
    [0.333333, 0.333333, 0.333333]
    """
    k = np.arange(p + 1)
    if model_prior == "beta-binomial":
        by_size = -math.log(p + 1) - np.array([math.log(math.comb(p, i)) for i in k])
    else:
        share = 0.5 if model_prior == "uniform" else model_prior
        if isinstance(share, str) or not 0.0 < share < 1.0:
            raise TermError(
                f"model_prior = {share!r}: expected 'beta-binomial', 'uniform' or a probability between 0"
                " and 1"
            )
        by_size = k * math.log(share) + (p - k) * math.log1p(-share)
    return by_size - math.log(np.sum(admissible_counts(p, needs) * np.exp(by_size))) if needs else by_size


def admissible_counts(p: int, needs: Needs) -> FloatArray:
    """Number of admissible models of each size 0 ... p.

    Children and parents form trees: a tree has its root and any admissible part of each branch, or nothing.

    Examples
    --------
    >>> admissible_counts(3, [(1, 0)]).tolist()
    [1.0, 2.0, 2.0, 1.0]
    """
    branches: dict[int, list[int]] = {}
    for child, parent in needs:
        branches.setdefault(parent, []).append(child)

    def below(root: int) -> FloatArray:
        inside = np.ones(1)
        for child in branches.get(root, []):
            inside = np.convolve(inside, below(child))
        return np.concatenate(([1.0], inside))

    whole = np.ones(1)
    for root in sorted(set(range(p)) - {child for child, _ in needs}):
        whole = np.convolve(whole, below(root))
    return whole


def by_number(needs: Sequence[tuple[str, str]], names: Sequence[str]) -> list[tuple[int, int]]:
    """Needs by the numbers of the candidates; of those that are not among them nothing is asked."""
    number = {name: j for j, name in enumerate(names)}
    return [(number[a], number[b]) for a, b in dict.fromkeys(needs) if a in number and b in number]


def hierarchy(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Which terms call for which among `names`, as (child, parent).

    A power of the input calls for the power two below (b3 for b1, b2 for b0), an asymmetry for the power it
    is the asymmetry of (b1p for b1), a term times temperature for the lower power of temperature, and a term
    times the rate of temperature for the term itself. A parent that is not among the names is not asked for.

    Examples
    --------
    >>> hierarchy(["b0", "b1", "b3", "b1p", "b1*T", "b1*T2", "m_j"])
    (('b3', 'b1'), ('b1p', 'b1'), ('b1*T', 'b1'), ('b1*T2', 'b1*T'))
    """
    pairs = ((name, _parent(name)) for name in names)
    return tuple((name, parent) for name, parent in pairs if parent in names)


def _parent(name: str) -> str:
    """Name of the term that a term calls for; empty where it stands alone."""
    prefix, _, own = name.rpartition(".")
    prefix = f"{prefix}." if prefix else ""
    base, _, heated = own.partition("*")
    if heated:
        power = int(heated[1:] or 1) if heated[0] == "T" else 1
        return f"{prefix}{base}" if power == 1 else f"{prefix}{base}*T{'' if power == 2 else power - 1}"
    if match := re.fullmatch(r"b(\d+)(p?)", own):
        power, signed = int(match[1]), bool(match[2])
        return f"{prefix}b{power}" if signed else f"{prefix}b{power - 2}" if power >= 2 else ""
    return ""
