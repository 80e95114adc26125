"""Linear effect of coefficients in a scene: on the output, or on what the output is integrated to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import BoolArray, FloatArray
from imubayes.algebra.factor import row_blocks, triangular
from imubayes.rig.inputs import Inputs
from imubayes.rig.shaking import mean_columns
from imubayes.scenes.propagation import CELLS, STATES, Budget, functionals, propagation, running_functionals
from imubayes.scenes.record import Scene, in_case
from imubayes.sensors.terms import Factor, Kind, Library, columns, tied
from imubayes.units import STANDARD_GRAVITY

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
    >>> from imubayes.scenes.record import recorded
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
    vibration, whose oscillations integrate to nothing. Where the mission repeats its record, temperature runs
    on.
    """
    if budget.quantity == "output":
        return output_effects(scene, lib, axis)
    inputs = in_case(scene.mean_motion, axis)
    propagated = propagation(lib.kind, inputs, schuler=budget.schuler, load=turned_force(lib.kind, inputs))
    times = (scene.duration * np.arange(1, TIMES + 1) / TIMES).tolist()
    heated = np.array([any(_is_heat(factor) for factor in term.factors) for term in lib.terms])
    J = np.empty((TIMES, 3, len(lib.terms)))
    J[..., ~heated] = functionals(propagated, _mean_motion(scene, _some(lib, ~heated), inputs), times)
    if heated.any():
        columns_of = _warming(scene, _some(lib, heated), inputs)
        J[..., heated] = running_functionals(propagated, columns_of, times)
    return SceneEffects(lib.names, tied(lib, J[:, STATES.index(budget.quantity)]), largest=True)


def turned_force(kind: Kind, inputs: Inputs) -> FloatArray | float:
    """Force that a small turn about a gyroscope's axis moves into velocity, m/s^2: ``|e_i x f|``.

    A turn by dphi about i moves f by dphi e_i x f. Its direction is taken to stay, as that of the axis is.
    A channel of an accelerometer is level: g; so is one of which nothing says what force acts.

    Parameters
    ----------
    kind : of the component.
    inputs : (n,) rows along its (i, j, k).

    Examples
    --------
    >>> force = {"f_i": np.array([9.0]), "f_j": np.array([3.0]), "f_k": np.array([-4.0])}
    >>> boost = Inputs(np.zeros(1), force, 1.0)
    >>> turned_force("gyroscope", boost), round(turned_force("accelerometer", boost), 2)
    (array([5.]), 9.81)
    """
    if kind == "accelerometer" or not any(name.startswith("f_") for name in inputs.channels):
        return STANDARD_GRAVITY
    absent = np.zeros(len(inputs))
    return np.hypot(inputs.channels.get("f_j", absent), inputs.channels.get("f_k", absent))


def cell_loads(load: FloatArray | float, inputs: Inputs, time: float) -> FloatArray | float:
    """Means (2000,) of a load (n,) that a mission repeats, over the cells in which `noise_growth` takes it.

    Examples
    --------
    >>> burn = np.linspace(10.0, 30.0, 4000)
    >>> cell_loads(burn, Inputs(np.arange(4000.0), {}, 1.0), 4000.0)[[0, -1]].round(2).tolist()
    [10.0, 30.0]
    """
    if not np.ndim(load):
        return load
    start = inputs.t - inputs.t[0]
    edges = np.append(start, start[-1] + inputs.interval)
    total = np.append(0.0, np.cumsum(load * np.diff(edges)))
    cells = time * np.arange(CELLS + 1) / CELLS
    whole = np.floor(cells / edges[-1])
    passed = whole * total[-1] + np.interp(cells - whole * edges[-1], edges, total)
    return np.diff(passed) * CELLS / time


def _is_heat(factor: Factor) -> bool:
    return factor.channel in ("T", "dT")


def _some(lib: Library, chosen: BoolArray) -> Library:
    return Library(lib.kind, tuple(term for term, one in zip(lib.terms, chosen, strict=True) if one))


def _mean_motion(scene: Scene, lib: Library, inputs: Inputs) -> FloatArray:
    """Columns (n, p) of terms without temperature, averaged over the scene's vibration."""
    return mean_columns(lib, inputs, scene.vibration if scene.slow else 0.0)


def _warming(scene: Scene, lib: Library, inputs: Inputs) -> Callable[[int], FloatArray]:
    """Columns (n, p) of terms with temperature in each repetition of the record: a product of two.

    The motion is the record's, the temperature that of the mission.
    """
    moving = _mean_motion(scene, _factored(lib, heat=False), inputs)
    warm, course, start = _factored(lib, heat=True), scene.temperature, inputs.t - inputs.t[0]
    length = float(start[-1]) + inputs.interval
    return lambda record: moving * columns(warm, course.at(start + record * length), len(start))


def _factored(lib: Library, *, heat: bool) -> Library:
    """Terms with only those factors that are a temperature, or with only the others."""
    parts = (tuple(f for f in term.factors if _is_heat(f) is heat) for term in lib.terms)
    return Library(lib.kind, tuple(replace(t, factors=p) for t, p in zip(lib.terms, parts, strict=True)))
