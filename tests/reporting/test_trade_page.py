import io
import json
import re

import numpy as np
import pytest
from rich.console import Console
from tool_readings import wrong_trade
from trades import measured, told, trade

from imubayes.inference.intervals import frequency
from imubayes.ladder.trade.machine import Machine
from imubayes.ladder.trade.measure import standing_of
from imubayes.ladder.trade.recommend import front, recommended
from imubayes.ladder.trade.record import Traded, places
from imubayes.ladder.trade.score import Rate, Score
from imubayes.reporting.html import page_html
from imubayes.reporting.trade_page import terminal_trade, trade_json, trade_page, write_trade
from imubayes.reporting.trade_words import trade_answer

RUNGS = ("means", "plug-in", "collapsed", "raw")
NOTHING = Rate(0, 40, frequency(0, 40))


def _score(rung, held):
    return Score(rung, 20, Rate(held, 200, frequency(held, 200)), 1.0, NOTHING, NOTHING, NOTHING, 0.0, 1.5)


def _traded(held=180):
    each = [
        measured(told("means", mean=np.array([1.1, 0.0, 0.0]), inclusion=np.array([1.0, 0.5, 0.4])), 0.02),
        measured(told("plug-in", mean=np.array([1.005, 0.0, 0.0])), 0.3),
        measured(told("collapsed", monte_carlo=np.full(3, 0.02), ess=2000.0), 5.0),
        measured(told("raw", monte_carlo=np.full(3, 0.03), ess=400.0, wanting=2.5, chain_seconds=40.0), 50.0),
    ]
    one = trade(rungs=RUNGS, missions=())
    standing = standing_of("<ACC>", each, {}, [("averaged", "it takes about 90 s, and 20 s were left")])
    found = places([standing], RUNGS)
    scores = (_score("means", 100), _score("plug-in", held), _score("collapsed", held))
    return Traded(
        trade=one,
        standings=(standing,),
        places=found,
        best=standing.best,
        floor=standing.floor,
        front=front(found, standing.floor[0]),
        recommended=recommended(found, scores, standing.best, standing.floor[0]),
        scores=scores,
        dear=("raw",),
        machine=Machine("A processor", "System 1", 2, {"linear algebra": 1}, 0.1, {"numpy": "2.0"}),
        seconds=70.0,
    )


@pytest.fixture(scope="module")
def found():
    return _traded()


def test_the_answer_names_the_recommended_rung_with_its_reasons(found):
    told_words = " ".join(trade_answer(found))
    assert found.recommended == "collapsed"
    assert trade_answer(found)[0].startswith("Take collapsed")
    # the mean of 1.1 is ten of the best's sds off, that of 1.005 half of one
    assert "means (20 ms): a coefficient is off by 10 posterior sd" in told_words
    assert "plug-in (0.3 s): a coefficient is off by 0.5 posterior sd" in told_words
    # 50 s, and 1.5 times 40 s more: from 20 ms to 110 s are 3.7 decades
    assert "3.7 decades" in told_words
    assert "about 110 s" in told_words
    assert "That is what a run takes without being asked" in told_words
    assert "averaged was left out" in told_words


def test_intervals_that_are_too_short_rule_rungs_out():
    found = _traded(held=120)
    assert found.recommended == "raw"  # it answered no repeat, and nothing is known against it
    assert "too short: means, plug-in, collapsed" in page_html(trade_page(found))


def test_the_page_is_whole_and_names_are_escaped(found, tmp_path):
    page = page_html(trade_page(found))
    assert "<b>small" not in page
    assert "&lt;ACC&gt;" in page
    assert len(re.findall(r"<figure", page)) == 4
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert [file.name for file in write_trade(found, tmp_path)] == ["report.html", "result.json"]


def test_numbers_of_the_file_are_those_that_were_measured(found):
    values = json.loads(trade_json(found))
    assert values["recommended"] == found.recommended
    assert [one["seconds"] for one in values["rungs"]] == [0.02, 0.3, 5.0, 50.0]
    assert values["front"] == list(found.front)
    terms = values["components"][0]["rungs"][0]["terms"]
    assert terms[0] == {
        "name": "b0", "mean": 1.1, "full_mean": 1.0, "full_sd": 0.01, "inclusion": 1.0, "verdict": "needed",
    }  # fmt: skip
    # what never happened, or no chain has, is null and not NaN
    assert values["components"][0]["rungs"][0]["ess"] is None


def test_the_table_fits_a_console_of_eighty_columns(found):
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal_trade(found))
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].split()[:5] == ["rung", "time", "memory", "off", "rms"]
    assert lines[4].split()[:2] == ["raw", "~110"]


def test_every_number_of_the_page_is_one_of_the_result(found):
    assert wrong_trade(page_html(trade_page(found)), json.loads(trade_json(found))) == []
