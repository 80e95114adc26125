"""How the axes of a triad lie: a rotation of all three, and the angles between them.

The input axis of component a is the direction of its row of the gain matrix I + M. Three axes have six small
angles: the rotation psi of the triad as a whole, and by how much each angle between two axes is short of
90 deg, ``nu_ab``. With the linear coefficients m_ab (response of a to an input along b, over the scale)::

    psi_x = (m_yz - m_zy) / 2,  and so on round x, y, z
    nu_xy = m_xy + m_yx

A rotation rho of the case in its fixture adds to psi and leaves nu as it is, so that angles between axes, and
the rotation of one triad against another in the same case, are known better than the misalignments that they
come of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import posterior_root
from imubayes.inference.summary import Summary
from imubayes.inference.triad import Triad
from imubayes.sensors.imu import PERMUTATION
from imubayes.sensors.terms import Kind

LINEAR = ("b1", "m_j", "m_k")
"""Terms of a row of the gain, along i, j, k."""

STEP = 1e-6
"""Change of a coefficient for the derivatives: their curvature over it is below 1e-9."""

RELATIVE = "gyroscopes against accelerometers"
"""What the rotation between two triads is of."""


@dataclass(frozen=True, slots=True)
class Angle:
    """An angle of the axes in a case, under the full library.

    Attributes
    ----------
    name : ``rotation_x``, ``nonorthogonality_xy``, ...
    of : ``accelerometer``, ``gyroscope``, or the rotation of the one triad against the other.
    mean, sd : rad; a rotation is right-handed about its axis, from the case's axes to the triad's, and an
        angle between two axes is 90 deg less the non-orthogonality.
    """

    name: str
    of: str
    mean: float
    sd: float


def angles_of(triads: Sequence[Triad], summary: Summary, sd: FloatArray) -> tuple[Angle, ...]:
    """Angles of the axes of triads in one case, from their joint posterior.

    Parameters
    ----------
    triads : whose misalignments are all in their libraries; others have no rotation of their own.
    summary : over the terms ``ax.b0`` ... of all components.
    sd : (p,) prior sds of its columns, SI.

    Examples
    --------
    >>> from imubayes.algebra.factor import Factor
    >>> from imubayes.inference.triad import triad_of
    >>> from imubayes.sensors.terms import library
    >>> triad = triad_of(library("gyroscope", powers=1, asymmetry=-1), referenced=True)
    >>> R = np.diag([1e3] * len(triad.names) + [0.0])
    >>> found = angles_of([triad], Summary(Factor(triad.names, R, 99)), np.ones(len(R) - 1))
    >>> [(angle.name, round(angle.sd, 6)) for angle in found[2:4]]
    [('rotation_z', 0.000707), ('nonorthogonality_xy', 0.001414)]
    """
    columns = [[_columns(triad, k) for k in range(3)] for triad in triads]
    flat = [name for rows in columns for row in rows for name in row]
    if not flat or any(name not in summary.names for name in flat):
        return ()
    where = [summary.names.index(name) for name in flat]
    mean, root = posterior_root(summary.factor, sd)
    values, slopes = _differentiated(mean[where])
    spread = np.linalg.norm(slopes @ root[where], axis=1)
    labels = _labels([triad.kind for triad in triads])
    return tuple(
        Angle(name, of, float(value), float(size))
        for (name, of), value, size in zip(labels, values, spread, strict=True)
    )


def _columns(triad: Triad, k: int) -> tuple[str, ...]:
    """Columns of a row of the gain, along i, j, k."""
    return tuple(f"{triad.components[k]}.{term}" for term in LINEAR)


def _labels(kinds: Sequence[Kind]) -> list[tuple[str, str]]:
    """Name of each angle, and what it is of, in the order of `_angles`."""
    rotations = [f"rotation_{axis}" for axis in "xyz"]
    between = [f"nonorthogonality_{'xyz'[a]}{'xyz'[b]}" for a, b, _ in PERMUTATION]
    own = [(name, kind) for kind in kinds for name in (*rotations, *between)]
    return own + [(name, RELATIVE) for _ in pairwise(kinds) for name in rotations]


def _differentiated(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles (m,) at linear coefficients (9 a triad,), and their derivatives (m, 9 a triad)."""
    steps = STEP * np.eye(len(theta))
    slopes = [(_angles(theta + step) - _angles(theta - step)) / (2.0 * STEP) for step in steps]
    return _angles(theta), np.column_stack(slopes)


def _angles(theta: FloatArray) -> FloatArray:
    """Angles of each triad, then of each triad against the one before."""
    found = [_of_triad(rows) for rows in theta.reshape(-1, 3, 3)]
    against = [after[:3] - before[:3] for before, after in pairwise(found)]
    return np.concatenate([*found, *against])


def _of_triad(rows: FloatArray) -> FloatArray:
    """Rotation about x, y, z and non-orthogonality xy, yz, zx of rows (3, 3) of b1, m_j, m_k."""
    axes = np.eye(3)
    for row, coefficients, order in zip(axes, rows, PERMUTATION, strict=True):
        row[list(order)] += coefficients
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turned = [(axes[b, c] - axes[c, b]) / 2.0 for _, b, c in PERMUTATION]
    return np.array([*turned, *(np.arcsin(axes[a] @ axes[b]) for a, b, _ in PERMUTATION)])
