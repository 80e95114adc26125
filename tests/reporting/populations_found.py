"""Units of a class as a study finds them, made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imubayes.inference import Share
from imubayes.population.needs import Need
from imubayes.population.pooled import Pooled
from imubayes.population.sessions import ClassInCommon, TermInClass
from imubayes.population.spreads import Spreads

UG = 9.80665e-6
UNITS = tuple(f"IMU-{k}" for k in range(1, 9))
SESSIONS = ("monday", "tuesday", "friday")
UNIT = {"b0": ("m/s^2", "ug", UG), "m_j": ("rad", "urad", 1e-6), "c_jj": ("(m/s^2)^-1", "ug/g^2", 1.02e-7)}
UNIT["c_kk"] = UNIT["c_jj"]
ANSWER = {"needed": "needed", "not needed": "not needed", "cannot tell": "inseparable"}


def spreads_found(size: float, *, moves: bool, single: bool, several: bool = False) -> Spreads:
    """Units that differ by 30 of `size`, in sessions that move by 1 of it where they do."""
    spread = Share(30.0 * size, 20.0 * size, 50.0 * size)
    turn_on = Share(size, 0.5 * size, 3.0 * size) if moves else Share(0.02 * size, 0.0, 0.06 * size)
    common = Share(0.9, 0.6, 0.99) if moves else Share(0.5, 0.0, 1.0)
    alone = not single and not several
    shift = size * np.array([0.8, 0.73, -1.53]) if alone else np.zeros(0)
    shift_sd = size * np.array([0.9, 0.9, 0.19]) if alone else np.zeros(0)
    found = Spreads(0.2 * size, 0.1 * size, unit_to_unit=spread, shift=shift, shift_sd=shift_sd)
    if not several:
        mean, band = (Share(-250.0 * size, (-250.0 - x) * size, (-250.0 + x) * size) for x in (20.0, 50.0))
        found = replace(found, mean=mean, mean_sd=12.0 * size, next_unit=band)
    if single:
        return found
    p = 1e-9 if moves else 0.4
    return replace(
        found, turn_on=turn_on, turn_on_own=turn_on, turn_on_common=turn_on, common_share=common, p_value=p
    )


def term_found(
    name: str,
    component: str = "",
    *,
    verdict: str = "needed",
    sessions: tuple[str, ...] = SESSIONS,
    several: bool = False,
) -> TermInClass:
    """One term; `several` for all axes together."""
    si, printed, unit = UNIT[name]
    size = 1e3 * unit
    rng = np.random.default_rng(len(name + component))
    units = tuple(f"{u}.{c}" for c in ("ax", "az") for u in UNITS) if several else UNITS
    value = -250.0 * size + 30.0 * size * rng.normal(size=(len(units), 1))
    value = value + size * rng.normal(size=(len(units), len(sessions)))
    if len(sessions) > 1:
        value[-1, -1] = np.nan
    # a further unit has with 95 % none of what is not needed
    has = Pooled(1.0, Share(0.9, 0.7, 1.0), 330.0 * size)
    together = Pooled(0.11, Share(0.08, 0.02, 0.3), 0.0) if verdict == "not needed" else has
    need = Need(verdict, "as made", {ANSWER[verdict]: len(units)}, Share(1.0, 0.8, 1.0), together)
    single = len(sessions) == 1
    return TermInClass(
        f"{component}.{name}" if component else name,
        si,
        printed,
        name,
        component,
        40.0 * size,
        spreads_found(size, moves=name == "b0", single=single, several=several),
        units,
        sessions,
        value,
        np.full_like(value, 0.22 * size),
        need,
    )


def class_found(sessions: tuple[str, ...] = SESSIONS) -> ClassInCommon:
    """Two axes: a bias that moves, a misalignment of one axis that does not, a term that nothing tells."""
    options = {"sessions": sessions}
    terms = (
        term_found("b0", several=True, **options),
        term_found("b0", "ax", **options),
        term_found("b0", "az", **options),
        term_found("m_j", "ax", verdict="not needed", **options),
        term_found("c_jj", several=True, verdict="cannot tell", **options),
        term_found("c_jj", "ax", verdict="cannot tell", **options),
        term_found("c_jj", "az", verdict="cannot tell", **options),
    )
    return ClassInCommon("mems_consumer", "accelerometer", UNITS, sessions, ("ax", "az"), terms)
