"""One component's share of a joint problem: its own runs, and what all other runs say, as one factor.

Columns that the component's own runs do not move are integrated out of the others' factor under their priors,
so that the posterior of all that is left is what it is in the whole problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, add, noise_scale, reorder, with_prior_rows
from imubayes.inference.linear import Linear, narrowed
from imubayes.inference.summary import RunSummary, Summary


@dataclass(frozen=True, slots=True, eq=False)
class Apart:
    """A component by itself, over the w columns that its own runs or its own terms move.

    Attributes
    ----------
    summary : its own runs; the factor is of their rows and of `known`.
    sd : (w,) prior sds, SI.
    rows : of its own runs.
    known : what the other runs say of these columns; None where there are no others.
    """

    summary: Summary
    sd: FloatArray
    rows: tuple[Linear, ...]
    known: Factor | None


def apart(
    summary: Summary,
    sd: FloatArray,
    rows: Sequence[Linear],
    parts: Sequence[int],
    columns: Sequence[str],
) -> Apart:
    """Set a component apart.

    Parameters
    ----------
    summary, rows : of the joint problem.
    sd : prior sd of all of its columns, SI.
    parts : indices of the runs that the component takes part in.
    columns : that are kept in any case: its candidates.
    """
    own = [summary.runs[k] for k in parts]
    moved = np.max([run.reach for run in own], axis=0) > 0.0
    kept = tuple(name for name, there in zip(summary.names, moved, strict=True) if there or name in columns)
    known = _elsewhere(summary, sd, [k for k in range(len(summary.runs)) if k not in parts], kept)
    factors = [reorder(run.factor, kept) for run in own]
    runs = tuple(_among(run, f, summary.names) for run, f in zip(own, factors, strict=True))
    whole = reduce(add, factors if known is None else [*factors, known])
    return Apart(
        summary=replace(
            summary,
            factor=whole,
            runs=runs,
            reach={name: summary.reach[name] for name in kept if name in summary.reach},
            extras=tuple(extra for extra in summary.extras if extra.name in kept),
        ),
        sd=sd[[summary.names.index(name) for name in kept]],
        rows=tuple(narrowed(rows[k], [rows[k].names.index(name) for name in kept]) for k in parts),
        known=known,
    )


def _elsewhere(
    summary: Summary, sd: FloatArray, others: Sequence[int], kept: tuple[str, ...]
) -> Factor | None:
    """What the other runs say of the columns `kept`, the rest integrated out under their priors.

    As many rows as say something of them: how well the other runs are fitted is no matter of the component.
    """
    if not others:
        return None
    gone = tuple(name for name in summary.names if name not in kept)
    width = dict(zip(summary.names, sd.tolist(), strict=True))
    scale = noise_scale(summary.factor, sd)
    f = reorder(reduce(add, (summary.runs[k].factor for k in others)), (*gone, *kept))
    prior = np.array([scale / width[name] for name in gone] + [0.0] * len(kept))
    R = with_prior_rows(f.R, prior)[len(gone) :, len(gone) :].copy()
    R[-1, -1] = 0.0
    return Factor(kept, R, int(np.count_nonzero(np.diag(R))))


def _among(run: RunSummary, f: Factor, names: Sequence[str]) -> RunSummary:
    reach = run.reach[[list(names).index(name) for name in f.names]]
    return replace(run, factor=f, reach=reach)
