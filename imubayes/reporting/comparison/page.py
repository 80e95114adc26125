"""What all comparisons say: which results, what counts as a difference, and each difference."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

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
from imubayes.reporting.comparison.differences import LEVEL, Comparison, Entry, Group, differing
from imubayes.selection.verdicts import listed

RESULT, DIFFERENCE = Both("result", ""), Both("difference", "differs")
"""Headings, and those of a terminal."""

LITTLE = 0.01
"""Share of a budget below which a term that no model has is left out."""


def comparison_page(
    found: Comparison,
    question: str,
    answer: Iterable[str],
    how: str,
    alone: str,
    sections: Iterable[Section],
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
    files = list(zip(found.labels, found.files, strict=True))
    hashed = Markup('<strong>{}</strong> SHA-256 <code class="hash">{}</code>, imubayes {}')
    hashes = [hashed.format(label, one.sha256, one.version) for label, one in files]
    said = [joined(strong(label), f"{one.study}, {one.path}") for label, one in files]
    paths = " ".join(str(one.path) for one in found.files)
    method = (
        f"A difference counts from {found.threshold:.1f} sd on: in {found.tests} comparisons chance reaches"
        f" that with {100.0 * LEVEL:.0f} % at most (Bonferroni). {how}"
    )
    return Page(
        "Results side by side",
        question,
        first=(Prose(strong(" ".join(answer)), "answer"),),
        blocks=(
            Prose(said, "list"),
            Prose(method, "note"),
            Prose([alone] if alone else []),
            *sections,
            repeat(f"imubayes compare {paths}", "", "", *hashes),
        ),
    )


def titled(
    title: str, of: str, head: Sequence[Text], rows: Iterable[Row], columns: str, *said: str
) -> Section:
    """Table under its title, and what is said of it."""
    return Section(title, (Prose(" ".join(said)), Table(f"{title}: {of}", head, tuple(rows), columns)))


def entry_rows(
    labels: Sequence[str],
    name: str,
    one: Entry,
    told: Iterable[tuple[Text, ...]],
    *,
    brief: bool,
) -> Iterator[Row]:
    """One line for each result: name and difference on the first, and the cells that say its value."""
    for k, (label, cells) in enumerate(zip(labels, told, strict=True)):
        first, last = (name, difference(one, len(labels))) if k == 0 else ("", "")
        yield Row((first, label, *cells, last), strong=one.beyond, brief=brief or one.beyond)


def difference(one: Entry, count: int) -> Both:
    """Largest difference, and between which two of more than two results."""
    what, pull = one.largest
    if pull is None:
        return Both("", "")
    pair = f" {pull.pair[0]}-{pull.pair[1]}" if count > 2 else ""
    text = f"{what} {pull.size:.1f} sd{pair}".lstrip()
    if pull.beyond:
        return Both(strong(f"{text}, beyond uncertainty"), f"! {text}")
    return Both(quiet(text), text)


def most_different(groups: Iterable[tuple[Group, Iterable[Entry]]]) -> str:
    """Count what differs beyond uncertainty among entries of groups, and name the most; empty if nothing."""
    every = [(group.name, *pair) for group, entries in groups for pair in differing(entries)]
    if not every:
        return ""
    name, what, pull = max(every, key=lambda entry: entry[2].size)
    count = counted(len(every), "value differs", "values differ")
    return f"{count} beyond uncertainty, most {what} of {name}, by {pull.size:.1f} sd"


def counted(count: int, one: str, many: str) -> str:
    """Number with its noun and verb.

    Examples
    --------
    >>> counted(1, "value differs", "values differ"), counted(3, "value differs", "values differ")
    ('1 value differs', '3 values differ')
    """
    return f"{count} {one if count == 1 else many}"


def incomplete(group: Group, count: int) -> Iterator[str]:
    """Say which terms fewer than `count` results have."""
    partly = [name for name, one in group.terms.items() if sum(v is not None for v in one.values) < count]
    if partly:
        yield f"Not in every library, which the other estimates depend on: {listed(partly)}."
