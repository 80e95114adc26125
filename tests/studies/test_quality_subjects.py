import numpy as np
import pytest

from imubayes.rig.bench import true_inputs
from imubayes.sensors.terms import columns, library
from studies.decision_quality.subjects import runs_of, subject


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_misplaced_reference_changes_the_output_by_what_it_applies_alone(kind):
    one = subject(library(kind), 0, seed=5)
    theta = np.array(list(one.truth.values()))
    for right, wrong, plan in zip(runs_of(one), runs_of(one, misplaced=True), one.plans, strict=True):
        true = true_inputs(plan, one.errors)
        told, applied = plan.inputs.channels, true.channels
        n = len(true)
        own = applied.get(one.library.own, np.zeros(n)) - told.get(one.library.own, np.zeros(n))
        more = (columns(one.library, applied, n) - columns(one.library, told, n)) @ theta
        assert wrong.inputs is plan.inputs
        size = np.abs(right.output).max()
        np.testing.assert_allclose(wrong.output - right.output, own + more, atol=1e-12 * size)
