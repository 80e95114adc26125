"""Templates of exported source texts, and the algorithm's numbers that all of them share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imubayes.reporting.export.characterized import Characterized
from imubayes.reporting.export.equations import Language, lines
from imubayes.reporting.export.heading import heading, identifier
from imubayes.sensors.imu import COMPONENTS
from imubayes.sensors.imu_compensation import ROUNDING, split_jumps
from imubayes.sensors.imu_range import rounds
from imubayes.sensors.terms import REFERENCE_TEMPERATURE


def rendered(template: str, values: Mapping[str, Any]) -> str:
    """Text of a template beside this module.

    Raises
    ------
    jinja2.UndefinedError : if a template uses a value that is not given: a fault of ours.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("imubayes", "reporting/export"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # source texts, not HTML
    )
    return environment.get_template(template).render(**values)


def model_values(found: Characterized, language: Language) -> dict[str, Any]:
    """What the templates of compensations say: terms by component, ends of the range, steps.

    Raises
    ------
    InputError : if the model cannot be inverted over the range that was tested; names the terms.
    """
    smooth, jumps = split_jumps(found.imu)
    return {
        "heading": heading(found),
        "name": identifier(found),
        "components": lines(smooth, language),
        "jumps": lines(jumps, language),
        "index": {name: c for c, name in enumerate(COMPONENTS)},
        "uses_sign": any(f.signed for c in smooth.components for t in c.library.terms for f in t.factors),
        "jumping": any(component.library.terms for component in jumps.components),
        "ends": [language.number(end) for end in found.within.ends],
        "rounds": rounds(smooth, found.within),
        "reference": language.number(REFERENCE_TEMPERATURE),
        "rounding": language.number(ROUNDING),
    }
