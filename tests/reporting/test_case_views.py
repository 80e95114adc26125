"""Cases in the report: known quantities in numbers and words, and what a kind of component needs."""

import math

import numpy as np
import pytest
from block_readings import rows
from results_found import MG, cased, recovered

from imubayes.reporting.case_views import CANNOT, KNOWN, case_section, pooled_verdict
from imubayes.reporting.results import published_result
from imubayes.selection.verdicts import EQUAL, UNSEEN


@pytest.mark.parametrize(("what", "width"), [("gravity", 1), ("rest", 3), ("closure", 2), ("turn", 1)])
def test_errors_are_root_mean_squares_in_the_printed_unit(what, width):
    """Of a closure the two directions make one angle; of the others each number counts."""
    one = recovered(what, width=width)
    study = cased(one)
    row = rows([case_section("U0", "case1", study.sensors, EQUAL)])[0]
    unit = {"mg": MG, "deg/s": math.pi / 180.0, "deg": math.pi / 180.0}[KNOWN[what].printed]
    squares = np.sum(one.after**2) / (30 if what == "closure" else 30 * width)
    assert float(row[4].replace(" ×10⁻", "e-")) == pytest.approx(math.sqrt(squares) / unit, rel=0.05)
    (record,) = published_result(study)["cases"][0]["recovered"]
    assert record["rms"]["after"] == pytest.approx(math.sqrt(squares), rel=1e-12)
    assert (record["within_2_sd"], record["of"]) == (one.inside, 30 * width)
    assert row[-1] == f"{one.inside} of {30 * width}"


@pytest.mark.parametrize("inclusion", [0.0, 0.3, 0.9, 1.0])
def test_what_no_component_can_tell_is_not_told_by_all_and_no_answer_is_against_each(inclusion):
    assert pooled_verdict(inclusion, UNSEEN) == CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "undecided"), EQUAL) != CANNOT
    assert pooled_verdict(inclusion, (*UNSEEN, "not needed", "not needed")) != "needed"
    assert pooled_verdict(inclusion, (*UNSEEN, "needed", "undecided")) != "not needed"
