"""What is shown, whatever its markup: elements of a page, its words in their order, lines of a terminal."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
from collections.abc import Iterator
from typing import Any
from unittest import mock
from xml.etree.ElementTree import Element

from report_reading import NUMBER, Page, plain, tree, words_of
from rich.console import RenderableType

from imubayes.campaign import StudyResult
from imubayes.cli.console import show
from imubayes.reporting.blocks import Lines, page_html, terminal_page
from imubayes.reporting.document import report_page


def whole(page: Page) -> Page:
    """A page whose elements are closed in their order, and whose links lead to one place each."""
    assert page.wrong == []
    ids, links = page.all("id"), {link[1:] for link in page.all("href") if link.startswith("#")}
    assert len(ids) == len(set(ids))
    assert links <= set(ids), links - set(ids)
    return page


LINES = frozenset({"p", "li", "dt", "dd", "caption", "figcaption", "summary", "pre", "title"})
"""Elements whose words stand in a line of their own."""


def said(html: str) -> str:
    """Words of a page: a line for each heading, paragraph, row of a table and label of a figure."""
    return "".join(f"{line}\n" for line in _lines(tree(html)) if line)


def _lines(node: Element) -> Iterator[str]:
    if node.tag in ("style", "script") or node.get("aria-hidden"):
        return
    if re.fullmatch("h[1-6]", node.tag):
        yield f"\n{'#' * int(node.tag[1])} {words_of(node)}"
    elif node.tag in LINES:
        yield words_of(node)
    elif node.tag == "tr":
        yield " | ".join(words_of(cell) for cell in node)
    elif node.tag == "svg":
        labels = [text for text in map(words_of, node.iter("text")) if not NUMBER.fullmatch(text)]
        yield f"figure: {plain(node.get('aria-label', ''))} [{'; '.join(labels)}]"
    else:
        for child in node:
            yield from _lines(child)


def numbers(value: Any, indent: str = "\n") -> str:
    """JSON with a line for each table that holds no other, and numbers to four digits."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) > 1e-18 else "0"  # rounding's own digits are no promise
    if not isinstance(value, dict | list):
        return json.dumps(value, ensure_ascii=False)
    entries = list(value.values() if isinstance(value, dict) else value)
    keys = [f"{json.dumps(key)}: " for key in value] if isinstance(value, dict) else [""] * len(value)
    flat = not any(isinstance(one, dict | list) for one in entries)
    start, between, end = ("", ", ", "") if flat else (f"{indent} ", f",{indent} ", indent)
    parts = [key + numbers(one, f"{indent} ") for key, one in zip(keys, entries, strict=True)]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}{start}{between.join(parts)}{end}{last}"


def report_html(result: StudyResult) -> str:
    """Text of the report of a study of sensors."""
    return page_html(report_page(result))


def study_lines(result: StudyResult) -> Lines:
    """Lines of a terminal on a study of sensors."""
    return terminal_page(report_page(result))


def printed(shown: RenderableType, encoding: str = "utf-8") -> str:
    """Lines of a terminal of 80 columns without colour."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with mock.patch.dict(os.environ, {"COLUMNS": "80"}), contextlib.redirect_stdout(stream):
        show(shown)
    stream.flush()
    return stream.buffer.getvalue().decode(encoding)
