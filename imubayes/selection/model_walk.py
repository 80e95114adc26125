"""A random walk over submodels, for posteriors too wide to be listed.

A state is the triangular factor of all columns, the included ones first. From it the odds of every model
one column away are exact: of a column outside by its part beside the included ones, of a column inside by
the inverse of the leading triangle. A step flips a column drawn in proportion to its conditional probability
of flipping (Barker's balancing function; Zanella, 2020), accepted with the ratio of the sums of these
probabilities. Every fourth step or so swaps an included column for another, the likelier the more alike they
are; every tenth draws all columns anew that the data say little of, from the prior given the others. The
inclusion is averaged over the conditional probabilities (Rao-Blackwell), not over the states.
Chains walk in parallel until they agree.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.compiled import compiled, inner
from imubayes.selection.bounds import TreeProblem, additions, bring, has_bit, put_bit, put_words, within
from imubayes.selection.kernels import invert

SWAPS = 0.25
"""Share of the steps that swap two columns."""

REDRAWS = 0.1
"""Share of the steps that draw the columns anew which the data say little of."""

LITTLE = 0.8
"""Posterior over prior variance from which the data say little of a column, 0.9 in sd."""


class State(NamedTuple):
    """Where a chain stands.

    `factor` (p + 1, p + 1) of all columns in the order `column` (p,), the first ``size[0]`` of them included;
    `flip` (p,) the probability of flipping each, given all others; `log_joint` (1,).
    """

    factor: FloatArray
    column: NDArray[np.int64]
    size: NDArray[np.int64]
    flip: FloatArray
    log_joint: FloatArray


class Record(NamedTuple):
    """What a chain leaves, or several together.

    `words` (n, 2), `log_joint` and `stay` (n,) of the models they were at, with repetitions: two words each,
    and the steps that they stayed there. `inclusion` (p,), averaged over the steps. `count` (1,) of these
    models, or of the steps of all chains.
    """

    words: NDArray[np.uint64]
    log_joint: FloatArray
    stay: FloatArray
    inclusion: FloatArray
    count: NDArray[np.int64]


def begin(T: FloatArray, inside: NDArray[np.bool_], problem: TreeProblem) -> State:
    """Stand at a model, inside (p,): T (p + 1, p + 1) has columns whose prior rows are 1."""
    p = len(inside)
    column = np.concatenate((np.flatnonzero(inside), np.flatnonzero(~inside)))
    factor = np.linalg.qr(T[:, np.append(column, p)], mode="r")
    size = np.array([inside.sum()])
    state = State(np.ascontiguousarray(factor), column, size, np.zeros(p), np.zeros(1))
    _look_around(problem, state, (np.zeros(p + 1), np.zeros(p + 1)), np.zeros((p, p)))
    return state


class Moves(NamedTuple):
    """What proposals need: weight (p, p) of swapping two columns, the columns that are drawn anew (u,)."""

    likeness: FloatArray
    loose: NDArray[np.int64]


def moves(T: FloatArray) -> Moves:
    """Swaps by the square of the columns' correlation, and a floor; redraws where the prior row rules."""
    X, p = T[:, :-1] / np.linalg.norm(T[:, :-1], axis=0), T.shape[0] - 1
    likeness = (X.T @ X) ** 2 + 1.0 / p**2
    np.fill_diagonal(likeness, 0.0)
    inverse = np.zeros((p, p))
    invert(np.ascontiguousarray(T), 0, p, inverse)
    return Moves(likeness, np.flatnonzero(np.sum(inverse**2, axis=1) > LITTLE))


@compiled
def take_steps(problem, state, moves, uniform, record):
    """As many steps as `uniform` (n, 4 + p) has rows; `record` is written anew.

    Returns the share of the proposals that were accepted.
    """
    p = len(state.column)
    other = State(
        state.factor.copy(), state.column.copy(), state.size.copy(), state.flip.copy(), state.log_joint.copy()
    )
    scratch, inverse = (np.zeros(p + 1), np.zeros(p + 1)), np.zeros((p, p))
    record.inclusion[:] = 0.0
    record.count[0] = 0
    _note(state, record)
    for n in range(len(uniform)):
        _copy(state, other)
        kind = uniform[n, 0]
        if kind >= SWAPS + REDRAWS or (kind >= SWAPS and len(moves.loose) < 2):
            moved = _flip(problem, other, uniform[n], scratch, inverse, np.sum(state.flip))
        else:
            if kind < SWAPS:
                moved = _swap(problem, other, moves.likeness, uniform[n])
            else:
                moved = _redraw(problem, other, moves.loose, uniform[n])
            if moved:
                _look_around(problem, other, scratch, inverse)
        if moved:
            _copy(other, state)
            _note(state, record)
        record.stay[record.count[0] - 1] += 1.0
        k = state.size[0]
        for j in range(p):
            flip = state.flip[j]
            record.inclusion[state.column[j]] += 1.0 - flip if j < k else flip
    for j in range(p):
        record.inclusion[j] /= len(uniform)
    return (record.count[0] - 1) / len(uniform)


@inner
def _copy(a, b):
    p = len(a.column)
    for i in range(p + 1):
        for j in range(p + 1):
            b.factor[i, j] = a.factor[i, j]
    for j in range(p):
        b.column[j], b.flip[j] = a.column[j], a.flip[j]
    b.size[0], b.log_joint[0] = a.size[0], a.log_joint[0]


@compiled
def _note(state, record):
    m = record.count[0]
    put_words(_words(state), record.words[m])
    record.log_joint[m] = state.log_joint[0]
    record.stay[m] = 0.0
    record.count[0] = m + 1


@inner
def _flip(problem, state, uniform, scratch, inverse, before):
    """Flip a column drawn by its probability; return whether that is accepted."""
    if before <= 0.0:
        return False
    chosen = _draw(state.flip, uniform[1] * before)
    _move(state, chosen)
    _look_around(problem, state, scratch, inverse)
    return uniform[2] * np.sum(state.flip) < before


@inner
def _draw(weight, target):
    """First place where the running sum of the weights exceeds the target; never one of weight zero."""
    chosen, total = -1, 0.0
    for j in range(len(weight)):
        if weight[j] > 0.0:
            chosen = j
            total += weight[j]
            if total > target:
                break
    return chosen


@inner
def _move(state, j):
    """Take the column at place j in, or out."""
    k = state.size[0]
    if j >= k:
        _bring(state, j, k)
        state.size[0] = k + 1
    else:
        for i in range(j + 1, k):  # to the end of the included ones: they pass it one by one
            _bring(state, i, i - 1)
        state.size[0] = k - 1


@inner
def _bring(state, q, t):
    if q == t:
        return
    bring(state.factor, len(state.column), q, t)
    moved = state.column[q]
    for k in range(q, t, -1):
        state.column[k] = state.column[k - 1]
    state.column[t] = moved


@inner
def _swap(problem, state, likeness, uniform):
    """Swap an included column for one outside; return whether the models' odds accept it."""
    p, k = len(state.column), state.size[0]
    if k == 0 or k == p:
        return False
    i = min(int(uniform[1] * k), k - 1)
    out = state.column[i]
    weight = np.zeros(p)
    for j in range(k, p):
        weight[j] = likeness[out, state.column[j]]
    there = np.sum(weight)
    j = _draw(weight, uniform[2] * there)
    into = state.column[j]
    back = likeness[into, out]
    for q in range(k, p):
        if q != j:
            back += likeness[into, state.column[q]]
    old = state.log_joint[0]
    _move(state, j)
    _move(state, i)
    if not _admissible(problem, state):
        return False
    _weigh(problem, state)
    return math.log(uniform[3] + 1e-300) < state.log_joint[0] - old + math.log(there / back)


@inner
def _redraw(problem, state, loose, uniform):
    """Draw which loose columns are in, from the prior given the others; return whether that is accepted.

    The prior is the proposal, so that only the likelihoods decide.
    """
    u, lp, old = len(loose), problem.log_prior, state.size[0]
    before = state.log_joint[0] - lp[old]
    words, others = _words(state), old
    for c in loose:
        others -= 1 if has_bit(words, c) else 0
    weight, highest = np.empty(u + 1), -np.inf
    for v in range(u + 1):
        weight[v] = lp[others + v] - math.lgamma(v + 1.0) - math.lgamma(u - v + 1.0)
        highest = max(highest, weight[v])
    for v in range(u + 1):
        weight[v] = math.exp(weight[v] - highest)
    size = _draw(weight, uniform[1] * np.sum(weight))
    for c in loose:
        rank = 0
        for other in loose:
            rank += uniform[4 + other] < uniform[4 + c]
        if (rank < size) != has_bit(words, c):
            place = 0
            while state.column[place] != c:
                place += 1
            _move(state, place)
    if not _admissible(problem, state):
        return False
    _weigh(problem, state)
    return math.log(uniform[3] + 1e-300) < state.log_joint[0] - lp[state.size[0]] - before


@compiled
def _admissible(problem, state):
    """Whether every included column has its parents."""
    words, complete = _words(state), True
    for j in range(state.size[0]):
        complete = complete and within(problem.parents[state.column[j]], words)
    return complete


@compiled
def _words(state):
    words = np.zeros(2, np.uint64)
    for j in range(state.size[0]):
        put_bit(words, state.column[j])
    return words


@inner
def _weigh(problem, state):
    A, k, p = state.factor, state.size[0], len(state.column)
    rss = log_det = 0.0
    for i in range(k):
        log_det += math.log(abs(A[i, i]))
    for i in range(k, p + 1):
        rss += A[i, p] * A[i, p]
    state.log_joint[0] = problem.log_prior[k] - rss / problem.spread - log_det


@compiled
def _look_around(problem, state, scratch, inverse):
    """Log joint of the state's model, and the probability of flipping each column given the others."""
    A, k, p, lp = state.factor, state.size[0], len(state.column), problem.log_prior
    _weigh(problem, state)
    words = _words(state)
    g, norm2 = scratch
    additions(A, p, k, g, norm2)
    for j in range(k, p):
        odds = g[j] * g[j] / norm2[j] / problem.spread - 0.5 * math.log(norm2[j]) + lp[k + 1] - lp[k]
        state.flip[j] = _share(odds) if within(problem.parents[state.column[j]], words) else 0.0
    invert(A, np.int64(0), k, inverse)
    for i in range(k):
        mean = variance = 0.0
        for j in range(i, k):
            mean += inverse[i, j] * A[j, p]
            variance += inverse[i, j] * inverse[i, j]
        odds = -mean * mean / variance / problem.spread - 0.5 * math.log(variance) + lp[k - 1] - lp[k]
        needed = False
        for j in range(k):
            needed = needed or has_bit(problem.parents[state.column[j]], state.column[i])
        state.flip[i] = 0.0 if needed else _share(odds)


@compiled
def _share(odds):
    return 1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0


CHAINS = 4

STEPS = 500
"""Steps of a chain in one batch."""

ROUNDS = 20
"""Fewest batches; the first fifth is left out, in which the chains find their way."""

STEADY = 0.002
"""Standard error of the inclusion at which the walk ends."""

MIXED = 1.05
"""Split R-hat at which the walk ends."""


def _batch(problem: TreeProblem, how: Moves, state: State, rng: np.random.Generator) -> Record:
    p = len(state.column)
    words, sums = np.empty((STEPS + 1, 2), np.uint64), np.empty((2, STEPS + 1))
    record = Record(words, sums[0], sums[1], np.empty(p), np.zeros(1, dtype=np.int64))
    take_steps(problem, state, how, rng.random((STEPS, 4 + p)), record)
    n = record.count[0]
    return record._replace(words=words[:n], log_joint=sums[0, :n], stay=sums[1, :n])


def walk_models(
    T: FloatArray,
    problem: TreeProblem,
    first: BoolArray,
    needed: BoolArray,
    steps: int,
    rng: np.random.Generator,
) -> tuple[Record, FloatArray]:
    """Walk in parallel chains until they are steady, or have taken `steps` together.

    Parameters
    ----------
    T : (p + 1, p + 1) factor whose columns have prior rows of 1.
    first : (p,) model at which the first chain starts; the others start at random.
    needed : (p, p) whether the column of each row needs that of each column.
    steps : of all chains, about: whole batches are taken, and `ROUNDS` of them at least.

    Returns
    -------
    record of all chains, and the standard error (p,) of its inclusion.
    """
    how, owns, starts = moves(T), rng.spawn(CHAINS), [first]
    for share in np.linspace(0.0, 1.0, CHAINS - 1):  # ever more columns drawn at random, from none to all
        inside = rng.random(len(needed)) < share
        starts.append(inside & ~(needed & ~inside).any(axis=1))
    chains = [(begin(T, inside, problem), own) for inside, own in zip(starts, owns, strict=True)]
    records: list[Record] = []
    inclusion = []
    with ThreadPoolExecutor(CHAINS) as pool:
        while len(inclusion) < ROUNDS or not (len(records) * STEPS >= steps or _steady(np.array(inclusion))):
            batch = list(pool.map(lambda chain: _batch(problem, how, *chain), chains))
            records += batch
            inclusion.append([record.inclusion for record in batch])
    dropped = len(inclusion) // 5
    settled, kept = np.array(inclusion)[dropped:], records[CHAINS * dropped :]
    walked = Record(
        np.concatenate([record.words for record in kept]),
        np.concatenate([record.log_joint for record in kept]),
        np.concatenate([record.stay for record in kept]),
        settled.mean(axis=(0, 1)),
        np.array([len(records) * STEPS]),
    )
    return walked, _standard_error(settled)


def _steady(inclusion: FloatArray) -> bool:
    """Whether the chains agree, by split R-hat, and the error is small: inclusion (rounds, chains, p)."""
    settled = inclusion[len(inclusion) // 5 :]
    halves = _halves(settled)
    means, within = halves.mean(axis=0), halves.var(axis=0, ddof=1).mean(axis=0)
    between = means.var(axis=0, ddof=1)
    n = len(halves)
    mixed = between + within * (n - 1) / n <= MIXED**2 * within + 1e-12
    return bool(mixed.all() and _standard_error(settled).max() <= STEADY)


def _halves(inclusion: FloatArray) -> FloatArray:
    """(rounds / 2, 2 chains, p): both halves of each chain."""
    n = len(inclusion) // 2
    return np.concatenate((inclusion[:n], inclusion[-n:]), axis=1)


def _standard_error(inclusion: FloatArray) -> FloatArray:
    """(p,) the larger of the standard errors from the halves of the chains and from the batches."""
    means = _halves(inclusion).mean(axis=0)
    batches = inclusion.reshape(-1, inclusion.shape[-1])
    return np.maximum(
        means.std(axis=0, ddof=1) / math.sqrt(len(means)),
        batches.std(axis=0, ddof=1) / math.sqrt(len(batches)),
    )
