"""Where the tests find what others computed and recorded."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

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
