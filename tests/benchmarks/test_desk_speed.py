"""How long somebody waits at the desk, in compute: ``pytest -m benchmark``.

Whole commands are timed, and today's beside those of another environment where ``IMUBAYES_PEER`` names its
``imubayes`` (of commit 7178aca: a worktree of it, by ``pip install -e`` in an environment of its own).
The two run by turns, and seconds of the processor count, not of the clock: other work slows both alike.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

pytestmark = pytest.mark.benchmark

STUDIES = Path(__file__).parents[2] / "studies"
TODAY = Path(sys.executable).with_name("imubayes")
PEER = os.environ.get("IMUBAYES_PEER", "")
ROUNDS = 3


class Cost(NamedTuple):
    """What a command took: s of the processor, and its largest memory in MB."""

    seconds: float
    memory: float


def cost(*command: str | Path, **environment: str) -> Cost:
    process = subprocess.Popen(
        [*map(str, command)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def by_turns(once, rounds=ROUNDS):
    """Costs (rounds, 2) of today's command and the peer's; without a peer that is NaN."""
    return np.array([[once(TODAY), once(Path(PEER)) if PEER else (np.nan, np.nan)] for _ in range(rounds)])


@pytest.mark.parametrize(
    ("study", "share", "of_memory"),
    [("quickstart", 0.45, 0.56), ("xsens_tumble", 0.5, 1.0), ("imu_tk_xsens", 0.5, 1.0)],
)
def test_second_run_of_a_study_takes_no_larger_share_of_the_first_release(
    study, share, of_memory, tmp_path, measured
):
    def once(command):
        compiled = {"NUMBA_CACHE_DIR": str(tmp_path / command.parts[-3])}
        return cost(command, "run", STUDIES / f"{study}.toml", "--out", tmp_path / "out", **compiled)

    by_turns(once, 1)  # compiles
    told = by_turns(once)
    measured(f"s of compute, {study}", round(float(np.median(told[:, 0, 0])), 1))
    measured(f"MB at most, {study}", round(float(told[:, 0, 1].max())))
    if PEER:
        ratio = float(np.median(told[:, 0, 0] / told[:, 1, 0]))
        memory = float(told[:, 0, 1].max() / told[:, 1, 1].max())
        measured(f"share of the peer's compute, {study}", round(ratio, 2))
        measured(f"share of the peer's memory, {study}", round(memory, 2))
        assert ratio < share and memory < of_memory


def test_first_run_compiles_in_no_more_than_the_first_release_took(tmp_path, measured):
    def once(command):
        new = {"NUMBA_CACHE_DIR": str(tmp_path / f"{len(list(tmp_path.iterdir()))}")}
        return cost(command, "run", STUDIES / "quickstart.toml", "--out", tmp_path / "out", **new)

    told = by_turns(once, 1)
    measured("s of compute, first quickstart", round(float(told[0, 0, 0]), 1))
    if PEER:
        measured(
            "share of the peer's compute, first quickstart", round(float(told[0, 0, 0] / told[0, 1, 0]), 2)
        )
        assert told[0, 0, 0] < 0.7 * told[0, 1, 0]


@pytest.mark.parametrize("used", ["__version__", "select"])
def test_import_takes_no_longer_than_it_did(used, measured):
    told = by_turns(lambda c: cost(c.with_name("python"), "-c", f"import imubayes; imubayes.{used}"), 5)
    measured(f"s of compute, imubayes.{used}", round(float(np.median(told[:, 0, 0])), 2))
    if PEER:
        ratio = float(np.median(told[:, 0, 0] / told[:, 1, 0]))
        measured(f"share of the peer's compute, imubayes.{used}", round(ratio, 2))
        assert ratio < 1.1
