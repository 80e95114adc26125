import re
import struct
from dataclasses import replace

import pytest
from lots_found import lot_result

from imubayes.population.lots import Against
from imubayes.reporting.blocks import MOST_WORDS, write_page
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.reporting.lots_sentences import contrasts, lots_answer
from imubayes.reporting.lots_words import headline


def test_slide_is_beside_the_report_16_to_9_with_its_answer(tmp_path):
    found = lot_result()
    paths = write_page(lots_page(found), lots_json(found), tmp_path)
    files = {path.name: path.read_bytes() for path in paths}
    assert list(files) == ["report.html", "result.json", "slide.svg", "slide.png"]
    assert struct.unpack(">II", files["slide.png"][16:24]) == (2200, 1238)
    assert b"Consumer MEMS and tactical MEMS need b0" in files["slide.svg"]
    assert len(files["slide.png"]) < 300_000


@pytest.fixture(scope="module")
def result():
    return lot_result()


def test_classes_that_need_the_same_terms_are_told_from_those_that_do_not(result):
    ((sharp, terms, text),) = contrasts(result, 0)
    assert terms == ("g_i", "g_k")
    assert text.startswith("consumer MEMS and tactical MEMS need g_i and g_k; navigation FOG does not: ")
    # the least of 1.0 and 0.3, and the 95 % point over units of the only class that does not need them
    assert sharp == pytest.approx(0.3 / 0.003)


def test_every_sentence_of_the_answer_has_its_numbers(result):
    anchors = [anchor for _, anchor in lots_answer(result)]
    assert anchors == ["needed-terms", "needed-terms", "scene-helicopter", "basic", "check"]
    assert len(lots_answer(lot_result(basic=False))) == 4


FOG_OR_MEMS = Against(("fog_navigation",), ("mems_consumer", "mems_tactical"))
MEMS_OR_FOG = Against(("mems_consumer", "mems_tactical"), ("fog_navigation",))


def _asking(result, asks):
    return replace(result, study=replace(result.study, asks=asks))


@pytest.mark.parametrize("asks", ["classes", "scenes", "triad", FOG_OR_MEMS, MEMS_OR_FOG])
def test_answer_names_terms_in_no_more_words_than_it_may_have(result, asks):
    text = headline(_asking(result, asks))[0]
    assert len(text.split()) <= MOST_WORDS
    assert any(name in re.findall(r"\w+", text) for name in result.study.library.names)
    assert text.endswith(".") and ".." not in text
