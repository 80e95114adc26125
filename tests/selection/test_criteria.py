"""Information criteria against R's leaps and direct formulas; predictive scores as criteria."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from decisions import dwells, records, table

from imubayes.algebra.factor import factor_of
from imubayes.errors import TermError
from imubayes.inference.dwells import Pieces
from imubayes.selection import criteria as module
from imubayes.selection.criteria import Criterion, criteria, with_sampled_noise
from imubayes.selection.model_sets import Space

NAMES = ("a", "b", "c", "d", "e")
ORDER = ("aic", "aicc", "bic", "hqc", "ebic", "waic", "loo", "leave_one_run_out")


def _by_name(found: tuple[Criterion, ...]) -> dict[str, Criterion]:
    return {c.name: c for c in found}


def _subsets(p: int) -> list[list[int]]:
    return [list(s) for k in range(p + 1) for s in combinations(range(p), k)]


def _problem(n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    X = rng.normal(size=(n, 5))
    return X, X @ [0.5, 0.0, 0.2, 0.0, 0.0] + rng.normal(size=n)


def _cut(X: np.ndarray, y: np.ndarray, names: tuple[str, ...], rows: int) -> Pieces:
    return dwells(np.split(np.column_stack((X, y)), range(rows, len(y), rows)), names)


@pytest.mark.parametrize("name", ["attitude", "hald"])
def test_every_subset_of_leaps_has_its_rss_cp_aic_and_bic(references, name):
    names, X, y = table(references / f"bms/{name}.csv")
    f = factor_of(np.column_stack((np.ones(len(y)), X)), y, ("one", *names))
    sd = np.array([np.inf, *np.ones(len(names))])
    full = f.R[-1, -1] ** 2 / (f.n - f.p)
    for row in records(references / f"leaps/leaps_{name}.csv"):
        inside = np.array([[digit == "1" for digit in row["gamma"]]])
        found = _by_name(criteria(f, [], sd, names, among=inside))
        assert found["aic"].value == pytest.approx(float(row["AIC_R"]), rel=1e-10)
        assert found["bic"].value == pytest.approx(float(row["BIC_R"]), rel=1e-10)
        K = int(row["size"]) + 2
        rss = f.n * math.exp((found["aic"].value - 2.0 * K) / f.n - 1.0) / (2.0 * math.pi)
        assert rss == pytest.approx(float(row["rss"]), rel=1e-10)
        assert rss / full - f.n + 2.0 * (K - 1) == pytest.approx(float(row["cp"]), rel=1e-8)


def _direct(X: np.ndarray, y: np.ndarray, m: float) -> dict[str, dict[tuple[int, ...], float]]:
    """Every criterion of every subset by its formula."""
    out: dict[str, dict[tuple[int, ...], float]] = {name: {} for name in ORDER[:5]}
    n, p = X.shape
    for subset in _subsets(p):
        left = y - X[:, subset] @ np.linalg.lstsq(X[:, subset], y, rcond=None)[0] if subset else y
        log_lik = -0.5 * n * (math.log(2.0 * math.pi * np.sum(left**2) / n) + 1.0)
        K, key = len(subset) + 1, tuple(subset)
        out["aic"][key] = -2.0 * log_lik + 2.0 * K
        out["aicc"][key] = out["aic"][key] - 2.0 * K + 2.0 * K * m / (m - K - 1.0)
        out["bic"][key] = -2.0 * log_lik + K * math.log(m)
        out["hqc"][key] = -2.0 * log_lik + 2.0 * K * math.log(math.log(m))
        out["ebic"][key] = out["bic"][key] + 2.0 * math.log(math.comb(p, len(subset)))
    return out


@pytest.mark.parametrize("samples", [60.0, 25.0])
def test_criteria_are_their_formulas_with_the_effective_sample_size_for_n(samples):
    X, y = _problem()
    found = _by_name(criteria(factor_of(X, y, NAMES), [], np.ones(5), NAMES, samples=samples))
    for name, values in _direct(X, y, samples).items():
        ordered = sorted(values.values())
        best = min(values, key=lambda subset, v=values: v[subset])
        weight = {subset: math.exp(-0.5 * (v - ordered[0])) for subset, v in values.items()}
        share = [sum(w for s, w in weight.items() if j in s) / sum(weight.values()) for j in range(5)]
        assert found[name].model == tuple(NAMES[j] for j in best)
        assert found[name].value == pytest.approx(ordered[0], rel=1e-10)
        assert found[name].lead == pytest.approx(ordered[1] - ordered[0], abs=1e-9)
        assert list(found[name].inclusion.values()) == pytest.approx(share, rel=1e-9)


def test_of_columns_that_depend_on_each_other_the_smallest_subset_with_their_span_wins():
    rng = np.random.default_rng(5)
    X, y = _problem()
    X, y = X * 10.0 ** rng.uniform(-4, 4, 5), 1e4 * X[:, 0] + y
    X = np.column_stack((X, X[:, 1] + X[:, 2]))
    names = (*NAMES, "sum")
    f = factor_of(X, y, names)
    # b, c and their sum leave a wholly to be explained: rounding must not do it
    dependent = np.array([[False, True, True, False, False, True]])
    values = _by_name(criteria(f, [], np.ones(6), names, among=dependent))
    left = y - X[:, 1:3] @ np.linalg.lstsq(X[:, 1:3], y, rcond=None)[0]
    expected = 60 * (math.log(2.0 * math.pi * np.sum(left**2) / 60) + 1.0) + 2.0 * 4
    assert values["aic"].value == pytest.approx(expected, abs=1e-4)
    assert not {"b", "c", "sum"} <= set(_by_name(criteria(f, [], np.ones(6), names))["bic"].model)


def test_beyond_the_budget_the_best_subset_is_still_found_and_said_not_to_be_exact(monkeypatch):
    X, y = _problem()
    f, pieces = factor_of(X, y, NAMES), [_cut(X, y, NAMES, 6)]
    whole = _by_name(criteria(f, pieces, np.ones(5), NAMES))
    monkeypatch.setattr(module, "WALKED", 100.0)
    monkeypatch.setattr(module, "LISTED", 120.0)
    few = _by_name(criteria(f, pieces, np.ones(5), NAMES))["loo"]
    assert few.model == whole["loo"].model
    assert few.value == pytest.approx(whole["loo"].value, rel=1e-12)
    assert (few.exact, few.compared) == (False, 12)
    assert "12 subsets" in few.note
    assert list(few.inclusion.values()) == pytest.approx(list(whole["loo"].inclusion.values()), abs=0.05)


def test_subsets_that_waic_was_not_computed_for_still_count_in_its_weights(monkeypatch):
    X, y = _problem()
    y = y + 30.0 * X[:, 0]
    f, pieces = factor_of(X, y, NAMES), [_cut(X, y, NAMES, 6)]
    sd = np.full(5, 30.0)
    whole = _by_name(criteria(f, pieces, sd, NAMES))["waic"]
    monkeypatch.setattr(module, "SCORED", 6)
    few = _by_name(criteria(f, pieces, sd, NAMES))["waic"]
    assert (few.model, few.compared, few.exact) == (whole.model, 6, False)
    assert few.value == pytest.approx(whole.value, rel=1e-12)
    # sixteen subsets with a carry the weight; six alone would leave errors of a tenth
    assert list(few.inclusion.values()) == pytest.approx(list(whole.inclusion.values()), abs=0.02)


def test_a_list_of_all_subsets_gives_what_the_tree_gives():
    X, y = _problem()
    f, pieces = factor_of(X, y, NAMES), [_cut(X, y, NAMES, 6)]
    among = Space(5).members(np.arange(32))
    for a, b in zip(
        criteria(f, pieces, np.ones(5), NAMES),
        criteria(f, pieces, np.ones(5), NAMES, among=among),
        strict=True,
    ):
        assert a.model == b.model
        assert a.value == pytest.approx(b.value, rel=1e-12)
        assert a.inclusion == pytest.approx(b.inclusion, rel=1e-8)
        assert not b.exact
        assert "32 subsets" in b.note


def test_the_only_run_is_scored_by_the_evidence():
    X, y = _problem()
    f = factor_of(X, y, NAMES)
    among = np.zeros((1, 5), dtype=bool)
    found = criteria(f, [_cut(X, y, NAMES, 60)], np.ones(5), NAMES, among=among)[-1]
    variance = f.R[-1, -1] ** 2 / (60 - 5)
    # without a column the data are white noise of the scale that the full library leaves
    assert found.value == pytest.approx(60 * math.log(2 * math.pi * variance) + y @ y / variance, rel=1e-10)
    assert "only run" in found.note


def test_a_run_that_alone_excites_a_flat_column_cannot_be_predicted():
    X, y = _problem()
    X[:30, 4] = 0.0
    f = factor_of(X, y, NAMES)
    pieces = [_cut(X[:30], y[:30], NAMES, 6), _cut(X[30:], y[30:], NAMES, 6)]
    found = _by_name(criteria(f, pieces, np.array([1.0, 1.0, 1.0, 1.0, np.inf]), NAMES[:4]))
    assert found["leave_one_run_out"].value == math.inf
    assert "too few" in found["leave_one_run_out"].note
    assert math.isfinite(found["loo"].value)


def test_aicc_of_fewer_samples_than_parameters_is_undefined_not_wrong():
    X, y = _problem()
    found = _by_name(criteria(factor_of(X, y, NAMES), [], np.ones(5), NAMES, samples=1.5))["aicc"]
    assert found.value == math.inf
    assert "too few" in found.note
    assert all(math.isnan(share) for share in found.inclusion.values())


def test_chains_tell_leave_one_out_how_far_to_trust_it():
    X, y = _problem()
    found = criteria(factor_of(X, y, NAMES), [_cut(X, y, NAMES, 6)], np.ones(5), NAMES)
    mean = np.random.default_rng(1).normal(size=(4000, 1)) / 3.0
    told = _by_name(with_sampled_noise(found, -0.5 * (np.array([[0.0, 0.5, 9.0]]) - mean) ** 2))
    assert told["loo"].pareto_k > 0.7
    assert "1 of 3 dwells" in told["loo"].note
    assert math.isnan(told["waic"].pareto_k)


MANY = tuple(f"c{j}" for j in range(23))


@pytest.mark.parametrize(
    ("said", "candidates", "options"),
    [
        ("23 candidates", MANY, {}),
        ("'z'", ("a", "z"), {}),
        ("a needs b", NAMES, {"needs": (("a", "b"),), "among": np.eye(1, 5, dtype=bool)}),
    ],
)
def test_what_cannot_be_compared_is_refused(said, candidates, options):
    names = candidates if candidates is MANY else NAMES
    f = factor_of(np.eye(30, len(names)), np.ones(30), names)
    with pytest.raises(TermError, match=said):
        criteria(f, [], np.ones(len(names)), candidates, **options)
