"""How the posterior was found, in words and tables: rung, chains, test bench, uncertain noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from results_found import sampled_result
from scipy.stats import multivariate_normal

from imubayes.algebra.factor import factor_of
from imubayes.reporting.chain_views import exact_evidence, own_errors


@pytest.mark.parametrize(("id", "listed"), [("imu.ay", ["gravity", "tilt_j.ay"]), ("alone", None)])
def test_a_component_lists_the_bench_and_its_own_errors(id, listed):
    names = ["gravity", "tilt_j.ax", "tilt_j.ay", "turn_on.log.gz"]
    extras = [
        SimpleNamespace(extra=SimpleNamespace(name=name, kind=name.partition(".")[0])) for name in names
    ]
    found = own_errors(SimpleNamespace(id=id, extras=extras))
    assert [entry.extra.name for entry in found] == (listed or names)


def test_exact_evidence_is_the_density_of_the_data_with_coefficients_and_noise_integrated():
    sensor, rng = sampled_result(), np.random.default_rng(8)
    columns = (*sensor.selection.columns, *(entry.extra.name for entry in sensor.extras))
    sd = np.array([*(t.prior_sd for t in sensor.selection.terms), *(e.extra.sd for e in sensor.extras)])
    runs, log_density = [], []
    X = [0.5 * rng.standard_normal((40, len(sd))) / sd for _ in sensor.runs]
    L = [np.tril(0.2 * rng.standard_normal((40, 40))) + np.eye(40) for _ in sensor.runs]
    y = np.concatenate([rows @ (sd * rng.standard_normal(len(sd))) for rows in X])
    for k, run in enumerate(sensor.runs):
        white = np.linalg.solve(L[k], np.column_stack((X[k], y[40 * k : 40 * k + 40])))
        log_det = 2.0 * float(np.sum(np.log(np.abs(np.diag(L[k])))))
        made = factor_of(white[:, :-1], white[:, -1], columns, log_det=log_det)
        runs.append(replace(run, factor=made))
    whole, noise = np.concatenate(X), np.zeros((80, 80))
    noise[:40, :40], noise[40:, 40:] = L[0] @ L[0].T, L[1] @ L[1].T
    covariance = noise + (whole * sd**2) @ whole.T
    log_density = multivariate_normal(np.zeros(80), covariance).logpdf(y)
    assert exact_evidence(replace(sensor, runs=tuple(runs))) == pytest.approx(log_density, abs=1e-8)


def test_component_of_a_triad_has_no_evidence_of_its_own() -> None:
    sensor = sampled_result()
    own = tuple(f"ay.{name}" for name in sensor.selection.columns)
    assert exact_evidence(replace(sensor, selection=replace(sensor.selection, columns=own))) is None
