"""The command line as a person meets it."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import imubayes
from imubayes.campaign.study import Sampling, Study
from imubayes.cli import Method, main
from imubayes.errors import ConvergenceError, InputError
from imubayes.sensors.catalogue import classes
from imubayes.sensors.terms import library
from imubayes.study.schema.tables import HeaderTable

HEAVY = {
    *("arviz", "celerite2", "h5py", "jinja2", "matplotlib", "numba", "numpy", "pint"),
    *("pyarrow", "pydantic", "rich", "scipy", "xarray"),
}

STUDY = """
[study]
title = "small tumble"
seed = 1
method = "exact"

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


def _call(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    monkeypatch.setattr(sys, "argv", ["imubayes", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


@pytest.fixture
def study(tmp_path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(STUDY)
    return path


def test_help_imports_nothing_heavy():
    script = f"import sys, imubayes.cli; print(*({HEAVY!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.benchmark
def test_help_answers_in_half_a_second():
    command = [sys.executable, "-c", "from imubayes.cli import main; main()", "--help"]
    start = time.perf_counter()
    subprocess.run(command, capture_output=True, check=True)
    assert time.perf_counter() - start < 0.5


def test_help_lists_the_commands(monkeypatch, capsys):
    assert _call(monkeypatch, "--help") == 0
    listed = capsys.readouterr().out
    assert all(
        f"\n  {command} " in listed for command in ("run", "check", "simulate", "catalogue", "compare")
    )


def test_version_is_the_packages(monkeypatch, capsys):
    assert _call(monkeypatch, "--version") == 0
    assert capsys.readouterr().out == f"imubayes {imubayes.__version__}\n"


def test_unknown_command_is_wrong_input(monkeypatch, capsys):
    assert _call(monkeypatch, "characterise") == 2
    assert "characterise" in capsys.readouterr().err


def test_run_writes_three_files_and_prints_every_term(study, tmp_path, monkeypatch, capsys):
    assert _call(monkeypatch, "run", str(study), "--out", str(tmp_path / "results")) == 0
    printed = capsys.readouterr()
    written = {path.name for path in (tmp_path / "results").iterdir()}
    assert written == {"report.html", "result.json", "posterior.nc"}
    result = json.loads((tmp_path / "results" / "result.json").read_text())
    names = [term["name"] for term in result["sensors"][0]["terms"]]
    assert names == list(library("accelerometer", powers=2, asymmetry=-1).names)
    assert all(name in printed.out for name in names)
    assert "written: " in printed.out
    assert printed.err == ""


def test_results_go_under_the_studys_name_by_default(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert _call(monkeypatch, "run", str(study)) == 0
    assert (tmp_path / "reports" / "small" / "result.json").exists()


def _sampling(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Sampling:
    """How the command line wants a study to be sampled."""
    came: list[Sampling] = []

    def caught(study: Study, **_: object) -> None:
        came.append(study.sampling)
        raise InputError("seen enough")

    monkeypatch.setattr("imubayes.study.method.run", caught)
    assert _call(monkeypatch, "run", *arguments) == 2
    (sampling,) = came
    return sampling


SAMPLED = STUDY.replace('"exact"\n', '"full"\n[sampling]\ness = 50\n')


def test_sampling_is_the_studys_where_the_command_line_is_silent(study, tmp_path, monkeypatch):
    study.write_text(SAMPLED)
    assert _sampling(monkeypatch, str(study), "--out", str(tmp_path)) == Sampling(
        "full", 50.0, 600.0, checkpoints=tmp_path / "chains", resume=False
    )


def test_command_line_wins_over_the_study(study, tmp_path, monkeypatch):
    study.write_text(SAMPLED)
    options = ("--method", "collapsed", "--time-limit", "5 min", "--ess", "300")
    assert _sampling(monkeypatch, str(study), "--out", str(tmp_path), *options) == Sampling(
        "collapsed", 300.0, 300.0, checkpoints=tmp_path / "chains", resume=False
    )


def test_chains_are_resumed_where_there_are_checkpoints(study, tmp_path, monkeypatch):
    (tmp_path / "chains").mkdir()
    (tmp_path / "chains" / "ACC-1.h5").touch()
    study.write_text(SAMPLED)
    sampling = _sampling(monkeypatch, str(study), "--out", str(tmp_path), "--resume")
    assert sampling == Sampling("full", 50.0, 600.0, checkpoints=tmp_path / "chains", resume=True)


def test_resumed_run_gives_the_result_of_the_run_that_it_resumes(study, tmp_path, monkeypatch):
    out = tmp_path / "results"
    asked = ("run", str(study), "--out", str(out), "--method", "collapsed", "--ess", "40")
    results = []
    for options in ((), ("--resume",)):
        assert _call(monkeypatch, *asked, *options) == 0
        assert [path.name for path in (out / "chains").iterdir()] == ["ACC-1.h5"]
        (sensor,) = json.loads((out / "result.json").read_text())["sensors"]
        results.append((sensor["method"], sensor["terms"]))
    assert results[0][0] == "collapsed"
    assert results[1] == results[0]


def test_methods_of_the_command_line_are_those_of_a_study():
    assert tuple(Method) == get_args(get_type_hints(HeaderTable)["method"])


def test_simulated_files_give_the_result_of_the_simulated_study(study, tmp_path, monkeypatch):
    assert _call(monkeypatch, "simulate", str(study), "--out", str(tmp_path / "files")) == 0
    assert {path.name for path in (tmp_path / "files").iterdir()} == {
        "tumble.csv",
        "truth.json",
        "small.toml",
    }
    terms = []
    for path in (study, tmp_path / "files" / "small.toml"):
        assert _call(monkeypatch, "run", str(path), "--out", str(tmp_path / "results")) == 0
        result = json.loads((tmp_path / "results" / "result.json").read_text())
        terms.append(result["sensors"][0]["terms"])
    # the samples are equal to the last bit; their interval is a median of rounded differences, which moves
    # the noise within the tolerance at which its estimate stops
    for simulated, recorded in zip(*terms, strict=True):
        assert recorded["full_mean"] == pytest.approx(simulated["full_mean"], abs=1e-4 * simulated["full_sd"])
        assert recorded["verdict"] == simulated["verdict"]


def test_check_names_what_a_tumble_cannot_tell(study, monkeypatch, capsys):
    assert _call(monkeypatch, "check", str(study)) == 0
    printed = capsys.readouterr().out
    assert "ACC-1" in printed
    assert all(name in printed for name in ("b0", "b2", "c_jj", "c_kk"))


def test_catalogue_lists_every_class(monkeypatch, capsys):
    assert _call(monkeypatch, "catalogue") == 0
    printed = capsys.readouterr().out
    assert all(entry.id in printed for entry in classes())


def test_catalogue_of_a_class_gives_every_terms_prior_in_printed_units(monkeypatch, capsys):
    assert _call(monkeypatch, "catalogue", "mems_tactical", "--kind", "accelerometer") == 0
    printed = capsys.readouterr().out
    lines = {line.split()[0]: line.split() for line in printed.splitlines() if line.strip()}
    assert set(library("accelerometer", set="extended").names) <= set(lines)
    assert lines["b2"][1:4] == ["K2", "30", "ug/g^2"]
    assert lines["N"][2:4] == ["60", "ug/sqrt(Hz)"]


def test_catalogue_holds_the_classes_of_a_file_of_ones_own(tmp_path, monkeypatch, capsys):
    own = tmp_path / "own.toml"
    own.write_text('[gyroscope.mine]\nlike = "mems_tactical"\ngrade = "screened"\n')
    assert _call(monkeypatch, "catalogue", "mine", "--own", str(own)) == 0
    assert "screened" in capsys.readouterr().out
    assert _call(monkeypatch, "catalogue", "--own", str(tmp_path / "none.toml")) == 2
    assert "none.toml" in capsys.readouterr().err


def test_catalogue_suggests_the_class_that_was_meant(monkeypatch, capsys):
    assert _call(monkeypatch, "catalogue", "fog_tactica") == 2
    assert capsys.readouterr().err == (
        "imubayes: class 'fog_tactica' is not in the catalogue: did you mean 'fog_tactical'?\n"
    )


LOTS = """
[lots]
kind = "gyroscope"
classes = ["mems_tactical", "fog_tactical"]
units = 2
processes = 1
library = { powers = 1, asymmetry = -1 }
[[lots.run]]
name = "steps"
procedure = "rate-table"
simulate = { rates = ["-50 deg/s", "50 deg/s"], mounts = 6, dwell = "10 s", rate = "1 Hz" }
[[scene]]
name = "helicopter"
duration = "1 min"
budget = { attitude = "1 deg" }
"""


def test_class_level_study_has_a_report_over_its_classes(tmp_path, monkeypatch, capsys):
    path, out = tmp_path / "lots.toml", tmp_path / "out"
    path.write_text(LOTS)
    assert _call(monkeypatch, "run", str(path), "--out", str(out)) == 0
    assert {file.name for file in out.iterdir()} == {"report.html", "result.json"}
    told = json.loads((out / "result.json").read_text())
    assert [one["id"] for one in told["lots"]["classes"]] == ["mems_tactical", "fog_tactical"]
    assert [len(one["units"]) for one in told["lots"]["classes"]] == [2, 2]
    assert "tactical FOG" in capsys.readouterr().out


def test_class_level_study_has_no_chains(tmp_path, monkeypatch, capsys):
    path = tmp_path / "lots.toml"
    path.write_text(LOTS)
    assert _call(monkeypatch, "run", str(path), "--method", "full") == 2
    assert "leaves no choice of" in " ".join(capsys.readouterr().err.split())


def test_fault_of_ours_exits_with_one(study, monkeypatch, capsys):
    def unsettled(*_: object) -> None:
        raise ConvergenceError("REML did not settle", estimate=1.0)

    monkeypatch.setattr("imubayes.study.schema.read_study", unsettled)
    assert _call(monkeypatch, "check", str(study)) == 1
    assert "REML did not settle" in capsys.readouterr().err
