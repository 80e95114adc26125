"""Is this unit typical of its class? A tested unit against the population that a class-level study found.

A unit's coefficient is estimated as t with sd s under the full library; the population has the mean mu and
the spread tau, each with an interval. A typical unit has ``t ~ N(mu, s^2 + var(mu) + E[tau^2])``, tau
log-normal. Noise is compared by its logarithm against that of the lot's units. One test a term: the largest
of them all is beyond what a typical unit shows in 5 % of cases at most (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev

from imubayes.errors import InputError
from imubayes.reporting.comparison.lot_files import ClassFile, LotFile, PopulationFile, log_spread
from imubayes.reporting.comparison.pulls import LETTERS, Pull, judged, normal_of, threshold_of
from imubayes.reporting.comparison.result_files import ComponentFile, ResultFile
from imubayes.reporting.result.file import Written
from imubayes.reporting.result.sensors import Term


@dataclass(frozen=True, slots=True)
class TermOfUnit:
    """A term of a unit and of its class; `pull` is None where one of them was not tested."""

    name: str
    unit: Term
    population: PopulationFile
    pull: Pull | None


@dataclass(frozen=True, slots=True)
class NoiseOfUnit:
    """N, B or K of a unit, mean of its runs, and of the lot's units: median and sd of the logarithm."""

    letter: str
    value: float
    median: float
    log_sd: float
    pull: Pull | None


@dataclass(frozen=True, slots=True)
class UnitInClass:
    """A component beside its class.

    Attributes
    ----------
    label : of its result.
    component : that was tested.
    terms, noise : compared.
    missing : terms of the component that the class-level study does not have.
    """

    label: str
    component: ComponentFile
    terms: tuple[TermOfUnit, ...]
    noise: tuple[NoiseOfUnit, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class UnitsComparison:
    """Units beside their class.

    Attributes
    ----------
    results, labels : files and their labels, in the order that they were given.
    lot, lot_label : the class-level study, and its label.
    units : components whose class it has.
    alone : (label, id, class) of components whose class it has not.
    tests, threshold : number of comparisons, and the size from which one is beyond uncertainty.
    """

    results: tuple[Written, ...]
    labels: tuple[str, ...]
    lot: LotFile
    lot_label: str
    units: tuple[UnitInClass, ...]
    alone: tuple[tuple[str, str, str], ...]
    tests: int
    threshold: float


def units_compared(results: Sequence[ResultFile | LotFile]) -> UnitsComparison:
    """Set units beside the class that one of the results is of.

    Raises
    ------
    InputError : if there is not exactly one class-level result, or it has the class of no component.
    """
    labels = tuple(LETTERS[: len(results)])
    pairs = list(zip(labels, results, strict=False))
    lots = [(label, one) for label, one in pairs if isinstance(one, LotFile)]
    if len(lots) != 1 or len(pairs) != len(results):
        raise InputError(
            f"units are compared with one class-level result, came {len(lots)} among {len(results)} results:"
            " compare the class-level results with each other first"
        )
    (lot_label, lot), known = lots[0], lots[0][1].classes
    components = [(label, c) for label, one in pairs if isinstance(one, ResultFile) for c in one.components]
    typical = [(label, c) for label, c in components if c.kind == lot.kind and c.class_id in known]
    if not typical:
        came = ", ".join(f"{c.id}: {c.kind} of class {c.class_id or 'none'}" for _, c in components)
        raise InputError(
            f"{lot.file.path}: has {lot.kind}s of the classes {', '.join(known)}, and the units are others"
            f" ({came}): expected the class in both studies"
        )
    units = [_unit(label, c, known[c.class_id], lot_label) for label, c in typical]
    tests = sum(pull is not None for one in units for pull in _pulls(one))
    threshold = threshold_of(tests)
    alone = tuple((label, c.id, c.class_id) for label, c in components if (label, c) not in typical)
    marked = tuple(_judged(one, threshold) for one in units)
    return UnitsComparison(
        tuple(one.file for one in results), labels, lot, lot_label, marked, alone, tests, threshold
    )


def _unit(label: str, component: ComponentFile, entry: ClassFile, lot_label: str) -> UnitInClass:
    both = [(name, one) for name, one in component.terms.items() if name in entry.terms]
    pair = (label, lot_label)
    return UnitInClass(
        label,
        component,
        tuple(
            TermOfUnit(name, one, entry.terms[name], _pull(one, entry.terms[name], pair))
            for name, one in both
        ),
        tuple(_noise(component, entry, pair)),
        tuple(name for name in component.terms if name not in entry.terms),
    )


def _pull(unit: Term, found: PopulationFile, pair: tuple[str, str]) -> Pull | None:
    sd = predictive_sd(unit.full_sd, found)
    if unit.verdict == "untested" or not found.tested or not sd > 0.0 or not math.isfinite(sd):
        return None
    return Pull(pair, abs(unit.full_mean - found.mean.value) / sd)


def predictive_sd(sd: float, found: PopulationFile) -> float:
    """Standard deviation of a typical unit's estimate about the population's mean.

    Parameters
    ----------
    sd : of the unit's own estimate, SI.
    found : population of the term.
    """
    log_tau, log_sd = log_spread(found.spread)
    mean_square = math.exp(2.0 * (log_tau + log_sd**2))
    return math.sqrt(sd**2 + normal_of(found.mean.low, found.mean.high) ** 2 + mean_square)


def _noise(component: ComponentFile, entry: ClassFile, pair: tuple[str, str]) -> Iterator[NoiseOfUnit]:
    for k, letter in enumerate("NBK"):
        own = [one for (_, of), one in component.noise.items() if of == letter and one.value > 0.0]
        logs = [math.log(values[k]) for values in entry.noise if values[k] > 0.0]
        if not own or len(logs) < 2:
            continue
        value, error = fmean(one.value for one in own), max(one.log_sd for one in own)
        spread = stdev(logs)
        sd = math.hypot(spread * math.sqrt(1.0 + 1.0 / len(logs)), error)
        size = abs(math.log(value) - fmean(logs)) / sd if sd > 0.0 else math.nan
        pull = Pull(pair, size) if math.isfinite(size) else None
        yield NoiseOfUnit(letter, value, math.exp(fmean(logs)), spread, pull)


def _pulls(one: UnitInClass) -> Iterator[Pull | None]:
    yield from (entry.pull for entry in (*one.terms, *one.noise))


def _judged(one: UnitInClass, threshold: float) -> UnitInClass:
    return replace(
        one,
        terms=tuple(replace(term, pull=judged(term.pull, threshold)) for term in one.terms),
        noise=tuple(replace(noise, pull=judged(noise.pull, threshold)) for noise in one.noise),
    )
