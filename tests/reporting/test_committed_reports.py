"""Every committed report is that of its own result: its numbers, its answers, its verdicts."""

import json
from pathlib import Path

import pytest
from grounds import Grounds, explained
from page_reading import plain, sentences, tree
from report_answers import wrong_lots, wrong_sensors

REPORTS = Path(__file__).parents[2] / "reports"
NAMES = sorted(page.parent.name for page in REPORTS.glob("*/report.html"))


def _read(name: str) -> tuple[str, dict]:
    html, result = (
        (REPORTS / name / file).read_text(encoding="utf-8") for file in ("report.html", "result.json")
    )
    return html, json.loads(result)


def other(said: str) -> str:
    """The same number with five more in its last digit that is not zero."""
    k = max((i for i, digit in enumerate(said) if digit in "123456789"), default=said.find("0"))
    return f"{said[:k]}{(int(said[k]) + 5) % 10}{said[k + 1 :]}"


@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_a_committed_report_are_those_of_its_result(name):
    """What its result does not have is derived, or says how to read the page; of other numbers it has few."""
    html, result = _read(name)
    grounds = Grounds(result)
    right = explained(html, grounds)
    assert right > 0.6
    assert explained(html, grounds, other) < right - 0.15
    if "fleet" in result:  # whose units are in its dataset
        return
    parts = {page for page in (REPORTS / name).glob("*.html") if page.name != "report.html"}
    assert all(explained(page.read_text(encoding="utf-8"), grounds) > 0.6 for page in parts)


@pytest.mark.parametrize("name", NAMES)
def test_answers_of_a_committed_report_are_those_of_its_result_and_of_the_verdicts_in_it(name):
    html, result = _read(name)
    blocks = sentences(tree(html))
    page = " ".join(block.text for block in blocks)
    assert [said for said in result.get("answer", ()) if plain(said) not in page] == []
    assert [*wrong_sensors(blocks, result)] == [] if "sensors" in result else True
    assert [*wrong_lots(result)] == [] if "lots" in result else True


def test_page_that_is_told_other_verdicts_is_found():
    html, result = _read("quickstart")
    blocks = sentences(tree(html))
    result["sensors"][0]["terms"][3]["verdict"] = "needed"
    assert len([*wrong_sensors(blocks, result)]) == 4


def test_answer_that_a_result_gives_against_its_units_is_found():
    result = _read("basic_vs_generalized")[1]
    one = result["lots"]["classes"][0]
    one["not_needed"], one["needed"] = one["needed"], one["not_needed"]
    result["scenes"][0]["model"] = ["b0", *result["scenes"][0]["model"]]
    assert len([*wrong_lots(result)]) == 3
