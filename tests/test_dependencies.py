"""What an install brings is what a user's commands import."""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

DOCUMENTATION = {"sphinx", "docutils", "babel", "numpydoc"}
"""Tools that write manuals: nobody needs them to run a study."""


def _name(requirement: str) -> str:
    return re.sub(r"[-_.]+", "-", Requirement(requirement).name).lower()


_owners = cache(packages_distributions)


def _imported(folder: str = "imubayes") -> set[str]:
    """Names of the distributions that a module of a folder imports, at its top or in a function."""
    modules: set[str] = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.partition(".")[0])
    return {_name(owner) for module in modules for owner in _owners().get(module, ())}


def _brought(requirement: str, seen: set[str]) -> set[str]:
    """Add the distribution of a requirement, and all that it needs here, to those seen."""
    if (name := _name(requirement)) not in seen:
        seen.add(name)
        try:
            needs = [Requirement(text) for text in requires(name) or ()]
        except PackageNotFoundError:
            needs = []
        for need in needs:
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                _brought(need.name, seen)
    return seen


def test_every_dependency_is_imported():
    declared = {_name(text) for text in DECLARED["dependencies"]}
    assert declared <= _imported()


@pytest.mark.parametrize("folder", ["imubayes", "studies"])
def test_every_import_is_declared(folder):
    extras = DECLARED["optional-dependencies"].values()
    declared = {_name(text) for part in (DECLARED["dependencies"], *extras) for text in part}
    assert _imported(folder) <= declared | {"imubayes"}


def test_an_install_brings_no_tool_that_writes_manuals():
    seen: set[str] = set()
    for text in DECLARED["dependencies"]:
        _brought(text, seen)
    assert "numpy" in seen
    assert not seen & DOCUMENTATION
