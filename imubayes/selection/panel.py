"""Every other method on one component, run as its authors would, beside the decision; why they differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial, reduce
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from imubayes.algebra import BoolArray, FloatArray
from imubayes.algebra.factor import Factor, add, reorder
from imubayes.inference.case import Apart, apart
from imubayes.inference.dwells import Pieces, always, pieces_of
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc import Chains
from imubayes.inference.prior import ScalePrior
from imubayes.inference.residuals import SUSPECT, check_residuals
from imubayes.inference.summary import Summary
from imubayes.inference.whiten import effective_samples
from imubayes.selection.causes import (
    PREDICTIVE,
    Ballot,
    DisputedTerm,
    case_of,
    cause_of,
    decided,
    explained,
    line_of,
)
from imubayes.selection.compensations import Reduced, design_factor, reduced
from imubayes.selection.criteria import LARGEST, Criterion, criteria, with_sampled_noise
from imubayes.selection.decision import Selection, loose_fit
from imubayes.selection.model_sets import hierarchy
from imubayes.selection.sensitivity import (
    MORE,
    LeftOut,
    Mounts,
    Sensitivity,
    of_decision,
    sensitivity,
    without_parts,
)
from imubayes.selection.sindy import PATHS, Sparse, sparse_regressions

Answer = TypeVar("Answer")

INFORMATION = ("aic", "aicc", "bic", "hqc", "ebic")
SPARSE = tuple(PATHS)
OTHER_PRIORS, REDUCED = "g-prior", "reduced model"
EVERY = (*INFORMATION, *PREDICTIVE, *SPARSE, OTHER_PRIORS, REDUCED)
"""Names of the opinions, as they are left out."""

ORDER = ("evidence", OTHER_PRIORS, *INFORMATION, *PREDICTIVE, *SPARSE, "collapsed")
"""Methods in the order in which they are shown."""

LISTED = 20_000
"""Most models that are compared where all subsets are too many, and as many that are near them."""


class Unasked(NamedTuple):
    """An opinion that could not be had: the method's name, and why."""

    method: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """What the other methods say of one component.

    Attributes
    ----------
    criteria : information criteria and predictive scores.
    sindy : sparse regressions.
    sensitivity : inclusion under other priors.
    votes : all of them beside the decision.
    reduced : the smallest model that predicts the test as well as the posterior does; None where it was not
        found.
    unasked : what is left out of all this, and why. The decision stands without it.
    left_out : what coefficients are without each run or mount; None where there is nothing beside it.
    """

    criteria: tuple[Criterion, ...]
    sindy: tuple[Sparse, ...]
    sensitivity: Sensitivity
    votes: Votes
    reduced: Reduced | None
    unasked: tuple[Unasked, ...] = ()
    left_out: LeftOut | None = None


def panel_of(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    selection: Selection,
    *,
    rng: np.random.Generator,
    resamples: int = 100,
    chains: Chains | None = None,
    hierarchical: bool = False,
    widths: Sequence[float] = (),
    parts: Sequence[int] = (),
    mounts: Mounts = MappingProxyType({}),
) -> Panel:
    """Ask every other method about the candidates of a decision.

    A component of a case is asked about on its own runs; what the case's other runs say stays in every model.

    Parameters
    ----------
    summary, prior, selection : the problem, and the decision on one of its components.
    rows : of each run, in the order of the summary's.
    rng : for resampling dwells, and for draws of the posterior.
    resamples : campaigns drawn for the frequencies of the sparse regressions.
    chains : that sampled the noise, for importance sampling beside the closed-form leave-one-out.
    hierarchical : whether a model must hold what its terms call for.
    widths : factors on every prior sd that are tried; by default as many as do not take long.
    parts : indices of the component's own runs, where others take part in the factor.
    mounts : of runs that have several, when and which.
    """
    left_out: list[Unasked] = []
    asked = partial(_asked, left_out)
    question = asked(
        EVERY, lambda: _question(summary, prior, rows, selection, hierarchical=hierarchical, parts=parts)
    )
    if question is None:
        return Panel((), (), of_decision(selection), _votes(selection, left_out), None, tuple(left_out))
    compared = _compared(question, chains, left_out)
    sparse = _regressed(question, rng, resamples, left_out)
    others = asked([OTHER_PRIORS], lambda: _under_other_priors(question, summary, selection, widths))
    told = (compared, sparse, others or of_decision(selection))
    shortest = asked([REDUCED], lambda: reduced(selection, design_factor(question.own.rows), rng=rng))
    white = asked(["coloured noise"], lambda: coloured(summary, prior, rows, parts))
    whole = (question.factor, question.sd, question.pieces)
    without = asked(["parts left out"], lambda: without_parts(*whole, mounts))
    return Panel(*told, _votes(selection, left_out, *told, white or ()), shortest, tuple(left_out), without)


def _asked(left_out: list[Unasked], methods: Sequence[str], opinion: Callable[[], Answer]) -> Answer | None:
    """Ask for an opinion of some methods; where it fails, by whatever error, leave it out and say so."""
    try:
        return opinion()
    except Exception as error:  # noqa: BLE001  a peer's code may fail in any way; the decision needs none
        reason = " ".join(f"{type(error).__name__}, {error}".split())
        left_out += [Unasked(method, reason) for method in methods]
        return None


@dataclass(frozen=True, slots=True, eq=False)
class _Question:
    """What the methods are asked about: a component on its own runs, over the columns that are tested."""

    own: Apart
    factor: Factor
    sd: FloatArray
    pieces: list[Pieces]
    candidates: tuple[str, ...]
    needs: tuple[tuple[str, str], ...]
    samples: float
    among: BoolArray | None


def _question(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    selection: Selection,
    *,
    hierarchical: bool,
    parts: Sequence[int],
) -> _Question:
    models, among = selection.models, None
    candidates = models.candidates.names
    if len(candidates) > LARGEST:
        # another criterion may prefer a model to which the evidence gives nothing: it is looked for among the
        # most probable ones, and what differs from the first of these by a term
        order = np.argsort(-models.weight, kind="stable")[:LISTED]
        found, p = models.space.members(order), len(candidates)
        near = found[: max(1, LISTED // p), None, :] ^ np.eye(p, dtype=bool)
        among = np.unique(np.concatenate((found, near.reshape(-1, p))), axis=0)
    own = apart(summary, prior.sd, rows, parts or range(len(rows)), candidates)
    names = tuple(name for name in own.summary.names if name in models.candidates.columns)
    pieces = [pieces_of(r, run.noise) for r, run in zip(own.rows, own.summary.runs, strict=True)]
    told = reduce(add, (reorder(run.factor, candidates) for run in own.summary.runs))
    return _Question(
        own=own,
        factor=reorder(own.summary.factor, names),
        sd=own.sd[[own.summary.names.index(name) for name in names]],
        pieces=[*pieces, *([] if own.known is None else [always(own.known)])],
        candidates=candidates,
        needs=hierarchy(names) if hierarchical else (),
        samples=effective_samples(told, own.rows, [run.noise for run in own.summary.runs]),
        among=among,
    )


def _compared(q: _Question, chains: Chains | None, left_out: list[Unasked]) -> tuple[Criterion, ...]:
    """Criteria; those of information alone where the predictive ones fail."""

    def of(pieces: Sequence[Pieces]) -> tuple[Criterion, ...]:
        given = {"needs": q.needs, "samples": q.samples, "among": q.among, "widen": True}
        return criteria(q.factor, pieces, q.sd, q.candidates, **given)

    found = _asked(left_out, PREDICTIVE, lambda: of(q.pieces))
    if found is None:
        return _asked(left_out, INFORMATION, lambda: of([])) or ()
    if chains is None:
        return found
    log_lik = chains.log_likelihood
    sampled = partial(with_sampled_noise, found, log_lik.reshape(-1, log_lik.shape[-1]))
    return _asked(left_out, ["loo with the noise sampled"], sampled) or found


def _regressed(
    q: _Question, rng: np.random.Generator, resamples: int, left_out: list[Unasked]
) -> tuple[Sparse, ...]:
    """Sparse regressions, all on the same campaigns; one by one where one of them fails."""
    start, failed = deepcopy(rng), list[Unasked]()

    def of(optimizers: Sequence[str], rng: np.random.Generator) -> tuple[Sparse, ...]:
        given = {"rng": rng, "resamples": resamples, "optimizers": optimizers}
        return sparse_regressions(q.factor, q.pieces, q.sd, q.candidates, **given)

    found = _asked(failed, SPARSE, lambda: of(SPARSE, rng))
    if found is not None:
        return found
    each = [_asked(left_out, [name], partial(of, [name], deepcopy(start))) for name in SPARSE]
    return tuple(one for some in each for one in some or ())


def _under_other_priors(
    q: _Question, summary: Summary, selection: Selection, widths: Sequence[float]
) -> Sensitivity:
    """Inclusion under other priors; of many candidates what the decision has found itself."""
    if len(q.candidates) > MORE:
        return of_decision(selection)
    known = [extra.name for extra in summary.extras]
    given = {"known": known, "needs": q.needs, "costs": selection.costs, "widths": widths}
    return sensitivity(q.factor, q.sd, q.candidates, **given)


def _votes(
    selection: Selection,
    left_out: list[Unasked],
    compared: tuple[Criterion, ...] = (),
    sparse: tuple[Sparse, ...] = (),
    others: Sensitivity | None = None,
    white: tuple[str, ...] = (),
) -> Votes:
    """Votes with a row for who says nothing; without reasons for disagreements where these fail."""
    silent, alone = tuple(one.method for one in left_out), of_decision(selection)
    told = partial(votes, selection, compared, sparse, others or alone, coloured=white, silent=silent)
    return _asked(left_out, ["reasons of disagreements"], told) or votes(
        selection, (), (), alone, silent=EVERY
    )


def coloured(
    summary: Summary, prior: ScalePrior, rows: Sequence[Linear], parts: Sequence[int] = ()
) -> tuple[str, ...]:
    """Names of the runs (of the indices `parts`) whose noise was assumed white, and which are not."""
    asked = [(rows[k], summary.runs[k]) for k in parts or range(len(rows))]
    white = [(r, run) for r, run in asked if run.found.origin == "white"]
    theta, _ = loose_fit(summary, prior)
    return tuple(run.name for r, run in white if check_residuals(r, theta, run).whiteness_p < SUSPECT)


SIDES = (0.025, 0.975)
"""Ends of the interval of a coefficient that chains keep where zero is outside of it."""


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
            for disagreement in _on(selection, ballots, case_of(selection, sensitivity, k, tuple(coloured)))
        ),
    )


def with_chains(votes: Votes, selection: Selection, chains: Chains) -> Votes:
    """Votes with those of chains, which keep what is not zero with 95 % under the full library."""
    carrier = dict(zip((term.name for term in selection.terms), selection.carriers, strict=True))
    theta = chains.theta.reshape(-1, len(chains.names))
    own = theta[:, [chains.names.index(carrier[name]) for name in votes.terms]]
    low, high = np.quantile(own, SIDES, axis=0)
    above = np.mean(own > 0.0, axis=0)
    return replace(
        votes,
        methods=(*votes.methods, "collapsed"),
        strength=np.vstack((votes.strength, np.abs(2.0 * above - 1.0))),
        keeps=np.vstack((votes.keeps, low * high > 0.0)),
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
                line_of(c, len(c.model), len(names)),
                c.samples,
            )
            for c in criteria
        ),
        *(Ballot(s.optimizer, s.inclusion, _kept(s.names, s.model)) for s in sindy),
    ]


def _kept(names: Iterable[str], model: Sequence[str]) -> dict[str, bool]:
    return {name: name in model for name in names}


def _on(selection: Selection, ballots: Sequence[Ballot], case: DisputedTerm) -> list[Disagreement]:
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
            other = replace(ballot, swapped=swapped)
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
