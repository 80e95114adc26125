"""A small, complete and plausible result, made by hand: no engine is needed to test what is printed of it."""

import math
from dataclasses import asdict, fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from imubayes.algebra.factor import factor_of
from imubayes.campaign import Appendix, ExtraPosterior, SensorResult, SensorSpec, Study
from imubayes.inference.known_quantities import Recovered
from imubayes.inference.linear import Extra
from imubayes.inference.mcmc import Chains, Diagnostics
from imubayes.inference.misfit import Dependence, Misfit
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.observability import Confounded, Observability
from imubayes.inference.residuals import ResidualCheck
from imubayes.inference.robust import Distrusted
from imubayes.inference.summary import RunSummary
from imubayes.population.sessions import Repeatability
from imubayes.rig.inputs import Source
from imubayes.selection.compensations import Reduced
from imubayes.selection.criteria import Criterion
from imubayes.selection.decision import Selection
from imubayes.selection.mixture import Scales
from imubayes.selection.model_sets import Space
from imubayes.selection.models import Models
from imubayes.selection.panel import Disagreement, Panel, Votes
from imubayes.selection.sensitivity import Sensitivity
from imubayes.selection.sindy import Sparse
from imubayes.selection.verdicts import EQUAL, TermVerdict
from imubayes.sensors.equations import symbols
from imubayes.sensors.noise import Noise, allan_variance
from imubayes.sensors.terms import Library, Term, library
from imubayes.study import StudyResult

UG, MG = 9.80665e-6, 9.80665e-3
DEG = math.pi / 180.0

# mean, sd, prior sd, inclusion, verdict; in printed units
ACCELEROMETER = {
    "b0": (1502.1, 4.2, 1500.0, 1.0, "needed"),
    "b1": (310.24, 0.93, 300.0, 1.0, "needed"),
    "b2": (41.8, 0.62, 40.0, 1.0, "needed"),
    "b3": (0.01, 0.11, 8.0, 0.02, "not needed"),
    "b0p": (1.0, 3.1, 20.0, 0.31, "undecided"),
    "m_j": (-912.0, 2.4, 900.0, 1.0, "needed"),
    "m_k": (433.0, 2.4, 900.0, 1.0, "needed"),
    "c_jj": (12.0, 14.0, 40.0, 0.31, "inseparable"),
    "c_kk": (10.0, 14.0, 40.0, 0.29, "inseparable"),
    "c_jk": (1.1, 38.0, 40.0, 0.4, "unresolved"),
}
GYROSCOPE = {
    "b0": (11.2, 0.31, 20.0, 1.0, "needed"),
    "b1": (-152.0, 4.4, 300.0, 1.0, "needed"),
    "g_i": (4.1, 0.2, 10.0, 0.999, "needed"),
    "m_j": (812.0, 12.0, 900.0, 1.0, "needed"),
}


def _partly(kind, **known):
    """Make a value whose other fields, which nothing here prints, stay empty."""
    return kind(**{field.name: known.get(field.name) for field in fields(kind)})


def _verdict(term: Term, symbol: str, row: tuple[float, float, float, float, str]) -> TermVerdict:
    from imubayes.reporting.rounding import per_unit

    unit = per_unit(term.printed, term.unit)
    mean, sd, prior_sd, inclusion, verdict = row
    mean, sd, prior_sd = mean * unit, sd * unit, prior_sd * unit
    partners = {"c_jj": ("c_kk",), "c_kk": ("c_jj",)}.get(term.name, ()) if verdict == "inseparable" else ()
    return TermVerdict(
        term.name, symbol, term.unit, term.printed, term.group,
        mean, sd, mean - 1.645 * sd, mean + 1.645 * sd, mean, sd, prior_sd,
        inclusion, (max(inclusion - 0.1, 0.0), min(inclusion + 0.05, 1.0)), abs(mean) + 2.0 * sd,
        abs(mean) / unit * (UG if term.unit != "rad/s" else DEG / 3600.0), verdict,
        f"{verdict}: a reason made from the numbers", partners,
    )  # fmt: skip


def _selection(lib: Library, rows: dict[str, tuple[float, float, float, float, str]]) -> Selection:
    default = (0.0, 20.0, 20.0, 0.2, "untested")
    terms = tuple(_verdict(term, symbols(lib)[term.name], rows.get(term.name, default)) for term in lib.terms)
    excited = [term for term in terms if term.verdict != "untested"]
    p = len(excited)
    model = tuple(term.name for term in terms if term.inclusion >= 0.5)
    inclusion = np.array([term.inclusion for term in excited])
    optional = [term.name for term in excited if term.name not in model]
    best = tuple((model + tuple(optional[: k % 4]), 0.4 * 0.6**k) for k in range(10))
    size = np.arange(p + 1.0)
    by_size = 8123.0 - 0.5 * (size - len(model)) ** 2 - 60.0 * np.maximum(len(model) - size, 0.0)
    models = _partly(
        Models, candidates=SimpleNamespace(names=tuple(t.name for t in excited)),
        names=tuple(t.name for t in excited), inclusion=inclusion,
        mean=np.array([t.mean for t in excited]), sd=np.array([t.sd for t in excited]),
        log_evidence=8124.2, best=best, by_size=by_size, n_models=2**p,
        space=Space(p), missing=0.0, error=0.0, weight=np.ones(1), scales=Scales.only(1.0), parts=(),
        drawn=0,
    )  # fmt: skip
    widths = ((1 / 3, inclusion), (1.0, inclusion), (3.0, inclusion))
    return _partly(
        Selection, terms=terms, columns=lib.names, model=model, log_evidence=8124.2, models=models,
        by_width=widths, observability=_observability(terms), groups=(), ties=(),
        costs=EQUAL,
    )  # fmt: skip


def _observability(terms: tuple[TermVerdict, ...]) -> Observability:
    tested = np.array([term.verdict != "untested" for term in terms])
    ratio = np.array([term.sd / term.prior_sd for term in terms])
    names = tuple(term.name for term in terms)
    groups = ()
    if "c_jj" in names and any(term.verdict == "inseparable" for term in terms):
        groups = (
            Confounded(
                ("c_jj", "c_kk"), (1.0, -1.0), 0.97, True,
                "f_j and f_k are equal in size in every row", "a tumble about a third axis separates them",
            ),
        )  # fmt: skip
    return Observability(names, tested, ratio, 0.5 * ratio, np.where(tested, 4.0, np.nan), groups)


def _run(name: str, procedure: str, noise: Noise, columns: tuple[tuple[str, str, str], ...]) -> RunSummary:
    ranges = {"f_i": (-196.0, 196.1), "f_j": (-9.81, 9.81), "T": (293.15, 299.15), "output": (-197.0, 196.0)}
    source = Source(f"{name}.csv", "9f" * 32, columns, ("not in the file, taken as zero: w_i, w_j, w_k",))
    priors = {name: (1.3 * value if value else 1e-6, 0.6) for name, value in asdict(noise).items()}
    return _partly(
        RunSummary, name=name, procedure=procedure, samples=2880, duration=2880.0, interval=1.0,
        found=NoiseEstimate(noise, (0.02, 0.2, 1.4), priors), ranges=ranges, source=source, stills=(),
    )  # fmt: skip


def _check(run: RunSummary, fits: bool, rng: np.random.Generator) -> ResidualCheck:
    q, lags = 240, np.arange(1, 21)
    tau = np.geomspace(run.interval, run.duration / 4.0, 12)
    expected = np.sqrt(allan_variance(asdict(run.noise), tau))
    f_i = rng.uniform(-196.0, 196.0, q)
    shown = rng.standard_normal(q) + (0.0 if fits else 3e-5 * f_i**2)
    return ResidualCheck(
        run=run.name, scale=1.02 if fits else 1.83, whiteness_p=0.41 if fits else 1e-9, normality_p=0.6,
        sample_scale=1.1, sample_whiteness_p=0.02, lags=lags,
        autocorrelation=rng.standard_normal(len(lags)) / math.sqrt(q), tau=tau,
        deviation=expected * np.exp(0.1 * rng.standard_normal(12)), expected=expected,
        t=np.linspace(0.0, run.duration, q), shown=shown,
        outliers=() if fits else ((1200.0, 1230.0, 7.4),), fits=fits,
    )  # fmt: skip


def sensor_result(
    sensor_id: str = "ACC-07",
    *,
    lib: Library | None = None,
    runs: tuple[str, ...] = ("tumble", "centrifuge"),
    misfit: str = "",
    column: str = "adc",
) -> SensorResult:
    """One component, with whatever library and runs a test asks for."""
    lib = lib or library("accelerometer", powers=3, asymmetry=2)
    rows = ACCELEROMETER if lib.kind == "accelerometer" else GYROSCOPE
    unit = UG if lib.kind == "accelerometer" else DEG / 3600.0
    rng = np.random.default_rng(3)
    noise = Noise(59.0 * unit, 38.0 * unit, 0.4 * unit)
    summaries = tuple(_run(name, "tumble", noise, ((column, "output", "count"),)) for name in runs)
    selection = _selection(lib, rows)
    mean, sd, inclusion = (
        np.array([getattr(t, k) for t in selection.terms]) for k in ("mean", "sd", "inclusion")
    )
    included = rng.random((600, len(mean))) < inclusion
    draws = np.where(included, mean + sd * rng.standard_normal((600, len(mean))), 0.0)
    prior_sd = np.array([term.prior_sd for term in selection.terms])
    return SensorResult(
        sensor_id, lib.kind, "mems_tactical", 5760, summaries, selection,
        tuple(_check(run, run.name != misfit, rng) for run in summaries), draws,
        prior_sd * rng.standard_normal(draws.shape), "the catalogue's class mems_tactical", 0.93,
    )  # fmt: skip


def study_result(*sensors: SensorResult, title: str = "ACC-07 acceptance") -> StudyResult:
    """A study of these components; of one accelerometer without any."""
    sensors = sensors or (sensor_result(),)
    specs = tuple(
        SensorSpec(sensor.id, sensor.kind, None, library(sensor.kind), (), {}) for sensor in sensors
    )
    text = f'[study]\ntitle = "{title}"\nseed = 1\n'
    return StudyResult(Study(title, 1, specs, Path("studies/acc07.toml"), text), sensors)


EXTRAS = (
    Extra("gravity", "gravity", 50.0 * UG, "m/s^2", "ug", "error of local gravity"),
    Extra("fixture_j.tumble.1", "fixture", 1e-4, "rad", "urad", "rotation of the fixture about j, mount 1"),
    Extra("fixture_j.tumble.2", "fixture", 1e-4, "rad", "urad", "rotation of the fixture about j, mount 2"),
)
STUCK = 2.5
"""sd by which the first ensemble stays off the others where the chains have not converged."""


def chains_of(sensor: SensorResult, *, converged: bool = True, draws: int = 500) -> Chains:
    """Four ensembles of a component: b1 and b3 nearly cancel, K of the first run is hardly known."""
    rng = np.random.default_rng(7)
    terms, extras = sensor.selection.terms, tuple(entry.extra for entry in sensor.extras)
    mean = np.array([*(t.full_mean for t in terms), *(e.mean for e in sensor.extras)])
    sd = np.array([*(t.full_sd for t in terms), *(e.sd for e in sensor.extras)])
    z = rng.standard_normal((4, draws, len(mean)))
    z[..., 3] = -0.96 * z[..., 1] + 0.28 * z[..., 3]
    if extras:  # the error of gravity and b1; two mounts and m_k
        z[..., -3] = 0.8 * z[..., 1] + 0.6 * z[..., -3]
        z[..., -2] = -0.6 * z[..., 8] + 0.8 * z[..., -2]
    if not converged:
        z[0, :, 2] += STUCK
    runs = tuple(run.name for run in sensor.runs)
    typical = np.array([[run.noise.N, run.noise.B, run.noise.K] for run in sensor.runs])
    spread = np.array([0.02, 0.2, 1.4])
    dwells = tuple((run, 30.0 * k, 30.0 * k + 30.0) for run in runs for k in range(12))
    observed = 1e-3 * rng.standard_normal(len(dwells))
    names = (*sensor.selection.columns, *(extra.name for extra in extras))
    prior_sd = np.array([*(t.prior_sd for t in terms), *(extra.sd for extra in extras)])
    return Chains(
        sampler="collapsed", names=names, units=(*(t.unit for t in terms), *(e.unit for e in extras)),
        theta=mean + sd * z, runs=runs,
        noise=typical * np.exp(spread * rng.standard_normal((4, draws, len(runs), 3))),
        log_density=-0.5 * (z**2).sum(axis=-1), dwells=dwells,
        log_likelihood=5.0 - 0.5 * rng.standard_normal((4, draws, len(dwells))) ** 2, observed=observed,
        predicted=observed + 1e-5 * rng.standard_normal((4, draws, len(dwells))),
        prior_theta=prior_sd * rng.standard_normal((800, len(names))),
        prior_noise=typical * np.exp(0.6 * rng.standard_normal((800, len(runs), 3))),
        diagnostics=_diagnostics(names, runs, converged), interpolation_error=0.004,
        log_evidence=(8120.4, 0.05),
    )  # fmt: skip


def _diagnostics(names: tuple[str, ...], runs: tuple[str, ...], converged: bool) -> Diagnostics:
    parameters = (*names, *(f"{letter}.{run}" for run in runs for letter in "NBK"))
    d = len(parameters)
    ess, rhat = np.linspace(1800.0, 1240.0, d), np.full(d, 1.002)
    if not converged:
        ess[2], rhat[2] = 31.0, 1.83
    text = "every parameter has mixed" if converged else "not converged: b2 has R-hat 1.83"
    return Diagnostics(
        parameters=parameters, ess=ess, rhat=rhat, tau=np.linspace(20.0, 60.0, d), acceptance=0.31,
        steps=4000, walkers=24, ensembles=4, seconds=12.4, converged=converged, text=text,
    )  # fmt: skip


def sampled_result(sensor_id: str = "ACC-07", *, converged: bool = True, **options: object) -> SensorResult:
    """One component whose posterior was sampled, with errors of the test bench and two distrusted dwells."""
    sensor = sensor_result(sensor_id, **options)
    extras = tuple(
        ExtraPosterior(extra, 0.3 * extra.sd, share * extra.sd, partners)
        for extra, share, partners in zip(
            EXTRAS, (0.98, 0.6, 0.7), (("b1",), ("m_k",), ("m_k",)), strict=True
        )
    )
    plug_in = [t.inclusion for t in sensor.selection.terms]
    plug_in[4] -= 0.08
    sensor = replace(
        sensor,
        selection=replace(sensor.selection, plug_in=tuple(plug_in)),
        method="collapsed",
        method_reason="the noise is estimated from the runs themselves",
        extras=extras,
        distrusted=(
            Distrusted("tumble", 120.0, 150.0, 0.9998, 812.0 * UG, 9.0 * UG),
            Distrusted("centrifuge", 900.0, 930.0, 0.61, -40.0 * UG, 15.0 * UG),
        ),
    )
    sensor = replace(sensor, runs=tuple(_with_factor(run, sensor) for run in sensor.runs))
    return replace(sensor, chains=chains_of(sensor, converged=converged))


def _with_factor(run: RunSummary, sensor: SensorResult) -> RunSummary:
    """Whitened rows of a run that see every column three times as well as its prior."""
    rng = np.random.default_rng(len(run.name))
    prior_sd = [*(t.prior_sd for t in sensor.selection.terms), *(entry.extra.sd for entry in sensor.extras)]
    names = (*sensor.selection.columns, *(entry.extra.name for entry in sensor.extras))
    X = 0.3 * rng.standard_normal((90, len(names))) / np.array(prior_sd)
    return replace(run, factor=factor_of(X, rng.standard_normal(90), names, log_det=-700.0))


def repeatability(parameter: str = "b0", *, exceeds: bool = True, units: int = 3) -> Repeatability:
    """Three sessions of the same units; the last unit missed the last session."""
    rng = np.random.default_rng(len(parameter) + units)
    names = tuple(f"IMU-{k}" for k in range(1, units + 1))
    sd = np.full((units, 3), 10.0 * UG)
    mean = 500.0 * UG + (60.0 * UG if exceeds else 9.0 * UG) * rng.standard_normal((units, 3))
    mean[-1, -1] = sd[-1, -1] = np.nan
    pulls = (mean[:, :, None] - mean[:, None, :]) / np.sqrt(sd[:, :, None] ** 2 + sd[:, None, :] ** 2)
    between = (55.0 * UG, 31.0 * UG, 96.0 * UG) if exceeds else (3.0 * UG, 0.2 * UG, 9.0 * UG)
    return Repeatability(
        parameter, "m/s^2", "ug", names, ("monday", "tuesday", "friday"), mean, sd, pulls,
        1e-9 if exceeds else 0.41, between, exceeds,
    )  # fmt: skip


def judged_result(sensor_id: str = "ACC-07", **options: object) -> SensorResult:
    """One component with every other method beside its decision, a group, and a misfit."""
    sensor = sensor_result(sensor_id, **options)
    selection = replace(sensor.selection, groups=((("c_jj", "c_kk"), 0.52),))
    sensor = replace(sensor, selection=selection)
    return replace(sensor, panel=panel_of(sensor), misfit=misfit_of(sensor))


def recovered(what: str = "gravity", *, count: int = 30, width: int = 1) -> Recovered:
    """Errors of a known quantity of 0.1 mg, where 0.2 mg are predicted of new ones."""
    after = 0.1 * MG * np.random.default_rng(1).normal(size=(count, width))
    sds = (np.full_like(after, size * MG) for size in (0.1, 0.2))
    return Recovered("hand", what, 100.0 * MG + after, after, 1.5 * after, *sds)


def cased(*found: Recovered, cases: int = 1) -> StudyResult:
    """Three accelerometers of each case, with what is pooled and recovered of them."""
    pooled = {"b0": 1.0, "b0p": 0.97, "b3": 0.01, "c_jk": 0.86}
    sensors = (sensor_result(f"U{k}.a{axis}") for k in range(cases) for axis in "xyz")
    return study_result(*(replace(one, pooled=pooled, recovered=found) for one in sensors))


CRITERIA = ("aic", "aicc", "bic", "hqc", "ebic", "waic", "loo", "leave_one_run_out")
OPTIMIZERS = ("stlsq", "sr3", "ssr", "frols")
LIBERAL = ("aic", "waic", "sr3")


def panel_of(sensor: SensorResult) -> Panel:
    """Every method on a component; `LIBERAL` ones keep the first term that the others drop."""
    terms = tuple(term for term in sensor.selection.terms if term.verdict != "untested")
    names, p = tuple(term.name for term in terms), len(terms)
    model = tuple(name for name in sensor.selection.model if name in names)
    extra = next((name for name in names if name not in model), names[-1])
    other = tuple(name for name in names if (name in model) is not (name == extra))
    models = {name: other if name in LIBERAL else model for name in (*CRITERIA, *OPTIMIZERS)}
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
    told = Disagreement(extra, LIBERAL, "weak effect", f"{', '.join(LIBERAL)} keep {extra}: 0.1 sd from zero")
    votes = Votes(names, methods, strength, keeps.astype(float), (told,))
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


APPENDIX = Appendix(
    "Effective samples a second", "One machine, one thread.", "pytest tests/benchmarks -m benchmark",
    ("sampler", "ess/s"), (("ours", "12,000"), ("stretch", "40")),
)  # fmt: skip
