"""How loops are compiled. With one set of options what several functions call is compiled once a process.

Apart, so that only what runs a compiled loop loads the compiler.
"""

from numba import njit

compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
"""Compile a function, keep it for later runs, and let other threads go on; a product and a sum may share a
rounding."""
