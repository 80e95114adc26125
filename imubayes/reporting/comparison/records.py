"""What all comparisons put into their ``result.json``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import imubayes
from imubayes.reporting.comparison.pulls import LEVEL, Pull

if TYPE_CHECKING:
    from imubayes.reporting.result.file import Written


class Compared(Protocol):
    """A comparison of any kind."""

    @property
    def results(self) -> Sequence[Written]:
        """Files, in the order of their labels."""
        ...

    @property
    def labels(self) -> Sequence[str]:
        """A, B, C ..."""
        ...

    @property
    def tests(self) -> int:
        """Number of comparisons."""
        ...

    @property
    def threshold(self) -> float:
        """Difference over its sd from which one is beyond uncertainty."""
        ...


def head_record(found: Compared) -> dict[str, Any]:
    """Which results, and what counts as a difference."""
    return {
        "imubayes": imubayes.__version__,
        "results": [
            {"label": label, "file": str(one.path), "sha256": one.sha256, "study": one.study}
            for label, one in zip(found.labels, found.results, strict=True)
        ],
        "level": LEVEL,
        "comparisons": found.tests,
        "threshold": found.threshold,
    }


def pull_record(pull: Pull | None) -> dict[str, Any]:
    """Largest difference; nulls where there is none."""
    if pull is None:
        return {"difference_over_sd": None, "between": None, "differs": None}
    return {"difference_over_sd": pull.size, "between": list(pull.pair), "differs": pull.beyond}
