"""Compiled work on several threads, with the same numbers whatever their number.

The work is cut in pieces that do not depend on the threads, and what the pieces give comes back in their
order. Plain threads carry it, since compiled code releases the interpreter's lock: numba's own threading
layers may not be entered from two threads at once, nor after a fork.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import parent_process
from typing import TypeVar

Found = TypeVar("Found")


def threads() -> int:
    """Threads that work may be shared by: ``NUMBA_NUM_THREADS``, by default one a core.

    One in a process that another Python started: such processes share the cores already.
    """
    from numba.core import config

    return 1 if parent_process() is not None else int(config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]


def pieces(work: Callable[[int], Found], count: int) -> list[Found]:
    """Do the pieces 0 ... count - 1 of a work.

    Parameters
    ----------
    work : of the number of a piece; compiled, and without the interpreter's lock where it takes time.
    count : of the pieces.

    Returns
    -------
    what `work` gives for each, in the order of their numbers.

    Examples
    --------
    >>> pieces(lambda k: k * k, 3)
    [0, 1, 4]
    """
    available = min(threads(), count)
    if available < 2:
        return [work(k) for k in range(count)]

    def every(first: int) -> list[Found]:
        return [work(k) for k in range(first, count, available)]

    with ThreadPoolExecutor(available) as pool:
        found = list(pool.map(every, range(available)))
    return [found[k % available][k // available] for k in range(count)]
