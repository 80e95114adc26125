"""What is timed: one problem, and everybody who solves it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Subject = Literal[
    "least squares", "one-sided", "subsets", "g-prior", "enumeration", "noise", "posterior", "trade"
]
Quantity = Literal["rows", "terms", "models", "runs", "units"]


@dataclass(frozen=True, slots=True, eq=False)
class Self:
    """What an entrant gives that keeps its own time, in place of what was around its work."""

    answer: Any
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Entrant:
    """Somebody who solves a problem.

    `solve` gives the answer, or `Self` where it keeps its own time; the `error` of that is NaN where nothing
    tells it. Without the modules that it `needs`, or ``R:`` and a package of R, it is left out. `ours` marks
    this package; `remark` is what a reader should know.
    """

    name: str
    solve: Callable[[], Any]
    error: Callable[[Any], float]
    needs: tuple[str, ...] = ()
    ours: bool = False
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """A problem of a size, and who solves it; the first entrant is the one that the others are held against.

    For a reader the title names the problem and its size; `error` says what the errors are, `time` what the
    seconds are of.
    """

    subject: Subject
    size: int
    title: str
    error: str
    time: str
    entrants: tuple[Entrant, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """The same work at several sizes of a quantity: (size, work) each.

    `title` names the work for a reader; `expected` is the exponent that the count of operations gives.
    """

    quantity: Quantity
    title: str
    expected: float
    steps: tuple[tuple[int, Callable[[], Any]], ...]


@dataclass(frozen=True, slots=True)
class SpeedStudy:
    """What is measured, everybody `repeats` times in turns, of which the shortest counts.

    `contests` are sizes of each subject: rows, candidates, samples of a static record, rows of a campaign;
    `growth` are sizes of each quantity that a power law is fitted to, rising.
    """

    seed: int = 1
    repeats: int = 5
    contests: Mapping[Subject, tuple[int, ...]] = field(
        default_factory=lambda: {
            "least squares": (100_000, 1_000_000),
            "one-sided": (100_000,),
            "subsets": (10, 12),
            "g-prior": (12, 20),
            "enumeration": (20, 23, 26),
            "noise": (36_000, 360_000),
            "posterior": (6_000,),
            "trade": (1_000, 10_000, 100_000, 1_000_000, 10_000_000),
        }
    )
    growth: Mapping[Quantity, tuple[int, ...]] = field(
        default_factory=lambda: {
            "rows": (10_000, 30_000, 100_000, 300_000, 1_000_000),
            "terms": (10, 20, 40, 80, 160),
            "models": (2**16, 2**18, 2**20, 2**22, 2**24),
            "runs": (1, 2, 4, 8, 16),
            "units": (1, 2, 4, 8, 16),
        }
    )
    command: str = "python -m studies.speed"


SMALL = SpeedStudy(
    repeats=1,
    contests={
        "least squares": (500,),
        "one-sided": (500,),
        "subsets": (8,),
        "g-prior": (8,),
        "enumeration": (9, 10),
        "noise": (1_000,),
    },
    growth={
        "rows": (1_000, 2_000, 4_000),
        "terms": (3, 6, 9),
        "models": (256, 512, 1_024),
        "units": (1, 2, 3),
    },
)
"""Seconds of work; the chains of a posterior are left out."""
