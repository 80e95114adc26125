"""All methods on one component: what each is given, and that they speak of the same terms."""

import math

import numpy as np
import pytest
from decisions import campaign_of

import imubayes as ib
from imubayes.selection import panel as panels
from imubayes.selection.panel import begun, coloured, panel_of
from imubayes.sensors.noise import Noise

SPARSE = ("stlsq", "sr3", "ssr", "frols")


def asked(campaign, resamples):
    *given, selection = campaign
    return panel_of(begun(*given, rng=np.random.default_rng(1), resamples=resamples), selection)


@pytest.fixture(scope="module")
def panel(campaign):
    return asked(campaign, 5)


def test_criteria_count_the_effective_samples_of_coloured_noise(campaign, panel):
    rows = sum(len(run) for run in campaign[2])
    counted = {c.name: c.samples for c in panel.criteria}
    assert math.isnan(counted["aic"])
    assert 0.0 < counted["bic"] < rows


def test_too_many_subsets_are_those_that_the_evidence_finds_most_probable(campaign, panel, monkeypatch):
    """With as few as 200 of 8192 models the criteria choose as with all, for theirs are among them."""
    monkeypatch.setattr("imubayes.selection.panel.LARGEST", 5)
    monkeypatch.setattr("imubayes.selection.panel.LISTED", 200)
    told = asked(campaign, 2)
    assert len(campaign[3].models.candidates.names) > 8
    size = len(campaign[3].models.candidates.names)
    assert {c.compared for c in told.criteria if c.name == "bic"} <= set(range(200, 400 + size))
    assert not any(c.exact for c in told.criteria)
    for few, all_of_them in zip(told.criteria, panel.criteria, strict=True):
        assert few.model == all_of_them.model, few.name
        assert few.value == pytest.approx(all_of_them.value, rel=1e-9)


def test_white_noise_that_is_not_white_is_found_out():
    lean = {"powers": 1, "asymmetry": 0}
    plans = [ib.tumble(angles=12, planes=3, rate=1.0)]
    drifting, white = Noise(6e-4, 4e-4, 1e-5), Noise(6e-4, 0.0, 0.0)
    for rule, noise, found in (
        ("white", drifting, ("tumble",)),
        ("white", white, ()),
        ("estimate", drifting, ()),
    ):
        summary, prior, rows, _ = campaign_of("mems_tactical", plans, noise=noise, rule=rule, **lean)
        assert coloured(summary, prior, rows) == found


STAGES = {
    "apart": panels.EVERY,
    "criteria": (*panels.PREDICTIVE, *panels.INFORMATION),
    "sparse_regressions": SPARSE,
    "sensitivity": ("g-prior",),
    "reduced": ("reduced model",),
    "coloured": ("coloured noise",),
    "waic": panels.PREDICTIVE,
}


@pytest.mark.parametrize("stages", [["apart"], ["criteria", "sensitivity"], ["sparse_regressions", "reduced"],
                                    ["waic", "coloured"]])  # fmt: skip
def test_no_failure_of_an_opinion_takes_the_others_with_it(monkeypatch, campaign, panel, stages):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("cannot be had")

    for stage in stages:
        monkeypatch.setattr(f"imubayes.selection.{'criteria' if stage == 'waic' else 'panel'}.{stage}", fails)
    told = asked(campaign, 2)
    lost = [method for stage in stages for method in STAGES[stage]]
    assert sorted(one.method for one in told.unasked) == sorted(lost)
    assert {one.reason for one in told.unasked} == {"LinAlgError, cannot be had"}
    assert told.votes.methods == panel.votes.methods
    silent = np.isnan(told.votes.keeps).all(axis=1)
    assert {name for name, none in zip(told.votes.methods, silent, strict=True) if none} == {*lost} - {
        "reduced model",
        "coloured noise",
    }
    kept = {c.name: c for c in told.criteria}
    assert all(kept[c.name].model == c.model for c in panel.criteria if c.name in kept)
