"""What every command says on the terminal, on small studies, held to the letter."""

import contextlib
import json
import re
from pathlib import Path

import pytest
from plan_studies import SMALL

import imubayes
from imubayes.cli import app

SENSOR = """
[study]
title = "small tumble"
seed = {seed}
method = "exact"
[decision]
compare = false
[[sensor]]
id = "ACC-1"
kind = "accelerometer"
class = "mems_tactical"
library = {{ powers = 2, asymmetry = -1 }}
truth = {{ b0 = "{bias}", b1 = "300 ppm", b2 = "300 ug/g^2", m_j = "900 urad" }}
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = {{ angles = 12, dwell = "10 s", rate = "2 Hz" }}
"""

LOTS = """
[study]
title = "Which terms does a vibrating beam need?"
seed = 2
[lots]
kind = "accelerometer"
classes = ["mems_tactical", "vba_quartz"]
units = 4
processes = 1
library = { powers = 2, asymmetry = -1 }
[[lots.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 12, dwell = "10 s", rate = "2 Hz" }
[[scene]]
name = "helicopter"
duration = "1 min"
budget = { velocity = "1 m/s" }
"""

FLEET = """
[study]
title = "five units"
seed = 4
[fleet]
kind = "accelerometer"
class = "mems_tactical"
units = 5
processes = 1
library = { powers = 1, asymmetry = -1 }
[[fleet.run]]
name = "tumble"
procedure = "tumble"
simulate = { angles = 6, planes = 1, dwell = "4 s", rate = "1 Hz" }
"""

STUDIES = {
    "a": SENSOR.format(seed=1, bias="1 mg"),
    "b": SENSOR.format(seed=2, bias="11 mg"),
    "c": SENSOR.format(seed=3, bias="1 mg"),
    "lots": LOTS,
    "fleet": FLEET,
    "plan": SMALL.replace("planes = 2", "planes = 1"),
}

COMMANDS = {
    "run": "run a.toml --out a",
    "run_other_unit": "run b.toml --out b",
    "run_other_session": "run c.toml",
    "run_lots": "run lots.toml --out lots",
    "run_fleet": "run fleet.toml --out fleet",
    "check": "check a.toml",
    "simulate": "simulate a.toml --out files",
    "run_files": "run files/a.toml --out again",
    "plan": "plan plan.toml --out plan",
    "compare": "compare a reports/c b --out difference",
    "compare_session": "compare a reports/c/result.json",
    "compare_unit_and_lot": "compare b lots --out typical",
    "compare_one": "compare a",
    "compare_nothing": "compare a none --out nothing",
    "compare_a_study": "compare a a.toml --out nothing",
    "export": "export a --to c --out exported",
    "export_no_result": "export empty.json --to json --out nothing",
    "catalogue": "catalogue",
    "catalogue_class": "catalogue mems_tactical --kind accelerometer",
    "catalogue_no_class": "catalogue fog_tactica",
    "version": "--version",
}
"""By the file of its words; each may read what those before it wrote."""

REFUSED = ("compare_one", "compare_nothing", "compare_a_study", "export_no_result", "catalogue_no_class")

MASKS = {
    r"(?<=of this machine, )\d+ s": "* s",
    r"(?<=weighed in )\d[\d.]* s": "* s",  # it took
    r"^Usage: .*imubayes": "Usage: imubayes",  # as it was called
    r"<[^>]*>": "<...>",  # typer names types otherwise from version to version
}
"""What differs from run to run, by what stands for it."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where every command is run."""
    return tmp_path_factory.mktemp("terminal")


@pytest.fixture(scope="module")
def said(command, folder) -> dict[str, str]:
    """What every command said, and its exit code."""
    found = {}
    with contextlib.chdir(folder):
        for name, text in STUDIES.items():
            Path(f"{name}.toml").write_text(text, encoding="utf-8")
        Path("empty.json").write_text("{}")
        for name, line in COMMANDS.items():
            code, out, err = command(*line.split())
            found[name] = f"$ imubayes {line}\n{out}{err}exit {code}\n"
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_command_says_what_it_said(name, said, golden):
    golden(f"terminal/{name}.txt", _masked(said[name]))


def test_version_is_the_packages(said):
    assert f"\nimubayes {imubayes.__version__}\n" in said["version"]


def test_other_unit_differs_where_its_truth_does_and_is_not_typical_of_its_class(said, folder):
    """A bias of 11 mg beside one of 1 mg, in a lot with biases of 1 mg or so."""
    (component,) = json.loads((folder / "difference" / "result.json").read_text())["components"]
    assert [term["name"] for term in component["terms"] if term["differs"]] == ["b0"]
    (unit,) = json.loads((folder / "typical" / "result.json").read_text())["units"]
    assert not unit["typical"]
    assert "Nothing differs beyond uncertainty" in " ".join(said["compare_session"].split())


def test_simulated_files_give_the_result_of_the_simulated_study(said, folder):
    # the samples are equal to the last bit; their interval is a median of rounded differences, which moves
    # the noise within the tolerance at which its estimate stops
    simulated, recorded = (
        json.loads((folder / name / "result.json").read_text())["sensors"][0]["terms"]
        for name in ("a", "again")
    )
    for one, other in zip(simulated, recorded, strict=True):
        assert other["full_mean"] == pytest.approx(one["full_mean"], abs=1e-4 * one["full_sd"])
        assert other["verdict"] == one["verdict"]


def test_what_is_refused_is_said_in_one_line_and_leaves_nothing(said, folder):
    for name in REFUSED:
        _, sentence, code = said[name].splitlines()
        assert sentence.startswith("imubayes: ") and code == "exit 2"
    assert not (folder / "nothing").exists()


@pytest.mark.parametrize("name", ["", *sorted(entry.name for entry in app.registered_commands)])
def test_help_says_what_it_said(name, command, golden):
    code, out, err = command(*([name] if name else []), "--help")
    assert (code, err) == (0, "")
    golden(f"terminal/help{'_' * bool(name)}{name}.txt", _masked(out))


def _masked(text: str) -> str:
    # what a slow machine says beside
    text = re.sub(r"^imubayes: (?:after \d|if \S+ takes too long).*\n", "", text, flags=re.M)
    for pattern, sign in MASKS.items():
        text = re.sub(pattern, sign, text, flags=re.M)
    return text
