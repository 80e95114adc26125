from __future__ import annotations

from dataclasses import replace

import pytest
from block_readings import panels, rows, said

from imubayes.reporting.chain_views import (
    MOST_BENCH,
    bench_sections,
    chain_sections,
    change_sections,
    dwell_sections,
)


def test_errors_of_the_test_bench_are_in_printed_units_without_the_dwells(make_sampled) -> None:
    found = rows(bench_sections(make_sampled()))
    assert [row[0] for row in found] == [
        "error of local gravity",
        "rotation of the fixture about j, mount 1",
        "rotation of the fixture about j, mount 2",
    ]
    # 0.3 and 0.98 of a prior sd of 50 ug
    assert found[0][1:] == ("± 50", "15 ± 49", "µg", "K1")


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
    found = list(bench_sections(replace(sensor, extras=many)))
    assert [row[0] for row in rows(found)] == [f"mount {k}" for k in range(0, 2 * MOST_BENCH, 2)]
    assert f"{MOST_BENCH} more, of which the test says less" in said(found)


def test_partners_on_the_test_bench_are_named_by_kind_once(make_sampled) -> None:
    sensor = make_sampled()
    partners = ("m_j", "fixture_j.tumble.1", "fixture_j.tumble.2")
    extras = (replace(sensor.extras[0], partners=partners), *sensor.extras[1:])
    assert rows(bench_sections(replace(sensor, extras=extras)))[0][-1] == "d_o, fixture"


@pytest.mark.parametrize(("kind", "si"), [("accelerometer", 9.80665e-6), ("gyroscope", 4.84813681109536e-6)])
def test_offset_of_a_dwell_is_in_the_unit_of_the_output(make_sampled, kind, si) -> None:
    sensor = make_sampled()
    dwell = replace(sensor.distrusted[0], offset=120.0 * si, sd=3.0 * si)
    (row,) = rows(dwell_sections(replace(sensor, kind=kind, distrusted=(dwell,))))
    assert row[-1].startswith("120.0 ± 3.0 ")


def test_long_list_of_dwells_is_cut_and_counted(make_sampled) -> None:
    sensor = make_sampled()
    found = list(dwell_sections(replace(sensor, distrusted=sensor.distrusted * 30)))
    assert 0 < len(rows(found)) < 60 and f"{60 - len(rows(found))} more are in result.json" in said(found)


def test_chains_of_many_components_have_fewer_figures_and_none_where_nothing_is_drawn(make_sampled) -> None:
    sensor = make_sampled()
    alone, beside, none = (list(chain_sections(sensor, "s1", count)) for count in (1, 9, 0))
    # traces and ranks of what is watched, and the corner
    assert len(panels(alone)) == 13 and len(panels(beside)) == 7 and not panels(none)
    assert len(panels(beside)[-1].svg) < len(panels(alone)[-1].svg)
    assert rows(none) == rows(alone)


def test_exact_component_has_no_chains(make_sensor) -> None:
    sensor = make_sensor()
    assert not [*chain_sections(sensor, "s1", 1), *bench_sections(sensor), *change_sections(sensor)]
