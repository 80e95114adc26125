"""Simulated campaigns on a test bench with errors, shared by tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import imubayes as ib
from imubayes.rig.bench import true_inputs
from imubayes.rig.inputs import Run
from imubayes.rig.plans import Plan
from imubayes.sensors.noise import Noise

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


def nominal(plans: Sequence[Plan]) -> tuple[Run, ...]:
    """Runs of a sensor that is not there."""
    return tuple(Run(p.name, p.procedure, p.inputs, np.zeros(len(p.inputs))) for p in plans)
