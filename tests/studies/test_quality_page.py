from dataclasses import replace

import numpy as np
import pytest
from page_reading import said
from report_reading import grids, tree

from imubayes.reporting.blocks import page_html
from imubayes.reporting.rounding import NARROW, percent
from studies.decision_quality.measure import Quality
from studies.decision_quality.page import quality_page
from studies.decision_quality.questions import Interval
from studies.decision_quality.scores import scores, treated
from studies.decision_quality.trials import MODELLED, OWN, WHITE, QualityStudy, Trial
from studies.decision_quality.words import quality_answer, targets

METHODS = (*OWN, "aic", "ebic", "bic", "leave_one_run_out", "stlsq")
STUDY = QualityStudy(seed=3, sensors=20, treatments=(MODELLED, WHITE), misspecified=20, processes=1)


def _trial(number: int, treatment: str, wrong: float) -> Trial:
    """Every method errs on a share of the terms; the decision on half as many."""
    rng = np.random.default_rng([number, treatment == WHITE])
    true = rng.random(10) < 0.5
    flips = (
        rng.random((len(METHODS), 10))
        < np.array([*[wrong / 2.0] * 3, *[wrong] * (len(METHODS) - 3)])[:, None]
    )
    keeps = np.where(flips, ~true, true).astype(float)
    strength = np.clip(keeps, 0.1, 0.9)
    effect = np.where(true, np.resize([0.5, 1.5, 3.0, 6.0, 20.0], 10), 0.0)
    terms = tuple(f"t{k}" for k in range(10))
    kind = ("accelerometer", "gyroscope")[number % 2]
    return Trial(
        kind,
        number,
        "x",
        treatment,
        terms,
        true * 1.0,
        effect,
        METHODS,
        keeps,
        strength,
        keeps,
        np.where(np.arange(len(METHODS))[:, None] < 3, rng.standard_normal(keeps.shape), np.nan),
    )


def made_quality() -> Quality:
    tried = tuple(_trial(k, t, w) for t, w in ((MODELLED, 0.2), (WHITE, 0.5)) for k in range(20))
    rng = np.random.default_rng(1)
    told = scores(tried, MODELLED, rng=rng)
    return Quality(STUDY, tried, told, tuple(treated(tried, t, rng=rng) for t in (MODELLED, WHITE)), 120.0)


@pytest.fixture(scope="module")
def quality() -> Quality:
    return made_quality()


def test_method_that_costs_less_is_named(quality):
    first = quality.scores
    cheap = replace(first.methods[3], cost=Interval(0.01, 0.0, 0.1), excess=Interval(-1.0, -2.0, -0.5))
    beaten = replace(first, methods=(*first.methods[:3], cheap, *first.methods[4:]))
    text = " ".join(quality_answer(replace(quality, scores=beaten)))
    assert "are not the fewest: AIC (0.01)" in text


def test_target_names_every_treatment_that_misses_it(quality):
    met, missed = (replace(quality, treated=tuple(map(change, quality.treated))) for change in (_good, _bad))
    first, second, third, last = targets(met)
    assert "each of 2 treatments: yes, most under as modelled, 1.0" in plain(first)
    assert second.endswith("yes, most under as modelled, 1.20.")
    assert third.endswith("yes, 4 against 4.")
    assert last.endswith("yes, 0.")
    first, second, third, last = targets(missed)
    assert "no, 5.0 % under as modelled and 5.0 % under noise assumed white" in plain(first)
    assert second.endswith("no, 3.00 under as modelled and 3.00 under noise assumed white.")
    assert third.endswith("no, 5 against 4.")
    assert last.endswith("no, 2.")


def plain(text):
    return text.replace(NARROW, " ")


def _with(one, share, rms, left, missed):
    def changed(said):
        return replace(
            said,
            false_keeps=Interval(share, 0.0, 0.1),
            rms=rms,
            left=Interval(0.1, 0.0, 0.2, left if said.method == OWN[0] else 4, 40),
            false_drops=Interval(missed / 40.0, 0.0, 0.2, missed, 40),
        )

    return replace(one, verdicts=tuple(map(changed, one.verdicts)))


def _good(one):
    return _with(one, 0.01, 1.2, 4, 0)


def _bad(one):
    return _with(one, 0.05, 3.0, 5, 2)


def test_sensors_that_are_refused_are_told_with_the_reason(quality):
    bad = replace(quality.treated[1], refused=("3 rows leave nothing to judge", "no"))
    text = plain(page_html(quality_page(replace(quality, treated=(quality.treated[0], bad)))))
    said = "Under noise assumed white 2 of 20 sensors were refused, and all of their terms left open: 3 rows"
    assert said in text
    assert "sensors were refused" not in page_html(quality_page(quality))


def test_tables_by_treatment_say_what_the_verdicts_are(quality):
    by_method, decision = grids(tree(page_html(quality_page(quality))))[:2]
    for one, row in zip(quality.treated, by_method.rows, strict=True):
        assert row[:2] == (one.treatment, str(one.zero))
        shown = [said.false_keeps for said in one.verdicts if said.method not in OWN[1:]]
        for found, cell in zip(shown, row[2:], strict=True):
            assert cell == (plain(f"{found.events} ({percent(found.value)})") if found.events else "0")
    assert len(decision.rows) == 6
    last = quality.treated[1].of(OWN[2])
    assert decision.rows[-1][0] == f"{WHITE}: {OWN[2]}"
    assert decision.rows[-1][1].startswith(f"{last.false_keeps.events} of {last.false_keeps.of}: ")
    assert decision.rows[-1][4].startswith(f"{last.left.events} of {last.left.of}: ")
    assert decision.rows[-1][5:] == (f"{last.rms:.2f}", f"{last.largest:.1f}")


def test_page_says_what_it_said(quality, golden):
    golden("pages/quality.txt", said(page_html(quality_page(quality))))
