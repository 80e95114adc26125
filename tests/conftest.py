"""Where the tests find what others computed and recorded."""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import pytest
from hypothesis import settings

# two workers share two cores: threads of the linear algebra, which starts later, would wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# the same examples on every machine; no deadline, for a first call compiles and machines are busy
settings.register_profile("imubayes", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None, max_examples=2000)
settings.load_profile("imubayes")

# the studies about the tool; last, so that the package that is tested is the one that is installed
sys.path.append(str(Path(__file__).parents[1]))

GOLDEN = Path(__file__).parent / "references"
"""Texts that were read by a person, and are held to the letter."""

VERSION = re.compile(r"\b(imubayes|[Pp]ython|numpy|numba|emcee)([ \":]+)\d[\w.+]*")

HASH = re.compile(r"\b[0-9a-f]{64}\b")

SHARED = Path(__file__).parents[2] / "shared"


FIRST = ("test_terminal.py", "test_any_result.py", "test_ensembles.py", "test_search.py", "test_pages.py")
"""In this order: where nothing is compiled yet one worker compiles what most tests call, and the other has
what calls none of it; else both compile the same."""

LONG = {"cli", "ladder", "mcmc", "population", "studies", "study", "tests"}
"""Folders with files of few tests that take long."""


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """With workers, each file is one worker's: what its tests share is made once."""
    if getattr(config.option, "numprocesses", None) and config.option.dist == "no":
        config.option.dist, config.option.loadscopereorder = "loadfile", False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long come first: no worker is left with one of them when the others have finished."""
    order = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: (order.get(item.path.name, len(order)), item.path.parent.name not in LONG))


def pytest_addoption(parser: pytest.Parser) -> None:
    """``pytest --renew``: write the golden files anew, to be read in the diff."""
    parser.addoption("--renew", action="store_true", help="write the files of tests/references anew")


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Hold a text against the golden file of that name; versions and hashes do not count."""

    def held(name: str, text: str) -> None:
        file, text = GOLDEN / name, HASH.sub("*", VERSION.sub(r"\1\2*", re.sub(r" +$", "", text, flags=re.M)))
        if request.config.getoption("--renew"):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        old = file.read_text(encoding="utf-8") if file.exists() else ""
        if text != old:
            lines = difflib.unified_diff(
                old.splitlines(), text.splitlines(), "golden", "today", "", "", 0, ""
            )
            changed = "\n".join([*lines][:60])
            pytest.fail(
                f"tests/references/{name}; where it is right, pytest --renew\n{changed}", pytrace=False
            )

    return held


class Ended(NamedTuple):
    """How a command ended, and what it said."""

    code: object
    out: str
    err: str

    @property
    def words(self) -> str:
        """What it said, whatever the width of the lines."""
        return " ".join((self.out + self.err).split())


@pytest.fixture(scope="session")
def command() -> Callable[..., Ended]:
    """Run ``imubayes`` with these arguments, in this process and 80 columns."""
    from imubayes.cli import main

    def run(*arguments: object) -> Ended:
        out, err = io.StringIO(), io.StringIO()
        line = mock.patch.object(sys, "argv", ["imubayes", *map(str, arguments)])
        width = mock.patch.dict(os.environ, {"COLUMNS": "80"})
        said = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
        with line, width, said[0], said[1], pytest.raises(SystemExit) as stop:
            main()
        return Ended(stop.value.code, out.getvalue(), err.getvalue())

    return run


STUDY = """
[study]
title = "small tumble"
seed = 1
method = "exact"
[decision]
compare = false
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
"""A small tumble, decided at the estimated noise, with no other method beside."""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A small study on file."""
    path = tmp_path / "small.toml"
    path.write_text(STUDY)
    return path


def _folder(variable: str, usual: Path) -> Path:
    folder = Path(os.environ.get(variable, usual))
    if not folder.is_dir():
        pytest.skip(f"needs the folder {folder}: set {variable} to where it is")
    return folder


@pytest.fixture(scope="session")
def references() -> Path:
    """Folder of numbers that others computed: NIST StRD, R packages."""
    return _folder("IMUBAYES_REFERENCES", SHARED / "references")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of public recordings."""
    return _folder("IMUBAYES_DATA", SHARED / "data")


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Callable[[str, float], None]:
    """Keep a number that a test measured, for the end of a verbose run (``pytest -v``) and junit files."""
    return lambda name, value: request.node.user_properties.append((name, value))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what the tests measured."""
    passed = [report for report in terminalreporter.getreports("passed") if report.when == "call"]
    lines = [f"{value:>8}  {name}" for report in passed for name, value in report.user_properties]
    if lines and terminalreporter.config.get_verbosity() > 0:
        terminalreporter.write_sep("=", "measured")
        for line in lines:
            terminalreporter.write_line(line)
