from __future__ import annotations

import re
from dataclasses import replace

from page_reading import printed, study_lines
from results_found import sensor_result, study_result

from imubayes.reporting import figures
from imubayes.reporting.document import report_html
from imubayes.sensors.terms import library


def test_what_is_one_is_in_the_singular() -> None:
    lib = replace(library("accelerometer", powers=1), terms=library("accelerometer", powers=1).terms[:1])
    one = sensor_result(lib=lib, runs=("tumble",))
    told = printed(study_lines(study_result(one))) + report_html(study_result(one))
    told += figures.model_size(one, "k").title + figures.inclusion(one, "k").title
    assert "1 run" in told and "1 term" in told
    assert not re.findall(r"(?<![\d.,^])1 (?:terms|runs|models|samples|blocks|digits|units)\b", told)
