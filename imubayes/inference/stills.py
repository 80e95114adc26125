"""Stills of a hand tumble: found where the output hardly moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.linear import Linear
from imubayes.rig.inputs import Run, durations

Stills = tuple[tuple[int, int], ...]
"""(start, stop) sample indices of each still."""

WINDOW = 1.0
"""s: length of the window whose variance tells rest from motion."""

FEWEST_IN_WINDOW = 8
"""Samples that a window holds at least, at low rates."""

SHORTEST = 1.0
"""s: a still that is shorter, once its ends are trimmed, is left out."""

CONTRAST = 10.0
"""Variance in motion over that at rest (medians) from which a record has both: hands give 1e2 to 1e5."""

RESTLESS = 3.0
"""Variance of the rates over a window, beside the usual one at rest, from which a case turns slowly: noise
makes two windows in a million that restless, if they hold as few as 24 numbers."""

STILLEST = 1e-8
"""Share of the largest variance below which rest is rest: coarse counts that do not change have none."""

BINS = 256
"""Bins of the histogram that the threshold is taken from."""


def find_stills(run: Run) -> Stills:
    """(start, stop) sample indices of each still.

    The variance over a sliding window is a few times the sensor's own at rest and thousands of times in
    motion, so its logarithm has two humps; the threshold is where Otsu's criterion parts them, and the ends
    of each still are trimmed by half a window, so that the result hardly depends on it. A slow turn, or one
    about the direction of gravity, hardly changes the force: gyroscopes in the case see it.

    Each row of a table of means is one.

    Raises
    ------
    UnobservableError : if the record has no rest, or nothing but rest.
    """
    if run.inputs.averaged is not None:
        return tuple((k, k + 1) for k in range(len(run.t)))
    width = max(FEWEST_IN_WINDOW, round(WINDOW / run.interval))
    if len(run.t) < 3 * width:
        raise UnobservableError(
            f"run '{run.name}' lasts {run.t[-1] - run.t[0]:.1f} s: too short to tell stills from motion"
        )
    quiet = _quiet(run, width)
    if run.rate.size:
        quiet &= _unturned(run.rate, width, quiet)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], quiet, [False])).astype(np.int8)))
    # a quiet window that starts at s covers s ... s + width - 1; half a window is trimmed at both ends
    found = [(int(a + width // 2), int(b + width // 2)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    stills = tuple((a, b) for a, b in found if (b - a) * run.interval >= SHORTEST)
    if not stills:
        raise UnobservableError(
            f"run '{run.name}' has no stills of {SHORTEST:g} s: hold each position for longer"
        )
    return stills


def rows_of(stills: Stills) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples (n,) of all stills in their order, and which still each of them belongs to."""
    index = np.concatenate([np.arange(a, b) for a, b in stills])
    return index, np.repeat(np.arange(len(stills)), [b - a for a, b in stills])


def still_rows(
    run: Run,
    stills: Stills,
    component: str,
    names: tuple[str, ...],
    said: FloatArray,
    X: FloatArray,
) -> Linear:
    """All samples of the stills of one component as rows of a linear model.

    Parameters
    ----------
    run, stills : where it is at rest.
    component : ``ax`` to ``gz``.
    names, X : the p columns, and what they are (k, p) in each still.
    said : (n,) output of the component in the run, SI.
    """
    index, still = rows_of(stills)
    t = run.t[index]
    return Linear(
        name=f"{run.name} ({component} at rest)",
        procedure=run.procedure,
        names=names,
        t=t,
        duration=durations(t, run.interval),
        interval=run.interval,
        y=said[index],
        columns=lambda start, stop: X[still[start:stop]],
    )


def means_of(values: FloatArray, stills: Stills) -> FloatArray:
    """Means (k, a) of values (n, a) over each still."""
    return np.array([values[a:b].mean(axis=0) for a, b in stills])


def times_of(run: Run, stills: Stills) -> tuple[tuple[float, float], ...]:
    """(start, stop) of each still, s."""
    t, half = run.t, np.zeros(len(run.t)) if run.inputs.averaged is None else 0.5 * run.inputs.averaged
    return tuple((float(t[a] - half[a]), float(t[b - 1] + half[b - 1])) for a, b in stills)


def _quiet(run: Run, width: int) -> NDArray[np.bool_]:
    """Windows at rest: (n - width + 1,)."""
    variance = _rolling_variance(run.force, width)
    least = max(STILLEST * float(variance.max()), np.finfo(float).tiny)
    spread = np.log(np.maximum(variance, least))
    quiet = spread < _threshold(spread)
    if quiet.all() or np.median(spread[~quiet]) - np.median(spread[quiet]) < math.log(CONTRAST):
        raise UnobservableError(
            f"run '{run.name}' has no stills that differ from motion: hold the triad still in one direction"
            " after the other, and turn it between them"
        )
    return quiet


def _unturned(rate: FloatArray, width: int, quiet: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Windows in which the rates do not vary by more than noise, which is that of the `quiet` windows."""
    variance = _rolling_variance(rate, width)
    usual = max(float(np.median(variance[quiet])), STILLEST * float(variance.max()))
    return variance < RESTLESS * usual


def _rolling_variance(values: FloatArray, width: int) -> FloatArray:
    """Summed variance of the columns over each window: (n - width + 1,)."""
    centred = values - values.mean(axis=0)
    first = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred)), axis=0)
    second = np.cumsum(np.vstack((np.zeros(values.shape[1]), centred**2)), axis=0)
    mean = (first[width:] - first[:-width]) / width
    return np.maximum((second[width:] - second[:-width]) / width - mean**2, 0.0).sum(axis=1)


def _threshold(values: FloatArray) -> float:
    """Otsu's threshold: the cut with the largest variance between the two sides; inf where all are equal."""
    if np.ptp(values) == 0.0:
        return math.inf
    counts, edges = np.histogram(values, bins=BINS)
    middles = 0.5 * (edges[1:] + edges[:-1])
    below, total = np.cumsum(counts)[:-1], counts.sum()
    first = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (first[-1] * below / total - first[:-1]) ** 2 / (below * (total - below))
    return float(edges[1 + int(np.nanargmax(between))])
