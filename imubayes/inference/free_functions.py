"""Free functions of a run's inputs: what the output could depend on, were the library not there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.linear import Linear, blocks_of
from imubayes.inference.summary import RunSummary

BLOCKS = 400
"""Blocks that a run is averaged to: enough to follow an input, few enough to judge the noise many times."""

KNOTS = 9
"""Knots of a free function: more than the library's powers can bend."""

LEVELS = 10
"""An input that takes at most so many values has a free value at each."""

TURN = 0.01
"""Share of its range by which an input must turn back to be falling, or rising."""

PLAYS = (0.03, 0.1, 0.2, 0.4)
"""Plays that hysteresis is made of (Prandtl and Ishlinskii), as shares of the input's range."""

ROUNDING = 1e-9
"""Relative spread of an input below which it does not vary."""

CLOSE = 1e-3
"""Share of its range below which two knots of an input are one."""

TIME = "t"
"""Input of a dependence on time."""

HYSTERESIS = "hysteresis of "
"""How the input of a dependence begins that differs between the branches."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A free function of one input of a run.

    Attributes
    ----------
    run, input : where to look.
    blocks : averages of the run.
    beside : (m, r) columns over the blocks, beside the library's, that the function must add to.
    columns : (m, q) that span the function.
    x, branch : (m,) the input, SI, and its direction.
    """

    run: RunSummary
    input: str
    blocks: Linear
    beside: FloatArray
    columns: FloatArray
    x: FloatArray
    branch: FloatArray


def looks_at(rows: Linear, channels: Mapping[str, FloatArray], run: RunSummary, own: str) -> Iterator[Look]:
    """Give the free functions of every input that varies, and of time, in the order of the channels.

    Parameters
    ----------
    rows : of a run.
    channels : (n,) arrays by input, SI.
    run : summary of the same run.
    own : the component's own input, which may have hysteresis as temperature may; empty for none.
    """
    blocks = blocks_of(rows, BLOCKS)
    flat = np.zeros(len(blocks.y))
    for name, values in {**channels, TIME: rows.t}.items():
        knots = _knots(values)
        if len(knots) < 2:
            continue
        free = _averaged(rows, lambda x, knots=knots: _functions(x, knots), values)
        x = _averaged(rows, lambda x: x[:, None], values)[:, 0]
        yield Look(run, name, blocks, free[:, :0], free, x, flat)
        if name in ("T", own):
            ahead = np.column_stack([_lag(x, share * float(np.ptp(x))) for share in (TURN, *PLAYS)])
            branch = np.sign(ahead[:, 0])
            if np.ptp(branch) == 2.0:
                yield Look(run, f"{HYSTERESIS}{name}", blocks, free, ahead[:, 1:], x, branch)


def _averaged(rows: Linear, functions: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    """Averages over the blocks of functions of a channel, which are not the functions of its averages."""
    names = tuple(map(str, range(functions(values[:1]).shape[1])))
    made = replace(rows, names=names, columns=lambda a, b: functions(values[a:b]))
    return blocks_of(made, BLOCKS).X


def _knots(values: FloatArray) -> FloatArray:
    """Knots of a free function of a channel; a single one where it does not vary."""
    width = float(np.ptp(values))
    if not width > ROUNDING * float(np.max(np.abs(values))):
        return values[:1]
    levels = np.unique(np.round((values - values.min()) / width, 6)) * width + values.min()
    knots = levels if len(levels) <= LEVELS else np.quantile(values, np.linspace(0.0, 1.0, KNOTS))
    if knots[0] < 0.0 < knots[-1]:
        knots = np.sort(np.append(knots, 0.0))
    return knots[np.append(True, np.diff(knots) > CLOSE * width)]


def _functions(x: FloatArray, knots: FloatArray) -> FloatArray:
    """Piecewise linear functions (n, k): one at its own knot, zero at the others; and the input's sign."""
    hats = [np.interp(x, knots, peak) for peak in np.eye(len(knots))]
    signs = [np.sign(x)] if knots[0] < 0.0 < knots[-1] else []
    return np.column_stack((*hats, *signs))


def _lag(x: FloatArray, play: float) -> FloatArray:
    """How far an input (m,) is ahead of what it drags along with a play to either side, SI."""
    ahead, dragged = np.empty(len(x)), float(x[0])
    for k, value in enumerate(x.tolist()):
        dragged = min(max(dragged, value - play), value + play)
        ahead[k] = value - dragged
    return ahead
