"""Which noise processes a run shows: evidence of every set of them.

White noise is in every set. Bias instability, random walk, quantization, a ramp and a Gauss-Markov process
are each in half of the sets; the sets are weighed by the evidence of the run under the class's priors, with
the library's columns projected out, so that the unit may be under test. Beside it stands the other route: a
fit of the Allan variance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.inference.allan import AllanCurve, AllanFit, allan_curve, fit_allan
from imubayes.inference.linear import Linear, residuals
from imubayes.inference.noise_fit import ProcessFit, detection_limits, fit_draws, fit_mode, parameters
from imubayes.inference.noise_model import NoiseModel, noise_rows, prior_of, process_model, scatter, span
from imubayes.rig.inputs import between_gaps
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, listed
from imubayes.sensors import SensorClass
from imubayes.sensors.noise import NAMES, OPTIONAL, NoisePrior, Sizes, class_prior, vague_prior

WORTH = 7.0
"""Nats below the best set beyond which importance draws would change no inclusion by more than 0.001."""

FEW = 40.0
"""Effective draws by which a set is weighed: its evidence is then known to 0.15 nats."""

ENOUGH = 1000.0
"""Effective draws of all sets together, each by its probability: what is to hold 5 % holds 4 to 6 %."""

DRAWS = 2000
"""Posterior draws from which quantiles are taken."""

GROUPS = ((1, NEEDED), (2, 0.99))
"""Partners of an inseparable process, and the probability that one of the group is there: of three processes
that the run says nothing of, one is there with 0.875 by the prior alone."""

TOLD = 0.7
"""Posterior sd over prior sd of the logarithm up to which the data have told a size."""

SIZES = (*NAMES, "tau")
"""What has a posterior: the processes' sizes and the time constant."""


@dataclass(frozen=True, slots=True)
class ProcessSize:
    """Posterior of one process, SI; of its size where it is there.

    Attributes
    ----------
    name : N, B, K, Q, R, G, or tau, the time constant of G.
    inclusion : probability that the run shows the process; 1 for N.
    mean, sd, q05, q50, q95 : over the sets that have it; not a number where none was drawn.
    limit95 : size that it stays below with 95 %, over the sets that have it.
    detection_limit : size from which a run like this one finds it with 95 %; not a number for N and tau.
    verdict, reason : ``needed``, ``not needed``, ``undecided``, ``inseparable`` (one of it and its partners
        is there, and the run cannot say which) or ``unresolved``.
    confounded_with : the partners.
    """

    name: str
    inclusion: float
    mean: float
    sd: float
    q05: float
    q50: float
    q95: float
    limit95: float
    detection_limit: float
    verdict: str
    reason: str
    confounded_with: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class NoiseChoice:
    """What a run says of its noise processes.

    Attributes
    ----------
    run : its name.
    sizes : of N, B, K, Q, R, G and tau, those that were asked for.
    sets : (processes beside N, probability), most probable first.
    noise : the medians of the processes of the best set.
    prior : in words, where the priors come from.
    samples, rows : of the run, and averages that it was judged by.
    draws : (m, 7) posterior draws of `SIZES`, zero where a draw's set has no such process.
    curve : Allan deviation of the residuals beside the processes; None for too short a run.
    fit : by the weighted fit of the Allan variance; None where gaps interrupt the run.
    """

    run: str
    sizes: tuple[ProcessSize, ...]
    sets: tuple[tuple[tuple[str, ...], float], ...]
    noise: Sizes
    prior: str
    samples: int
    rows: int
    draws: FloatArray
    curve: AllanCurve | None = None
    fit: AllanFit | None = None

    @property
    def identified(self) -> tuple[str, ...]:
        """Processes beside N with an inclusion of 0.95 or more."""
        return tuple(size.name for size in self.sizes if size.name in OPTIONAL and size.verdict == "needed")

    def size(self, name: str) -> ProcessSize:
        """Posterior of a process by its symbol."""
        return next(size for size in self.sizes if size.name == name)


def identify_noise(
    rows: Linear,
    sensor: SensorClass | None = None,
    *,
    rng: np.random.Generator,
    candidates: Sequence[str] = OPTIONAL,
) -> NoiseChoice:
    """Weigh every set of noise processes on one run.

    Parameters
    ----------
    rows : of the run, a quiet log or a test; the library's columns are projected out.
    sensor : class whose priors hold; None takes wide ones.
    rng : of the importance draws.
    candidates : processes beside N that the run may show.
    """
    return identified([question_of(rows, sensor, candidates)], rng)[0]


class ProcessQuestion(NamedTuple):
    """What is weighed of one run: its rows laid out, where the prior is from, and the processes `asked`."""

    run: str
    samples: int
    data: NoiseModel
    source: str
    asked: tuple[str, ...]


def question_of(
    rows: Linear, sensor: SensorClass | None, candidates: Sequence[str] = OPTIONAL
) -> ProcessQuestion:
    """Lay out a run for `identified`; parameters as `identify_noise` has them."""
    means, levels = noise_rows(rows)
    if sensor:
        prior, source = class_prior(sensor, rows.sampling), f"class {sensor.id}"
    else:
        prior = vague_prior(scatter(means.y, means.duration), means.rows.span, rows.sampling)
        source = "no class is named: what would just show"
    asked = tuple(name for name in OPTIONAL if name in candidates)
    return ProcessQuestion(rows.name, rows.samples, process_model(means, levels, prior), source, asked)


def identified(questions: Sequence[ProcessQuestion], rng: np.random.Generator) -> list[NoiseChoice]:
    """Weigh every set of noise processes on each run, one after the other."""
    return [_identified(one, rng) for one in questions]


def _identified(question: ProcessQuestion, rng: np.random.Generator) -> NoiseChoice:
    data, asked = question.data, question.asked
    fits = _fits(data, asked, rng)
    weighed = _weighed(fits, ramp="R" in asked)
    draws = _drawn(fits, weighed, rng)
    # the medians of the draws of the best set
    present = np.array([name in next(iter(weighed)) for name in OPTIONAL])
    held = (draws[:, [SIZES.index(name) for name in OPTIONAL]] != 0.0) == present
    middle = np.median(draws[held.all(axis=1)], axis=0).tolist()
    best = {name: size for name, size in zip(SIZES, middle, strict=True) if size != 0.0}
    limits = detection_limits(data, best, asked)
    return NoiseChoice(
        run=question.run,
        sizes=tuple(_sizes(draws, asked, weighed, limits, data.prior)),
        sets=tuple(weighed.items()),
        noise=best,
        prior=question.source,
        samples=question.samples,
        rows=len(data.table),
        draws=draws,
    )


Fits = Mapping[tuple[str, ...], ProcessFit]


def _fits(data: NoiseModel, asked: tuple[str, ...], rng: np.random.Generator) -> Fits:
    """Fit every set of the processes that are not the ramp, small ones first; draw from those that count."""
    coloured = [name for name in asked if name != "R"]
    fits: dict[tuple[str, ...], ProcessFit] = {}
    for size in range(len(coloured) + 1):
        for chosen in combinations(coloured, size):
            names = parameters(chosen)
            fits[chosen] = fit_mode(data, names, list(_starts(data, names, fits, chosen)))
    top = max(max(fit.log_evidence) for fit in fits.values())
    for chosen in [chosen for chosen, fit in fits.items() if max(fit.log_evidence) > top - WORTH]:
        fits[chosen] = fit_draws(data, fits[chosen], rng, enough=FEW)
    total: dict[tuple[str, ...], float] = {}  # of each set, with and without a ramp
    for chosen, p in _weighed(fits, ramp="R" in asked).items():
        others = tuple(name for name in chosen if name != "R")
        total[others] = total.get(others, 0.0) + p
    for chosen, p in total.items():
        if ENOUGH * p > FEW:
            fits[chosen] = fit_draws(data, fits[chosen], rng, enough=ENOUGH * p)
    return fits


def _starts(
    data: NoiseModel, names: tuple[str, ...], fits: Fits, chosen: tuple[str, ...]
) -> Iterator[FloatArray]:
    """Begin from each set that lacks one process, with that one as large as usual, or small."""
    usual = dict(zip(names, prior_of(data, names)[0].tolist(), strict=True))
    yield np.array([*usual.values()])
    for missing in chosen:
        smaller = fits[tuple(name for name in chosen if name != missing)]
        known = usual | dict(zip(smaller.names, smaller.mode.tolist(), strict=True))
        for shift in (0.0, -2.0, -4.0):
            yield np.array([known[name] + shift * (name == missing) for name in names])
    if not chosen:
        yield np.log([scatter(data.table[:, -1], data.rows.duration)])


def _weighed(fits: Fits, *, ramp: bool) -> dict[tuple[str, ...], float]:
    """Probability of each set, with and without a ramp, most probable first."""
    levels: dict[tuple[str, ...], float] = {}
    for chosen, fit in fits.items():
        levels[chosen] = fit.log_evidence[0]
        if ramp:
            levels[tuple(name for name in OPTIONAL if name in (*chosen, "R"))] = fit.log_evidence[1]
    top = max(levels.values())
    total = sum(math.exp(level - top) for level in levels.values())
    ordered = sorted(levels.items(), key=lambda one: -one[1])
    return {chosen: math.exp(level - top) / total for chosen, level in ordered}


def _drawn(fits: Fits, weighed: Mapping[tuple[str, ...], float], rng: np.random.Generator) -> FloatArray:
    """Posterior draws (m, 7) over all sets, in proportion to their probabilities."""
    parts = []
    counts = rng.multinomial(DRAWS, list(weighed.values())).tolist()
    for chosen, count in ((chosen, count) for chosen, count in zip(weighed, counts, strict=True) if count):
        fit = fits[tuple(name for name in chosen if name != "R")]
        weights = fit.weights[:, int("R" in chosen)]
        at = rng.choice(len(weights), size=count, p=weights / weights.sum())
        part = np.zeros((count, len(SIZES)))
        logs = fit.draws[at]
        if len(weights) == 1:
            logs = logs + rng.standard_normal(logs.shape) @ fit.root.T
        part[:, [SIZES.index(name) for name in fit.names]] = np.exp(logs)
        if "R" in chosen:
            part[:, SIZES.index("R")] = rng.normal(fit.ramps[at, 0], fit.ramps[at, 1])
        parts.append(part)
    return np.concatenate(parts)


def _sizes(
    draws: FloatArray,
    asked: tuple[str, ...],
    weighed: Mapping[tuple[str, ...], float],
    limits: Mapping[str, float],
    prior: NoisePrior,
) -> Iterator[ProcessSize]:
    for name in SIZES:
        own = "G" if name == "tau" else name
        if own != "N" and own not in asked:
            continue
        values = draws[:, SIZES.index(name)]
        there = values[values != 0.0] if values.any() else np.array([math.nan])
        q05, q50, q95 = np.quantile(there, [0.05, 0.5, 0.95]).tolist()
        logs = there if name == "R" else np.log(there)  # a ramp has a sign
        spread = float(logs.std()) / prior[name][1] if len(there) > 1 else math.nan
        inclusion = _any(weighed, (own,)) if own != "N" else 1.0
        partners = _partners(own, weighed, asked)
        verdict, reason = _verdict(inclusion, spread, partners)
        yield ProcessSize(
            name=name,
            inclusion=inclusion,
            mean=float(there.mean()),
            sd=float(there.std()),
            q05=q05,
            q50=q50,
            q95=q95,
            limit95=float(np.quantile(np.abs(there), 0.95)),
            detection_limit=limits.get(name, math.nan),
            verdict=verdict,
            reason=reason,
            confounded_with=partners if verdict == "inseparable" else (),
        )


def _any(weighed: Mapping[tuple[str, ...], float], names: Sequence[str]) -> float:
    """Probability that at least one of the processes is there."""
    return min(sum(p for chosen, p in weighed.items() if not set(chosen).isdisjoint(names)), 1.0)


def _partners(name: str, weighed: Mapping[tuple[str, ...], float], asked: tuple[str, ...]) -> tuple[str, ...]:
    """Smallest group of open processes of which the run shows one, and cannot say which."""
    open_ones = [n for n in asked if n != name and NOT_NEEDED < _any(weighed, (n,)) < NEEDED]
    for size, sure in GROUPS:
        # a group that is sure without it says nothing of it
        groups = [group for group in combinations(open_ones, size) if _any(weighed, group) < NEEDED]
        sums = {group: _any(weighed, (name, *group)) for group in groups}
        best = max(sums, key=lambda group: sums[group], default=())
        if best and sums[best] >= sure:
            return best
    return ()


def _verdict(inclusion: float, spread: float, partners: tuple[str, ...]) -> tuple[str, str]:
    if inclusion >= NEEDED or inclusion <= NOT_NEEDED:
        return "needed" if inclusion >= NEEDED else "not needed", f"inclusion {inclusion:.3f}"
    if partners:
        return "inseparable", f"the run shows it or {listed(partners)}: a longer one tells them apart"
    if spread > TOLD:
        return "unresolved", "its usual size is below what this run can tell: record longer"
    return "undecided", f"inclusion {inclusion:.2f}: a longer run would settle it"


def with_curve(choice: NoiseChoice, rows: Linear, theta: FloatArray | None) -> NoiseChoice:
    """Noise processes of a run beside its Allan deviation.

    That is of the residuals of the coefficients theta (p,), None for those that fit the run alone best by
    least squares; the evidence needs none.
    """
    if theta is None:
        basis = span(rows.columns(0, len(rows)))
        left = rows.y - basis @ (basis.T @ rows.y)
    else:
        left = residuals(rows, theta)
    curve = allan_curve(left, rows.t, rows.interval, choice.noise)
    choice = replace(choice, curve=curve)
    if curve is None or len(between_gaps(rows.t, rows.interval)) > 1:
        return choice
    # averages over blocks are too long to show quantization
    names = tuple(name for name in choice.noise if not (rows.stream and name == "Q"))
    if len(names) >= len(curve.tau):
        return choice
    return replace(choice, fit=fit_allan(curve, choice.noise, names, (len(rows), rows.interval)))
