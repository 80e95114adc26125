"""What every method says of every term, side by side, and why they differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Methods that do not share the decision on one term.

    Attributes
    ----------
    term : its name.
    methods : that keep it where the decision does not, or drop it where the decision keeps it.
    cause : ``prior width``, ``collinearity``, ``coloured noise``, ``sample size`` or ``weak effect``.
    text : in words, made from the numbers.
    """

    term: str
    methods: tuple[str, ...]
    cause: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Votes:
    """Votes of the methods on the terms of a component.

    Attributes
    ----------
    terms : names of the terms that the test excites, t of them, in the order of the verdicts.
    methods : m of them: ``evidence``, ``g-prior``, the criteria, then the sparse regressions.
    strength : (m, t) from 0 (out) to 1 (in): a probability, a weight or a frequency; NaN where a method says
        nothing.
    keeps : (m, t) 1 in the method's model, 0 out, NaN where it says nothing.
    disagreements : where methods differ from the decision.
    """

    terms: tuple[str, ...]
    methods: tuple[str, ...]
    strength: FloatArray
    keeps: FloatArray
    disagreements: tuple[Disagreement, ...]
