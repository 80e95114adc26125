import itertools
from dataclasses import replace

import numpy as np
import pytest
from ladders import ground, problem

from imubayes.algebra.factor import factor_of
from imubayes.inference.dwells import dwells_of
from imubayes.inference.linear import linear_of
from imubayes.ladder import regression as rung
from imubayes.ladder.regression import by_bic, means


def _rows(n: int, p: int, seed: int):
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, p)) * 10.0 ** rng.integers(-3, 4, p)
    theta = np.where(np.arange(p) % 2 == 0, 0.6, 0.0) / np.abs(X).mean(axis=0)
    return X, X @ theta + rng.standard_normal(n)


def _brute_force(X, y):
    """Inclusion and averaged coefficients by lstsq on the rows and BIC, model by model."""
    n, p = X.shape
    bic, inside, theta = [], [], []
    for mask in itertools.product((False, True), repeat=p):
        columns = np.flatnonzero(mask)
        scale = np.linalg.norm(X[:, columns], axis=0)
        b = np.linalg.lstsq(X[:, columns] / scale, y, rcond=None)[0] / scale
        rss = float(np.sum((y - X[:, columns] @ b) ** 2))
        bic.append(n * np.log(rss / n) + len(columns) * np.log(n))
        inside.append(mask)
        theta.append(np.bincount(columns, weights=b, minlength=p))
    weight = np.exp(0.5 * (min(bic) - np.array(bic)))
    weight /= weight.sum()
    return weight @ np.array(inside), weight @ np.array(theta)


def test_bic_over_subsets_is_that_of_least_squares_on_the_rows():
    X, y = _rows(60, 6, 1)
    inclusion, theta = _brute_force(X, y)
    found = by_bic(factor_of(X, y, tuple("abcdef")))
    np.testing.assert_allclose(found.inclusion, inclusion, rtol=1e-9)
    np.testing.assert_allclose(found.mean, theta, rtol=1e-8, atol=1e-12 * np.abs(theta).max())


def _log_weights(models):
    inside = models.space.members(np.arange(len(models.space)))
    return {
        tuple(row): np.log(w)
        for row, w in zip(inside.tolist(), models.weight.tolist(), strict=True)
        if w > 0.0
    }


def test_single_steps_find_the_best_model_and_weigh_those_around_it_as_all_subsets_do(monkeypatch):
    X, y = _rows(60, 6, 2)
    every = by_bic(factor_of(X, y, tuple("abcdef")))
    monkeypatch.setattr(rung, "EXHAUSTIVE", 0)
    steps = by_bic(factor_of(X, y, tuple("abcdef")))
    assert steps.best[0][0] == every.best[0][0]
    there, here = _log_weights(every), _log_weights(steps)
    apart = [here[model] - there[model] for model in here if model in there]
    assert len(apart) >= 7
    np.testing.assert_allclose(apart, apart[0], atol=1e-8)


def test_no_model_has_more_than_half_as_many_terms_as_dwells():
    X, y = _rows(8, 7, 4)
    found = by_bic(factor_of(X, y, tuple("abcdefg")))
    assert max(len(model) for model, _ in found.best) <= 4
    assert np.isfinite([*found.inclusion, *found.mean, *found.sd]).all()


@pytest.mark.parametrize("most", [rung.EXHAUSTIVE, 0], ids=["all", "steps"])
def test_a_model_is_found_where_two_columns_that_only_rounding_separates_would_fit_best(most, monkeypatch):
    monkeypatch.setattr(rung, "EXHAUSTIVE", most)
    X, y = _rows(60, 11, 6)
    apart = np.random.default_rng(7).standard_normal(60)
    found = by_bic(
        factor_of(np.column_stack((X, X[:, 0] + 1e-9 * apart)), y + 9.0 * apart, tuple("abcdefghijkl"))
    )
    assert not any({"a", "l"} <= {*model} for model, _ in found.best)
    assert np.isfinite([*found.inclusion, *found.mean, *found.sd]).all()


def test_an_input_that_only_rounds_is_not_tested():
    """A force across of 1e-14 m/s^2 would be as good a column as any."""
    one = problem()
    (run,) = one.runs
    dust = 1e-14 * np.random.default_rng(8).standard_normal(len(run.inputs))
    moved = replace(run, inputs=replace(run.inputs, channels={**run.inputs.channels, "f_k": dust}))
    found = means(ground(replace(one, runs=(moved,))))
    assert found.selection.terms[one.library.names.index("m_k")].verdict == "untested"


def test_a_term_waits_for_what_it_modifies():
    rng = np.random.default_rng(5)
    X = rng.standard_normal((80, 2))
    y = X[:, 1] + 0.1 * rng.standard_normal(80)
    names = ("b1", "b1*T")
    assert by_bic(factor_of(X, y, names)).best[0][0] == ("b1*T",)
    assert by_bic(factor_of(X, y, names), True).best[0][0] == names


def test_full_library_is_ordinary_least_squares_on_the_dwell_means():
    one = problem()
    d = dwells_of(linear_of(one.runs[0], one.library))
    found = means(ground(one))
    told = np.abs(d.means.X).max(axis=0) > 0.0
    # on the sphere |f| = g the last even column depends on those before it, and is left out
    kept = [j for j in np.flatnonzero(told) if np.linalg.matrix_rank(d.means.X[:, : j + 1] / 10.0, 1e-9) >
            np.linalg.matrix_rank(d.means.X[:, :j] / 10.0, 1e-9)]  # fmt: skip
    theta, rss, *_ = np.linalg.lstsq(d.means.X[:, kept], d.means.y, rcond=None)
    sd = np.sqrt(
        np.diag(np.linalg.inv(d.means.X[:, kept].T @ d.means.X[:, kept])) * rss[0] / (len(d) - len(kept))
    )
    np.testing.assert_allclose(found.full_mean[kept], theta, rtol=1e-7, atol=1e-7 * sd.min())
    np.testing.assert_allclose(found.full_sd[kept], sd, rtol=1e-6)
