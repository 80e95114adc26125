"""How loops are compiled. With one set of options what several functions call is compiled once a process.

Apart, so that only what runs a compiled loop loads the compiler. A cache of compiled functions does not see
that options change here: it has to be removed. It names the classes of what a loop takes: one that is renamed
cannot be read from what an earlier version compiled, and ends in a traceback.

What makes the compiler slow stays out of the loops: a slice that is assigned, whose error message on shapes
is compiled with it (1 to 3 s); a literal number that one loop passes to another, which is compiled for it
once more, as it is not for ``np.int64(0)``; arrays of a second layout, such as rows of one that is unpacked.
"""

from functools import partial
from typing import Any, cast

from numba import njit

# C calls none of them: no wrapper for it is compiled
_loop = partial(cast("Any", njit), cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)

compiled = _loop(fastmath={"contract"})
"""Compile a function, keep it for later runs, and let other threads go on; a product and a sum may share a
rounding."""

reordered = _loop(fastmath={"reassoc", "contract"})
"""As `compiled`, of a function whose sums may be added up in any order, as vectors."""

strict = _loop()
"""As `compiled`, where each rounding counts: in sums in twice the digits, and before a sign is taken."""

inlined = _loop(inline="always")
"""Copy a function into those that call it, whose options it has."""

inner = _loop(fastmath={"contract"}, no_cpython_wrapper=True)
"""As `compiled`, of a function that only compiled ones call."""
