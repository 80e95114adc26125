"""A small, complete and plausible result, made by hand: no engine is needed to test what is printed of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from imubayes.campaign import SensorResult, SensorSpec, Study, StudyResult
from imubayes.inference.residuals import ResidualCheck
from imubayes.inference.summary import RunSummary
from imubayes.planning.observability import Confounded, Observability
from imubayes.rig.inputs import Source
from imubayes.selection.decision import Selection
from imubayes.selection.enumerate import Models
from imubayes.selection.verdicts import TermVerdict
from imubayes.sensors.noise import Noise, allan_variance
from imubayes.sensors.terms import Library, Term, library

UG = 9.80665e-6
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


def _verdict(term: Term, row: tuple[float, float, float, float, str]) -> TermVerdict:
    from imubayes.reporting.rounding import per_unit

    unit = per_unit(term.printed, term.unit)
    mean, sd, prior_sd, inclusion, verdict = row
    mean, sd, prior_sd = mean * unit, sd * unit, prior_sd * unit
    partners = {"c_jj": ("c_kk",), "c_kk": ("c_jj",)}.get(term.name, ()) if verdict == "inseparable" else ()
    return TermVerdict(
        term.name, term.symbol, term.unit, term.printed, term.group,
        mean, sd, mean - 1.645 * sd, mean + 1.645 * sd, mean, sd, prior_sd,
        inclusion, (max(inclusion - 0.1, 0.0), min(inclusion + 0.05, 1.0)), abs(mean) + 2.0 * sd,
        abs(mean) / unit * (UG if term.unit != "rad/s" else DEG / 3600.0), verdict,
        f"{verdict}: a reason made from the numbers", partners,
    )  # fmt: skip


def _selection(lib: Library, rows: dict[str, tuple[float, float, float, float, str]]) -> Selection:
    default = (0.0, 20.0, 20.0, 0.2, "untested")
    terms = tuple(_verdict(term, rows.get(term.name, default)) for term in lib.terms)
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
    )  # fmt: skip
    widths = ((1 / 3, inclusion), (1.0, inclusion), (3.0, inclusion))
    return _partly(
        Selection, terms=terms, columns=lib.names, model=model, log_evidence=8124.2, models=models,
        by_width=widths, observability=_observability(terms),
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
    return Observability(names, tested, ratio, 0.5 * ratio, np.where(tested, 4.0, np.inf), groups)


def _run(name: str, procedure: str, noise: Noise, columns: tuple[tuple[str, str, str], ...]) -> RunSummary:
    ranges = {"f_i": (-196.0, 196.1), "f_j": (-9.81, 9.81), "T": (293.15, 299.15), "output": (-197.0, 196.0)}
    source = Source(f"{name}.csv", "9f" * 32, columns, ("not in the file, taken as zero: w_i, w_j, w_k",))
    priors = tuple((1.3 * value if value else 1e-6, 0.6) for value in (noise.N, noise.B, noise.K))
    return _partly(
        RunSummary, name=name, procedure=procedure, samples=2880, duration=2880.0, interval=1.0, noise=noise,
        noise_sd=(0.02, 0.2, 1.4), noise_prior=priors, noise_origin="REML", ranges=ranges, source=source,
        stills=(),
    )  # fmt: skip


def _check(run: RunSummary, fits: bool, rng: np.random.Generator) -> ResidualCheck:
    q, lags = 240, np.arange(1, 21)
    tau = np.geomspace(run.interval, run.duration / 4.0, 12)
    expected = np.sqrt(allan_variance(run.noise, tau))
    f_i = rng.uniform(-196.0, 196.0, q)
    shown = rng.standard_normal(q) + (0.0 if fits else 3e-5 * f_i**2)
    return ResidualCheck(
        run=run.name, scale=1.02 if fits else 1.83, whiteness_p=0.41 if fits else 1e-9, normality_p=0.6,
        sample_scale=1.1, sample_whiteness_p=0.02, lags=lags,
        autocorrelation=rng.standard_normal(len(lags)) / math.sqrt(q), tau=tau,
        deviation=expected * np.exp(0.1 * rng.standard_normal(12)), expected=expected,
        t=np.linspace(0.0, run.duration, q), shown=shown,
        inputs={"f_i": f_i, "T": np.linspace(293.0, 299.0, q)},
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


@pytest.fixture
def result() -> StudyResult:
    return study_result()


@pytest.fixture
def make_sensor() -> Callable[..., SensorResult]:
    return sensor_result


@pytest.fixture
def make_study() -> Callable[..., StudyResult]:
    return study_result
