import json
from dataclasses import replace

import numpy as np
import pytest
from tool_readings import wrong_quality

from imubayes.reporting.blocks import page_html
from imubayes.reporting.result.file import json_text
from imubayes.reporting.rounding import NARROW
from studies.decision_quality.measure import Quality
from studies.decision_quality.page import quality_page, quality_record
from studies.decision_quality.questions import Interval
from studies.decision_quality.scores import scores
from studies.decision_quality.trials import DECISION, MODELLED, SURE, WHITE, QualityStudy, Trial
from studies.decision_quality.words import claim, quality_answer

METHODS = (DECISION, SURE, "aic", "ebic", "bic", "leave_one_run_out", "stlsq")
STUDY = QualityStudy(seed=3, sensors=20, treatments=(MODELLED, WHITE), misspecified=20, processes=1)


def _trial(number: int, treatment: str, wrong: float) -> Trial:
    """Every method errs on a share of the terms; the decision on half as many."""
    rng = np.random.default_rng([number, treatment == WHITE])
    true = rng.random(10) < 0.5
    flips = rng.random((len(METHODS), 10)) < np.array([wrong / 2.0, *[wrong] * (len(METHODS) - 1)])[:, None]
    keeps = np.where(flips, ~true, true).astype(float)
    strength = np.clip(keeps, 0.1, 0.9)
    strength[1] = np.nan
    effect = np.where(true, np.resize([0.5, 1.5, 3.0, 6.0, 20.0], 10), 0.0)
    terms, nothing = tuple(f"t{k}" for k in range(10)), np.zeros(0)
    kind = ("accelerometer", "gyroscope")[number % 2]
    return Trial(
        kind,
        number,
        "x",
        treatment,
        terms,
        true * 1.0,
        effect,
        (),
        nothing,
        METHODS,
        keeps,
        strength,
        keeps[0],
    )


def made_quality() -> Quality:
    tried = tuple(_trial(k, t, w) for t, w in ((MODELLED, 0.2), (WHITE, 0.5)) for k in range(20))
    rng = np.random.default_rng(1)
    told = tuple(scores(tried, t, kind, rng=rng) for t in (MODELLED, WHITE) for kind in ("", "accelerometer"))
    return Quality(STUDY, tried, told, 120.0)


@pytest.fixture(scope="module")
def quality() -> Quality:
    return made_quality()


def test_method_that_costs_less_is_named(quality):
    first = quality.scores[0]
    cheap = replace(first.methods[2], cost=Interval(0.01, 0.0, 0.1), excess=Interval(-1.0, -2.0, -0.5))
    beaten = replace(first, methods=(*first.methods[:2], cheap, *first.methods[3:]))
    text = " ".join(quality_answer(replace(quality, scores=(beaten,))))
    assert "are not the fewest: AIC (0.01)" in text


@pytest.mark.parametrize(
    ("value", "high", "said"),
    [(0.01, 0.019, "yes."), (0.01, 0.03, "but the interval reaches 3.0 %"), (0.05, 0.09, "no, 5.0 %")],
)
def test_claim_is_kept_only_with_its_interval(value, high, said):
    assert said in claim(Interval(value, 0.0, high), "false keeps").replace(NARROW, " ")


def test_every_number_of_the_page_is_one_of_the_result(quality):
    assert (
        wrong_quality(page_html(quality_page(quality)), json.loads(json_text(quality_record(quality)))) == []
    )
