"""The whole measurement: every case of the grid through the public path, against its reference."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import factor as algebra
from imubayes.algebra.factor import LeastSquares
from imubayes.errors import InputError
from imubayes.inference.dwells import whitened_factor
from imubayes.inference.linear import Linear
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.models import Models
from imubayes.work import Progress, silent
from studies.extremes import exact, exact_g
from studies.extremes.cases import FAMILIES, Case, Stamps, cases
from studies.extremes.digits import digits_of, of_coefficients, of_log_evidence


@dataclass(frozen=True, slots=True)
class ExtremesStudy:
    """What is measured: of each family each k-th case, `every` being 1 for the entire grid."""

    seed: int = 1
    families: tuple[str, ...] = tuple(FAMILIES)
    every: int = 1
    command: str = "python -m studies.extremes"


SMALL = ExtremesStudy(families=("condition", "columns", "noise 0"), every=4)
"""Ten problems or so."""

QUANTITIES: tuple[str, ...] = (
    "least squares",
    "their sd",
    "averaged",
    "averaged sd",
    "log evidence",
    "inclusion",
)
"""What is held against the reference: coefficients and sds of least squares, then of the posterior."""


@dataclass(frozen=True, slots=True)
class Told:
    """One quantity of one case: digits that are correct, and that the product says can be trusted.

    The fewest of its elements count. They are NaN where the product refused to answer; correct ones also
    where there is no reference, and -inf where the answer was not finite.
    """

    correct: float
    stated: float

    @property
    def silent(self) -> bool:
        """Whether more was claimed than is right, or the answer was no number."""
        return self.correct < self.stated or self.correct == -math.inf


NOTHING = Told(math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one case.

    `condition` is that of its equilibrated columns, inf where they are dependent to rounding; `full_rank`
    says whether the reference finds them independent. `told` is by quantity; `refused` is what the product
    said where it gave no least squares, and no posterior. `rows` are those of the problem, copies counted.
    """

    family: str
    label: str
    condition: float
    full_rank: bool
    told: dict[str, Told]
    refused: tuple[str, ...]
    rows: int = 0

    @property
    def silent(self) -> tuple[str, ...]:
        """Quantities of which more was claimed than is right."""
        return tuple(name for name, one in self.told.items() if one.silent)


@dataclass(frozen=True, slots=True, eq=False)
class Extremes:
    """How many digits are right at the extremes, and how many were claimed."""

    study: ExtremesStudy
    outcomes: tuple[Outcome, ...]
    seconds: float


def measure(study: ExtremesStudy, *, progress: Progress = silent) -> Extremes:
    """Hold every case of a study against its reference; `progress` is told which one."""
    start = time.perf_counter()
    outcomes = []
    for case in cases(study.families, seed=study.seed, every=study.every):
        progress(f"{case.family}: {case.label}")
        outcomes.append(outcome(case))
    return Extremes(study, tuple(outcomes), time.perf_counter() - start)


def outcome(case: Case) -> Outcome:
    """Answer of the product to one case, against the reference."""
    given = _products(case)
    fit = exact.least_squares(given)
    summary, refused = _summary(case), []
    told: dict[str, Told] = dict.fromkeys(QUANTITIES, NOTHING)
    try:
        told |= _of_least_squares(summary.least_squares(), fit)
    except InputError as error:
        refused.append(str(error))
    try:
        models = _models(case, summary)
        told |= _of_models(models, _reference(case, given, models))
    except InputError as error:
        refused.append(str(error))
    return Outcome(
        case.family, case.label, _condition(summary), fit is not None, told, tuple(refused), given.n
    )


def _products(case: Case) -> exact.Products:
    X, y = np.asarray(case.X, dtype=float), np.asarray(case.y, dtype=float)
    if case.stamps is not None and not case.stamps.plain:
        return exact.whitened_products(X, y, case.stamps)
    return exact.products(X, y, 2**case.doublings)


def _summary(case: Case) -> Summary:
    if case.stamps is None:
        f = Summary.from_arrays(case.X, case.y, case.names).factor
    else:
        f = _whitened(case, case.stamps)
    for _ in range(case.doublings):
        f = algebra.add(f, f)
    return Summary(f)


def _whitened(case: Case, stamps: Stamps) -> algebra.Factor:
    rows = Linear(
        name=case.family,
        procedure="other",
        names=case.names,
        t=stamps.rows.t,
        duration=stamps.rows.duration,
        interval=float(stamps.rows.duration[0]),
        y=np.asarray(case.y, dtype=float),
        columns=lambda start, stop: np.asarray(case.X, dtype=float)[start:stop],
    )
    return whitened_factor(rows, stamps.noise, stamps.parts, sharp=True)


def _models(case: Case, summary: Summary) -> Models:
    scale = None if case.stamps is None else 1.0
    prior = case.prior or ScalePrior(case.sd)
    return enumerate_models(summary, prior, always=case.names[: case.always], scale=scale)


def _reference(case: Case, given: exact.Products, models: Models) -> exact.Averaged:
    """Exact posterior, at the very noise scale where the product takes one."""
    if case.prior is not None:
        return exact_g.posterior(given, case.prior)
    scale = None
    if len(models.scales.at) == 1:
        scale = math.ldexp(float(models.scales.at[0]), models.candidates.response_unit)
    return exact.posterior(given, case.sd, case.always, scale=scale)


def _of_least_squares(found: LeastSquares, fit: exact.Fit | None) -> dict[str, Told]:
    if fit is None:
        return {name: Told(0.0, float(found.digits.coefficients)) for name in QUANTITIES[:2]}
    right = (of_coefficients(found.mean, fit.mean, fit.sd), digits_of(found.sd, fit.sd, fit.sd))
    stated = (found.digits.coefficients, found.digits.sd)
    return {name: Told(a, float(b)) for name, a, b in zip(QUANTITIES[:2], right, stated, strict=True)}


def _of_models(found: Models, truth: exact.Averaged) -> dict[str, Told]:
    right = (
        of_coefficients(found.mean, truth.mean, truth.sd),
        digits_of(found.sd, truth.sd, truth.sd),
        of_log_evidence(found.log_evidence, truth.log_evidence),
        digits_of(found.inclusion, truth.inclusion, np.ones(len(truth.inclusion))),
    )
    own = found.digits
    stated = (own.coefficients, own.sd, own.log_evidence, own.inclusion)
    return {name: Told(a, float(b)) for name, a, b in zip(QUANTITIES[2:], right, stated, strict=True)}


def _condition(summary: Summary) -> float:
    """Condition number of the columns brought to unit norm."""
    norms = summary.factor.column_norms
    if not norms.all():
        return math.inf
    d = np.linalg.svd(summary.factor.R[:, :-1] / norms, compute_uv=False)
    return float(d[0] / d[-1]) if d[-1] > 0.0 else math.inf
