"""Relinearisation: where it ends, and where it must not."""

import numpy as np
import pytest

from imubayes.errors import ConvergenceError
from imubayes.inference.settle import Pace, Round, settle
from imubayes.inference.summary import Summary

PACE = Pace("rows", judged=range(1), settled=1e-6, rounds=30)
ROWS = 100


def of_rows(value):
    """A round at a place (1,) of rows of a coefficient whose least-squares value there is `value`; sd 0.1."""

    def at(place, noise, second):
        rows = np.ones((ROWS, 1)), np.full(ROWS, value(float(place[0])))
        return Round(place, Summary.from_arrays(*rows, ("a",)), (), noise)

    return at


def test_a_smooth_curve_settles_at_its_root():
    found = settle(of_rows(lambda a: 0.5 * np.cos(a)), np.array([1e6]), PACE, np.zeros(1))
    assert found.place[0] == pytest.approx(0.450183611294874, abs=1e-6)  # a = cos(a)/2


def test_a_sign_that_changes_to_and_fro_settles_within_what_it_moves():
    found = settle(of_rows(lambda a: -7e-4 * np.sign(a)), np.array([1e6]), PACE, np.full(1, 0.3))
    assert abs(found.place[0]) == pytest.approx(7e-4)


@pytest.mark.parametrize(
    "value", [lambda a: -0.7 * np.sign(a), lambda a: 0.95 * a], ids=["far to and fro", "slow"]
)
def test_what_is_still_on_its_way_has_not_settled(value):
    with pytest.raises(ConvergenceError, match="rows did not settle in 30 rounds"):
        settle(of_rows(value), np.array([1e6]), PACE, np.full(1, 0.5))
