"""How the posterior was found, in words and tables: rung, chains, test bench, uncertain noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from block_readings import rows, said

from imubayes.campaign.fidelity import NEEDS_ROWS, Choice
from imubayes.inference.observability import Confounded
from imubayes.reporting.chain_views import (
    MOST_BENCH,
    bench_sections,
    chain_sections,
    change_sections,
    choice_sentences,
    diagnoses,
    distrust_sentence,
    own_errors,
    published_choice,
)
from imubayes.reporting.words import answer, sensor_groups

CHEAP = Choice(
    "sparse", "a budget of 1 s", 0.4, 0.5, (), "plug-in", 0.9, (0.1, 0.3), "neighbours", budget=1.0
)
CLIMBED = Choice(
    "raw",
    "an accuracy of 0.1 posterior sd",
    4.0,
    9.0,
    (("means", 0.0, 0.0), ("full", 0.2, 0.1), ("raw", 0.05, 0.01)),
    None,
    0.0,
    (0.0, 0.0),
    "there is no better rung",
    accuracy=0.1,
)


@pytest.mark.parametrize(
    ("choice", "words", "met"),
    [
        (CHEAP, "the best that fits a budget of 1 s (0.4 s)", True),
        (
            replace(CHEAP, foreseen=2.0, seconds=1.2),
            "the cheapest: none fits a budget of 1 s (it took 1.2 s)",
            False,
        ),
        (replace(CHEAP, seconds=1.6), "foreseen to fit a budget of 1 s; it took longer, 1.6 s", False),
        (CLIMBED, "reached an accuracy of 0.1 posterior sd (4 s)", True),
        (
            replace(CLIMBED, accuracy=0.01),
            "the last that there is: an accuracy of 0.1 posterior sd was not reached (4 s)",
            False,
        ),
        (replace(CHEAP, budget=None), "as asked (0.4 s)", True),
    ],
)
def test_what_was_asked_for_is_claimed_only_where_it_came_true(choice, words, met):
    assert words in choice_sentences(choice)[0]
    record = published_choice(choice)
    assert record is not None
    assert record["met"] is met


def test_a_rung_that_is_no_choice_says_why():
    top = replace(CLIMBED, rung="full", next_reason=f"raw is no choice here: {NEEDS_ROWS}")
    (said,) = [text for text in choice_sentences(top) if text.startswith("Raw")]
    assert "a run that is read a part at a time does not hold them" in said


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


def test_dwells_that_are_not_trusted_are_counted_by_run(make_sampled) -> None:
    sensor = make_sampled()
    assert distrust_sentence(sensor).startswith("2 dwells are not trusted (1 in tumble, 1 in centrifuge)")
    one = replace(sensor, distrusted=sensor.distrusted[:1])
    assert distrust_sentence(one).startswith("1 dwell is not trusted (1 in tumble)")
    many = tuple(replace(sensor.distrusted[0], run=f"r{k}") for k in range(9))
    assert "9 dwells" in distrust_sentence(replace(sensor, distrusted=many))
    assert "and elsewhere" in distrust_sentence(replace(sensor, distrusted=many))


def test_diagnostics_name_the_worst_parameter_as_it_is_said_and_how_to_draw_the_chains(make_sampled) -> None:
    section = list(chain_sections(make_sampled()))
    values = {name: value for name, value, _ in rows(section)}
    assert values["smallest effective sample size"] == "1,240 (K of centrifuge)"
    assert values["log evidence by bridge sampling"] == "8120.40 ± 0.05"
    assert 'arviz.plot_trace(arviz.from_netcdf("posterior.nc"))' in said(section)
    values = {name: value for name, value, _ in diagnoses(make_sampled(converged=False))}
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
    told = diagnoses(replace(sensor, chains=replace(sensor.chains, diagnostics=found)))
    (meaning,) = [meaning for name, _, meaning in told if name == "log evidence, exact"]
    assert ("noise's prior costs" in meaning) == sampled and ("must agree" in meaning) != sampled


def test_largest_changes_of_inclusion_come_first_and_small_ones_have_no_row(make_sampled) -> None:
    section = list(change_sections(make_sampled()))
    assert "by more than 0.080 (b0p); none crosses 0.05, 0.5 or 0.95." in said(section)
    assert rows(section) == [("b0p", "0.230", "0.310", "+0.080")]


def test_change_across_a_verdict_s_line_is_named(make_sampled) -> None:
    sensor = make_sampled()
    plug_in = (*sensor.selection.plug_in[:4], 0.62, *sensor.selection.plug_in[5:])
    sensor = replace(sensor, selection=replace(sensor.selection, plug_in=plug_in))
    assert "b0p crosses 0.05, 0.5 or 0.95." in said(change_sections(sensor))


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


def test_errors_of_the_test_bench_are_in_printed_units_without_the_dwells(make_sampled) -> None:
    found = rows(bench_sections(make_sampled()))
    assert [row[0] for row in found] == [
        "error of local gravity",
        "rotation of the fixture about j, mount 1",
        "rotation of the fixture about j, mount 2",
    ]
    # 0.3 and 0.98 of a prior sd of 50 ug
    assert found[0][1:] == ("± 50", "15 ± 49", "µg", "K1")


def test_of_many_errors_those_that_the_test_narrows_most_are_listed_in_their_order(make_sampled) -> None:
    sensor = make_sampled()
    fixture = sensor.extras[1]
    many = tuple(
        replace(
            fixture,
            extra=replace(fixture.extra, name=f"fixture_j.tumble.{k}", text=f"mount {k}"),
            sd=fixture.extra.sd * (1.0 if k % 2 else 0.5),
        )
        for k in range(2 * MOST_BENCH)
    )
    found = list(bench_sections(replace(sensor, extras=many)))
    assert [row[0] for row in rows(found)] == [f"mount {k}" for k in range(0, 2 * MOST_BENCH, 2)]
    assert f"{MOST_BENCH} more, of which the test says less" in said(found)


def test_exact_component_has_no_chains(make_sensor) -> None:
    sensor = make_sensor()
    assert not [*chain_sections(sensor), *bench_sections(sensor), *change_sections(sensor)]


@pytest.mark.parametrize(("id", "listed"), [("imu.ay", ["gravity", "tilt_j.ay"]), ("alone", None)])
def test_a_component_lists_the_bench_and_its_own_errors(id, listed):
    names = ["gravity", "tilt_j.ax", "tilt_j.ay", "turn_on.log.gz"]
    extras = [SimpleNamespace(extra=SimpleNamespace(name=name)) for name in names]
    found = own_errors(SimpleNamespace(id=id, extras=extras))
    assert [entry.extra.name for entry in found] == (listed or names)
