"""The rungs of the ladder as functions with one interface: a problem in, an answer out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from imubayes.campaign.fidelity import RungName, rung_of
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder.answer import Answer
from imubayes.ladder.averaged import averaged
from imubayes.ladder.means import means
from imubayes.ladder.plug_in import plug_in
from imubayes.ladder.problem import Ground, Problem, Tell, ground_of
from imubayes.ladder.raw import raw
from imubayes.ladder.sampled import collapsed, full
from imubayes.ladder.sparse import sparse


@dataclass(frozen=True, slots=True)
class Method:
    """What a rung does, and what of it other rungs do too (names in `Ground.shared`)."""

    work: Callable[[Ground], Answer]
    shares: tuple[str, ...] = ()


RUNGS: Mapping[RungName, Method] = {
    "means": Method(means),
    "sparse": Method(sparse, ("factor",)),
    "plug-in": Method(plug_in, ("factor",)),
    "averaged": Method(averaged, ("factor",)),
    "collapsed": Method(collapsed, ("factor", "collapsed")),
    "full": Method(full, ("factor", "full")),
    "raw": Method(raw, ("factor", "full")),
}
"""From the cheapest to the best."""


def answer(
    rung: RungName,
    problem: Problem,
    *,
    rng: np.random.Generator,
    tell: Tell = lambda message: None,
    limits: Limits | None = None,
) -> Answer:
    """Answer a problem with one rung.

    Parameters
    ----------
    rung : by name.
    problem : one component (see `imubayes.ladder.problem.problem_of`).
    rng : of whatever is drawn.
    tell : is told what goes on.
    limits : of chains, where the rung has any; by default those of a study.

    Raises
    ------
    InputError : if there is no such rung, or the runs cannot be used.
    """
    return stand(rung, ground_of(problem, rng, tell, limits))


def stand(rung: RungName, ground: Ground) -> Answer:
    """Answer of one rung on a ground that others may have been on before: what they share is not done again.

    The seconds are those that the rung takes alone.
    """
    method = RUNGS[rung_of(rung).name]
    done = sum(seconds for name, (_, seconds) in ground.shared.items() if name in method.shares)
    start = time.perf_counter()
    found = method.work(ground)
    seconds, ready = time.perf_counter() - start + done, ground.shared.get("factor", (None, 0.0))[0]
    return replace(found, seconds=seconds, ready=ready if "factor" in method.shares else None)
