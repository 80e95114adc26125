"""What the time that is left affords."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from imubayes.campaign.fidelity import CostLaw, RungName, Size
from imubayes.ladder.costs import foreseen
from imubayes.ladder.trade.plan import FEWEST

HALF = 0.5
"""Share of the time for the study's own data; the rest is for repeats of it."""

CHAINS = 0.3
"""Share of the time that is left that a chain may take."""

SHORTEST = 1.0
"""s that chains have at least."""

CROWDED = 1.5
"""Times as long as alone that a rung takes beside others, which share memory, and with data to simulate."""

START = 3.0
"""s that a new process takes for its imports, about."""


def beforehand(rung: RungName, size: Size, law: CostLaw) -> float:
    """Seconds that a rung takes at least, chains cut short.

    Chains on every row end when their time is up; around them they take what two rungs of chains do.
    """
    below: RungName = "full" if rung == "raw" else rung
    seconds = foreseen(below, size, law).seconds
    return START + (2.0 * seconds if rung == "raw" else seconds)


def chain_limit(left: float) -> float:
    """Seconds that chains may take of what is left."""
    return max(SHORTEST, CHAINS * left)


def counts(
    seconds: Mapping[RungName, float], repeats: int, left: float, processes: int
) -> dict[RungName, int]:
    """How many repeats each rung answers, the cheapest first.

    Parameters
    ----------
    seconds : that each rung takes, from the cheapest rung to the best.
    repeats : that are asked for.
    left : s.
    processes : that share them.

    Examples
    --------
    >>> counts({"means": 0.1, "averaged": 5.0, "raw": 100.0}, 20, 60.0, 2)
    {'means': 20, 'averaged': 20}
    """
    room, found = left * processes, dict[RungName, int]()
    for rung, each in seconds.items():
        most = min(repeats, int(room / max(each, 1e-9)))
        if most < min(FEWEST, repeats) or not most:
            break
        found[rung] = most
        room -= most * each
    return found


def dear(rungs: Sequence[RungName], afforded: Mapping[RungName, int]) -> tuple[RungName, ...]:
    """Rungs that no repeat can afford."""
    return tuple(rung for rung in rungs if rung not in afforded)
