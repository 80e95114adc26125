"""`imubayes compare` as a person meets it."""

import json
import sys

import pytest

from imubayes.cli import main
from imubayes.population.lots import measure
from imubayes.reporting.document import write_results
from imubayes.reporting.lots_results import lots_json
from imubayes.study.method import run
from imubayes.study.schema import read, read_study

STUDY = """
[study]
title = "unit {truth}"
seed = {seed}
method = "exact"
[decision]
compare = false
[[sensor]]
id = "ACC"
kind = "accelerometer"
class = "mems_tactical"
library = {{ powers = 2, asymmetry = -1 }}
truth = {{ b0 = "{truth}", b2 = "300 ug/g^2" }}
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = {{ angles = 12, dwell = "10 s", rate = "2 Hz" }}
"""
LOT = """
[study]
seed = 2
[lots]
kind = "accelerometer"
classes = ["mems_tactical"]
units = 4
processes = 1
library = { powers = 2, asymmetry = -1 }
[[lots.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, dwell = "10 s", rate = "2 Hz" }
"""


def _call(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["imubayes", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two sessions of one unit, and a unit whose bias is 10 mg off: some hundred sd."""
    base = tmp_path_factory.mktemp("compared")
    for name, seed, truth in (("first", 1, "1 mg"), ("second", 2, "1 mg"), ("other", 3, "11 mg")):
        (base / f"{name}.toml").write_text(STUDY.format(seed=seed, truth=truth))
        write_results(run(read_study(base / f"{name}.toml")), base / name)
    return base


def test_sessions_of_one_unit_agree(folders, monkeypatch, capsys):
    assert _call(monkeypatch, "compare", folders / "first", folders / "second" / "result.json") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Nothing differs beyond uncertainty" in printed


def test_other_unit_differs_where_its_truth_does(folders, monkeypatch, capsys, tmp_path):
    out = tmp_path / "difference"
    paths = [folders / name for name in ("first", "second", "other")]
    assert _call(monkeypatch, "compare", *paths, "--out", out) == 0
    printed = capsys.readouterr().out
    assert all(len(line) <= 80 for line in printed.splitlines() if "/" not in line)
    assert "written: " in printed
    (component,) = json.loads((out / "result.json").read_text())["components"]
    assert [term["name"] for term in component["terms"] if term["differs"]] == ["b0"]
    assert (out / "report.html").stat().st_size > 0


@pytest.mark.parametrize("name", ["none", "second.toml"])
def test_file_that_is_no_result_exits_with_two_and_writes_nothing(
    name, folders, monkeypatch, capsys, tmp_path
):
    out = tmp_path / "difference"
    assert _call(monkeypatch, "compare", folders / "first", folders / name, "--out", out) == 2
    said = capsys.readouterr()
    assert name in said.err and said.err.count("\n") == 1 and not said.out
    assert not list(tmp_path.iterdir())


def test_unit_is_held_against_the_lot_of_its_class(folders, monkeypatch, capsys, tmp_path):
    """The unit whose bias is 11 mg, against a lot with biases of 1 mg or so."""
    out = tmp_path / "class"
    (tmp_path / "lot.toml").write_text(LOT)
    (tmp_path / "lot.json").write_text(lots_json(measure(read(tmp_path / "lot.toml")[1])))
    assert _call(monkeypatch, "compare", folders / "other", tmp_path / "lot.json", "--out", out) == 0
    assert "ACC is not typical of the lot of class mems_tactical: b0" in " ".join(
        capsys.readouterr().out.split()
    )
    (unit,) = json.loads((out / "result.json").read_text())["units"]
    assert not unit["typical"] and (out / "report.html").stat().st_size > 0


def test_one_result_alone_is_refused(folders, monkeypatch, capsys):
    assert _call(monkeypatch, "compare", folders / "first") == 2
    assert "2 to 26 results" in capsys.readouterr().err
