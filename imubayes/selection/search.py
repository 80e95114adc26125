"""Models beyond enumeration: branch and bound with a certified bound, and a walk over the models."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import Factor, noise_scale
from imubayes.errors import TermError
from imubayes.selection.bounds import TreeProblem
from imubayes.selection.branching import MODELS, NODES, Listing, best_guess, explore, levels, missing
from imubayes.selection.mixture import Candidates, Scales, log_flat
from imubayes.selection.model_sets import Needs, listed
from imubayes.selection.model_walk import walk_models
from imubayes.selection.models import Models, WeightedModels, posterior_of

WordArray = NDArray[np.uint64]

LARGEST = 128
"""Most candidates: a model is two words of 64 bits."""

TOLERANCE = 1e-6
"""Posterior probability that the models which are not listed may carry together."""

MOST = 2_000_000
"""Most models to list."""

EFFORT = 8.0
"""Of a search, about in seconds; where half will be too little, a walk over the models takes the rest."""

SEED = 20231
"""Of the walk, so that it gives the same numbers twice."""

MANY = 100
"""Models by which a walk's share of the evidence is judged: those it stayed at longest."""

FIRST = 10.0
"""Log by which models of the first pass may fall below the best model known."""

STEP = 5.0
"""Most that the next pass goes further down."""

TINY = 1e-300
"""Share whose logarithm stands for that of none."""

PASS = 2_000
"""Nodes between two looks at the effort."""

NODE, WALKED = 3e-5, 1e-5
"""Seconds that a node and a step of a chain take, about: effort is counted by them."""

SHARE = 0.5
"""Share of the time that branch and bound may take before the walk begins."""

FIRST_SHARE = 0.15
"""Share of the time that the first pass may take: the later ones take longer."""

HOPE = 1.5
"""Branch and bound goes on while its foreseen end exceeds its time by no more than this factor."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelsFound:
    """Models that carry the posterior, at one noise scale: inside (m, p), none twice, and log joint (m,).

    The weight (m,) goes with the joint probability where all models that matter are listed, with the time
    that the walk was there where they are not; so does the inclusion of the candidates, `frequency` (p,).
    `log_missing` is the log of a bound on the summed joint probability of all models that are not listed,
    +inf where there is none: `certified` where that is below `TOLERANCE`. The error is that bound, or the
    largest standard error of the walk; `visited` counts nodes and steps.
    """

    inside: BoolArray
    log_joint: FloatArray
    weight: FloatArray
    log_missing: float
    certified: bool
    frequency: FloatArray
    error: float
    visited: int


class _Pass(NamedTuple):
    """How far down a pass went, by how much its bound fails, and the effort until it ended."""

    depth: float
    gap: float
    at: float


def search(
    T: FloatArray,
    log_width: FloatArray,
    scale: float,
    log_prior: FloatArray,
    *,
    needs: Needs = (),
    effort: float = EFFORT,
    rng: np.random.Generator,
) -> ModelsFound:
    """Find the models that carry the posterior, and bound what the others carry.

    The log joint probability of a model M, up to what is common to all models, is::

        -rss_M / (2 scale^2) - sum_{j in M} ln |r_jj| + sum_{j in M} log_width_j + log_prior[|M|]

    with rss and r of the model's own triangular factor. Branch and bound (`selection.bounds`) goes down from
    the best model in passes, each listing all models above a threshold, until the bound on the rest is
    certified. Where the passes say that it will not be in time, a walk over the models
    (`selection.model_walk`) takes the rest of the effort, or less if it is steady before. Effort is counted
    in nodes and steps, not by the clock, so that a search gives the same on any machine.

    Parameters
    ----------
    T : (p + 1, p + 1) upper triangular factor of ``[X y]``, the prior's rows stacked under it.
    log_width : (p,) ``ln(scale / sd)``, of the noise and the prior.
    log_prior : (p + 1,) log prior probability of one model of each size.
    needs : (child, parent) pairs, in no circle; a model with a child and without its parent has no mass.
    effort : about the seconds that it may take, at `NODE` a node and `WALKED` a step.
    rng : for the walk.

    Raises
    ------
    TermError : if there are over 128 candidates.

    Examples
    --------
    >>> X = np.array([[9.0, 0.1], [0.3, 9.0], [1.0, 0.0], [0.0, 1.0]])  # two rows of data, two of the prior
    >>> T = np.linalg.qr(np.column_stack((X, (20.0, 0.2, 0.0, 0.0))), mode="r")
    >>> found = search(T, np.zeros(2), 1.0, np.log(np.full(3, 1 / 3)), rng=np.random.default_rng(1))
    >>> found.certified, found.frequency.round(2).tolist()
    (True, [1.0, 0.11])
    """
    p = len(log_width)
    if p > LARGEST:
        raise TermError(f"{p} candidates are more than the {LARGEST} that are searched: leave out some")
    required = np.zeros((p, p), dtype=bool)  # the column of each row needs that of each column
    for child, parent in needs:
        required[child, parent] = True
    for j in range(p):
        required |= required[:, j : j + 1] & required[j]
    scaled = np.ascontiguousarray(T / np.append(np.exp(log_width), 1.0))
    problem = TreeProblem(2.0 * scale**2, np.asarray(log_prior, float), _words(required))
    models, spent = _branch_and_bound(scaled, problem, effort)
    return models if models.certified else _walk(scaled, problem, models, effort - spent, rng)


def _branch_and_bound(T: FloatArray, problem: TreeProblem, effort: float) -> tuple[ModelsFound, float]:
    """Pass after pass, each further down, until the bound is certified or will not be in time.

    Returns what was found, and the effort that it took.
    """
    top, room = best_guess(problem, levels(T)), MOST + T.shape[0]
    listing = Listing(np.empty((room, 2), np.uint64), np.empty(room), np.zeros(4))
    best, depth, passes, spent, share = None, FIRST, [], 0.0, FIRST_SHARE
    while True:
        models, ended = _one_pass(T, problem, top - depth, share * effort - spent, listing)
        spent, share = spent + NODE * models.visited, SHARE
        gap = math.log(max(models.error, TINY)) - math.log(max(TOLERANCE, TINY))
        passes.append(_Pass(depth, gap, spent))
        best = models if best is None or models.log_missing < best.log_missing else best
        step = _next_step(passes, SHARE * effort) if ended and not best.certified else None
        if step is None:
            return best, spent
        depth += step


def _one_pass(
    T: FloatArray, problem: TreeProblem, least: float, effort: float, listing: Listing
) -> tuple[ModelsFound, bool]:
    """List all models above exp(least), and whether the pass came to its end."""
    at = levels(T)
    listing.sums[:] = 0.0
    ended = False
    while not ended and NODE * listing.sums[NODES] < effort and listing.sums[MODELS] < MOST:
        ended = explore(problem, at, least, PASS, listing)
    m = min(int(listing.sums[MODELS]), MOST)
    log_joint, log_missing = listing.log_joint[:m].copy(), missing(at, listing, least)
    if m < listing.sums[MODELS]:
        rest = np.logaddexp.reduce(listing.log_joint[m : int(listing.sums[MODELS])])
        log_missing = float(np.logaddexp(log_missing, rest))
    p = T.shape[0] - 1
    inside = _bits(listing.words[:m], p)
    total = np.logaddexp.reduce(log_joint) if m else -math.inf
    weight, share = np.exp(log_joint - total), 1.0
    if log_missing < math.inf:
        share = math.exp(min(log_missing - np.logaddexp(total, log_missing), 0.0))
    models = ModelsFound(
        inside=inside,
        log_joint=log_joint,
        weight=weight,
        log_missing=log_missing,
        certified=share <= TOLERANCE,
        frequency=weight @ inside if m else np.full(p, math.nan),
        error=share,  # at most what is missing
        visited=int(listing.sums[NODES]),
    )
    return models, ended


def _next_step(passes: list[_Pass], effort: float) -> float | None:
    """How much further down the next pass goes; None where certainty is farther than the time allows.

    The bound on what is missing falls, and the time rises, about exponentially with the depth.
    """
    now = passes[-1]
    if len(passes) == 1:
        return min(now.gap, STEP)
    before = passes[-2]
    step = now.depth - before.depth
    fall = max((before.gap - now.gap) / step, 0.05)
    took = max(now.at - before.at, 1e-3)
    earlier = max(before.at - (passes[-3].at if len(passes) > 2 else 0.0), 1e-3)
    growth = max(math.log(took / earlier) / step, 0.0)
    needed = 1.05 * now.gap / fall + 0.1
    if now.at + took * math.exp(min(growth * needed, 50.0)) > HOPE * effort:
        return None
    return min(needed, STEP)


def _walk(
    T: FloatArray, problem: TreeProblem, models: ModelsFound, effort: float, rng: np.random.Generator
) -> ModelsFound:
    """Walk over the models in parallel chains: a sample of them takes the place of what was found."""
    p = T.shape[0] - 1
    first = models.inside[np.argmax(models.log_joint)] if len(models.log_joint) else np.zeros(p, dtype=bool)
    walked, error = walk_models(T, problem, first, _bits(problem.parents, p), int(effort / WALKED), rng)
    # each model once: those of most steps
    order = np.lexsort(walked.words.T)
    words = walked.words[order]
    new = np.ones(len(words), dtype=bool)
    new[1:] = (words[1:] != words[:-1]).any(axis=1)
    stay = np.add.reduceat(walked.stay[order], np.flatnonzero(new))
    best = np.argsort(-stay, kind="stable")[:MOST]
    return replace(
        models,
        inside=_bits(words[new][best], p),
        log_joint=walked.log_joint[order][new][best],
        weight=stay[best] / stay[best].sum(),
        log_missing=math.inf,
        frequency=walked.inclusion,
        error=float(error.max()),
        visited=models.visited + int(walked.count[0]),
    )


def _words(inside: BoolArray) -> WordArray:
    """Two words of 64 bits, (m, 2), of each row of `inside` (m, p)."""
    bits = np.zeros((len(inside), LARGEST), dtype=bool)
    bits[:, : inside.shape[1]] = inside
    return np.packbits(bits, axis=1, bitorder="little").view("<u8").astype(np.uint64)


def _bits(words: WordArray, p: int) -> BoolArray:
    """Inverse of `_words`."""
    packed = np.ascontiguousarray(words, "<u8").view(np.uint8)
    return np.unpackbits(packed, axis=1, bitorder="little", count=p).astype(bool)


def search_models(
    names: tuple[str, ...], c: Candidates, by_size: FloatArray, needs: Needs, scale: float | None
) -> Models:
    """Posterior over the models that carry it, with a bound on the probability of the others.

    Without a noise scale it is taken as the full library leaves it, whose uncertainty, a share of
    ``1/sqrt(2 n)``, moves the log odds of a term t sd from zero by no more than ``t^2/sqrt(2 n)``.
    """
    proper = np.isfinite(c.sd)
    sd = np.where(proper, c.sd, 1e8 * np.max(c.sd[proper]))
    held = noise_scale(Factor(c.columns, c.whole, c.dof), sd) if scale is None else scale
    a, T = len(c.always), c.at(held)
    found = search(
        np.ascontiguousarray(T[a:, a:]),
        np.log(held / c.sd[a:]),
        held,
        by_size,
        needs=needs,
        effort=EFFORT,
        rng=np.random.default_rng(SEED),
    )
    space, weight = listed(found.inside, found.weight)
    # of all models, from the share that some of them have of it
    most = np.argsort(-found.weight, kind="stable")[:MANY]
    level = float(np.logaddexp.reduce(found.log_joint[most]) - math.log(found.weight[most].sum()))
    w = WeightedModels(c, space, Scales.only(held), weight, level + log_flat(c, T, held))
    posterior = posterior_of(names, w)
    if found.certified:
        return replace(posterior, missing=found.error)
    inclusion = posterior.inclusion.copy()
    # sharper than the share of the steps, and what the error is of
    inclusion[[names.index(name) for name in c.names]] = found.frequency
    return replace(posterior, inclusion=inclusion, missing=math.nan, error=found.error)
