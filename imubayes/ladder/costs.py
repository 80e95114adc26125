"""What each rung takes on this machine, foreseen from the size of a problem.

Seconds are a sum over features of the size. What a rung does of each is the same everywhere, and was found by
least squares on problems of 600 to 162,000 rows, 15 to 23 columns and one to three runs (what is fixed, of
plug-in, averaged and collapsed, and what models take, so that 20 budgets from 1,000 to 600,000 rows are
kept); how fast a machine does it is measured with three kinds of work, in less than a second. Rows that are
read a part at a time are read again for each whitening: once for a single noise, some thirty times where the
noise is averaged over, some five hundred times where they count at every step; the walkers of a step share
what is read, which is a fiftieth of the work, and a tenth from text.

Beside it stand the machine that measured times belong to, and the memory that a piece of work takes there.
"""

from __future__ import annotations

import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from imubayes.inference.linear import BLOCKS, Rows
from imubayes.inference.mcmc.ensembles import walkers_for
from imubayes.inference.mcmc.split import WHOLE
from imubayes.inference.whiten import whiten
from imubayes.ladder import CostLaw, RungName, Size, rungs_for
from imubayes.selection.enumerate import LARGEST
from imubayes.sensors.noise import Noise
from imubayes.work import Progress, cores, silent


def _blocks(size: Size) -> float:
    """Numbers in the averages over blocks that stand for the runs."""
    rows = size.rows / max(size.runs, 1)
    return size.runs * (rows if rows <= WHOLE else BLOCKS) * size.columns


def _every(size: Size) -> float:
    """Rows that are whitened in a step of an ensemble over coefficients and noise."""
    return float(size.rows * walkers_for(size.columns + 3 * size.runs))


FEATURES: Mapping[str, tuple[str, Callable[[Size], float]]] = {
    "fixed": ("small", lambda s: 1.0),
    "runs": ("small", lambda s: float(s.runs)),
    "blocks": ("small", _blocks),
    "rows": ("large", lambda s: float((s.rows - s.streamed) * s.columns)),
    "streamed": ("large", lambda s: float(s.streamed * s.columns)),
    "models": ("subsets", lambda s: s.components * 2.0 ** min(s.candidates, LARGEST)),
    "every": ("large", _every),
}
"""What the seconds of a rung are a sum over: the kind of work, and how much of it."""

REFERENCE: CostLaw = {
    "means": {"fixed": 0.03, "rows": 5e-8},
    "sparse": {"runs": 0.05, "rows": 1e-7, "streamed": 4e-8},
    "plug-in": {"fixed": 0.15, "runs": 0.08, "rows": 9e-8, "streamed": 4e-8, "models": 8e-7},
    "averaged": {
        "fixed": 0.4, "runs": 0.2, "blocks": 1e-5, "rows": 1.5e-6, "streamed": 1.1e-6, "models": 2.9e-6,
    },
    "collapsed": {
        "fixed": 0.9, "runs": 0.5, "blocks": 6e-6, "rows": 1.5e-6, "streamed": 1.1e-6, "models": 3.1e-6,
    },
    "full": {
        "fixed": 0.9, "runs": 0.85, "blocks": 6e-6, "rows": 2e-6, "streamed": 1.1e-6, "models": 3.3e-6,
    },
    "raw": {
        "fixed": 0.9, "runs": 0.85, "blocks": 6e-6, "rows": 3e-6, "streamed": 1.2e-5, "models": 7.8e-6,
        "every": 1.9e-4,
    },
}  # fmt: skip
"""Seconds by unit of each feature, on a machine whose speeds are those of `USUAL`."""

USUAL = {"small": 6.5e-4, "large": 6.6e-3, "subsets": 5.4e-4}
"""Seconds of each kind of work on that machine."""

ROUNDS, REPEATS = 5, 5
"""Rounds of all kinds of work, and times that each is done in one: the fastest counts, which a busy machine
delays least."""

LARGE = 20_000
"""Rows of the large kind of work: beyond a cache."""

FILE = "speeds.json"
"""Speeds of this machine, in the user's cache folder."""


def foreseen(rung: RungName, size: Size, law: CostLaw) -> float:
    """Seconds that a rung will take, alone.

    Examples
    --------
    >>> size = Size(rows=36_000, columns=20, candidates=17, runs=2)
    >>> [round(foreseen(name, size, REFERENCE), 1) for name in ("means", "averaged")]
    [0.1, 2.9]
    """
    return sum(constant * FEATURES[name][1](size) for name, constant in law[rung].items())


def within(budget: float, size: Size, law: CostLaw) -> RungName:
    """Best rung that is foreseen to take no more than a budget (s); the cheapest where none does.

    Examples
    --------
    >>> within(2.0, Size(rows=36_000, columns=20, candidates=17, runs=2), REFERENCE)
    'plug-in'
    """
    every = rungs_for(size)
    fitting: list[RungName] = [rung for rung in every if foreseen(rung, size, law) <= budget]
    return fitting[-1] if fitting else every[0]


def calibrate(progress: Progress = silent) -> CostLaw:
    """Constants of this machine: from the user's cache folder, or measured and kept there.

    A folder that cannot be read or written is no error: the machine is then measured each time.
    """
    speeds = kept_speeds()
    if speeds is None:
        progress("measuring the speed of this machine")
        speeds = measured_speeds()
        text = json.dumps({"machine": _machine(), "speeds": dict(speeds)}, indent=1)
        with suppress(OSError, RuntimeError):
            folder = cache_folder()
            folder.mkdir(parents=True, exist_ok=True)
            part = folder / f"{FILE}.{os.getpid()}.part"
            part.write_text(text + "\n", encoding="utf-8")
            part.replace(folder / FILE)
    return law_of(speeds)


def known_law() -> CostLaw:
    """Constants of this machine where they are kept, else those of the one that they were found on."""
    speeds = kept_speeds()
    return REFERENCE if speeds is None else law_of(speeds)


def law_of(speeds: Mapping[str, float]) -> CostLaw:
    """Law of a machine that takes so many seconds for each kind of work (the keys of `USUAL`)."""
    slower = {kind: speeds[kind] / usual for kind, usual in USUAL.items()}
    return {
        rung: {name: constant * slower[FEATURES[name][0]] for name, constant in parts.items()}
        for rung, parts in REFERENCE.items()
    }


def measured_speeds() -> dict[str, float]:
    """Seconds of each kind of work here, with linear algebra in one thread, as an analysis does it."""
    from threadpoolctl import threadpool_limits

    from imubayes.selection.lanes import walk

    R = np.triu(np.ones((17, 17))) + np.diag(np.arange(1.0, 18.0))
    walk(R)  # compiled once, which counts for nothing
    works = {"small": _whitening(1500, 21), "large": _whitening(LARGE, 17), "subsets": lambda: walk(R)}
    seconds = dict.fromkeys(works, math.inf)
    with threadpool_limits(1, user_api="blas"):
        for _ in range(ROUNDS):  # in turn: what delays the machine for a moment delays none of them always
            for kind, work in works.items():
                for _ in range(REPEATS):
                    start = time.perf_counter()
                    work()
                    seconds[kind] = min(seconds[kind], time.perf_counter() - start)
    return seconds


def _whitening(n: int, width: int) -> Callable[[], object]:
    """Whiten n rows, and factor as many of them as fit the cache."""
    rows, table = Rows(np.arange(float(n)), np.ones(n)), np.ones((n, width))
    table += np.add.outer(np.arange(n), np.arange(width) ** 2) % 7

    def work() -> object:
        white = whiten(Noise(1.0, 0.1, 1e-3), rows, table.copy())[0]
        return np.linalg.qr(white[:4000], mode="r")

    return work


def cache_folder() -> Path:
    """Where this platform keeps what a program can do without."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "imubayes"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "imubayes"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "imubayes"


def kept_speeds() -> dict[str, float] | None:
    """Seconds of each kind of work on this machine as they were kept; None where they are not known."""
    try:
        kept = json.loads((cache_folder() / FILE).read_text(encoding="utf-8"))
        speeds = {kind: float(kept["speeds"][kind]) for kind in USUAL}
        sound = all(math.isfinite(s) and s > 0.0 for s in speeds.values())
        return speeds if sound and kept["machine"] == _machine() else None
    except (OSError, RuntimeError, ValueError, LookupError, TypeError):
        return None


def _machine() -> list[str]:
    here = platform.node(), platform.machine(), str(os.cpu_count()), platform.python_version()
    return [*here, np.__version__]


Made = TypeVar("Made")

COUNTED = ("numpy", "scipy", "numba", "emcee", "statsmodels", "scikit-learn", "abess",
           "allantools", "nutpie")  # fmt: skip
"""Distributions whose versions matter for the times."""

STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""What Linux tells of a process, and where it is told to forget the peak."""

FORGET_PEAK = "5"


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """What the times belong to; `cores` may be used by this process, `threads` are of each kind of work.

    The load is the average of the last minute before the first timing; NaN where the system does not tell.
    """

    processor: str
    system: str
    cores: int
    threads: dict[str, int]
    load: float
    versions: dict[str, str]


def machine() -> Machine:
    """Describe this machine."""
    from threadpoolctl import threadpool_info

    from imubayes.selection.model_sets import threads

    blas = [int(pool["num_threads"]) for pool in threadpool_info() if pool["user_api"] == "blas"]
    told = Path("/proc/cpuinfo")
    lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return Machine(
        processor=(named[0] if named else platform.processor() or platform.machine()),
        system=f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        cores=cores(),
        threads={"enumeration": threads(), "linear algebra": max(blas, default=1)},
        load=os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan,
        versions={name: number for name in COUNTED if (number := _version(name))},
    )


def _version(distribution: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

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
    values = [line.split()[1] for line in lines if line.startswith(f"{what}:")]
    return 1024.0 * float(values[0]) if values else math.nan


def _most() -> float:
    """Most bytes that the process ever held."""
    try:
        import resource
    except ImportError:
        return math.nan
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
