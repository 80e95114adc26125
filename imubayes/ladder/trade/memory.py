"""How much memory a piece of work takes at its peak, beside what the process held before."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Found = TypeVar("Found")

STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""What Linux tells of a process, and where it is told to forget the peak."""

FORGET_PEAK = "5"


def with_peak(work: Callable[[], Found]) -> tuple[Found, float]:
    """Do a piece of work; give what it gives, and the bytes that it took at its peak (NaN if nobody tells).

    Examples
    --------
    >>> found, taken = with_peak(lambda: sum([1, 2]))
    >>> found, taken >= 0.0 or math.isnan(taken)
    (3, True)
    """
    _forget()
    before = _told("VmRSS")
    if math.isnan(before):
        before = _most()
    found = work()
    after = _told("VmHWM")
    return found, max((_most() if math.isnan(after) else after) - before, 0.0)


def _forget() -> None:
    try:
        REFERENCES.write_text(FORGET_PEAK)
    except OSError:
        return


def _told(what: str) -> float:
    """Bytes that the system's status of this process says; NaN where there is none."""
    try:
        lines = STATUS.read_text(encoding="ascii").splitlines()
    except OSError:
        return math.nan
    found = [line.split()[1] for line in lines if line.startswith(f"{what}:")]
    return 1024.0 * float(found[0]) if found else math.nan


def _most() -> float:
    """Most bytes that the process ever held."""
    try:
        import resource
    except ImportError:
        return math.nan
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
