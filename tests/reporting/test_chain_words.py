from __future__ import annotations

from dataclasses import replace

import pytest

from imubayes.campaign.fidelity import Choice
from imubayes.inference.observability import Confounded
from imubayes.reporting.chain_words import changes, diagnoses, distrust_sentence
from imubayes.reporting.words import answer, sensor_groups


def test_answer_says_first_that_the_chains_have_not_converged_and_why(make_sampled) -> None:
    first, second, *_ = answer(make_sampled(converged=False))
    assert first.startswith("ACC-07: the chains have not converged (b2 has R-hat 1.83).")
    assert "5 of 20 terms are needed" in second


@pytest.mark.parametrize(
    ("given", "remedy"), [("budget", "a larger --budget"), ("accuracy", "a longer --time-limit")]
)
def test_chains_of_a_rung_cannot_be_resumed_and_nobody_is_told_to(make_sampled, given, remedy) -> None:
    told = Choice("raw", "so much", 4.0, 9.0, (), None, 0.0, (0.0, 0.0), "the top")
    sensor = replace(make_sampled(converged=False), choice=replace(told, **{given: 1.0}))
    first = answer(sensor)[0]
    assert remedy in first
    assert "--resume" not in first
    assert "--resume" in answer(replace(sensor, choice=None))[0]


def test_answer_states_the_method_and_why_in_its_second_sentence(make_sampled) -> None:
    _, second, *_ = answer(make_sampled())
    assert second == "Posterior: collapsed chains, because the noise is estimated from the runs themselves."


def test_exact_posterior_without_a_reason_says_nothing_of_methods(make_sensor) -> None:
    assert not any("Posterior" in sentence for sentence in answer(make_sensor()))


def test_dwells_that_are_not_trusted_are_counted_by_run(make_sampled) -> None:
    sensor = make_sampled()
    assert distrust_sentence(sensor).startswith("2 dwells are not trusted (1 in tumble, 1 in centrifuge)")
    one = replace(sensor, distrusted=sensor.distrusted[:1])
    assert distrust_sentence(one).startswith("1 dwell is not trusted (1 in tumble)")
    many = tuple(replace(sensor.distrusted[0], run=f"r{k}") for k in range(9))
    assert "9 dwells" in distrust_sentence(replace(sensor, distrusted=many))
    assert "and elsewhere" in distrust_sentence(replace(sensor, distrusted=many))


def test_diagnostics_name_the_worst_parameter_as_it_is_said(make_sampled) -> None:
    values = {line.name: line.value for line in diagnoses(make_sampled(), make_sampled().chains)}
    assert values["smallest effective sample size"] == "1,240 (K of centrifuge)"
    assert values["log evidence by bridge sampling"] == "8120.40 ± 0.05"
    stuck = make_sampled(converged=False)
    values = {line.name: line.value for line in diagnoses(stuck, stuck.chains)}
    assert values["largest R-hat"] == "1.830 (b2)"


@pytest.mark.parametrize("sampled", [True, False])
def test_bridge_is_held_against_the_exact_evidence_only_where_they_mean_the_same(make_sampled, sampled):
    sensor = make_sampled()
    found = sensor.chains.diagnostics
    if not sampled:
        count = len(sensor.chains.names)
        found = replace(
            found,
            parameters=found.parameters[:count],
            ess=found.ess[:count],
            rhat=found.rhat[:count],
            tau=found.tau[:count],
        )
    (exact,) = [
        line
        for line in diagnoses(sensor, replace(sensor.chains, diagnostics=found))
        if line.name == "log evidence, exact"
    ]
    assert ("noise's prior costs" in exact.meaning) == sampled and ("must agree" in exact.meaning) != sampled


def test_largest_changes_of_inclusion_come_first_and_small_ones_have_no_row(make_sampled) -> None:
    sentence, rows = changes(make_sampled())
    assert "by more than 0.080 (b0p); none crosses 0.05, 0.5 or 0.95." in sentence
    assert [(row.term, round(row.plug_in, 3), row.averaged) for row in rows] == [("b0p", 0.23, 0.31)]


def test_change_across_a_verdict_s_line_is_named(make_sampled) -> None:
    sensor = make_sampled()
    plug_in = (*sensor.selection.plug_in[:4], 0.62, *sensor.selection.plug_in[5:])
    sentence, _ = changes(replace(sensor, selection=replace(sensor.selection, plug_in=plug_in)))
    assert "b0p crosses 0.05, 0.5 or 0.95." in sentence


def test_inclusion_that_was_not_averaged_has_no_changes(make_sensor) -> None:
    assert changes(make_sensor()) == ("", ())


def grouped(sensor, *names: str) -> str:
    group = Confounded(names, (1.0,) * len(names), 0.9, True, "", "another mount")
    return sensor_groups(sensor, (group,))[0]


def test_group_with_an_error_of_the_test_bench_is_said_in_words(make_sampled) -> None:
    text = grouped(make_sampled(), "b1", "gravity")
    assert text.startswith("b1 (K1) and the error of local gravity appear only in one combination")


def test_many_errors_of_one_kind_are_counted(make_sampled) -> None:
    sensor = make_sampled()
    fixture = sensor.extras[1]
    mounts = tuple(
        replace(fixture, extra=replace(fixture.extra, name=f"fixture_j.tumble.{k}")) for k in range(5)
    )
    names = [entry.extra.name for entry in mounts]
    text = grouped(replace(sensor, extras=mounts), "m_j", "m_k", *names)
    assert text.startswith("m_j, m_k and 5 errors of the test bench (fixture) appear")
