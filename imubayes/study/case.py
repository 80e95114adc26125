"""What a decided case gives beyond its verdicts: compensation, pooled inclusion, quantities recovered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from imubayes.campaign.preparation import Prepared, compensation
from imubayes.campaign.study import SensorSpec
from imubayes.errors import ConvergenceError
from imubayes.inference.case import Case
from imubayes.inference.recovered import recover
from imubayes.population.classes import pooled_by_kind
from imubayes.selection.decision import Selection
from imubayes.sensors.terms import Kind


def of_case(
    spec: SensorSpec, case: Case, ready: Prepared, selections: Sequence[Selection]
) -> list[dict[str, Any]]:
    """Fields of `SensorResult` that the components of a case have for being in one case."""
    terms = [(one, term) for one in selections for term in one.terms]
    rows = compensation(spec, case, [term.mean for _, term in terms])
    kept = [
        # of what is unresolved the data say nothing of their own
        term.mean if term.name in one.model and term.verdict != "unresolved" else 0.0
        for one, term in terms
    ]
    runs = [run for run in ready.runs if not run.known]
    try:
        found = recover(case, runs, ready.prior.sd, np.array(kept))
    except ConvergenceError:  # data and prior disagree, which the report says first of all
        found = ()
    kinds: list[Kind] = [one.library.kind for one in case.components]
    pooled = pooled_by_kind(kinds, selections)
    return [
        {"calibration": row, "pooled": pooled[kind], "recovered": found}
        for row, kind in zip(rows, kinds, strict=True)
    ]
