"""Who does the work: processes of this machine, or the workers of a dask scheduler.

Both give each job's result with its index as it is done, and `processes.Lost` for a job that ends its process
whenever it is tried. The only module that knows dask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from imubayes.errors import InputError
from imubayes.population.processes import Lost, as_done

LOCAL = "local"
"""Name of the processes of this machine, in place of a scheduler's address."""

REACH = 5.0
"""s in which a scheduler answers, and has a worker."""

ABANDONED = 60.0
"""s without any worker, as when a cluster restarts, after which nobody is waited for."""

AHEAD = 4
"""Jobs in flight for each thread of the workers: the scheduler always has one to give."""

INSTALL = "pip install 'imubayes[dask]'"

Job = tuple[Any, ...]
Done = Iterator[tuple[int, Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Engine:
    """Who does the work.

    Attributes
    ----------
    name : in words.
    do : takes a module's own function and the arguments of each call, gives (index, result) as they are done.
    """

    name: str
    do: Callable[[Callable[..., Any], Sequence[Job]], Done]


@contextmanager
def engine(scheduler: str, processes: int) -> Iterator[Engine]:
    """Give who does the work for as long as the block lasts.

    Parameters
    ----------
    scheduler : address of a dask scheduler such as ``tcp://10.0.0.5:8786``, or ``local``.
    processes : of this machine that share the work where no scheduler does.

    Raises
    ------
    InputError : if no address is given, dask is not installed, the scheduler does not answer, or its workers
        lack imubayes.
    """
    if scheduler == LOCAL:
        what = "process" if processes == 1 else "processes"
        yield Engine(f"{processes} {what} of this machine", partial(_local, processes))
        return
    if not scheduler.strip():
        raise InputError(
            "--scheduler: came an empty text: expected an address such as tcp://127.0.0.1:8786; without "
            "--scheduler the work is done on this machine"
        )
    client = _connected(scheduler)
    try:
        workers = _checked_workers(client, scheduler)
        what = "worker" if workers == 1 else "workers"
        yield Engine(f"{workers} {what} of the dask scheduler {scheduler}", partial(_on_dask, client))
    finally:
        client.close()


def _local(processes: int, work: Callable[..., Any], jobs: Sequence[Job]) -> Done:
    return as_done(work, jobs, processes)


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError(
            f"--scheduler {address}: needs dask, which is not installed: {INSTALL}, or leave --scheduler out"
        ) from None
    try:
        _reached(address)
        return Client(address, timeout=REACH, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no dask scheduler answers there ({error}): expected an address such as "
            "tcp://127.0.0.1:8786, as 'dask scheduler' prints it when it starts; without --scheduler the "
            "work is done on this machine"
        ) from None


def _reached(address: str) -> None:
    """Knock at an address: a client that cannot connect lingers.

    Raises
    ------
    OSError, ValueError : if nobody is there, or it is no address.
    """
    import socket

    from distributed.comm.addressing import get_address_host_port

    with socket.create_connection(get_address_host_port(address), timeout=REACH):
        pass


def _version() -> str:
    """Version of imubayes that is installed here."""
    from importlib.metadata import version

    return version("imubayes")


def _checked_workers(client: Any, address: str) -> int:
    """Number of workers, all with this version of imubayes."""
    from importlib.metadata import version

    own = _version()
    try:
        client.wait_for_workers(1, timeout=REACH)
    except TimeoutError:
        raise InputError(
            f"--scheduler {address}: the scheduler has no workers: start some, 'dask worker {address} "
            "--nthreads 1', one for each core"
        ) from None
    found = client.run(version, "imubayes", on_error="return")
    for worker, answer in found.items():
        if answer != own:
            has = f"imubayes {answer}" if isinstance(answer, str) else "no imubayes"
            raise InputError(
                f"--scheduler {address}: worker {worker} has {has}: install imubayes {own} there, {INSTALL}"
            )
    return len(found)


def _on_dask(client: Any, work: Callable[..., Any], jobs: Sequence[Job]) -> Done:
    """Do the jobs on the workers.

    Raises
    ------
    InputError : if the scheduler is gone, or all its workers are.
    """
    from distributed.comm.core import CommClosedError

    try:
        yield from _shared_out(client, work, jobs)
    except (CommClosedError, CancelledError):
        raise InputError(
            "the scheduler is gone: start it, and run again with --resume, which keeps what is finished"
        ) from None


def _shared_out(client: Any, work: Callable[..., Any], jobs: Sequence[Job]) -> Done:
    """Keep the workers in work; the scheduler gives what a worker was at when it died to another."""
    queue, flight = iter(enumerate(jobs)), dict[Any, int]()
    while True:
        room = max(AHEAD, AHEAD * sum(client.nthreads().values()))
        for _, (index, job) in zip(range(room - len(flight)), queue, strict=False):
            flight[client.submit(work, *job, pure=False)] = index
        if not flight:
            return
        for future in _landed(client, flight):
            yield flight.pop(future), _result(future)


def _landed(client: Any, flight: dict[Any, int]) -> list[Any]:
    """Wait for the first jobs that are done.

    Raises
    ------
    InputError : if there is no worker for a while.
    """
    from distributed import wait

    while True:
        try:
            with client.as_current():
                found: Any = wait(list(flight), timeout=ABANDONED, return_when="FIRST_COMPLETED")
            return list(found.done)
        except TimeoutError:
            if not client.nthreads():
                raise InputError(
                    f"all workers of the scheduler are gone for {ABANDONED:.0f} s: start some, and run again "
                    "with --resume, which keeps what is finished"
                ) from None


def _result(future: Any) -> Any:
    from distributed.scheduler import KilledWorker

    error = future.exception()
    if isinstance(error, KilledWorker):
        return Lost()
    if error is not None:
        raise error
    return future.result()
