"""Timings against peers and bounds, each a ratio within one run on one machine: ``pytest -m benchmark``."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest
from celerite2 import driver

from imubayes.inference.linear import Rows
from imubayes.inference.summary import summarize
from imubayes.inference.whiten import mattering, states_of
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import columns, library

pytestmark = pytest.mark.benchmark

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


def _peer(run: Run) -> Callable[[], None]:
    """celerite2's own factor and solve, as its GaussianProcess calls them, of the columns and y of a run."""
    n = len(run.inputs)
    t, lasting = run.inputs.t, np.full(n, INTERVAL)
    c = states_of(NOISE, mattering(NOISE, Rows(t, lasting)), lasting).rates
    U = np.ones((n, len(c)))
    V = U * 1e-9  # time does not depend on the sizes; these leave the matrix positive
    rows = np.empty((n, len(LIB.terms) + 1))
    columns(LIB, run.inputs.channels, n, out=rows[:, :-1])
    rows[:, -1] = run.output

    def solve() -> None:
        d, W = driver.factor(t, c, np.ones(n), U, V, np.empty(n), np.copy(V))
        z = np.array(rows)
        z = driver.solve_lower(t, c, U, W, z, z)
        z /= d[:, None]
        driver.solve_upper(t, c, U, W, z, z)

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
import sys
sys.path.insert(0, {folder!r})
from test_speed import LIB, NOISE, _run
from imubayes.inference.summary import summarize
from imubayes.ladder.costs import with_peak
from imubayes.sensors.noise import NoiseRule
fixed = {{"r": NoiseRule("fixed", NOISE)}}
summary, peak = with_peak(lambda: summarize([_run(10_000_000)], LIB, rules=fixed))
assert summary.factor.n == 10_000_000
sys.stdout.write(str(round(peak)))
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
