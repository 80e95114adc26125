"""The whole measurement: try every method on simulated sensors, and score them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from imubayes.work import Progress, silent
from studies.decision_quality.scores import Scores, Treated, scores, treated
from studies.decision_quality.trials import MODELLED, TREATMENTS, QualityStudy, Trial, trials


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """How good the decision and its rivals are: scores as modelled, and verdicts under every treatment."""

    study: QualityStudy
    trials: tuple[Trial, ...]
    scores: Scores
    treated: tuple[Treated, ...]
    seconds: float


def measure(study: QualityStudy, *, progress: Progress = silent) -> Quality:
    """Measure how good the decision and its rivals are; `progress` is told what goes on."""
    start = time.perf_counter()
    found = trials(study, progress=progress)
    progress("intervals")
    rng = np.random.default_rng([study.seed, 4])
    tried = [name for name in TREATMENTS if any(t.treatment == name for t in found)]
    verdicts = tuple(treated(found, name, rng=rng) for name in tried)
    return Quality(study, found, scores(found, MODELLED, rng=rng), verdicts, time.perf_counter() - start)
