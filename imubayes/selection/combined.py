"""The verdict of three families: evidence, what is left without a part of the test, sparse regressions.

The evidence of the models says what is needed if the model of the test is right. A part of the test (a run, a
mount) without which a coefficient moves by more than chance allows says that it is not; so do sparse
regressions on resampled campaigns that hardly ever keep a term which is far from zero, or always one which is
not needed. Who objects leaves the term open, and the verdict says who, and why.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.dwells import Pieces, joined
from imubayes.rig.inputs import Run
from imubayes.selection.decision import Selection
from imubayes.selection.mixture import Candidates
from imubayes.selection.predictive import by_dwell
from imubayes.selection.sindy import Sparse
from imubayes.selection.verdicts import TermVerdict, Voices

Mounts = Mapping[str, tuple[FloatArray, NDArray[np.int64]]]
"""Of runs with several mounts: time (n,), s, and number of the mount of each row."""


def mounts_of(runs: Iterable[Run]) -> Mounts:
    """When runs are in which of their mounts."""
    return {run.name: (run.inputs.t, run.inputs.mount) for run in runs if run.inputs.mount is not None}


MOVED = 4.0
"""Change of a coefficient without a part of the test, in sds of what chance allows, that chance is not."""

FAR = 8.0
"""Sds from zero from which a sparse regression that is worth asking keeps a term."""

CLEAR = 5.0
"""Sds from zero from which a term is needed where the library was found wanting."""

SURE = ("needed", "not needed")
"""Verdicts that may be objected to."""

NEAR = 2.0
"""Sds from zero below which it does not."""

SELDOM, ALWAYS = 0.05, 0.95
"""Share of resampled campaigns below which regressions object to a term, and above which to its absence."""


def parts_of(pieces: Sequence[Pieces], mounts: Mounts) -> tuple[list[Pieces], tuple[str, ...]]:
    """Dwells put together to what is left out: mounts of a run, where it has several, else the run."""
    parts, names = list[Pieces](), list[str]()
    for one in pieces:
        if one.kept:
            parts.append(one)
            continue
        t, number = mounts.get(one.run, (np.zeros(1), np.zeros(1, dtype=np.int64)))
        middle = 0.5 * (one.start + one.stop)
        of = number[np.clip(np.searchsorted(t, middle), 0, len(number) - 1)]
        parts.append(joined(one, of))
        mounted = [f"mount {m} of run {one.run}" for m in np.unique(of).tolist()]
        names += mounted if len(mounted) > 1 else [f"run {one.run}"]
    return parts, tuple(names)


class LeftOut(NamedTuple):
    """How far coefficients move without each part of a test, (q, p), in sds of what chance allows."""

    parts: tuple[str, ...]
    columns: tuple[str, ...]
    change: FloatArray


def without_parts(f: Factor, sd: FloatArray, pieces: Sequence[Pieces], mounts: Mounts) -> LeftOut | None:
    """Leave out each mount of a run, or each run, in turn; None where there is nothing beside it.

    Without a part the posterior's variance is larger, and the mean moves by as much: under the model the
    square of the change is the difference of the variances.

    The factor f is of all rows over p columns, whose prior sds are `sd`; the pieces are dwells of the runs
    that are left out, and what always stays.
    """
    joint, parts = parts_of(pieces, mounts)
    if len(parts) < 2:
        return None
    scale = algebra.noise_scale(f, sd)
    held = by_dwell(joint, Candidates((), f.names, sd, f.R, f.n, f.log_det), scale)
    mean, variance = _told(held.whole, scale)
    others = [_told(T, scale) for T in held.without]
    change = np.array([other - mean for other, _ in others])
    chance = np.array([more - variance for _, more in others])
    told = chance > LEAST * variance
    moves = np.divide(change, np.sqrt(np.abs(chance)), out=np.zeros_like(change), where=told)
    return LeftOut(parts, f.names, moves)


LEAST = 1e-6
"""Share of a variance by which it must rise without a part for the part to say anything."""


def _told(T: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    inverse = algebra.invert_triangular(T[:-1, :-1])
    return inverse @ T[:-1, -1], np.sum((scale * inverse) ** 2, axis=1)


def combined(
    selection: Selection, left_out: LeftOut | None, sparse: Sequence[Sparse], *, doubtful: bool = False
) -> Selection:
    """Decision in which every family has its say, beside the evidence; the same where a test has no parts.

    Of a library that by itself was found wanting (`doubtful`) a term must be farther from zero.
    """
    if left_out is None:
        return selection
    place = {name: k for k, name in enumerate(left_out.columns)}
    # share of the resampled campaigns in which regressions keep a column, on average over these
    names = sparse[0].names if sparse else ()
    frequency = {name: float(np.mean([one.inclusion[name] for one in sparse])) for name in names}
    terms = tuple(
        _heard(term, left_out, place[carrier], frequency.get(carrier, math.nan), doubtful=doubtful)
        if carrier in place and term.verdict != "untested"
        else term
        for term, carrier in zip(selection.terms, selection.carriers, strict=True)
    )
    return replace(selection, terms=terms)


def _heard(term: TermVerdict, out: LeftOut, place: int, frequency: float, *, doubtful: bool) -> TermVerdict:
    change, verdict = out.change[:, place], term.verdict
    worst = int(np.argmax(np.abs(change)))
    voices = Voices(verdict, out.parts[worst], float(change[worst]), frequency)
    pull = abs(term.full_mean) / term.full_sd if term.full_sd > 0.0 else math.inf
    moved = f"without {voices.part} it moves by {abs(voices.change):.1f} sd of what chance allows"
    kept = f"sparse regressions keep it in {100 * frequency:.0f} % of resampled campaigns"
    weak = f"at {pull:.1f} sd from zero it may be what the library lacks"
    objections = {
        moved: abs(voices.change) > MOVED,
        kept: frequency < SELDOM and pull > FAR
        if verdict == "needed"
        else frequency > ALWAYS and pull < NEAR,
        weak: verdict == "needed" and doubtful and pull < CLEAR,
    }
    said = [text for text, holds in objections.items() if holds]
    if verdict not in SURE or not said:
        return replace(term, voices=voices)
    reason = f"{verdict} by the evidence ({term.reason}), but {'; '.join(said)}"
    return replace(term, verdict="undecided", reason=reason, voices=voices)
