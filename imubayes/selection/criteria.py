"""Information criteria and predictive scores: the best subset under each, and what each says of a term.

With the deviance ``D = n ln(2 pi rss/n) + n + ln|noise|`` (coefficients flat, noise scale profiled), K
coefficients and the scale among the parameters, P candidates of which k are in, and the effective sample size
m of the coloured noise::

    AIC  = D + 2 K                        AICc = D + 2 K m / (m - K - 1)
    BIC  = D + K ln m                     HQC  = D + 2 K ln ln m
    EBIC = D + K ln m + 2 ln C(P, k)      (Chen and Chen 2008 with gamma = 1: every size equally likely)

The scale is profiled, so that rows of unknown noise are treated like whitened ones; with many whitened rows
it makes no difference, for ``n ln(1 + d/n)`` is then d. Of columns that depend on each other every one counts
in K, though the residual is that of their span: the smallest subset with that span wins.

WAIC and leave-one-out take the physical prior at the noise scale of the full library (see `predictive`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from imubayes.algebra import BoolArray, FloatArray, IntArray
from imubayes.algebra.factor import Factor, noise_scale, with_prior_rows
from imubayes.errors import TermError
from imubayes.inference.dwells import Pieces
from imubayes.selection.mixture import Candidates, candidates
from imubayes.selection.model_sets import Space, admissible, by_number, descended
from imubayes.selection.predictive import RELIABLE, Held, by_dwell, by_run, fits, leave_out, psis_loo, waic

Needs = tuple[tuple[str, str], ...]

LARGEST = 22
"""Most candidates of which all subsets are compared: 2^22 deviances are 34 megabytes a criterion."""

WALKED = 3e7
"""Models times parts left out that are visited by the tree: two seconds."""

LISTED = 1e5
"""Models times parts left out beyond that, each model from its own factor: about as long."""

SCORED = 200
"""Models that WAIC is computed for: those that predict a dwell left out best."""

HOLD = 1e-8
"""Rows that hold a null direction at zero, relative to the norms of the columns: of what the data tell of a
direction of singular value s beside its columns, (HOLD/s)^2 is lost, and of what rounding (1e-16) feigns to
tell, all but 1e-16."""

EXACT = 1e-10
"""Smallest residual relative to the response: below, rounding would be read as signal."""

UNDEFINED = "no subset has a finite value: the data are too few for this criterion"


@dataclass(frozen=True, slots=True)
class Criterion:
    """What one criterion says.

    Attributes
    ----------
    name : ``aic``, ``aicc``, ``bic``, ``hqc``, ``ebic``, ``waic``, ``loo`` (a dwell left out) or
        ``leave_one_run_out``.
    model : the best subset.
    value : of that subset on the deviance scale: smaller is better.
    lead : how much worse the next subset is; NaN where there is none.
    inclusion : of each candidate: sum of the weights ``exp(-difference / 2)`` of the subsets with it.
    compared : subsets that were compared.
    exact : whether no subset was left out.
    samples : effective sample size of the coloured noise, where the criterion has one; else NaN.
    pareto_k : largest k of the importance sampling by which the full library is scored with the noise
        sampled; NaN without chains. The criterion's own score has a closed form.
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


def criteria(
    factor: Factor,
    pieces: Sequence[Pieces],
    sd: FloatArray,
    candidates: tuple[str, ...],
    *,
    needs: Needs = (),
    samples: float | None = None,
    among: BoolArray | None = None,
    widen: bool = False,
) -> tuple[Criterion, ...]:
    """Compare all subsets of the candidates under every criterion.

    Parameters
    ----------
    factor : of all rows, over the excited columns. Columns that are no candidates are in every model, under
        their priors.
    pieces : of each run, over the columns of `factor` and perhaps others; without any, the scores that leave
        dwells or runs out are not given.
    sd : (w,) prior sd of each column of `factor`, SI; inf for a flat prior of a column that is no candidate.
    candidates : p names.
    needs : (child, parent): a subset with the child and without the parent is not admissible. A parent that
        is no candidate is taken as there.
    samples : effective sample size of the coloured noise (`inference.whiten.effective_samples`); by default
        the rows.
    among : (m, p) subsets to compare, where all of them are too many.
    widen : whether to compare as well what can be reached from the best of `among` by adding, removing or
        exchanging terms, as long as an information criterion falls.

    Returns
    -------
    ``aic``, ``aicc``, ``bic``, ``hqc``, ``ebic``, then with pieces ``waic``, ``loo``, ``leave_one_run_out``.

    Raises
    ------
    TermError : if a candidate is no column, if there are over 22 and no list of subsets, or if none of a list
        is admissible.

    Examples
    --------
    >>> from imubayes.algebra.factor import factor_of
    >>> rng = np.random.default_rng(1)
    >>> X = rng.normal(size=(50, 2))
    >>> f = factor_of(X, 2.0 * X[:, 0] + rng.normal(size=50), ("a", "b"))
    >>> [(c.name, c.model) for c in criteria(f, [], np.ones(2), ("a", "b"))][:2]
    [('aic', ('a',)), ('aicc', ('a',))]
    """
    c, scale, p = _prepared(factor, sd, candidates), noise_scale(factor, sd), len(candidates)
    size = float(factor.n if samples is None else samples)
    if among is None and p > LARGEST:
        raise TermError(
            f"{p} candidates have too many subsets to compare all, up to {LARGEST} have not: give the subsets"
            " that a search found (among)"
        )
    if among is not None and widen:
        among = descended(
            among,
            lambda some: _information_of(c, scale, factor, some, size),
            lambda inside: _with_parents(inside, candidates, needs),
        )
    space = Space(p, among)
    allowed = _admissible(space, candidates, needs)
    best = partial(_best, space, allowed, candidates)
    found = [
        best(name, (values, None, ""), samples=math.nan if name == "aic" else size)
        for name, values in _information_of(c, scale, factor, space, size).items()
    ]
    if not pieces:
        return tuple(found)
    dwells, runs = by_dwell(pieces, c, scale), by_run(pieces, c, scale)
    near = _left_out(space, allowed, dwells)
    which = _first(allowed, near[0], SCORED)
    scores = np.array([waic(dwells, inside) for inside in space.members(which)])
    alone = "the only run is predicted from the prior: this is the evidence" if len(pieces) == 1 else ""
    return (
        *found,
        best("waic", _completed(allowed, near[0], which, scores, "leave-one-out")),
        best("loo", near),
        best("leave_one_run_out", _left_out(space, allowed, runs), note=alone),
    )


def with_sampled_noise(found: Sequence[Criterion], log_lik: FloatArray) -> tuple[Criterion, ...]:
    """Criteria of which leave-one-out says how chains that sampled the noise judge the full library.

    `log_lik` (draws, q) is of each dwell under each draw of the chains. It is that of averages within the
    dwell: its sum is on another level than the criterion's value, which is of all rows.
    """
    elpd, k = psis_loo(log_lik)
    worst, unsure = float(k.max()), int(np.sum(k > RELIABLE))
    trust = (
        f"by importance sampling; k is above {RELIABLE} at {unsure} of {len(k)} dwells: not to be trusted"
        if unsure
        else f"by importance sampling, largest k {worst:.2f}"
    )
    value = -2.0 * elpd.sum()
    text = f"full library with the noise sampled, on averages within the dwells: {value:.1f} ({trust})"
    plugged = "subsets are scored at the estimated noise"
    notes = {"waic": (plugged,), "loo": (plugged, text)}
    return tuple(
        replace(
            c,
            pareto_k=worst if c.name == "loo" else c.pareto_k,
            note="; ".join(filter(None, (c.note, *notes.get(c.name, ())))),
        )
        for c in found
    )


_Scores = tuple[FloatArray, int | None, str]
"""Deviance (m,) of every model; how many of them are exact where not all are, which a note then says."""


def _first(allowed: BoolArray, deviance: FloatArray, count: int) -> IntArray:
    """Numbers of the admissible models of the smallest deviance, best first."""
    scored = np.where(allowed, deviance, np.inf)
    count = min(count, int(allowed.sum()))
    top = np.argpartition(scored, count - 1)[:count]
    return top[np.argsort(scored[top], kind="stable")]


def _best(
    space: Space,
    allowed: BoolArray,
    names: tuple[str, ...],
    name: str,
    scores: _Scores,
    *,
    samples: float = math.nan,
    note: str = "",
) -> Criterion:
    """Criterion from the scores of all models of a space, of which some are admissible."""
    (deviance, scored, told), every = scores, space.every
    top = _first(allowed, deviance, 2)
    least, *next_one = deviance[top].tolist()
    finite = math.isfinite(least)
    if not finite:
        note, least, weight = UNDEFINED, math.inf, np.full(len(space), math.nan)
    else:
        weight = np.exp(-0.5 * (np.where(allowed, deviance, np.inf) - least))
    sums, total = space.sums(weight)
    inside = space.members(top[:1])[0].tolist()
    compared = int(allowed.sum()) if scored is None else scored
    listing = f"among the {len(space):,} subsets that a search listed or came to from there"
    return Criterion(
        name=name,
        model=tuple(term for term, there in zip(names, inside, strict=True) if there),
        value=least,
        lead=next_one[0] - least if next_one and finite else math.nan,
        inclusion=dict(zip(names, np.minimum(sums / total, 1.0).tolist(), strict=True)),
        compared=compared if finite else 0,
        exact=every and scored is None,
        samples=samples,
        pareto_k=math.nan,
        note="; ".join(filter(None, ("" if every else listing, told, note))),
    )


def _prepared(factor: Factor, sd: FloatArray, names: tuple[str, ...]) -> Candidates:
    unknown = [name for name in names if name not in factor.names]
    if unknown:
        raise TermError(f"candidate '{unknown[0]}' is no column: they are {', '.join(factor.names)}")
    always = tuple(name for name in factor.names if name not in names)
    width = dict(zip(factor.names, sd.tolist(), strict=True))
    return candidates(factor, names, always, np.array([width[name] for name in (*always, *names)]))


def _information_of(
    c: Candidates, scale: float, factor: Factor, space: Space, samples: float
) -> dict[str, FloatArray]:
    """Information criteria (m,) of every model: candidates flat, the other columns under their priors.

    They are as the head of this module defines them, of an effective number of samples.
    """
    a, p, k = len(c.always), len(c.names), space.sizes()
    norms = np.linalg.norm(c.whole[:, :-1], axis=0)
    rows = np.concatenate((scale / c.sd[:a], HOLD * norms[a:]))
    rss, _ = fits(with_prior_rows(c.whole, rows), c, space)
    rss, n = np.maximum(rss, (EXACT * float(np.linalg.norm(c.whole[:, -1]))) ** 2), factor.n
    # parameters are flat coefficients and the noise scale
    K = (k + int(np.sum(np.isinf(c.sd[:a]))) + 1).astype(float)
    log_alike = np.array([math.log(math.comb(p, i)) for i in range(p + 1)])[k]
    deviance = n * np.log(2.0 * math.pi * rss / n) + n + factor.log_det
    spare = samples - K - 1.0
    corrected = np.where(spare > 0.0, 2.0 * K * samples / np.where(spare > 0.0, spare, 1.0), np.inf)
    bic = deviance + K * math.log(samples)
    return {
        "aic": deviance + 2.0 * K,
        "aicc": deviance + corrected,
        "bic": bic,
        "hqc": deviance + 2.0 * K * math.log(math.log(max(samples, math.e))),
        "ebic": bic + 2.0 * log_alike,
    }


def _with_parents(inside: BoolArray, names: tuple[str, ...], needs: Needs) -> BoolArray:
    """Models (m, p) with the parents of all that they hold."""
    whole = inside.copy()
    pairs = by_number(needs, names)
    for _ in pairs:
        for child, parent in pairs:
            whole[:, parent] |= whole[:, child]
    return whole


def _admissible(space: Space, names: tuple[str, ...], needs: Needs) -> BoolArray:
    """Which models (m,) have the parent of each child."""
    allowed = admissible(space, by_number(needs, names))
    if not allowed.any():
        pairs = ", ".join(f"{child} needs {parent}" for child, parent in needs)
        raise TermError(
            f"none of the {len(space)} subsets listed is admissible ({pairs}): list some that are"
        )
    return allowed


def _left_out(space: Space, allowed: BoolArray, held: Held) -> _Scores:
    """Score every model by leaving each part out; beyond the budget, those that promise most.

    These have the smallest ``rss/scale^2 + 2 k`` under the prior: leaving out and AIC are asymptotically the
    same (Stone 1977).
    """
    parts = len(held.parts)
    if len(space) * parts <= (WALKED if space.every else LISTED):
        return leave_out(held, space), None, ""
    rss, _ = fits(held.whole, held.candidates, space)
    guess = rss / held.scale**2 + 2.0 * space.sizes()
    which = _first(allowed, guess, max(int(LISTED / parts), 1))
    return _completed(allowed, guess, which, leave_out(held, Space.of(space.members(which))), "AIC")


def _completed(
    allowed: BoolArray, guess: FloatArray, which: IntArray, scores: FloatArray, other: str
) -> _Scores:
    """Scores of the models `which`; the others have what another criterion gives them, moved to fit.

    The move is the mean difference of the two over `which`, each model with its weight.
    """
    if len(which) == allowed.sum():
        deviance = np.full(len(guess), np.inf)
        deviance[which] = scores
        return deviance, None, ""
    if not np.isfinite(scores).all() or not np.isfinite(guess[which]).all():
        return np.full(len(guess), np.inf), None, ""
    gap, weight = scores - guess[which], np.exp(-0.5 * (scores - scores.min()))
    move = float(np.average(gap, weights=weight))
    spread = math.sqrt(np.average((gap - move) ** 2, weights=weight))
    deviance = guess + move
    deviance[which] = scores
    note = (
        f"computed for the {len(which):,} subsets that {other} likes best; the others are taken at its score,"
        f" which is right to {spread:.2g} there"
    )
    return deviance, len(which), note
