"""How long somebody waits at the desk, against commit 7178aca: ``pytest -m benchmark``.

Whole commands are timed by the clock, the last commit's and that one's by turns, and their medians compared.
Both are installed apart from what tests need: scikit-learn loads pandas where it finds it. ``IMUBAYES_PEER``
may name the ``imubayes`` of that commit.
"""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

pytestmark = pytest.mark.benchmark

ROOT = Path(__file__).parents[2]
COMMIT = "7178aca"

LOG = """
[study]
title = "A static log of a million rows"
[[sensor]]
id = "ACC"
kind = "accelerometer"
class = "mems_tactical"
library = { powers = 1, asymmetry = -1 }
[[sensor.run]]
name = "log"
procedure = "static"
simulate = { duration = "10000 s", rate = "100 Hz" }
"""

MODELS = """
import numpy as np
import imubayes as ib
def found(p):
    rng = np.random.default_rng(2)
    X, y = rng.normal(size=(500, p)), rng.normal(size=500)
    return ib.enumerate_models(ib.Summary.from_arrays(X, y, [f"x{j}" for j in range(p)]), ib.ScalePrior(1.0))
found(12)
import time
start = time.perf_counter()
assert found(26).n_models == 2**26
print(time.perf_counter() - start)
"""


def desk(**own):
    """Environment of somebody at a desk, with more of its own; that of tests holds linear algebra back."""
    return {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | own


def history(*arguments):
    """What git says of this repository, which has to hold the commit."""
    told = subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True)
    if told.returncode:
        pytest.skip(f"this repository's history does not hold commit {COMMIT}")
    return told.stdout


class Cost(NamedTuple):
    """What a command took: s by the clock and of the processor, and its largest memory in MB."""

    seconds: float
    compute: float
    memory: float


def waited(process, start):
    """Cost of a process that was begun at `start`, when it has ended well."""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return Cost(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def installed(place, source):
    """The ``imubayes`` of a source, in an environment of its own."""
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    subprocess.run([place / "bin/pip", "install", "-q", source], check=True)
    return place / "bin/imubayes"


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The ``imubayes`` of the last commit, and that of `COMMIT`."""
    history("cat-file", "-e", COMMIT)
    folder, before = tmp_path_factory.mktemp("both"), os.environ.get("IMUBAYES_PEER")
    return (
        installed(folder / "today", f"git+{ROOT.as_uri()}"),
        Path(before) if before else installed(folder / "before", f"git+{ROOT.as_uri()}@{COMMIT}"),
    )


@pytest.fixture
def cost(tmp_path):
    """Run a command with compiled loops of its own."""

    def run(command, *arguments):
        start = time.perf_counter()
        process = subprocess.Popen(
            [command, *map(str, arguments)],
            cwd=tmp_path,  # python would import what lies in the project's folder
            env=desk(NUMBA_CACHE_DIR=str(tmp_path / command.parts[-3])),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        return waited(process, start)

    return run


def shares(once, both, rounds):
    """What `once` gives of today's command over what it gives of the other one, medians of some rounds."""
    told = np.array([list(map(once, both)) for _ in range(rounds)], dtype=float)
    today, before = np.median(told, axis=0)
    return today / before


@pytest.mark.parametrize(
    ("study", "most", "of_compute", "of_memory"),
    [
        ("quickstart", 1 / 5, 0.45, 250 / 475),
        ("xsens_tumble", 1 / 3, 0.5, 1.0),
        ("imu_tk_xsens", 1 / 3, 0.5, 1.0),
    ],
)
def test_second_run_of_a_study(study, most, of_compute, of_memory, both, cost, tmp_path, measured):
    def once(command):
        return cost(command, "run", ROOT / f"studies/{study}.toml", "--out", tmp_path / "out")

    shares(once, both, 1)  # compiles
    seconds, compute, memory = shares(once, both, 5 if study == "quickstart" else 2)
    measured(f"of the time, {study}", round(seconds, 3))
    measured(f"of the compute, {study}", round(compute, 3))
    measured(f"of the memory, {study}", round(memory, 2))
    assert seconds <= most
    assert compute < of_compute
    assert memory <= of_memory


def test_first_run_of_a_quickstart_and_its_first_answer(both, tmp_path, measured):
    def once(command):
        """Cost of a run on a terminal, and s until that shows provisional verdicts; the other has none."""
        ours, theirs = pty.openpty()
        own = desk(NUMBA_CACHE_DIR=str(tmp_path / f"new{len(list(tmp_path.iterdir()))}"), TERM="xterm")
        arguments = "run", ROOT / "studies/quickstart.toml", "--out", tmp_path / "out"
        start, shown, answered = time.perf_counter(), b"", 0.0
        process = subprocess.Popen([command, *arguments], env=own, stdout=theirs, stderr=theirs)
        os.close(theirs)
        with suppress(OSError):  # the terminal ends with its last process
            while part := os.read(ours, 4096):
                shown += part
                if not answered and b"provisional" in shown:
                    answered = time.perf_counter() - start
        told = waited(process, start)
        return *told, answered or told.seconds

    whole, compute, _, first = shares(once, both, 3)
    measured("of the time, first quickstart", round(whole, 3))
    measured("of the compute, first quickstart", round(compute, 3))
    measured("of the first quickstart's time, provisional verdicts", round(first, 3))
    assert whole <= 1 / 4
    assert compute < 0.7
    assert first <= 1 / 10


@pytest.mark.parametrize("study", ["lots", "log"])
def test_run_of_a_large_study(study, both, cost, tmp_path, measured):
    path = tmp_path / f"{study}.toml"
    if study == "log":
        path.write_text(LOG)
    else:
        path.write_bytes(history("show", f"{COMMIT}:studies/mems_vs_fog.toml"))

    def once(command):
        return cost(command, "run", path, "--out", tmp_path / "out").seconds

    if study == "log":
        shares(once, both, 1)  # compiles
    share = shares(once, both, 3 if study == "log" else 1)
    measured(f"of the time, {study}", round(share, 3))
    assert share <= 1 / 3


@pytest.mark.parametrize(
    ("used", "most"),
    [
        ("imubayes.study", 0.4 / 1.4),
        ("imubayes; imubayes.__version__", 1.1),
        ("imubayes; imubayes.select", 1.1),
    ],
)
def test_import(used, most, both, cost, measured):
    def once(command):
        return cost(command.with_name("python"), "-c", f"import {used}")

    seconds, compute, _ = shares(once, both, 15)
    measured(f"of the time, import {used}", round(seconds, 3))
    measured(f"of the compute, import {used}", round(compute, 3))
    assert max(seconds, compute) < most


def test_2_to_the_26_models(both, measured):
    def once(command):
        told = subprocess.run(
            [command.with_name("python"), "-c", MODELS], check=True, cwd="/", env=desk(), capture_output=True
        )
        return float(told.stdout)

    share = shares(once, both, 3)
    measured("of the time, 2^26 models", round(share, 3))
    assert share <= 1 / 2
