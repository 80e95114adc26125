"""Results of many units as they are published: a class-level study, and a fleet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import imubayes
from imubayes.population.needs import (
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    VERDICTS,
    WOULD_MATTER,
    in_scene,
    of_class,
    terms_in,
    terms_of,
)
from imubayes.reporting.lots_sentences import lots_answer
from imubayes.reporting.lots_words import fleet_answer, simulated, status
from imubayes.reporting.provenance import provenance
from imubayes.reporting.result.file import result_text
from imubayes.reporting.result.many import (
    Class,
    ClassInScene,
    ClassTerm,
    ClassTermInScene,
    Fleet,
    FleetResult,
    FleetTerm,
    Lots,
    LotsResult,
)
from imubayes.reporting.result.values import published
from imubayes.sensors.equations.standards import symbols

if TYPE_CHECKING:
    from imubayes.population import fleet
    from imubayes.population.lots import LotResult, MissionFound
    from imubayes.population.needs import ClassFound


def lots_json(result: LotResult) -> str:
    """Text of ``result.json`` of a class-level study."""
    return result_text(published_lots(result))


def published_lots(result: LotResult) -> LotsResult:
    """Publish what a class-level study found."""
    study = result.study
    return LotsResult(
        imubayes=imubayes.__version__,
        study=study.title,
        seed=study.seed,
        answer=tuple(text for text, _ in lots_answer(result)),
        status=status(result),
        simulated=simulated(result),
        scenes=tuple(_scene(one, scene) for one in result.classes for scene in one.missions),
        lots=published(
            Lots,
            study,
            terms=study.library.names,
            classes=tuple(map(_class, result.classes)),
            check=result.check,
        ),
        provenance=provenance(study.path, study.text, f"imubayes run {study.path}"),
    )


def _scene(found: ClassFound, scene: MissionFound) -> ClassInScene:
    terms = tuple(
        published(
            ClassTermInScene,
            term,
            share_of_budget=term.share.value,
            share_range=(term.share.low, term.share.high),
            true_share_of_budget=term.true_share,
            answer=in_scene(known, term),
        )
        for known, term in zip(found.terms, scene.terms, strict=True)
    )
    return published(
        ClassInScene,
        scene,
        name=scene.mission,
        sensor=found.sensor_class.id,
        model=terms_in(found, scene, NEEDED),
        would_matter=terms_in(found, scene, WOULD_MATTER),
        cannot_tell=terms_in(found, scene, UNTOLD),
        terms=terms,
        noise_share_of_budget=scene.noise_share,
        basic_share_of_budget=scene.basic_share,
    )


def _class(found: ClassFound) -> Class:
    return published(
        Class,
        found,
        id=found.sensor_class.id,
        needed=terms_of(found, NEEDED),
        not_needed=terms_of(found, NOT_NEEDED),
        cannot_tell=terms_of(found, UNTOLD),
        terms=tuple(published(ClassTerm, term, answer=of_class(term)) for term in found.terms),
    )


def fleet_json(result: fleet.FleetResult) -> str:
    """Text of ``result.json`` of a fleet."""
    study, answer = result.study, result.answer
    document = published(
        FleetResult,
        result,
        imubayes=imubayes.__version__,
        study=study.title,
        seed=study.seed,
        answer=fleet_answer(result),
        fleet=published(
            Fleet,
            answer,
            kind=study.spec.kind,
            **{"class": study.sensor_class.id},
            units=len(study.units),
            read=answer.units,
            terms=tuple(_fleet_terms(result)),
        ),
        provenance=provenance(study.path, study.text, f"imubayes run {study.path}"),
    )
    return result_text(document)


def _fleet_terms(result: fleet.FleetResult) -> Iterator[FleetTerm]:
    library, answer = result.study.spec.library, result.answer
    known = symbols(library)
    for term, found, counts in zip(library.terms, answer.terms, answer.counts.T.tolist(), strict=True):
        yield published(
            FleetTerm,
            found,
            symbol=known[term.name],
            unit=term.unit,
            verdicts=dict(zip(VERDICTS, counts, strict=True)),
        )
