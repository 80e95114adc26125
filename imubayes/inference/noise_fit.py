"""Posterior and evidence of one set of noise processes, and how small a process a run can still tell.

The mode and its curvature give Laplace's approximation, and the proposal of importance draws that put right
what is not normal: a process that hides below the others has a long tail to small sizes, and of a slow
Gauss-Markov process only the walk ``2 G^2 / tau`` is known. A ramp is linear: with and without it the
evidence comes from the same factor.

A process of size s is told from the others when they cannot take its place: the information of the run
against the best model without it, ``D = min over the others of sum_f [S1/S0 - 1 - ln(S1/S0)]`` over the
frequencies of the run (Whittle), must exceed what evidence of 19 to 1 takes. The others may grow, and one
that is not there may come in, at the price of their priors; chance may take 1.645 sqrt(2 D).
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.inference import SIDE
from imubayes.inference.importance import MixtureDraws, Student, drawn_until
from imubayes.inference.minimum import lowest
from imubayes.inference.noise_model import NoiseModel, likelihood, log_prior, mode_of, prior_of
from imubayes.sensors.noise import NoisePrior, Sizes

WIDE = 3.0
"""Width of a second hump about the mode, over the first one's: it meets a ridge that the first would miss."""


@dataclass(frozen=True, slots=True, eq=False)
class ProcessFit:
    """Posterior of one set of processes, from mode and curvature alone or with importance draws.

    Attributes
    ----------
    names : logarithms that vary: N, then those of B, K, Q, G, tau that the set has.
    mode : (k,) of the logarithms.
    root : (k, k) lower triangular, of the covariance at the mode.
    log_evidence : (without a ramp, with one), of the data under the set and its priors.
    weights : (m, 2) posterior weights without a ramp and with one; they add up to 1.
    ramps : (m, 2) mean and sd of the ramp, u/s, given each draw.
    drawn : what was drawn, to go on from; None where nothing was.
    """

    names: tuple[str, ...]
    mode: FloatArray
    root: FloatArray
    log_evidence: tuple[float, float]
    weights: FloatArray
    ramps: FloatArray
    drawn: MixtureDraws | None = None

    @property
    def draws(self) -> FloatArray:
        """Logarithms (m, k); the mode alone where nothing was drawn."""
        return self.mode[None] if self.drawn is None else self.drawn.draws


def parameters(processes: Container[str]) -> tuple[str, ...]:
    """Logarithms that a set of processes has.

    Examples
    --------
    >>> parameters(("K", "G"))
    ('N', 'K', 'G', 'tau')
    """
    return ("N", *(name for name in "BKQ" if name in processes), *(("G", "tau") if "G" in processes else ()))


def fit_mode(model: NoiseModel, names: tuple[str, ...], starts: Sequence[FloatArray]) -> ProcessFit:
    """Laplace's approximation of one set of processes, from the best of some starts (k,).

    `names` are the k logarithms that vary, as `parameters` gives them.
    """
    best = max(starts, key=lambda x: likelihood(model, names, x).level + log_prior(model, names, x))
    mode, covariance = mode_of(model, names, best)
    told = likelihood(model, names, mode)
    root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    spread = 0.5 * len(mode) * math.log(2.0 * math.pi) + float(np.sum(np.log(np.diag(root))))
    without, ramp = (told.levels + log_prior(model, names, mode) + spread).tolist()
    return ProcessFit(
        names=names,
        mode=mode,
        root=root,
        log_evidence=(without, ramp),
        weights=np.exp(told.levels - told.level)[None, :],
        ramps=np.array([told.last]) * model.prior["R"][1],
    )


def fit_draws(model: NoiseModel, fit: ProcessFit, rng: np.random.Generator, *, enough: float) -> ProcessFit:
    """Put the approximation of `fit_mode` right by importance draws, until `enough` of them count.

    A fit that has draws keeps them.
    """

    def target(x: FloatArray) -> Sequence[float]:
        told, prior = likelihood(model, fit.names, x), log_prior(model, fit.names, x)
        return told.level + prior, *(told.levels + prior).tolist(), *told.last

    width = prior_of(model, fit.names)[1]
    humps = [Student(fit.mode, wide * fit.root) for wide in (1.0, WIDE)]
    drawn = drawn_until(target, fit.drawn or humps, width, rng, enough=enough)
    logs = drawn.told[:, 1:3] - drawn.log_proposal[:, None]
    peak = float(np.max(logs))
    weights = np.exp(logs - peak)
    levels = np.log(np.maximum(weights.mean(axis=0), np.finfo(float).tiny)) + peak
    return replace(
        fit,
        log_evidence=(float(levels[0]), float(levels[1])),
        weights=weights / weights.sum(),
        ramps=drawn.told[:, 3:] * model.prior["R"][1],
        drawn=drawn,
    )


EVIDENCE = math.log(19.0)
"""Nats of evidence that make a process needed."""

PARAMETER = 2.0
"""Nats that a parameter more costs, its prior over its posterior: for widths of the class of 0.5 to 2."""

REACH = 8.0
"""Sds of a prior within which a limit is sought."""

BINS = 40
"""Frequencies of a level, each standing for its neighbours."""

HALVINGS = 10
"""Halvings of the interval of ln s: to a hundredth of a prior sd."""


class Spectrum(NamedTuple):
    """Frequencies of a run: (q,) Hz, how many Fourier frequencies each stands for, length averaged, s."""

    f: FloatArray
    count: FloatArray
    length: FloatArray


def detection_limits(data: NoiseModel, noise: Sizes, candidates: Sequence[str]) -> dict[str, float]:
    """Size from which each candidate is found with 95 %, beside the other processes; infinite if at none.

    `noise` has the processes of the run; the candidates could take each other's place.
    """
    begins = np.flatnonzero(~data.joined)
    # lengths of the unbroken parts, where the columns are enough to take out the mean of each
    few = data.table.shape[1] - 2 < len(begins) or len(begins) == 1
    parts = None if few else np.add.reduceat(data.rows.duration, begins)
    grid = spectrum(data.levels, ramp="R" in candidates, parts=parts)
    limits = {
        name: _limit(grid, noise, name, [c for c in candidates if c not in (name, "R")], data.prior)
        for name in candidates
        if name != "R"
    }
    return limits | ({"R": _ramp_limit(data, grid, noise, candidates)} if "R" in candidates else {})


def spectrum(
    levels: Sequence[tuple[float, int]], *, ramp: bool = False, parts: FloatArray | None = None
) -> Spectrum:
    """Frequencies that the averages of a run, (length in s, how many), see; a ramp takes the lowest one.

    Where the means of parts of these lengths, s, are taken out, only parts that hold a period see a
    frequency.

    Examples
    --------
    >>> whole, parted = (spectrum(((1.0, 100),), parts=p) for p in (None, np.array([30.0, 70.0])))
    >>> float(whole.count[whole.f < 0.03].sum()), round(float(parted.count[parted.f < 0.03].sum()), 3)
    (2.0, 0.7)
    """
    tables = []
    for level, (length, number) in enumerate(levels):
        first = 1 + (ramp and level == len(levels) - 1)
        edges = np.geomspace(first, max(number // 2, first) + 1, BINS + 1)
        edges = np.unique(np.rint(edges).astype(int))
        count, center = np.diff(edges).astype(float), 0.5 * (edges[:-1] + edges[1:] - 1)
        tables.append((center / (number * length), count, np.full(len(count), length)))
    f, count, length = (np.concatenate(column) for column in zip(*tables, strict=True))
    if parts is not None:
        count = count * (parts * (parts * f[:, None] >= 1.0)).sum(axis=1) / parts.sum()
    return Spectrum(f, count, length)


def density(noise: Sizes, grid: Spectrum) -> FloatArray:
    """Two-sided density (q,) of averages over the grid's lengths, u^2/Hz; a ramp has none."""
    return np.sum([_part(name, noise, grid) for name in "NBKQG" if name in noise], axis=0)


def _part(name: str, noise: Sizes, grid: Spectrum) -> FloatArray:
    """Density of one process."""
    w, size = 2.0 * np.pi * grid.f, noise[name]
    if name == "N":
        return np.full_like(w, size**2)
    if name == "B":
        return size**2 / w
    if name == "K":
        return (size / w) ** 2
    if name == "Q":
        return 4.0 * size**2 / grid.length * np.sin(0.5 * w * grid.length) ** 2
    return 2.0 * size**2 * noise["tau"] / (1.0 + (w * noise["tau"]) ** 2)


def _slopes(names: Sequence[str], noise: Sizes, grid: Spectrum) -> FloatArray:
    """Derivatives (k, q) of the density by the logarithms of the sizes and of the time constant."""
    x2 = (2.0 * np.pi * grid.f * noise.get("tau", 1.0)) ** 2
    return np.array(
        [
            _part("G", noise, grid) * (1.0 - x2) / (1.0 + x2)
            if name == "tau"
            else 2.0 * _part(name, noise, grid)
            for name in names
        ]
    )


def information(there: FloatArray, instead: FloatArray, count: FloatArray) -> float:
    """Mean log likelihood ratio, nats, of a log with the density `there` against the density `instead`."""
    ratio = there / instead
    return float(count @ (ratio - 1.0 - np.log(ratio)))


def _limit(grid: Spectrum, noise: Sizes, name: str, others: Sequence[str], prior: NoisePrior) -> float:
    """Halve the interval of ln s: where a set with it beats every one without in 19 logs of twenty."""
    median, width = prior[name]
    usual, own = noise.get("tau", prior["tau"][0]), PARAMETER * (2 if name == "G" else 1)
    present = [n for n in others if n in noise]
    newcomers = [(), *((n,) for n in others if n not in present)]

    def told(log_size: float) -> bool:
        there = {**noise, name: math.exp(log_size), "tau": usual}
        price = [PARAMETER * (len(new) + ("G" in new)) for new in newcomers]
        left = [_alternative(grid, there, ("N", *present), new, prior) for new in newcomers]
        return min(map(sum, zip(left, price, strict=True))) - own > EVIDENCE

    low, high = math.log(median) - REACH * width, math.log(median) + REACH * width
    if not told(high):
        return math.inf
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if told(middle) else (middle, high)
    return math.exp(high)


def _alternative(
    grid: Spectrum, there: Sizes, present: Sequence[str], new: Sequence[str], prior: NoisePrior
) -> float:
    """Information against the best sizes of one set, their price included, less what chance takes."""
    names = [*present, *new, *(["tau"] if "G" in (*present, *new) else [])]
    center = np.log([prior[n][0] for n in names])
    width = np.array([prior[n][1] for n in names])
    held = np.array([n in present or (n == "tau" and "G" in present) for n in names])
    now = np.where(held, np.log([there.get(n, 1.0) for n in names]), center)
    spent, truth = np.where(held, ((now - center) / width) ** 2, 0.0), density(there, grid)

    def sizes(x: FloatArray) -> Sizes:
        return dict(zip(names, np.exp(x).tolist(), strict=True))

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        instead, z = density(sizes(x), grid), (x - center) / width
        slope = _slopes(names, sizes(x), grid) @ (grid.count * (1.0 - truth / instead) / instead)
        price = 0.5 * float(np.sum(z**2 - spent))
        return information(truth, instead, grid.count) + price, slope + z / width

    ends = center - REACH * width, center + REACH * width
    starts = [np.where(held, now, center + shift * width) for shift in ((0.0, 2.0) if new else (0.0,))]
    reached = lowest(cost, np.array(starts), width, ends)
    # of the log likelihood ratio, sd sqrt(2 D) at a mean of D, chance takes away that in one log of twenty
    D = information(truth, density(sizes(reached.x), grid), grid.count)
    return reached.level - SIDE * math.sqrt(2.0 * D)


def _ramp_limit(data: NoiseModel, grid: Spectrum, noise: Sizes, candidates: Sequence[str]) -> float:
    """Ramp that a random walk could not stand for, u/s."""
    median, width = data.prior["K"]
    walks = (
        np.exp(math.log(median) + width * np.linspace(-4.0, 4.0, 17)) if "K" in candidates else np.empty(0)
    )
    models = [noise, *({**noise, "K": walk} for walk in walks.tolist())]
    truth = density(noise, grid)
    told = np.array([information(truth, density(one, grid), grid.count) for one in models])
    fits = [likelihood(data, names := parameters(one), np.log([one[n] for n in names])) for one in models]
    slopes = np.array([1.0 / fit.last[1] ** 2 - 1.0 for fit in fits])
    if not slopes.min() > 0.0:
        return math.inf
    # half the square of the ramp's size over its sd is its own information; the ramp is one parameter more
    need = EVIDENCE + PARAMETER - PARAMETER * (np.arange(len(models)) > 0) - told
    # mean information D that leaves what is needed in 19 logs of 20: D - 1.645 sqrt(2 D) = need
    half = SIDE / math.sqrt(2.0)
    square = 2.0 * np.where(need > 0.0, (half + np.sqrt(half**2 + np.maximum(need, 0.0))) ** 2, 0.0) / slopes
    return data.prior["R"][1] * float(np.sqrt(np.max(square)))
