"""The list of a folder's reports."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

from markupsafe import Markup

from imubayes.errors import InputError
from imubayes.reporting.blocks import INDEX, MARK, Page, Prose, Table, is_of_reports, page_html, repeat
from imubayes.rig.recordings import write_whole
from imubayes.units import counted

LISTED_HEAD = ("report", "answer", "data", "fit", "made")

LISTED_NOTE = (
    "Answers are those of the reports' first screens. A dash: a report of an older version does not say."
)


def write_index(folder: Path) -> Path:
    """Write the list of a folder's reports, in place of an older one alone."""
    file = folder / INDEX
    if file.exists() and not is_of_reports(folder):
        raise InputError(f"{file}: is no list of reports: expected a folder of reports, or that name free")
    if not (reports := sorted(folder.glob("*/report.html"))):
        raise InputError(f"{folder}: has no */report.html: expected a folder that 'imubayes run' writes into")
    table = Table("Reports", LISTED_HEAD, [_listed_row(report) for report in reports], "wwtwt", LISTED_NOTE)
    said = f"{counted(len(reports), 'report')} in this folder."
    again = repeat(f"imubayes index {folder}", "")
    page = Page("Reports", "What was asked, and what was found.", [Prose(said)], [table, again])
    text = page_html(page).replace("<title>", f"{MARK}\n<title>", 1)
    write_whole(file, lambda stream: stream.write(text.encode()))
    return file


def renew_index(folder: Path) -> tuple[Path, ...]:
    """Write the list anew where a report was written, if its folder is clearly one of reports."""
    parent = folder.parent if folder.parent.name else folder.resolve().parent  # as the folder was named
    return (write_index(parent),) if is_of_reports(parent) and (folder / "report.html").is_file() else ()


def _listed_row(report: Path) -> tuple[str, ...]:
    """Link to a report with its title and question, and what else its head says of it."""
    name, (head, *_) = report.parent.name, report.read_text(encoding="utf-8").partition("<style>")
    told = dict(re.findall(r'<meta name="(\w+)" content="([^"]*)">', head))
    if title := re.search(r"<title>(.*?)</title>", head, re.S):
        told["title"] = title[1]
    told = {key: unescape(text) for key, text in told.items()}
    cell = Markup('<a href="{}/report.html">{}</a><br>{}')
    link = cell.format(name, told.get("title", name), told.get("question", ""))
    return (link, *(told.get(key, "–") for key in ("description", "data", "fit", "date")))
