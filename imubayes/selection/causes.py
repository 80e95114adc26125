"""Why a method and the decision differ on a term, worked out from the numbers of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra.factor import invert_triangular, vanished
from imubayes.selection.criteria import Criterion
from imubayes.selection.decision import Selection
from imubayes.selection.sensitivity import Sensitivity, usual
from imubayes.selection.verdicts import UNRESOLVED, TermVerdict, listed

ALIKE = 0.7
"""Correlation of two estimates from which one term can take the other's place: half of each variance."""

LENIENCE = 1.25
"""How far beyond a line the pull may lie, which is that under the full library: methods drop other terms."""

EVEN = 0.5
"""Inclusion from which a term is kept where both errors cost the same."""

NEAR = 3.0
"""Standard deviations from zero up to which an effect is weak: lines are drawn from 1.4 to 3 and beyond."""

FEW = 5
"""Names that a sentence can bear."""

PREDICTIVE = ("waic", "loo", "leave_one_run_out")
"""Methods that leave out whole dwells or runs, so that coloured noise shows between these."""


@dataclass(frozen=True, slots=True)
class DisputedTerm:
    """What is known of one term that methods differ on, beside its verdict.

    The decision keeps it or not, None where it says that the test cannot tell. The data alone put it `pull`
    sds from zero under the full library, where its posterior sd over its prior sd is `ratio`; the evidence
    keeps it from a pull of about `line` on, and would from `even`, were it as likely beforehand to be there
    as not: infinite where the data say nothing. `range` is that of its inclusion over prior widths from 1/3
    to 3, `keep` the inclusion from which a term is kept, `others` how many other terms are in the decision's
    model and how many there are. `alike` are the terms whose estimates are strongly correlated with its own,
    and how strongly; `inflation` is that of its variance by the other terms; `coloured` are runs whose noise
    was assumed white and is not.
    """

    term: TermVerdict
    kept: bool | None
    pull: float
    ratio: float
    line: float
    even: float
    range: tuple[float, float]
    keep: float
    others: tuple[int, int]
    alike: tuple[tuple[str, float], ...]
    inflation: float
    coloured: tuple[str, ...]

    @property
    def swings(self) -> bool:
        """Whether the width of the prior decides on it."""
        return self.range[0] < self.keep <= self.range[1]


@dataclass(frozen=True, slots=True)
class Ballot:
    """What one method says by column: nothing of a column that is not there.

    `strength` is how strongly it is for a term, from 0 to 1, and `keeps` whether it keeps it. Where that
    follows from a penalty, with an effective size of `samples`, it keeps a term from the pull `line` on; else
    both are NaN. `swapped` are terms alike on which a method that differs on a term differs the other way
    round.
    """

    method: str
    strength: Mapping[str, float]
    keeps: Mapping[str, bool]
    line: float = math.nan
    samples: float = math.nan
    swapped: tuple[str, ...] = ()


def case_of(
    selection: Selection, sensitivity: Sensitivity, number: int, coloured: tuple[str, ...] = ()
) -> DisputedTerm:
    """What is known of the term `number` of a selection, which must be one that the test excites."""
    term, column = selection.terms[number], selection.columns[number]
    ratio = min(term.full_sd / term.prior_sd, 1.0)
    kept = {*selection.model} - {term.name, *dict(selection.ties)}
    others = len(kept), len(selection.models.candidates.names) - 1
    keep = selection.costs.keep
    informed = math.sqrt(max(1.0 - ratio**2, 0.0))
    inclusion = sensitivity.inclusion[usual(sensitivity.widths), sensitivity.names.index(column)]
    seen = selection.observability
    return DisputedTerm(
        term=term,
        kept=decided(term, selection),
        pull=abs(term.full_mean) / term.full_sd / informed if informed > 0.0 else 0.0,
        ratio=ratio,
        line=_line_of_evidence(ratio, keep, (others[1] + 1.0 - others[0]) / (others[0] + 1.0)),
        even=_line_of_evidence(ratio, keep, 1.0),
        range=(float(inclusion.min()), float(inclusion.max())),
        keep=keep,
        others=others,
        alike=_alike(selection, column),
        inflation=float(seen.vif[seen.names.index(column)]),
        coloured=coloured,
    )


def decided(term: TermVerdict, selection: Selection) -> bool | None:
    """Whether the decision keeps a term; None where it says that the test cannot tell."""
    if term.verdict in ("inseparable", "unresolved"):
        return None
    return term.name in selection.model


def line_of(criterion: Criterion, kept: int, p: int) -> float:
    """Pull from which a criterion keeps one more term: the square root of its penalty; NaN if it has none.

    Beside `kept` terms of p candidates, the noise scale counts as a parameter.

    Examples
    --------
    >>> nothing = Criterion("aic", (), 0.0, 0.0, {}, 1, True, math.nan, math.nan)
    >>> round(line_of(nothing, 3, 10), 3)
    1.414
    """
    n = criterion.samples
    penalty = {
        "aic": lambda: 2.0,
        "aicc": lambda: 2.0 * n * ((kept + 2) / (n - kept - 3.0) - (kept + 1) / (n - kept - 2.0)),
        "bic": lambda: math.log(n),
        "hqc": lambda: 2.0 * math.log(math.log(n)),
        "ebic": lambda: math.log(n) + 2.0 * math.log(max(p - kept, 1) / (kept + 1)),
    }.get(criterion.name)
    if penalty is None or not (criterion.name == "aic" or n > kept + 3.0):
        return math.nan
    return math.sqrt(max(penalty(), 0.0))


def cause_of(case: DisputedTerm, other: Ballot) -> str:
    """Cause of a difference, the most telling first.

    Terms that the test cannot tell apart, or that stand in for each other; noise that is coloured and was
    taken as white, where dwells left out do not bear out an effect that seems strong; costs that are not
    equal; a prior whose width decides; a model prior that does, since many or few of the other terms are
    there; penalties that draw their lines on either side of the term; an effect so weak that all lines are
    near. What is none of these is the method's own.
    """
    if case.term.confounded_with or other.swapped:
        return "collinearity"
    if case.coloured and case.kept and other.method in PREDICTIVE and case.pull > NEAR:
        return "coloured noise"
    if case.kept is not None:
        if (case.term.inclusion >= EVEN) != (case.term.inclusion >= case.keep):
            return "costs"
        if case.swings or other.method == "g-prior":
            return "prior width"
        if (case.pull >= case.line) is case.kept is not (case.pull >= case.even):
            return "model prior"
        low, high = (case.line, other.line) if case.kept else (other.line, case.line)
        if low < high and low / LENIENCE <= case.pull <= high * LENIENCE:
            return "sample size"
    weak = case.ratio > UNRESOLVED or case.pull <= max(NEAR, LENIENCE * case.line)
    return "weak effect" if weak or case.term.verdict == "not needed" else "method"


def explained(case: DisputedTerm, cause: str, others: Sequence[Ballot], *, everyone: bool) -> str:
    """One sentence on the methods that differ on a term for one cause: `everyone`, or only these."""
    verb = "drop" if case.kept else "keep"
    methods = "every other method" if everyone else listed([other.method for other in others])
    start = f"{methods} {verb}{'s' if everyone or len(others) == 1 else ''} {case.term.name}"
    return f"{start}: {_TEXTS[cause](case, others)}"


def _of_collinearity(case: DisputedTerm, others: Sequence[Ballot]) -> str:
    if partners := case.term.confounded_with:
        few = listed(partners, FEW - 1 if len(partners) > FEW else 0)
        return f"the test sees it only together with {few}, and each method takes one of them"
    swapped = tuple(dict.fromkeys(name for other in others for name in other.swapped))
    shares = [abs(r) for name, r in case.alike if name in swapped]
    verb = "left out" if not case.kept else "taken"
    return (
        f"{listed(swapped)} is {verb} in its place; their estimates are correlated at {max(shares):.2f}"
        f" (variance inflation {case.inflation:.0f})"
    )


def _of_penalty(case: DisputedTerm, others: Sequence[Ballot]) -> str:
    lines = listed([f"{other.method} {other.line:.1f}" for other in others])
    counts = [other.samples for other in others if not math.isnan(other.samples)]
    samples = f" ({counts[0]:,.0f} effective samples)" if counts else ""
    return (
        f"it is {case.pull:.1f} sd from zero, and the lines are drawn at {lines}{samples},"
        f" {_line_and_why(case)}"
    )


def _line_and_why(case: DisputedTerm) -> str:
    kept, there = case.others
    return (
        f"that of the evidence at about {case.line:.1f} (its prior is {1.0 / case.ratio:.3g} times as wide as"
        f" the posterior, and {kept} of {there} other terms are in the model)"
    )


_TEXTS: Mapping[str, Callable[[DisputedTerm, Sequence[Ballot]], str]] = {
    "collinearity": _of_collinearity,
    "coloured noise": lambda case, others: (
        f"the noise of {listed(case.coloured)} was taken as white and is not, so that dwells differ by more"
        f" than the evidence allows for, which puts it {case.pull:.1f} sd from zero"
    ),
    "costs": lambda case, others: (
        f"its inclusion of {case.term.inclusion:.2f} is"
        f" {'below' if case.term.inclusion < case.keep else 'above'} the {case.keep:.2f} from which the"
        " study's costs keep a term; the others know of no costs"
    ),
    "prior width": lambda case, others: (
        f"its inclusion goes from {case.range[0]:.2f} to {case.range[1]:.2f} between a third and three times"
        " the prior's width"
        if case.swings
        else "its own prior goes by the noise, not by the class, whose sd is"
        f" {1.0 / case.ratio:.3g} times the posterior's (inclusion {case.term.inclusion:.2f})"
    ),
    "model prior": lambda case, others: (
        f"it is {case.pull:.1f} sd from zero, where the evidence draws the line at about {case.line:.1f} and"
        f" would at {case.even:.1f}, did it not expect it to be {'there' if case.kept else 'out'}, since"
        f" {case.others[0]} of {case.others[1]} other terms are in the model"
    ),
    "sample size": _of_penalty,
    "weak effect": lambda case, others: (
        f"the data leave {100.0 * case.ratio:.0f} % of the prior's sd, and put it {case.pull:.1f} sd from"
        " zero"
        if case.ratio > UNRESOLVED
        else f"it is {case.pull:.1f} sd from zero, a weak effect; the line of aic is at 1.4,"
        f" {_line_and_why(case)}"
    ),
    "method": lambda case, others: (
        f"it is {case.pull:.1f} sd from zero, the line of the evidence is at about {case.line:.1f}, and none"
        " of the causes that are looked for explains it"
    ),
}
"""What is said of a difference by its cause."""


def _line_of_evidence(ratio: float, keep: float, against: float) -> float:
    """Pull t at which the posterior odds of a term equal those from which it is kept.

    For a term by itself the Bayes factor is ``ratio exp(t^2 (1 - ratio^2) / 2)``.

    The ratio is posterior over prior sd, `keep` the inclusion from which it is kept, `against` the prior odds
    against it: (m + 1 - k)/(k + 1) beside k of m others under the beta-binomial prior.
    """
    if not 0.0 < ratio < 1.0:
        return math.inf
    logs = math.log(keep / (1.0 - keep)) + math.log(against) - math.log(ratio)
    return math.sqrt(max(2.0 * logs / (1.0 - ratio**2), 0.0))


def _alike(selection: Selection, column: str) -> tuple[tuple[str, float], ...]:
    """Candidates whose estimates under the full library are strongly correlated with that of a column.

    None under flat priors where rows are fewer than columns, so that the full library has no one estimate.
    """
    c = selection.models.candidates
    T = c.at(selection.models.scale)
    if vanished(T).any():
        return ()
    inverse = invert_triangular(T[:-1, :-1])
    directions = inverse / np.linalg.norm(inverse, axis=1)[:, None]
    r = directions @ directions[c.columns.index(column)]
    return tuple(
        (name, float(r[c.columns.index(name)]))
        for name in c.names
        if name != column and abs(r[c.columns.index(name)]) >= ALIKE
    )
