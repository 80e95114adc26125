"""The reports as a browser shows them, on a desk, on a telephone and on paper."""

import json
import re
import shutil
import subprocess
from html import escape, unescape
from pathlib import Path

import pytest
from lots_found import SIZES, lot_result

from imubayes.reporting.document import report_html
from imubayes.reporting.html import page_html
from imubayes.reporting.lots_page import lots_page

WIDTHS = (1280, 390)
"""px: a desk, and a telephone."""

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PLAYWRIGHT = ("chromium*/chrome-linux*/chrome", "chromium*/chrome-linux*/headless_shell")

MEASURED = """
<script>
function told(page, width) {
  const seen = [...page.querySelectorAll('body *')].filter(one => !one.closest('.scroll, .wide, svg'));
  const wide = seen.filter(one => one.getBoundingClientRect().right > width + 0.5);
  const over = [];
  let texts = 0;
  for (const svg of page.querySelectorAll('svg')) {
    const shown = [...svg.querySelectorAll('text')].filter(one => one.textContent.trim());
    const boxes = shown.map(one => one.getBoundingClientRect());
    texts += boxes.length;
    for (let a = 0; a < boxes.length; a++) for (let b = 0; b < a; b++) {
      const x = Math.min(boxes[a].right, boxes[b].right) - Math.max(boxes[a].left, boxes[b].left);
      const y = Math.min(boxes[a].bottom, boxes[b].bottom) - Math.max(boxes[a].top, boxes[b].top);
      if (x > 1 && y > 1) over.push(shown[a].textContent + ' on ' + shown[b].textContent);
    }
    if (svg.closest('.panel') && !svg.closest('.wide')
        && boxes.some(box => box.right > width + 0.5 || box.left < -0.5)) wide.push(svg);
  }
  const scrolls = page.documentElement.scrollWidth - width;
  return {scrolls, wide: wide.map(one => one.outerHTML.slice(0, 80)),
          over, texts};
}
addEventListener('load', () => {
  const found = {};
  for (const frame of document.querySelectorAll('iframe'))
    found[frame.id] = told(frame.contentDocument, frame.clientWidth);
  const out = document.createElement('pre');
  out.id = 'found';
  out.textContent = JSON.stringify(found);
  document.body.append(out);
});
</script>
"""
"""What is seen of a page in each frame: how far it scrolls sideways, what sticks out, labels that overlap."""


def _browser() -> str | None:
    cache = Path.home() / ".cache" / "ms-playwright"
    cached = (str(path) for pattern in PLAYWRIGHT for path in sorted(cache.glob(pattern)))
    return next((path for name in NAMES if (path := shutil.which(name))), next(cached, None))


BROWSER = _browser()
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason="there is no Chromium or Chrome, neither on PATH nor in playwright's cache"
)


def _run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    quiet = (
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
    )
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", *quiet, "--disable-dev-shm-usage",
        "--hide-scrollbars",
        f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr", *options,
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)


def _frames(html: str) -> str:
    style = "height:2000px;border:0;width"
    frames = "".join(
        f'<iframe id="w{width}" style="{style}:{width}px" srcdoc="{escape(html)}"></iframe>'
        for width in WIDTHS
    )
    return f'<!DOCTYPE html><html><head><meta charset="utf-8">{MEASURED}</head><body>{frames}</body></html>'


def _shown(html: str, folder: Path) -> tuple[dict, list[str]]:
    """What is seen of a page at each width, and what the browser's console says."""
    page = folder / "frames.html"
    page.write_text(_frames(html), encoding="utf-8")
    done = _run(folder, "--dump-dom", page.as_uri())
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.S)
    assert found, done.stderr[-2000:]
    return json.loads(unescape(found[1])), [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.fixture(params=["lots", "sensors"])
def html(request) -> str:
    return (
        page_html(lots_page(lot_result()))
        if request.param == "lots"
        else report_html(request.getfixturevalue("result"))
    )


def test_page_fits_every_screen_no_label_covers_another_and_the_console_is_silent(html, tmp_path):
    seen, console = _shown(html, tmp_path)
    assert console == []
    for width in WIDTHS:
        found = seen[f"w{width}"]
        assert found.pop("texts") > 20
        assert found == {"scrolls": 0, "wide": [], "over": []}


def test_page_that_is_too_wide_and_labels_that_overlap_are_seen(tmp_path):
    labels = '<svg width="90" height="20"><text y="9">one</text><text y="10">two</text></svg>'
    body = f'<body><p style="width:500px">a</p>{labels}<script>console.error("x")</script></body>'
    seen, console = _shown(f"<!DOCTYPE html><html>{body}</html>", tmp_path)
    assert seen["w390"]["scrolls"] > 0
    assert len(seen["w390"]["wide"]) == 1
    assert seen["w1280"]["over"] == ["two on one"]
    assert console


def test_page_prints_with_a_sheet_for_each_class(tmp_path):
    page, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    page.write_text(page_html(lots_page(lot_result())), encoding="utf-8")
    _run(tmp_path, f"--print-to-pdf={paper}", page.as_uri())
    printed = paper.read_bytes()
    assert printed.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) >= 1 + len(SIZES)
