import struct

from lots_found import lot_result

from imubayes.population.needs import NEEDED, UNTOLD, terms_in
from imubayes.reporting.blocks import write_page
from imubayes.reporting.lots_figures import slide
from imubayes.reporting.lots_page import lots_json, lots_page


def test_tiles_have_the_terms_needed_in_each_scene_and_what_the_tests_cannot_tell():
    result = lot_result()
    svg = slide(result, "a").svg
    first = result.classes[0]
    count = len(terms_in(first, first.missions[0], NEEDED))
    assert count and f">{count} +1?<" in svg
    open_ = [
        set.intersection(*(set(terms_in(one, m, UNTOLD)) for m in one.missions)) for one in result.classes
    ]
    assert svg.count(">?<") == sum(map(len, open_)) + 1  # and its key
    assert "cannot tell c_jk S_ij, needed g_i g_k, would matter S_kk; tactical MEMS" in svg


def test_slide_is_beside_the_report_16_to_9_with_its_answer(tmp_path):
    found = lot_result()
    paths = write_page(lots_page(found), lots_json(found), tmp_path)
    files = {path.name: path.read_bytes() for path in paths}
    assert list(files) == ["report.html", "result.json", "slide.svg", "slide.png"]
    assert struct.unpack(">II", files["slide.png"][16:24]) == (2200, 1238)
    assert b"Consumer MEMS and tactical MEMS need b0" in files["slide.svg"]
    assert len(files["slide.png"]) < 300_000
