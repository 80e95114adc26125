import re
from dataclasses import replace

import pytest
from lots_found import SIZES, lot_result
from rich.console import Console

from imubayes.reporting.html import page_html
from imubayes.reporting.lots_page import lots_page, terminal_lots, write_lots


@pytest.fixture(scope="module")
def result():
    return lot_result()


@pytest.fixture(scope="module")
def html(result):
    return page_html(lots_page(result))


def _printed(result):
    console = Console(width=80)
    with console.capture() as capture:
        console.print(terminal_lots(result))
    return capture.get().splitlines()


def test_every_cell_of_the_first_matrix_leads_to_the_row_of_its_numbers(html, result):
    matrix = html[html.index('<svg id="needed-matrix"') :].partition("</svg>")[0]
    cells = [f"class-{name}-{term}" for term in result.study.library.names for name in SIZES]
    assert re.findall(r'href="#([^"]+)"', matrix) == cells
    assert all(f'<tr id="{cell}">' in html for cell in cells)


def test_index_over_classes_comes_first_and_a_page_a_class_after_it(html):
    places = [html.index("<nav"), html.index('id="needed-matrix"'), html.index('id="scene-helicopter"')]
    places += [html.index(f'<h2 id="class-{name}"') for name in SIZES]
    assert places == sorted(places)
    assert html.count('<section class="sheet">') == len(SIZES)


def test_triad_is_only_spoken_of_where_it_was_asked(html):
    assert '<h2 id="basic">' in html
    assert "triad" not in page_html(lots_page(lot_result(basic=False)))


def test_coverage_of_means_and_of_spreads_stand_apart_with_their_counts(html, result):
    table = html[html.index('<tr id="check-precision">') :].partition("</table>")[0]
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", table)
    assert cells[4:] == ["27 of 33 held", "82\xa0% (69 to 91)", "30 of 33 held", "91\xa0% (81 to 97)"]
    printed = [" ".join(line.split()) for line in _printed(result)[-2:]]
    assert printed == [
        "population mean 27 of 33 held 82 % (69 to 91)",
        "population spread 30 of 33 held 91 % (81 to 97)",
    ]


def test_study_without_scenes_has_its_classes_only(result):
    bare = [replace(one, missions=()) for one in result.classes]
    found = replace(result, study=replace(result.study, missions=()), classes=tuple(bare))
    assert 'id="scenes"' not in page_html(lots_page(found))
    assert '<h2 id="class-mems_tactical">' in page_html(lots_page(found))


def test_two_files_are_written_and_the_terminal_has_a_line_a_class(result, tmp_path):
    assert [file.name for file in write_lots(result, tmp_path)] == ["report.html", "result.json"]
    lines = _printed(result)
    assert [line.split("  ")[0] for line in lines[-9:-6]] == [
        "consumer MEMS",
        "tactical MEMS",
        "navigation FOG",
    ]
    assert all(len(line) <= 80 for line in lines[-4:])
