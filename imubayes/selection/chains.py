"""Parallel chains of the walk over models, and what they say when they agree."""

from __future__ import annotations

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from imubayes.selection.bounds import Problem
    from imubayes.selection.model_walk import Moves, Record, State

WordArray = NDArray[np.uint64]

CHAINS = 4

STEPS = 500
"""Steps of a chain in one batch."""

ROUNDS = 20
"""Fewest batches; the first fifth is left out, in which the chains find their way."""

STEADY = 0.002
"""Standard error of the inclusion at which the walk ends."""

MIXED = 1.05
"""Split R-hat at which the walk ends."""


@dataclass(frozen=True, slots=True, eq=False)
class Walked:
    """What the chains found.

    Attributes
    ----------
    words, log_joint : (n, 2) and (n,) of the models they were at, with repetitions.
    stay : (n,) steps that they stayed there.
    frequency, error : (p,) inclusion and its standard error.
    steps : of all chains.
    """

    words: WordArray
    log_joint: FloatArray
    stay: FloatArray
    frequency: FloatArray
    error: FloatArray
    steps: int


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    state: State
    rng: np.random.Generator

    def batch(self, problem: Problem, moves: Moves) -> Record:
        """Take `STEPS` steps."""
        from imubayes.selection.model_walk import Record, take_steps

        p = len(self.state.column)
        words, sums = np.empty((STEPS + 1, 2), np.uint64), np.empty((2, STEPS + 1))
        record = Record(words, sums[0], sums[1], np.empty(p), np.zeros(1, dtype=np.int64))
        take_steps(problem, self.state, moves, self.rng.random((STEPS, 4 + p)), record)
        n = record.count[0]
        return record._replace(words=words[:n], log_joint=sums[0, :n], stay=sums[1, :n])


def walk_models(
    T: FloatArray, problem: Problem, first: BoolArray, needed: BoolArray, steps: int, rng: np.random.Generator
) -> Walked:
    """Walk in parallel chains until they are steady, or have taken `steps` together.

    Parameters
    ----------
    T : (p + 1, p + 1) factor whose columns have prior rows of 1.
    problem : the models' prior, and which columns need which.
    first : (p,) model at which the first chain starts; the others start at random.
    needed : (p, p) whether the column of each row needs that of each column.
    steps : of all chains, about: whole batches are taken, and `ROUNDS` of them at least.
    """
    from imubayes.selection.model_walk import begin, moves

    how, owns = moves(T), rng.spawn(CHAINS)
    starts = (first, *_dispersed(needed, rng))
    chains = [_Chain(begin(T, inside, problem), own) for inside, own in zip(starts, owns, strict=True)]
    records: list[Record] = []
    inclusion = []
    with ThreadPoolExecutor(CHAINS) as pool:
        while len(inclusion) < ROUNDS or not (len(records) * STEPS >= steps or _steady(np.array(inclusion))):
            batch = list(pool.map(lambda chain: chain.batch(problem, how), chains))
            records += batch
            inclusion.append([record.inclusion for record in batch])
    dropped = len(inclusion) // 5
    settled, kept = np.array(inclusion)[dropped:], records[CHAINS * dropped :]
    return Walked(
        np.concatenate([record.words for record in kept]),
        np.concatenate([record.log_joint for record in kept]),
        np.concatenate([record.stay for record in kept]),
        settled.mean(axis=(0, 1)),
        _standard_error(settled),
        len(records) * STEPS,
    )


def _dispersed(needed: BoolArray, rng: np.random.Generator) -> Iterable[BoolArray]:
    """Models of ever more columns drawn at random, from none to all: (p,) each."""
    for share in np.linspace(0.0, 1.0, CHAINS - 1):
        inside = rng.random(len(needed)) < share
        yield inside & ~(needed & ~inside).any(axis=1)


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
