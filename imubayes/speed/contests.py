"""What is timed: one problem, and everybody who solves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Subject = Literal["least squares", "one-sided", "subsets", "g-prior", "enumeration", "noise", "posterior"]
Quantity = Literal["rows", "terms", "models", "runs", "units"]


@dataclass(frozen=True, slots=True, eq=False)
class Self:
    """What an entrant gives that keeps its own time, in place of what was around its work.

    Attributes
    ----------
    answer : its answer.
    seconds : that count.
    """

    answer: Any
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Entrant:
    """Somebody who solves a problem.

    Attributes
    ----------
    name : for a reader.
    solve : gives the answer, or `Self` where it keeps its own time.
    error : of an answer; NaN where nothing tells it.
    needs : modules, or ``R:`` and a package of R, without which it is left out.
    ours : whether it is this package.
    remark : what a reader should know.
    """

    name: str
    solve: Callable[[], Any]
    error: Callable[[Any], float]
    needs: tuple[str, ...] = ()
    ours: bool = False
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """A problem, and who solves it; the first entrant is the one that the others are held against.

    Attributes
    ----------
    subject : of the problem.
    size : number that it was built for.
    title : of the problem and its size, for a reader.
    error : what the errors are.
    time : what the seconds are of.
    entrants : ours first.
    """

    subject: Subject
    size: int
    title: str
    error: str
    time: str
    entrants: tuple[Entrant, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """The same work at several sizes.

    Attributes
    ----------
    quantity : that the sizes are of.
    title : of the work, for a reader.
    expected : exponent that the count of operations gives.
    steps : (size, work) each.
    """

    quantity: Quantity
    title: str
    expected: float
    steps: tuple[tuple[int, Callable[[], Any]], ...]


@dataclass(frozen=True, slots=True, eq=False)
class SpeedStudy:
    """A study of speed.

    Attributes
    ----------
    title, seed : of the study.
    repeats : times that everything is timed, in turns.
    contests : sizes of each subject.
    growth : sizes of each quantity that a law is fitted to.
    path, text : of the study file.
    """

    title: str
    seed: int
    repeats: int
    contests: dict[Subject, tuple[int, ...]]
    growth: dict[Quantity, tuple[int, ...]]
    path: Path
    text: str
