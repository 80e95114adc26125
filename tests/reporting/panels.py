"""Every other method beside a decision, made by hand: no engine is needed to test what is printed of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from imubayes.campaign import SensorResult
from imubayes.inference.misfit import Dependence, Misfit
from imubayes.selection.compensations import Reduced
from imubayes.selection.criteria import Criterion
from imubayes.selection.panel import Disagreement, Panel, Votes
from imubayes.selection.sensitivity import Sensitivity
from imubayes.selection.sindy import Sparse
from imubayes.selection.verdicts import TermVerdict

UG = 9.80665e-6

CRITERIA = ("aic", "aicc", "bic", "hqc", "ebic", "waic", "loo", "leave_one_run_out")
OPTIMIZERS = ("stlsq", "sr3", "ssr", "frols")


def panel_of(sensor: SensorResult, *, liberal: tuple[str, ...] = ("aic", "waic", "sr3")) -> Panel:
    """Every method on a component; those that are `liberal` keep the first term that the others drop."""
    terms = tuple(term for term in sensor.selection.terms if term.verdict != "untested")
    names, p = tuple(term.name for term in terms), len(terms)
    model = tuple(name for name in sensor.selection.model if name in names)
    extra = next((name for name in names if name not in model), names[-1])
    other = tuple(name for name in names if (name in model) is not (name == extra))
    models = {name: other if name in liberal else model for name in (*CRITERIA, *OPTIMIZERS)}
    inclusion = {name: dict(zip(names, np.clip(_shares(names, kept), 0.0, 1.0), strict=True))
                 for name, kept in models.items()}  # fmt: skip
    criteria = tuple(
        Criterion(name, models[name], -8100.0 - k, 2.5 + k, inclusion[name], 2**p, name != "loo",
                  412.0 if k < 5 else math.nan, 0.31 if name == "loo" else math.nan)
        for k, name in enumerate(CRITERIA)
    )  # fmt: skip
    sparse = tuple(_sparse(name, terms, models[name], inclusion[name]) for name in OPTIMIZERS)
    widths = np.geomspace(0.1, 10.0, 9)
    nominal = np.array([term.inclusion for term in terms])
    over = nominal[None] / (nominal + (1.0 - nominal) * widths[:, None] ** 0.8)
    sensitivity = Sensitivity(names, widths, over, np.where(nominal > 0.9, 1.0, 0.6 * nominal), (), (extra,))
    methods = ("evidence", "g-prior", *CRITERIA, *OPTIMIZERS)
    strength = np.array([nominal, sensitivity.g_prior,
                         *(np.array(list(inclusion[name].values())) for name in models)])  # fmt: skip
    keeps = np.array(
        [[n in model for n in names]] * 2 + [[n in kept for n in names] for kept in models.values()]
    )
    told = Disagreement(extra, liberal, "weak effect", f"{', '.join(liberal)} keep {extra}: 0.1 sd from zero")
    votes = Votes(names, methods, strength, keeps.astype(float), (told,) if liberal else ())
    path = tuple((model[:k], 9e-4 * 0.2**k) for k in range(len(model) + 1))
    reduced = Reduced(model[:4], np.full(4, 1e-3), 2e-6, path[4][1], path)
    return Panel(criteria, sparse, sensitivity, votes, reduced)


def _sparse(
    name: str, terms: tuple[TermVerdict, ...], model: tuple[str, ...], inclusion: dict[str, float]
) -> Sparse:
    """A sparse regression whose terms drop out below the threshold, or the weakest first."""
    size = np.array([abs(term.mean) / term.sd for term in terms])
    weakest = np.argsort(np.argsort(size))
    by_threshold = name in OPTIMIZERS[:2]
    strength = np.geomspace(0.3, 300.0, 25) if by_threshold else np.arange(len(terms) + 1.0)
    kept = size > strength[:, None] if by_threshold else weakest >= len(terms) - strength[:, None]
    return Sparse(
        name, tuple(term.name for term in terms), model, inclusion, strength, np.where(kept, size, 0.0),
        np.zeros(len(strength)), 12 if by_threshold else len(model), model[:5], 0.75, 0.8,
    )  # fmt: skip


def _shares(names: tuple[str, ...], kept: tuple[str, ...]) -> np.ndarray:
    """Weights of a method's terms: those that it keeps above one half, the others below."""
    rng = np.random.default_rng(len(kept))
    return np.array([0.97 if name in kept else 0.1 for name in names]) + 0.03 * rng.uniform(
        -1.0, 1.0, len(names)
    )


def misfit_of(sensor: SensorResult) -> Misfit:
    """A component whose output hangs behind the temperature: 40 ug between heating and cooling."""
    T = np.tile(np.linspace(263.15, 333.15, 8), 2)
    branch = np.repeat([1.0, -1.0], 8)
    run = sensor.runs[0].name
    mean, sd = 20.0 * UG * branch * np.sin(np.pi * (T - 263.15) / 70.0), np.full(16, 4.0 * UG)
    loop = Dependence(run, "hysteresis of T", 3e-7, 0.41, 28.0 * UG, T, mean, sd, branch)
    none = replace(loop, input="f_i", p=0.4, share=0.01, x=T - 298.0, branch=np.zeros(16), mean=np.zeros(16))
    text = "The residuals hold something the library does not contain: T between heating and cooling."
    return Misfit((loop, none), (loop,), {r.name: 0.3 for r in sensor.runs}, text)
