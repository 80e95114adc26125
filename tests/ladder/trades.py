"""Small trades, shared by tests: problems that a rung answers in a moment, and answers that are made up."""

from __future__ import annotations

import math
from pathlib import Path

import ladders
import numpy as np
from recorded_scenes import recorded

from imubayes.campaign import Mission
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.ladder import RungName
from imubayes.ladder.problem import Problem
from imubayes.ladder.trade.components import Subject, Trade
from imubayes.ladder.trade.measurement import Measured, here
from imubayes.scenes.propagation import Budget

SHORT = Limits(ess=100.0, time_limit=1.0, seed=1)


def problem(**reference: float) -> Problem:
    """A short tumble."""
    return ladders.problem(dwell=4.0, reference=reference)


def mission() -> Mission:
    """Ten seconds along all axes, with a budget of the output."""
    t = np.arange(0.0, 10.0, 0.1)
    wave = np.column_stack([np.sin((k + 1.0) * t + k) for k in range(3)])
    scene = recorded("shaken", t, np.array([0.0, 0.0, 9.8]) + 8.0 * wave, 0.5 * wave)
    return Mission("shaken", scene, Budget("output", 1e-3))


def trade(**options) -> Trade:
    """Two rungs on one component and six repeats of it, in this process."""
    asked = {
        "title": "<b>small</b>",
        "seed": 3,
        "path": Path("small.toml"),
        "text": "[study]",
        "subjects": (Subject("<ACC>", problem()),),
        "missions": (mission(),),
        "rungs": ("means", "plug-in"),
        "repeats": 6,
        "limit": 600.0,
        "processes": 1,
    }
    return Trade(**{**asked, **options})


def in_this_process(problem: Problem, rung: RungName, limits: Limits, seed: tuple[int, ...]) -> Measured:
    """Measure a rung without a process of its own, and briefly."""
    return here(problem, rung, SHORT, seed)


def told(rung: RungName = "plug-in", seconds: float = 0.1, **options) -> Measured:
    """An answer about three terms: one is there, one is not, one cannot be told."""
    asked = {
        "rung": rung,
        "names": ("b0", "b1", "b2"),
        "mean": np.array([1.0, 0.0, 0.0]),
        "inclusion": np.array([1.0, 0.02, 0.4]),
        "full_mean": np.array([1.0, 0.01, 0.0]),
        "full_sd": np.array([0.01, 0.01, 1.0]),
        "prior_sd": np.array([1.0, 1.0, 1.0]),
        "limit95": np.array([1.02, 0.02, 2.0]),
        "verdicts": ("needed", "not needed", "unresolved"),
        "model": ("b0",),
        "draws": np.tile([1.0, 0.0, 0.0], (4, 1)),
        "noises": np.array([[[1.0, 0.1, 0.0]], [[2.0, 0.1, 0.0]]]),
        "monte_carlo": np.zeros(3),
        "ess": math.inf,
        "wanting": 1.0,
        "chain_seconds": 0.0,
        "seconds": seconds,
        "processor_seconds": 1.5 * seconds,
        "memory": 2e7,
        "foreseen": (math.nan, math.nan) if rung == "raw" else (0.3, 0.01),
    }
    return Measured(**{**asked, **options})
