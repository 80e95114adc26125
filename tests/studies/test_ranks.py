"""Ranks of simulated truths are uniform in the committed report; a small study is run by its command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies.ranks.measure import Ranks, RanksStudy
from studies.ranks.page import DOUBTFUL

COMMITTED = Path(__file__).parents[2] / "reports" / "ranks" / "result.json"


def test_ranks_of_the_committed_campaigns_are_uniform():
    told = json.loads(COMMITTED.read_text(encoding="utf-8"))
    study = RanksStudy()
    for one in told["quantities"]:
        ranks = np.repeat(np.arange(study.bins) * (study.draws + 1) // study.bins, one["counts"])
        assert len(ranks) == study.campaigns == told["campaigns"]
        p = Ranks(study, {"any": ranks}, 0.0).p_value("any")
        assert p == pytest.approx(one["p_value"], rel=1e-9)
        assert p > DOUBTFUL


def test_ranks_of_an_overconfident_posterior_are_refused():
    rng, study = np.random.default_rng(1), RanksStudy()
    truth, draws = (
        rng.standard_normal(study.campaigns),
        0.7 * rng.standard_normal((study.campaigns, study.draws)),
    )
    center = truth + rng.standard_normal(study.campaigns)
    ranks = np.sum(draws < (truth - center)[:, None], axis=1)
    assert Ranks(study, {"b0": ranks}, 0.0).p_value("b0") < 0.01
