"""Settings of the documentation site: ``sphinx-build -W docs build/site``.

Pages are Markdown (MyST). README, the help of the commands, the standards' symbols and the list of reports
become pages, in ``made``, as the site is built. Links that leave ``docs`` lead to copies beside the pages.
"""

import json
import re
import shutil
from pathlib import Path

import typer
from pygments.lexers.special import TextLexer

from imubayes import __version__
from imubayes.cli import app as command_line
from imubayes.sensors.equations import STANDARDS

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
COPIED = (
    "studies/*.toml",
    "reports/*/*.html",
    "reports/*/*.svg",
    "reports/*/*.png",
    "C*.md",
    "docs/*.svg",
    "docs/*.json",
    "docs/tutorial/*.csv",
)
"""Files beside the pages, which pages link to."""

MARKED = r"\\\1"
"""A sign that Markdown would take for its own."""

project = "imubayes"
author = copyright = "The imubayes authors"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"imubayes {__version__}"
html_copy_source = html_show_sourcelink = False
myst_heading_anchors = 4
myst_url_schemes = {"http": None, "https": None, "beside": {"url": "{{path}}"}}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_use_rtype = False
add_module_names = False


def commands() -> str:
    """Page of the command line: the help of each command."""
    page = [
        "# Commands",
        "What `imubayes COMMAND --help` says. [Exit codes](../study.md#exit-codes) are in the reference.",
    ]
    for name, command in typer.main.get_group(command_line).commands.items():
        context = typer.Context(
            command, info_name=f"imubayes {name}", max_content_width=100, terminal_width=100
        )
        page.append(f"## {name}\n\n```text\n{command.get_help(context).strip()}\n```")
    return "\n\n".join(page) + "\n"


def gallery() -> str:
    """Page of the reports: the title of each, and the first sentence of its answer where it has one."""
    page = "# Reports\n\nEach is one HTML file that opens offline. The studies lie in `studies/`.\n\n"
    for file in sorted(ROOT.glob("reports/*/result.json")):
        result = json.loads(file.read_text(encoding="utf-8"))
        answer = (result.get("answer") or [""])[0]
        name = file.parent.name
        page += f"- [{result['study']}](../../reports/{name}/report.html) (`{name}`)"
        page += f": {re.sub(r'([*_|])', MARKED, answer)}\n" if answer else "\n"
    return page


def symbols() -> str:
    """Page of the standards' symbols, with the generalized terms that determine them."""
    page = "# Symbols\n\nOf each standard, with the term that determines it, and its weight there.\n"
    for one in STANDARDS.values():
        page += f"\n## {one.title}, {one.kind}\n\nMapping: {one.exact}.\n\n"
        page += "| symbol | term | weight | unit | note |\n|---|---|---|---|---|\n"
        for row in one.symbols:
            term = f"`{row.term}`" if row.term else "none"
            page += f"| `{row.symbol}` | {term} | {row.weight:g} | {row.printed} | {row.note} |\n"
    return page


def readme() -> str:
    """README as a page: its links lead from another folder."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"\]\((?=studies|reports|CHANGELOG|CONTRIBUTING)", "](../../", text)
    return text.replace("](docs/", "](../").replace("# imubayes", "# What it does", 1)


def write_pages(app: object) -> None:
    """Make the pages that no file holds."""
    folder = DOCS / "made"
    folder.mkdir(exist_ok=True)
    for page in (commands, gallery, readme, symbols):
        (folder / f"{page.__name__}.md").write_text(page(), encoding="utf-8")


def leaving(app: object, name: str, source: list[str]) -> None:
    """Make a link to what is beside the pages one to its copy there."""
    text = source[0].replace("](../README.md)", "](made/readme.md)")
    text = re.sub(r"\]\(\.\./((?:\.\./)*(?:studies|reports|C[HO])[^)\s]*)\)", r"](beside:\1)", text)
    source[0] = re.sub(r"\]\(([\w/.]+\.(?:json|csv))\)", r"](beside:\1)", text)


def lengths(app: object, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Keep the signs of a length apart from a substitution's."""
    lines[:] = [line.replace("|f|", r"\|f\|") for line in lines]


def copy_files(app: object, error: Exception | None) -> None:
    """Copy what pages link to."""
    for file in (file for pattern in COPIED for file in ROOT.glob(pattern)) if error is None else ():
        target = Path(app.outdir) / file.relative_to(DOCS if file.is_relative_to(DOCS) else ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)


def setup(app: object) -> None:
    """Register them."""
    app.add_lexer("csv", TextLexer)
    app.connect("builder-inited", write_pages)
    app.connect("source-read", leaving)
    app.connect("autodoc-process-docstring", lengths)
    app.connect("build-finished", copy_files)
