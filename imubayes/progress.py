"""What somebody who waits is told: what goes on, and what share of it is done."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Who is told; work that can be counted says what share of it, 0 to 1, is done, and the rest nothing."""

    def __call__(self, doing: str, share: float | None = None, /) -> None:
        """Say what goes on."""


def silent(doing: str, share: float | None = None, /) -> None:
    """Tell nobody."""


def part_of(tell: Progress, done: int, total: int, name: str = "") -> Progress:
    """Tell of one of `total` like pieces of work, `done` of which are: its own share is one of the whole.

    Examples
    --------
    >>> part_of(lambda doing, share: print(f"{doing}, {share:.2f}"), 1, 4, "B: ")("noise", 0.5)
    B: noise, 0.38
    """

    def told(doing: str, share: float | None = None, /) -> None:
        of_all = share if total == 1 else (done + (share or 0.0)) / total
        tell(f"{name}{doing}", of_all)

    return told
