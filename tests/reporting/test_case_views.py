"""Cases in the report: known quantities in numbers and words, and what a kind of component needs."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from block_readings import rows, said
from page_reading import report_html
from results_found import sensor_result, study_result
from scipy import stats

from imubayes.inference.known_quantities import Recovered
from imubayes.reporting.case_views import (
    CANNOT,
    KNOWN,
    angle_sections,
    case_answer,
    case_section,
    cases_of,
    cases_section,
    pooled_verdict,
)
from imubayes.reporting.results import published_result
from imubayes.selection.verdicts import EQUAL, UNSEEN

MG = 9.80665e-3


def recovered(what="gravity", *, count=30, width=1, fitted=0.1 * MG, fresh=0.2 * MG, seed=1):
    rng = np.random.default_rng(seed)
    shape = (count, width)
    after = fitted * rng.normal(size=shape)
    sds = (np.full(shape, fitted), np.full(shape, fresh))
    return Recovered("hand", what, 100.0 * MG + after, after, 1.5 * after, *sds)


@pytest.fixture
def cased():
    """Three accelerometers of one case, with what is pooled and recovered of them, and k cases of them."""

    def of(*found, cases=1):
        pooled = {"b0": 1.0, "b0p": 0.97, "b3": 0.01, "c_jk": 0.86}
        sensors = [
            replace(sensor_result(f"U{k}.a{axis}"), pooled=pooled, recovered=found)
            for k in range(cases)
            for axis in "xyz"
        ]
        return study_result(*sensors)

    return of


def answered(study):
    """First paragraph on the first case."""
    return case_answer("U0", cases_of(study)["U0"], EQUAL)


def shown(study):
    """Section of the first case."""
    return [case_section("U0", "case1", cases_of(study)["U0"], EQUAL)]


def test_a_case_names_what_one_of_its_components_needs_beyond_the_others(cased):
    study = cased(recovered())
    first, *others = study.sensors
    terms = first.selection.terms
    more = tuple(replace(term, verdict="needed") if term.name == "b3" else term for term in terms)
    first = replace(first, selection=replace(first.selection, terms=more))
    assert answered(replace(study, sensors=(first, *others)))[0].endswith(
        "; ax needs also b1, b2, b3, m_j and m_k; ay and az need also b1, b2, m_j and m_k."
    )


@pytest.mark.parametrize(("what", "width"), [("gravity", 1), ("rest", 3), ("closure", 2), ("turn", 1)])
def test_errors_are_root_mean_squares_in_the_printed_unit(cased, what, width):
    """Of a closure the two directions make one angle; of the others each number counts."""
    one = recovered(what, width=width)
    study = cased(one)
    row = rows(shown(study))[0]
    unit = {"mg": MG, "deg/s": math.pi / 180.0, "deg": math.pi / 180.0}[KNOWN[what].printed]
    squares = np.sum(one.after**2) / (30 if what == "closure" else 30 * width)
    assert float(row[4].replace(" ×10⁻", "e-")) == pytest.approx(math.sqrt(squares) / unit, rel=0.05)
    (record,) = published_result(study)["cases"][0]["recovered"]
    assert record["rms"]["after"] == pytest.approx(math.sqrt(squares), rel=1e-12)
    assert (record["within_2_sd"], record["of"]) == (one.inside, 30 * width)
    assert row[-1] == f"{one.inside} of {30 * width}"


def test_a_kind_needs_what_its_components_show_together(cased):
    study = cased(recovered())
    verdicts = {row[0]: row[-1][2:] for row in rows(shown(study))[1:]}
    # alone b0p is undecided, and of c_jk no component's test can tell
    assert verdicts == {"b0": "needed", "b0p": "needed", "b3": "not needed", "c_jk": CANNOT}
    assert "Not every accelerometer shows b0p by itself" in said(shown(study))
    assert answered(study)[0] == (
        "U0 as a whole: its accelerometers need b0 and b0p; ax, ay and az need also b1, b2, m_j and m_k."
    )


@pytest.mark.parametrize("inclusion", [0.0, 0.3, 0.9, 1.0])
def test_what_no_component_can_tell_is_not_told_by_all_and_no_answer_is_against_each(inclusion):
    assert pooled_verdict(inclusion, UNSEEN) == CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "undecided"), EQUAL) != CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "not needed", "not needed")) != "needed"
    assert pooled_verdict(inclusion, (*UNSEEN, "needed", "undecided")) != "not needed"


@pytest.mark.parametrize(
    ("scale", "word"), [(2.0, "larger than predicted"), (0.5, "smaller than predicted"), (1.0, "as many as")]
)
def test_many_cases_say_whether_their_errors_are_as_large_as_predicted(cased, scale, word):
    one = recovered()
    sd = np.full_like(one.after, 1e-3)
    normal = stats.norm.ppf((np.arange(one.after.size) + 0.5) / one.after.size).reshape(one.after.shape)
    found = replace(one, after=scale * 1e-3 * normal, fitted=sd, fresh=2.0 * sd)
    study = cased(found, cases=6)
    sentence = said([cases_section(cases_of(study))])
    assert word in sentence and f"{6 * found.inside} of {6 * found.after.size} lie" in sentence
    records = [entry for case in published_result(study)["cases"] for entry in case["recovered"]]
    assert sum(entry["within_2_sd"] for entry in records) == 6 * found.inside
    assert word in report_html(study)


def angled(misalignment):
    """Component of a case whose misalignment against it is known so well, in rad, and its angles."""
    of = ("accelerometer", "accelerometer", "gyroscopes against accelerometers")
    names = ("rotation_x", "nonorthogonality_xy", "rotation_x")
    sizes = ((1.234e-4, 1.6e-4), (-4.7895e-4, 1.61e-5), (1e-6, 2e-6))
    angles = [
        {"name": name, "of": what, "mean": mean, "sd": sd}
        for name, what, (mean, sd) in zip(names, of, sizes, strict=True)
    ]
    selection = SimpleNamespace(terms=[SimpleNamespace(name="m_j", full_sd=misalignment)])
    return SimpleNamespace(kind="accelerometer", selection=selection, calibration={"angles": angles})


@pytest.mark.parametrize(
    ("misalignment", "told"),
    [
        (1.65e-4, "how the case as a whole lay in its fixture is known no better"),
        (1.1e-5, "is known about as well"),
    ],
)
def test_angles_are_rounded_by_their_own_sd_and_the_sentence_says_whether_a_rotation_is_hidden(
    misalignment, told
):
    section = list(angle_sections("U0", [angled(misalignment)]))
    assert rows(section) == [
        ("rotation about x", "120 ± 160", "1.0 ± 2.0"),
        ("non-orthogonality of x and y", "−479 ± 16", ""),
    ]
    assert told in said(section) and "are known to 16 µrad" in said(section)
