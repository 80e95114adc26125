import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_readings import wrong_fleet
from rich.console import Console

from imubayes.campaign.study import SensorSpec
from imubayes.inference.intervals import Share
from imubayes.population.fleet import FleetAnswer, FleetResult, Pull
from imubayes.population.parts import FleetStudy, recorded_units, simulated_units
from imubayes.population.records import Broken
from imubayes.population.terms import PopulationTerm
from imubayes.reporting.fleet_page import fleet_page, terminal_fleet, write_fleet
from imubayes.reporting.fleet_words import NAMED, fleet_answer, standing_out
from imubayes.reporting.html import page_html
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import library

BROKEN = Broken(7, "A<8>", "A8/tumble.csv, line 3: is no number")


def _result(**options) -> FleetResult:
    """Ten units: bias and scale needed, the rest open; one unit could not be read."""
    entry, lib = (
        sensor("mems_tactical", kind="accelerometer"),
        library("accelerometer", powers=1, asymmetry=-1),
    )
    p = len(lib.terms)
    study = FleetStudy(
        title="Ten <b>units</b>",
        seed=3,
        spec=SensorSpec("fleet", "accelerometer", entry, lib, (), {}),
        sensor_class=entry,
        units=simulated_units("mems_tactical", 10),
        part=8,
        processes=2,
        path=Path("fleet.toml"),
        text="[fleet]",
    )
    counts = np.zeros((6, p), dtype=np.int64)
    counts[0, :2], counts[3, 2:] = 9, 9
    answer = FleetAnswer(
        units=9,
        samples=1234,
        terms=tuple(_term(name, needed=j < 2) for j, name in enumerate(lib.names)),
        counts=counts,
        order=Share(2.0, 2.0, 2.0),
        noise=(Share(6e-4, 5e-4, 7e-4), Share(3e-4, 2e-4, 4e-4), Share(3e-6, 2e-6, 4e-6)),
        worst=(_pull(1, 8.0), _pull(2, -6.0), _pull(3, 2.0)),
        outliers=2,
        limit=4.1,
        broken=(BROKEN,),
    )
    return FleetResult(study, replace(answer, **options), "2 processes of this machine", 0, 12.0)


def _term(name: str, *, needed: bool) -> PopulationTerm:
    share = Share(1.0, 0.8, 1.0) if needed else Share(0.0, 0.0, 0.2)
    mean, spread = Share(1e-4, 5e-5, 2e-4), Share(3e-4, 2e-4, 5e-4)
    return PopulationTerm(name, share, 0.0 if needed else 1.0, mean, spread, 1.1e-4, 2.9e-4)


def _pull(k: int, pull: float) -> Pull:
    return Pull(f"u{k}", "b0" if k % 2 else "N", 1e-3 * k, pull, abs(pull) > 4.1)


@pytest.fixture(scope="module")
def html() -> str:
    return page_html(fleet_page(_result()))


def test_names_of_the_study_and_its_files_are_escaped(html):
    assert "<b>units" not in html
    assert "A&lt;8&gt;" in html


def test_page_opens_offline_needs_no_script_and_its_links_lead_somewhere(html):
    assert "http" not in html
    assert "<script" not in html
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(set(ids)) == len(ids)
    assert set(re.findall(r'href="#([^"]+)"', html)) <= set(ids)


def test_answer_counts_terms_names_units_that_stand_out_and_those_that_are_broken():
    first, needed, untold, out, broken = fleet_answer(_result())
    assert first == (
        "9 tactical MEMS accelerometers: the median unit needs 2 of 15 terms (90 % of the units: 2 to 2)."
    )
    assert needed == "Needed in half of the units or more: b0, b1."
    assert untold.startswith("The test leaves open in half of the units or more: m_j, m_k,")
    # 1e-3 m/s^2 are 102 ug; N of 2e-3 m/s^2/sqrt(Hz) is 204 ug/sqrt(Hz)
    assert out.startswith("2 units stand out from the population (beyond 4.1 sd")
    assert out.endswith("u1 in b0 (+8.0 sd, 100 µg), u2 in N (−6.0 sd, 200 µg/√Hz).")
    assert broken == "1 unit of 10 could not be read: A<8>: A8/tumble.csv, line 3: is no number."


def test_fleet_without_outliers_says_how_far_the_farthest_is():
    calm = _result(outliers=0, worst=(_pull(1, 2.5),))
    assert standing_out(calm).startswith("No unit stands out")
    assert "+2.5 sd" in standing_out(calm)


def test_many_outliers_are_counted_after_a_few():
    many = _result(outliers=9, worst=tuple(_pull(k, 9.0) for k in range(9)))
    assert standing_out(many).endswith(f"and {9 - NAMED} more.")


def test_recorded_units_have_no_column_of_the_truth(html):
    result = _result()
    names = [f"A{k}" for k in range(10)]
    recorded = replace(result.study, units=recorded_units(names, [Path(name) for name in names]))
    other = page_html(fleet_page(replace(result, study=recorded)))
    assert ">true</th>" in html
    assert ">true</th>" not in other
    assert "10 recorded tactical MEMS" in other


def test_units_that_are_all_read_need_no_section_of_broken_ones(html):
    assert '<h2 id="broken">' in html
    assert 'id="broken"' not in page_html(fleet_page(_result(broken=())))


def test_numbers_lie_beside_the_page_and_the_terminal_has_a_line_a_term(tmp_path):
    result = _result()
    assert [file.name for file in write_fleet(result, tmp_path)] == ["report.html", "result.json"]
    found = json.loads((tmp_path / "result.json").read_text())
    assert (found["fleet"]["units"], found["fleet"]["read"]) == (10, 9)
    assert found["fleet"]["broken"] == [{"number": 7, "name": "A<8>", "error": BROKEN.error}]
    assert found["fleet"]["terms"][0]["verdicts"]["needed"] == 9
    assert found["fleet"]["terms"][0]["mean"] == {"value": 1e-4, "low": 5e-5, "high": 2e-4}
    console = Console(width=80)
    with console.capture() as lines:
        console.print(terminal_fleet(result))
    table = [line for line in lines.get().splitlines() if re.match(r"(b0|b1|[mcSs]_[ijk]+) ", line)]
    assert len(table) == 15
    assert all(len(line) <= 80 for line in table)


def test_every_number_of_the_page_is_one_of_the_result(tmp_path):
    page, values = write_fleet(_result(), tmp_path)
    assert wrong_fleet(page.read_text("utf-8"), json.loads(values.read_text("utf-8"))) == []
