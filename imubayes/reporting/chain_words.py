"""What the chains and the robust analysis say, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.inference.mcmc.ensembles import STILL
from imubayes.reporting.evidence import exact_evidence
from imubayes.reporting.rows import plug_in_inclusion
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, listed

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.mcmc.chains import Chains

HOW = {
    "exact": "exact",
    "collapsed": "collapsed chains",
    "full": "full chains, of coefficients and noise",
}
"""Each method in words."""

CHANGED = 0.02
"""Change of an inclusion probability that is worth a row."""

MOST_CHANGED = 6
"""Rows of such changes."""

MOST_DWELLS = 4
"""Runs that a sentence names."""


def method_sentence(sensor: SensorResult) -> str:
    """Say how the posterior was computed, and why so; empty where nothing was chosen."""
    if not sensor.method_reason or sensor.choice is not None:
        return ""
    return sentence(f"Posterior: {HOW[sensor.method]}, because {sensor.method_reason}")


def unconverged_sentence(sensor: SensorResult) -> str:
    """Say that the chains cannot be trusted yet; empty where they can, or where there are none."""
    if sensor.chains is None or sensor.chains.diagnostics.converged:
        return ""
    found = sensor.chains.diagnostics
    why = found.text.removeprefix("not converged").lstrip(": ")
    return (
        f"{sensor.id}: the chains have not converged"
        + (f" ({why})" if why else "")
        + f". What rests on them is the estimate so far: {_remedy(sensor)}."
    )


def _remedy(sensor: SensorResult) -> str:
    """What gives the chains more steps, where these help; those of a rung that was chosen are not kept."""
    if sensor.chains and STILL in sensor.chains.diagnostics.text:
        return "hold the noise at its estimate by --method exact"
    if sensor.choice is None:
        return "continue with --resume, or give more time"
    return "give a larger --budget" if sensor.choice.budget is not None else "give a longer --time-limit"


def distrust_sentence(sensor: SensorResult) -> str:
    """Say how many dwells the robust analysis holds for contaminated, and where."""
    count = len(sensor.distrusted)
    if not count:
        return ""
    by_run: dict[str, int] = {}
    for dwell in sensor.distrusted:
        by_run[dwell.run] = by_run.get(dwell.run, 0) + 1
    where = [f"{number} in {run}" for run, number in by_run.items()][:MOST_DWELLS]
    rest = "" if len(by_run) <= MOST_DWELLS else " and elsewhere"
    dwells = "dwell is" if count == 1 else "dwells are"
    return f"{count} {dwells} not trusted ({', '.join(where)}{rest}): the fit goes on without them."


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A line of the table of diagnostics: what, its value, and how to read it."""

    name: str
    value: str
    meaning: str


def diagnoses(sensor: SensorResult, chains: Chains) -> tuple[Diagnosis, ...]:
    """Diagnostics of the chains with what each means."""
    found = chains.diagnostics
    low, high = int(found.ess.argmin()), int(found.rhat.argmax())
    return (
        Diagnosis(
            "smallest effective sample size",
            f"{found.ess[low]:,.0f} ({_said(found.parameters[low])})",
            "how many independent draws the chains are worth; 1,000 place a mean within 0.03 sd",
        ),
        Diagnosis(
            "largest R-hat",
            f"{found.rhat[high]:.3f} ({_said(found.parameters[high])})",
            "spread of all draws over the spread within half an ensemble; below 1.01 they agree",
        ),
        Diagnosis(
            "longest autocorrelation time",
            f"{found.tau.max():.3g} steps",
            "steps after which a walker has forgotten where it was",
        ),
        Diagnosis(
            "accepted proposals",
            f"{found.acceptance:.0%}",
            "near 0 the walkers stand still; high is good for proposals from the posterior itself",
        ),
        Diagnosis(
            "chains",
            f"{found.ensembles} ensembles of {found.walkers} walkers, {found.steps:,} steps each",
            f"{found.text}; {found.seconds:.1f} s",
        ),
        Diagnosis(
            "interpolation error",
            f"{chains.interpolation_error:.2g} nats",
            "largest error of the log density from whitenings between computed ones; 0 where none was needed",
        ),
        *_evidence(sensor, chains),
    )


def _evidence(sensor: SensorResult, chains: Chains) -> Iterator[Diagnosis]:
    """Evidence of the full library by bridge sampling, beside the exact one at the estimated noise."""
    value, sd = chains.log_evidence
    sampled = set(chains.diagnostics.parameters) - set(chains.names)
    over = ", averaged over the prior of the noise" if sampled else ""
    yield Diagnosis(
        "log evidence by bridge sampling",
        f"{value:.2f} ± {sd:.2f}",
        f"of the full library{over}, from the chains",
    )
    exact = exact_evidence(sensor)
    if exact is not None:
        told = "the bridge is lower by what the noise's prior costs" if sampled else "the bridge must agree"
        at = "estimated" if sampled else "given"
        yield Diagnosis(
            "log evidence, exact", f"{exact:.2f}", f"of the full library at the {at} noise: {told}"
        )


def _said(parameter: str) -> str:
    """Name of a noise parameter as it is said.

    Examples
    --------
    >>> _said("N.tumble"), _said("b2"), _said("ax.b0")
    ('N of tumble', 'b2', 'ax.b0')
    """
    letter, dot, run = parameter.partition(".")
    return f"{letter} of {run}" if dot and letter in ("N", "B", "K") else parameter


@dataclass(frozen=True, slots=True)
class Change:
    """Inclusion of a term at the estimated noise, and averaged over the noise's posterior."""

    term: str
    plug_in: float
    averaged: float


def changes(sensor: SensorResult) -> tuple[str, tuple[Change, ...]]:
    """Effect of the uncertain noise on inclusion: a sentence, and the changes worth a row, largest first."""
    plug_in = plug_in_inclusion(sensor.selection)
    if not plug_in:
        return "", ()
    terms = sensor.selection.terms
    every = sorted(
        (Change(t.name, plug_in[t.name], t.inclusion) for t in terms),
        key=lambda one: -abs(one.averaged - one.plug_in),
    )
    crossing = [one.term for one in every if _level(one.plug_in) != _level(one.averaged)]
    first = every[0]
    text = (
        "Averaged over the uncertain noise, no inclusion probability moves by more than"
        f" {abs(first.averaged - first.plug_in):.3f} ({first.term})"
    )
    who = f"{listed(crossing)} cross{'es' if len(crossing) == 1 else ''}" if crossing else "none crosses"
    rows = tuple(one for one in every if abs(one.averaged - one.plug_in) > CHANGED)[:MOST_CHANGED]
    return f"{text}; {who} 0.05, 0.5 or 0.95.", rows


def _level(inclusion: float) -> int:
    return sum(inclusion >= level for level in (NOT_NEEDED, 0.5, NEEDED))


def sentence(text: str) -> str:
    """Close a text as a sentence does."""
    return text if text.endswith((".", "!", "?")) else f"{text}."
