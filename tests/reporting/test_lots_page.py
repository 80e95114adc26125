import struct
from dataclasses import replace

import pytest
from lots_found import counted, lot_result

from imubayes.inference import Share
from imubayes.reporting.blocks import write_page
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.reporting.lots_sentences import lots_answer, own_scene_sentences
from imubayes.reporting.lots_words import in_scene, of_budget, ranged_in, share_in


def test_slide_is_beside_the_report_16_to_9_with_its_answer(tmp_path):
    found = lot_result()
    paths = write_page(lots_page(found), lots_json(found), tmp_path)
    files = {path.name: path.read_bytes() for path in paths}
    assert list(files) == ["report.html", "result.json", "slide.svg", "slide.png"]
    assert struct.unpack(">II", files["slide.png"][16:24]) == (2200, 1238)
    assert b"consumer MEMS and tactical MEMS need g_i" in files["slide.svg"]
    assert len(files["slide.png"]) < 300_000


@pytest.fixture(scope="module")
def result():
    return lot_result()


def test_every_sentence_of_the_answer_has_its_numbers(result):
    anchors = [anchor for _, anchor in lots_answer(result)]
    assert anchors == ["needed-terms", "needed-terms", "scene-helicopter", "basic", "check"]
    assert len(lots_answer(lot_result(basic=False))) == 4


def test_shares_beyond_the_linear_range_are_said_to_be_what_was_flown_or_more(result):
    scene = replace(result.classes[0].missions[0], beyond=(40.0, 18.0))
    assert of_budget(17.0, scene) == "17 times the budget"
    # a share that the navigator holds for less than that is no more
    assert of_budget(39.0, scene) == "18 times the budget or more"
    assert of_budget(3e5, scene) == "18 times the budget or more"
    assert share_in(scene, 3e5) == "18 times or more"
    term = replace(scene.terms[0], share=Share(12.0, 5.0, 200.0), most_of_budget=0.5)
    assert ranged_in(scene, term) == "12 times (5.0 times to 18 times or more)"
    open_ = counted(result.classes[0], 0, 100).terms[0]
    assert ranged_in(scene, replace(term, known=open_)) == "up to 50 %"


def test_what_takes_the_budget_alone_and_is_not_needed_is_said_to_be_taken_up(result):
    one = result.classes[0]
    term = one.missions[0].terms[0]
    alone = [replace(term, required=0.25, share=Share(share, share, share)) for share in (0.9, 1.0)]
    assert [in_scene(cell) for cell in alone] == ["not needed", "not needed: taken up"]
    scene = replace(one.missions[0], terms=(alone[1], *one.missions[0].terms[1:]))
    said = " ".join(own_scene_sentences(scene))
    assert "b0 alone takes the budget or more; models do without where other terms take that up." in said
