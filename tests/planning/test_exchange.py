"""The search for the best test: optima that are known, optima found by trying everything, and its bounds."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from imubayes.planning import Menu, PlanProblem, Signal, Step, duration, root, runs_of, size_of, worth
from imubayes.planning.exchange import _promised_without, best_plan, even_plan, following
from imubayes.sensors.noise import Noise, flicker

WHITE = Noise(1.0, 0.0, 0.0)
COLOURED = Noise(1.0, 0.5, 0.3)


def _menu(X, *, mount=None, dwells=(1.0,), noise=WHITE, **times):
    mounts = np.zeros(len(X), dtype=np.int64) if mount is None else np.array(mount)
    return Menu("bench", (Signal(X, noise),), mounts, dwells, **times)


def _problem(menus, kind, limit, *, prior=1.0):
    c = menus[0].signals[0].X.shape[1]
    return PlanProblem(tuple(menus), prior * np.eye(c), kind, np.eye(c), limit)


@pytest.mark.parametrize(
    ("degree", "support"),
    [
        (3, [-1.0, -(5.0**-0.5), 5.0**-0.5, 1.0]),
        (4, [-1.0, -((3.0 / 7.0) ** 0.5), 0.0, (3.0 / 7.0) ** 0.5, 1.0]),
    ],
)
def test_d_optimal_polynomial_design_is_at_the_zeros_of_legendre_slope(degree, support):
    # Guest (1958), Hoel (1958): equal weights at the ends and at the zeros of P_n'
    grid = np.linspace(-0.97, 0.97, 38)
    x = np.sort(np.concatenate((grid[np.abs(grid[:, None] - support).min(axis=1) > 0.02], support)))
    repeats = 3
    limit = float(repeats * len(support))
    powers = np.vander(x, degree + 1, increasing=True)
    found = best_plan(_problem([_menu(powers)], "D", limit, prior=1e-4))
    settings = np.sort([x[step.setting] for step in found.steps])
    np.testing.assert_allclose(settings, np.repeat(support, repeats), atol=1e-12)


def test_rounding_does_not_choose_among_plans_that_are_as_good():
    # a circle of positions: each plan is as good turned by a step, or run through backwards
    angle, rng = np.arange(12) * np.pi / 6, np.random.default_rng(1)
    X = np.column_stack([np.ones(12), *(wave(k * angle) for k in (1, 2) for wave in (np.cos, np.sin))])
    found = [
        best_plan(
            _problem([_menu(X * (1.0 + rounding * rng.normal(size=X.shape)), noise=COLOURED)], "worst", 8.0)
        )
        for rounding in (0.0, 1e-13, 1e-13)
    ]
    assert found[0].steps == found[1].steps == found[2].steps


def test_a_search_tells_how_far_it_is_at_each_move():
    told: list[tuple[str, float]] = []
    X = np.random.default_rng(1).normal(size=(5, 2))
    best_plan(_problem([_menu(X)], "D", 4.0), tell=lambda *said: told.append(said))
    shares = [share for _, share in told]
    assert shares == sorted(shares) and 0.6 < shares[-1] <= 1.0
    assert told[0][0] == "plans to start from" and told[-1][0].startswith("3 of 3 plans improved, round ")


@pytest.mark.parametrize("kind", ["D", "worst", "rms"])
@pytest.mark.parametrize("noise", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize("seed", range(2))
def test_search_finds_what_trying_every_order_of_every_choice_finds(kind, noise, seed):
    X = np.random.default_rng(seed).normal(size=(5, 2))
    problem = _problem([_menu(X, noise=noise)], kind, 4.0)
    every = (tuple(Step(0, k, 1.0) for k in chosen) for chosen in product(range(5), repeat=4))
    assert best_plan(problem).worth == pytest.approx(min(worth(problem, steps) for steps in every), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_search_over_mounts_and_dwells_is_within_3_percent_of_trying_everything(seed):
    X = np.random.default_rng([seed, 1]).normal(size=(4, 2))
    menu = _menu(X, mount=[0, 0, 1, 1], dwells=(1.0, 3.0), settle=0.5, remount=1.0, noise=COLOURED)
    problem = _problem([menu], "worst", 10.0)
    single = [Step(0, k, dwell) for k in range(4) for dwell in menu.dwells]
    every = (
        steps
        for n in range(1, 6)
        for steps in product(single, repeat=n)
        if _blocks_once(menu, steps) and duration(problem, steps) <= problem.limit
    )
    assert best_plan(problem).worth <= 1.03 * min(worth(problem, steps) for steps in every)


def _blocks_once(menu, steps):
    mounts = [int(menu.mount[step.setting]) for step in steps]
    changes = sum(a != b for a, b in pairwise(mounts))
    return changes == len(set(mounts)) - 1


def test_posterior_of_steps_is_that_of_dense_algebra():
    rng = np.random.default_rng(5)
    menus = [_menu(rng.normal(size=(6, 3)), noise=n) for n in (COLOURED, WHITE)]
    problem = _problem(menus, "D", 99.0, prior=0.7)
    steps = (*(Step(0, k, 2.0) for k in (3, 1, 1, 5)), *(Step(1, k, 0.5) for k in (2, 0)))
    information = 0.7**2 * np.eye(3)
    for k, part in runs_of(steps):
        (told,) = menus[k].signals
        X = told.X[[step.setting for step in part]]
        information += X.T @ np.linalg.inv(_dense(told.noise, [s.dwell for s in part])) @ X
    S = root(problem, steps)
    # the processes that stand for B are a decade apart, here a factor of four
    np.testing.assert_allclose(S @ S.T, np.linalg.inv(information), rtol=0.05, atol=0.01)


def _dense(noise, dwells):
    """Covariance of means over consecutive dwells, by quadrature of the processes' own."""
    fine = 0.02
    t = np.arange(0.5 * fine, sum(dwells), fine)
    lag = np.abs(t[:, None] - t)
    C = noise.N**2 / fine * np.eye(len(t)) + noise.K**2 * np.minimum(t[:, None], t)
    if noise.B:
        for variance, tau in zip(*flicker(noise.B, 0.2, 50.0, 4.0), strict=True):
            C += variance * np.exp(-lag / tau)
    edges = np.concatenate(([0.0], np.cumsum(dwells)))
    A = np.array([(t > a) & (t < b) for a, b in pairwise(edges)], dtype=float)
    A /= A.sum(axis=1, keepdims=True)
    return A @ C @ A.T


def test_leaving_the_last_step_out_costs_what_is_computed_afresh():
    rng = np.random.default_rng(8)
    problem = _problem([_menu(rng.normal(size=(8, 4)), noise=COLOURED)], "D", 6.0)
    steps = tuple(Step(0, k, 1.0) for k in (0, 3, 3, 7, 2, 5))
    # nothing comes after it, so that no time changes; processes for a shorter span are a little fewer
    assert _promised_without(problem, steps)[-1] == pytest.approx(worth(problem, steps[:-1]), rel=0.02)


def test_worst_is_at_most_the_largest_sd_and_at_least_a_sixteenth_root_of_it():
    V = np.diag(np.arange(1.0, 16.0) ** 2)
    size = float(size_of("worst", V))
    assert 15.0 * 15.0 ** (-1.0 / 16.0) <= size <= 15.0


def test_what_is_known_before_moves_dwells_to_what_is_not():
    # columns of two unknowns; the first is known already
    menu = _menu(np.eye(2))
    problem = replace(_problem([menu], "worst", 4.0), start=np.diag([100.0, 1.0]))
    assert {step.setting for step in best_plan(problem).steps} == {1}
    (best, _, _), *_ = following(problem, 2)
    assert best.setting == 1


def test_plan_keeps_the_time_and_even_plan_uses_all_of_it():
    X = np.random.default_rng(3).normal(size=(6, 3))
    times = {"settle": 2.0, "remount": 10.0, "setup": 20.0}
    menu = _menu(X, mount=[0, 0, 1, 1, 2, 2], dwells=(5.0, 20.0), noise=COLOURED, **times)
    problem = _problem([menu], "worst", 150.0)
    assert duration(problem, best_plan(problem).steps) <= 150.0
    assert duration(problem, even_plan(problem, 0)) == pytest.approx(150.0)
    # by hand: set up, three mounts, six times to settle, and six dwells
    assert duration(problem, even_plan(problem, 0)[:1]) == pytest.approx(20.0 + 10.0 + 2.0 + (150 - 62) / 6)


def test_an_even_plan_has_a_record_beyond_what_is_lost_at_the_ends_of_each_dwell():
    menu = _menu(np.eye(2), settle=2.0, lost=0.3)
    assert even_plan(_problem([menu], "worst", 5.0), 0)[0].dwell == pytest.approx(0.5)
