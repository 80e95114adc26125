"""Problems with coloured noise and with chains, and work of growing size, on simulated runs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import factor_of, invert_triangular, posterior, with_prior_rows
from imubayes.inference.linear import Linear, blocks_of, linear_of
from imubayes.inference.prior import prior
from imubayes.inference.summary import Summary, summarize
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.rotations import centrifuge
from imubayes.rig.simulate import simulate, synthesise
from imubayes.rig.tumbles import tumble
from imubayes.selection.decision import select
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library
from studies.speed import peers
from studies.speed.contests import Contest, Entrant, Ladder, Self
from studies.speed.problems import LIBRARY, ROWS, drive

RATE = 100.0
"""Hz; of a static record."""

RECORDS = 8
"""Static records whose noise is estimated, so that an error can be told from luck."""

TYPICAL = Noise(N=6e-4, B=4e-4, K=6e-5)
"""m/s^2/sqrt(Hz), m/s^2, m/s^2/sqrt(s): of a tactical accelerometer. White noise rules to 5 s, the random
walk from one minute on, so that a record of an hour shows all three."""

WHITE = Noise(TYPICAL.N, 0.0, 0.0)
"""Of the campaign whose coefficients are sampled."""

CHAIN = 20_000.0
"""Effective samples that our sampler is asked for: with fewer its checks would be most of the time."""

CHAIN_TERMS = library("accelerometer", powers=4, asymmetry=2)
"""Of 21 terms, those of the study of the samplers."""

DWELL = 10.0
"""s; of a position of a campaign."""

POSITIONS = 72 + 48
"""Of a tumble in three planes and a centrifuge at four levels in twelve mounts."""

SMALL = {"angles": 12, "dwell": 5.0, "rate": 10.0, "settle": 1.0}
"""Tumble of a unit whose decision is repeated."""


def noise(n: int, seed: int) -> Contest:
    """N, B and K of static records of n samples at 100 Hz."""
    rng = np.random.default_rng([seed, 3, n])
    t = np.arange(n) / RATE
    records = [synthesise(TYPICAL, t, 1.0 / RATE, rng) for _ in range(RECORDS)]
    truth = np.log([TYPICAL.N, TYPICAL.B, TYPICAL.K])

    def off(found: FloatArray) -> float:
        return float(np.sqrt(np.mean((np.log(found) - truth) ** 2)))

    def by_likelihood() -> FloatArray:
        return np.array([_reml(t, y) for y in records])

    def by_slopes() -> FloatArray:
        return np.array([peers.allan_slopes(y, RATE) for y in records])

    return Contest(
        "noise",
        n,
        f"N, B, K of {RECORDS} static records of {n:,} samples",
        "rms error of ln N, ln B, ln K",
        "all records",
        (
            Entrant("imubayes, REML", by_likelihood, off, ours=True, remark="with an error bar for each"),
            Entrant("allantools, slopes", by_slopes, off, ("allantools",)),
        ),
    )


def _reml(t: FloatArray, y: FloatArray) -> FloatArray:
    from imubayes.inference.noise_model import estimate

    rows = Linear("r", "static", ("b0",), t, np.full(len(t), 1.0 / RATE), 1.0 / RATE, y, _ones)
    found = estimate(blocks_of(rows)).noise
    return np.array([found.N, found.B, found.K])


def _ones(start: int, stop: int) -> FloatArray:
    return np.ones((stop - start, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """Runs of a tumble and a centrifuge, their factor at given noise, and the prior of the 21 terms (p,)."""

    runs: tuple[Run, ...]
    summary: Summary
    sd: FloatArray


def campaign(n: int, seed: int) -> Campaign:
    """Simulate a campaign of about n rows."""
    tactical = sensor("mems_tactical", kind="accelerometer")
    rate = n / (POSITIONS * DWELL)
    plans = [
        tumble(angles=24, planes=3, dwell=DWELL, rate=rate, settle=DWELL / 5.0),
        centrifuge([1.0, 5.0, 10.0, 20.0], mounts=12, dwell=DWELL, rate=rate),
    ]
    runs = simulate(tactical, plans, seed=seed, noise=WHITE)
    rules = {run.name: NoiseRule("fixed", WHITE) for run in runs}
    summary = summarize(runs, CHAIN_TERMS, sensor=tactical, rules=rules)
    return Campaign(runs, summary, prior(tactical, CHAIN_TERMS).sd)


def chains(n: int, seed: int) -> Contest:
    """The posterior of 21 coefficients at given noise, from a campaign of about n rows."""
    made = campaign(n, seed)
    mean, spread = posterior(made.summary.factor, made.sd)
    A, b, basis = standard(made)

    def off(theta: FloatArray) -> float:
        return float(np.max(np.abs(theta.mean(axis=0) - mean) / spread))

    def by_nuts() -> Self:
        found = peers.nuts(A, b, seed)
        return Self(mean + found.answer @ basis.T, found.seconds)

    remark = "likelihood of every row, coordinates whitened by the posterior"
    return Contest(
        "posterior",
        n,
        f"Posterior of {len(mean)} coefficients, {len(b) - len(mean):,} rows, noise given",
        "largest error of a mean, in posterior sd",
        f"{peers.ENOUGH:,.0f} effective samples of the worst coefficient",
        (
            Entrant("imubayes, full sampler", lambda: _sampled(made, seed), off, ours=True),
            Entrant("nutpie, NUTS", by_nuts, off, ("nutpie", "arviz"), remark=remark),
        ),
    )


def standard(made: Campaign) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Whitened rows (n + p, p), response (n + p,), and the basis (p, p) of the coordinates that they are in.

    There the posterior, ``exp(-|A x - b|^2/2)``, is standard normal about zero.
    """
    rows = [linear_of(run, CHAIN_TERMS) for run in made.runs]
    white = np.sqrt(np.concatenate([one.rows.duration for one in rows])) / WHITE.N
    X, y = stacked(rows)
    X, y = X * white[:, None], y * white
    basis = invert_triangular(with_prior_rows(made.summary.factor.R, 1.0 / made.sd)[:-1, :-1])
    mean, _ = posterior(made.summary.factor, made.sd)
    A = np.vstack((X, np.diag(1.0 / made.sd))) @ basis
    return A, np.concatenate((y - X @ mean, -mean / made.sd)), basis


def stacked(rows: Sequence[Linear]) -> tuple[FloatArray, FloatArray]:
    """Columns (n, p) and response (n,) of all runs."""
    return np.vstack([one.columns(0, len(one)) for one in rows]), np.concatenate([one.y for one in rows])


def _sampled(made: Campaign, seed: int) -> Self:
    """Draws (m, p) of the full sampler, and its seconds for a thousand effective ones."""
    from imubayes.inference.mcmc.ensembles import Limits
    from imubayes.inference.mcmc.run import sample

    start = time.perf_counter()
    rows = [linear_of(run, CHAIN_TERMS) for run in made.runs]
    limits = Limits(ess=CHAIN, seed=seed)
    found = sample(made.summary, rows, made.sd, method="full", limits=limits).chains
    seconds = time.perf_counter() - start
    theta = found.theta.reshape(-1, found.theta.shape[-1])
    return Self(theta, seconds * peers.ENOUGH / float(found.diagnostics.ess.min()))


def rows_ladder(sizes: tuple[int, ...], seed: int) -> Iterator[Ladder]:
    """A run of n rows to its factor, with the noise given and with the noise estimated."""
    for title, rule in (
        ("whitening and factor, noise given", NoiseRule("fixed", TYPICAL)),
        ("noise, whitening and factor", NoiseRule()),
    ):
        steps = tuple((n, _summarized([_run(n, seed)], rule)) for n in sizes)
        yield Ladder("rows", f"{title}, 21 terms", 1.0, steps)


def _run(n: int, seed: int) -> Run:
    rng = np.random.default_rng([seed, 4, n])
    u, t = drive(n, rng), np.arange(n) / RATE
    y = u["f_i"] + synthesise(TYPICAL, t, 1.0 / RATE, rng)
    return Run(f"r{n}", "other", Inputs(t, u, 1.0 / RATE), y)


def _summarized(runs: list[Run], rule: NoiseRule) -> Callable[[], Summary]:
    rules = {run.name: rule for run in runs}
    return lambda: summarize(runs, LIBRARY, rules=rules)


def terms_ladder(sizes: tuple[int, ...], seed: int) -> Iterator[Ladder]:
    """The factor of as many columns."""
    rng = np.random.default_rng([seed, 5])
    X, y = rng.normal(size=(50_000, max(sizes))), rng.normal(size=50_000)

    def work(p: int) -> Callable[[], object]:
        columns, names = np.ascontiguousarray(X[:, :p]), [f"x{j}" for j in range(p)]
        return lambda: factor_of(columns, y, names)

    yield Ladder("terms", "factor of 50,000 rows", 2.0, tuple((p, work(p)) for p in sizes))


def models_ladder(sizes: tuple[int, ...], seed: int) -> Iterator[Ladder]:
    """The posterior over so many models, noise given."""
    from imubayes.inference.prior import ScalePrior
    from imubayes.selection.enumerate import enumerate_models

    rng = np.random.default_rng([seed, 6])
    p = [math.ceil(math.log2(size)) for size in sizes]
    X, y = rng.normal(size=(ROWS, max(p))), rng.normal(size=ROWS)

    def work(k: int) -> Callable[[], object]:
        s = Summary.from_arrays(X[:, :k], y, [f"x{j}" for j in range(k)])
        return lambda: enumerate_models(s, ScalePrior(1.0), scale=1.0)

    yield Ladder("models", "posterior over all of them, noise given", 1.0, tuple((2**k, work(k)) for k in p))


def runs_ladder(sizes: tuple[int, ...], seed: int) -> Iterator[Ladder]:
    """The factor of so many runs of 2,000 rows, each with its own noise."""
    runs = [_run(2_000 + k, seed) for k in range(max(sizes))]
    steps = tuple((m, _summarized(runs[:m], NoiseRule())) for m in sizes)
    yield Ladder("runs", "noise, whitening and factor of runs of 2,000 rows", 1.0, steps)


def units_ladder(sizes: tuple[int, ...], seed: int) -> Iterator[Ladder]:
    """The whole decision on so many units, one after the other."""
    tactical = sensor("mems_tactical", kind="accelerometer")
    lib = library("accelerometer", powers=2, asymmetry=1)
    beliefs = prior(tactical, lib)
    units = [simulate(tactical, [tumble(**SMALL)], seed=seed + k) for k in range(max(sizes))]

    def work(m: int) -> Callable[[], object]:
        return lambda: [select(summarize(runs, lib, sensor=tactical), beliefs) for runs in units[:m]]

    title = f"from rows to the decision on {len(lib.terms)} terms"
    yield Ladder("units", title, 1.0, tuple((m, work(m)) for m in sizes))
