from dataclasses import replace
from pathlib import Path

import pytest
from fleets_found import fleet_result

from imubayes.population.records import Unit
from imubayes.reporting.blocks import page_html
from imubayes.reporting.fleet_page import fleet_page


@pytest.fixture(scope="module")
def html() -> str:
    return page_html(fleet_page(fleet_result()))


def test_recorded_units_have_no_column_of_the_truth(html):
    result = fleet_result()
    units = tuple(Unit(k, f"A{k}", Path(f"A{k}")) for k in range(10))
    recorded = replace(result.study, units=units)
    other = page_html(fleet_page(replace(result, study=recorded)))
    assert ">true</th>" in html
    assert ">true</th>" not in other
    assert "10 recorded tactical MEMS" in other
