"""Information criteria and predictive scores: the best subset under each, and what each says of a term."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Criterion:
    """What one criterion says.

    Attributes
    ----------
    name : ``aic``, ``aicc``, ``bic``, ``hqc``, ``ebic``, ``waic``, ``loo`` (a dwell left out) or
        ``leave_one_run_out``.
    model : the best subset.
    value : of that subset on the deviance scale: smaller is better.
    lead : how much worse the next subset is.
    inclusion : of each candidate: sum of the weights ``exp(-difference / 2)`` of the subsets with it.
    compared : subsets that were compared.
    exact : whether no subset was left out.
    samples : effective sample size of the coloured noise, where the criterion has one; else NaN.
    pareto_k : largest k of importance sampling, where it is used; NaN where the score is closed-form.
    note : what a reader should know, in words; else empty.
    """

    name: str
    model: tuple[str, ...]
    value: float
    lead: float
    inclusion: Mapping[str, float]
    compared: int
    exact: bool
    samples: float
    pareto_k: float
    note: str = ""
