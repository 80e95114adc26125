"""What a study of the extremes measures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class ExtremesStudy:
    """What is measured.

    Attributes
    ----------
    title, seed : of the study.
    families : keys of `cases.FAMILIES`.
    every : 1 for the entire grid, k for each k-th case of a family.
    path, text : of the study file.
    """

    title: str
    seed: int
    families: tuple[str, ...]
    every: int
    path: Path
    text: str
