"""Each study about the tool runs by its one command, small, and its laws hold there."""

from __future__ import annotations

import json
import runpy
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from markupsafe import escape

from studies import command
from studies.decision_quality.trials import MODELLED, OPTIONS, QualityStudy
from studies.decision_quality.trials import SMALL as FEW_TRIALS
from studies.speed.contests import SMALL

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _timed(result: Any) -> bool:
    asked = [(subject, size) for subject, sizes in SMALL.contests.items() for size in sizes]
    contests = [(one["subject"], one["size"]) for one in result["contests"]]
    return contests == asked and {one["of"] for one in result["growth"]} == set(SMALL.growth)


LAWS: dict[str, Callable[[Any], bool]] = {
    "decision_quality": lambda r: [one["treatment"] for one in r["treated"]] == [MODELLED],
    "extremes": lambda r: not any(one["silent"] or one["lost"] for one in r["cases"]),
    "ranks": lambda r: all(one["p_value"] > 0.001 for one in r["quantities"]),
    "speed": _timed,
}
"""What the result of each small study shows."""

FEWER = {"decision_quality": ("--treatments", MODELLED)}
"""Options of a small study of which `trials` are tested in full elsewhere."""


def test_every_study_about_the_tool_is_tested():
    assert LAWS.keys() == {path.parent.name for path in (ROOT / "studies").glob("*/__main__.py")}


@pytest.mark.parametrize("name", LAWS)
def test_small_study_runs_by_its_command_and_its_law_holds(name, tmp_path, monkeypatch):
    fewer = FEWER.get(name, ())
    monkeypatch.setattr(sys, "argv", [name, "--small", "--seed", "5", *fewer, "--out", str(tmp_path / "out")])
    monkeypatch.delitem(sys.modules, f"studies.{name}.__main__", raising=False)  # of another test
    runpy.run_module(f"studies.{name}", run_name="__main__")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written - {"slide.svg", "slide.png"} == {"report.html", "result.json"}
    page, result = (tmp_path / "out" / name for name in ("report.html", "result.json"))
    said = escape(shlex.join(["python", "-m", f"studies.{name}", "--small", "--seed", "5", *fewer]))
    assert f"<pre>{said}</pre>" in page.read_text(encoding="utf-8")
    assert LAWS[name](json.loads(result.read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", LAWS)
def test_readme_and_the_committed_report_state_the_command(name):
    command = f"python -m studies.{name}"
    assert f"`{command}`" in README
    report = ROOT / "reports" / name / "report.html"
    assert f"<pre>{command}</pre>" in report.read_text(encoding="utf-8")


def test_options_that_differ_are_settings_and_are_repeated_in_the_command(monkeypatch):
    given = ["--small", "--sensors", "3", "--treatments", "dead band", "coarse steps", "--resamples", "2"]
    monkeypatch.setattr(sys, "argv", ["x", *given])
    study, _ = command._asked(QualityStudy(), FEW_TRIALS, OPTIONS)
    assert (study.sensors, study.treatments) == (3, ("dead band", "coarse steps"))
    assert study.misspecified == FEW_TRIALS.misspecified
    own = "python -m studies.decision_quality --small"
    assert study.command == f"{own} --sensors 3 --treatments 'dead band' 'coarse steps'"


def test_folder_that_is_a_file_is_refused_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    (tmp_path / "out").write_text("")
    monkeypatch.setattr(sys, "argv", ["x", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as stop:
        command.main(QualityStudy(), FEW_TRIALS, pytest.fail, pytest.fail, pytest.fail)
    assert stop.value.code == 2
    assert "is a file: expected a folder for --out" in " ".join(capsys.readouterr().err.split())
