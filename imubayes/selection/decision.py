"""One verdict per term, from the evidence of every submodel and from what the test can tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.digits import Digits
from imubayes.algebra.factor import noise_scale, posterior_root, reorder
from imubayes.inference.drift import Drift
from imubayes.inference.importance import picked
from imubayes.inference.mcmc import NoiseDraw
from imubayes.inference.observability import Observability, carried, observe
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import LARGEST, enumerate_models
from imubayes.selection.mixture import Candidates, Components, draw, limit, probability_within
from imubayes.selection.model_sets import hierarchy
from imubayes.selection.models import (
    Models,
    average,
    components_given,
    digits_of,
    inclusion_given,
    inclusion_of_any,
)
from imubayes.selection.verdicts import (
    EQUAL,
    TENTH,
    Costs,
    Evidence,
    TermVerdict,
    median_model,
    moments_of,
    untested_verdict,
    verdict_of,
    with_tied,
)
from imubayes.sensors.equations import symbols
from imubayes.sensors.terms import Library, Term

WIDTHS = (1.0 / 3.0, 1.0, 3.0)
"""Factors on every prior sd that a verdict is checked at."""

SCALE_LIMIT = 10.0
"""How much stronger than its estimate the noise may be."""

LOOSE = 1e3
"""Factor on the prior's sds at which the prior only holds what the data leave open."""

SURE_PULL = 5.0
"""Standard deviations from zero at which the data alone are sure of a coefficient."""

NOMINAL = WIDTHS.index(1.0)

ROWS = 2
"""Rows for each column from which inclusions at the estimated noise are told beside those over its draws."""

MANY = 20_000
"""Draws that the bias over a record is told from: its mean is then right to 0.007 sd."""

FEW_NOISES = 4
"""Draws of the noise that are averaged over where the models of each must be searched for."""


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The decision on one component.

    Attributes
    ----------
    terms : a verdict for every term of the library, in the order of the model equation.
    columns : name of each term's column in the summary: its own, or ``<component>.<term>`` for a triad.
    model : names of the excited terms that cost less kept than dropped: with inclusion of one half or more
        (the median probability model) where both errors cost the same.
    log_evidence : of the data, averaged over all models.
    models : the enumeration at the nominal prior width, over the terms that the test excites.
    by_width : (prior width factor, inclusion of the candidates) for 1/3, 1, 3.
    observability : what the test can tell.
    free : (p,) coefficients under a prior a thousand times wider, in the order of `terms`: what the library
        can explain of the data, whatever the prior says.
    plug_in : inclusion of each of `terms` at the estimated noise, where the others are averaged over the
        noise's posterior; empty where they are not.
    groups : terms that the test sees in one combination only, and the probability that at least one of them
        is in the model.
    ties : (term, leader) of coefficients that are one: the leader's column carries both, and both have its
        verdict. It counts as one candidate.
    costs : what a wrong choice was said to cost.
    digits : that rounding leaves of the numbers; None for a method that does not weigh every model.
    """

    terms: tuple[TermVerdict, ...]
    columns: tuple[str, ...]
    model: tuple[str, ...]
    log_evidence: float
    models: Models
    by_width: tuple[tuple[float, FloatArray], ...]
    observability: Observability
    free: FloatArray
    plug_in: tuple[float, ...] = ()
    groups: tuple[tuple[tuple[str, ...], float], ...] = ()
    ties: tuple[tuple[str, str], ...] = ()
    costs: Costs = EQUAL
    digits: Digits | None = None

    @property
    def carriers(self) -> tuple[str, ...]:
        """Name of the column that carries each coefficient: its own, or that of the term it is tied to."""
        own = {term.name: column for term, column in zip(self.terms, self.columns, strict=True)}
        return tuple(own[dict(self.ties).get(name, name)] for name in own)

    def table(self) -> str:
        """Verdicts as plain text, in SI units."""
        rows = [f"{'term':8} {'symbol':8} {'mean':>12} {'sd':>9} {'inclusion':>9}  verdict"]
        rows += [
            f"{t.name:8} {t.symbol:8} {t.mean:12.5g} {t.sd:9.2g} {t.inclusion:9.3f}  {t.verdict}"
            for t in self.terms
        ]
        return "\n".join(rows)


def select(
    summary: Summary,
    prior: ScalePrior,
    lib: Library | None = None,
    *,
    component: str = "",
    noises: Sequence[NoiseDraw] = (),
    log_evidence: float = 0.0,
    costs: Costs = EQUAL,
    hierarchical: bool = False,
) -> Selection:
    """Decide which terms of a component the data need.

    Parameters
    ----------
    summary : the runs' factor.
    prior : physical prior of every term of the summary, in its order.
    lib : the component's library; by default the one that `summary` was made with.
    component : name of a triad's component. Its terms are ``<component>.<term>`` in the summary, and the
        other components' terms stay in every model, under their priors.
    noises : draws of the noise's posterior under the full library, to average over; none takes the noise
        that whitened the summary, and averages over its common scale alone; one is the noise that is given.
    log_evidence : of the full library, with the noise of these draws integrated out.
    costs : of a term kept that is zero, and of one dropped that is not; the thresholds follow.
    hierarchical : weigh only models that hold what each of their terms calls for (`model_sets.hierarchy`).

    Raises
    ------
    TermError : if there is no library.
    """
    lib = lib or summary.candidates
    prefix = f"{component}." if component else ""
    own = {f"{prefix}{term.name}": term for term in lib.terms}
    seen = seen_by(summary, prior)
    weigh = _weighing(summary, prior, seen.excited, own, hierarchical)
    if sum(name in own for name in seen.excited) > LARGEST:
        some = np.linspace(0, len(noises) - 1, min(FEW_NOISES, len(noises))).astype(int)
        noises = [noises[k] for k in some]
    tested = tuple(name for name in seen.excited if name in own)
    beside = {name: tuple(n for n in seen.partners(name) if n in tested) for name in tested}
    hiding = tuple(dict.fromkeys(filter(None, beside.values())))
    widths = []
    for k, width in enumerate(WIDTHS):
        usual = k == NOMINAL
        required = (*hiding, tested) if usual else hiding
        widths.append(weigh(width, noises, log_evidence, required, coefficients=usual))
    models = widths[NOMINAL]
    mean, strain = _without_prior(summary, prior)
    sd = dict(zip(summary.names, prior.sd.tolist(), strict=True))
    asked = _Asked(own, symbols(lib), seen, beside, sd, strain, summary.reach, costs)
    verdicts = with_tied(_verdicts(asked, widths), lib.tied)
    # of hardly more rows than columns the common scale of the noise is not to be had
    told = len(noises) > 1 and summary.factor.n > ROWS * len(summary.names)
    carriers = [f"{prefix}{name}" for name in lib.carriers]
    seen = carried(seen, dict(zip(own, carriers, strict=True)))
    return Selection(
        terms=verdicts,
        columns=tuple(own),
        model=median_model(verdicts, costs),
        log_evidence=models.log_evidence,
        models=models,
        by_width=tuple((w, inclusion_given(m, ())) for w, m in zip(WIDTHS, widths, strict=True)),
        observability=seen,
        free=np.array([mean[name] for name in carriers]),
        plug_in=_inclusions(weigh(1.0), carriers) if told else (),
        groups=_groups(models, seen, own),
        ties=lib.tied,
        costs=costs,
        digits=digits_of(models, summary),
    )


def seen_by(summary: Summary, prior: ScalePrior) -> Observability:
    """What a test can tell of each column, in the noise that its rows show."""
    scale = noise_scale(summary.factor, prior.sd)
    return observe(summary.factor, prior.sd, summary.facts, scale=scale, reach=summary.reach or None)


def _groups(
    models: Models, seen: Observability, own: Mapping[str, Term]
) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Own terms of each combination, and the probability that at least one of them is there."""
    groups = (tuple(name for name in group.terms if name in models.candidates.names) for group in seen.groups)
    return tuple(
        (tuple(own[name].name for name in names), inclusion_of_any(models, names))
        for names in dict.fromkeys(groups)
        if len(names) > 1
    )


def loose_fit(
    summary: Summary, prior: ScalePrior, *, whitened: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Mean (p,) and covariance (p, p) of all columns, with a prior that only holds what the data leave open.

    What is no term (an error of the bench) keeps its prior: it is known from elsewhere. The covariance is
    that by what the rows scatter by, or, `whitened`, by the noise that they were whitened with.
    """
    extras = {extra.name for extra in summary.extras}
    loose = np.array([1.0 if name in extras else LOOSE for name in summary.names])
    scale = noise_scale(summary.factor, prior.sd)
    mean, root = posterior_root(summary.factor, loose * prior.sd, scale)
    root /= scale if whitened else 1.0
    leader = dict(summary.library.tied) if summary.library else {}
    where = [summary.names.index(leader.get(name, name)) for name in summary.names]
    return mean[where], (root @ root.T)[np.ix_(where, where)]


def _without_prior(summary: Summary, prior: ScalePrior) -> tuple[dict[str, float], dict[str, float]]:
    """What the data alone say of each term, and its size in prior sds where they are sure of it."""
    mean, cov = loose_fit(summary, prior)
    sd = np.sqrt(np.diagonal(cov))
    strain = np.where(np.abs(mean) > SURE_PULL * sd, np.abs(mean) / prior.sd, 0.0)
    return (
        dict(zip(summary.names, mean.tolist(), strict=True)),
        dict(zip(summary.names, strain.tolist(), strict=True)),
    )


def _weighing(
    summary: Summary, prior: ScalePrior, excited: tuple[str, ...], own: Collection[str], hierarchical: bool
) -> Callable[..., Models]:
    """How every submodel of the excited columns is weighed: at a factor on the width of the terms' priors.

    How well the bench is known is not in question with that. The noise is as estimated, its scale not known
    where there are more rows than columns to tell it, or draws are given of its posterior under the full
    library: dividing by that library's evidence at each draw makes them count as draws of the prior.
    `required` is as `average` has it.
    """
    extras = {extra.name for extra in summary.extras}
    sd = np.array([prior.sd[summary.names.index(name)] for name in excited])
    known = np.array([name in extras for name in excited])

    def weighed(
        width: float,
        noises: Sequence[NoiseDraw] = (),
        log_evidence: float = 0.0,
        required: Sequence[tuple[str, ...]] = (),
        *,
        coefficients: bool = False,
    ) -> Models:
        found = (
            enumerate_models(
                Summary(reorder(factor, excited)),
                ScalePrior(np.where(known, 1.0, width) * sd),
                always=[name for name in excited if name not in own],
                scale_limit=SCALE_LIMIT,
                scale=1.0 if noises or factor.n <= len(excited) else None,
                needs=hierarchy(excited) if hierarchical else (),
                coefficients=coefficients,
            )
            for factor in ([noise.factor for noise in noises] or [summary.factor])
        )
        if not noises:
            return next(found)
        return average(found, log_evidence - np.array([noise.log_marginal for noise in noises]), required)

    return weighed


def _inclusions(models: Models, own: Collection[str]) -> tuple[float, ...]:
    """Inclusion of every own term, tested or not."""
    inclusion = dict(zip(models.candidates.names, inclusion_given(models, ()).tolist(), strict=True))
    untested = _prior_inclusion(models)
    return tuple(inclusion.get(name, untested) for name in own)


class _Asked(NamedTuple):
    """A component: its terms by the names of their columns, what the test can tell, and what errors cost.

    The tested columns that hide each one stand `beside` it. Prior sd, strain and largest size of a column,
    SI, are by its name.
    """

    own: Mapping[str, Term]
    symbols: Mapping[str, str]
    seen: Observability
    beside: Mapping[str, tuple[str, ...]]
    sd: Mapping[str, float]
    strain: Mapping[str, float]
    reach: Mapping[str, float]
    costs: Costs


Given = Callable[[tuple[str, ...]], tuple[list[FloatArray], list[Components]]]
"""Inclusions and mixtures, by prior width, over the models that contain some terms."""


def _verdicts(asked: _Asked, widths: Sequence[Models]) -> list[TermVerdict]:
    """Verdict on every own term."""
    models, c = widths[NOMINAL], widths[NOMINAL].candidates
    full, prior_inclusion = components_given(models, c.names), _prior_inclusion(models)

    @cache
    def given(partners: tuple[str, ...]) -> tuple[list[FloatArray], list[Components]]:
        parts = [components_given(m, partners) if partners else m.components for m in widths]
        return [inclusion_given(m, partners) for m in widths], parts

    return [
        _tested(asked, name, c, given, full)
        if name in c.names
        else untested_verdict(term, asked.symbols[term.name], asked.sd[name], prior_inclusion)
        for name, term in asked.own.items()
    ]


def _tested(asked: _Asked, name: str, c: Candidates, given: Given, full: Components) -> TermVerdict:
    """Verdict on a term that the test excites."""
    term, seen = asked.own[name], asked.seen
    j, column, prior_sd = c.names.index(name), c.columns.index(name), float(c.sd[c.columns.index(name)])
    partners = asked.beside[name]
    alone = [float(inclusion[j]) for inclusion in given(())[0]]
    inclusions, mixtures = given(partners)
    together = [*alone, *(float(inclusion[j]) for inclusion in inclusions)]
    parts = mixtures[NOMINAL]
    (mean, sd), (whole, error) = moments_of(parts, column), moments_of(full, column)
    prefix = f"{name.rpartition('.')[0]}."  # as its own component writes it, ax.b2 beside ax.b0 is b2
    evidence = Evidence(
        inclusion=alone[NOMINAL],
        range=(min(together), max(together)),
        small=min(
            probability_within(m, column, TENTH * prior_sd) for m in (mixtures if partners else [parts])
        ),
        ratio=float(seen.ratio[seen.names.index(name)]),
        pull=abs(mean) / sd if sd > 0.0 else 0.0,
        partners=tuple(n.removeprefix(prefix) for n in seen.partners(name)),
        remedy=next((group.remedy for group in seen.groups if name in group.terms), ""),
        shown=abs(whole) / error if error > 0.0 else 0.0,
        prior_sd=prior_sd,
        full=(whole, error),
        limit95=next(most for most in (limit(m, column) for m in (parts, full)) if math.isfinite(most)),
        reach=asked.reach.get(name, 0.0),
        strain=asked.strain[name],
    )
    verdict = verdict_of(term, asked.symbols[term.name], parts, column, evidence, asked.costs)
    return replace(verdict, inclusion_range=(min(alone), max(alone)))


def _prior_inclusion(models: Models) -> float:
    """Inclusion of a term without data, given how many others are in: E[(k + 1)/(p + 2)], beta-binomial."""
    weight = np.exp(models.by_size - models.by_size.max())
    k = np.arange(len(weight))
    return float(np.sum(weight * (k + 1.0)) / np.sum(weight) / (len(weight) + 1.0))


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias of a component whose noise walks, averaged over models: each (mean, sd), SI.

    Attributes
    ----------
    start, mean, end : at the start of the record, on average over it, and at its end.
    drift : from the start to the end.
    walk : sd of what the random walk strays in that time, SI.
    """

    start: tuple[float, float]
    mean: tuple[float, float]
    end: tuple[float, float]
    drift: tuple[float, float]
    walk: float


def over_record(selection: Selection, drift: Drift, rng: np.random.Generator) -> tuple[Selection, Bias]:
    """Selection whose b0 is the bias on average over the record, and the bias at the record's ends.

    Inclusion and verdict stay: they ask whether there is a bias to walk from. Where b0 has confounded
    partners all three are as wide as it is over the models that contain these.
    """
    models = selection.models
    drawn = drift.bias(models.candidates.columns, _model_draws(models, MANY, rng), rng)
    place = selection.columns.index(drift.b0)
    before, start = selection.terms[place], drawn[:, 0]
    if before.confounded_with:
        wider = math.sqrt(max(before.sd**2 - float(start.var()), 0.0))
        drawn = drawn + before.mean - start.mean() + wider * rng.standard_normal((len(drawn), 1))
    sizes = [(float(x.mean()), float(x.std())) for x in (*drawn.T, drawn[:, 2] - drawn[:, 0])]
    bias = Bias(*sizes, walk=drift.walk)
    (mean, sd), (q05, q95) = bias.mean, np.quantile(drawn[:, 1], [0.05, 0.95]).tolist()
    after = replace(
        before,
        mean=mean,
        sd=sd,
        q05=q05,
        q95=q95,
        full_mean=float(drift.full[1, 0]),
        full_sd=float(drift.full[1, 1]),
        limit95=float(np.quantile(np.abs(drawn[:, 1]), 0.95)),
        effect=abs(mean),
    )
    terms = (*selection.terms[:place], after, *selection.terms[place + 1 :])
    return replace(selection, terms=terms), bias


def posterior_draws(
    selection: Selection, size: int, rng: np.random.Generator, drift: Drift | None = None
) -> FloatArray:
    """Independent draws (size, p) in the order of the verdicts; a term that a draw's model lacks is zero.

    Terms that the test never excited are drawn from their prior, with the inclusion that the others suggest.
    With a drift, b0 is the bias on average over the record.
    """
    names, drawn = selection.models.candidates.columns, _model_draws(selection.models, size, rng)
    columns = {name: drawn[:, j] for j, name in enumerate(names)}
    if drift is not None:
        columns[drift.b0] = drift.bias(names, drawn, rng)[:, 1]
    out = np.empty((size, len(selection.terms)))
    for j, (term, name) in enumerate(zip(selection.terms, selection.carriers, strict=True)):
        if name in columns:
            out[:, j] = columns[name]
        else:
            inside = rng.random(size) < term.inclusion
            out[:, j] = np.where(inside, term.prior_sd * rng.standard_normal(size), 0.0)
    return out[:, _carried(selection)]


def _carried(selection: Selection) -> list[int]:
    """Place (p,) of the coefficient that each is."""
    return [selection.columns.index(name) for name in selection.carriers]


def _model_draws(models: Models, size: int, rng: np.random.Generator) -> FloatArray:
    """Draws of the candidates' columns; each is at one of the draws of the noise, by what that counts.

    What it is made of is its own, whatever the others are.
    """
    noise, chance = rng.random(size), rng.random(size)
    out = rng.standard_normal((size, len(models.candidates.columns)))
    parts = models.parts or ((1.0, models),)
    which = picked(np.array([share for share, _ in parts]), noise)
    for k, (_, part) in enumerate(parts):
        rows = np.flatnonzero(which == k)
        out[rows] = draw(part.candidates, part.components, chance[rows], out[rows])
    return out


def prior_draws(selection: Selection, size: int, rng: np.random.Generator) -> FloatArray:
    """Draws (size, p) of the prior: the share of terms in the model is uniform, coefficients are normal."""
    share = rng.random(size)
    inside = rng.random((size, len(selection.terms))) < share[:, None]
    sd = np.array([term.prior_sd for term in selection.terms])
    return np.where(inside, rng.standard_normal(inside.shape) * sd, 0.0)[:, _carried(selection)]
