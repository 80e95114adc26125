from typing import get_args

import pytest

from imubayes.campaign.fidelity import LADDER, RungName, rung_of
from imubayes.errors import InputError


def test_ladder_has_every_rung_once_in_the_order_of_its_names():
    assert tuple(rung.name for rung in LADDER) == get_args(RungName)


def test_only_the_last_rung_leaves_nothing_out():
    assert [rung.name for rung in LADDER if not rung.leaves_out] == [LADDER[-1].name]


def test_an_unknown_rung_is_answered_with_those_there_are():
    with pytest.raises(InputError, match=r"'fastest' is not known: expected one of means, sparse, plug-in"):
        rung_of("fastest")
