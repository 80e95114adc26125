"""Ranks of simulated truths: uniform, few as they are here, and of many in the committed report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies.ranks.measure import SMALL, Ranks, RanksStudy, measure

COMMITTED = Path(__file__).parents[2] / "reports" / "ranks" / "ranks.json"


@pytest.fixture(scope="module")
def found() -> Ranks:
    return measure(SMALL)


def test_ranks_of_few_campaigns_are_uniform(found):
    for name, ranks in found.ranks.items():
        assert ranks.min() >= 0 and ranks.max() <= SMALL.draws
        assert found.counts(name).sum() == SMALL.campaigns
        assert found.p_value(name) > 0.001, name


def test_ranks_of_the_committed_campaigns_are_uniform():
    told = json.loads(COMMITTED.read_text(encoding="utf-8"))
    study = RanksStudy()
    for name, counts in told["counts"].items():
        ranks = np.repeat(np.arange(study.bins) * (study.draws + 1) // study.bins, counts)
        assert len(ranks) == study.campaigns == told["campaigns"]
        p = Ranks(study, {name: ranks}, 0.0).p_value(name)
        assert p == pytest.approx(told["p_values"][name], abs=1e-4)
        assert p > 0.01


def test_ranks_of_an_overconfident_posterior_are_refused():
    rng, study = np.random.default_rng(1), RanksStudy()
    truth, draws = (
        rng.standard_normal(study.campaigns),
        0.7 * rng.standard_normal((study.campaigns, study.draws)),
    )
    center = truth + rng.standard_normal(study.campaigns)
    ranks = np.sum(draws < (truth - center)[:, None], axis=1)
    assert Ranks(study, {"b0": ranks}, 0.0).p_value("b0") < 0.01
