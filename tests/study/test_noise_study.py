"""Noise processes of a whole IMU through a study: each component at rest, by its own prior and units."""

import json

import numpy as np
import pytest
from grounds import Grounds, explained
from page_reading import report_html, sentences, tree
from report_answers import wrong_sensors
from run_files import csv_of

from imubayes.reporting.results import result_json
from imubayes.study.method import run

DT, REST, TURNING, G = 0.01, 400, 100, 9.81
UP = ("x", "-x", "y", "-y", "z", "-z")
NAMES = ("ax", "ay", "az", "gx", "gy", "gz")
N = dict(zip(NAMES, (1e-3, 2e-3, 3e-3, 1e-4, 2e-4, 3e-4), strict=True))
"""White noise, m/s^2/sqrt(Hz) and rad/s/sqrt(Hz)."""

STUDY = """
[noise]
identify = "all"
candidates = ["Q"]
[decision]
compare = false
[study]
method = "exact"
[[sensor]]
id = "imu"
kind = "imu"
class = "mems_consumer"
library.accelerometer = {{ powers = 1, asymmetry = -1 }}
library.gyroscope = {{ powers = 1, asymmetry = -1 }}
[[sensor.run]]
name = "bench"
procedure = "ferraris"
file = "bench.csv"
gravity = "{g} m/s^2"
sections = [{sections}]
"""


def axis(up):
    return np.eye(3)["xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Six positions and three turns, white noise alone."""
    folder = tmp_path_factory.mktemp("bench")
    rng = np.random.default_rng(1)
    force, rate, sections, n = [], [], [], 0
    for up, angle in [*((up, 0.0) for up in UP), *((up, -360.0) for up in "xyz")]:
        count = TURNING if angle else REST
        force.append(np.tile(G * axis(up), (count, 1)))
        rate.append(np.tile(np.deg2rad(angle) / (count * DT) * axis(up), (count, 1)))
        turn = f', turn = "{angle} deg"' if angle else ""
        sections.append(f'{{ rows = [{n}, {n + count}], up = "{up}"{turn} }}')
        n += count
    said = np.hstack((np.concatenate(force), np.concatenate(rate)))
    said += rng.normal(size=(n, 6)) * np.array([N[name] for name in NAMES]) / np.sqrt(DT)
    units = ("m/s^2",) * 3 + ("rad/s",) * 3
    header = ",".join(["t [s]", *(f"{name} [{unit}]" for name, unit in zip(NAMES, units, strict=True))])
    table = np.column_stack((DT * np.arange(n), said))
    csv_of(folder, header, table, "bench.csv")
    path = folder / "study.toml"
    path.write_text(STUDY.format(g=G, sections=", ".join(sections)))
    return run(path)


def test_white_noise_of_each_component_is_found_and_its_quantization_is_not(result):
    for sensor in result.sensors:
        (found,) = sensor.processes
        name = sensor.id.removeprefix("imu.")
        size = found.size("N")
        assert found.run == f"bench ({name} at rest)"
        assert abs(size.mean - N[name]) < 4.0 * size.sd < 0.4 * N[name]
        assert found.identified == ()


@pytest.fixture(scope="module")
def page(result):
    return report_html(result)


def test_page_says_the_noise_of_each_component_in_words_and_in_one_table(page):
    for name in NAMES:
        told = f"<strong>Noise of imu.{name}, bench ({name} at rest).</strong> The run shows white noise N ="
        assert page.count(told) == 1
    table = page.split('aria-label="Noise processes by component"')[1].split("</table>")[0]
    assert table.count("°/√h") == table.count("µg/√Hz") == 3
    assert table.count("bench (gz at rest)") == 1


LOG = """
[study]
method = "exact"
[decision]
compare = false
[noise]
identify = "static"
candidates = ["Q"]
[[sensor]]
id = "log"
kind = "accelerometer"
class = "mems_consumer"
library = { powers = 1, asymmetry = -1 }
[[sensor.run]]
name = "quiet"
procedure = "static"
simulate = { duration = "5 min", rate = "10 Hz" }
"""


def test_a_study_of_noise_says_the_noise_first_with_one_value_each_and_then_what_a_log_tells_of_terms(
    tmp_path,
):
    path = tmp_path / "study.toml"
    path.write_text(LOG)
    page = report_html(run(path))
    first, _, rest = page.partition("<h2")
    assert "log shows white noise N =" in first and "terms are needed" not in first
    assert rest.index("The run shows white noise N =") < rest.index("terms are needed")
    assert 'aria-label="Noise of log"' not in page and 'aria-label="Noise processes of quiet"' in page
    assert "a run with the case turned over" in page and "a centrifuge run" not in page


def test_numbers_and_answers_of_a_report_on_a_whole_imu_and_its_noise_are_those_of_its_result(result, page):
    told = json.loads(result_json(result))
    assert explained(page, Grounds(told)) > 0.7
    assert [*wrong_sensors(sentences(tree(page)), told)] == []
