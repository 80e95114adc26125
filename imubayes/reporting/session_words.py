"""What changes between sessions, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from imubayes.population.sessions import SUSPECT
from imubayes.reporting.rounding import measured, per_unit
from imubayes.selection.verdicts import listed
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.population.sessions import Repeatability

COMMON = 0.5
"""Share of the scatter that all units have in common from which one cause for all is likely."""

MOST_NAMES = 6
"""Parameters that a sentence names."""


def together(found: list[Repeatability]) -> list[Repeatability]:
    """Leave a triad's axes to the parameter that holds them all together."""
    names = {one.parameter for one in found}
    return [
        one
        for one in found
        if "." not in one.parameter or one.parameter.rpartition(".")[2] not in names
    ]  # fmt: skip


def session_sentence(found: tuple[Repeatability, ...]) -> str:
    """Say which parameters change between sessions by more than their posteriors allow; units in ASCII."""
    every = together(list(found))
    told = [one for one in every if not math.isnan(one.p_value)]
    moving = sorted((one for one in told if one.exceeds), key=lambda one: one.p_value)
    silent = [one.parameter for one in every if math.isnan(one.p_value)]
    count = counted(len(told), "parameter")
    if moving:
        text = f"{len(moving)} of {count} change{'s' if len(moving) == 1 else ''} {_moving(moving)}"
    elif told:
        text = f"Of {count} none changes between sessions by more than its error bars allow."
    else:
        text = "The sessions cannot be compared."
    if told:
        text += (
            f" Each test alarms below p {told[0].level:.1g}, so that chance alone makes"
            f" {100 * SUSPECT:.0f} % of studies at most do so."
        )
    return text + (f" The sessions cannot tell of {listed(silent)}." if silent else "")


def _moving(moving: list[Repeatability]) -> str:
    most = listed(f"{one.parameter} (sd {amount(one)})" for one in moving[:MOST_NAMES])
    others = f", and {len(moving) - MOST_NAMES} more" if len(moving) > MOST_NAMES else ""
    text = (
        f"between sessions by more than the error bars allow: {most}{others}."
        " What one session finds holds for the next only within these sds."
    )
    alike = [one for one in moving if one.shared > COMMON and one.shared > 2.0 / len(one.units)]
    if not alike:
        return text
    shares = listed(f"{one.shared:.0%} of the scatter of {one.parameter}" for one in alike[:MOST_NAMES])
    return f"{text} All units have {shares} in common, as temperature would make it."


def amount(one: Repeatability) -> str:
    """Sd between sessions in the unit that people use."""
    return str(measured(one.between[0] / per_unit(one.printed, one.unit), 0.0, one.printed))
