"""What it takes to repeat a study: its file, the command, and the versions."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import imubayes

if TYPE_CHECKING:
    from pathlib import Path

    from imubayes.reporting.result.parts import Provenance


def provenance(path: Path, text: str, command: str) -> Provenance:
    """What it takes to repeat a study: its file and the text of it, the command and the versions."""
    return {
        "study_file": str(path),
        "study_text": text,
        "command": command,
        "versions": versions(),
    }


@cache
def versions() -> dict[str, str]:
    """Versions of imubayes, of Python and of what computes the numbers."""
    return {
        "imubayes": imubayes.__version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in ("numpy", "numba", "emcee")},
    }


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "unknown"
