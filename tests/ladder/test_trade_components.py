from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trades import problem

from imubayes.campaign.study import Study
from imubayes.errors import InputError
from imubayes.ladder.trade.components import drawn, of_lots, of_study
from imubayes.study.schema import read

LOTS = Path(__file__).parents[2] / "studies" / "mems_vs_fog.toml"


@pytest.fixture(scope="module")
def lots():
    study = read(LOTS)[1]
    assert study
    return replace(study, missions=())


def test_a_lot_gives_one_unit_of_each_class_and_further_units_as_repeats(lots):
    found = of_lots(lots, ["mems_tactical", "fog_tactical"], repeats=5)
    assert [one.name for one in found.subjects] == ["mems_tactical", "fog_tactical"]
    for subject in found.subjects:
        np.testing.assert_array_equal(drawn(subject, None, 1).truth, subject.lot.theta[2])
        assert not np.array_equal(subject.lot.theta[2], subject.lot.theta[0])


def test_the_bench_of_a_lot_is_allowed_for(lots):
    (one,) = of_lots(lots, ["fog_tactical"], repeats=2).subjects
    own = {spec.sensor_class.id: spec.reference for spec in lots.specs}
    assert one.problem.spec.reference == own["fog_tactical"]


def test_names_that_are_not_in_the_study_are_refused(lots):
    with pytest.raises(InputError, match="did you mean 'fog_tactical'"):
        of_lots(lots, ["fog_tacticl"])
    spec = problem().spec
    with pytest.raises(InputError, match="no sensor of the study is called 'x'"):
        of_study(Study("s", 1, (spec,), Path("s.toml"), ""), ["x"])
