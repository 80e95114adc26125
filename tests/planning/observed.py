"""What plans can tell of a sensor's terms, on a bench with errors or without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import imubayes as ib
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.inference.observability import Observability, observe
from imubayes.inference.prior import class_sd
from imubayes.inference.summary import Summary, summarize
from imubayes.rig.plans import Plan
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import NoiseRule

KIND = {"fog_navigation": "gyroscope", "mech_sdf_rig": "gyroscope"}
"""Kind of a class that is none of accelerometers."""


def observed(
    class_id: str, plans: Sequence[Plan], bench: Mapping[str, float] | None = None, **options
) -> tuple[Observability, Summary]:
    """Observability of plans on a sensor with the typical noise of its class, and the summary it is of."""
    kind = KIND.get(class_id, "accelerometer")
    sensor, library = ib.sensor(class_id, kind=kind), ib.library(kind, **options)
    runs = ib.simulate(sensor, plans, seed=1, truth={})
    rules = {run.name: NoiseRule("fixed", typical_noise(sensor)) for run in runs}
    extras = extras_for(runs, bench or {}, sensor=kind)
    rows = rows_with(runs, library, extras, np.zeros(len(library.terms)), np.zeros(len(extras)))
    summary = summarize(runs, library, sensor=sensor, rules=rules, rows=rows, extras=extras)
    sd = np.concatenate((class_sd(sensor, library), [extra.sd for extra in extras]))
    return observe(summary.factor, sd, summary.facts, reach=summary.reach), summary
