"""Noises of a problem's runs from logarithms, where some runs share theirs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.campaign.preparation import Prepared


def groups_of(ready: Prepared) -> tuple[tuple[str, int], ...]:
    """Runs whose noise is not known, each with how many of ln N, ln B, ln K there are; once if shared."""
    return tuple({run.noise_run: len(run.steering) for run in ready.summary.runs if run.steering}.items())


def noises_of(ready: Prepared, groups: Sequence[tuple[str, int]], x: FloatArray) -> FloatArray:
    """N, B, K (m, g, 3) of every run, from logarithms (m, d).

    Parameters
    ----------
    ready : the runs; one whose noise is not in `groups` has that of its summary.
    groups : (run whose noise it is, how many of ln N, ln B, ln K) in the order of the columns of x.
    x : logarithms.
    """
    runs = ready.summary.runs
    out = np.repeat([[(run.noise.N, run.noise.B, run.noise.K) for run in runs]], len(x), axis=0)
    first = 0
    for name, count in groups:
        for k, run in enumerate(runs):
            if run.steering and run.noise_run == name:
                out[:, k, :count] = np.exp(x[:, first : first + count])
        first += count
    return out
