"""Fleets on the command line."""

import json
import sys

import pytest
from fleet_studies import recorded

from imubayes.cli import main

SMALL = """
[study]
seed = 4
[fleet]
kind = "accelerometer"
class = "mems_tactical"
units = 5
processes = 1
[fleet.library]
powers = 1
asymmetry = -1
[[fleet.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 6, planes = 1, dwell = "4 s", rate = "1 Hz" }
"""


def _run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    monkeypatch.setattr(sys, "argv", ["imubayes", "run", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


def test_one_unit_that_cannot_be_read_is_named_and_the_exit_code_is_0(tmp_path, monkeypatch, capsys):
    study = recorded(tmp_path)
    (tmp_path / "units" / "A2" / "tumble.csv").write_text("t [s],output [m/s^2]\n0,rubbish\n")
    study.path.write_text(study.text.replace("part = 3", "part = 3\nprocesses = 1"))
    out = tmp_path / "out"
    assert _run(monkeypatch, str(study.path), "--out", str(out)) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "1 unit of 5 could not be read: A2: " in shown
    assert shown.endswith("report.html, result.json")
    (broken,) = json.loads((out / "result.json").read_text())["fleet"]["broken"]
    assert (broken["name"], "A2/tumble.csv" in broken["error"]) == ("A2", True)
    assert sorted(file.name for file in out.iterdir()) == ["report.html", "result.json", "units"]


def test_resume_keeps_what_is_finished(tmp_path, monkeypatch, capsys):
    path, out = tmp_path / "fleet.toml", tmp_path / "out"
    path.write_text(SMALL)
    assert _run(monkeypatch, str(path), "--out", str(out)) == 0
    (part,) = (out / "units").iterdir()
    before = part.stat().st_mtime_ns
    capsys.readouterr()
    assert _run(monkeypatch, str(path), "--out", str(out), "--resume", "--scheduler", "local") == 0
    assert "5 units were there already" in " ".join(capsys.readouterr().out.split())
    assert part.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--ess", "100"), "a fleet's is exact: leave them out"),
        (("--scheduler", ""), "--scheduler: came an empty text: expected an address such as tcp://"),
        (("--scheduler", "nonsense"), "--scheduler nonsense: no dask scheduler answers there"),
    ],
)
def test_option_that_cannot_be_is_refused_before_anything_is_written(
    tmp_path, monkeypatch, capsys, option, message
):
    path, out = tmp_path / "fleet.toml", tmp_path / "out"
    path.write_text(SMALL)
    assert _run(monkeypatch, str(path), "--out", str(out), *option) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_interrupt_is_said_in_one_line_and_resume_goes_on(tmp_path, monkeypatch, capsys):
    path, out, done = tmp_path / "fleet.toml", tmp_path / "out", list[int]()
    path.write_text(SMALL.replace("units = 5", "units = 5\npart = 2"))

    def once(total, things, progress):
        def stop(units: int) -> None:
            done.append(units)
            if len(done) == 1:
                raise KeyboardInterrupt

        return stop

    monkeypatch.setattr("imubayes.population.fleet.pace", once)
    assert _run(monkeypatch, str(path), "--out", str(out)) == 130
    assert capsys.readouterr().err == (
        "imubayes: interrupted: the same command with --resume goes on, and keeps what is finished\n"
    )
    assert [file.name for file in out.iterdir()] == ["units.part"]
    assert _run(monkeypatch, str(path), "--out", str(out), "--resume") == 0
    assert "2 units were there already" in " ".join(capsys.readouterr().out.split())
    assert sorted(file.name for file in out.iterdir()) == ["report.html", "result.json", "units"]


def test_recordings_where_the_results_would_be_are_refused_and_stay(tmp_path, monkeypatch, capsys):
    study = recorded(tmp_path, ("A1", "A2"))
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    assert _run(monkeypatch, str(study.path), "--out", str(tmp_path)) == 2
    assert "A1: is a unit of this study" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def test_scheduler_of_a_study_without_a_fleet_is_refused(tmp_path, monkeypatch, capsys):
    path = tmp_path / "small.toml"
    run = '[[sensor.run]]\nname = "a"\nprocedure = "tumble"\nsimulate = { angles = 4 }\n'
    path.write_text(f'[[sensor]]\nid = "A"\nkind = "accelerometer"\nclass = "mems_tactical"\n{run}')
    assert _run(monkeypatch, str(path), "--scheduler", "tcp://127.0.0.1:8786") == 2
    assert "the units of a [fleet], which this study has none of" in capsys.readouterr().err
