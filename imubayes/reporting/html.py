"""A page of blocks as one HTML file that opens offline."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from imubayes.reporting.blocks import Both, Page, Text

if TYPE_CHECKING:
    from jinja2 import Environment

CLASSES = {"t": "once", "f": "once", "w": "wrap", "n": "n"}
"""Class of a cell by the letter of its column (`Table.columns`)."""


def page_html(page: Page) -> str:
    """Text of the page; names that come from files are escaped."""
    return environment().get_template("page.html.j2").render(page=page)


def write_page(page: Page, values: str, folder: Path) -> tuple[Path, ...]:
    """Write a page as ``report.html`` and its numbers as ``result.json`` into a folder."""
    report, result = folder / "report.html", folder / "result.json"
    report.write_text(page_html(page), encoding="utf-8")
    result.write_text(values, encoding="utf-8")
    return report, result


@cache
def environment() -> Environment:
    """Templates of reports, and what they know of blocks."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.tests["block"] = lambda block, kind: type(block).__name__ == kind
    found.filters["html"] = _on_page
    found.globals["classes"] = CLASSES
    return found


def _on_page(text: Text) -> str:
    return text.page if isinstance(text, Both) else text
