"""What it takes to repeat a study: its file, the command, and the versions."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Protocol

import imubayes

if TYPE_CHECKING:
    from pathlib import Path

    from imubayes.reporting.result.entries import Provenance


class FromFile(Protocol):
    """A study of any kind."""

    @property
    def path(self) -> Path:
        """Of its file."""
        ...

    @property
    def text(self) -> str:
        """Of its file."""
        ...


def provenance(study: FromFile, command: str) -> Provenance:
    """Collect what it takes to repeat a study: the study file, the command and the versions."""
    return {
        "study_file": str(study.path),
        "study_text": study.text,
        "command": command,
        "versions": versions(),
    }


@cache
def versions() -> dict[str, str]:
    """Versions of imubayes, of Python and of what computes the numbers."""
    return {
        "imubayes": imubayes.__version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in ("numpy", "celerite2", "numba", "emcee")},
    }


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "unknown"
