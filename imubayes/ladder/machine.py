"""The machine that times belong to, and how much memory a piece of work takes on it."""

from __future__ import annotations

import math
import os
import platform
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeVar

Made = TypeVar("Made")

COUNTED = ("numpy", "scipy", "numba", "emcee", "statsmodels", "scikit-learn", "abess",
           "allantools", "nutpie")  # fmt: skip
"""Distributions whose versions matter for the times."""

STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""What Linux tells of a process, and where it is told to forget the peak."""

FORGET_PEAK = "5"


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """What the times belong to.

    Attributes
    ----------
    processor, system : in words.
    cores : that this process may use.
    threads : of numba and of linear algebra.
    load : average of the last minute before the first timing; NaN where the system does not tell.
    versions : of what computes.
    """

    processor: str
    system: str
    cores: int
    threads: dict[str, int]
    load: float
    versions: dict[str, str]


def machine() -> Machine:
    """Describe this machine."""
    from imubayes.selection.spaces import threads

    return Machine(
        processor=_processor(),
        system=f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        cores=cores(),
        threads={"enumeration": threads(), "linear algebra": _blas_threads()},
        load=os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan,
        versions={name: number for name in COUNTED if (number := _version(name))},
    )


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    """Return the name of the processor, as the system gives it."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _blas_threads() -> int:
    from threadpoolctl import threadpool_info

    return max((int(one["num_threads"]) for one in threadpool_info() if one["user_api"] == "blas"), default=1)


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def with_peak(work: Callable[[], Made]) -> tuple[Made, float]:
    """Do a piece of work; give what it gives, and the bytes at its peak beside what the process held before.

    NaN bytes if the system does not tell.

    Examples
    --------
    >>> found, taken = with_peak(lambda: sum([1, 2]))
    >>> found, taken >= 0.0 or math.isnan(taken)
    (3, True)
    """
    with suppress(OSError):
        REFERENCES.write_text(FORGET_PEAK)
    before = _told("VmRSS")
    if math.isnan(before):
        before = _most()
    made = work()
    after = _told("VmHWM")
    return made, max((_most() if math.isnan(after) else after) - before, 0.0)


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
