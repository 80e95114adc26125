"""A page as a browser shows it: Chromium or Chrome, from PATH or from playwright's cache."""

import json
import re
import shutil
import subprocess
from collections.abc import Mapping
from html import unescape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

WIDTHS = (1280, 905, 645, 390, 360)
"""px: a desk, a tablet, and telephones."""

PAPER = {"A4": 688, "Letter": 710}
"""px between the margins of a sheet."""

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PLAYWRIGHT = ("chromium*/chrome-linux*/chrome", "chromium*/chrome-linux*/headless_shell")

MEASURED = r"""
function upright(text) {  // the box of a slanted label is wider than the label
  const turned = /rotate\((-?[\d.]+)/.exec(text.getAttribute('transform') || '');
  return !turned || Math.abs(turned[1] % 90) < 1;
}
function told(page, width) {
  const seen = [...page.querySelectorAll('body *')].filter(one => !one.closest('.scroll, .wide, svg'));
  const wide = seen.filter(one => one.getBoundingClientRect().right > width + 0.5);
  const over = [];
  let texts = 0;
  for (const svg of page.querySelectorAll('svg')) {
    const shown = [...svg.querySelectorAll('text')].filter(one => one.textContent.trim() && upright(one));
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
  const tables = [...page.querySelectorAll('table')];
  const name = table => table.closest('.scroll').getAttribute('aria-label');
  const lost = tables.filter(one => one.getBoundingClientRect().width > one.parentElement.clientWidth + 1);
  const spilt = tables.filter(one => [...one.querySelectorAll('th, td')].some(cell => {
    const [box, text] = [cell.getBoundingClientRect(), page.createRange()];
    text.selectNodeContents(cell);
    return [...text.getClientRects()].some(
      part => part.width && (part.right > box.right + 1.5 || part.left < box.left - 1.5));
  }));
  return {lost: lost.map(name), spilt: spilt.map(name), over, texts,
          scrolls, wide: wide.map(one => one.outerHTML.slice(0, 80))};
}
function wrong(frame, options) {
  return frame.contentWindow.axe.run({resultTypes: ['violations'], ...options}).then(found => found.violations
    .filter(one => ['serious', 'critical'].includes(one.impact))
    .map(one => `${one.id}: ${one.nodes.length}, ${one.nodes[0].html.slice(0, 120)}`));
}
addEventListener('load', async () => {
  const found = {};
  for (const [page, frames] of Object.entries(PAGES)) {
    const seen = found[page] = {serious: []}, made = frames.map(([id, width, srcdoc]) => {
      const frame = Object.assign(document.createElement('iframe'), {id, srcdoc});
      frame.style.cssText = `height: 2000px; border: 0; width: ${width}px`;
      return frame;
    });
    const loaded = made.map(frame => new Promise(done => frame.addEventListener('load', done)));
    document.body.append(...made);
    await Promise.all(loaded);
    for (const frame of made) seen[frame.id] = told(frame.contentDocument, frame.clientWidth);
    if (AXE) {
      const shown = made[0].contentDocument;
      shown.head.append(Object.assign(shown.createElement('script'), {textContent: AXE}));
      const light = await wrong(made[0], {});
      for (const one of shown.querySelectorAll('style')) one.textContent =
        one.textContent.replaceAll('@media screen and (prefers-color-scheme: dark)', '@media screen');
      seen.serious = [...light, ...await wrong(made[0], {runOnly: ['color-contrast']})];
    }
    for (const frame of made) frame.remove();
  }
  tell(found);
});
"""
"""What is seen of a page in each frame: how far it scrolls sideways, what sticks out, labels that overlap,
tables wider than their room, and those with text outside its cell. In the first frame, what axe-core calls
serious or worse: in light, and of colours in dark."""


def _browser() -> str | None:
    cache = Path.home() / ".cache" / "ms-playwright"
    cached = (str(path) for pattern in PLAYWRIGHT for path in sorted(cache.glob(pattern)))
    return next((path for name in NAMES if (path := shutil.which(name))), next(cached, None))


BROWSER = _browser()


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
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


def _frames(html: str) -> list[tuple[str, int, str]]:
    """Frames of each width; and of sheets, whose styles are those of print."""
    printed = html.replace("@media print", "@media all").replace("@media screen", "@media print")
    sheets = [(paper, width, printed) for paper, width in PAPER.items()]
    return [*((f"w{width}", width, html) for width in WIDTHS), *sheets]


def _axe() -> Path | None:
    found = find_spec("axe_core_python")
    return Path(found.origin).with_name("axe.min.js") if found and found.origin else None


AXE = _axe()


def shown(pages: Mapping[str, str], folder: Path) -> tuple[dict[str, dict], list[str]]:
    """What is seen of each page at each width and by axe-core, and what the browser's console says."""
    given = {"AXE": AXE.read_text("utf-8") if AXE else "", "PAGES": {k: _frames(v) for k, v in pages.items()}}
    told = "".join(f"const {name} = {json.dumps(one)};" for name, one in given.items())
    blank = '<!DOCTYPE html><html><head><meta charset="utf-8"></head><body></body></html>'
    return told_by(told.replace("</", r"<\/") + MEASURED, blank, folder)


def told_by(script: str, html: str, folder: Path) -> tuple[Any, list[str]]:
    """What a script after a page tells by ``tell``, and what the console says."""
    tell = (
        "const tell = found => document.body.append(Object.assign(document.createElement('pre'),"
        " {id: 'found', textContent: JSON.stringify(found)}));"
    )
    page = folder / "told.html"
    page.write_text(html.replace("</body>", f"<script>{tell}\n{script}</script></body>"), encoding="utf-8")
    done = run(folder, "--virtual-time-budget=60000", "--window-size=1280,900", "--dump-dom", page.as_uri())
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.S)
    assert found, done.stderr[-2000:]
    return json.loads(unescape(found[1])), [line for line in done.stderr.splitlines() if "CONSOLE" in line]
