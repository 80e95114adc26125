"""Every other method on one component, run as its authors would, beside the decision; why they differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
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
from imubayes.selection.decision import Selection, loose_fit, seen_by
from imubayes.selection.enumerate import enumerate_models
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
from imubayes.selection.sindy import OPTIMIZERS, Sparse, sparse_regressions
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.work import Begin, here

Answer = TypeVar("Answer")

INFORMATION = ("aic", "aicc", "bic", "hqc", "ebic")
OTHER_PRIORS, REDUCED = "g-prior", "reduced model"
EVERY = (*INFORMATION, *PREDICTIVE, *OPTIMIZERS, OTHER_PRIORS, REDUCED)
"""Names of the opinions, as they are left out."""

ORDER = ("evidence", OTHER_PRIORS, *INFORMATION, *PREDICTIVE, *OPTIMIZERS, "collapsed")
"""Methods in the order in which they are shown."""

LISTED = 20_000
"""Most models that are compared where all subsets are too many, and as many that are near them."""

SMALL = 9
"""Candidates of the problem that loads and compiles: no fewer fill the lanes of the enumeration."""


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


Regressed = tuple[tuple[Sparse, ...], list[Unasked], np.random.Generator]
"""Sparse regressions, those that could not be had, and the source of randomness after them."""


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What the methods are asked about: a component on its own runs, over the columns that are tested.

    `known` are the columns that are no terms, and `white` gives the names of runs (see `coloured`).
    """

    own: Apart
    factor: Factor
    sd: FloatArray
    pieces: list[Pieces]
    candidates: tuple[str, ...]
    known: tuple[str, ...]
    needs: tuple[tuple[str, str], ...]
    samples: float
    white: Callable[[], tuple[str, ...]]

    @property
    def scores(self) -> Callable[..., tuple[Criterion, ...]]:
        """Criteria of given pieces, of all models or among some."""
        given = {"needs": self.needs, "samples": self.samples, "widen": True}
        return partial(criteria, self.factor, sd=self.sd, candidates=self.candidates, **given)


Compared = tuple[tuple[Criterion, ...], list[Unasked]]
"""Criteria, and those that could not be had."""


class Begun(NamedTuple):
    """A question, and what waits for what was begun on it.

    Criteria of many candidates need the models that the decision comes to, which has found as well what other
    priors give: None stands for them.
    """

    question: Question
    criteria: Callable[[], Compared] | None
    regressions: Callable[[], Regressed]
    priors: Callable[[], Sensitivity] | None


def begun(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    *,
    rng: np.random.Generator,
    component: str = "",
    resamples: int = 100,
    hierarchical: bool = False,
    parts: Sequence[int] = (),
    costs: Costs = EQUAL,
    widths: Sequence[float] = (),
    begin: Begin = here,
) -> Begun | list[Unasked]:
    """Begin what takes long and needs no decision, or say why no method can be asked.

    A component of a case is asked about on its own runs; what the case's other runs say stays in every model.

    Parameters
    ----------
    summary, prior : of the problem.
    rows : of each run, in the order of the summary's.
    rng : for resampling dwells, and for draws of the posterior.
    component : name of a case's component, whose library the summary has.
    resamples : campaigns drawn for the frequencies of the sparse regressions.
    hierarchical : whether a model must hold what its terms call for.
    parts : indices of the component's own runs, where others take part in the factor.
    costs, widths : of the decision, and factors on every prior sd that are tried (see `sensitivity`).
    begin : does the work (see `imubayes.work.beside`).
    """
    left_out: list[Unasked] = []
    asked = (summary, prior, rows, component, parts or range(len(rows)))
    question = _asked(left_out, EVERY, lambda: _question(*asked, hierarchical=hierarchical))
    if question is None:
        return left_out
    q = question
    regressions = begin(regressed, q.factor, q.pieces, q.sd, q.candidates, rng, resamples)
    among = None if len(q.candidates) > LARGEST else begin(compared, q.scores, q.pieces)
    if len(q.candidates) > MORE:
        return Begun(q, among, regressions, None)
    given = {"known": q.known, "needs": q.needs, "costs": costs, "widths": widths}
    priors = begin(partial(sensitivity, **given), q.factor, q.sd, q.candidates)
    return Begun(q, among, regressions, priors)


def panel_of(
    asked: Begun | list[Unasked],
    selection: Selection,
    *,
    chains: Chains | None = None,
    mounts: Mounts = MappingProxyType({}),
) -> Panel:
    """Ask every other method about the candidates of a decision.

    Parameters
    ----------
    selection : the decision on the component.
    chains : that sampled the noise, for importance sampling beside the closed-form leave-one-out.
    mounts : of runs that have several, when and which.
    """
    if isinstance(asked, list):
        left_out = list(asked)
        return Panel((), (), of_decision(selection), _votes(selection, left_out), None, tuple(left_out))
    q, left_out = asked.question, list[Unasked]()
    ask = partial(_asked, left_out)
    white = ask(["coloured noise"], q.white)
    without = ask(["parts left out"], lambda: without_parts(q.factor, q.sd, q.pieces, mounts))
    others = ask([OTHER_PRIORS], asked.priors) if asked.priors else None
    of_criteria, failed = (
        asked.criteria() if asked.criteria else compared(q.scores, q.pieces, _near(selection))
    )
    left_out += failed
    if of_criteria and chains is not None:
        log_lik = chains.log_likelihood
        sampled = partial(with_sampled_noise, of_criteria, log_lik.reshape(-1, log_lik.shape[-1]))
        of_criteria = ask(["loo with the noise sampled"], sampled) or of_criteria
    sparse, failed, rng = asked.regressions()
    left_out += failed
    shortest = ask([REDUCED], lambda: reduced(selection, design_factor(q.own.rows), rng=rng))
    told = (of_criteria, sparse, others or of_decision(selection))
    return Panel(*told, _votes(selection, left_out, *told, white or ()), shortest, tuple(left_out), without)


def _asked(left_out: list[Unasked], methods: Sequence[str], opinion: Callable[[], Answer]) -> Answer | None:
    """Ask for an opinion of some methods; where it fails, by whatever error, leave it out and say so."""
    try:
        return opinion()
    except Exception as error:  # noqa: BLE001  a peer's code may fail in any way; the decision needs none
        reason = " ".join(f"{type(error).__name__}, {error}".split())
        left_out += [Unasked(method, reason) for method in methods]
        return None


def _question(
    summary: Summary,
    prior: ScalePrior,
    rows: Sequence[Linear],
    component: str,
    parts: Sequence[int],
    *,
    hierarchical: bool,
) -> Question:
    prefix, excited = f"{component}." if component else "", seen_by(summary, prior).excited
    terms = {f"{prefix}{term.name}" for term in summary.candidates.terms}
    candidates = tuple(name for name in excited if name in terms)
    own = apart(summary, prior.sd, rows, parts, candidates)
    names = tuple(name for name in own.summary.names if name in excited)
    pieces = [pieces_of(r, run.noise) for r, run in zip(own.rows, own.summary.runs, strict=True)]
    told = add(*(reorder(run.factor, candidates) for run in own.summary.runs))
    return Question(
        own=own,
        factor=reorder(own.summary.factor, names),
        sd=own.sd[[own.summary.names.index(name) for name in names]],
        pieces=[*pieces, *([] if own.known is None else [always(own.known)])],
        candidates=candidates,
        known=tuple(extra.name for extra in summary.extras),
        needs=hierarchy(names) if hierarchical else (),
        samples=effective_samples(told, own.rows, [run.noise for run in own.summary.runs]),
        white=lambda: coloured(summary, prior, rows, parts),
    )


def compared(
    scores: Callable[..., tuple[Criterion, ...]], pieces: Sequence[Pieces], among: BoolArray | None = None
) -> Compared:
    """Criteria of all models or `among` some; of information alone where the predictive ones fail."""
    left_out = list[Unasked]()
    found = _asked(left_out, PREDICTIVE, lambda: scores(pieces=pieces, among=among))
    return found or _asked(left_out, INFORMATION, lambda: scores(pieces=[], among=among)) or (), left_out


def _near(selection: Selection) -> BoolArray:
    """Models (m, p) that are compared where all are too many.

    Another criterion may prefer a model to which the evidence gives nothing: it is looked for among the most
    probable ones, and what differs from the first of these by a term.
    """
    models, p = selection.models, len(selection.models.candidates.names)
    found = models.space.members(np.argsort(-models.weight, kind="stable")[:LISTED])
    near = found[: max(1, LISTED // p), None, :] ^ np.eye(p, dtype=bool)
    return np.unique(np.concatenate((found, near.reshape(-1, p))), axis=0)


def regressed(
    factor: Factor,
    pieces: Sequence[Pieces],
    sd: FloatArray,
    candidates: tuple[str, ...],
    rng: np.random.Generator,
    resamples: int,
) -> Regressed:
    """Sparse regressions, all on the same campaigns; one by one where one of them fails."""
    left_out = list[Unasked]()

    def of(optimizers: Sequence[str]) -> Regressed:
        own = deepcopy(rng)
        given = {"rng": own, "resamples": resamples, "optimizers": optimizers}
        sparse = sparse_regressions(factor, pieces, sd, candidates, **given)
        return sparse, left_out, own

    if (whole := _asked([], OPTIMIZERS, lambda: of(OPTIMIZERS))) is not None:
        return whole
    each = [_asked(left_out, [name], partial(of, [name])) for name in OPTIMIZERS]
    return tuple(sparse for some in each if some for sparse in some[0]), left_out, rng


def ready() -> None:
    """Load and compile what `regressed` and the decision need, with a small problem.

    The peers come first: while they are loaded another process may compile what both need.
    """
    rng = np.random.default_rng(1)
    X = rng.normal(size=(4 * SMALL, SMALL))
    small = Summary.from_arrays(X, X[:, 0] + rng.normal(size=len(X)), tuple(map(str, range(SMALL))))
    sparse_regressions(small.factor, [], np.ones(SMALL), small.names, rng=rng, resamples=0)
    enumerate_models(small, ScalePrior(1.0))


def _votes(
    selection: Selection,
    left_out: list[Unasked],
    compared: tuple[Criterion, ...] = (),
    sparse: tuple[Sparse, ...] = (),
    others: Sensitivity | None = None,
    white: tuple[str, ...] = (),
) -> Votes:
    """Votes with a row for who says nothing; without reasons for disagreements where these fail."""
    silent, alone = tuple(opinion.method for opinion in left_out), of_decision(selection)
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
