"""Inputs as they were a little earlier: what a latency between the rig's clock and the sensor's does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.rig.inputs import GAP, Inputs


def delayed(inputs: Inputs, latency: float, start: int, stop: int) -> dict[str, FloatArray]:
    """Channels in the rows from start to stop as they were `latency` earlier, s.

    Cubics with central slopes between the samples of a part without gaps; straight on beyond its ends.

    Examples
    --------
    >>> inputs = Inputs(np.arange(4.0), {"w_i": 2.0 * np.arange(4.0)}, 1.0)
    >>> delayed(inputs, 0.25, 1, 3)["w_i"].tolist()
    [1.5, 3.5]
    """
    if latency == 0.0:
        return {name: values[start:stop] for name, values in inputs.channels.items()}
    t = inputs.t
    # two neighbours beyond the reach of the latency settle the slopes on both sides
    first = max(int(np.searchsorted(t, t[start] - abs(latency))) - 2, 0)
    last = min(int(np.searchsorted(t, t[stop - 1] + abs(latency))) + 3, len(t))
    at = _Between.of(t[first:last], inputs.interval, latency, slice(start - first, stop - first))
    return {name: at.values(values[first:last]) for name, values in inputs.channels.items()}


@dataclass(frozen=True, slots=True, eq=False)
class _Between:
    """Where times fall between samples: left and right sample, share of the step, and how far beyond."""

    t: FloatArray
    inside: NDArray[np.bool_]
    left: NDArray[np.intp]
    right: NDArray[np.intp]
    share: FloatArray
    beyond: FloatArray

    @classmethod
    def of(cls, t: FloatArray, interval: float, latency: float, rows: slice) -> _Between:
        inside = np.diff(t) <= GAP * interval
        index = np.arange(len(t))
        begins = np.maximum.accumulate(np.where(np.concatenate(([True], ~inside)), index, 0))
        ends = np.concatenate((~inside, [True]))
        ends = np.minimum.accumulate(np.where(ends, index, len(t))[::-1])[::-1]
        begin, end, wanted = begins[rows], ends[rows], t[rows] - latency
        held = np.clip(wanted, t[begin], t[end])
        left = np.clip(np.searchsorted(t, held, side="right") - 1, begin, np.maximum(end - 1, begin))
        right = np.minimum(left + 1, end)
        step = np.where(right > left, t[right] - t[left], 1.0)
        return cls(t, inside, left, right, (held - t[left]) / step, wanted - held)

    def values(self, u: FloatArray) -> FloatArray:
        """Values of samples u at those times."""
        slopes = _slopes(self.t, u, self.inside)
        a, b, s = self.left, self.right, self.share
        step = self.t[b] - self.t[a]
        rise = u[b] - u[a]
        low, high = slopes[a] * step - rise, rise - slopes[b] * step
        cubic = u[a] + s * rise + s * (1.0 - s) * ((1.0 - s) * low + s * high)
        return cubic + self.beyond * np.where(s > 0.5, slopes[b], slopes[a])


def _slopes(t: FloatArray, u: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Derivative (n,) at each sample: second order between two neighbours, one-sided beside a gap."""
    step = np.where(inside, np.diff(t), 0.0)
    slope = np.divide(np.diff(u), step, out=np.zeros(len(step)), where=inside)
    before, after = np.concatenate(([0.0], step)), np.concatenate((step, [0.0]))
    left, right = np.concatenate(([0.0], slope)), np.concatenate((slope, [0.0]))
    both = (before > 0.0) & (after > 0.0)
    total = np.where(both, before + after, 1.0)
    return np.where(both, (before * right + after * left) / total, left + right)
