"""Work that several processes share, with word of how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

Progress = Callable[[str], None]
Found = TypeVar("Found")


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

    Examples
    --------
    >>> shared(pow, [(2, 3), (3, 2)], 1, things="powers")
    [8, 9]
    """
    start, found = time.perf_counter(), dict[int, Found]()
    for done, (index, one) in enumerate(_as_done(work, jobs, processes), 1):
        found[index] = one
        left = (time.perf_counter() - start) / done * (len(jobs) - done)
        progress(f"{done} of {len(jobs)} {things}, about {left / 60.0:.0f} min left")
    return [found[index] for index in range(len(jobs))]


def _as_done(
    work: Callable[..., Found], jobs: Sequence[tuple[Any, ...]], processes: int
) -> Iterator[tuple[int, Found]]:
    """What each job gives, with its index, as they are done."""
    if processes == 1:
        yield from ((index, work(*job)) for index, job in enumerate(jobs))
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_alone) as pool:
        index = {pool.submit(work, *job): k for k, job in enumerate(jobs)}
        yield from ((index[done], done.result()) for done in as_completed(index))


def _alone() -> None:
    """Leave linear algebra to one thread: the processes share the cores."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
