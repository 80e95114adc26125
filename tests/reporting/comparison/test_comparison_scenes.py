"""A scene of several results side by side."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from published_found import FILE, a_term
from scenes_found import a_relevance

from imubayes.reporting.comparison.kinds import comparison_json
from imubayes.reporting.comparison.pulls import QUANTILE
from imubayes.reporting.comparison.result_files import ComponentFile, ResultFile, sensors_of
from imubayes.reporting.comparison.results import compared
from imubayes.reporting.comparison.results_page import comparison_record
from imubayes.reporting.result.file import written
from imubayes.reporting.results import result_json
from imubayes.reporting.scene_views import published_scene


@pytest.fixture
def read(make_study, make_sensor, tmp_path):
    """Read back a result of one sensor in the scenes that are given."""

    def write(*scenes, seed=1):
        study = replace(make_study(make_sensor("A")), scenes=tuple(("A", one) for one in scenes))
        study = replace(study, study=replace(study.study, seed=seed))
        file = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
        file.write_text(result_json(study))
        return sensors_of(written(file))

    return write


def _moved(name, low, half, high, *, kept=True):
    """The made-up scene with another share of one term, and another model."""
    found = a_relevance()
    terms = tuple(
        replace(t, share=(low, half, high), kept=kept) if t.name == name else t for t in found.terms
    )
    return replace(found, terms=terms, model=tuple(t.name for t in terms if t.kept))


def test_scene_is_read_as_it_was_written(read):
    assert read(a_relevance()).scenes == (published_scene(a_relevance(), "A"),)


def test_shares_differ_by_the_error_over_its_sd(read):
    (component,) = compared([read(a_relevance()), read(_moved("b2", 1.2, 1.3, 1.4))]).components
    (scene,) = component.scenes
    (b2,) = [term for term in scene.terms if term.name == "b2"]
    sd = 100.0 * (0.4 - 0.2) / (2.0 * QUANTILE)
    assert b2.pull.size == pytest.approx(100.0 / (2.0**0.5 * sd), rel=1e-12) and b2.pull.beyond
    assert not any(term.pull.beyond for term in scene.terms if term.pull and term.name != "b2")


def test_budget_that_was_changed_is_no_difference_by_itself(read):
    found = a_relevance()
    halved = tuple(replace(t, share=tuple(2.0 * share for share in t.share)) for t in found.terms)
    half = replace(found, budget=replace(found.budget, limit=50.0), terms=halved)
    (component,) = compared([read(found), read(half)]).components
    sizes = [term.pull.size for term in component.scenes[0].terms if term.pull]
    assert sizes == pytest.approx([0.0] * len(sizes), abs=1e-12) and len(sizes) == 4  # b3 has no interval


def test_scenes_are_matched_by_name_and_by_what_is_budgeted(read):
    found = a_relevance()
    other = replace(found, scene="marine")
    turned = replace(found, budget=replace(found.budget, quantity="attitude"))
    (component,) = compared([read(found, other), read(turned, other, found)]).components
    assert [(one.name, one.quantity) for one in component.scenes] == [
        ("quadrotor", "position"),
        ("marine", "position"),
    ]


def test_threshold_counts_the_shares_of_a_scene(read):
    bare, seen = ([read(*scenes), read(*scenes)] for scenes in ((), (a_relevance(),)))
    assert compared(seen).tests == compared(bare).tests + 4


def _component(id):
    return ComponentFile(id, "gyroscope", "", {"b0": a_term("b0", 1.0, 1.0, unit="rad/s")}, {}, ())


def test_result_without_scenes_is_compared_as_before():
    files = [ResultFile(FILE, (_component("G"),)) for _ in range(2)]
    assert compared(files).components[0].scenes == ()


def test_numbers_say_what_a_scene_requires_in_one_result_only(read):
    found = compared([read(a_relevance()), read(_moved("b2", 0.0, 0.01, 0.02, kept=False), seed=2)])
    (scene,) = json.loads(comparison_json(comparison_record(found)))["components"][0]["scenes"]
    assert [term["name"] for term in scene["terms"] if term["required_differs"]] == ["b2"]
    assert scene["models"] == [["b0", "b2"], ["b0"]]
