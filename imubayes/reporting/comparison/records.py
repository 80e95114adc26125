"""What all comparisons put into their ``result.json``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import imubayes
from imubayes.reporting.comparison.pulls import LEVEL, Pull
from imubayes.reporting.comparison.view import Labelled


class Source(Protocol):
    """A result of any kind of study."""

    @property
    def path(self) -> Path:
        """Of the file."""
        ...

    @property
    def sha256(self) -> str:
        """Of its bytes."""
        ...

    @property
    def study(self) -> str:
        """Title."""
        ...

    @property
    def version(self) -> str:
        """Of imubayes that wrote it."""
        ...


def labelled(results: Sequence[Source], labels: Sequence[str]) -> tuple[Labelled, ...]:
    """Results under their labels."""
    return tuple(
        Labelled(label, one.study, one.path, one.sha256, one.version)
        for label, one in zip(labels, results, strict=True)
    )


def head_record(
    results: Sequence[Source], labels: Sequence[str], tests: int, threshold: float
) -> dict[str, Any]:
    """Which results, and what counts as a difference."""
    return {
        "imubayes": imubayes.__version__,
        "results": [
            {"label": label, "file": str(one.path), "sha256": one.sha256, "study": one.study}
            for label, one in zip(labels, results, strict=True)
        ],
        "level": LEVEL,
        "comparisons": tests,
        "threshold": threshold,
    }


def pull_record(pull: Pull | None) -> dict[str, Any]:
    """Largest difference; nulls where there is none."""
    if pull is None:
        return {"difference_over_sd": None, "between": None, "differs": None}
    return {"difference_over_sd": pull.size, "between": list(pull.pair), "differs": pull.beyond}
