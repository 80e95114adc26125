"""The whole measurement: try every method on simulated sensors, and score them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import numpy as np

from imubayes.population.processes import Progress
from imubayes.sensors.terms import Kind
from studies.decision_quality.scores import Scores, scores
from studies.decision_quality.trials import QualityStudy, Trial, trials


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """How good the decision and its rivals are.

    Attributes
    ----------
    study : that was run.
    trials : what every method said of every sensor.
    scores : for each treatment, of both kinds of sensors together and then of each.
    seconds : that it took.
    """

    study: QualityStudy
    trials: tuple[Trial, ...]
    scores: tuple[Scores, ...]
    seconds: float

    @property
    def overall(self) -> tuple[Scores, ...]:
        """Scores of both kinds of sensors together, by treatment."""
        return tuple(one for one in self.scores if not one.kind)


def measure(study: QualityStudy, *, progress: Progress = lambda message: None) -> Quality:
    """Measure how good the decision and its rivals are.

    Parameters
    ----------
    study : as `config.read` gives it.
    progress : is told what goes on.
    """
    start = time.perf_counter()
    found = trials(study, progress=progress)
    progress("intervals")
    return Quality(study, found, tuple(_scored(study, found)), time.perf_counter() - start)


def _scored(study: QualityStudy, found: tuple[Trial, ...]) -> Iterator[Scores]:
    rng = np.random.default_rng([study.seed, 4])
    for treatment in study.treatments:
        for kind in ("", *get_args(Kind)):
            if any(t.treatment == treatment and kind in ("", t.kind) for t in found):
                yield scores(found, treatment, kind, rng=rng)
