"""Where the tests find what others computed and recorded."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

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

SHARED = Path(__file__).parents[2] / "shared"


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
