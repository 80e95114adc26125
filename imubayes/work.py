"""Work that takes long: who does it, and what somebody who waits is told.

It is done by processes of this machine, or the workers of a dask scheduler; or by one beside this one. The
first two give each job's result with its index as it is done, and `Lost` for a job that ends its process
whenever it is tried: a process that dies costs only its job. The only module that knows dask.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe, connection, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

from imubayes.errors import InputError

Found = TypeVar("Found")

AHEAD = 2
"""Jobs in flight for each process: one that it does, and one that waits so that it need not."""

AHEAD_ON_DASK = 4
"""Jobs in flight for each thread of the workers: the scheduler always has one to give."""

HOPELESS = 4
"""Jobs that end their processes, before any other is done, from which it is not the jobs."""

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1"
)
"""What libraries of linear algebra read as they are loaded, later than a process begins."""

LOCAL = "local"
"""Name of the processes of this machine, in place of a scheduler's address."""

REACH = 5.0
"""s in which a scheduler answers, and has a worker."""

ABANDONED = 60.0
"""s without any worker, as when a cluster restarts, after which nobody is waited for."""

THREADS = Path("/proc/self/task")
"""Folder of the threads of this process, those of libraries too, where the system is Linux."""

INSTALL = "pip install 'imubayes[dask]'"

Job = tuple[Any, ...]
Done = Iterator[tuple[int, Any]]
"""Index and result of each job, as it is done."""

Begin = Callable[..., Callable[[], Any]]
"""Begin a job, a module's own function and its arguments; what it gives waits for the result."""

Engine = tuple[str, Callable[[Callable[..., Any], Sequence[Job]], Done]]
"""Who does the work: its name in words, and what takes a module's own function and each call's arguments."""


class Progress(Protocol):
    """Who is told; work that can be counted says what share of it, 0 to 1, is done, and the rest nothing."""

    def __call__(self, doing: str, share: float | None = None, /) -> None:
        """Say what goes on."""


def silent(doing: str, share: float | None = None, /) -> None:
    """Tell nobody."""


def part_of(tell: Progress, done: int, total: int, name: str = "") -> Progress:
    """Tell of one of `total` like pieces of work, `done` of which are: its own share is one of the whole.

    Examples
    --------
    >>> part_of(lambda doing, share: print(f"{doing}, {share:.2f}"), 1, 4, "B: ")("noise", 0.5)
    B: noise, 0.38
    """

    def told(doing: str, share: float | None = None, /) -> None:
        of_all = share if total == 1 else (done + (share or 0.0)) / total
        tell(f"{name}{doing}", of_all)

    return told


@dataclass(frozen=True, slots=True)
class Lost:
    """In place of the result of a job that ended its process, not only once."""


def shared(
    work: Callable[..., Found],
    jobs: Sequence[Job],
    processes: int,
    *,
    things: str,
    progress: Progress = silent,
) -> list[Found]:
    """Do every job: what `work` gives for each, in the order of the jobs, whatever the number of processes.

    `work` is a module's own function, of a job's parts, called in another process unless there is only one;
    each leaves linear algebra to one thread. `things` are what a job is about, in words, for `progress`. It
    is a `ChildProcessError` if a job ends its process twice, or processes end as soon as they start.

    Examples
    --------
    >>> shared(pow, [(2, 3), (3, 2)], 1, things="powers")
    [8, 9]
    """
    found = dict[int, Found]()
    for index, one in as_done(work, jobs, processes):
        if isinstance(one, Lost):
            raise ChildProcessError(f"one of {len(jobs)} {things} ended its process twice: is memory short?")
        found[index] = one
        progress(f"{len(found)} of {len(jobs)} {things}", len(found) / len(jobs))
    return [found[index] for index in range(len(jobs))]


def as_done(
    work: Callable[..., Found], jobs: Sequence[Job], processes: int
) -> Iterator[tuple[int, Found | Lost]]:
    """Do every job; give its index and result as it is done.

    When a process dies (killed, or out of memory), the jobs that were in flight are done again, one at a time
    in a process of their own. A job that ends this one too is `Lost`; the others go on. It is a
    `ChildProcessError` if processes end as soon as they start, whatever they are to do.
    """
    if processes == 1:
        yield from ((index, work(*job)) for index, job in enumerate(jobs))
        return
    left, lost = dict(enumerate(jobs)), 0
    while left:
        suspects = yield from _until_one_dies(work, left, processes, AHEAD * processes)
        alone = {index: left.pop(index) for index in suspects}
        while alone:
            for index in (yield from _until_one_dies(work, alone, 1, 1)):
                del alone[index]
                lost += 1
                if HOPELESS <= lost == len(jobs) - len(left) - len(alone):
                    raise ChildProcessError("processes end as soon as they start: is memory short?")
                yield index, Lost()


def elsewhere(work: Callable[..., Found], *job: Any) -> Found | Lost:
    """Do one job in a process of its own, which has all threads; `Lost` where that does not survive it.

    Examples
    --------
    >>> elsewhere(pow, 2, 3)
    8
    """
    return dict(_until_one_dies(work, {0: job}, 1, 1, one_thread=False)).get(0, Lost())


def _until_one_dies(
    work: Callable[..., Found], left: dict[int, Job], processes: int, ahead: int, *, one_thread: bool = True
) -> Generator[tuple[int, Found], None, list[int]]:
    """Give results and take their jobs from `left`; return those of the `ahead` in flight when one died."""
    queue, flight = iter(list(left)), dict[Future[Found], int]()
    with _begun(processes, one_thread=one_thread) as submit:
        try:
            while left:
                for _, index in zip(range(ahead - len(flight)), queue, strict=False):
                    flight[submit(work, *left[index])] = index
                done, _ = wait(flight, return_when=FIRST_COMPLETED)
                # those of broken processes come last
                for future in sorted(done, key=lambda one: isinstance(one.exception(), BrokenProcessPool)):
                    found = future.result()
                    index = flight.pop(future)
                    del left[index]
                    yield index, found
        except BrokenProcessPool:
            return sorted(index for index in flight.values() if index in left)
    return []


@contextmanager
def _begun(
    processes: int, *, start: str = "spawn", one_thread: bool = True
) -> Iterator[Callable[..., Future[Any]]]:
    """Processes of their own, which end with the block, and what gives them a job."""
    held, own = Pipe(duplex=False)
    begun = {"mp_context": get_context(start), "initializer": _alone, "initargs": (held, own, one_thread)}
    with held, own, ProcessPoolExecutor(processes, **begun) as pool:

        def submit(work: Callable[..., Found], *job: Any) -> Future[Found]:
            with _uninterrupted():
                return pool.submit(work, *job)

        try:
            yield submit
        finally:
            # nobody waits for jobs that are in flight, nor for processes to take down what they have loaded
            own.close()


def here(work: Callable[..., Found], *job: Any) -> Callable[[], Found]:
    """Do a job in this process, when its result is waited for."""
    return partial(work, *job)


@contextmanager
def beside() -> Iterator[Begin]:
    """Give what begins jobs in a process beside this one, one after the other.

    It is a fork of this one, with all that is loaded, where Linux tells that this one has no second thread.
    With one core, or where that process ends before its time, a job is done `here`.
    """
    if cores() == 1:
        yield here
        return
    with _begun(1, start="fork" if len(list(THREADS.glob("*"))) == 1 else "spawn") as submit:

        def begin(work: Callable[..., Found], *job: Any) -> Callable[[], Found]:
            own = here(work, *job)
            try:
                future = submit(work, *job)
            except BrokenProcessPool:
                return own

            def waited() -> Found:
                try:
                    return future.result()
                except BrokenProcessPool:
                    return own()

            return waited

        yield begin


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold an interrupt from the keyboard back; a process that is started here does not know it at all.

    It would say so in a traceback of its own, before it could be told not to.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _alone(held: Connection, own: Connection, one_thread: bool) -> None:
    """Leave linear algebra to one thread, where processes share the cores, and interrupts to the parent.

    `held` is a pipe whose other end is the parent's `own`: this process ends when that is closed, or dies
    with the parent. One that worked for nobody would hold its core, and make others look slow.
    """
    from threadpoolctl import threadpool_limits

    own.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if one_thread:
        os.environ.update(ONE_THREAD)
        threadpool_limits(1)

    def follow() -> None:
        connection.wait([held])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def engine(scheduler: str, processes: int) -> Iterator[Engine]:
    """Give who does the work for as long as the block lasts.

    That is a dask scheduler at an address such as ``tcp://10.0.0.5:8786``, or, in place of one, ``local``: so
    many processes of this machine. It is an `InputError` if no address is given, dask is not installed, the
    scheduler does not answer, or its workers lack imubayes.
    """
    if scheduler == LOCAL:
        what = "process" if processes == 1 else "processes"
        yield f"{processes} {what} of this machine", lambda work, jobs: as_done(work, jobs, processes)
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
        name = f"{workers} {what} of the dask scheduler {scheduler}"
        yield name, lambda work, jobs: _on_dask(client, work, jobs)
    finally:
        client.close()


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError(
            f"--scheduler {address}: needs dask, which is not installed: {INSTALL}, or leave --scheduler out"
        ) from None
    try:
        # knock at an address: a client that cannot connect lingers
        import socket

        from distributed.comm.addressing import get_address_host_port

        with socket.create_connection(get_address_host_port(address), timeout=REACH):
            pass
        return Client(address, timeout=REACH, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no dask scheduler answers there ({error}): expected an address such as "
            "tcp://127.0.0.1:8786, as 'dask scheduler' prints it when it starts; without --scheduler the "
            "work is done on this machine"
        ) from None


def _checked_workers(client: Any, address: str) -> int:
    """Number of workers, all with this version of imubayes."""
    from importlib.metadata import version

    from imubayes import __version__ as own

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
    """Keep the workers in work; the scheduler gives what a worker was at when it died to another."""
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    queue, flight = iter(enumerate(jobs)), dict[Any, int]()
    try:
        while True:
            room = max(AHEAD_ON_DASK, AHEAD_ON_DASK * sum(client.nthreads().values()))
            for _, (index, job) in zip(range(room - len(flight)), queue, strict=False):
                flight[client.submit(work, *job, pure=False)] = index
            if not flight:
                return
            for future in _first_done(client, flight):
                killed = isinstance(future.exception(), KilledWorker)
                yield flight.pop(future), Lost() if killed else future.result()
    except (CommClosedError, CancelledError):
        raise InputError(
            "the scheduler is gone: start it, and run again with --resume, which keeps what is finished"
        ) from None


def _first_done(client: Any, flight: dict[Any, int]) -> list[Any]:
    """Wait for the first jobs that are done, unless there is no worker for a while."""
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
