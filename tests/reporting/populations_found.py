"""Units of a class as a study finds them: results made by hand, put together as those of a study are."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from results_found import sensor_result

from imubayes.campaign import SensorResult, SensorSpec
from imubayes.population.sessions import ClassInCommon, in_common
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.terms import Library, library

UNITS = tuple(f"IMU-{k}" for k in range(1, 9))
SESSIONS = ("monday", "tuesday", "friday")
MEMS = sensor("mems_consumer", kind="accelerometer")
VERDICTS = {"b0": "needed", "b3": "not needed", "m_j": "needed", "c_jj": "inseparable", "c_kk": "inseparable"}
LIB = Library("accelerometer", tuple(t for t in library("accelerometer").terms if t.name in VERDICTS))


@cache
def class_found(sessions: tuple[str, ...] = SESSIONS) -> ClassInCommon:
    """Two axes: a bias that moves, a misalignment of one that stays, and what is not there or not told."""
    (found,) = in_common(_tested(sessions))
    return found


def _tested(sessions: tuple[str, ...]) -> Iterator[tuple[SensorSpec, list[SensorResult]]]:
    """Each unit in each session, but the last unit in the last; between these all biases move alike."""
    rng, made = np.random.default_rng(3), sensor_result(lib=LIB)
    own, common = rng.normal(1.0, 0.3, (len(UNITS), 3)), 0.01 * rng.normal(size=len(sessions))
    for u, s in np.ndindex(len(UNITS), len(sessions)):
        if (u, s) == (len(UNITS) - 1, len(SESSIONS) - 1):
            continue
        spec = SensorSpec(
            f"{UNITS[u]} {sessions[s]}", LIB.kind, MEMS, LIB, (), {}, unit=UNITS[u], session=sessions[s]
        )
        found = []
        for axis, bias, tilt in (("ax", own[u, 0], own[u, 2]), ("az", own[u, 1], None)):
            size = {"b0": bias + common[s], "m_j": tilt}
            terms = []
            for term in (one for one in made.selection.terms if size.get(one.name, 0.0) is not None):
                sd = 0.99 if VERDICTS[term.name] == "inseparable" else 5e-3
                mean = term.prior_sd * (size.get(term.name, 0.0) + sd * rng.normal())
                known = {"full_mean": mean, "full_sd": sd * term.prior_sd, "verdict": VERDICTS[term.name]}
                terms.append(replace(term, **known))
            columns = tuple(term.name for term in terms)
            selection = replace(made.selection, terms=tuple(terms), columns=columns)
            found.append(replace(made, id=f"{spec.id}.{axis}", class_id=MEMS.id, selection=selection))
        yield spec, found
