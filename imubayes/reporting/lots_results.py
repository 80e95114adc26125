"""A class-level study as plain values for ``result.json``: SI units, finite numbers or null."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import imubayes
from imubayes.population.needs import (
    NEEDED,
    NOT_NEEDED,
    UNTOLD,
    WOULD_MATTER,
    in_scene,
    of_class,
    terms_in,
    terms_of,
)
from imubayes.reporting.lots_headline import simulated, status
from imubayes.reporting.lots_sentences import lots_answer
from imubayes.reporting.quality_page import finite
from imubayes.reporting.results import versions

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.population.lots import LotResult
    from imubayes.population.needs import ClassFound
    from imubayes.population.records import Record
    from imubayes.population.scenes import MissionFound


def lots_json(result: LotResult) -> str:
    """Text of ``result.json``: SI; what is not finite becomes null."""
    study = result.study
    document = {
        "imubayes": imubayes.__version__,
        "study": study.title,
        "seed": study.seed,
        "answer": [one.text for one in lots_answer(result)],
        "status": status(result),
        "simulated": simulated(result),
        "scenes": [_scene_entry(one, scene) for one in result.classes for scene in one.missions],
        "lots": {
            "kind": study.kind,
            "units": study.units,
            "terms": study.library.names,
            "classes": [_class_entry(one) for one in result.classes],
            "check": asdict(result.check),
        },
        "provenance": {
            "study_file": str(study.path),
            "study_text": study.text,
            "command": f"imubayes run {study.path}",
            "versions": versions(),
        },
    }
    return json.dumps(finite(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _scene_entry(found: ClassFound, scene: MissionFound) -> dict[str, Any]:
    """A scene with the keys of ordinary studies; `sensor` is the class, `model` what it needs."""
    return {
        "name": scene.mission,
        "sensor": found.sensor_class.id,
        "model": terms_in(found, scene, NEEDED),
        "would_matter": terms_in(found, scene, WOULD_MATTER),
        "cannot_tell": terms_in(found, scene, UNTOLD),
        "terms": [
            {
                "name": term.name,
                "rms": term.rms,
                "share_of_budget": term.share.value,
                "share_range": (term.share.low, term.share.high),
                "required": term.required,
                "true_share_of_budget": term.true_share,
                "answer": in_scene(known, term),
            }
            for known, term in zip(found.terms, scene.terms, strict=True)
        ],
        "order": _entry(scene.order),
        "within": scene.within,
        "noise_share_of_budget": scene.noise_share,
        "basic_share_of_budget": scene.basic_share,
    }


def _class_entry(found: ClassFound) -> dict[str, Any]:
    return {
        "id": found.sensor_class.id,
        "order": _entry(found.order),
        "needed": terms_of(found, NEEDED),
        "not_needed": terms_of(found, NOT_NEEDED),
        "cannot_tell": terms_of(found, UNTOLD),
        "terms": [asdict(term) | {"answer": of_class(term)} for term in found.terms],
        "units": [_unit_entry(unit) for unit in found.units],
    }


def _unit_entry(unit: Record) -> dict[str, Any]:
    arrays = ("truth", "mean", "sd", "inclusion", "full_mean", "full_sd")
    return {
        "number": unit.number,
        **{name: getattr(unit, name).tolist() for name in arrays},
        "verdicts": unit.verdicts,
        "noise": dict(zip("NBK", unit.noise, strict=True)),
    }


def _entry(found: Share) -> dict[str, float]:
    return asdict(found)
