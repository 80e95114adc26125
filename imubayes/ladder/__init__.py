"""The ladder of methods, from the cheapest to the best: what each leaves out, and what it takes.

What a rung takes follows a law in the size of the problem, whose constants are those of the machine; what a
rung leaves out is said in a sentence, and measured by a trade study.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from imubayes.errors import InputError

RungName = Literal["means", "sparse", "plug-in", "averaged", "collapsed", "full", "raw"]
Method = Literal["auto", RungName, "exact"]
"""What a study and ``--method`` may say: a rung; ``auto``, the one that suits the study; ``exact``, which is
another word for plug-in."""

METHODS: tuple[str, ...] = get_args(Method)

AT_ONCE = ("means", "sparse")
"""Rungs that decide on their way, of one component with known inputs."""

CHAINED = ("auto", "collapsed", "full")
"""Methods that may keep chains, which can be resumed."""


LADDER: Mapping[str, tuple[str, str]] = {
    "means": ("dwell means, ordinary least squares, BIC",
              "takes the noise as white and as strong as the scatter of the dwells: drift counts as signal."),
    "sparse": ("whitened factor, sparse regression along its path",
               "weighs the models of one path only, and gives no probabilities of its own."),
    "plug-in": ("whitened factor, every model, noise as estimated",
                "takes the noise as known but for its strength."),
    "averaged": ("every model, averaged over draws of the noise",
                 "weighs few draws of the noise, from a guess of its posterior."),
    "collapsed": ("emcee over the noise, every model",
                  "takes the coefficients as Gaussian given the noise, which they are but for errors of the"
                  " bench."),
    "full": ("emcee over coefficients and noise on compressed rows",
             "takes exact whitenings at a few places and carries them on between."),
    "raw": ("emcee over coefficients and noise on every row", ""),
}  # fmt: skip
"""Title of each method, from the cheapest to the best, and what only the next one does."""

NAMES: tuple[RungName, ...] = get_args(RungName)
"""From the cheapest to the best."""


@dataclass(frozen=True, slots=True)
class Size:
    """What the time of a rung depends on.

    Columns are terms and errors of the bench, candidates terms that are excited, of which every subset is a
    model; of the rows of all runs some are `streamed`: read a part at a time, again for each whitening. Of
    several components in a case rows, columns and runs are those of all, and candidates stand for the mean
    number of models of one.
    """

    rows: int
    columns: int
    candidates: float
    runs: int
    streamed: int = 0
    components: int = 1


def rungs_for(size: Size) -> tuple[RungName, ...]:
    """Rungs that a problem can be put to, from the cheapest: not every one takes a case.

    Examples
    --------
    >>> rungs_for(Size(rows=10_000, columns=120, candidates=17, runs=1, components=6))[0]
    'plug-in'
    """
    return tuple(name for name in NAMES if name not in AT_ONCE or size.components == 1)


def rung_of(name: str) -> RungName:
    """Rung of a name; an `InputError` if there is none."""
    if name not in NAMES:
        raise InputError(f"rung '{name}' is not known: expected one of {', '.join(NAMES)}")
    return NAMES[NAMES.index(name)]


CostLaw = Mapping[RungName, Mapping[str, float]]
"""Seconds of each rung by unit of a feature of the problem's size (see `imubayes.ladder.costs.FEATURES`)."""
