"""The laws of a page, over every kind of page and every committed report."""

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest
from browser import AXE, BROWSER, PAPER, WIDTHS, run, shown, told_by
from lots_found import SIZES
from page_reading import Page, numbers, printed, said, whole
from pages_made import KINDS, made
from tool_results import OF_THE_TOOL

from imubayes.reporting.blocks import Figure, Table, page_html
from imubayes.reporting.blocks import Page as Made
from imubayes.reporting.canvas import draw, rows_of

ROOT = Path(__file__).parents[2]
COMMITTED = sorted(str(file.relative_to(ROOT)) for file in ROOT.glob("reports/*/report.html"))

MOST = 2 * 2**20
"""Bytes of a page."""

LONG = 70_000
"""Bytes of a `result.json` that has no golden file."""

ATTACK = '<script>alert("x")</script>&\x1b[31m[red]$\\frac{'
"""A name as a file may have it; its dollar sign is no mathematics."""

browsed = pytest.mark.skipif(
    BROWSER is None, reason="there is no Chromium or Chrome, neither on PATH nor in playwright's cache"
)


def _html(name: str) -> str:
    if name in KINDS:
        return made(name).html
    if name in OF_THE_TOOL:
        return page_html(OF_THE_TOOL[name]())
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture(scope="module", params=[*KINDS, *OF_THE_TOOL, *COMMITTED])
def page(request) -> Page:
    """Each page in turn, read once for all laws."""
    return Page(_html(request.param))


def test_page_is_whole_and_each_link_leads_to_one_place(page):
    whole(page)


def test_no_markup_is_shown_as_words(page):
    assert re.findall(r"</?(?:code|strong|em|a|i|b|span|sub|sup)\b[^>]*>", said(page.html)) == []


@pytest.mark.parametrize("kind", [*KINDS, *OF_THE_TOOL])
def test_no_line_ends_between_a_number_and_its_percent_sign(kind):
    words = re.sub(r"<(pre|svg|script|head)\b.*?</\1>|<[^>]*>", "", _html(kind), flags=re.S)
    assert re.findall(r".{40}\d %", words) == []


def test_page_opens_offline_and_needs_no_script(page):
    assert not page.tagged("iframe", "object", "embed", "base", "image")
    assert page.tagged("script") in ([], [{}])  # enhancement: laws hold without it
    loaded = [*page.all("src"), *page.all("srcset"), *page.all("xlink:href")]
    loaded += [attributes.get("href", "") for attributes in page.tagged("link")]
    assert [one for one in loaded if not one.startswith(("data:", "#"))] == []
    sheets = re.findall(r"<style[^>]*>(.*?)</style>", page.html, re.S)
    styles = " ".join((*sheets, *page.all("style")))
    assert not re.search(r"@import|url\((?![\"']?(?:#|data:))", styles)
    assert [link for link in page.all("href") if re.match(r"(?!data:)\w*:|//", link)] == []
    assert not [name for node in page.root.iter() for name in node.attrib if name.startswith("on")]


def test_page_has_a_title_one_first_heading_and_no_level_left_out(page):
    levels = [int(node.tag[1]) for node in page.root.iter() if re.fullmatch("h[1-6]", node.tag)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(below <= above + 1 for above, below in pairwise(levels))
    assert re.search(r"<title>[^<]+</title>", page.html)
    assert [attributes.get("lang") for attributes in page.tagged("html")] == ["en"]
    assert any(attributes.get("name") == "viewport" for attributes in page.tagged("meta"))


@pytest.mark.parametrize("kind", KINDS)
def test_first_screen_answers_in_sixty_words_with_a_status_and_one_picture(kind):
    first = re.search(r'<section id="first".*?</section>', made(kind).html, re.S)[0]
    answers = re.findall(r'<p class="answer.*?</p>', first, re.S)
    assert len(answers) == 1
    assert 3 <= len(re.sub(r"<a .*?</a>|<[^>]+>", "", answers[0]).split()) <= 60
    compared = kind.startswith("compared")  # which has no numbers of its own to draw
    assert first.count("<svg") == (0 if compared else 1)
    assert compared or first.count('<p class="status"') == (kind != "trade")


def test_figures_are_told_to_those_who_cannot_see_them_and_pages_are_small(page):
    figures = [attributes for attributes in page.tagged("svg") if "aria-hidden" not in attributes]
    assert figures or "<table" in page.html
    assert all(one.get("role") == "img" and one.get("aria-label") for one in figures)
    assert len(page.html.encode()) < MOST


@pytest.mark.parametrize("kind", KINDS)
def test_names_that_come_from_files_are_escaped(kind):
    page = made(kind, ATTACK)
    assert page.html.count("<script") == 1 and 'alert("' not in page.html
    assert "&lt;script&gt;" in page.html and "[red]$\\frac{" in page.html
    whole(Page(page.html))
    shown = "".join(printed(page.terminal).split())
    assert "\x1b" not in shown and shown.count("[red]") == shown.count("</script>&")
    assert ATTACK in json.dumps(json.loads(page.values), ensure_ascii=False).encode().decode("unicode_escape")


@pytest.mark.parametrize("kind", KINDS)
def test_same_result_gives_the_same_bytes(kind):
    first, again = made(kind), KINDS[kind]("A-1")
    assert (first.html, first.values) == (again.html, again.values)


@pytest.mark.parametrize("kind", KINDS)
def test_terminal_fits_80_columns_without_colour_and_in_ascii(kind):
    text = printed(made(kind).terminal)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text and "\x1b" not in text
    assert printed(made(kind).terminal, encoding="ascii")


@pytest.mark.parametrize("kind", KINDS)
def test_page_terminal_and_numbers_say_what_they_said(kind, golden):
    page = made(kind)
    golden(f"pages/{kind}.txt", said(page.html))
    golden(f"pages/{kind}.terminal.txt", printed(page.terminal))
    if len(page.values) < LONG:
        golden(f"pages/{kind}.json", numbers(json.loads(page.values)) + "\n")


@pytest.fixture(scope="module", params=["made", pytest.param("committed", marks=pytest.mark.slow)])
def seen(request, tmp_path_factory) -> tuple[dict[str, dict], list[str]]:
    """What a browser shows of every page, and says of them."""
    names = COMMITTED if request.param == "committed" else (*KINDS, *OF_THE_TOOL)
    return shown({name: _html(name) for name in names}, tmp_path_factory.mktemp("seen"))


@browsed
def test_page_fits_every_screen_no_label_covers_another_and_the_console_is_silent(seen):
    pages, console = seen
    assert console == []
    for page, found in pages.items():
        for width in WIDTHS:
            off = {key: found[f"w{width}"][key] for key in ("scrolls", "wide", "over", "spilt")}
            assert off == {"scrolls": 0, "wide": [], "over": [], "spilt": []}, (page, width)
        for name in ("w1280", *PAPER):  # where a table cannot be pushed aside
            assert (found[name]["lost"], found[name]["spilt"]) == ([], []), (page, name)


accessible = pytest.mark.skipif(AXE is None, reason="axe-core is not there: pip install axe-core-python")


@browsed
@accessible
def test_axe_finds_nothing_serious_in_light_or_dark(seen):
    assert {page: found["serious"] for page, found in seen[0].items() if found["serious"]} == {}


@browsed
@accessible
def test_axe_finds_pale_words_and_links_in_pictures(tmp_path):
    body = (
        '<p style="color:#aaa">pale</p><svg role="img" aria-label="a"><a href="#b"><text>b</text></a></svg>'
        "<style>@media screen and (prefers-color-scheme: dark) { b { color: #ccc } }</style><b>bright</b>"
    )
    html = f'<html lang="en"><head><title>t</title></head><body>{body}</body></html>'
    serious = shown({"pale": html}, tmp_path)[0]["pale"]["serious"]
    kinds = [one.partition(":")[0] for one in serious]
    assert (kinds.count("color-contrast"), kinds.count("nested-interactive")) == (2, 1)
    assert "color-contrast: 2" in " ".join(serious)  # in dark


CLICKED = """
const [scroll] = document.querySelectorAll('.scroll'), table = scroll.querySelector('table');
const shown = () => [...table.tBodies[0].rows].filter(row => row.offsetParent);
const column = k => shown().map(row => row.cells[k].textContent);
const head = table.tHead.rows[0].cells[1];
const told = {first: column(1)};
head.click(); told.up = column(1);
head.click(); told.down = column(1);
head.click(); told.back = column(1);
const field = document.querySelector('.tools input');
field.value = 'b3'; field.dispatchEvent(new Event('input')); told.kept = column(0);
const choice = document.querySelector('.tools select');
choice.value = '2'; choice.dispatchEvent(new Event('change'));
told.shown = [...table.tHead.rows[0].cells].filter(cell => cell.offsetParent).map(cell => cell.textContent);
tell(told);
"""


@browsed
def test_scripts_sort_and_filter_long_tables_and_set_columns_beside_each_other(tmp_path):
    values = [f"{value:,}".replace("-", "−") for value in (12, -3, 1200, 0.5, 7, 90, 8, 9, 10, 11, 13, 14)]
    rows = [(f"b{k}", value, *"cdef") for k, value in enumerate(values)]
    table = Table("T", ("term", "A", "B", "C", "D", "E"), rows, beside=True)
    told, _ = told_by(CLICKED, page_html(Made("T", "?", [], [table])), tmp_path)
    up = ["−3", "0.5", "7", "8", "9", "10", "11", "12", "13", "14", "90", "1,200"]
    assert (told["first"], told["up"], told["down"], told["back"]) == (values, up, up[::-1], values)
    assert (told["kept"], told["shown"]) == (["b3"], ["term", "B"])


POINTED = """
const svg = document.querySelector('svg[data-scales]'), box = svg.getBoundingClientRect();
const at = (x, y) => {
  const place = {clientX: box.left + x * box.width / 350, clientY: box.top + y * box.height / 180};
  svg.dispatchEvent(new PointerEvent('pointermove', place));
  return document.querySelector('.told').textContent;
};
tell([at(46, 6), at(193, 74), at(10, 10)]);
"""


@browsed
def test_script_says_what_the_place_under_the_pointer_stands_for(tmp_path):
    def paint(axes):
        axes.barh([0, 1], [1.0, 100.0])
        rows_of(axes, ["b0", "b<1>"])
        axes.set(xscale="log", xlim=(0.01, 100.0), xlabel="share, %")

    panel = draw(paint, title="T", alt="a", key="k")
    told, _ = told_by(POINTED, page_html(Made("T", "?", [], [Figure([panel])])), tmp_path)
    assert told == ["share, %: 0.01 · b0", "share, %: 1 · b0", ""]


@browsed
def test_page_that_is_too_wide_and_labels_that_overlap_are_seen(tmp_path):
    labels = '<svg width="90" height="20"><text y="9">one</text><text y="10">two</text></svg>'
    cell = '<p style="width:600px;white-space:nowrap;word-spacing:600px">a b</p>'
    table = f'<table style="width:500px"><tr><td>{cell}</td></tr></table>'
    table = f'<div class="scroll" aria-label="t">{table}</div>'
    body = f'<body>{table}<p style="width:500px">a</p>{labels}<script>console.error("x")</script></body>'
    pages, console = shown({"wide": f"<!DOCTYPE html><html>{body}</html>"}, tmp_path)
    seen = pages["wide"]
    assert seen["w390"]["scrolls"] > 0
    assert len(seen["w390"]["wide"]) == 1
    assert seen["w1280"]["over"] == ["two on one"]
    assert (seen["w360"]["lost"], seen["w360"]["spilt"], seen["w1280"]["lost"]) == (["t"], ["t"], [])
    assert console


@browsed
def test_page_prints_with_a_sheet_for_each_class(tmp_path):
    page, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    page.write_text(made("lots").html, encoding="utf-8")
    run(tmp_path, f"--print-to-pdf={paper}", page.as_uri())
    sheets = paper.read_bytes()
    assert sheets.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", sheets)) >= 1 + len(SIZES)
