"""Simulated campaigns on a test bench with errors, shared by tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import imubayes as ib
from imubayes.campaign.prepared import Doubt
from imubayes.ladder.posteriors import averaged
from imubayes.ladder.problem import decided, ground_of, prepared
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.sensors.noise import Noise
from imubayes.work import silent

QUIET = Noise(0.0, 0.0, 0.0)


def measured(
    sensor, plans: Sequence[Plan], truth: Mapping[str, float], errors: Mapping[str, float], rng, **options
) -> tuple[Run, ...]:
    """Runs on a rig with errors, with the inputs that the rig says."""
    moved = [replace(plan, inputs=true_inputs(plan, errors)) for plan in plans]
    runs = ib.simulate(sensor, moved, seed=rng, truth=truth, **options)
    return tuple(
        replace(run, inputs=plan.inputs, output=run.output + errors.get(f"turn_on.{run.name}", 0.0))
        for run, plan in zip(runs, plans, strict=True)
    )


def decided_terms(problem, *, doubted: bool):
    """Terms as they are decided, and what was prepared, with or without a doubt of bench and library."""
    asked = replace(problem, doubt=Doubt(3, (1,)) if doubted else None)
    ground = ground_of(asked, np.random.default_rng(1), silent, None)
    return decided(ground, averaged(ground)).selection.terms, prepared(ground)


def nominal(plans: Sequence[Plan]) -> tuple[Run, ...]:
    """Runs of a sensor that is not there."""
    return tuple(Run(p.name, p.procedure, p.inputs, np.zeros(len(p.inputs))) for p in plans)
