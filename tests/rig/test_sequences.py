"""Dwells in an order of one's own."""

import numpy as np
import pytest
from run_files import same

from imubayes.rig.recordings import RunSpec
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.sequences import Dwell, in_order, menu_of
from imubayes.rig.simulate import plan_run
from imubayes.rig.tumbles import tumble


@pytest.mark.parametrize(
    ("profile", "options"),
    [
        (tumble, {"angles": 6, "planes": 2}),
        (rate_table, {"rates": (-1.0, 0.5), "mounts": 3}),
        (centrifuge, {"levels": (1.0, 5.0), "mounts": 4}),
    ],
)
def test_dwells_in_the_procedures_own_order_are_the_procedure(profile, options):
    usual = profile(**options, dwell=3.0, rate=2.0, settle=4.0).inputs
    menu = menu_of(profile, options)
    steps = [Dwell(k, 3.0, 4.0) for k in range(len(menu.inputs))]
    run = in_order(menu, steps, rate=2.0).inputs
    np.testing.assert_allclose(run.t, usual.t, atol=1e-12)
    assert run.interval == usual.interval
    same(run, usual)


def test_a_mount_that_is_come_back_to_is_a_new_one():
    menu = menu_of(tumble, {"angles": 4, "planes": 2})
    run = in_order(menu, [Dwell(at, 1.0) for at in (0, 2, 5, 1)], rate=1.0).inputs
    assert run.mount is not None
    assert run.mount.tolist() == [0, 0, 1, 2]


def test_steps_of_a_study_become_the_run_that_they_say():
    steps = ({"at": 1, "dwell": 2.0, "pause": 30.0}, {"at": 0, "dwell": 1.0, "pause": 5.0})
    simulate = {"profile": "tumble", "angles": 4, "planes": 1, "rate": 1.0, "steps": steps}
    inputs = plan_run(RunSpec("short", "tumble", simulate=simulate)).inputs
    assert inputs.t.tolist() == [0.0, 1.0, 7.0]
    assert (inputs.channels["f_i"] / 9.80665).round(12).tolist() == [0.0, 0.0, 1.0]
