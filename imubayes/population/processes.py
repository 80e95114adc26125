"""Work that several processes share, with word of how far it is; a process that dies costs only its job."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import Pipe, connection, get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

Progress = Callable[[str], None]
Found = TypeVar("Found")

AHEAD = 2
"""Jobs in flight for each process: one that it does, and one that waits so that it need not."""

HOPELESS = 4
"""Jobs that end their processes, before any other is done, from which it is not the jobs."""


ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1"
)
"""What libraries of linear algebra read as they are loaded, later than a process begins."""


@dataclass(frozen=True, slots=True)
class Lost:
    """In place of the result of a job that ended its process, not only once."""


def shared(
    work: Callable[..., Found],
    jobs: Sequence[tuple[Any, ...]],
    processes: int,
    *,
    things: str,
    progress: Progress = lambda message: None,
) -> list[Found]:
    """Do every job.

    Parameters
    ----------
    work : a module's own function, of a job's parts; called in another process unless there is only one.
    jobs : arguments of each call.
    processes : that share the work; each leaves linear algebra to one thread.
    things : what a job is about, in words, for `progress`.
    progress : is told how many are done, and how long the others will take.

    Returns
    -------
    what `work` gives for each job, in the order of the jobs, whatever the number of processes.

    Raises
    ------
    ChildProcessError : if a job ends its process twice, or processes end as soon as they start.

    Examples
    --------
    >>> shared(pow, [(2, 3), (3, 2)], 1, things="powers")
    [8, 9]
    """
    tell, found = pace(len(jobs), things, progress), dict[int, Found]()
    for index, one in as_done(work, jobs, processes):
        if isinstance(one, Lost):
            raise ChildProcessError(f"one of {len(jobs)} {things} ended its process twice: is memory short?")
        found[index] = one
        tell(len(found))
    return [found[index] for index in range(len(jobs))]


def pace(total: int, things: str, progress: Progress) -> Callable[[int], None]:
    """Give what tells how many of `total` things are done, and how long the others will take."""
    start = time.perf_counter()

    def tell(done: int) -> None:
        left = (time.perf_counter() - start) / done * (total - done)
        progress(f"{done} of {total} {things}, about {left / 60.0:.0f} min left")

    return tell


def as_done(
    work: Callable[..., Found], jobs: Sequence[tuple[Any, ...]], processes: int
) -> Iterator[tuple[int, Found | Lost]]:
    """Do every job; give its index and result as it is done.

    When a process dies (killed, or out of memory), the jobs that were in flight are done again, one at a time
    in a process of their own. A job that ends this one too is `Lost`; the others go on.

    Raises
    ------
    ChildProcessError : if processes end as soon as they start, whatever they are to do.
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
    work: Callable[..., Found],
    left: dict[int, tuple[Any, ...]],
    processes: int,
    ahead: int,
    *,
    one_thread: bool = True,
) -> Generator[tuple[int, Found], None, list[int]]:
    """Give results and take their jobs from `left`; return those of the `ahead` in flight when one died."""
    queue, flight = iter(list(left)), dict[Future[Found], int]()
    held, own = Pipe(duplex=False)
    spawned = {"mp_context": get_context("spawn"), "initializer": _alone, "initargs": (held, one_thread)}
    with held, own, ProcessPoolExecutor(processes, **spawned) as pool:
        try:
            while left:
                for _, index in zip(range(ahead - len(flight)), queue, strict=False):
                    with _uninterrupted():
                        flight[pool.submit(work, *left[index])] = index
                yield from _landed(flight, left)
        except BrokenProcessPool:
            return sorted(index for index in flight.values() if index in left)
        except BaseException:
            # nobody waits for the jobs that are in flight any more: the pool would
            own.close()
            raise
    return []


def _landed(
    flight: dict[Future[Found], int], left: dict[int, tuple[Any, ...]]
) -> Iterator[tuple[int, Found]]:
    """Results that are there, those of broken processes last."""
    done, _ = wait(flight, return_when=FIRST_COMPLETED)
    for future in sorted(done, key=lambda one: isinstance(one.exception(), BrokenProcessPool)):
        found = future.result()
        index = flight.pop(future)
        del left[index]
        yield index, found


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


def _alone(held: Connection, one_thread: bool) -> None:
    """Leave linear algebra to one thread, where processes share the cores, and interrupts to the parent.

    `held` is a pipe whose other end only the parent has: this process ends when that is closed, or dies with
    the parent. One that worked for nobody would hold its core, and make others look slow.
    """
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if one_thread:
        os.environ.update(ONE_THREAD)
        threadpool_limits(1)

    def follow() -> None:
        connection.wait([held])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
