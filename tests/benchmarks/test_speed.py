"""Timings against peers and bounds, each a ratio within one run on one machine: ``pytest -m benchmark``."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest
from celerite2 import driver

from imubayes.factor import factor_of
from imubayes.inference.summary import summarize
from imubayes.inference.whiten import Rows, whitener
from imubayes.rig.inputs import Inputs, Run
from imubayes.selection.tree import walk
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import columns, library

pytestmark = pytest.mark.benchmark

CANDIDATES = 20
NANOSECONDS_A_MODEL = 100.0
ROWS = 1_000_000
TIMES_CELERITE = 3.0
LIB = library("accelerometer", powers=3, asymmetry=0, set="extended")
INTERVAL = 0.01
NOISE = Noise(1e-3, 1e-3, 1e-4)
GIBIBYTES = 6.0


def _run(n: int) -> Run:
    rng = np.random.default_rng(1)
    u = {f"{quantity}_{axis}": rng.normal(size=n) for quantity in "fw" for axis in "ijk"}
    return Run("r", "other", Inputs(INTERVAL * np.arange(n), u, INTERVAL), u["f_i"] + rng.normal(size=n))


def _shortest(call: Callable[[], object], times: int = 3) -> float:
    """Seconds of the fastest call of several."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def test_a_model_of_2_to_the_20_takes_at_most_100_nanoseconds_on_one_thread(benchmark, measured):
    rng = np.random.default_rng(2)
    X, y = rng.normal(size=(200, CANDIDATES)), rng.normal(size=200)
    R = factor_of(X, y, [f"x{j}" for j in range(CANDIDATES)]).R
    walk(R[-3:, -3:])  # compiles, or reads what was compiled
    rss, _ = benchmark.pedantic(walk, args=(R,), rounds=5)
    assert len(rss) == 2**CANDIDATES
    nanoseconds = benchmark.stats.stats.min * 1e9 / 2**CANDIDATES
    measured("nanoseconds a model", round(nanoseconds, 1))
    assert nanoseconds <= NANOSECONDS_A_MODEL


def _peer(run: Run) -> Callable[[], None]:
    """celerite2's own factor and solve, as its GaussianProcess calls them, of the columns and y of a run."""
    n = len(run.inputs)
    w = whitener(NOISE, Rows(run.inputs.t, np.full(n, INTERVAL)))
    V = w.U * 1e-9  # time does not depend on the sizes; these leave the matrix positive
    rows = np.empty((n, len(LIB.terms) + 1))
    columns(LIB, run.inputs.channels, n, out=rows[:, :-1])
    rows[:, -1] = run.output

    def solve() -> None:
        d, W = driver.factor(w.t, w.c, np.ones(n), w.U, V, np.empty(n), np.copy(V))
        z = np.array(rows)
        z = driver.solve_lower(w.t, w.c, w.U, W, z, z)
        z /= d[:, None]
        driver.solve_upper(w.t, w.c, w.U, W, z, z)

    return solve


def test_summarize_takes_at_most_three_times_celerites_factor_and_solve(benchmark, measured):
    run = _run(ROWS)
    assert len(LIB.terms) == 21
    rules = {run.name: NoiseRule("fixed", NOISE)}
    summarize([run], LIB, rules=rules)  # imports, and memory that the system has not yet handed out
    peer = _shortest(_peer(run))
    benchmark.pedantic(summarize, args=([run], LIB), kwargs={"rules": rules}, rounds=3)
    ratio = benchmark.stats.stats.min / peer
    measured("celerite2's factor and solve, s", round(peer, 3))
    measured("summarize over celerite2", round(ratio, 2))
    assert ratio <= TIMES_CELERITE


PEAK = """
import resource, sys
sys.path.insert(0, {folder!r})
from test_speed import LIB, NOISE, _run
from imubayes.inference.summary import summarize
from imubayes.sensors.noise import NoiseRule
summary = summarize([_run(10_000_000)], LIB, rules={{"r": NoiseRule("fixed", NOISE)}})
assert summary.factor.n == 10_000_000
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
sys.stdout.write(str(peak * (1 if sys.platform == "darwin" else 1024)))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs getrusage")
def test_ten_million_rows_take_less_than_six_gibibytes(measured):
    script = PEAK.format(folder=str(__file__).rpartition("/")[0])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    peak = int(done.stdout) / 2**30
    measured("peak memory, GiB", round(peak, 2))
    assert peak < GIBIBYTES
