"""Each study about the tool runs by its one command, small, and says how it was made."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STUDIES = sorted(path.parent.name for path in (ROOT / "studies").glob("*/__main__.py"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _run(name: str, *options: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"studies.{name}", *options]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, env=os.environ)


@pytest.mark.parametrize("name", STUDIES)
def test_small_study_runs_by_its_command_and_writes_its_report(name, tmp_path):
    done = _run(name, "--small", "--seed", "5", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    files = re.findall(r"[\w.]+$|(?<=/)[\w.]+(?=,)", done.stdout.strip().splitlines()[-1])
    assert sorted(files) == sorted(path.name for path in (tmp_path / "out").iterdir())
    command = f"python -m studies.{name} --small --seed 5"
    assert any(command in path.read_text(encoding="utf-8") for path in (tmp_path / "out").iterdir())


@pytest.mark.parametrize("name", STUDIES)
def test_readme_and_the_committed_report_state_the_command(name):
    command = f"python -m studies.{name}"
    assert f"`{command}`" in README
    report = ROOT / "reports" / name
    assert any(command in path.read_text(encoding="utf-8") for path in report.iterdir())


def test_folder_that_is_a_file_is_refused_before_anything_is_measured(tmp_path):
    (tmp_path / "out").write_text("")
    done = _run("speed", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "is a file: expected a folder for --out" in " ".join(done.stderr.split())
