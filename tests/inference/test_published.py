"""Tables of published figures in the studies' appendices: they hold what the committed results say."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import pytest

from studies.published import ROOT, csv_text, imu_tk_rows, imucal_rows

ROWS = {"imu_tk_xsens": imu_tk_rows, "imucal_ferraris": imucal_rows}
WRITE = os.environ.get("IMUBAYES_TABLES")
"""Folder that the tables are written to; none where they are only looked at."""


@pytest.fixture(scope="module", params=ROWS)
def table(request, recordings):
    """Name of a study, and its table made anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IMUBAYES_DATA", str(recordings))
        rows = list(ROWS[request.param]())
    if WRITE:
        (Path(WRITE) / f"{request.param}.csv").write_text(csv_text(rows), encoding="utf-8")
    return request.param, rows


def test_the_appendix_of_a_study_holds_its_result(table):
    study, rows = table
    text = (ROOT / "studies" / f"{study}.csv").read_text(encoding="utf-8")
    assert [tuple(row) for row in csv.reader(text.splitlines())][1:] == rows


def test_published_figures_are_met_within_error_bars_but_for_what_the_study_says(table):
    """imu_tk leaves g-sensitivity out, which moves its gyroscopes' scale factors by a part in a thousand."""
    study, rows = table
    for figure, component, *_, pull in rows:
        told = study == "imu_tk_xsens" and figure == "scale" and component.startswith("g")
        assert abs(float(pull)) < (5.0 if told else 3.0), (figure, component)
