from __future__ import annotations

from dataclasses import replace

import pytest

from imubayes.reporting.chain_views import MOST_BENCH, bench_view, chain_view, dwell_rows, sampled_view


def test_errors_of_the_test_bench_are_in_printed_units_without_the_dwells(make_sampled) -> None:
    view = bench_view(make_sampled())
    assert [row.text for row in view.rows] == [
        "error of local gravity",
        "rotation of the fixture about j, mount 1",
        "rotation of the fixture about j, mount 2",
    ]
    gravity = view.rows[0]
    # 0.3 and 0.98 of a prior sd of 50 ug
    assert (str(gravity.prior), str(gravity.value)) == ("50 ug", "15 +- 49 ug")
    assert gravity.partners == ("K1",) and view.left_out == 0


def test_of_many_errors_those_that_the_test_narrows_most_are_listed_in_their_order(make_sampled) -> None:
    sensor = make_sampled()
    fixture = sensor.extras[1]
    many = tuple(
        replace(
            fixture,
            extra=replace(fixture.extra, name=f"fixture_j.tumble.{k}", text=f"mount {k}"),
            sd=fixture.extra.sd * (1.0 if k % 2 else 0.5),
        )
        for k in range(2 * MOST_BENCH)
    )
    view = bench_view(replace(sensor, extras=many))
    assert [row.text for row in view.rows] == [f"mount {k}" for k in range(0, 2 * MOST_BENCH, 2)]
    assert view.left_out == MOST_BENCH


def test_partners_on_the_test_bench_are_named_by_kind_once(make_sampled) -> None:
    sensor = make_sampled()
    partners = ("m_j", "fixture_j.tumble.1", "fixture_j.tumble.2")
    extras = (replace(sensor.extras[0], partners=partners), *sensor.extras[1:])
    assert bench_view(replace(sensor, extras=extras)).rows[0].partners == ("d_o", "fixture")


@pytest.mark.parametrize(("kind", "si"), [("accelerometer", 9.80665e-6), ("gyroscope", 4.84813681109536e-6)])
def test_offset_of_a_dwell_is_in_the_unit_of_the_output(make_sampled, kind, si) -> None:
    dwell = replace(make_sampled().distrusted[0], offset=120.0 * si, sd=3.0 * si)
    (row,) = dwell_rows((dwell,), kind)
    assert (row.offset.value, row.offset.sd) == ("120.0", "3.0")


def test_long_list_of_dwells_is_cut_and_counted(make_sampled) -> None:
    sensor = make_sampled()
    view = sampled_view(replace(sensor, distrusted=sensor.distrusted * 30), "s1", 0)
    assert len(view.dwells) + view.more_dwells == 60 and view.more_dwells > 0


def test_chains_of_many_components_have_fewer_figures_and_none_where_nothing_is_drawn(make_sampled) -> None:
    sensor = make_sampled()
    alone, beside, none = (chain_view(sensor, "s1", count) for count in (1, 9, 0))
    assert len(alone.traces) == len(alone.ranks) == 6 and len(beside.traces) == 3
    assert beside.corner is not None and len(beside.corner.svg) < len(alone.corner.svg)
    assert none.traces == none.ranks == () and none.corner is None and none.diagnoses == alone.diagnoses


def test_exact_component_has_no_chains(make_sensor) -> None:
    view = sampled_view(make_sensor(), "s1", 1)
    assert view.chains is None and view.bench.rows == () and view.changed == ""
