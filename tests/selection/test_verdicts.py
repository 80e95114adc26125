"""The rule from evidence to verdict, over all evidence there can be."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from imubayes.errors import StudyError
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.decision import select
from imubayes.selection.verdicts import Costs, Evidence, decide, untested_verdict
from imubayes.sensors.terms import library

share = st.floats(0.0, 1.0)
prices = st.floats(0.01, 100.0)


beside = st.sampled_from([(), ("b2",), ("b2", "c_jj", "c_kk")])


@st.composite
def evidences(draw, partners=beside):
    inclusion, a, b = draw(share), draw(share), draw(share)
    low, high = min(inclusion, a, b), max(inclusion, a, b)
    return Evidence(
        inclusion,
        (low, high),
        draw(share),
        draw(share),
        draw(st.floats(0.0, 1e4)),
        draw(partners),
        "a run would",
    )


alone = evidences(partners=st.just(()))
confounded = evidences(partners=st.just(("b2", "c_jj", "c_kk")))
RANK = {"needed": 2, "undecided": 1, "unresolved": 1, "inseparable": 1, "not needed": 0}


def told(evidence):
    return decide(evidence)[0]


@given(alone)
def test_needed_is_inclusion_of_95_percent_and_no_other_thing(evidence):
    assert (told(evidence) == "needed") == (evidence.inclusion >= 0.95)


@given(confounded)
def test_a_confounded_term_is_needed_at_every_prior_width_or_not_at_all(evidence):
    resolved = evidence.ratio <= 0.9
    assert (told(evidence) == "needed") == (evidence.range[0] >= 0.95 and resolved)


@given(confounded)
def test_a_confounded_term_is_never_left_undecided_or_unresolved(evidence):
    verdict, reason = decide(evidence)
    assert verdict in ("needed", "not needed", "inseparable")
    if verdict == "inseparable":
        assert "b2, c_jj and c_kk" in reason and "a run would" in reason


@given(evidences())
def test_not_needed_is_unlikely_or_small_and_resolved(evidence):
    if told(evidence) == "not needed":
        largest = evidence.range[1] if evidence.partners else evidence.inclusion
        assert largest <= 0.05 or (evidence.small >= 0.95 and largest <= 0.5)
        assert evidence.ratio <= 0.9


@given(evidences(), prices, prices)
@example(Evidence(0.51, (0.4, 0.6), 1.0, 0.1, 3.0, (), ""), 1.0, 1.0)
def test_no_term_that_the_model_holds_is_not_needed_at_any_costs(evidence, false_keep, false_drop):
    costs = Costs(false_keep, false_drop)
    if evidence.inclusion > costs.keep:
        assert decide(evidence, costs)[0] != "not needed"


@given(evidences(), share)
def test_more_inclusion_never_makes_a_term_less_needed(evidence, more):
    up = [x + (1.0 - x) * more for x in (evidence.inclusion, *evidence.range)]
    raised = replace(evidence, inclusion=up[0], range=(up[1], up[2]))
    assert RANK[told(raised)] >= RANK[told(evidence)]


@given(alone)
def test_partners_only_take_certainty_away(evidence):
    with_partners = replace(evidence, partners=("b2",))
    before, after = RANK[told(evidence)], RANK[told(with_partners)]
    # a term that is there but surely small is needed alone, and does not matter where only its prior says so
    assert after in (before, 1) or evidence.small >= 0.95


@given(alone)
def test_a_posterior_as_wide_as_the_prior_resolves_nothing(evidence):
    if evidence.ratio > 0.9 and evidence.inclusion < 0.95:
        assert told(evidence) == "unresolved"


@pytest.mark.parametrize(
    ("inclusion", "words"), [(0.9, "leans towards it, 2.5 sd"), (0.2, "leans against it, 2.5 sd")]
)
def test_an_undecided_term_says_which_way_it_leans(inclusion, words):
    verdict, reason = decide(Evidence(inclusion, (inclusion, inclusion), 0.0, 0.3, 2.5, (), ""))
    assert verdict == "undecided"
    assert reason.startswith(words)


@pytest.mark.parametrize(("pull", "inclusion"), [(0.1, 0.77), (0.9, 0.84), (0.1, 0.2)])
def test_what_only_the_prior_and_the_other_terms_ask_for_is_not_said_to_be_shown(pull, inclusion):
    _, reason = decide(Evidence(inclusion, (inclusion, inclusion), 0.0, 0.3, pull, (), ""))
    alone = pull < 0.5 < inclusion
    assert ("by the prior and the other terms alone, 0.1 sd from zero" in reason) is alone


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_an_untested_term_names_the_inputs_it_waits_for(kind):
    for term in library(kind, set="extended").terms:
        found = untested_verdict(term, "", 1.0, 0.3)
        assert found.verdict == "untested"
        assert all(factor.channel in found.reason for factor in term.factors)


@given(prices, prices)
def test_a_verdict_is_sure_where_the_other_choice_costs_nineteen_times_as_much(false_keep, false_drop):
    costs = Costs(false_keep, false_drop)
    for inclusion, odds in ((costs.needed, 19.0), (costs.keep, 1.0), (costs.not_needed, 1.0 / 19.0)):
        dropped, kept = inclusion * false_drop, (1.0 - inclusion) * false_keep
        assert dropped == pytest.approx(odds * kept, rel=1e-9)


@given(evidences(), prices, prices, st.floats(1.0, 100.0))
def test_a_dearer_false_keep_never_makes_a_term_more_needed(evidence, false_keep, false_drop, more):
    before = RANK[decide(evidence, Costs(false_keep, false_drop))[0]]
    assert RANK[decide(evidence, Costs(more * false_keep, false_drop))[0]] <= before


@pytest.mark.parametrize("cost", [0.0, -1.0, float("inf"), float("nan")])
def test_a_cost_that_is_none_is_refused(cost):
    with pytest.raises(StudyError, match="cost of a false keep must be positive"):
        Costs(false_keep=cost)
    with pytest.raises(StudyError, match="cost of a false drop must be positive"):
        Costs(false_drop=cost)


def test_a_bias_of_five_sd_in_two_sets_is_not_unneeded_for_the_width_of_its_prior():
    """Lindley's paradox: under a prior of ten million error bars five sd have an inclusion below a half."""
    rng, lib = np.random.default_rng(1), library("accelerometer", powers=1, asymmetry=-1)
    lib = replace(lib, terms=lib.terms[:1])
    for n in (400, 900):
        noise = rng.standard_normal(n)
        y = (noise - noise.mean()) / noise.std() + 5.0 / np.sqrt(n)
        summary = Summary.from_arrays(np.ones((n, 1)), y, lib.names)
        (found,) = select(summary, ScalePrior([1e7 / np.sqrt(n)]), lib).terms
        assert found.inclusion < 0.5
        assert found.verdict == "undecided" and "width of its prior" in found.reason
