"""The mixture of Gaussians against closed forms and its own draws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import norm

from imubayes.inference.prior import GPrior, ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection import mixture
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.mixture import Components, draw, limit, probability_within, quantiles
from imubayes.selection.models import Models

LEVELS = (0.001, 0.05, 0.3, 0.5, 0.8, 0.95, 0.999)
NAMES = ("a", "b", "c", "d", "e", "f")


def _components(weight, mean, sd) -> Components:
    """Mixture of a single column."""
    shape = (len(weight), 1)
    return Components(
        np.array(weight), np.zeros(len(weight), dtype=np.int64), np.ones(len(weight)),
        np.reshape(mean, shape).astype(float), np.reshape(sd, shape).astype(float),
    )  # fmt: skip


UNIT = ScalePrior(1.0)


def _models(n: int = 14, p: int = 4, prior=UNIT, **options) -> Models:
    rng = np.random.default_rng(11)
    X = rng.normal(size=(n, p)) @ (np.eye(p) + 0.3)
    y = X[:, :2] @ [1.0, -0.45] + 0.8 * rng.normal(size=n)
    return enumerate_models(Summary.from_arrays(X, y, NAMES[:p]), prior, **options)


@given(st.floats(0.05, 0.95), st.floats(-3.0, 3.0), st.floats(0.1, 2.0))
def test_quantiles_are_where_the_distribution_with_its_step_at_zero_passes_the_level(share, mean, sd):
    parts = _components([1.0 - share, share], [0.0, mean], [0.0, sd])
    below, width = share * norm.cdf(0.0, mean, sd), 1e-12 * (3.0 + 12.0 * sd)

    def distribution(x):
        return share * norm.cdf(x, mean, sd) + (1.0 - share) * (x >= 0.0)

    for level, found in zip(LEVELS, quantiles(parts, 0, LEVELS), strict=True):
        assert distribution(found - width) <= level + 1e-12
        assert distribution(found + width) >= level - 1e-12
        if below + 1e-12 < level < below + 1.0 - share - 1e-12:
            assert found == 0.0


def test_quantiles_of_a_point_mass_alone_are_exactly_zero():
    assert quantiles(_components([0.4, 0.6], [0.0, 0.0], [0.0, 0.0]), 0, LEVELS) == (0.0,) * len(LEVELS)


@given(st.floats(0.01, 4.0), st.floats(-3.0, 3.0), st.floats(0.1, 2.0))
def test_probability_within_counts_the_mass_at_zero(bound, mean, sd):
    parts = _components([0.25, 0.75], [0.0, mean], [0.0, sd])
    inside = norm.cdf(bound, mean, sd) - norm.cdf(-bound, mean, sd)
    assert probability_within(parts, 0, bound) == pytest.approx(0.25 + 0.75 * inside, abs=1e-14)
    assert probability_within(_components([1.0], [0.0], [0.0]), 0, 0.0) == 1.0


@given(st.floats(0.01, 0.99), st.floats(0.01, 5.0))
def test_limit_is_that_of_the_models_with_the_term(share, sd):
    """Centred at zero: 1.96 sd for 95 %, however much probability sits at zero itself."""
    parts = _components([1.0 - share, share], [0.0, 0.0], [0.0, sd])
    assert limit(parts, 0) == pytest.approx(norm.ppf(0.975) * sd, rel=1e-12)
    assert limit(parts, 0, 0.5) == pytest.approx(norm.ppf(0.75) * sd, rel=1e-12)


def test_quantiles_and_limit_are_the_mean_where_its_sd_is_below_rounding():
    parts = _components([0.3, 0.7], [0.0, 1e4], [0.0, 1e-14])
    assert quantiles(parts, 0, (0.05, 0.5, 0.95)) == (0.0, 1e4, 1e4)
    assert limit(parts, 0) == 1e4
    assert quantiles(_components([1.0], [-1e4], [1e-14]), 0, LEVELS) == (-1e4,) * len(LEVELS)


@given(st.integers(0, 10_000))
def test_quantiles_and_limit_of_widths_over_nine_decades_are_those_of_brent(seed):
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.full(8, 0.4))
    mean, sd = rng.normal(size=8) * 10.0 ** rng.uniform(-6.0, 1.0), 10.0 ** rng.uniform(-8.0, 1.0, 8)
    end = float(np.max(np.abs(mean) + 12.0 * sd))

    def below(x):
        return weight @ norm.cdf(x, mean, sd)

    parts = _components(weight, mean, sd)
    for level, found in zip(LEVELS, quantiles(parts, 0, LEVELS), strict=True):
        brent = brentq(lambda x, level=level: below(x) - level, -end, end, xtol=1e-15 * end)
        assert found == pytest.approx(brent, abs=1e-13 * end)
    brent = brentq(lambda x: below(x) - below(-x) - 0.95, 0.0, end, xtol=1e-15 * end)
    assert limit(parts, 0) == pytest.approx(brent, abs=1e-13 * end)


def test_limit_of_a_term_that_is_in_no_model_is_not_a_number():
    assert math.isnan(limit(_components([1.0], [0.0], [0.0]), 0))


DRAWS = 40_000


def _within_four_standard_errors(sample: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> None:
    error = np.std(sample, axis=0) / math.sqrt(len(sample))
    np.testing.assert_array_less(np.abs(sample.mean(axis=0) - mean), 4.0 * error + 1e-12)
    squares = (sample - mean) ** 2
    error = np.std(squares, axis=0) / math.sqrt(len(sample))
    np.testing.assert_array_less(np.abs(squares.mean(axis=0) - sd**2), 4.0 * error + 1e-12)


@pytest.mark.parametrize("options", [{}, {"forced": ["b"]}, {"forced": ["a"], "always": ["c"]}])
def test_draws_have_the_moments_inclusion_and_quantiles_of_the_mixture(options):
    models = _models(**options)
    rng, columns = np.random.default_rng(3), len(models.candidates.columns)
    own = rng.random(DRAWS), rng.standard_normal((DRAWS, columns))
    sample = draw(models.candidates, models.components, *own)
    order = [models.candidates.columns.index(name) for name in models.names]
    sample = sample[:, order]
    _within_four_standard_errors(sample, models.mean, models.sd)
    included = (sample != 0.0).astype(float)
    spread = np.sqrt(models.inclusion * (1.0 - models.inclusion) / DRAWS)
    np.testing.assert_array_less(np.abs(included.mean(axis=0) - models.inclusion), 4.0 * spread + 1e-9)
    for column, j in enumerate(order):
        for level, at in zip(LEVELS, quantiles(models.components, j, LEVELS), strict=True):
            if at != 0.0:
                share = np.mean(sample[:, column] <= at)
                assert abs(share - level) < 4.0 * math.sqrt(level * (1.0 - level) / DRAWS)


def test_a_draw_changes_with_the_posterior_and_not_with_other_draws():
    """A few come from another model once its weight has changed; all others move as little as their model."""
    first, other = _models(prior=UNIT), _models(prior=ScalePrior(1.003))
    rng = np.random.default_rng(3)
    own = rng.random(4_000), rng.standard_normal((4_000, len(first.candidates.columns)))
    before, after = (draw(one.candidates, one.components, *own) for one in (first, other))
    elsewhere = np.any((before != 0.0) != (after != 0.0), axis=1)
    assert 0 < np.count_nonzero(elsewhere) < 40
    moved = np.abs(after - before)[~elsewhere]
    assert 0.0 < moved.max() < 0.1 * first.sd.max()


def test_a_draw_does_not_depend_on_how_the_factor_was_turned():
    models = _models(p=6)
    turned = models.candidates.whole * np.where(np.arange(7) % 3, 1.0, -1.0)[:, None]
    rng = np.random.default_rng(3)
    own = rng.random(200), rng.standard_normal((200, 6))
    one, other = (draw(replace(models.candidates, whole=R), models.components, *own)
                  for R in (models.candidates.whole, turned))  # fmt: skip
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_moments_of_the_mixture_are_those_of_all_models():
    """Against inclusion, which is summed over all models, not over the components that were kept."""
    models = _models(n=40, p=6)
    inside = models.components.weight @ (models.components.sd > 0.0)
    np.testing.assert_allclose(inside, models.inclusion, atol=mixture.LEFT_OUT * 2.0)


def test_a_systematic_sample_of_models_stands_for_all(monkeypatch):
    """Evenly spaced ticks miss the probability of any set of consecutive models by less than two ticks."""
    exact = _models(n=20, p=6)
    assert exact.drawn == 0
    monkeypatch.setattr(mixture, "CHOSEN", 40)
    sampled = _models(n=20, p=6)
    used = np.unique(sampled.components.inside, axis=0)
    assert len(used) <= 40 < len(np.unique(exact.components.inside, axis=0))
    last = sampled.components.sd[:, 5] > 0.0  # the last column's models are consecutive masks
    assert abs(sampled.components.weight[last].sum() - exact.inclusion[5]) < 2.0 / 40
    assert np.all(np.abs(sampled.mean - exact.mean) < 0.1 * exact.sd)
    np.testing.assert_allclose(sampled.inclusion, exact.inclusion, rtol=1e-13)
    assert sampled.drawn == 40
    assert _models(n=20, p=6, prior=GPrior(20.0)).drawn == 0  # its means are sums over all models
