"""Models where they are too many to be enumerated: chains walk over them in parallel until they agree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import Factor, noise_scale
from imubayes.selection.mixture import Candidates, log_flat, scale_components
from imubayes.selection.model_prior import Needs
from imubayes.selection.model_sets import listed
from imubayes.selection.model_walk import Moves, Problem, Record, State, begin, moves, take_steps
from imubayes.selection.models import Models, Weighed, posterior_of

CHAINS = 4

STEPS = 500
"""Steps of a chain in one batch."""

ROUNDS = 20
"""Fewest batches; the first fifth is left out, in which the chains find their way."""

STEADY = 0.002
"""Standard error of the inclusion at which the walk ends."""

MIXED = 1.05
"""Split R-hat at which the walk ends."""

MOST = 2_000_000
"""Models that are kept: those that the chains stayed at longest."""


class Walked(NamedTuple):
    """What the chains found.

    Attributes
    ----------
    inside, log_joint : (m, p) and (m,) of the models they were at, each once.
    weight : (m,) share of the steps that they were there.
    inclusion, error : (p,) and its standard error.
    """

    inside: BoolArray
    log_joint: FloatArray
    weight: FloatArray
    inclusion: FloatArray
    error: FloatArray


def walk_models(
    T: FloatArray, log_width: FloatArray, problem: Problem, steps: int, rng: np.random.Generator
) -> Walked:
    """Walk in parallel chains until they are steady, or have taken `steps` together.

    The log joint probability of a model M, up to what is common to all models, is::

        -rss_M / (2 scale^2) - sum_{j in M} ln |r_jj| + sum_{j in M} log_width_j + log_prior[|M|]

    with rss and r of the model's own triangular factor.

    Parameters
    ----------
    T : (p + 1, p + 1) upper triangular factor of ``[X y]``, the prior's rows stacked under it.
    log_width : (p,) ``ln(scale / sd)``, sd the prior's.
    problem : the noise scale, the models' prior, and which columns need which, through others too.
    steps : of all chains, about: whole batches are taken, and `ROUNDS` of them at least.
    rng : the source of randomness.

    Examples
    --------
    >>> X = np.array([[9.0, 0.1], [0.3, 9.0], [1.0, 0.0], [0.0, 1.0]])  # two rows of data, two of the prior
    >>> T = np.linalg.qr(np.column_stack((X, (20.0, 0.2, 0.0, 0.0))), mode="r")
    >>> problem = Problem(2.0, np.log(np.full(3, 1 / 3)), np.zeros((2, 2), dtype=bool))
    >>> walk_models(T, np.zeros(2), problem, 40_000, np.random.default_rng(1)).inclusion.round(2).tolist()
    [1.0, 0.11]
    """
    T = np.ascontiguousarray(T / np.append(np.exp(log_width), 1.0))
    how, owns = moves(T), rng.spawn(CHAINS)
    starts = _dispersed(problem.needed, rng)
    chains = [(begin(T, inside, problem), own) for inside, own in zip(starts, owns, strict=True)]
    records: list[Record] = []
    inclusion = []
    with ThreadPoolExecutor(CHAINS) as pool:
        while len(inclusion) < ROUNDS or not (len(records) * STEPS >= steps or _steady(np.array(inclusion))):
            batch = list(pool.map(lambda chain: _batch(problem, how, *chain), chains))
            records += batch
            inclusion.append([record.inclusion for record in batch])
    dropped = len(inclusion) // 5
    settled = np.array(inclusion)[dropped:]
    return Walked(
        *_distinct(records[CHAINS * dropped :], len(log_width)),
        settled.mean(axis=(0, 1)),
        _standard_error(settled),
    )


def _batch(problem: Problem, how: Moves, state: State, rng: np.random.Generator) -> Record:
    """Take `STEPS` steps of a chain; models come packed, eight columns a byte."""
    p = len(state.column)
    inside, sums = np.empty((STEPS + 1, p), dtype=bool), np.empty((2, STEPS + 1))
    record = Record(inside, sums[0], sums[1], np.empty(p), np.zeros(1, dtype=np.int64))
    take_steps(problem, state, how, rng.random((STEPS, 4 + p)), record)
    n = record.count[0]
    return record._replace(
        inside=np.packbits(inside[:n], axis=1), log_joint=sums[0, :n].copy(), stay=sums[1, :n].copy()
    )


def _distinct(records: Sequence[Record], p: int) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Each model once, its log joint and share of the steps, in the order of this share; at most `MOST`."""
    packed = np.concatenate([record.inside for record in records])
    every, first, which = np.unique(packed, axis=0, return_index=True, return_inverse=True)
    stay = np.bincount(which.ravel(), np.concatenate([record.stay for record in records]))
    best = np.argsort(-stay, kind="stable")[:MOST]
    inside = np.unpackbits(every[best].view(np.uint8), axis=1, count=p).astype(bool)
    log_joint = np.concatenate([record.log_joint for record in records])[first[best]]
    return inside, log_joint, stay[best] / stay[best].sum()


def _dispersed(needed: BoolArray, rng: np.random.Generator) -> Iterable[BoolArray]:
    """Models of ever more columns drawn at random, from none to all: (p,) each."""
    for share in np.linspace(0.0, 1.0, CHAINS):
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


EFFORT = 800_000
"""Steps of a walk, some eight seconds: counted, so that it gives the same on any machine."""

SEED = 20231
"""Of the walk, so that it gives the same numbers twice."""

MANY = 100
"""Models by which a walk's share of the evidence is judged: those it stayed at longest."""


def search_models(
    names: tuple[str, ...], c: Candidates, by_size: FloatArray, needs: Needs, scale: float | None
) -> Models:
    """Posterior over the models that carry it, by a walk.

    Parameters
    ----------
    names : the summary's columns.
    c : candidates, under physical priors.
    by_size : (p + 1,) log prior probability of one model of each size.
    needs : (child, parent) by the candidates' numbers, in no circle.
    scale : the noise scale; None takes the one that the full library leaves, whose uncertainty, a share of
        ``1/sqrt(2 n)``, moves the log odds of a term t sd from zero by no more than ``t^2/sqrt(2 n)``.
    """
    proper = np.isfinite(c.sd)
    sd = np.where(proper, c.sd, 1e8 * np.max(c.sd[proper]))
    held = noise_scale(Factor(c.columns, c.whole, c.dof), sd) if scale is None else scale
    a, T = len(c.always), c.at(held)
    required = np.zeros((len(c.names),) * 2, dtype=bool)
    for child, parent in needs:
        required[child, parent] = True
    for j in range(len(required)):  # through others too
        required |= required[:, j : j + 1] & required[j]
    problem = Problem(2.0 * held**2, np.asarray(by_size, dtype=float), required)
    found = walk_models(T[a:, a:], np.log(held / c.sd[a:]), problem, EFFORT, np.random.default_rng(SEED))
    # of all models, from the share that some of them have of it
    share = math.log(float(found.weight[:MANY].sum()))
    level = float(np.logaddexp.reduce(found.log_joint[:MANY]) - share)
    space, weight = listed(found.inside, found.weight)
    w = Weighed(c, space, np.array([held]), weight, level + log_flat(c, T, held))
    posterior = posterior_of(names, w, scale_components(c, space, w.scales, weight))
    inclusion = posterior.inclusion.copy()
    # sharper than the share of the steps
    inclusion[[names.index(name) for name in c.names]] = found.inclusion
    return replace(posterior, inclusion=inclusion, error=float(found.error.max()))
