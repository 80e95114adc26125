"""What all comparisons say: which results, what counts as a difference, and each difference."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from markupsafe import Markup

from imubayes.reporting.blocks import (
    Both,
    Page,
    Prose,
    Row,
    Section,
    Table,
    Text,
    joined,
    quiet,
    repeat,
    strong,
)
from imubayes.reporting.comparison.pulls import Pull, is_beyond, method_sentence
from imubayes.reporting.comparison.records import Compared

RESULT, DIFFERENCE = Both("result", ""), Both("difference", "differs")
"""Headings, and those of a terminal."""


def comparison_page(
    found: Compared, question: str, answer: Iterable[str], how: str, alone: str, sections: Iterable[Section]
) -> Page:
    """Page of a comparison.

    Parameters
    ----------
    question : that it answers.
    answer : in words made from the numbers.
    how : what is compared, and as what.
    alone : what stands in one result only; empty where nothing does.
    sections : one by one.
    """
    files = list(zip(found.labels, found.results, strict=True))
    hashed = Markup('<strong>{}</strong> SHA-256 <code class="hash">{}</code>, imubayes {}')
    hashes = [hashed.format(label, one.sha256, one.version) for label, one in files]
    said = [joined(strong(label), f"{one.study}, {one.path}") for label, one in files]
    paths = " ".join(str(one.path) for one in found.results)
    return Page(
        "Results side by side",
        question,
        first=(Prose(strong(" ".join(answer)), "answer"),),
        blocks=(
            Prose(said, "list"),
            Prose(method_sentence(found.threshold, found.tests, how), "note"),
            Prose([alone] if alone else []),
            *sections,
            repeat(f"imubayes compare {paths}", "", "", *hashes),
        ),
    )


def titled(
    title: str, of: str, head: Sequence[Text], rows: Sequence[Row], columns: str, *said: str
) -> Section:
    """Table under its title, and what is said of it."""
    return Section(title, (Prose(" ".join(said)), Table(f"{title}: {of}", head, rows, columns)))


def difference(pull: Pull | None, count: int, what: str = "") -> Both:
    """Difference, and between which two of more than two results."""
    if pull is None:
        return Both("", "")
    pair = f" {pull.pair[0]}-{pull.pair[1]}" if count > 2 else ""
    text = f"{what} {pull.size:.1f} sd{pair}".lstrip()
    if is_beyond(pull):
        return Both(strong(f"{text}, beyond uncertainty"), f"! {text}")
    return Both(quiet(text), text)


def headed(k: int, *texts: Text) -> tuple[Text, ...]:
    """Texts that only the first line of a group has."""
    return texts if k == 0 else ("",) * len(texts)


def counted(count: int, one: str, many: str) -> str:
    """Number with its noun and verb.

    Examples
    --------
    >>> counted(1, "value differs", "values differ"), counted(3, "value differs", "values differ")
    ('1 value differs', '3 values differ')
    """
    return f"{count} {one if count == 1 else many}"


def largest_first(pulls: Sequence[tuple[str, Pull | None]]) -> list[tuple[str, Pull]]:
    """Named differences beyond uncertainty, the largest first."""
    there = [(name, pull) for name, pull in pulls if pull is not None and pull.beyond]
    return sorted(there, key=lambda pair: -pair[1].size)
