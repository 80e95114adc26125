"""A random walk over submodels, where they are too many to be enumerated.

A state is the triangular factor of all columns, the included ones first. From it the odds of every model
one column away are exact: of a column outside by its part beside the included ones, of a column inside by
the inverse of the leading triangle. A step flips a column drawn in proportion to its conditional probability
of flipping (Barker's balancing function; Zanella, 2020), accepted with the ratio of the sums of these
probabilities. Every fourth step or so swaps an included column for another, the likelier the more alike they
are; every tenth draws all columns anew that the data say little of, from the prior given the others. The
inclusion is averaged over the conditional probabilities (Rao-Blackwell), not over the states.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.selection.kernels import invert

SWAPS = 0.25
"""Share of the steps that swap two columns."""


REDRAWS = 0.1
"""Share of the steps that draw the columns anew which the data say little of."""

LITTLE = 0.8
"""Posterior over prior variance from which the data say little of a column, 0.9 in sd."""


class Problem(NamedTuple):
    """What is walked over: ``2 scale^2``, log prior by size (p + 1,), and what needs what (p, p), by row."""

    spread: float
    log_prior: FloatArray
    needed: BoolArray


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
    """What a chain leaves: inside (n, p), log joint, steps (n,) of models that it was at; inclusion (p,)."""

    inside: BoolArray
    log_joint: FloatArray
    stay: FloatArray
    inclusion: FloatArray
    count: NDArray[np.int64]


def begin(T: FloatArray, inside: NDArray[np.bool_], problem: Problem) -> State:
    """Stand at a model, inside (p,): T (p + 1, p + 1) has columns whose prior rows are 1."""
    p = len(inside)
    column = np.concatenate((np.flatnonzero(inside), np.flatnonzero(~inside)))
    factor = np.linalg.qr(T[:, np.append(column, p)], mode="r")
    size = np.array([inside.sum()])
    state = State(np.ascontiguousarray(factor), column, size, np.zeros(p), np.zeros(1))
    _look_around(problem, state, np.zeros((p, p)))
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
    invert(np.ascontiguousarray(T), p, inverse)
    return Moves(likeness, np.flatnonzero(np.sum(inverse**2, axis=1) > LITTLE))


@njit(cache=True, nogil=True, error_model="numpy")
def take_steps(problem, state, moves, uniform, record):
    """As many steps as `uniform` (n, 4 + p) has rows; `record` is written anew.

    Returns the share of the proposals that were accepted.
    """
    p = len(state.column)
    other = State(
        state.factor.copy(), state.column.copy(), state.size.copy(), state.flip.copy(), state.log_joint.copy()
    )
    inverse = np.zeros((p, p))
    record.inclusion[:] = 0.0
    record.count[0] = 0
    _note(state, record)
    for n in range(len(uniform)):
        _copy(state, other)
        kind = uniform[n, 0]
        if kind >= SWAPS + REDRAWS or (kind >= SWAPS and len(moves.loose) < 2):
            moved = _flip(problem, other, uniform[n], inverse, np.sum(state.flip))
        else:
            if kind < SWAPS:
                moved = _swap(problem, other, moves.likeness, uniform[n])
            else:
                moved = _redraw(problem, other, moves.loose, uniform[n])
            if moved:
                _look_around(problem, other, inverse)
        if moved:
            _copy(other, state)
            _note(state, record)
        record.stay[record.count[0] - 1] += 1.0
        k = state.size[0]
        for j in range(p):
            flip = state.flip[j]
            record.inclusion[state.column[j]] += 1.0 - flip if j < k else flip
    record.inclusion[:] /= len(uniform)
    return (record.count[0] - 1) / len(uniform)


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(a, b):
    b.factor[:] = a.factor
    b.column[:] = a.column
    b.size[0] = a.size[0]
    b.flip[:] = a.flip
    b.log_joint[0] = a.log_joint[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _note(state, record):
    """Write the model that a chain came to."""
    m = record.count[0]
    record.inside[m] = _inside(state)
    record.log_joint[m] = state.log_joint[0]
    record.stay[m] = 0.0
    record.count[0] = m + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _flip(problem, state, uniform, inverse, before):
    """Flip a column drawn by its probability; return whether that is accepted."""
    if before <= 0.0:
        return False
    chosen = _draw(state.flip, uniform[1] * before)
    _move(state, chosen)
    _look_around(problem, state, inverse)
    return uniform[2] * np.sum(state.flip) < before


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _bring(state, q, t):
    """Move the column at place q to place t < q, and make the factor triangular again."""
    A, p, moved = state.factor, len(state.column), state.column[q]
    for k in range(q, t, -1):
        state.column[k] = state.column[k - 1]
    state.column[t] = moved
    for i in range(q + 1):
        value = A[i, q]
        for k in range(q, t, -1):
            A[i, k] = A[i, k - 1]
        A[i, t] = value
    for i in range(q - 1, t - 1, -1):
        a, b = A[i, t], A[i + 1, t]
        norm = math.sqrt(a * a + b * b)
        if b == 0.0 or norm == 0.0:
            continue
        c, s = a / norm, b / norm
        A[i, t], A[i + 1, t] = norm, 0.0
        for k in range(i + 1, p + 1):
            x, y = A[i, k], A[i + 1, k]
            A[i, k] = c * x + s * y
            A[i + 1, k] = c * y - s * x


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _redraw(problem, state, loose, uniform):
    """Draw which loose columns are in, from the prior given the others; return whether that is accepted.

    The prior is the proposal, so that only the likelihoods decide.
    """
    u, lp, old = len(loose), problem.log_prior, state.size[0]
    before = state.log_joint[0] - lp[old]
    inside = _inside(state)
    others = old - np.sum(inside[loose])
    weight = np.empty(u + 1)
    for v in range(u + 1):
        weight[v] = lp[others + v] - math.lgamma(v + 1.0) - math.lgamma(u - v + 1.0)
    weight[:] = np.exp(weight - weight.max())
    size = _draw(weight, uniform[1] * np.sum(weight))
    key = uniform[4:][loose]
    limit = np.sort(key)[size - 1] if size > 0 else -1.0
    for i in range(u):
        if (key[i] <= limit) != inside[loose[i]]:
            place = 0
            while state.column[place] != loose[i]:
                place += 1
            _move(state, place)
    if not _admissible(problem, state):
        return False
    _weigh(problem, state)
    return math.log(uniform[3] + 1e-300) < state.log_joint[0] - lp[state.size[0]] - before


@njit(cache=True, nogil=True, error_model="numpy")
def _admissible(problem, state):
    """Whether every included column has those that it needs."""
    inside, complete = _inside(state), True
    for j in range(state.size[0]):
        complete = complete and not np.any(problem.needed[state.column[j]] & ~inside)
    return complete


@njit(cache=True, nogil=True, error_model="numpy")
def _inside(state):
    """Which columns (p,) are in the state's model."""
    inside = np.zeros(len(state.column), np.bool_)
    inside[state.column[: state.size[0]]] = True
    return inside


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(problem, state):
    """Log joint probability of the state's model."""
    A, k, p = state.factor, state.size[0], len(state.column)
    rss = log_det = 0.0
    for i in range(k):
        log_det += math.log(abs(A[i, i]))
    for i in range(k, p + 1):
        rss += A[i, p] * A[i, p]
    state.log_joint[0] = problem.log_prior[k] - rss / problem.spread - log_det


@njit(cache=True, nogil=True, error_model="numpy")
def _look_around(problem, state, inverse):
    """Log joint of the state's model, and the probability of flipping each column given the others."""
    A, k, p, lp = state.factor, state.size[0], len(state.column), problem.log_prior
    _weigh(problem, state)
    inside = _inside(state)
    for j in range(k, p):
        dot, norm2 = np.sum(A[k : j + 1, j] * A[k : j + 1, p]), np.sum(A[k : j + 1, j] ** 2)
        odds = dot * dot / norm2 / problem.spread - 0.5 * math.log(norm2) + lp[k + 1] - lp[k]
        state.flip[j] = 0.0 if np.any(problem.needed[state.column[j]] & ~inside) else _share(odds)
    invert(A, k, inverse)
    for i in range(k):
        mean = variance = 0.0
        for j in range(i, k):
            mean += inverse[i, j] * A[j, p]
            variance += inverse[i, j] * inverse[i, j]
        odds = -mean * mean / variance / problem.spread - 0.5 * math.log(variance) + lp[k - 1] - lp[k]
        state.flip[i] = 0.0 if np.any(problem.needed[:, state.column[i]] & inside) else _share(odds)


@njit(cache=True, nogil=True, error_model="numpy")
def _share(odds):
    return 1.0 / (1.0 + math.exp(-odds)) if odds > -700.0 else 0.0
