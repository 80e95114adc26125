"""What is kept of a unit of many, and how it is tested: on a bench with errors, as if it were unknown.

The bench's errors are drawn anew for each simulated unit, normal with the sds that the study states, and they
act on what the rig applied, not on what it says. The analysis allows for them under the same sds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, reorder, with_prior_rows
from imubayes.campaign.preparation import prepare
from imubayes.campaign.study import SensorSpec
from imubayes.inference.at_noise import at_found_noise
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.rig.reference import OFFSET, errors_of
from imubayes.rig.runs import plan_run
from imubayes.rig.simulate import simulate
from imubayes.selection.decision import loose_fit, select
from imubayes.selection.draws import posterior_draws
from imubayes.sensors.lots import Lot


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What is kept of a unit; arrays are in the order of the library, SI.

    Attributes
    ----------
    number, name : of the unit.
    mean, sd : (p,) model-averaged.
    full_mean, full_sd : (p,) under the full library and a prior so wide that it only holds what the data
        leave open.
    inclusion : (p,) posterior probability of each term.
    verdicts : of each term.
    noise : N, B, K that was found, averaged over runs.
    samples : rows used.
    R : (p + 1, p + 1) triangular factor of the terms and the response, whitened with the noise that was
        found; the errors of the bench are integrated out.
    truth : (p,) coefficients of a simulated unit; NaN for a recorded one.
    draws : (m, p) model-averaged posterior draws, for scenes; none where no scene asks.
    """

    number: int
    name: str
    mean: FloatArray
    sd: FloatArray
    full_mean: FloatArray
    full_sd: FloatArray
    inclusion: FloatArray
    verdicts: tuple[str, ...]
    noise: tuple[float, float, float]
    samples: int
    R: FloatArray
    truth: FloatArray
    draws: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True, slots=True)
class Broken:
    """A unit that has no record, and why."""

    number: int
    name: str
    error: str


def record_of(
    number: int,
    spec: SensorSpec,
    runs: Sequence[Run],
    truth: FloatArray,
    seed: Sequence[int],
    *,
    draws: int = 0,
) -> Record:
    """Analyse one unit; the noise is held as it was found.

    Parameters
    ----------
    number : of the unit.
    spec : of the unit: its name is the record's.
    runs : recorded or simulated.
    truth : (p,) coefficients of a simulated unit, SI; NaN of a recorded one.
    seed : of what is drawn.
    draws : of the posterior that are kept.

    Raises
    ------
    ConvergenceError : if the errors of the bench do not settle.
    """
    rng = np.random.default_rng(seed)
    ready = prepare(spec, runs, lambda message: None, rng)
    selection = select(ready.summary, ready.prior, noises=(at_found_noise(ready.summary, ready.prior),))
    mean, cov = loose_fit(ready.summary, ready.prior)
    p, found = len(selection.terms), ready.summary.runs
    N, B, K = np.mean([(run.noise.N, run.noise.B, run.noise.K) for run in found], axis=0).tolist()
    return Record(
        number=number,
        name=spec.id,
        mean=np.array([term.mean for term in selection.terms]),
        sd=np.array([term.sd for term in selection.terms]),
        full_mean=mean[:p],
        full_sd=np.sqrt(np.diagonal(cov)[:p]),
        inclusion=np.array([term.inclusion for term in selection.terms]),
        verdicts=tuple(term.verdict for term in selection.terms),
        noise=(N, B, K),
        samples=sum(run.samples for run in found),
        R=of_terms(ready.summary, ready.prior).R,
        truth=truth,
        draws=posterior_draws(selection, draws, rng) if draws else np.zeros((0, 0)),
    )


def of_terms(summary: Summary, prior: ScalePrior) -> Factor:
    """Factor of the terms alone, at the noise that was found.

    With the rows of their prior stacked under it, and their columns first, what the errors of the bench do is
    in the rows above those of the terms: these alone have the terms' likelihood with the errors integrated
    out.
    """
    found = at_found_noise(summary, prior).factor
    terms = len(summary.names) - len(summary.extras)
    rows = np.where(np.arange(found.p) < terms, 0.0, 1.0 / prior.sd)
    whole = replace(found, R=with_prior_rows(found.R, rows))
    sorted_ = reorder(whole, (*summary.names[terms:], *summary.names[:terms]))
    extras = found.p - terms
    return Factor(sorted_.names[extras:], sorted_.R[extras:, extras:], found.n, found.log_det)


def simulate_unit(spec: SensorSpec, lot: Lot, number: int, rng: np.random.Generator) -> tuple[Run, ...]:
    """Runs of one unit on a bench with errors, with the inputs that the rig says.

    Parameters
    ----------
    spec : of the unit: its runs, and the sd of each kind of error of the bench.
    lot : that the unit is of.
    number : of the unit.
    rng : draws the bench's errors, then the noise.
    """
    plans = [plan_run(run) for run in spec.runs]
    errors = _errors(plans, spec.reference, rng)
    moved = [replace(plan, inputs=true_inputs(plan, errors)) for plan in plans]
    runs = simulate(lot.sensor_class, moved, seed=rng, truth=spec.truth, noise=lot.noise[number])
    return tuple(
        replace(run, inputs=plan.inputs, output=run.output + errors.get(f"{OFFSET}.{run.name}", 0.0))
        for run, plan in zip(runs, plans, strict=True)
    )


def _errors(plans: list[Plan], reference: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Errors of the bench by name, SI, normal with the sds that are stated."""
    return {
        error.name: float(rng.normal(0.0, reference[error.kind])) for error in errors_of(plans, reference)
    }
