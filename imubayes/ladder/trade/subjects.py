"""Which components a study has for the rungs to answer: its sensors, or a unit of each class of its lots."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from imubayes.campaign.fidelity import RungName
from imubayes.campaign.preparation import runs_of
from imubayes.campaign.study import SensorSpec, Study
from imubayes.errors import InputError
from imubayes.ladder.problem import problem_of
from imubayes.ladder.trade.plan import ESS, LIMIT, NAMES, REPEATS, Subject, Trade, cores
from imubayes.population.lots import LotStudy, lot_of, spec_of
from imubayes.population.records import simulate_unit
from imubayes.rig.inputs import ImuRun, TriadRun
from imubayes.sensors.lots import Lot

FREE = "free tumbles and whole IMUs have one method, and no ladder"


def of_study(study: Study, only: Collection[str] = ()) -> Trade:
    """Trade of a study's sensors, those that are named or all.

    Raises
    ------
    InputError : if a sensor is not in the study, or none has runs with known inputs.
    """
    _check_named(only, [spec.id for spec in study.sensors], "sensor")
    subjects: list[Subject] = []
    left_out: list[tuple[str, str]] = []
    for k, spec in enumerate(study.sensors):
        if only and spec.id not in only:
            continue
        runs = runs_of(spec, study.seed, k)
        if any(isinstance(run, TriadRun | ImuRun) for run in runs):
            left_out.append((spec.id, FREE))
            continue
        problem = problem_of(spec, runs, costs=study.costs, hierarchical=study.hierarchical)
        subjects.append(Subject(spec.id, problem))
    if not subjects:
        raise InputError(f"{study.path}: {FREE}: a trade needs a single component with known inputs")
    return Trade(
        title=study.title,
        seed=study.seed,
        path=study.path,
        text=study.text,
        subjects=tuple(subjects),
        missions=study.scenes,
        ess=study.sampling.ess,
        processes=cores(),
        left_out=tuple(left_out),
        only=tuple(only),
    )


def of_lots(study: LotStudy, only: Collection[str] = (), repeats: int = REPEATS) -> Trade:
    """Trade of one unit of each class of a class-level study, those that are named or all.

    Further units of each lot are the repeats, so that lots are drawn as large as `repeats` asks.

    Raises
    ------
    InputError : if a class is not in the study.
    """
    _check_named(only, [entry.id for entry in study.classes], "class")
    chosen = [k for k, entry in enumerate(study.classes) if not only or entry.id in only]
    larger = replace(study, units=1 + math.ceil(repeats / len(chosen)))
    subjects = []
    for k in chosen:
        lot = lot_of(larger, k)
        subjects.append(
            unit(lot, 0, spec_of(study, lot.sensor_class), np.random.default_rng([study.seed, k, 1, 0, 0]))
        )
    return Trade(
        title=study.title,
        seed=study.seed,
        path=study.path,
        text=study.text,
        subjects=tuple(subjects),
        missions=study.missions,
        processes=cores(),
        only=tuple(only),
    )


def with_options(
    trade: Trade,
    *,
    rungs: Sequence[RungName] = NAMES,
    repeats: int = REPEATS,
    limit: float = LIMIT,
    ess: float | None = None,
) -> Trade:
    """Trade with what the command line asks for.

    Raises
    ------
    InputError : if the number of repeats is negative.
    """
    if repeats < 0:
        raise InputError(f"{repeats} repeats: expected 0 (none) or more, such as {REPEATS}")
    return replace(trade, rungs=tuple(rungs), repeats=repeats, limit=limit, ess=ess or trade.ess or ESS)


def unit(lot: Lot, number: int, spec: SensorSpec, rng: np.random.Generator) -> Subject:
    """One unit of a lot after its campaign, on a bench with errors.

    Parameters
    ----------
    lot : that it is of.
    number : in the lot.
    spec : of any unit of the class.
    rng : draws the errors of the bench and the noise.
    """
    own = replace(spec, truth=lot.truth(number))
    return Subject(lot.sensor_class.id, problem_of(own, simulate_unit(own, lot, number, rng)), lot)


def _check_named(only: Collection[str], known: Sequence[str], what: str) -> None:
    for name in only:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"expected one of {', '.join(known)}"
            raise InputError(f"no {what} of the study is called '{name}': {hint}")
