"""What the command line asks of the sampling, in place of what the study says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imubayes.errors import InputError

if TYPE_CHECKING:
    from imubayes.campaign.study import Sampling


def overruled(usual: Sampling, method: str | None, ess: float | None, time_limit: str | None) -> Sampling:
    """Sampling of the study, with what the command line says in place of it."""
    if ess is not None and not 0.0 < ess < math.inf:
        raise InputError(f"--ess {ess:g}: expected a number of effective samples above zero, such as 1000")
    return replace(
        usual,
        method=usual.method if method is None else method,
        ess=usual.ess if ess is None else ess,
        time_limit=usual.time_limit if time_limit is None else duration(time_limit),
    )


def climbing(
    usual: Sampling, budget: str | None, accuracy: float | None, *, method: str | None, resume: bool
) -> Sampling:
    """Sampling with the budget or the accuracy that the command line asks for."""
    if budget is None and accuracy is None:
        return usual
    if method is not None or resume or (budget is not None and accuracy is not None):
        raise InputError(
            "--budget and --accuracy choose the method: give one of them, without --method and --resume"
        )
    if accuracy is not None and not 0.0 < accuracy < math.inf:
        raise InputError(f"--accuracy {accuracy:g}: expected posterior standard deviations, such as 0.1")
    return replace(usual, budget=None if budget is None else duration(budget, "--budget"), accuracy=accuracy)


def duration(text: str, option: str = "--time-limit") -> float:
    """Seconds of a quantity in time."""
    from imubayes.units import quantity

    try:
        seconds = quantity(text, like="s")
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if not seconds > 0.0:
        raise InputError(f"{option} '{text}': expected more than zero, such as '10 min'")
    return seconds


def check_resumable(method: str, chains: Path) -> None:
    """Refuse to resume where there are no chains, or none can be.

    Raises
    ------
    InputError : saying which.
    """
    if method == "exact":
        raise InputError("--resume continues chains, and the method 'exact' has none: run without --resume")
    if not any(chains.glob("*.h5")):
        raise InputError(
            f"{chains / '*.h5'}: there is no checkpoint to resume from: run without --resume, "
            "or name by --out the folder of the run that was interrupted"
        )
