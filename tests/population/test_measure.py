from dataclasses import replace

import numpy as np
import pytest
from lot_studies import small

from imubayes.inference.intervals import Share
from imubayes.population.lots import check, exposures, lot_of, measure, missions, unit_of
from imubayes.population.spreads import population


@pytest.fixture(scope="module")
def found():
    told: list[str] = []
    return measure(small(), progress=told.append), told


def test_every_class_has_its_units_terms_and_scenes(found):
    result, told = found
    study = result.study
    assert [one.sensor_class.id for one in result.classes] == [entry.id for entry in study.classes]
    for one in result.classes:
        assert [unit.number for unit in one.units] == [0, 1]
        assert [term.name for term in one.terms] == list(study.library.names)
        assert [scene.mission for scene in one.missions] == ["shaken"]
    assert told[-2].startswith("4 of 4 units")


def test_classes_are_what_their_units_say_one_by_one(found):
    study, second = found[0].study, found[0].classes[1]
    lot = lot_of(study, 1)
    units = [unit_of(study, 1, number, lot) for number in range(2)]
    assert second.terms == population(units, lot.sensor_class, study.library, lot)
    assert second.missions[0].terms == _scene(units, study).terms
    assert second.order.value == np.median([unit.verdicts.count("needed") for unit in units])


def _scene(units, study):
    exposed = exposures(study.missions, study.library)
    return missions(units, study.missions, exposed, basic=study.basic)[0]


@pytest.mark.slow
def test_two_processes_find_what_one_does(found):
    shared = measure(replace(found[0].study, processes=2))
    assert shared.check == found[0].check
    assert [one.terms for one in shared.classes] == [one.terms for one in found[0].classes]


def test_check_counts_cells_by_what_is_said_and_what_is_true(found):
    one = found[0].classes[0]
    scene, term = one.missions[0], one.missions[0].terms[0]
    said_true = [(0.2, 0.2), (0.2, 0.05), (0.05, 0.2), (0.3, 0.3), (0.01, 0.0), (0.05, 0.099)]
    terms = tuple(
        replace(term, share=replace(term.share, value=said), true_share=true) for said, true in said_true
    )
    shown = tuple(replace(known, needed=Share(1.0, 0.8, 1.0), open=0.0) for known in one.terms[:6])
    told = check([replace(one, terms=shown, missions=(replace(scene, terms=terms),))])
    assert told.cells == (6, 3)
    assert told.precision.value == pytest.approx(2 / 3)
    assert told.recall.value == pytest.approx(2 / 3)


@pytest.mark.parametrize(("hidden", "untold"), [(0.0, 0), (0.49, 0), (0.5, 1), (1.0, 1)])
def test_cells_of_terms_that_half_of_the_units_leave_open_are_counted_apart(found, hidden, untold):
    one = found[0].classes[0]
    shown = tuple(replace(term, needed=Share(1.0, 0.8, 1.0), open=0.0) for term in one.terms)
    first = replace(shown[0], needed=Share(1.0 - hidden, 0.0, 1.0), open=hidden)
    told = check([replace(one, terms=(first, *shown[1:]))])
    assert (told.cells[0], told.untold) == (len(shown) - untold, untold)


def test_coverage_counts_means_and_spreads_apart_of_what_is_tested(found):
    one = found[0].classes[0]
    untested = tuple(
        replace(unit, verdicts=("untested", *("needed",) * (len(unit.verdicts) - 1))) for unit in one.units
    )
    held = [
        replace(t, true_mean=t.mean.value, true_spread=t.spread.high * (2.0 if k == 1 else 1.0))
        for k, t in enumerate(one.terms)
    ]
    lost = (replace(held[0], true_mean=1e9, true_spread=1e9), *held[1:])
    told = check([replace(one, units=untested, terms=lost)])
    n = len(held) - 1
    means, spreads = told.population_mean, told.population_spread
    assert (means.held, means.of, means.share.value) == (n, n, 1.0)
    assert (spreads.held, spreads.of) == (n - 1, n)
    assert spreads.share.value == pytest.approx((n - 1) / n)
