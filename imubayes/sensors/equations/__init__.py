"""The component equations of the IEEE standards, and their mapping to the generalized coefficients.

A sensor's technology decides its standard (`standards_for`), and the standard the symbols that its terms are
shown with (`symbols`): nothing else spells them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from imubayes.errors import TermError
from imubayes.sensors.equations import basic, ieee517, ieee647, ieee813, ieee952, ieee1293, ieee1431
from imubayes.sensors.equations.mapping import FloatArray, Standard, Symbol
from imubayes.sensors.terms import Kind, Library

STANDARDS: Mapping[tuple[str, str], Standard] = {
    (standard.kind, standard.id): standard
    for standard in (
        ieee1293.STANDARD,
        basic.ACCELEROMETER,
        ieee952.STANDARD,
        ieee1431.STANDARD,
        ieee647.STANDARD,
        ieee517.STANDARD,
        ieee813.STANDARD_X,
        ieee813.STANDARD_Y,
        basic.GYROSCOPE,
    )
}
"""Every equation by kind and id."""

APPLIES: tuple[tuple[Kind, str, tuple[str, ...]], ...] = (
    ("accelerometer", "integrating gyro", ()),
    ("accelerometer", "piga", ()),
    ("accelerometer", "open-loop piezo", ()),
    ("accelerometer", "", ("ieee1293",)),
    ("gyroscope", "ifog", ("ieee952",)),
    ("gyroscope", "fiber", ("ieee952",)),
    ("gyroscope", "ring laser", ("ieee647",)),
    ("gyroscope", "cvg", ("ieee1431",)),
    ("gyroscope", "hemispherical", ("ieee1431",)),
    ("gyroscope", "mems", ("ieee1431",)),
    ("gyroscope", "rate-integrating", ("ieee517",)),
    ("gyroscope", "dynamically tuned", ("ieee813.x", "ieee813.y")),
    ("gyroscope", "spring-restrained", ()),
)
"""Kind, a phrase of the technology in lower case, and the standards of its equation; the first match counts.
IEEE 1293 leaves out the PIGA and open-loop piezoelectric sensors; the equation of IEEE 292 (spring-restrained
rate gyroscope) is not among ours. The basic triad applies to all."""


def standard(id: str, *, kind: str) -> Standard:
    """Equation by its id; a `TermError` lists those there are for the kind.

    Examples
    --------
    >>> standard("ieee952", kind="gyroscope").standard_only[:2]
    ('D_gradTdot,i', 'D_gradTdot,j')
    """
    if (kind, id) in STANDARDS:
        return STANDARDS[kind, id]
    ids = ", ".join(known_id for known_kind, known_id in STANDARDS if known_kind == kind)
    raise TermError(
        f"standard '{id}' has no equation of kind {kind}: expected {ids or 'accelerometer or gyroscope'}"
    )


def standards_for(kind: str, technology: str) -> tuple[str, ...]:
    """Ids of the equations that apply to a technology of the catalogue; the basic triad comes last.

    Examples
    --------
    >>> standards_for("gyroscope", "ring laser, mechanically dithered")
    ('ieee647', 'basic')
    """
    phrase = technology.lower()
    matches = (ids for known, part, ids in APPLIES if known == kind and part in phrase)
    return (*next(matches, ()), "basic")


def symbols(lib: Library) -> dict[str, str]:
    """Symbol of each term of a library in the standard of its technology, ``-`` where it has none.

    A gyroscope of no known technology has none: an ``eps_K`` is a gain in one standard, a divisor in another.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> laser = symbols(library("gyroscope", technology="small ring laser"))
    >>> mems = symbols(library("gyroscope", technology="CVG tuning-fork MEMS"))
    >>> laser["b1"], mems["b1"], mems["m_k"], mems["b3"]
    ('-eps_K', 'eps_K', '-a_X', '-')
    """
    own, *_ = standards_for(lib.kind, lib.technology)
    rows = standard(own, kind=lib.kind).symbols if own != "basic" else ()
    spelt = {row.term: row.of_term for row in rows if row.term}
    return {name: spelt.get(name, "-") for name in lib.names}


def in_standard(
    id: str, lib: Library, mean: FloatArray, cov: FloatArray
) -> tuple[tuple[Symbol, ...], FloatArray, FloatArray]:
    """Estimated coefficients as parameters of a standard.

    Parameters
    ----------
    id : of the standard (``ieee1293``, ``ieee952``, ``basic`` ...).
    lib : terms that were estimated; a parameter whose term is not among them is left out.
    mean : (p,) estimates in the library's order, SI.
    cov : (p, p) their covariance.

    Returns
    -------
    rows (r,) of the standard's table, their values and sds (r,) in SI, the sd by the mapping's linearisation
    at `mean`.

    Raises
    ------
    TermError : if there is no such standard for the library's kind, an array has the wrong shape, or the gain
        is not positive.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", powers=1, asymmetry=0)
    >>> mean = np.zeros(len(lib.terms)); mean[2] = 0.5e-3
    >>> rows, values, sd = in_standard("ieee1293", lib, mean, 1e-8 * np.eye(len(mean)))
    >>> [(float(v), round(float(e), 9)) for row, v, e in zip(rows, values, sd) if row.symbol == "K0'"]
    [(0.001, 0.0002)]
    """
    p = len(lib.terms)
    if np.shape(mean) != (p,) or np.shape(cov) != (p, p):
        raise TermError(
            f"the library has {p} terms: expected mean ({p},) and covariance ({p}, {p}),"
            f" got {np.shape(mean)} and {np.shape(cov)}"
        )
    rows, values, J = linearised(id, lib, mean)
    return rows, values, np.sqrt(np.maximum(np.einsum("rp,pq,rq->r", J, np.asarray(cov), J), 0.0))


def linearised(id: str, lib: Library, mean: FloatArray) -> tuple[tuple[Symbol, ...], FloatArray, FloatArray]:
    """Rows (r,) of a standard whose terms `lib` has, their values in SI at `mean` (p,), and the Jacobian.

    It is (r, p), exact by complex steps. A `TermError` as for `in_standard`.
    """
    known = standard(id, kind=lib.kind)
    rows = tuple(row for row in known.symbols if row.term in lib.names)
    mean = np.asarray(mean, dtype=np.float64)
    stepped = mean[:, None] + 1j * _STEP * np.eye(len(mean))
    p = known.from_general(dict(zip(lib.names, stepped, strict=True)))
    J = np.array([np.broadcast_to(np.imag(getattr(p, row.field)), len(mean)) for row in rows]) / _STEP
    exact = known.from_general(dict(zip(lib.names, mean, strict=True)))
    values = np.array([getattr(exact, row.field) for row in rows], dtype=np.float64)
    return rows, values, J


_STEP = 1e-30
"""Imaginary step: its square vanishes beside any coefficient, and nothing is subtracted."""
