"""Names and numbers of a class-level study as its report prints them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from imubayes.reporting.rounding import NARROW, duration, percents, pretty, share
from imubayes.reporting.scene_words import budget_unit
from imubayes.scenes.relevance import MATTERS

if TYPE_CHECKING:
    from imubayes.campaign.study import Mission
    from imubayes.inference.intervals import Share
    from imubayes.population.lots import Coverage
    from imubayes.population.scenes import MissionTerm
    from imubayes.sensors.sensor_class import SensorClass
    from imubayes.sensors.terms import Kind

GRADES = ("consumer", "industrial", "tactical", "navigation", "strategic")
"""Words of a class's id that go first in a sentence."""

SPELLED = frozenset({"mems", "fog", "ifog", "rlg", "hrg", "vba", "piga", "sdf", "rig", "dtg", "cvg"})
"""Words of a class's id that are spelled in capitals."""


def class_name(entry: SensorClass) -> str:
    """Name of a class in a sentence.

    Examples
    --------
    >>> from imubayes.sensors.catalogue import sensor
    >>> [class_name(sensor(name, kind="gyroscope")) for name in ("mems_tactical", "mech_sdf_rig")]
    ['tactical MEMS', 'SDF RIG']
    """
    words = [word for word in entry.id.split("_") if word != "mech"]
    grades = [word for word in words if word in GRADES]
    rest = [word.upper() if word in SPELLED else word for word in words if word not in GRADES]
    return " ".join((*grades, *rest))


def slug(*parts: str) -> str:
    """Anchor of classes, scenes and terms.

    Examples
    --------
    >>> slug("mems_tactical", "uav hover", "b0*T")
    'mems_tactical-uav-hover-b0-T'
    """
    return "-".join(re.sub(r"[^\w]+", "-", part).strip("-") for part in parts)


def capitalised(text: str) -> str:
    """Text that begins a sentence.

    Examples
    --------
    >>> capitalised("consumer MEMS")
    'Consumer MEMS'
    """
    return f"{text[:1].upper()}{text[1:]}"


def scene_name(name: str) -> str:
    """Name of a scene in a sentence."""
    return name.replace("_", " ")


def of_budget(taken: float) -> str:
    r"""Share of a budget, to go before "the budget".

    Examples
    --------
    >>> of_budget(0.0004), of_budget(0.62), of_budget(7.3)
    ('below 0.1\xa0% of the budget', '62\xa0% of the budget', '7.3 times the budget')
    """
    text = share(taken).replace(" %", f"{NARROW}%")
    return f"{text} the budget" if text.endswith("times") else f"{text} of the budget"


def covered(found: Coverage) -> str:
    r"""How many truths their intervals hold, with the share's interval.

    Examples
    --------
    >>> from imubayes.inference.intervals import Share
    >>> from imubayes.population.lots import Coverage
    >>> covered(Coverage(9, 10, Share(0.9, 0.64, 0.98)))
    '9 of 10 cases, 90\xa0% (64 to 98)'
    """
    return f"{found.held:,} of {found.of:,} cases, {percents(found.share)}"


def budget(mission: Mission, kind: Kind) -> str:
    """Duration and budget of a scene in words."""
    quantity, limit = mission.budget.quantity, mission.budget.limit
    unit, size = budget_unit(quantity, kind)
    what = "rms error of the output" if quantity == "output" else quantity
    return f"{duration(mission.scene.duration)}, budget {limit / size:.4g} {pretty(unit)} of {what}"


def amid(found: Share) -> str:
    """Median count of terms, with the range of 90 % of the units.

    Examples
    --------
    >>> from imubayes.inference.intervals import Share
    >>> amid(Share(12.5, 9.0, 14.0))
    '12.5 (9 to 14)'
    """
    return f"{found.value:.3g} ({found.low:.3g} to {found.high:.3g})"


def counts(term: MissionTerm) -> bool:
    """Whether a table of a scene shows a term: it is required in some unit, or takes a hundredth."""
    return term.required > 0.0 or max(term.share.high, term.true_share) >= 0.1 * MATTERS
