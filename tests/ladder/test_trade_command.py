import json
import sys

import pytest

from imubayes.cli import main

STUDY = """
[study]
title = "small tumble"
seed = 1

[[sensor]]
id = "ACC-1"
kind = "accelerometer"
class = "mems_tactical"
[sensor.library]
powers = 2
asymmetry = -1
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 8, planes = 2, dwell = "4 s", rate = "5 Hz" }
"""


def _call(monkeypatch, *arguments: str) -> object:
    monkeypatch.setattr(sys, "argv", ["imubayes", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(STUDY)
    return path


@pytest.mark.slow
def test_the_command_writes_a_report_of_processes_of_their_own(study, tmp_path, monkeypatch, capsys):
    options = (
        "--rungs",
        "means,plug-in",
        "--repeats",
        "6",
        "--limit",
        "10 min",
        "--out",
        str(tmp_path / "out"),
    )
    assert _call(monkeypatch, "trade", str(study), *options) == 0
    values = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [one["rung"] for one in values["rungs"]] == ["means", "plug-in"]
    assert [one["repeats"] for one in values["scores"]] == [6, 6]
    assert "Take " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--rungs", "means,best"), "rung 'best' is not known"),
        (("--limit", "5 kg"), "--limit"),
        (("--only", "ACC-2"), "did you mean 'ACC-1'?"),
        (("--repeats", "-1"), "-1 repeats"),
    ],
)
def test_what_cannot_be_traded_is_said_and_nothing_is_written(
    study, tmp_path, monkeypatch, capsys, options, said
):
    out = tmp_path / "out"
    assert _call(monkeypatch, "trade", str(study), "--out", str(out), *options) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()
