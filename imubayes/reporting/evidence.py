"""Evidence of the full library at the estimated noise: what bridge sampling is held against."""

from __future__ import annotations

import math
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.factor import add, with_prior_rows

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult


def exact_evidence(sensor: SensorResult) -> float | None:
    """Log evidence of the data under the full library and the noise that whitened the runs, in closed form.

    With A the whitened rows in units of the prior's sds, y the whitened response and W the whitening,
    ``-2 ln p(y) = n ln(2 pi) - ln det W'W + ln det(I + A'A) + |y|^2 - |projection of y|^2``. None for a
    component of a triad, whose rows hold the other components too.
    """
    selection = sensor.selection
    sd = {column: term.prior_sd for column, term in zip(selection.columns, selection.terms, strict=True)}
    sd |= {entry.extra.name: entry.extra.sd for entry in sensor.extras}
    whole = reduce(add, (run.factor for run in sensor.runs))
    if not set(whole.names) <= sd.keys():
        return None
    scale = np.array([sd[name] for name in whole.names])
    R = with_prior_rows(whole.R * np.append(scale, 1.0), np.ones(len(scale)))
    log_det = 2.0 * float(np.sum(np.log(np.abs(np.diag(R)[:-1]))))
    return -0.5 * (whole.n * math.log(2.0 * math.pi) + whole.log_det + log_det + float(R[-1, -1]) ** 2)
