"""Published values made by hand: what a test does not speak of is blank, or that of the quickstart."""

from __future__ import annotations

import json
import math
from pathlib import Path

from imubayes.reporting.result.file import Written
from imubayes.reporting.result.sensors import Term

FILE = Written(Path("result.json"), "", "study", "1", {})

BLANK = {"str": "", "Number": math.nan, "Names": (), "Numbers": ()}

QUICKSTART = json.loads(
    (Path(__file__).parents[2] / "reports" / "quickstart" / "result.json").read_text(encoding="utf-8")
)


def a_term(name: str, mean: float, sd: float, verdict: str = "needed", unit: str = "m/s^2") -> Term:
    """Term with its mean and sd under the full library."""
    blank = {key: BLANK[kind] for key, kind in Term.__annotations__.items()}
    return Term(**blank | {"name": name, "unit": unit, "printed_unit": unit, "full_mean": mean, "full_sd": sd,
                           "inclusion": 1.0, "verdict": verdict})  # fmt: skip
