"""What docs/equations.md says is what the package does."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[3] / "docs" / "equations.md"
ROWS = re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]+) \|$", PAGE.read_text(encoding="utf-8"), re.M)


def test_examples_of_the_page_give_what_they_say():
    failed, tried = doctest.testfile(str(PAGE), module_relative=False, encoding="utf-8")
    assert failed == 0 and tried > 15


@pytest.mark.parametrize(("module", "names"), ROWS, ids=[module for module, _ in ROWS])
def test_every_module_of_the_page_has_its_parameters(module, names):
    found = importlib.import_module(f"imubayes.sensors.equations.{module}")
    assert all(hasattr(found, name) for name in re.findall(r"`(\w+)`", names))


def test_page_names_every_standard():
    folder = PAGE.parents[1] / "imubayes" / "sensors" / "equations"
    modules = {file.stem for file in folder.glob("*.py")} - {"__init__", "mapping", "standards"}
    assert {module for module, _ in ROWS} == modules
