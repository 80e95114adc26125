"""Robust analysis: find the dwells that shocks and slips have spoilt, and go on without their rows.

Outliers hide behind the noise that they inflate. So the noise is estimated without the dwells that are
suspected, all dwells are judged by that noise (see `contamination`), and so on until the same ones are
suspected again.

The rows of a distrusted dwell are left out. A free offset for the dwell would do where all of it is off by as
much, but a shock of one second in a dwell of thirty leaves its shape behind, and the noise estimate with it:
with two percent of shocks error bars came out 13 to 27 times as large as those of clean data, 1.03 times
without the rows.

What it cannot do. An offset that the terms can follow is told from a term by the prior alone: of offsets at
one of the twelve positions at the highest level of a centrifuge all of 50 sd of the noise were found, but of
those of 20 sd two of three, and the others pulled a coefficient by up to 11 sd. Spikes of single samples are
no matter of dwells. Two percent of the samples with spikes of either sign spoil all dwells alike and count as
white noise: no coefficient is off, error bars are three times as large. Spikes of one sign are a bias as
well: 4 to 8 sd of b0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import UnobservableError
from imubayes.inference.contamination import (
    Offsets,
    evidence,
    first_suspects,
    log_posterior,
    sample,
)
from imubayes.inference.dwells import Dwells, dwells_of, rows_kept
from imubayes.inference.linear import Linear
from imubayes.rig.inputs import Run
from imubayes.rig.runs import renewed
from imubayes.sensors.noise import Noise

Mask = NDArray[np.bool_]
NoiseOf = Callable[[Sequence[Run], Sequence[Linear]], Sequence[Noise]]
"""How the noise of each run is known, from runs and their rows."""

ROUNDS = 6
"""Rounds of noise and indicators; two or three do, unless the dwells' verdicts hang on the noise."""

LIKELY = 0.5
"""Probability from which a dwell is left out."""

HARM = 25.0
"""Expected squared pull, in sd, from which a dwell is left out though it is likely clean: one of two, say, of
which the terms could follow either. Clean dwells stay below 10 on a tumble and a centrifuge of three
levels."""


@dataclass(frozen=True, slots=True)
class Distrusted:
    """A dwell of a run, from start to stop, s, whose rows the robust analysis leaves out.

    The probability that it is contaminated is below a half where one of several dwells is, and the data do
    not tell which; if it is, its mean is off by `offset`, of this sd, SI.
    """

    run: str
    start: float
    stop: float
    probability: float
    offset: float
    sd: float


class Trusted(NamedTuple):
    """Runs without the dwells that are distrusted, and their rows, in the order given.

    A run most of whose dwells are distrusted is not among them. What was left out comes worst first; `notes`
    say in words what did not go as usual.
    """

    runs: tuple[Run, ...]
    rows: tuple[Linear, ...]
    distrusted: tuple[Distrusted, ...]
    notes: tuple[str, ...] = ()

    @property
    def noted(self) -> list[Run]:
        """The runs, of which the first says what did not go as usual, with the extremes of what is left."""
        first, *others = self.runs
        source = replace(first.source, notes=(*first.source.notes, *self.notes))
        return [renewed(run) for run in (replace(first, source=source), *others)]


def robust_rows(
    runs: Sequence[Run],
    rows: Sequence[Linear],
    prior_sd: FloatArray,
    noise_of: NoiseOf,
    *,
    rng: np.random.Generator,
) -> Trusted:
    """Leave out the dwells that are contaminated, of runs of one component with known inputs.

    `prior_sd` (p,) are those of the rows' columns, SI; `noise_of` is asked of ever other parts of the runs.
    It is an `UnobservableError` if no run has a majority of dwells that can be trusted.
    """
    dwells = [dwells_of(part) for part in rows]
    bad, tau = first_suspects(rows, dwells, prior_sd)
    for _ in range(ROUNDS):
        e = evidence(dwells, noise_of(*_without(runs, rows, dwells, bad)), prior_sd, tau)
        offsets = sample(e, bad, rng)
        before, bad = bad, (offsets.probability > LIKELY) | (offsets.harm > HARM)
        if np.array_equal(before, bad) or _without_majority(dwells, bad):
            break
    out = before | bad
    if _without_majority(dwells, out):
        # where two runs contradict each other, the sampler ends where it happens to start: is all of one off?
        of_run = np.repeat(np.arange(len(dwells)), [len(d) for d in dwells])
        states = (out, *(of_run == k for k in range(len(dwells))))
        lost = _without_majority(dwells, max(states, key=lambda on: log_posterior(e, on)))
        names, rest = [runs[k].name for k in lost], [k for k in range(len(runs)) if k not in lost]
        if not rest:
            raise UnobservableError(
                f"more than half of the dwells of {', '.join(names)} fit neither each other nor the noise:"
                " outliers must be the exception; look at units, axes and references, or leave robust out"
            )
        found = robust_rows([runs[k] for k in rest], [rows[k] for k in rest], prior_sd, noise_of, rng=rng)
        return found._replace(notes=(*(_LOST.format(name) for name in names), *found.notes))
    unsettled = int(np.count_nonzero(before ^ bad))
    notes = (_UNSETTLED.format(unsettled),) if unsettled else ()
    return Trusted(*_without(runs, rows, dwells, out), _named(dwells, offsets, out), notes)


_UNSETTLED = (
    "the verdict on {} of the dwells hangs on the noise, and the noise on the verdict: all of these are left"
    " out"
)
_LOST = (
    "run '{}' is left out: most of its dwells contradict the other runs or each other. Two runs that"
    " contradict each other do not tell which is right: look at units, axes, references, and turn-on bias"
)


def _by_run(dwells: Sequence[Dwells], values: Mask) -> list[Mask]:
    return np.split(values, np.cumsum([len(d) for d in dwells])[:-1])


def _without(
    runs: Sequence[Run], rows: Sequence[Linear], dwells: Sequence[Dwells], bad: Mask
) -> tuple[tuple[Run, ...], tuple[Linear, ...]]:
    """Runs and rows without the dwells that are `bad` (m,)."""
    kept = [np.repeat(~b, np.diff(d.edges)) for d, b in zip(dwells, _by_run(dwells, bad), strict=True)]
    return (
        tuple(run.left(k) for run, k in zip(runs, kept, strict=True)),
        tuple(rows_kept(part, k) for part, k in zip(rows, kept, strict=True)),
    )


def _without_majority(dwells: Sequence[Dwells], bad: Mask) -> list[int]:
    """Runs most of whose dwells are `bad` (m,)."""
    return [k for k, b in enumerate(_by_run(dwells, bad)) if 2 * np.count_nonzero(b) > len(b)]


def _named(dwells: Sequence[Dwells], offsets: Offsets, bad: Mask) -> tuple[Distrusted, ...]:
    """The dwells that are `bad` (m,), those that would do most harm first."""
    where = [(d.means.name, float(a), float(b)) for d in dwells for a, b in zip(d.start, d.stop, strict=True)]
    worst = sorted(np.flatnonzero(bad).tolist(), key=lambda k: -offsets.harm[k])
    return tuple(
        Distrusted(*where[k], *(float(v[k]) for v in (offsets.probability, offsets.mean, offsets.sd)))
        for k in worst
    )
