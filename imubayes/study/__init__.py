"""From a study's file to its results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imubayes.campaign import SensorResult, Study
    from imubayes.population.sessions import ClassInCommon, Repeatability
    from imubayes.scenes.relevance import CaseRelevance, Relevance


@dataclass(frozen=True, slots=True, eq=False)
class StudyResult:
    """Results of a study, an entry for each component; of scenes with its id or that of its case."""

    study: Study
    sensors: tuple[SensorResult, ...]
    sessions: tuple[Repeatability, ...] = ()
    scenes: tuple[tuple[str, Relevance], ...] = ()
    case_scenes: tuple[tuple[str, CaseRelevance], ...] = ()
    classes: tuple[ClassInCommon, ...] = ()
