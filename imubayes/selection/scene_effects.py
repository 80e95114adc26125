"""Linear effect of coefficients in a scene: on the output, or on what the output is integrated to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.factor import row_blocks, triangular
from imubayes.rig.scenes import Scene, in_case
from imubayes.rig.vibration import mean_columns
from imubayes.selection.kernels import STATES, Budget, functionals
from imubayes.sensors.terms import Library, columns

FloatArray = NDArray[np.float64]

TIMES = 48
"""Times over the mission at which an error is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneEffects:
    """Linear effect of a library's coefficients on one quantity.

    Attributes
    ----------
    names : p terms.
    rows : (q, p) effect of a unit of each coefficient, SI.
    largest : whether the size of an effect is the largest of the rows; else their root sum of squares.
    """

    names: tuple[str, ...]
    rows: FloatArray
    largest: bool

    def size(self, theta: FloatArray) -> FloatArray:
        """Size (...) of the effect of coefficients (..., p), those that are left out being zero."""
        return self.sized(theta @ self.rows.T)

    def single(self, theta: FloatArray) -> FloatArray:
        """Size (..., p) of each coefficient's own effect."""
        return np.abs(theta) * self.sized(self.rows.T)

    def added(self, theta: FloatArray) -> float:
        """Size of the effects of coefficients (p,) of which none cancels another.

        Effects that are alike add in size, effects that have nothing to do with each other in squares.

        Examples
        --------
        >>> alike = SceneEffects(("a", "b"), np.array([[1.0, 1.0]]), largest=True)
        >>> alike.added(np.array([3.0, -2.0])), float(alike.size(np.array([3.0, -2.0])))
        (5.0, 1.0)
        """
        own = np.abs(theta * self.rows)
        if self.largest:
            return float(own.sum(axis=1).max())
        alike = np.abs(self.rows.T @ self.rows)
        return float(np.sqrt(np.abs(theta) @ alike @ np.abs(theta)))

    def sized(self, effect: FloatArray) -> FloatArray:
        """Size (...) of effects (..., q)."""
        return np.abs(effect).max(axis=-1) if self.largest else np.linalg.norm(effect, axis=-1)


def output_effects(scene: Scene, lib: Library, axis: str = "x") -> SceneEffects:
    """Rms effect on the output over a scene: ``|R_S theta_S| / sqrt(n)`` for any set S of terms.

    Parameters
    ----------
    scene : what the sensor will see, vibration included.
    lib : of the component.
    axis : case axis of the component's input.

    Examples
    --------
    >>> from imubayes.rig.scenes import recorded
    >>> from imubayes.sensors.terms import library
    >>> up = np.tile([0.0, 0.0, 2.0], (5, 1))
    >>> desk = recorded("desk", np.arange(5.0), up, np.zeros((5, 3)))
    >>> e = output_effects(desk, library("accelerometer", powers=2, asymmetry=-1), "z")
    >>> e.single(np.ones(len(e.names)))[:3].round(9).tolist()
    [1.0, 2.0, 4.0]
    """
    inputs = in_case(scene.inputs, axis)
    n, p = len(inputs), len(lib.terms)
    blocks = (
        columns(lib, {name: values[i:j] for name, values in inputs.channels.items()}, j - i)
        for i, j in row_blocks(n)
    )
    return SceneEffects(lib.names, triangular(blocks, p) / np.sqrt(n), largest=False)


def budget_effects(scene: Scene, lib: Library, budget: Budget, axis: str = "x") -> SceneEffects:
    """Effect on what is budgeted, over a scene.

    Parameters
    ----------
    scene : what the sensor will see.
    lib : of the component.
    budget : what it may come to.
    axis : case axis of the component's input.

    Returns
    -------
    for attitude, velocity and position, the largest error over the mission: of the columns averaged over
    vibration, whose oscillations integrate to nothing.
    """
    if budget.quantity == "output":
        return output_effects(scene, lib, axis)
    inputs = in_case(scene.mean_motion, axis)
    X = mean_columns(lib, inputs, scene.vibration if scene.slow else 0.0)
    times = scene.duration * np.arange(1, TIMES + 1) / TIMES
    J = functionals(lib.kind, X, inputs, times.tolist(), schuler=budget.schuler)
    return SceneEffects(lib.names, J[:, STATES.index(budget.quantity)], largest=True)
