"""Rows of a curved model, linearised where their own posterior is.

With the coefficients (and errors of the bench) theta an output is ``F(theta) + noise``. Linearised at a place
it is a row of an ordinary linear model, ``F(place) + dF (theta - place)``, whose posterior mean is the next
place. So rows, noise, factor and selection are those of every other test; a procedure supplies its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import invert_triangular, posterior, with_prior_rows
from imubayes.errors import ConvergenceError
from imubayes.inference.linear import Linear
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.summary import Summary

NEARLY = 0.02
"""Step still to go, in posterior sd, that is let pass where a curved valley makes it shrink slowly."""

KINK = 0.05
"""The same where it goes to and fro because the input of a sample changes its sign: the peak is between."""

TO_AND_FRO = 0.999
"""Share of the step before that a step to and fro has at least."""

FEW_ROUNDS = 12
"""Relinearisations after which a search begins anew with louder noise; four are usual."""

LOUDER = (1e3, 1e2, 10.0, 1.0)
"""Factors on the noise in such a search, one after the other."""

STALLED = 1e-15
"""Relative change of place or misfit that is rounding."""

ROUNDS = 100
"""Most relinearisations at each of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
    """How `what`, in words, settles: until no coefficient changes by more than `settled` posterior sds.

    The `judged` rounds judge the noise; in those before it is as the caller has it, after them it is held.
    There are at most so many `rounds` at the solution of the linear problem; `downhill` says whether trust
    regions go on from there, where a valley is too curved for that.
    """

    what: str
    judged: range
    settled: float
    rounds: int
    downhill: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """Rows of all parts, linearised at a place (w,), SI, their noise, and their factor over the w columns.

    `scale` is that of the noise, in units of what whitened.
    """

    place: FloatArray
    summary: Summary
    rows: tuple[Linear, ...]
    noise: Sequence[NoiseEstimate]
    scale: float = 1.0


At = Callable[[FloatArray, Sequence[NoiseEstimate], FloatArray | None], Round]
"""Linearises at a place (w,), with the noise of each part as it is given, or judged anew where none is. What
is small to second order is taken at a place of its own where one is given, and stays."""


def settle(
    at: At, sd: FloatArray, pace: Pace, start: FloatArray, noise: Sequence[NoiseEstimate] = ()
) -> Round:
    """Linearise where that settles, beginning at `start` (w,): the last round, at its posterior mean.

    `sd` (w,) are prior sds of all columns, SI, and `noise` is of each part, in the rounds before it is
    judged. It is a `ConvergenceError`, which carries the place so far, if it does not settle.
    """
    place, step = start, np.inf
    for turn in range(pace.rounds):
        made = at(place, () if turn in pace.judged else noise, None)
        noise = made.noise
        before, (mean, step) = step, _onward(made, sd)
        again = turn > pace.judged.stop and TO_AND_FRO * before <= step <= KINK
        if turn >= pace.judged.start and (step <= pace.settled or again):
            return replace(made, place=mean)
        place = mean
    if not pace.downhill:
        raise ConvergenceError(f"the {pace.what} did not settle in {pace.rounds} rounds", place)
    made, step = at(_peak(at, sd, pace, made), made.noise, None), np.inf
    for _ in range(FEW_ROUNDS):  # from near the peak the linear problem is followed while its steps shrink
        before, (mean, step) = step, _onward(made, sd)
        if step <= pace.settled or step >= before:
            break
        made = at(mean, made.noise, None)
    return made


def _onward(made: Round, sd: FloatArray) -> tuple[FloatArray, float]:
    """Posterior mean (w,) of a round, and how far it is from its place, in posterior sd."""
    mean, spread = posterior(made.summary.factor, sd, made.scale)
    return mean, float(np.max(np.abs(mean - made.place) / spread))


def _peak(at: At, sd: FloatArray, pace: Pace, start: Round) -> FloatArray:
    """Place (w,) of the posterior's peak; noise, and what is small to second order, are as at the start."""

    def held(place: FloatArray) -> Round:
        return at(place, start.noise, start.place)

    place, left = _descended(held, sd, pace, start, (start.scale, FEW_ROUNDS))
    if left > pace.settled:
        # the valley is curved and narrow: with louder noise it is wide, and leads to where it is deepest
        near = start
        for louder in LOUDER:
            there, more = _descended(held, sd, pace, near, (louder * start.scale, ROUNDS))
            near = held(there)
        # else it ends on the valley's wall, and the first was all but there
        if more <= NEARLY or left > NEARLY:
            place, left = there, more
    if left > NEARLY:
        raise ConvergenceError(
            f"the {pace.what} did not settle in {ROUNDS} rounds: check scale and sign of the"
            " output, and whether the errors that the study states for the bench are as large as that",
            place,
        )
    return place


def _descended(
    held: Callable[[FloatArray], Round], sd: FloatArray, pace: Pace, start: Round, most: tuple[float, int]
) -> tuple[FloatArray, float]:
    """Go downhill by trust regions; give the place, and the step that is left in posterior sd.

    The way is taken in coordinates in which the posterior is a unit ball at the start; `most` is the scale of
    the noise, and how many rounds.
    """
    from scipy.optimize import least_squares

    scale, rounds = most
    rows = scale / sd
    metric = scale * invert_triangular(with_prior_rows(start.summary.factor.R, rows)[:-1, :-1])

    @lru_cache(maxsize=1)
    def there(way: bytes) -> tuple[FloatArray, FloatArray]:
        place = start.place + metric @ np.frombuffer(way)
        T = with_prior_rows(held(place).summary.factor.R, rows) / scale
        return T[:, :-1] @ place - T[:, -1], T[:, :-1] @ metric

    if not np.isfinite(there(np.zeros(len(sd)).tobytes())[0]).all():
        raise ConvergenceError(f"the {pace.what} cannot be told: a run has no noise", start.place)
    slope: Any = lambda way: there(way.tobytes())[1]  # noqa: E731
    found = least_squares(
        lambda way: there(way.tobytes())[0],
        np.zeros(len(sd)),
        slope,
        gtol=pace.settled,
        xtol=STALLED,
        ftol=STALLED,
        max_nfev=rounds,
    )
    return start.place + metric @ found.x, float(found.optimality)
