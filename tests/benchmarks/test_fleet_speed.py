"""What a fleet costs beyond its units, on the local pool and on dask: ``pytest -m benchmark``."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import pytest
from fleet_studies import fleet

from imubayes.population import FleetStudy, part_found, parts_of
from imubayes.population.fleet import lot_of, measure
from imubayes.work import engine

pytestmark = pytest.mark.benchmark

UNITS, WORKERS = 200, 2
OVER_A_BARE_POOL = 1.3
"""Time of a fleet with its dataset and its population over that of a bare pool for the same units."""


def _fleet(units: int) -> FleetStudy:
    return fleet(units, part=8, processes=WORKERS)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with two workers."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster.scheduler_address


def _bare(units: int) -> float:
    """Seconds of a bare pool of the standard library for the same parts; nothing is kept or put together."""
    study = _fleet(units)
    parts = parts_of(study, lot_of(study))
    start = time.perf_counter()
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        list(pool.map(part_found, repeat(study), parts))
    return time.perf_counter() - start


def _seconds(folder: Path, address: str, units: int) -> float:
    start = time.perf_counter()
    with engine(address, WORKERS) as workers:
        measure(_fleet(units), folder, workers)
    return time.perf_counter() - start


@pytest.mark.parametrize("where", ["local", "dask"])
def test_fleet_takes_little_longer_than_a_bare_pool(benchmark, measured, tmp_path, scheduler, where):
    address = "local" if where == "local" else scheduler
    _seconds(tmp_path / "warm", address, 16)
    peer = _bare(UNITS)
    benchmark.pedantic(_seconds, args=(tmp_path / "fleet", address, UNITS), rounds=2)
    peer = min(peer, _bare(UNITS))
    mine = benchmark.stats.stats.min
    benchmark.extra_info |= {"units a second": UNITS / mine, "over a bare pool": mine / peer}
    measured(f"{where}: units a second", round(UNITS / mine, 1))
    measured(f"{where}: time over a bare pool's", round(mine / peer, 2))
    assert mine / peer <= OVER_A_BARE_POOL
