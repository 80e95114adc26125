"""Everybody on the same problem, in turns with ours: ``pytest -m benchmark tests/benchmarks/test_peers.py``.

The ratio of a peer's time to ours, and both errors, go into ``extra_info``; a peer that is not installed is
skipped with the reason.
"""

from __future__ import annotations

import dataclasses
import math

import pytest

from imubayes.reporting.speed_words import WRONG
from imubayes.speed.contests import Contest
from imubayes.speed.measure import CONTESTS, held
from imubayes.speed.peers import missing

pytestmark = pytest.mark.benchmark

SEED, TURNS = 1, 3
SIZES = {
    "least squares": (100_000, 1_000_000),
    "one-sided": (100_000,),
    "subsets": (10, 12, 14),
    "g-prior": (12, 20),
    "noise": (360_000,),
    "posterior": (6_000,),
}
AHEAD = {("subsets", "statsmodels OLS"): 100.0, ("g-prior", "numpy, one by one"): 20.0}
AHEAD |= {("g-prior", "R, BAS"): 10.0, ("g-prior", "R, BMS"): 10.0, ("posterior", "nutpie, NUTS"): 5.0}
"""Times ours that a peer takes at least, where that is the point; elsewhere the ratio is only told."""


@pytest.fixture(scope="module")
def contests() -> dict[tuple[str, int], Contest]:
    return {}


def _contest(contests, subject: str, size: int) -> Contest:
    if (subject, size) not in contests:
        contests.clear()  # a million rows at a time
        contests[subject, size] = CONTESTS[subject](size, SEED)
    return contests[subject, size]


PEERS = {
    "least squares": ("numpy.linalg.lstsq", "normal equations", "statsmodels OLS", "scikit-learn"),
    "one-sided": ("numpy.linalg.lstsq", "normal equations", "statsmodels OLS", "scikit-learn"),
    "subsets": ("statsmodels OLS", "abess"),
    "g-prior": ("numpy, one by one", "R, BAS", "R, BMS"),
    "noise": ("allantools, slopes",),
    "posterior": ("nutpie, NUTS",),
}
CASES = [
    (subject, size, peer) for subject, sizes in SIZES.items() for size in sizes for peer in PEERS[subject]
]


@pytest.mark.parametrize(("subject", "size", "peer"), CASES)
def test_peer_beside_ours(benchmark, contests, measured, subject, size, peer):
    contest = _contest(contests, subject, size)
    named = {entrant.name: entrant for entrant in contest.entrants}
    if peer not in named:
        pytest.skip(f"{peer} would take minutes at {size}")
    ours, other = contest.entrants[0], named[peer]
    if reason := missing(other.needs):
        pytest.skip(reason)
    alone = dataclasses.replace(contest, entrants=(ours, other))
    found = held(alone, TURNS)
    benchmark.pedantic(ours.solve, rounds=TURNS)
    own, theirs = found.places
    ratio = found.ratio(theirs)
    told = {"peer": peer, "seconds": own.fastest, "error": own.error}
    benchmark.extra_info |= told | {"peer over ours": ratio, "error of the peer": theirs.error}
    measured(f"{contest.title}: {peer} over ours", float(f"{ratio:.3g}"))
    assert own.error < WRONG.get(subject, math.inf)
    assert ratio >= AHEAD.get((subject, peer), 0.0)
