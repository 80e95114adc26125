"""One unit of a lot: tested on a bench with errors, and analysed as if nothing were known of it.

The bench's errors are drawn anew for each unit, normal with the sds that the study states, and they act on
what the rig applied, not on what it says. The analysis allows for them under the same sds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from imubayes.campaign.preparation import prepare
from imubayes.campaign.study import SensorSpec
from imubayes.inference.at_noise import at_found_noise
from imubayes.inference.summary import Summary
from imubayes.population.lots.answers import UnitFound
from imubayes.population.lots.plan import LotStudy
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run
from imubayes.rig.profiles import Plan
from imubayes.rig.reference import OFFSET, errors_of
from imubayes.rig.runs import plan_run
from imubayes.rig.simulate import simulate
from imubayes.selection.decision import loose_fit, select
from imubayes.selection.draws import posterior_draws
from imubayes.sensors.catalogue import coupled
from imubayes.sensors.lots import Lot, draw_lot

DRAWS = 500
"""Posterior draws of a unit: quantiles over them scatter by less than units do."""


def lot_of(study: LotStudy, class_index: int) -> Lot:
    """Draw the lot of one class of a study."""
    rng = np.random.default_rng([study.seed, class_index, 0])
    return draw_lot(study.classes[class_index], study.library, study.units, rng)


def unit_of(study: LotStudy, class_index: int, number: int, lot: Lot) -> UnitFound:
    """Test and analyse one unit.

    Parameters
    ----------
    study : says the campaign, and how well the bench is known.
    class_index, number : of the class in the study, and of the unit in its lot.
    lot : that the unit is of.

    Raises
    ------
    StudyError : if the options of a run make no run.
    ConvergenceError : if the errors of the bench do not settle.
    """
    seed = (study.seed, class_index, 1, number)
    spec = _spec(study, class_index, lot.truth(number))
    runs = simulate_unit(spec, lot, number, np.random.default_rng([*seed, 0]))
    rng = np.random.default_rng([*seed, 1])
    ready = prepare(spec, runs, lambda message: None, rng)
    selection = select(ready.summary, ready.prior, noises=(at_found_noise(ready.summary, ready.prior),))
    mean, cov = loose_fit(ready.summary, ready.prior)
    p = len(study.library.terms)
    return UnitFound(
        class_id=lot.sensor_class.id,
        number=number,
        truth=lot.theta[number],
        mean=mean[:p],
        cov=cov[:p, :p],
        average=np.array([term.mean for term in selection.terms]),
        sd=np.array([term.sd for term in selection.terms]),
        inclusion=np.array([term.inclusion for term in selection.terms]),
        verdicts=tuple(term.verdict for term in selection.terms),
        draws=posterior_draws(selection, DRAWS, rng),
        noise=_noise(ready.summary),
    )


def _spec(study: LotStudy, class_index: int, truth: Mapping[str, float]) -> SensorSpec:
    entry = study.classes[class_index]
    return SensorSpec(
        entry.id,
        study.kind,
        entry,
        coupled(study.library, entry),
        study.runs,
        truth,
        reference=dict(study.reference),
    )


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


def _noise(summary: Summary) -> tuple[float, float, float]:
    N, B, K = np.mean([(run.noise.N, run.noise.B, run.noise.K) for run in summary.runs], axis=0).tolist()
    return N, B, K
