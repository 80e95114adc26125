"""Prior probability of each model: by its size, and by which terms call for others."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import TermError

ModelPrior = str | float
Needs = Sequence[tuple[int, int]]
"""(child, parent) by number: a model with the child must have the parent. A child has one parent."""


def log_model_prior(model_prior: ModelPrior, p: int, needs: Needs = ()) -> FloatArray:
    """Log prior probability of one admissible model of each size 0 ... p.

    Parameters
    ----------
    model_prior : ``beta-binomial`` (every size equally likely where all models are admissible), ``uniform``,
        or the prior probability of each candidate.
    p : candidates.
    needs : what makes a model inadmissible; the probabilities of the others sum to 1.

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
