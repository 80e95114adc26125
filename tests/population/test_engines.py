"""A real scheduler and two workers on the loopback interface."""

import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from fleet_studies import after, fleet
from pyarrow import parquet

from imubayes import work
from imubayes.errors import InputError
from imubayes.population.fleet import measure
from imubayes.work import Lost, engine

UNITS = 24


@pytest.fixture(scope="module")
def cluster():
    """Scheduler and two workers, each under a nanny that starts it again; a second kill loses a task."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as running,
    ):
        yield running


@pytest.fixture(scope="module")
def at_home(tmp_path_factory):
    """The fleet as two processes of this machine find it."""
    folder = tmp_path_factory.mktemp("local")
    with engine("local", 2) as workers:
        return folder, measure(fleet(UNITS, part=4), folder, workers)


def _rows(folder):
    return parquet.read_table(folder / "units")


def test_dask_finds_what_the_local_pool_does_to_the_last_digit_though_a_worker_is_killed(
    cluster, at_home, tmp_path
):
    def kill() -> None:
        os.kill(_workers(cluster)[0], signal.SIGKILL)

    with engine(cluster.scheduler_address, 2) as workers:
        before = _workers(cluster)
        result = measure(fleet(UNITS, part=4), tmp_path, workers, progress=after(2, kill))
        _settle(cluster)
        assert len(set(before) & set(_workers(cluster))) == 1
    assert result.engine == f"2 workers of the dask scheduler {cluster.scheduler_address}"
    assert at_home[1].engine == "2 processes of this machine"
    for file in (tmp_path / "units").iterdir():
        assert file.read_bytes() == (at_home[0] / "units" / file.name).read_bytes()
    assert (result.terms, result.worst, result.broken) == (at_home[1].terms, at_home[1].worst, ())


def _workers(cluster) -> list[int]:
    from distributed import Client

    with Client(cluster.scheduler_address, set_as_default=False) as client:
        return sorted(client.run(os.getpid).values())


def _settle(cluster) -> None:
    """Wait until the nannies have started again what was killed."""
    for _ in range(300):
        if len(cluster.scheduler_info["workers"]) == 2:
            return
        time.sleep(0.1)


def test_scheduler_that_does_not_answer_is_said_within_seconds():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    start = time.perf_counter()
    _refused(address, f"--scheduler {address}: no dask scheduler answers")
    assert time.perf_counter() - start < 2.0 * work.REACH


def _refused(address: str, words: str) -> None:
    with pytest.raises(InputError, match=words), engine(address, 2):
        pass


@pytest.mark.parametrize("address", ["nonsense", "foo://x:1"])
def test_address_that_is_none_is_named(address):
    _refused(address, f"--scheduler {address}: .*expected an address such as")


def test_dask_that_is_not_installed_is_named_with_its_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    _refused("tcp://127.0.0.1:8786", r"pip install 'imubayes\[dask\]'")


def test_scheduler_without_workers_is_no_scheduler(monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(work, "REACH", 0.5)
    with LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=logging.CRITICAL) as empty:
        _refused(empty.scheduler_address, "has no workers: start some, 'dask worker tcp://")


def test_worker_with_another_version_is_named(cluster, monkeypatch):
    monkeypatch.setattr("imubayes.__version__", "0.0.0")
    words = r"worker tcp://.* has imubayes .*: install imubayes 0.0.0 there"
    _refused(cluster.scheduler_address, words)


def killed(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def test_job_that_ends_its_worker_too_often_is_lost_and_the_others_are_done(cluster, monkeypatch):
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)  # often enough is once
    with engine(cluster.scheduler_address, 2) as (_, do):
        found = dict(do(killed, [(k,) for k in range(6)]))
    assert found[3] == Lost()
    # what waits on a worker that dies with it is lost too: the fleet tries it alone
    assert {k: x for k, x in found.items() if x != Lost()}.items() <= {k: k * k for k in range(6)}.items()


@pytest.mark.slow
def test_scheduler_that_goes_away_is_said_and_what_is_finished_is_kept(at_home, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, quiet = f"tcp://127.0.0.1:{port}", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    own = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    work = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    scheduler = subprocess.Popen([*own, "--dashboard-address", ":0"], **quiet)
    worker = subprocess.Popen([*work, "--dashboard-address", ":0", "--death-timeout", "60"], **quiet)
    try:
        with (
            pytest.raises(InputError, match=r"the scheduler is gone: .*--resume"),
            _patiently(address) as workers,
        ):
            measure(fleet(UNITS, part=4), tmp_path, workers, progress=after(2, scheduler.kill))
    finally:
        worker.kill()
        scheduler.kill()
        worker.wait()
        scheduler.wait()
    with engine("local", 2) as workers:
        result = measure(fleet(UNITS, part=4), tmp_path, workers, resume=True)
    assert result.resumed == 8
    assert _rows(tmp_path).equals(_rows(at_home[0]))


@contextmanager
def _patiently(address: str) -> Iterator[work.Engine]:
    """Engine of a scheduler that is just starting."""
    for attempt in range(30):
        try:
            with engine(address, 2) as workers:
                yield workers
                return
        except InputError as error:
            if "the scheduler is gone" in str(error) or attempt == 29:
                raise
            time.sleep(1.0)
