"""The pages of the documentation do what they say."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import get_args

import pytest

from imubayes.rig.recordings import Procedure
from imubayes.sensors.terms import library
from imubayes.study.schema import read

DOCS = Path(__file__).parents[1] / "docs"
TUTORIAL = DOCS / "tutorial.md"
HOW_TO = sorted(DOCS.glob("howto/*.md"))

STEP = re.compile(r"```(console|toml)\n(.*?)```\n", re.S)
BY_CHANCE = re.compile(r"\d[\d.,]* (?:s|ms)\b|\de1\d")
"""Times, and the inflation of what is collinear but for rounding."""


def _followed(command, folder: Path) -> str:
    """The tutorial as it reads when somebody follows it in a folder."""

    def done(step: re.Match[str]) -> str:
        kind, text = step.groups()
        if kind == "toml":
            (folder / "acc.toml").write_text(text, encoding="utf-8")
            return step[0]
        line = text.splitlines()[0]
        ended = command(*line.removeprefix("$ imubayes ").split())
        assert ended.code == 0, ended.err
        printed = "\n".join(one.rstrip() for one in ended.out.strip("\n").splitlines())
        return f"```console\n{line}\n{printed}\n```\n"

    return STEP.sub(done, TUTORIAL.read_text(encoding="utf-8"))


def test_the_tutorial_prints_what_it_says(command, tmp_path, monkeypatch, request):
    shutil.copy(DOCS / "tutorial" / "tumble.csv", tmp_path)
    monkeypatch.chdir(tmp_path)
    page = _followed(command, tmp_path)
    if request.config.getoption("--renew"):
        TUTORIAL.write_text(page, encoding="utf-8")
    assert BY_CHANCE.sub("", page) == BY_CHANCE.sub("", TUTORIAL.read_text(encoding="utf-8"))
    assert (tmp_path / "flight" / "acc_12_compensation.c").exists()


@pytest.mark.parametrize("page", HOW_TO, ids=lambda page: page.stem)
def test_the_study_of_a_how_to_is_one(page, command, tmp_path, monkeypatch, request):
    (block,) = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    if "$IMUBAYES_DATA" in block:
        monkeypatch.setenv("IMUBAYES_DATA", str(request.getfixturevalue("recordings")))
    study = tmp_path / "study.toml"
    study.write_text(block, encoding="utf-8")
    kind, _ = read(study)
    if kind == "sensor":
        checked = command("check", study)
        assert checked.code == 0, checked.err
        assert "excited" in checked.out


def test_the_page_of_standards_names_procedures_and_terms_that_there_are():
    rows = [
        line.strip("|").split("|") for line in (DOCS / "standards.md").read_text().splitlines() if "|" in line
    ]
    known = {*get_args(Procedure), "positions"}
    asked = {"powers": 4, "asymmetry": 2, "set": "extended"}
    terms = {name for kind in ("accelerometer", "gyroscope") for name in library(kind, **asked).names}
    terms |= {"b0*T", "b1*T", "b0*dT", "T", "dT", "gT", "S"}
    for row in rows:
        codes = [set(re.findall(r"`([^`]+)`", cell)) for cell in row]
        if len(row) == 4 and codes[2]:
            assert codes[2] <= known and codes[3] <= terms, row
        if len(row) == 5 and codes[3]:
            assert codes[1] <= terms and codes[3] <= known, row
