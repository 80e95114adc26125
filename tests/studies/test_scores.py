import numpy as np
import pytest
from scipy.stats import binom

from studies.decision_quality import questions as asked
from studies.decision_quality.scores import scores, treated
from studies.decision_quality.trials import DECISION, EVIDENCE, MODELLED, Trial

METHODS = (DECISION, EVIDENCE, "perfect", "all", "none", "coin")


def trial(number, rng, *, t=12):
    """A sensor whose decision is calibrated by construction: the truth is drawn from its inclusion."""
    inclusion = rng.beta(0.5, 0.5, t)
    true = rng.random(t) < inclusion
    keeps = np.array([inclusion >= 0.5, inclusion >= 0.95, true, np.ones(t), np.zeros(t), true], dtype=float)
    strength = np.array([inclusion, inclusion, true, np.ones(t), np.zeros(t), np.full(t, 0.5)])
    return Trial(
        kind="accelerometer",
        number=number,
        class_id="x",
        treatment=MODELLED,
        terms=tuple(f"t{k}" for k in range(t)),
        truth=np.where(true, 1.0, 0.0),
        effect=np.where(true, 10.0 ** rng.uniform(-1.0, 2.0, t), 0.0),
        methods=METHODS,
        keeps=keeps,
        strength=strength,
        said=(said := np.where(strength >= 0.95, 1.0, np.where(strength <= 0.05, 0.0, np.nan))),
        pull=np.where(np.isnan(said), np.nan, rng.normal(0.0, 2.0, said.shape)),
    )


@pytest.fixture(scope="module")
def tried():
    rng = np.random.default_rng(1)
    return [trial(k, rng) for k in range(300)]


@pytest.fixture(scope="module")
def told(tried):
    return scores(tried, MODELLED, rng=np.random.default_rng(2))


def test_rates_are_counts_over_counts(tried, told):
    zero = sum(int(np.sum(t.truth == 0.0)) for t in tried)
    kept = sum(int(np.sum((t.truth == 0.0) & (t.keeps[0] == 1.0))) for t in tried)
    strong = sum(int(np.sum(t.effect >= 8.0)) for t in tried)
    own = told.of(DECISION)
    assert (own.false_keeps.events, own.false_keeps.of) == (kept, zero)
    assert own.false_keeps.value == pytest.approx(kept / zero, rel=1e-12)
    assert own.false_drops[-1].of == strong
    assert sum(b.of for b in own.false_drops) == told.true
    wrong = sum(float(np.sum(t.keeps[0] != (t.truth != 0.0))) for t in tried)
    assert own.cost.value == pytest.approx(wrong / len(tried), rel=1e-12)


def test_verdicts_are_counted_over_those_that_there_are(tried):
    told = treated(tried, MODELLED, rng=np.random.default_rng(2)).of(DECISION)
    called = [(bool(x), s, p) for t in tried for x, s, p in zip(t.truth, t.said[0], t.pull[0], strict=True)]
    given = [one for one in called if not np.isnan(one[1])]
    assert told.false_keeps.events == sum(not true and said == 1.0 for true, said, _ in given)
    assert told.missed.events == sum(true and said == 0.0 for true, said, _ in given)
    assert (told.left.events, told.left.of) == (len(called) - len(given), len(called))
    assert told.pulls == len(given)
    assert told.rms**2 == pytest.approx(sum(pull**2 for *_, pull in given) / len(given), rel=1e-12)
    assert told.largest == max(abs(pull) for *_, pull in given)
    assert abs(told.rms - 2.0) < 4.0 * 2.0 / np.sqrt(2.0 * len(given))


def test_interval_of_a_cost_is_that_of_a_mean_over_sensors(tried, told):
    each = np.array([np.sum(t.keeps[0] != (t.truth != 0.0)) for t in tried], dtype=float)
    half = 1.96 * each.std() / np.sqrt(len(each))
    cost = told.of(DECISION).cost
    # percentiles of 2000 bootstrap samples are good to 5 % of the interval
    assert cost.low == pytest.approx(each.mean() - half, abs=0.1 * half)
    assert cost.high == pytest.approx(each.mean() + half, abs=0.1 * half)


@pytest.mark.parametrize(("events", "total"), [(0, 150), (1, 80), (7, 300), (40, 40)])
def test_exact_interval_leaves_a_fortieth_on_either_side(events, total):
    low, high = asked._clopper_pearson(events, total)
    if events:
        assert binom.sf(events - 1, total, low) == pytest.approx(0.025, rel=1e-9)
    if events < total:
        assert binom.cdf(events, total, high) == pytest.approx(0.025, rel=1e-9)


def test_calibrated_inclusion_is_found_calibrated(told):
    assert sum(b.true.of for b in told.calibration) == told.zero + told.true
    for b in told.calibration:
        spread = np.sqrt(b.inclusion * (1.0 - b.inclusion) / b.true.of)
        assert abs(b.true.value - b.inclusion) < 4.0 * spread
