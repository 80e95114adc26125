"""How far mounts differ: against the marginal likelihood written out, and with mounts turned unseen."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches import decided_terms
from scipy.stats import lognorm, multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.errors import StudyError
from imubayes.inference.linear import Extra
from imubayes.inference.mcmc import NoiseDraw
from imubayes.inference.reproducibility import Spread, odds_of, over_spreads, spreads
from imubayes.ladder.problem import ground_of, prepared, problem_of
from imubayes.rig import formats, streams
from imubayes.rig.recordings import write_run
from imubayes.rig.runs import read_run
from imubayes.rig.simulate import plan_run, simulate
from imubayes.study.schema import read_study
from imubayes.work import silent

ARCSEC = math.pi / 648000.0
STUDY = """
[study]
title = "mounts"
[[sensor]]
id = "A-1"
class = "mems_tactical"
kind = "accelerometer"
library = {{ powers = 2, asymmetry = 0 }}
{reference}
[[sensor.run]]
name = "tumble"
procedure = "tumble"
simulate = {{ angles = 24, planes = {planes}, dwell = "10 s", rate = "5 Hz" }}
[[sensor.run]]
name = "centrifuge"
procedure = "centrifuge"
simulate = {{ levels = ["5 g", "10 g", "20 g"], mounts = {mounts}, dwell = "10 s", rate = "5 Hz" }}
"""
TRUTH = {"b0": 0.03, "b1": 4e-4, "b2": 2e-5}


def spec_of(folder, reference, planes=3, mounts=6):
    path = folder / "study.toml"
    path.write_text(STUDY.format(reference=reference, planes=planes, mounts=mounts))
    (spec,) = read_study(path).sensors
    return spec


def test_posterior_of_the_sd_is_that_of_the_marginal_likelihood_written_out():
    rng = np.random.default_rng(2)
    mounts = np.repeat(np.arange(6), 5)
    X, Z = np.ones((30, 1)), np.eye(6)[mounts]
    y = 0.7 + Z @ rng.normal(0.0, 2.0, 6) + rng.standard_normal(30)
    names = [f"fixture_j.{k}" for k in range(6)]
    extras = [Extra(name, "fixture", 1.0, "rad", "arcsec", "") for name in names]
    factor = factor_of(np.hstack((X, Z)), y, ("b0", *names))
    (found,) = spreads(factor, np.array([3.0, *np.ones(6)]), extras, {"fixture": 1.5})
    log = [
        multivariate_normal.logpdf(y, cov=9.0 * X @ X.T + s**2 * Z @ Z.T + np.eye(30))
        + math.log(s) + lognorm.logpdf(s, 1.0, scale=1.5)  # cells of ln s
        for s in found.size
    ]  # fmt: skip
    weight = np.exp(np.array(log) - max(log))
    np.testing.assert_allclose(found.weight, weight / weight.sum(), rtol=1e-6, atol=1e-12)
    assert found.count == 6


def test_odds_are_those_of_the_marginal_likelihoods_written_out():
    rng = np.random.default_rng(3)
    Z = np.eye(4)[np.repeat(np.arange(4), 5)]
    y = Z @ rng.normal(0.0, 1.0, 4) + rng.standard_normal(20)
    extras = [Extra(f"fixture_j.{k}", "fixture", 1.0, "rad", "arcsec", "") for k in range(4)]
    factor = factor_of(np.hstack((np.ones((20, 1)), Z)), y, ("b0", *(extra.name for extra in extras)))

    def density(s):
        return multivariate_normal.pdf(y, cov=4.0 + s**2 * Z @ Z.T + np.eye(20))

    sizes = np.exp(np.linspace(-3.0, 3.0, 4001))
    weight = np.exp(-0.5 * np.log(sizes) ** 2)
    expected = np.sum(weight * [density(s) for s in sizes]) / np.sum(weight) / density(0.0)
    found = odds_of(factor, np.array([2.0, *np.ones(4)]), extras, "fixture")
    assert found == pytest.approx(expected, rel=1e-3)


def test_draws_of_the_sd_scale_the_errors_and_nothing_else():
    factor = factor_of(np.eye(3)[:, :2], np.ones(3), ("b0", "fixture_j.0"))
    sure = Spread("fixture", 3, np.array([1.0, 3.0]), np.array([0.5, 0.5]), ("fixture_j.0",))
    draws = over_spreads([NoiseDraw(factor, 0.0)] * 8, [sure], np.ones(2), np.random.default_rng(1))
    ratios = [draw.factor.R[1, 1] / factor.R[1, 1] for draw in draws]
    assert sorted(np.round(ratios, 12)) == [0.5] * 4 + [1.5] * 4
    assert all(draw.factor.R[0, 0] == factor.R[0, 0] for draw in draws)


@pytest.mark.parametrize("turned", [0.0, 20.0])
def test_mounts_turned_unseen_are_found_and_make_no_term(tmp_path, turned, monkeypatch):
    spec = spec_of(tmp_path, 'reference = { fixture = "estimate" }')
    rng = np.random.default_rng(int(turned))
    plans = [plan_run(run) for run in spec.runs]
    blind = spec_of(tmp_path, "")
    assert blind.sensor_class is not None
    mounts = [f"{run}.{m}" for run, count in (("tumble", 3), ("centrifuge", 6)) for m in range(count)]
    errors = {f"fixture_{axis}.{m}": rng.normal(0.0, turned * ARCSEC) for m in mounts for axis in "ijk"}
    runs = simulate(blind.sensor_class, plans, errors=errors if turned else {}, seed=rng, truth=TRUTH)

    def false(one, *, doubted=False):
        terms, ready = decided_terms(problem_of(one, runs), doubted=doubted)
        return {t.name for t in terms if t.verdict == "needed"} - TRUTH.keys(), ready.spreads

    wrong, (found,) = false(spec)
    assert not wrong
    assert abs(found.mean / ARCSEC - turned) < (2.0 * found.sd / ARCSEC if turned else 6.0)
    if turned:
        assert len(false(blind)[0]) > 0
    unasked, told = false(blind, doubted=True)
    assert not unasked
    assert [one.kind for one in told] == ["fixture"] * bool(turned)
    if turned:  # of files that are read a part at a time it is told by the same dwells
        monkeypatch.setattr(streams, "STREAMED", 500)
        monkeypatch.setattr(formats, "ROWS", 1_024)
        for run in runs:
            write_run(run, tmp_path / f"{run.name}.csv", kind="accelerometer")
        files = tuple(
            replace(run, simulate=None, file=tmp_path / f"{run.name}.csv", shown=run.name)
            for run in blind.runs
        )
        runs = tuple(read_run(run, "accelerometer") for run in files)
        assert all(run.stream for run in runs)
        ((again,), (first,)) = false(replace(blind, runs=files), doubted=True)[1], told
        assert again.mean == pytest.approx(first.mean, rel=1e-3)


@pytest.mark.parametrize(
    ("said", "off"), [("", 250e-6), ('bench = "exact"', 0.0), ("reference = { radius = false }", 0.0)]
)
def test_an_arm_of_which_nobody_said_anything_is_in_doubt(tmp_path, said, off):
    spec = spec_of(tmp_path, said)
    plans = [plan_run(run) for run in spec.runs]
    runs = simulate(
        spec.sensor_class, plans, errors={"radius": off}, seed=np.random.default_rng(4), truth=TRUTH
    )
    problem = problem_of(spec, runs)

    def pull(*, doubted):
        terms, ready = decided_terms(problem, doubted=doubted)
        (term,) = (t for t in terms if t.name == "b1")
        return (term.full_mean - TRUTH["b1"]) / term.full_sd, ready.summary.extras

    far, extras = pull(doubted=True)
    assert abs(far) < 3.0
    assert [extra.kind for extra in extras] == ["radius"] * (not said)
    if off:
        assert pull(doubted=False)[0] > 10.0


@pytest.mark.parametrize(
    ("reference", "mounts", "told"),
    [
        (
            'reference = { gravity = "estimate" }',
            6,
            "reference.gravity: 'estimate' is for what differs from mount to mount",
        ),
        ('reference = { plane_zero = "estimate" }', 1, "plane_zero is to be estimated from fewer than 3"),
    ],
)
def test_what_has_no_replication_is_not_estimated(tmp_path, reference, mounts, told):
    with pytest.raises(StudyError, match=told):
        spec = spec_of(tmp_path, reference, planes=2, mounts=mounts)
        runs = simulate(
            spec.sensor_class, [plan_run(r) for r in spec.runs], seed=np.random.default_rng(1), truth=TRUTH
        )
        prepared(ground_of(problem_of(spec, runs), np.random.default_rng(1), silent, None))
