"""A triad in one case: its model, its compensation, and how that is published.

Components ax, ay, az and gx, gy, gz have the axes (i, j, k) = xyz, yzx, zxy of the case. Without an
orientation reference the rotation of the case is free; the gain matrix I + M of the accelerometers, or of
gyroscopes alone, is then upper triangular: the sensor's z axis is the case's, its y axis in its y-z plane.
Gyroscopes beside them have the whole matrix, for the accelerometers say how the case lies.

Its axes lie as a rotation of all three, and the angles between them, say. The input axis of component a is
the direction of its row of the gain matrix I + M. Three axes have six small angles: the rotation psi of the
triad as a whole, and by how much each angle between two axes is short of 90 deg, ``nu_ab``. With the linear
coefficients m_ab (response of a to an input along b, over the scale)::

    psi_x = (m_yz - m_zy) / 2,  and so on round x, y, z
    nu_xy = m_xy + m_yx

A rotation rho of the case in its fixture adds to psi and leaves nu as it is, so that angles between axes, and
the rotation of one triad against another in the same case, are known better than the misalignments that they
come of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import posterior_root
from imubayes.errors import ConvergenceError
from imubayes.inference.summary import Summary
from imubayes.sensors.imu import (
    ACCELEROMETERS,
    COMPONENTS,
    GYROSCOPES,
    PERMUTATION,
    Component,
    Imu,
    ideal,
    kind_of,
    signals,
)
from imubayes.sensors.imu_compensation import inverted, missed
from imubayes.sensors.terms import Kind, Library, columns

LINEAR = ("b1", "m_j", "m_k")
"""Terms of a row of the gain, along i, j, k."""

BELOW_DIAGONAL = ((), ("m_k",), ("m_j", "m_k"))
"""Misalignments that the choice of the case axes sets to zero."""

ROUNDS = 50
"""Most fixed-point steps of a compensation: each gains the digits that the coefficients are small by."""


@dataclass(frozen=True, slots=True, eq=False)
class Triad:
    """Model of the x, y and z component, of one kind, at known coefficients theta (p,) of all three, SI."""

    libraries: tuple[Library, Library, Library]
    theta: FloatArray

    @property
    def kind(self) -> Kind:
        """Accelerometer or gyroscope."""
        return self.libraries[0].kind

    @property
    def components(self) -> tuple[str, ...]:
        """``ax ay az`` or ``gx gy gz``."""
        return ACCELEROMETERS if self.kind == "accelerometer" else GYROSCOPES

    @property
    def names(self) -> tuple[str, ...]:
        """``ax.b0`` ... ``az.c_kk``."""
        named = zip(self.components, self.libraries, strict=True)
        return tuple(f"{c}.{n}" for c, lib in named for n in lib.names)

    def regressors(self, own: FloatArray, other: FloatArray | None = None) -> tuple[FloatArray, ...]:
        """Columns of each component at inputs (m, 3) along the case axes: three (m, p_c).

        `own` is the specific force for accelerometers, the rate for gyroscopes, and `other` the other one of
        the two; None for zero.
        """
        quantities = "fw" if self.kind == "accelerometer" else "wf"
        given = [(quantities[0], own)] if other is None else [*zip(quantities, (own, other), strict=True)]
        return tuple(
            columns(
                lib,
                {f"{q}_{axis}": v[:, c] for q, v in given for axis, c in zip("ijk", order, strict=True)},
                len(own),
            )
            for lib, order in zip(self.libraries, PERMUTATION, strict=True)
        )

    def parts(self) -> list[FloatArray]:
        """Coefficients of each component."""
        ends = np.cumsum([len(lib.terms) for lib in self.libraries])[:-1]
        return np.split(self.theta, ends)

    def compensate(self, y: FloatArray, other: FloatArray | None = None) -> FloatArray:
        """Own input (m, 3) of outputs y (m, 3); `other` as in `regressors`.

        It is a `ConvergenceError` if that does not settle: nominal scale or coefficients are far off.
        """
        beside = np.zeros_like(y) if other is None else other
        pair = (y, beside) if self.kind == "accelerometer" else (beside, y)
        imu, outputs = self._imu(), signals(*pair)
        x = inverted(imu, outputs, np.full(6, np.inf), ROUNDS)
        own = np.ascontiguousarray(np.hsplit(x, 2)[0 if pair[0] is y else 1])
        if missed(imu, outputs, x) <= 1e-13 * np.max(np.abs(y), initial=0.0):
            return own
        raise ConvergenceError(
            "the compensation of the triad does not settle: check scale and offset of its columns", own
        )

    def _imu(self) -> Imu:
        """The triad in its case, beside an ideal one of the other kind."""
        parts = zip(self.components, self.libraries, self.parts(), strict=True)
        own = {name: Component(lib, theta) for name, lib, theta in parts}
        return Imu(tuple(own.get(name) or ideal(kind_of(name)) for name in COMPONENTS), np.zeros((3, 3)))

    def gain(self) -> FloatArray:
        """I + M, (3, 3): the linear response along the case axes."""
        matrix = np.eye(3)
        parts = zip(matrix, self.libraries, self.parts(), PERMUTATION, strict=True)
        for row, lib, theta, order in parts:
            for name, axis in zip(LINEAR, order, strict=True):
                if name in lib.names:
                    row[axis] += theta[lib.names.index(name)]
        return matrix


def spans(quantity: str, values: FloatArray) -> dict[str, tuple[float, float]]:
    """Smallest and largest values of vectors (n, 3) along each case axis, by channel.

    Examples
    --------
    >>> spans("f", np.array([[0.0, 1.0, 2.0], [3.0, -1.0, 2.0]]))
    {'f_x': (0.0, 3.0), 'f_y': (-1.0, 1.0), 'f_z': (2.0, 2.0)}
    """
    ends = zip("xyz", values.T, strict=True)
    return {f"{quantity}_{axis}": (float(v.min()), float(v.max())) for axis, v in ends}


def triad_of(lib: Library, *, referenced: bool = False) -> Triad:
    """Triad of three alike components, all coefficients zero.

    It is `referenced` where directions are known, of gyroscopes also from the accelerometers beside them;
    without, the rotation of the case is fixed.
    """
    dropped = ((), (), ()) if referenced else BELOW_DIAGONAL
    libraries = tuple(replace(lib, terms=tuple(t for t in lib.terms if t.name not in out)) for out in dropped)
    x, y, z = libraries
    return Triad((x, y, z), np.zeros(sum(len(part.terms) for part in libraries)))


def calibration(
    triad: Triad, nominal: Sequence[tuple[float, float]], *, alone: bool = False
) -> tuple[dict[str, object], ...]:
    """Compensation of the x, y and z component, as calibration tools publish it.

    With raw numbers r, ``f = T K (r - bias)``: K is diagonal, T has ones on its diagonal and is upper
    triangular where no direction is known, from ``T K = (I + M)^-1 diag(scale)``: imu_tk's form and signs.
    Of each component: ``scale`` (SI per file unit), ``bias`` (file units), ``nonorthogonality`` (rad, by the
    term that causes it), ``convention``.

    Parameters
    ----------
    triad : at the coefficients to publish.
    nominal : (scale in SI per file unit, offset in file units) that made SI outputs of each column.
    alone : whether gyroscopes have no accelerometers beside them that say how the case lies.
    """
    letter, form = "f" if triad.kind == "accelerometer" else "w", "T with"
    case = "the case is that of the known directions"
    if triad.kind == "gyroscope" and not alone:
        case = "the case is that which the accelerometers are given in"
    elif "m_k" not in triad.libraries[1].names:
        form = "T upper triangular with"
        case = "the sensor's z axis is the case's, its y axis lies in the case's y-z plane"
    convention = (
        f"{letter} = T K (raw - bias), K diagonal (scale), {form} ones on the diagonal: {case}. Entries of T"
        " have the opposite sign of the misalignments m of the model, which go from input to output."
    )
    T = np.linalg.inv(triad.gain())
    parts = zip(triad.parts(), triad.libraries, strict=True)
    bias = [float(theta[lib.names.index("b0")]) for theta, lib in parts]
    rows = []
    for c, ((scale, offset), order) in enumerate(zip(nominal, PERMUTATION, strict=True)):
        across = zip(("m_j", "m_k"), order[1:], strict=True)
        names = [(name, axis) for name, axis in across if name in triad.libraries[c].names]
        rows.append(
            {
                "scale": float(T[c, c]) * scale,
                "bias": offset + bias[c] / scale,
                "nonorthogonality": {name: float(T[c, axis] / T[axis, axis]) for name, axis in names},
                "convention": convention,
            }
        )
    return tuple(rows)


STEP = 1e-6
"""Change of a coefficient for the derivatives: their curvature over it is below 1e-9."""

RELATIVE = "gyroscopes against accelerometers"
"""What the rotation between two triads is of."""


@dataclass(frozen=True, slots=True)
class Angle:
    """An angle of the axes in a case, rad: ``rotation_x``, ``nonorthogonality_xy``, ...

    It is of ``accelerometer``, of ``gyroscope``, or of the one triad against the other (`RELATIVE`). A
    rotation is right-handed about its axis, from the case's axes to the triad's, and an angle between two
    axes is 90 deg less the non-orthogonality.
    """

    name: str
    of: str
    mean: float
    sd: float


def angles_of(triads: Sequence[Triad], summary: Summary, sd: FloatArray) -> tuple[Angle, ...]:
    """Angles of the axes of triads in one case, from their joint posterior.

    The triads have all misalignments in their libraries; others have no rotation of their own. The summary is
    over the terms ``ax.b0`` ... of all components, whose prior sds are `sd` (p,), SI.
    """
    columns = [f"{name}.{term}" for triad in triads for name in triad.components for term in LINEAR]
    if not columns or any(name not in summary.names for name in columns):
        return ()
    where = [summary.names.index(name) for name in columns]
    mean, root = posterior_root(summary.factor, sd)
    steps = STEP * np.eye(len(where))
    slopes = [(_angles(mean[where] + s) - _angles(mean[where] - s)) / (2.0 * STEP) for s in steps]
    spread = np.linalg.norm(np.column_stack(slopes) @ root[where], axis=1)
    rotations = [f"rotation_{axis}" for axis in "xyz"]
    between = [f"nonorthogonality_{'xyz'[a]}{'xyz'[b]}" for a, b, _ in PERMUTATION]
    labels = [(name, triad.kind) for triad in triads for name in (*rotations, *between)]
    labels += [(name, RELATIVE) for _ in pairwise(triads) for name in rotations]
    return tuple(
        Angle(name, of, float(value), float(size))
        for (name, of), value, size in zip(labels, _angles(mean[where]), spread, strict=True)
    )


def _angles(theta: FloatArray) -> FloatArray:
    """Angles of each triad, then of each against the one before, at linear coefficients (9 a triad,).

    Of a triad rotations about x, y, z and non-orthogonalities xy, yz, zx, of rows (3, 3) of b1, m_j, m_k.
    """
    found = []
    for rows in theta.reshape(-1, 3, 3):
        axes = np.eye(3)
        for row, coefficients, order in zip(axes, rows, PERMUTATION, strict=True):
            row[list(order)] += coefficients
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        turned = [(axes[b, c] - axes[c, b]) / 2.0 for _, b, c in PERMUTATION]
        found.append(np.array([*turned, *(np.arcsin(axes[a] @ axes[b]) for a, b, _ in PERMUTATION)]))
    against = [after[:3] - before[:3] for before, after in pairwise(found)]
    return np.concatenate([*found, *against])
