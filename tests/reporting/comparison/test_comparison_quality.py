"""Results on how good the decision is, side by side."""

from __future__ import annotations

import json
import math
from statistics import NormalDist

import pytest
from rich.console import Console

from imubayes.errors import DataError, InputError
from imubayes.quality.questions import Interval
from imubayes.reporting.comparison.kinds import comparison_json, side_by_side
from imubayes.reporting.comparison.quality import quality_compared, quality_of
from imubayes.reporting.comparison.result_files import written
from imubayes.reporting.html import page_html
from imubayes.reporting.results import result_json
from imubayes.reporting.terminal import terminal_page


def _score(method, cost):
    rate = {"value": 0.1, "low": 0.08, "high": 0.12}
    rows = dict.fromkeys(("false_keeps", "brier", "log"), rate)
    return rows | {
        "method": method,
        "false_drops": [rate, rate],
        "cost": {"value": cost, "low": cost - 0.2, "high": cost + 0.2},
    }


def _result(cost=1.0, *, treatment="as modelled", methods=("decision", "bic"), kind=""):
    told = {"treatment": treatment, "kind": kind, "methods": [_score(name, cost) for name in methods]}
    return {
        "imubayes": "1",
        "study": "<b>good</b>?",
        "scores": [told, told | {"kind": "gyroscope", "methods": []}],
    }


@pytest.fixture
def write(tmp_path):
    def write(raw):
        file = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
        file.write_text(json.dumps(raw))
        return file

    return write


def test_scores_differ_over_the_sds_of_their_intervals(write):
    files = [quality_of(written(write(_result(cost)))) for cost in (1.0, 3.0)]
    assert files[0].scores["as modelled", "bic"][2] == Interval(1.0, 0.8, 1.2)
    found = quality_compared(files)
    (decision, _) = found.treatments["as modelled"]
    sd = 0.2 / NormalDist().inv_cdf(0.975)
    assert decision.pulls[2].size == pytest.approx(2.0 / (math.sqrt(2.0) * sd), rel=1e-12)
    assert [pull.beyond for pull in decision.pulls] == [False, False, True, False, False]
    assert found.tests == 2 * 5


def test_page_terminal_and_numbers_say_which_score_differs(write):
    shown = side_by_side([write(_result()), write(_result(3.0, methods=("decision", "aic")))])
    console = Console(width=80)
    with console.capture() as capture:
        console.print(terminal_page(shown.page))
    printed, html = capture.get(), page_html(shown.page)
    assert all(len(line) <= 80 for line in printed.splitlines())
    for text in (" ".join(printed.split()), " ".join(html.split())):
        assert "1 score differs beyond uncertainty, most cost of decision, as modelled, by 13.9 sd." in text
        assert "In one result only: BIC, as modelled (A); AIC, as modelled (B)." in text
    assert "<b>good" not in html
    (treatment,) = json.loads(comparison_json(shown.record))["treatments"]
    assert treatment["methods"][0]["scores"]["cost"]["differs"] is True


def test_what_cannot_be_compared_is_refused_with_what_can(write, make_study, make_sensor):
    sensors = write(json.loads(result_json(make_study(make_sensor("A")))))
    with pytest.raises(
        InputError, match=r"is of a study of sensors; .* is of a study of the decision's quality: expected"
    ):
        side_by_side([sensors, write(_result())])
    with pytest.raises(InputError, match="no treatment and method in common"):
        side_by_side([write(_result()), write(_result(treatment="another"))])
    broken = _result()
    del broken["scores"][0]["methods"][0]["cost"]
    with pytest.raises(DataError, match="'cost' is missing"):
        side_by_side([write(broken), write(_result())])
    with pytest.raises(DataError, match="no sensors, classes or scores"):
        side_by_side([write({"imubayes": "1", "components": []}), write(_result())])
