"""Rows a second and memory, whole and from a file in parts, beside celerite2: ``pytest -m benchmark``."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from celerite2 import driver
from pyarrow import parquet as pq

from imubayes.inference.dwells import pieces_of
from imubayes.inference.linear import Rows, linear_of
from imubayes.inference.summary import summarize
from imubayes.inference.whiten import Processes, processes, states_of
from imubayes.rig import streams
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import columns, library

pytestmark = pytest.mark.benchmark

ROWS = 1_000_000
TIMES_CELERITE, SHARE = 3.0, 0.5
LIB = library("accelerometer", powers=3, asymmetry=0, set="extended")
INTERVAL = 0.01
NOISE = Noise(1e-3, 1e-3, 1e-4)
GIBIBYTES = {"whole": 6.0, "in parts": 1.0}
UNITS = {"f": "m/s^2", "w": "rad/s"}


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


def _celerite(t: np.ndarray, parts: Processes, table: np.ndarray) -> Callable[[], None]:
    """celerite2's own factor and solve, as its GaussianProcess calls them, of a table (n, k) of columns."""
    c = states_of(NOISE, parts, np.full(len(t), INTERVAL)).rates
    U = np.ones((len(t), len(c)))
    V = U * 1e-9  # time does not depend on the sizes; these leave the matrix positive

    def solve() -> None:
        d, W = driver.factor(t, c, np.ones(len(t)), U, V, np.empty(len(t)), np.copy(V))
        z = np.array(table)
        z = driver.solve_lower(t, c, U, W, z, z)
        z /= d[:, None]
        driver.solve_upper(t, c, U, W, z, z)

    return solve


def _table(run) -> np.ndarray:
    """Columns of the library, and the output."""
    return np.column_stack((columns(LIB, run.inputs.channels, len(run.output)), run.output))


def test_summarize_takes_at_most_three_times_celerites_factor_and_solve(benchmark, measured):
    run = _run(ROWS)
    assert len(LIB.terms) == 21
    rules = {run.name: NoiseRule("fixed", NOISE)}
    summarize([run], LIB, rules=rules)  # imports, and memory that the system has not yet handed out
    parts = processes(Rows(run.inputs.t, np.full(ROWS, INTERVAL)), NOISE)
    peer = _shortest(_celerite(run.inputs.t, parts, _table(run)))
    benchmark.pedantic(summarize, args=([run], LIB), kwargs={"rules": rules}, rounds=3)
    ratio = benchmark.stats.stats.min / peer
    measured("celerite2's factor and solve, s", round(peer, 3))
    measured("summarize over celerite2", round(ratio, 2))
    assert ratio <= TIMES_CELERITE


def write(path: Path, rows: int) -> None:
    """A run of so many rows as a Parquet file, a million at a time."""
    for first in range(0, rows, ROWS):
        made = _run(min(ROWS, rows - first))
        u = {f"{name} [{UNITS[name[0]]}]": values for name, values in made.inputs.channels.items()}
        table = pa.table({"t [s]": first * INTERVAL + made.inputs.t, **u, "output [m/s^2]": made.output})
        if first == 0:
            file = pq.ParquetWriter(path, table.schema, use_dictionary=False)
        file.write_table(table)
    file.close()


def test_a_pass_over_a_file_has_at_least_half_the_rows_a_second_of_gram_and_celerite(
    benchmark, measured, tmp_path, monkeypatch
):
    write(tmp_path / "run.parquet", ROWS)
    monkeypatch.setattr(streams, "STREAMED", 1000)
    run = read_run(RunSpec("r", "other", file=tmp_path / "run.parquet"), "accelerometer")
    rows = linear_of(run, LIB)
    parts = processes(rows.rows, NOISE)

    def peer() -> float:
        """Seconds of X'X, celerite2's factor and its solve (lower and upper) over all rows, in blocks."""
        seconds = 0.0
        for part in run.stream.parts("peer"):
            table = _table(part)
            X, solve = table[:, :-1], _celerite(part.t, parts, table)
            seconds += _shortest(lambda X=X: X.T @ X, 1) + _shortest(solve, 1)
        return seconds

    pieces_of(rows, NOISE, parts)
    fastest = min(peer() for _ in range(3))
    benchmark.pedantic(pieces_of, args=(rows, NOISE, parts), rounds=3)
    share = fastest / benchmark.stats.stats.min
    measured("million rows a second, from the file", round(ROWS / benchmark.stats.stats.min / 1e6, 2))
    measured("million rows a second, X'X and celerite2", round(ROWS / fastest / 1e6, 2))
    benchmark.extra_info["rows a second over X'X and celerite2"] = share
    measured("share of the peers' rows a second", round(share, 2))
    assert share >= SHARE


# getrusage may tell of the process that started this one
PEAK = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from test_speed import LIB, NOISE, _run, write
from imubayes.inference.summary import summarize
from imubayes.ladder.costs import with_peak
from imubayes.rig.runs import read_run
from imubayes.rig.recordings import RunSpec
from imubayes.sensors.noise import NoiseRule
def whole():
    return summarize([_run(10_000_000)], LIB, rules={{"r": NoiseRule("fixed", NOISE)}}).factor.n
def in_parts():
    run = read_run(RunSpec("r", "other", file=Path({file!r})), "accelerometer")
    assert run.stream is not None
    return summarize([run], LIB).factor.n
if {way!r} == "in parts":
    write(Path({file!r}), 6_000_000)
rows, peak = with_peak(whole if {way!r} == "whole" else in_parts)
assert rows == (10_000_000 if {way!r} == "whole" else 6_000_000)
sys.stdout.write(str(round(peak)))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs getrusage")
@pytest.mark.parametrize("way", GIBIBYTES)
def test_memory_of_ten_million_rows_and_of_a_file_in_parts_stays_below_its_bound(way, measured, tmp_path):
    file = str(tmp_path / "run.parquet")
    script = PEAK.format(folder=str(Path(__file__).parent), file=file, way=way)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    peak = int(done.stdout) / 2**30
    measured(f"peak memory {way}, GiB", round(peak, 2))
    assert peak < GIBIBYTES[way]
