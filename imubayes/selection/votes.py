"""What every method says of every term, side by side, and why they differ."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.selection.causes import Ballot, DisputedTerm, case_of, cause_of, decided, explained, line_of
from imubayes.selection.criteria import Criterion
from imubayes.selection.decision import Selection
from imubayes.selection.sensitivity import Sensitivity
from imubayes.selection.sindy import Sparse

ORDER = (
    *("evidence", "g-prior"),
    *("aic", "aicc", "bic", "hqc", "ebic", "waic", "loo", "leave_one_run_out"),
    *("stlsq", "sr3", "ssr", "frols"),
)
"""Methods in the order in which they are shown."""


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Methods that do not share the decision on one term.

    Attributes
    ----------
    term : its name.
    methods : that keep it where the decision does not, or drop it where the decision keeps it.
    cause : ``collinearity``, ``coloured noise``, ``prior width``, ``model prior``, ``sample size`` or ``weak
        effect``; what is none of these is the ``method``'s own.
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


def votes(
    selection: Selection,
    criteria: Sequence[Criterion],
    sindy: Sequence[Sparse],
    sensitivity: Sensitivity,
    *,
    coloured: Sequence[str] = (),
    silent: Sequence[str] = (),
) -> Votes:
    """Put the methods beside the decision on a component.

    Parameters
    ----------
    selection : the decision.
    criteria, sindy, sensitivity : what the other methods say of the same candidates.
    coloured : runs whose noise was assumed white, and whose residuals are not.
    silent : methods that were not asked: their rows say nothing.
    """
    ballots = _ballots(selection, criteria, sindy, sensitivity)
    missing = {name for name in silent if name in ORDER} - {ballot.method for ballot in ballots}
    if missing:
        ballots += [Ballot(name, {}, {}) for name in missing]
        ballots.sort(key=lambda ballot: ORDER.index(ballot.method))
    tested = [k for k, name in enumerate(selection.columns) if name in selection.models.candidates.names]
    columns = [selection.columns[k] for k in tested]
    strength = [[ballot.strength.get(column, math.nan) for column in columns] for ballot in ballots]
    keeps = [[float(ballot.keeps.get(column, math.nan)) for column in columns] for ballot in ballots]
    return Votes(
        terms=tuple(selection.terms[k].name for k in tested),
        methods=tuple(ballot.method for ballot in ballots),
        strength=np.array(strength, dtype=float).reshape(len(ballots), len(columns)),
        keeps=np.array(keeps, dtype=float).reshape(len(ballots), len(columns)),
        disagreements=tuple(
            disagreement
            for k in tested
            for disagreement in _on(selection, ballots, case_of(selection, sensitivity, k), tuple(coloured))
        ),
    )


def _ballots(
    selection: Selection, criteria: Sequence[Criterion], sindy: Sequence[Sparse], sensitivity: Sensitivity
) -> list[Ballot]:
    """Ballots of all methods, in the order in which they are shown."""
    keep, names = selection.costs.keep, selection.models.candidates.names
    column = {term.name: name for term, name in zip(selection.terms, selection.columns, strict=True)}
    told = {column[term.name]: term.inclusion for term in selection.terms}
    evidence = {name: inclusion for name, inclusion in told.items() if name in names}
    g_prior = dict(zip(sensitivity.names, sensitivity.g_prior.tolist(), strict=True))
    lines = {c.name: line_of(c, len(c.model), len(names)) for c in criteria}
    return [
        *(
            Ballot(method, told, {name: share >= keep for name, share in told.items() if share == share})
            for method, told in (("evidence", evidence), ("g-prior", g_prior))
        ),
        *(
            Ballot(
                c.name,
                c.inclusion,
                _kept(c.inclusion, c.model) if c.compared else {},
                lines[c.name],
                c.samples,
            )
            for c in criteria
        ),
        *(Ballot(s.optimizer, s.inclusion, _kept(s.names, s.model)) for s in sindy),
    ]


def _kept(names: Iterable[str], model: Sequence[str]) -> dict[str, bool]:
    return {name: name in model for name in names}


def _on(
    selection: Selection, ballots: Sequence[Ballot], case: DisputedTerm, coloured: tuple[str, ...]
) -> list[Disagreement]:
    """Disagreements on one term: one for each cause."""
    column = dict(zip((t.name for t in selection.terms), selection.columns, strict=True))
    kept = {column[term.name]: decided(term, selection) for term in selection.terms}
    own = column[case.term.name]
    found: dict[str, list[Ballot]] = {}
    for ballot in ballots:
        if ballot.method != "evidence" and ballot.keeps.get(own) is (not case.kept):
            # the other way round: kept where this one is dropped, and dropped where this one is kept
            swapped = tuple(
                name
                for name, _ in case.alike
                if case.kept is not None
                and kept[name] is (not case.kept)
                and ballot.keeps.get(name) is case.kept
            )
            other = replace(ballot, swapped=swapped, coloured=coloured)
            found.setdefault(cause_of(case, other), []).append(other)
    rest = [ballot for ballot in ballots if ballot.method != "evidence" and own in ballot.keeps]
    return [
        Disagreement(
            term=case.term.name,
            methods=tuple(other.method for other in others),
            cause=cause,
            text=explained(case, cause, others, everyone=len(others) == len(rest) > 1),
        )
        for cause, others in found.items()
    ]
