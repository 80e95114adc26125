"""A triad of accelerometers in one case: its model, its compensation, and how that is published.

Components ax, ay, az have the axes (i, j, k) = xyz, yzx, zxy of the case. Without an orientation reference
the rotation of the case is free; the gain matrix I + M is then taken upper triangular: the sensor's z axis is
the case's, and its y axis lies in the case's y-z plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import ConvergenceError
from imubayes.sensors.terms import Library, columns

FloatArray = NDArray[np.float64]

COMPONENTS = ("ax", "ay", "az")

PERMUTATION = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Case axes of (i, j, k) of each component."""

BELOW_DIAGONAL = ((), ("m_k",), ("m_j", "m_k"))
"""Misalignments that the choice of the case axes sets to zero."""

ROUNDS = 50
"""Most fixed-point steps of a compensation: each gains the digits that the coefficients are small by."""


@dataclass(frozen=True, slots=True, eq=False)
class Triad:
    """Model of the three components at known coefficients.

    Attributes
    ----------
    libraries : of ax, ay, az.
    theta : (p,) coefficients of all three, SI.
    """

    libraries: tuple[Library, Library, Library]
    theta: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """``ax.b0`` ... ``az.c_kk``."""
        return tuple(f"{c}.{n}" for c, lib in zip(COMPONENTS, self.libraries, strict=True) for n in lib.names)

    def regressors(self, f: FloatArray) -> tuple[FloatArray, ...]:
        """Columns of each component at specific forces f (m, 3) along the case axes: three (m, p_c)."""
        return tuple(
            columns(
                lib, {f"f_{axis}": f[:, column] for axis, column in zip("ijk", order, strict=True)}, len(f)
            )
            for lib, order in zip(self.libraries, PERMUTATION, strict=True)
        )

    def parts(self) -> list[FloatArray]:
        """Coefficients of each component."""
        ends = np.cumsum([len(lib.terms) for lib in self.libraries])[:-1]
        return np.split(self.theta, ends)

    def deviation(self, f: FloatArray) -> FloatArray:
        """Output minus input (m, 3) at specific forces f (m, 3)."""
        parts = zip(self.regressors(f), self.parts(), strict=True)
        return np.column_stack([X @ theta for X, theta in parts])

    def compensate(self, y: FloatArray) -> FloatArray:
        """Specific force (m, 3) of outputs y (m, 3), by fixed-point iteration.

        Raises
        ------
        ConvergenceError : if it does not settle: the nominal scale is far off, or the coefficients are.
        """
        f = y
        for _ in range(ROUNDS):
            new = y - self.deviation(f)
            if np.max(np.abs(new - f)) <= 1e-13 * np.max(np.abs(y)):
                return new
            f = new
        raise ConvergenceError(
            "the compensation of the triad does not settle: check scale and offset of its columns", f
        )

    def gain(self) -> FloatArray:
        """I + M, (3, 3): the linear response along the case axes."""
        matrix = np.eye(3)
        for row, (lib, theta, order) in enumerate(
            zip(self.libraries, self.parts(), PERMUTATION, strict=True)
        ):
            for name, axis in zip(("b1", "m_j", "m_k"), order, strict=True):
                if name in lib.names:
                    matrix[row, axis] += theta[lib.names.index(name)]
        return matrix


def triad_of(lib: Library) -> Triad:
    """Triad of three alike components, with the rotation fixed and all coefficients zero."""
    libraries = tuple(
        Library(lib.kind, tuple(t for t in lib.terms if t.name not in dropped)) for dropped in BELOW_DIAGONAL
    )
    x, y, z = libraries
    return Triad((x, y, z), np.zeros(sum(len(part.terms) for part in libraries)))


def calibration(triad: Triad, nominal: Sequence[tuple[float, float]]) -> tuple[dict[str, object], ...]:
    """Compensation of each component, as calibration tools publish it.

    With raw numbers r, ``f = T K (r - bias)``: K is diagonal, T upper triangular with ones on its diagonal,
    from ``T K = (I + M)^-1 diag(scale)``. This is imu_tk's form, and its signs.

    Parameters
    ----------
    triad : at the coefficients to publish.
    nominal : (scale in SI per file unit, offset in file units) that made SI outputs of each column.

    Returns
    -------
    for ax, ay, az: ``scale`` (SI per file unit), ``bias`` (file units), ``nonorthogonality`` (rad, by the
    term that causes it), ``convention``.
    """
    T = np.linalg.inv(triad.gain())
    parts = zip(triad.parts(), triad.libraries, strict=True)
    bias = [float(theta[lib.names.index("b0")]) for theta, lib in parts]
    rows = []
    for c, ((scale, offset), order) in enumerate(zip(nominal, PERMUTATION, strict=True)):
        names = [(name, axis) for name, axis in zip(("m_j", "m_k"), order[1:], strict=True) if axis > c]
        rows.append(
            {
                "scale": float(T[c, c]) * scale,
                "bias": offset + bias[c] / scale,
                "nonorthogonality": {name: float(T[c, axis] / T[axis, axis]) for name, axis in names},
                "convention": CONVENTION,
            }
        )
    return tuple(rows)


CONVENTION = (
    "f = T K (raw - bias), K diagonal (scale), T upper triangular with ones on the diagonal: the sensor's"
    " z axis is the case's, its y axis lies in the case's y-z plane. Entries of T have the opposite sign of"
    " the misalignments m of the model, which go from force to output."
)
