"""One printed row a term, a run, a noise: what the terminal and the report both show."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult
from imubayes.inference import SIDE
from imubayes.inference.linear import Extra
from imubayes.inference.mcmc import Chains
from imubayes.inference.observability import Confounded
from imubayes.inference.summary import RunSummary
from imubayes.reporting import rounding
from imubayes.rig.bench import LACK
from imubayes.selection.decision import Selection
from imubayes.selection.verdicts import UNSEEN, TermVerdict, listed
from imubayes.sensors.noise import allan_variance
from imubayes.sensors.terms import CHANNEL_UNITS, Kind
from imubayes.units import factor, offset

MARKS = {
    "needed": ("●", "bold green", "o", "full"),
    "not needed": ("○", "dim", "o", "none"),
    "undecided": ("◐", "yellow", "o", "left"),
    "inseparable": ("▲", "bold magenta", "^", "full"),
    "unresolved": ("△", "magenta", "^", "none"),
    "untested": ("×", "dim magenta", "x", "full"),
}
"""Shape of each verdict, its colour in a terminal, and the shape's marker and fill in a figure."""

MOST_NAMES = 6
"""Names that a sentence holds."""

MOST_ALIKE = 2
"""Errors of the test bench of one kind that a sentence says one by one."""

VAGUE = 0.7
"""sd of a logarithm (a factor of two) above which a noise parameter is printed as a limit."""


def term_size(term: TermVerdict) -> rounding.Rounded | None:
    """Value and sd of a term in its printed unit; its limit if it is not needed; None if it is not seen."""
    if term.verdict in UNSEEN:
        return None
    if term.verdict == "not needed":
        return rounding.below(term.limit95, *rounding.unit_of(term))
    return rounding.sized(term, term.mean, term.sd)


Named = TypeVar("Named")


def renamed(value: Named, names: Mapping[str, str]) -> Named:
    """Write other names wherever a value has some of these."""

    def told(part: Any) -> Any:
        if isinstance(part, str):
            return names.get(part, part)
        if isinstance(part, Mapping):
            return {told(key): told(value) for key, value in part.items()}
        if isinstance(part, tuple):
            return getattr(part, "_make", tuple)(map(told, part))
        if is_dataclass(part) and not isinstance(part, type):
            return replace(part, **{f.name: told(getattr(part, f.name)) for f in fields(part)})
        return part

    return told(value)


def in_own_names(value: Named, selection: Selection) -> Named:
    """Call columns by the names of the component's own terms wherever a value has them: a triad has more."""
    return renamed(value, dict(zip(selection.columns, (t.name for t in selection.terms), strict=True)))


def own_groups(selection: Selection) -> tuple[Confounded, ...]:
    """Groups that hold a term of this component; what several directions hold is said once."""
    groups, columns = selection.observability.groups, {*selection.columns}
    own = [group for group in groups if not columns.isdisjoint(group.terms)]
    by_terms: dict[tuple[str, ...], Confounded] = {}
    for group in in_own_names(tuple(own), selection):
        by_terms.setdefault(group.terms, group)
    return tuple(by_terms.values())


def labels(sensor: SensorResult) -> dict[str, str]:
    """Short names of a component's columns: of what is no term, what it is an instance of: ``fixture``."""
    terms = {term.name: label(term) for term in sensor.selection.terms}
    return terms | {error.extra.name: error.extra.kind.replace("_", " ") for error in sensor.extras}


def label(term: TermVerdict) -> str:
    """Name people say: the IEEE symbol, or the slides' name where no standard has one."""
    return term.name if term.symbol == "-" else term.symbol


def confounded_sentences(
    groups: Sequence[Confounded], terms: Iterable[TermVerdict], extras: Iterable[Extra] = ()
) -> tuple[str, ...]:
    """Say which terms each group holds, why, and what would tell them apart: a sentence a cause.

    Groups are by the terms' names; terms have symbols, and columns that are no terms words, where given.
    """
    symbols = {term.name: label(term) for term in terms}
    bench = {extra.name: extra for extra in extras}
    causes: dict[str, list[str]] = {}
    for group in groups:
        how = "appear only in one combination" if group.exact else "cannot be told apart above the noise"
        why = f": {group.reason}" if group.reason else ""
        remedy = f" What would tell: {sentence(group.remedy)}" if group.remedy else ""
        causes.setdefault(f"{how}{why}.{remedy}", []).append(_members(group.terms, symbols, bench))
    return tuple(
        f"{'; '.join(members)}{' each ' if len(members) > 1 else ' '}{cause}"
        for cause, members in causes.items()
    )


def _members(names: Sequence[str], symbols: Mapping[str, str], bench: Mapping[str, Extra]) -> str:
    """Name what a group holds: terms with their symbols, errors of the test bench in words.

    Many terms go without symbols; many errors of one kind are counted.
    """
    told = {name: symbols.get(name, name) if len(names) <= MOST_NAMES else name for name in names}
    said = [name if told[name] == name else f"{name} ({told[name]})" for name in names if name not in bench]
    lacking, kinds = dict[str, None](), dict[str, list[str]]()
    for extra in (bench[name] for name in names if name in bench):
        if extra.kind.startswith(LACK):
            lacking[extra.kind.partition(".")[2].partition("^")[0]] = None
        else:
            kinds.setdefault(extra.kind, []).append(f"the {extra.text.removeprefix('the ')}")
    said += [f"what the library lacks of {channel}" for channel in lacking]
    for kind, texts in kinds.items():
        many = f"{len(texts)} errors of the test bench ({kind.replace('_', ' ')})"
        said += [many] if len(texts) > MOST_ALIKE else texts
    return listed(said)


def shortened(names: tuple[str, ...], most: int = 3) -> str:
    """Join names with commas; beyond `most` they are counted.

    >>> shortened(("K0", "K2", "Kpp", "Koo"), 2)
    'K0, K2 +2'
    """
    rest = f" +{len(names) - most}" if len(names) > most else ""
    return ", ".join(names[:most]) + rest


def sentence(text: str) -> str:
    """Close a text as a sentence does."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


def noise_cells(
    run: RunSummary, kind: Kind, chains: Chains | None = None
) -> tuple[tuple[rounding.Rounded, bool], ...]:
    """N, B and K of a run in data-sheet units, by its chains where it was sampled; and which are limits.

    A limit stands for a process that the data do not show: a factor of two is within one sd.
    """
    units, draws = [rounding.noise_unit(name, kind) for name in "NBK"], noise_draws(run, chains)
    if draws is None:
        values = zip((run.noise.N, run.noise.B, run.noise.K), run.found.sd, units, strict=True)
        return tuple(noise_cell(value / size, sd, unit) for value, sd, (unit, size) in values)
    cells = []
    for part, unit in zip(draws.T, units, strict=True):
        positive, limit = part[part > 0.0], rounding.below(float(np.quantile(part, 0.95)), *unit)
        vague = len(positive) > 0 and float(np.std(np.log(positive))) > VAGUE
        known = rounding.measured(float(part.mean()), float(part.std()), *unit)
        cells.append((limit if vague else known, vague))
    return tuple(cells)


def noise_draws(run: RunSummary, chains: Chains | None) -> FloatArray | None:
    """Draws (m, 3) of a run's N, B, K in SI; None where they were not sampled."""
    if chains is None or run.noise_run not in chains.runs:
        return None
    draws = chains.noise[:, :, chains.runs.index(run.noise_run)].reshape(-1, 3)
    return draws if np.any(draws != draws[0]) else None


def noise_cell(value: float, sd: float, unit: str) -> tuple[rounding.Rounded, bool]:
    """Print a log-normal estimate: with its sd, or as a limit where a factor of two is within one sd."""
    if sd > VAGUE:
        return rounding.below(value * math.exp(SIDE * sd), unit), True
    return rounding.measured(value, value * sd, unit), False


def noise_floor(sensor: SensorResult) -> rounding.Rounded:
    """Lowest Allan deviation that the noise of any run allows within its duration, in ug or deg/h."""
    lowest = []
    for run in sensor.runs:
        tau = np.geomspace(max(run.interval, 1e-9), max(run.duration, 2.0 * run.interval, 2e-9), 50)
        lowest.append(float(np.sqrt(allan_variance(asdict(run.noise), tau).min())))
    return rounding.on_output(min(lowest), sensor.kind)


def range_texts(run: RunSummary, kind: Kind) -> Iterator[tuple[str, str, str, str]]:
    """Ranges of a run as (channel, smallest, largest, unit) in units that people use."""
    for channel, ends in run.ranges.items():
        unit, si = channel_unit(channel, kind)
        low, high = ((end - offset(unit, si)) / factor(unit, like=si) for end in ends)
        half = max(abs(low), abs(high), 1e-12) / 2.0
        yield channel, rounding.measured(low, half).value, rounding.measured(high, half).value, unit


def channel_unit(channel: str, kind: Kind) -> tuple[str, str]:
    """Name the printed unit and the SI unit of an input channel or of an output (``output``, ``ax``)."""
    quantity = channel.partition("_")[0]
    if quantity not in rounding.CHANNEL_UNIT:
        quantity = "f" if kind == "accelerometer" else "w"
    return rounding.CHANNEL_UNIT[quantity], CHANNEL_UNITS[quantity]


def off_floor(scale: float) -> float:
    """How far residual over noise is from one, by its logarithm; 0 where nothing is told of it."""
    return 0.0 if math.isnan(scale) else abs(math.log(max(scale, 1e-12)))


def fit_scale(sensor: SensorResult) -> float:
    """Residual over noise of all runs together: rms of the whitened residuals, weighted by samples.

    NaN where no run says anything of it.
    """
    samples = {run.name: run.samples for run in sensor.runs}
    told = [check for check in sensor.checks if not math.isnan(check.scale)]
    weights = np.array([samples.get(check.run, 1) for check in told], dtype=float)
    scales = np.array([check.scale for check in told])
    return float(np.sqrt(np.sum(weights * scales**2) / np.sum(weights))) if len(scales) else math.nan
