"""Fill README.md's marked blocks, and draw docs/quickstart.svg, from real runs.

Run it by ``python docs/update_readme.py`` where imubayes is installed; it takes less than a minute. It
prints how far it is. What stands between these markers of README.md is replaced:

``<!-- quickstart -->``
    what ``imubayes run studies/quickstart.toml`` prints without a terminal, in 80 columns.
``<!-- table -->``
    what the Python code between the ``<!-- example -->`` markers prints.

``docs/quickstart.svg`` is the report's inclusion figure of the same study under its title, on white.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from imubayes.reporting.canvas import INK, VERDICT_COLOURS, WIDTH, Drawing
from imubayes.reporting.figures import inclusion
from imubayes.reporting.rows import MARKS
from imubayes.study.method import run

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
STUDY = Path("studies/quickstart.toml")

COLUMNS = 80
TITLE_WIDTH = 52
"""Characters of the figure's title in a line."""
LINE, PAD = 16, 12
"""px: height of a line of the title, and white space around the figure."""
ENLARGED = 1.25
"""A figure of the report on a page that is wider than the report's columns."""
FONT = "system-ui, -apple-system, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif"


def main() -> None:
    """Fill both blocks, then draw the figure."""
    readme = README.read_text(encoding="utf-8")
    readme = filled(readme, "quickstart", fenced(quickstart_output()))
    readme = filled(readme, "table", fenced(printed("-c", example_code(readme), folder=ROOT)))
    README.write_text(readme, encoding="utf-8")
    (sensor,) = run(ROOT / STUDY).sensors
    came = {term.verdict for term in sensor.selection.terms}
    figure = standalone(inclusion(sensor, key="q"), key_to([v for v in MARKS if v in came]))
    (ROOT / "docs" / "quickstart.svg").write_text(figure, encoding="utf-8")


def quickstart_output() -> str:
    """What the README's first command prints, run where it may write its report."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / STUDY
        copy.parent.mkdir()
        shutil.copy(ROOT / STUDY, copy)
        return printed("-c", "from imubayes.cli import main; main()", "run", str(STUDY), folder=Path(folder))


def printed(*arguments: str, folder: Path) -> str:
    """Standard output of a Python process, without blanks at the ends of lines."""
    environment = {**os.environ, "COLUMNS": str(COLUMNS), "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=True,
    )
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip("\n")


def block(readme: str, name: str) -> str:
    """Return what stands between a pair of markers.

    Raises
    ------
    SystemExit : if the README has no such pair.
    """
    found = re.search(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", readme, re.S)
    if found is None:
        raise SystemExit(f"README.md has no pair of markers <!-- {name} --> and <!-- /{name} -->: add them")
    return found[1]


def example_code(readme: str) -> str:
    """Python code of the README's example."""
    return block(readme, "example").removeprefix("```python\n").removesuffix("```\n")


def filled(readme: str, name: str, content: str) -> str:
    """README with other content between a pair of markers."""
    old = block(readme, name)
    return readme.replace(f"<!-- {name} -->\n{old}", f"<!-- {name} -->\n{content}", 1)


def fenced(text: str) -> str:
    """Text as a block of Markdown."""
    return f"```text\n{text}\n```\n"


def standalone(panel: Drawing, key: tuple[str, ...]) -> str:
    """Figure of the report as a file of its own, which has no page to lend it a font and a background.

    Parameters
    ----------
    panel : of the report.
    key : what the marks mean, line by line, as the contents of text elements.
    """
    lines = [escape(line) for line in textwrap.wrap(panel.title.replace("-", "−"), TITLE_WIDTH)]
    top = PAD + LINE * len(lines) + PAD // 2
    bottom = top + int(re.findall(r'height="(\d+)"', panel.svg)[0])
    width, height = WIDTH + 2 * PAD, bottom + LINE * len(key) + PAD
    title = "".join(_text(line, PAD + LINE * k, ' font-weight="600"') for k, line in enumerate(lines))
    legend = "".join(_text(line, bottom + PAD // 2 + LINE * k) for k, line in enumerate(key))
    figure = panel.svg.replace("<svg ", f'<svg x="{PAD}" y="{top}" ', 1)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
        f' width="{ENLARGED * width:g}" height="{ENLARGED * height:g}" font-family="{FONT}" font-size="11"'
        f' fill="{INK}"><rect width="{width}" height="{height}" fill="#fff"/>'
        f"{title}{figure}{legend}</svg>\n"
    )


def key_to(verdicts: list[str]) -> tuple[str, ...]:
    """Shape and word of each verdict in its colour, and what the lines are."""
    words = [f'<tspan fill="{VERDICT_COLOURS[v]}">{MARKS[v][0]}</tspan> {v}' for v in verdicts]
    return "   ".join(words), "— range over prior widths × ⅓, 1, 3"


def _text(content: str, y: int, style: str = "") -> str:
    return f'<text x="{PAD}" y="{y}" dominant-baseline="hanging" xml:space="preserve"{style}>{content}</text>'


if __name__ == "__main__":
    main()
