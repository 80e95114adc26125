"""Class-level results side by side."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from lots_found import lot_result

from imubayes.errors import DataError, InputError
from imubayes.inference.intervals import Share
from imubayes.reporting.comparison.kinds import comparison_json, side_by_side
from imubayes.reporting.comparison.lot_files import lots_of, unit_of_term
from imubayes.reporting.comparison.lots import lots_compared
from imubayes.reporting.comparison.pulls import QUANTILE, fisher
from imubayes.reporting.lots_results import lots_json
from imubayes.reporting.result.file import written
from imubayes.sensors.terms import library


@pytest.fixture
def write(tmp_path):
    def write(result):
        file = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
        file.write_text(lots_json(result))
        return file

    return write


def _changed(result, **population):
    """The first class with other figures of its first term."""
    first = result.classes[0]
    terms = (replace(first.terms[0], **population), *first.terms[1:])
    return replace(result, classes=(replace(first, terms=terms), *result.classes[1:]))


def _compared(write, *results):
    return lots_compared([lots_of(written(write(one))) for one in results])


def test_result_is_read_as_it_was_written(write):
    result = lot_result()
    read = lots_of(written(write(result)))
    assert (read.kind, read.units, list(read.classes)) == (
        "gyroscope",
        4,
        [c.sensor_class.id for c in result.classes],
    )
    for one in result.classes:
        found = read.classes[one.sensor_class.id]
        assert found.order == one.order and found.noise == tuple(unit.noise for unit in one.units)
        assert {name: (t.mean, t.spread, t.share) for name, t in found.terms.items()} == {
            t.name: (t.mean, t.spread, t.needed) for t in one.terms
        }
        for scene in one.missions:
            assert found.scenes[scene.mission].order == scene.order
            assert found.scenes[scene.mission].shares == {t.name: t.share for t in scene.terms}


def test_equal_results_do_not_differ(write):
    found = _compared(write, lot_result(), lot_result())
    pulls = [pull for one in found.classes for term in one.terms for _, pull in term.pulls]
    assert max(pull.size for pull in pulls) == 0.0 and not any(pull.beyond for pull in pulls)
    assert found.alone == () and not any(one.apart for one in found.classes)


def test_mean_differs_over_its_sd_and_spread_by_its_logarithm(write):
    result = lot_result()
    a = _changed(result, mean=Share(1.0, 0.9, 1.1), spread=Share(1.0, 0.5, 2.0))
    b = _changed(result, mean=Share(2.0, 1.9, 2.1), spread=Share(4.0, 2.0, 8.0))
    term = _compared(write, a, b).classes[0].terms[0]
    assert term.mean.size == pytest.approx(1.0 / (math.sqrt(2.0) * 0.1 / QUANTILE), rel=1e-12)
    assert term.spread.size == pytest.approx(2.0 / math.sqrt(2.0) * QUANTILE, rel=1e-12)
    assert term.mean.beyond and not term.spread.beyond


def test_shares_of_units_differ_by_their_counts(write):
    result = lot_result()
    a, b = (_changed(result, needed=Share(share, 0.0, 1.0)) for share in (1.0, 0.25))
    assert _compared(write, a, b).classes[0].terms[0].needed.size == fisher(4, 4, 1, 4)


def test_term_that_no_unit_tests_is_not_compared(write):
    result = _changed(lot_result(), mean=Share(9e9, 8e9, 1e10))
    first = result.classes[0]
    units = tuple(replace(u, verdicts=("untested", *u.verdicts[1:])) for u in first.units)
    blind = replace(result, classes=(replace(first, units=units), *result.classes[1:]))
    term = _compared(write, lot_result(), blind).classes[0].terms[0]
    assert [pull for _, pull in term.pulls] == [None, None, None]


def test_classes_of_one_result_only_are_named(write):
    result = lot_result()
    less = replace(result, classes=result.classes[1:])
    found = _compared(write, result, less)
    assert found.alone == (("A", result.classes[0].sensor_class.id),)
    assert [one.id for one in found.classes] == [c.sensor_class.id for c in less.classes]


def test_model_orders_are_apart_where_no_unit_is_in_both_ranges(write):
    result = lot_result()
    far = replace(
        result, classes=(replace(result.classes[0], order=Share(40.0, 38.0, 42.0)), *result.classes[1:])
    )
    assert [one.apart for one in _compared(write, result, far).classes] == [True, False, False]


def test_what_cannot_be_compared_is_refused(write):
    result = lot_result()
    with pytest.raises(InputError, match="2 to 26"):
        _compared(write, result)
    with pytest.raises(InputError, match=r"no class in common .*mems_consumer"):
        _compared(
            write, replace(result, classes=result.classes[:1]), replace(result, classes=result.classes[1:])
        )
    other = replace(result, study=replace(result.study, kind="accelerometer"))
    with pytest.raises(InputError, match="A gyroscopes, B accelerometers"):
        _compared(write, result, other)
    file = write(result)
    raw = json.loads(file.read_text())
    del raw["lots"]["classes"][0]["terms"][0]["needed"]
    file.write_text(json.dumps(raw))
    with pytest.raises(DataError, match=r"terms\[0\]\.needed: the key is missing"):
        lots_of(written(file))


def test_every_term_that_a_library_can_have_is_printed_in_its_own_unit():
    lib = library(
        "gyroscope", powers=5, asymmetry=3, set="extended", temperature=2, temperature_of=("b0", "c_ij")
    )
    assert all(unit_of_term(term.name, "gyroscope")[0] == term.printed for term in lib.terms)


def test_numbers_say_what_differs(write):
    result = lot_result()
    moved = _changed(result, mean=Share(1e3, 0.9e3, 1.1e3))
    record = json.loads(comparison_json(side_by_side([write(result), write(moved)]).record))
    differing = [
        (one["id"], term["name"])
        for one in record["classes"]
        for term in one["terms"]
        if term["mean"]["differs"]
    ]
    assert differing == [("mems_consumer", "b0")]
    assert np.isfinite(record["threshold"])
