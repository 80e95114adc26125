"""The machine that times belong to: processor, threads, load, and the versions of what computes."""

from __future__ import annotations

import math
import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

COUNTED = (
    "numpy",
    "scipy",
    "numba",
    "celerite2",
    "emcee",
    "statsmodels",
    "scikit-learn",
    "abess",
    "allantools",
    "nutpie",
)
"""Distributions whose versions matter for the times."""


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
    from imubayes.selection.threads import threads

    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan
    return Machine(
        processor=_processor(),
        system=f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        threads={"enumeration": threads(), "linear algebra": _blas_threads()},
        load=load,
        versions={name: number for name in COUNTED if (number := _version(name))},
    )


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
