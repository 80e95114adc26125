"""The truths that answers are held against, each by another route."""

from __future__ import annotations

import math

import numpy as np
import pytest

from studies.speed import campaigns, peers, problems, trades
from studies.speed.contests import Contest, Self


def _answers(contest: Contest) -> dict[str, object]:
    found = {e.name: e.solve() for e in contest.entrants if not peers.missing(e.needs)}
    return {name: one.answer if isinstance(one, Self) else one for name, one in found.items()}


def test_refined_least_squares_is_that_of_fifty_digits():
    """On seven powers of 40 to 50 g, whose condition is 1e11 with columns of unit length."""
    mpmath = pytest.importorskip("mpmath")
    rng = np.random.default_rng(1)
    x = rng.uniform(0.8, 1.0, 60) * problems.RANGE
    X = x[:, None] ** np.arange(8)
    y = X @ (rng.normal(size=8) / np.linalg.norm(X, axis=0)) + rng.normal(size=60)
    with mpmath.workdps(60):
        A, b = mpmath.matrix(X.tolist()), mpmath.matrix(y.tolist())
        exact = np.array([float(v) for v in mpmath.lu_solve(A.T * A, A.T * b)])
    theta, sd = problems.refined(X, y)
    assert np.max(np.abs(theta - exact) / sd) < 1e-5


@pytest.mark.parametrize("contest", [problems.least_squares, problems.one_sided])
def test_our_least_squares_is_right_where_columns_are_nearly_alike(contest):
    found = contest(5_000, 1)
    ours = found.entrants[0]
    assert ours.error(ours.solve()) < 1e-3
    assert found.entrants[0].error(np.zeros(21)) > 1.0


def test_the_tree_has_the_subsets_that_a_fit_of_each_has():
    contest = problems.subsets(8, 2)
    found = _answers(contest)
    for entrant in contest.entrants:
        if entrant.name in found:
            assert entrant.error(found[entrant.name]) < 1e-9, entrant.name


def test_a_g_prior_by_one_least_squares_after_the_other_is_ours():
    contest = problems.g_prior(8, 3)
    found = _answers(contest)
    np.testing.assert_allclose(found["imubayes"], found["numpy, one by one"], atol=1e-12)
    assert contest.entrants[0].error(found["imubayes"]) < 1e-12


def test_white_noise_alone_is_read_off_the_allan_plot():
    """sigma(tau) = N/sqrt(tau): over the first decade of 1e5 samples to 1 %, 4 sd."""
    pytest.importorskip("allantools", reason="needs the extra benchmark")
    y = 2e-3 * math.sqrt(100.0) * np.random.default_rng(5).normal(size=100_000)
    assert peers.allan_slopes(y, 100.0)[0] == pytest.approx(2e-3, rel=0.02)


def test_coordinates_of_the_chains_make_the_posterior_standard():
    """Where x is standard normal about zero, the rows obey ``A'A = 1`` and ``A'b = 0``."""
    contest = campaigns.chains(1_200, 1)
    assert contest.entrants[1].needs == ("nutpie", "arviz")
    runs = campaigns.campaign(1_200, 1)
    A, b, _ = campaigns.standard(runs)
    np.testing.assert_allclose(A.T @ A, np.eye(A.shape[1]), atol=1e-6)
    np.testing.assert_allclose(A.T @ b, 0.0, atol=1e-4 * np.linalg.norm(b))


def test_error_of_a_trade_is_counted_in_sd_of_its_best_rung_which_is_right(monkeypatch):
    monkeypatch.setattr(trades, "rungs_for", lambda size: ("plug-in",))
    contest, asked = trades.trade(1_000, 1), trades.problem(1_000, 1)
    ours, means, *_ = contest.entrants
    best = ours.solve()
    assert ours.error(best) == 0.0
    assert means.error(np.array([asked.spec.truth[name] for name in best.names])) < 4.0
    told = next(k for k, term in enumerate(best.selection.terms) if term.verdict == "needed")
    moved = best.full_mean + 3.0 * best.full_sd * (np.arange(len(best.names)) == told)
    assert means.error(moved) == pytest.approx(3.0)
