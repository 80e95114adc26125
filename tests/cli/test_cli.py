"""The command line as a person meets it."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
import typer

from imubayes.campaign import Sampling, Study
from imubayes.cli import ExportFormat, Method, app
from imubayes.cli.kinds import summed
from imubayes.errors import ConvergenceError, InputError
from imubayes.reporting.blocks import page_files
from imubayes.reporting.document import report_page
from imubayes.reporting.export import FORMATS
from imubayes.reporting.results import result_json
from imubayes.study.method import run
from imubayes.study.schema import read
from imubayes.study.schema.tables import HeaderTable

ROOT = Path(__file__).parents[2]
HEAVY = {
    *("arviz", "h5py", "jinja2", "matplotlib", "numba", "numpy", "pint"),
    *("pyarrow", "pydantic", "rich", "scipy", "xarray"),
}

UNUSED = {"arviz", "emcee", "matplotlib", "numba", "scipy.stats", "imubayes.planning", "imubayes.population"}


@pytest.mark.parametrize(("module", "heavy"), [("imubayes.cli", HEAVY), ("imubayes.study.schema", UNUSED)])
def test_help_and_a_study_that_is_read_import_nothing_heavy(module, heavy):
    script = f"import sys, {module}; print(*({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def _examples() -> dict[str, list[list[str]]]:
    """Arguments of the examples that each command's help has."""
    commands = typer.main.get_group(app).commands
    return {
        name: [shlex.split(line)[1:] for line in (one.epilog or "").splitlines() if "imubayes " in line]
        for name, one in commands.items()
    }


CHEAP = ("simulate", "init", "check", "catalogue", "compare", "export", "schema")
"""Commands whose examples are run, in this order: what one writes another reads."""


def test_every_command_has_an_example_of_its_own_that_parses():
    group = typer.main.get_group(app)
    for name, examples in _examples().items():
        assert name in {arguments[0] for arguments in examples}, name
        for command, *arguments in examples:
            group.commands[command].make_context(command, arguments)
            assert all((ROOT / one).exists() for one in arguments if one.startswith(("studies/", "reports/")))


def test_examples_of_the_help_work_as_they_stand(command, tmp_path, monkeypatch):
    for folder in ("studies", "reports"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    examples = _examples()
    for name in CHEAP:
        for arguments in (one for one in examples[name] if one[0] == name):
            assert command(*arguments).code == 0, arguments


def test_a_name_that_is_no_text_is_refused_before_a_run(command):
    ended = command("run", "st\udcfcdy.toml")
    assert ended.code == 2
    assert ended.words.startswith(r"imubayes: 'st\udcfcdy.toml': is no text in UTF-8: rename the file")


def test_unknown_command_is_wrong_input(command):
    ended = command("characterise")
    assert ended.code == 2 and "characterise" in ended.err


@pytest.mark.parametrize(
    ("options", "sampling"),
    [
        ("", Sampling("full", 50.0, 600.0)),
        ("--method=collapsed --time-limit=5min --ess=300", Sampling("collapsed", 300.0, 300.0)),
        ("--resume", Sampling("full", 50.0, 600.0, resume=True)),
        ("--accuracy=0.2", Sampling("full", 50.0, 600.0, accuracy=0.2)),
        ("--budget=5s", Sampling("full", 50.0, 600.0, budget=5.0)),
    ],
)
def test_command_line_wins_over_the_study(command, study, tmp_path, monkeypatch, options, sampling):
    study.write_text(study.read_text().replace('"exact"\n', '"full"\n[sampling]\ness = 50\n'))
    chains, came = tmp_path / "chains", []
    chains.mkdir()
    (chains / "ACC-1.h5").touch()

    def caught(study: Study, **_: object) -> None:
        came.append(study.sampling)
        raise InputError("seen enough")

    monkeypatch.setattr("imubayes.study.method.run", caught)
    assert command("run", study, "--out", tmp_path, *options.split()).code == 2
    assert came == [replace(sampling, checkpoints=chains)]


def test_resumed_run_gives_the_result_of_the_run_that_it_resumes(command, study, tmp_path):
    out = tmp_path / "results"
    asked = ("run", str(study), "--out", str(out), "--method", "collapsed", "--ess", "40")
    results = []
    for options in ((), ("--resume",)):
        assert command(*asked, *options).code == 0
        assert [path.name for path in (out / "chains").iterdir()] == ["ACC-1.h5"]
        (sensor,) = json.loads((out / "result.json").read_text())["sensors"]
        results.append((sensor["method"], sensor["terms"]))
    assert results[0][0] == "collapsed"
    assert results[1] == results[0]


def test_what_is_said_of_a_study_needs_no_models_one_by_one(study):
    _, asked = read(study)
    found = run(replace(asked, sampling=replace(asked.sampling, method="averaged")))
    light = summed(found)
    assert found.sensors[0].selection.models.parts and not light.sensors[0].selection.models.parts
    assert result_json(light) == result_json(found)
    assert page_files(report_page(light)) == page_files(report_page(found))


def test_report_is_the_same_beside_as_here_and_beside_no_figures_are_drawn_here(study, tmp_path):
    files, terminals = [], []
    for cores in (2, 1):
        script = (
            f"import sys\nfrom unittest import mock\nfrom imubayes.cli import main\n"
            f"with mock.patch('imubayes.work.cores', lambda: {cores}):\n    try:\n        main()\n"
            "    except SystemExit:\n        print('matplotlib' in sys.modules)"
        )
        out = tmp_path / "results"
        command = [sys.executable, "-c", script, "run", str(study), "--out", str(out)]
        ended = subprocess.run(command, capture_output=True, text=True, check=True)
        *lines, drawn_here = ended.stdout.splitlines()
        assert drawn_here == str(cores == 1)
        terminals.append([re.sub(r"[\d.]+ s\b", "", line) for line in lines])
        files.append({one.name: one.read_bytes() for one in out.iterdir() if one.name.startswith("slide")})
        assert {one.name for one in out.iterdir()} == {
            "report.html",
            "result.json",
            "posterior.nc",
            *files[-1],
        }
        shutil.rmtree(out)
    assert terminals[0] == terminals[1] and files[0] == files[1]


def test_choices_of_the_command_line_are_those_of_an_export_and_a_study():
    assert set(ExportFormat) == set(FORMATS)
    assert tuple(Method) == get_args(get_type_hints(HeaderTable)["method"])


def test_catalogue_holds_the_classes_of_a_file_of_ones_own(command, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('[gyroscope.mine]\nlike = "mems_tactical"\ngrade = "screened"\n')
    assert "screened" in command("catalogue", "mine", "--own", own).out
    ended = command("catalogue", "--own", tmp_path / "none.toml")
    assert ended.code == 2 and "none.toml" in ended.err


def test_fault_of_ours_exits_with_one(command, study, monkeypatch):
    def unsettled(*_: object, **__: object) -> None:
        raise ConvergenceError("REML did not settle", estimate=1.0)

    monkeypatch.setattr("imubayes.study.method.check", unsettled)
    ended = command("check", study)
    assert ended.code == 1 and "REML did not settle" in ended.err


def test_a_file_that_is_not_there_is_told_of_before_a_run_loads_what_draws_and_tests(tmp_path):
    (tmp_path / "study.toml").write_text(
        '[[sensor]]\nid = "A"\nkind = "gyroscope"\n[[sensor.run]]\nname = "log"\nprocedure = "static"\n'
        'file = "nowhere.csv"\n'
    )
    script = (
        "import sys\nfrom imubayes.cli import main\ntry:\n    main()\nexcept SystemExit:\n"
        "    heavy = ('matplotlib', 'numba', 'scipy.linalg', 'scipy.special', 'scipy.stats', 'sklearn')\n"
        "    print([name for name in heavy if name in sys.modules])"
    )
    command = [sys.executable, "-c", script, "run", "study.toml", "--out", "o"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "there is no such file" in ended.stderr
    assert ended.stdout.strip() == "[]"
