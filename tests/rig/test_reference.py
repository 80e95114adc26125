"""Kinds of errors of the test bench: units, sizes, names, and which runs they concern."""

import numpy as np
import pytest

from imubayes.rig.bench import KINDS, TILT, errors_of, refuse_idle
from imubayes.rig.inputs import Inputs
from imubayes.rig.plans import Plan
from imubayes.rig.rotations import centrifuge, rate_table
from imubayes.rig.tumbles import tumble
from imubayes.units import factor

SHORT = {"dwell": 1.0, "rate": 1.0}
TUMBLE, ARM = tumble(angles=6, **SHORT), centrifuge([1, 5], mounts=3, **SHORT)
TABLE = rate_table([-1.0, 1.0], mounts=2, **SHORT)


SWING = Plan("swing", "oscillation", Inputs(np.arange(9.0), {"w_i": np.sin(np.arange(9.0))}, 1.0))
BENCH = (TUMBLE, ARM, TABLE, SWING)


@pytest.mark.parametrize("kind", [*KINDS.values(), TILT], ids=lambda kind: kind.name)
def test_printed_unit_measures_what_the_si_unit_does(kind):
    assert factor(kind.unit, like=kind.unit) == pytest.approx(1.0, rel=1e-12)
    assert factor(kind.printed, like=kind.unit) > 0.0


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("latency", ["latency"]),
        ("rate_scale", ["rate_scale.centrifuge", "rate_scale.rate-table", "rate_scale.oscillation"]),
        ("plane_zero", ["plane_zero.tumble.0", "plane_zero.tumble.1", "plane_zero.tumble.2"]),
        ("fixture_common", ["fixture_common_i", "fixture_common_j", "fixture_common_k"]),
        ("turn_on", ["turn_on.tumble", "turn_on.centrifuge", "turn_on.rate-table", "turn_on.swing"]),
    ],
)
def test_one_unknown_for_each_place_that_an_error_is_confined_to(kind, names):
    assert [error.name for error in errors_of(BENCH, [kind])] == names


def test_a_fixture_has_three_rotations_in_each_mount():
    errors = errors_of(BENCH, ["fixture"])
    assert len(errors) == 3 * (3 + 3 + 2 + 1)
    assert {error.run: error.mount for error in errors} == {
        "tumble": 2, "centrifuge": 2, "rate-table": 1, "swing": 0
    }  # fmt: skip
    assert errors[5].name == "fixture_k.tumble.1"
    assert errors[5].text == "rotation of the case in its fixture about k in mount 1 of run tumble"


def test_every_kind_of_error_shows_in_runs_that_tell_their_inputs():
    refuse_idle([TUMBLE, ARM, TABLE, SWING], [kind for kind in KINDS if kind != "earth_rate"])


def test_a_ramp_and_a_swing_show_a_latency():
    refuse_idle([SWING], ["latency"])
    refuse_idle([centrifuge([1, 5], ramp=True)], ["latency"])
