"""The rule that turns the evidence on one term into one verdict, and the words that go with it.

Three answers are never mixed up: needed, not needed, and "this test cannot tell". Which of them holds depends
on the prior's width only where the test leaves it to the prior, and there the verdict says so. For a term
that the test excites, the first line that holds is the verdict; `needed`, `not_needed` and `keep` are the
thresholds of the costs (see `Costs`), 0.95, 0.05 and 0.5 where the two errors cost the same::

    needed        inclusion >= needed (for a term with confounded partners at every prior width from 1/3 to 3,
                  by itself and with its partners in the model), and posterior sd <= 0.9 prior sd
    not needed    posterior sd <= 0.9 prior sd, and either inclusion <= not_needed or, where inclusion is no
                  more than a half nor than `keep`, below a tenth of the prior's sd with 95 % (with partners
                  all of this at every width); never where all terms together put it 4 sd from zero
    inseparable   it has partners: the test sees only their sum
    unresolved    posterior sd > 0.9 prior sd: the data say next to nothing of it
    undecided     inclusion is between; it leans towards the term from `keep` on, and may yet say that the
                  term is below a tenth of the prior's sd

A term whose column was zero throughout is *untested*. A model holds what is tested and reaches `keep`: no
term that is not needed is in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from imubayes.errors import StudyError
from imubayes.selection.mixture import Components, limit, quantiles
from imubayes.sensors.terms import Term

ODDS = 19.0
"""Odds that make a verdict sure where both errors cost the same: 0.95 to 0.05."""

TENTH = 0.1
"""Share of the prior's sd, the class's typical size, below which a coefficient does not matter."""

SURE = 0.95
"""Posterior probability of being that small from which the term is not needed."""

STRAINED = 6.0
"""Prior sds from zero beyond which the data contradict the prior: look for a wrong sign or unit first."""

LIKELY = 0.5
"""Inclusion above which a term is there, however small it is."""

SHOWN = 4.0
"""Sds from zero, all terms in the model, from which no width of the prior makes a term unneeded: one that is
zero comes there once in 16,000."""

UNRESOLVED = 0.9
"""Posterior sd over prior sd above which a test has not resolved a term."""

UNSEEN = ("inseparable", "unresolved", "untested")
"""Verdicts of a test that cannot tell."""


@dataclass(frozen=True, slots=True)
class Costs:
    """What a wrong choice costs, in any unit: only the ratio counts.

    Attributes
    ----------
    false_keep : of a term in the model that is zero.
    false_drop : of a term left out that is not.

    Examples
    --------
    >>> Costs().needed, Costs().keep, Costs().not_needed
    (0.95, 0.5, 0.05)
    >>> Costs(false_keep=1.0, false_drop=4.0).keep
    0.2
    """

    false_keep: float = 1.0
    false_drop: float = 1.0

    def __post_init__(self) -> None:
        for name, cost in (("false keep", self.false_keep), ("false drop", self.false_drop)):
            if not (math.isfinite(cost) and cost > 0.0):
                raise StudyError(f"the cost of a {name} must be positive and finite: got {cost}")

    @property
    def keep(self) -> float:
        """Inclusion from which keeping a term costs less than dropping it: (1 - p) fk <= p fd."""
        return self.false_keep / (self.false_keep + self.false_drop)

    @property
    def needed(self) -> float:
        """Inclusion from which keeping costs a nineteenth of dropping: the term is needed."""
        return ODDS * self.false_keep / (ODDS * self.false_keep + self.false_drop)

    @property
    def not_needed(self) -> float:
        """Inclusion up to which dropping costs a nineteenth of keeping: the term is not needed."""
        return self.false_keep / (self.false_keep + ODDS * self.false_drop)


EQUAL = Costs()
"""A false keep costs what a false drop does."""

NEAR_ZERO = 0.5
"""Sds from zero below which the size of a term says nothing for it."""

NEEDED, NOT_NEEDED = EQUAL.needed, EQUAL.not_needed
"""Inclusion from which a term is needed, and up to which it is not, at equal costs."""


class Voices(NamedTuple):
    """What each family says of one term.

    Attributes
    ----------
    evidence : its verdict.
    part, change : part of the test (a run, a mount) without which the coefficient moves farthest, in sds of
        what chance allows.
    sparse : share of resampled campaigns in which sparse regressions keep it; NaN where none was drawn.
    """

    evidence: str
    part: str
    change: float
    sparse: float


@dataclass(frozen=True, slots=True)
class TermVerdict:
    """What the data say of one term; coefficients in the term's SI unit.

    Attributes
    ----------
    name, symbol, unit, printed, group : of the term.
    mean, sd, q05, q95 : model-averaged; for a term with confounded partners, over the models that
        contain these partners, so that what only the prior tells apart widens the error bar.
    full_mean, full_sd : under the full library.
    prior_sd : sd of the physical prior.
    inclusion : posterior probability that the term is in the model.
    inclusion_range : its range over prior widths x 1/3, 1, 3.
    limit95 : |theta| stays below this with 95 %, over the models that contain the term.
    effect : largest effect over the test at `mean`, m/s^2 or rad/s.
    verdict : needed | not needed | undecided | inseparable | unresolved | untested.
    reason : in words, made from the numbers.
    confounded_with : names.
    strain : prior sds that the data alone put it from zero, where they are sure of it; else 0. Beyond
        `STRAINED` data and prior disagree.
    voices : what each family says; None where the evidence alone was asked.
    """

    name: str
    symbol: str
    unit: str
    printed: str
    group: str
    mean: float
    sd: float
    q05: float
    q95: float
    full_mean: float
    full_sd: float
    prior_sd: float
    inclusion: float
    inclusion_range: tuple[float, float]
    limit95: float
    effect: float
    verdict: str
    reason: str
    confounded_with: tuple[str, ...]
    strain: float = 0.0
    voices: Voices | None = None


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the rule looks at, and what is told beside it.

    Attributes
    ----------
    range : smallest and largest inclusion over the prior widths; for a term with partners also over the
        models that contain the partners, where parsimony does not decide in its place.
    small : smallest probability, over the prior widths, that the coefficient is below a tenth of the
        class's typical size.
    ratio : posterior sd over prior sd under the full library.
    pull, shown : |mean| / sd of the coefficient, averaged over models and under the full library.
    partners, remedy : terms that it is confounded with, and which run would separate them.
    prior_sd, full : the prior's sd; mean and sd under the full library.
    limit95, strain : as in a `TermVerdict`.
    reach : largest size of the term's column, SI.
    """

    inclusion: float
    range: tuple[float, float]
    small: float
    ratio: float
    pull: float
    partners: tuple[str, ...]
    remedy: str
    shown: float = 0.0
    prior_sd: float = math.nan
    full: tuple[float, float] = (math.nan, math.nan)
    limit95: float = math.nan
    reach: float = 0.0
    strain: float = 0.0


def decide(e: Evidence, costs: Costs = EQUAL) -> tuple[str, str]:
    """Verdict and reason for a term that the test excites.

    Examples
    --------
    >>> decide(Evidence(1.0, (1.0, 1.0), 0.0, 0.01, 250.0, (), ""))
    ('needed', 'inclusion 1.000, 250 sd from zero')
    >>> decide(Evidence(0.7, (0.4, 0.8), 0.0, 0.95, 1.2, (), ""))[0]
    'unresolved'
    """
    low, high = e.range if e.partners else (e.inclusion, e.inclusion)
    if low >= costs.needed and e.ratio <= UNRESOLVED:  # else only the model prior asks for it
        return "needed", f"inclusion {e.inclusion:.3f}, {e.pull:.0f} sd from zero"
    if e.ratio <= UNRESOLVED and e.shown < SHOWN and (small := _small(e, high, costs)):
        return small
    if e.partners:
        return "inseparable", f"only the prior tells it from {listed(e.partners)}; {e.remedy}"
    if e.ratio > UNRESOLVED:
        return "unresolved", f"posterior sd is {e.ratio:.2f} of the prior's: measure longer, or drive harder"
    return "undecided", _leaning(e, costs)


def median_model(terms: Sequence[TermVerdict], costs: Costs = EQUAL) -> tuple[str, ...]:
    """Names of the tested terms that cost less kept than dropped.

    Where both errors cost the same, they make the median probability model.
    """
    return tuple(t.name for t in terms if t.inclusion >= costs.keep and t.verdict != "untested")


def with_tied(terms: Sequence[TermVerdict], ties: Sequence[tuple[str, str]]) -> tuple[TermVerdict, ...]:
    """Verdicts in which a term that is tied, (term, leader) by name, has all of the leader's.

    They are one coefficient.
    """
    by_name, leaders = {term.name: term for term in terms}, dict(ties)

    def as_leader(term: TermVerdict) -> TermVerdict:
        leader = by_name[leaders[term.name]]
        return replace(
            leader,
            name=term.name,
            symbol=term.symbol,
            unit=term.unit,
            printed=term.printed,
            group=term.group,
            reason=f"one lever arm with {leader.name}: {leader.reason}",
        )

    return tuple(as_leader(term) if term.name in leaders else term for term in terms)


def _small(e: Evidence, high: float, costs: Costs) -> tuple[str, str] | None:
    if high <= costs.not_needed:
        return "not needed", f"inclusion {e.inclusion:.3f}"
    if e.small >= SURE and high <= min(LIKELY, costs.keep):  # the model holds none that is not needed
        return "not needed", f"below a tenth of the prior's sd with {100 * e.small:.0f} %"
    return None


def _leaning(e: Evidence, costs: Costs) -> str:
    if e.small >= SURE and e.inclusion > LIKELY:
        size = f"there, but below a tenth of the class's size with {100 * e.small:.0f} %"
        return f"{size}, {e.pull:.1f} sd from zero"
    if e.inclusion < costs.keep and e.shown >= SHOWN:
        far = f"{e.shown:.1f} sd from zero beside all other terms, and left out by the width of its prior"
        return f"{far}: name the sensor's class, or what is known of it in [sensor.prior]"
    way = "towards it" if e.inclusion >= costs.keep else "against it"
    if e.inclusion >= costs.keep and e.pull < NEAR_ZERO:
        way += ", by the prior and the other terms alone"
    return f"leans {way}, {e.pull:.1f} sd from zero: a longer run or more input would settle it"


def verdict_of(
    term: Term, symbol: str, parts: Components, column: int, e: Evidence, costs: Costs = EQUAL
) -> TermVerdict:
    """Verdict and reason by the rule, with all numbers: from a mixture in which the term has a column."""
    verdict, reason = decide(e, costs)
    mean, sd = moments_of(parts, column)
    q05, q95 = quantiles(parts, column, (0.05, 0.95))
    return TermVerdict(
        name=term.name,
        symbol=symbol,
        unit=term.unit,
        printed=term.printed,
        group=term.group,
        mean=mean,
        sd=sd,
        q05=q05,
        q95=q95,
        full_mean=e.full[0],
        full_sd=e.full[1],
        prior_sd=e.prior_sd,
        inclusion=e.inclusion,
        inclusion_range=e.range,
        limit95=e.limit95,
        effect=abs(mean) * e.reach,
        verdict=verdict,
        reason=reason,
        confounded_with=e.partners,
        strain=e.strain,
    )


def untested_verdict(term: Term, symbol: str, prior_sd: float, inclusion: float) -> TermVerdict:
    """What the prior says of a term that the test never excited."""
    alone = Components(
        weight=np.array([inclusion, 1.0 - inclusion]),
        inside=np.array([[True], [False]]),
        scale=np.ones(2),
        mean=np.zeros((2, 1)),
        sd=np.array([[prior_sd], [0.0]]),
    )
    both, full = (inclusion, inclusion), (0.0, prior_sd)
    nothing = Evidence(
        inclusion, both, 0.0, 1.0, 0.0, (), "", prior_sd=prior_sd, full=full, limit95=limit(alone, 0)
    )
    verdict = verdict_of(term, symbol, alone, 0, nothing)
    inputs = " ".join(f.channel for f in term.factors)
    return replace(verdict, verdict="untested", reason=f"its input ({inputs}) was zero in every run")


def moments_of(parts: Components, column: int) -> tuple[float, float]:
    """Mean and sd of one column of a mixture."""
    alone = replace(parts, mean=parts.mean[:, column : column + 1], sd=parts.sd[:, column : column + 1])
    mean, sd = alone.moments()
    return float(mean[0]), float(sd[0])


def by_verdict(said: Iterable[tuple[str, str]]) -> str:
    """Names by what is said of them, each with that, in words.

    Examples
    --------
    >>> by_verdict([("b0", "needed"), ("b3", "not needed"), ("m_j", "needed")])
    'needed b0 m_j, not needed b3'
    """
    names: dict[str, list[str]] = {}
    for name, word in said:
        names.setdefault(word, []).append(name)
    return ", ".join(f"{word} {' '.join(alike)}" for word, alike in names.items())


def listed(names: Iterable[str], most: int = 0) -> str:
    """Join names as a sentence does; beyond `most`, if that is given, they are counted.

    Examples
    --------
    >>> listed(["b0", "b2", "c_jj"]), listed(["b0", "b2", "c_jj"], 1)
    ('b0, b2 and c_jj', 'b0 and 2 more')
    """
    every = tuple(names)
    if 0 < most < len(every):
        every = (*every[:most], f"{len(every) - most} more")
    *head, last = every
    return f"{', '.join(head)} and {last}" if head else last
