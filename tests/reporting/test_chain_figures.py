from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from imubayes.reporting import chain_figures
from imubayes.reporting.chain_figures import BINS, Watched, held_levels, rank_sd, rank_shares
from imubayes.reporting.chain_words import _said


def panels(sensor) -> list:
    shown = chain_figures.watched(sensor, sensor.chains, 4)
    drawn = [paint(one, f"a{n}{paint.__name__[0]}") for n, one in enumerate(shown)
             for paint in (chain_figures.trace, chain_figures.ranks)]  # fmt: skip
    return [*drawn, chain_figures.corner(sensor, sensor.chains, "c")]


def test_watched_are_the_slowest_coefficients_and_the_noises_that_agree_least(make_sampled) -> None:
    sensor = make_sampled(converged=False)
    *noises, first, second = chain_figures.watched(sensor, sensor.chains, 2)
    assert first.name == "b2" and second.name == "rotation of the fixture about j, mount 2"
    apart = {one.name: one.apart for one in chain_figures.watched(sensor, sensor.chains, 99)[:-2]}
    assert len(apart) == 6 and [one.name for one in noises] == sorted(apart, key=apart.__getitem__)[:-3:-1]


def test_noise_that_was_given_is_not_watched(make_sampled) -> None:
    sensor = make_sampled()
    parameters = tuple(name for name in sensor.chains.diagnostics.parameters if name in sensor.chains.names)
    found = replace(sensor.chains.diagnostics, parameters=parameters, ess=np.full(len(parameters), 9e9))
    shown = chain_figures.watched(sensor, replace(sensor.chains, diagnostics=found), 4)
    assert len(shown) == 2 and not any(_said(one.name) != one.name for one in shown)


def test_ensemble_that_is_stuck_is_named(make_sampled) -> None:
    titles = [panel.title for panel in panels(make_sampled(converged=False))]
    assert any(title.startswith("b2: ensemble 1 has ") for title in titles)
    assert all("within chance" in panel.title for panel in panels(make_sampled())[1:-1:2])


def test_quantities_are_in_printed_units(make_sampled) -> None:
    sensor = make_sampled()
    bias = chain_figures.column(sensor, sensor.chains, 0)
    gravity = chain_figures.column(sensor, sensor.chains, sensor.chains.names.index("gravity"))
    # 1 ug is 9.80665e-6 m/s^2
    np.testing.assert_allclose(bias.draws * 9.80665e-6, sensor.chains.theta[:, :, 0], rtol=1e-12)
    assert bias.unit == gravity.unit == "µg" and gravity.name == "error of local gravity"


def test_rank_shares_are_even_over_each_ensemble_and_over_each_bin() -> None:
    share = rank_shares(np.random.default_rng(2).standard_normal((4, 30 * BINS)))
    np.testing.assert_allclose(share.mean(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(share.mean(axis=1), 1.0, rtol=1e-12)


def test_rank_shares_scatter_by_chance_as_stated() -> None:
    rng = np.random.default_rng(4)
    many = np.array([rank_shares(rng.standard_normal((4, 120))) for _ in range(400)])
    # bins are filled without replacement: a factor 1 - 1/4 on the variance of independent counts
    variance, expected = float(np.mean((many - 1.0) ** 2)), 0.75 * rank_sd(120) ** 2
    # 400 repeats of 3 x 11 free squares: relative standard error sqrt(2 / 13200)
    assert abs(variance / expected - 1.0) < 4.0 * np.sqrt(2.0 / 13200.0)


def test_contours_hold_the_probability_they_are_named_after() -> None:
    x = np.linspace(-5.0, 5.0, 401)
    grid = np.stack(np.meshgrid(x, x), axis=-1)
    density = multivariate_normal([0.0, 0.0], [[1.0, 0.9], [0.9, 1.0]]).pdf(grid)
    peak = 1.0 / (2.0 * np.pi * np.sqrt(1.0 - 0.81))
    # a share s of a plane normal density lies above (1 - s) of its peak; cells are 0.025 wide
    assert held_levels(density) == pytest.approx([0.1 * peak, 0.5 * peak], rel=2e-3)


def test_strongest_ties_agree_with_the_correlation_of_the_draws(make_sampled) -> None:
    sensor = make_sampled()
    (a, b, r), *rest = chain_figures.tied_pairs(sensor, sensor.chains)
    assert {sensor.chains.names[a], sensor.chains.names[b]} == {"b1", "b3"}
    x, y = (sensor.chains.theta[:, :, j].ravel() for j in (a, b))
    slope = np.polyfit(x / x.std(), y / y.std(), 1)[0]
    assert r == pytest.approx(slope, abs=1e-10) and abs(r) >= max(abs(value) for _, _, value in rest)


def test_corner_shows_at_most_five_and_no_term_that_was_never_excited(make_sampled) -> None:
    sensor = make_sampled()
    theta = sensor.chains.theta.copy()
    untested = sensor.chains.names.index("S_ij")
    theta[:, :, untested] = theta[:, :, untested - 1]
    chains = replace(sensor.chains, theta=theta)
    names = {chains.names[j] for a, b, _ in chain_figures.tied_pairs(sensor, chains) for j in (a, b)}
    assert "S_ij" not in names and "gravity" in names
    root = ElementTree.fromstring(chain_figures.corner(sensor, chains, "c").svg)
    assert int(root.get("width")) < 700


def test_chains_that_never_vary_have_no_corner(make_sampled) -> None:
    sensor = make_sampled()
    still = replace(sensor.chains, theta=np.zeros_like(sensor.chains.theta))
    assert chain_figures.corner(sensor, still, "c") is None


def test_distance_of_an_ensemble_is_in_posterior_sd() -> None:
    draws = np.array([[0.0, 2.0], [4.0, 6.0]])
    # means 1 and 5 about 3; sd of 0, 2, 4, 6 is sqrt(5)
    assert Watched("a", "a", "", draws).apart == pytest.approx(2.0 / np.sqrt(5.0))
