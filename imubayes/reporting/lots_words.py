"""Names and numbers of a class-level study as its report prints them."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from imubayes.reporting.rounding import measured, pretty
from imubayes.reporting.scene_words import budget_unit, lasting
from imubayes.reporting.scene_words import share as share_of_budget
from imubayes.selection.relevance import MATTERS

if TYPE_CHECKING:
    from imubayes.campaign import Mission
    from imubayes.inference.intervals import Share
    from imubayes.lots.answers import Coverage, MissionFound, MissionTerm
    from imubayes.sensors.sensor_class import SensorClass
    from imubayes.sensors.terms import Kind

NARROW = "\u00a0"
"""Space before a percent sign, where no line ends."""

GRADES = ("consumer", "industrial", "tactical", "navigation", "strategic")
"""Words of a class's id that go first in a sentence."""

SPELLED = frozenset({"mems", "fog", "ifog", "rlg", "hrg", "vba", "piga", "sdf", "rig", "dtg", "cvg"})
"""Words of a class's id that are spelled in capitals."""

MAJORITY = 0.5
"""Share of a lot's units from which its class is said to need a term."""


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


def scene_name(name: str) -> str:
    """Name of a scene in a sentence."""
    return name.replace("_", " ")


def percent(share: float) -> str:
    """Share in percent."""
    return f"{100.0 * share:.0f}{NARROW}%"


def of_budget(share: float) -> str:
    r"""Share of a budget, to go before "the budget".

    Examples
    --------
    >>> of_budget(0.0004), of_budget(0.62), of_budget(7.3)
    ('0.1\xa0% of the budget', '62\xa0% of the budget', '7.3 times the budget')
    """
    text = share_of_budget(share).removeprefix("below ").replace(" %", f"{NARROW}%")
    return f"{text} the budget" if text.endswith("times") else f"{text} of the budget"


def ranged(found: Share, unit: str = "", size: float = 1.0) -> str:
    """Value with its interval in a printed unit, rounded to two digits of the interval's half width.

    Parameters
    ----------
    found : SI.
    unit : printed unit.
    size : SI value of one printed unit.

    Examples
    --------
    >>> from imubayes.inference.intervals import Share
    >>> ranged(Share(4.18e-5, 3.9e-5, 4.5e-5), "ppm", 1e-6)
    '41.8 (39.0 to 45.0) ppm'
    """
    if math.isnan(found.value):
        return ""
    value, low, high = (x / size for x in (found.value, found.low, found.high))
    rounded = measured(value, 0.5 * (high - low))
    power = 10.0**-rounded.exponent
    texts = (_as_fine(x * power, rounded.sd or rounded.value.lstrip("-")) for x in (value, low, high))
    middle, *ends = (text.replace("-", "−") for text in texts)
    raised = f"e{rounded.exponent} " if rounded.exponent else ""
    return f"{middle} ({ends[0]} to {ends[1]}) {raised}{pretty(unit)}".rstrip()


def _as_fine(value: float, sd: str) -> str:
    """Digits of a value down to the second one of `sd`.

    Examples
    --------
    >>> _as_fine(24155.0, "2300"), _as_fine(-1.234, "0.21")
    ('24200', '-1.23')
    """
    decimals = len(sd.partition(".")[2]) or min(2 - len(sd), 0)
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"


def shares(found: Share) -> str:
    r"""Share of the units with its interval.

    Examples
    --------
    >>> from imubayes.inference.intervals import Share
    >>> shares(Share(0.9, 0.64, 0.98))
    '90\xa0% (64 to 98)'
    """
    return f"{percent(found.value)} ({100.0 * found.low:.0f} to {100.0 * found.high:.0f})"


def covered(found: Coverage) -> str:
    r"""How many truths their intervals hold, with the share's interval.

    Examples
    --------
    >>> from imubayes.inference.intervals import Share
    >>> from imubayes.lots.answers import Coverage
    >>> covered(Coverage(9, 10, Share(0.9, 0.64, 0.98)))
    '9 of 10 cases, 90\xa0% (64 to 98)'
    """
    return f"{found.held:,} of {found.of:,} cases, {shares(found.share)}"


def budget(mission: Mission, kind: Kind) -> str:
    """Duration and budget of a scene in words."""
    quantity, limit = mission.budget.quantity, mission.budget.limit
    unit, size = budget_unit(quantity, kind)
    what = "rms error of the output" if quantity == "output" else quantity
    return f"{lasting(mission.scene.duration)}, budget {limit / size:.4g} {pretty(unit)} of {what}"


def required(found: MissionFound) -> tuple[str, ...]:
    """Terms that the smallest model has in at least half of the units."""
    return tuple(term.name for term in found.terms if term.required >= MAJORITY)


def counts(term: MissionTerm) -> bool:
    """Whether a table of a scene shows a term: it is required in some unit, or takes a hundredth."""
    return term.required > 0.0 or max(term.share.high, term.true_share) >= 0.1 * MATTERS
