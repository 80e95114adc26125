"""What all comparisons say and publish: which results, what counts as a difference, and each difference."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

import imubayes
from imubayes.reporting import blocks
from imubayes.reporting.comparison.differences import LETTERS, LEVEL, Comparison, Entry, Group, differing
from imubayes.reporting.result.file import Written
from imubayes.selection.verdicts import listed
from imubayes.units import counted

RESULT, DIFFERENCE = blocks.Both("result", ""), blocks.Both("difference", "differs")
"""Headings, and those of a terminal."""

LITTLE = 0.01
"""Share of a budget below which a term that no model has is left out."""


class Comparing(NamedTuple):
    """How results of a kind are compared and told.

    Attributes
    ----------
    compared : sets them side by side.
    question, answer, how : of the page, and what counts as a difference.
    section : of the k-th group.
    alone, item : what is said of what stands in one result alone, and of each: result, name, and class.
    keys : of the groups in ``result.json``, and of what stands alone.
    more : what the kind publishes beside that.
    """

    compared: Callable[[Sequence[Written], Sequence[Any]], Comparison]
    question: str
    answer: Callable[[Comparison], Iterable[str]]
    how: str
    section: Callable[[int, Group, Comparison], blocks.Section]
    alone: str
    item: str
    keys: tuple[str, ...]
    more: Callable[[Comparison], dict[str, Any]] = lambda _: {}


def comparison_page(comparison: Comparison, kind: Comparing) -> blocks.Page:
    """Page of a comparison."""
    files = list(zip(LETTERS, comparison.files, strict=False))
    hashed = Markup('<strong>{}</strong> SHA-256 <code class="hash">{}</code>, imubayes {}')
    hashes = [hashed.format(label, file.sha256, file.version) for label, file in files]
    said = [blocks.joined(blocks.strong(label), f"{file.study}, {file.path}") for label, file in files]
    paths = " ".join(str(file.path) for file in comparison.files)
    method = (
        f"A difference counts from {comparison.threshold:.1f} sd on: in {comparison.tests} comparisons chance"
        f" reaches that with {100.0 * LEVEL:.0f} % at most (Bonferroni). {kind.how}"
    )
    alone = ", ".join(kind.item.format(*(part or "none" for part in item)) for item in comparison.alone)
    first, rest = blocks.parted(kind.answer(comparison))
    return blocks.Page(
        "Results side by side",
        kind.question,
        first=(blocks.Prose(blocks.strong(" ".join(first)), "answer"),),
        blocks=(
            blocks.Prose(" ".join(rest)),
            blocks.Prose(said, "list"),
            blocks.Prose(method, "note"),
            blocks.Prose(f"{kind.alone}: {alone}." if alone else ""),
            *(kind.section(k, group, comparison) for k, group in enumerate(comparison.groups)),
            blocks.repeat(f"imubayes compare {paths}", "", "", *hashes),
        ),
    )


def titled(
    title: str, of: str, head: Sequence[blocks.Text], rows: Iterable[blocks.Row], columns: str, *said: str
) -> blocks.Section:
    """Table under its title, and what is said of it; brief where any row is."""
    lines = tuple(rows)
    table = blocks.Table(f"{title}: {of}", head, lines, columns)
    return blocks.Section(title, (blocks.Prose(" ".join(said)), table), brief=any(row.brief for row in lines))


def entry_rows(entries: Iterable[Entry], *, whole: bool) -> Iterator[blocks.Row]:
    """One line for each result: name and difference on the first, and the cells that say its value."""
    for entry in entries:
        brief = entry.beyond or (not entry.silent and (whole or entry.divided))
        for k, (label, cells) in enumerate(zip(LETTERS, entry.cells, strict=False)):
            first, last = ("", "") if k else (entry.name, difference(entry, len(entry.cells)))
            if entry.shown or entry.beyond:
                yield blocks.Row((first, label, *cells, last), strong=entry.beyond, brief=brief)


def difference(entry: Entry, count: int) -> blocks.Both:
    """Largest difference, and between which two of more than two results."""
    what, pull = entry.largest
    if pull is None:
        return blocks.Both("", "")
    pair = f" {pull.pair[0]}-{pull.pair[1]}" if count > 2 else ""
    text = f"{what} {pull.size:.1f} sd{pair}".lstrip()
    if pull.beyond:
        return blocks.Both(blocks.strong(f"{text}, beyond uncertainty"), f"! {text}")
    return blocks.Both(blocks.quiet(text), text)


def most_different(groups: Iterable[tuple[Group, Iterable[Entry]]]) -> str:
    """Count what differs beyond uncertainty among entries of groups, and name the most; empty if nothing."""
    every = [(group.name, *pair) for group, entries in groups for pair in differing(entries)]
    if not every:
        return ""
    name, what, pull = max(every, key=lambda entry: entry[2].size)
    differ = f"{counted(len(every), 'value')} differ{'s' if len(every) == 1 else ''}"
    return f"{differ} beyond uncertainty, most {what} of {name}, by {pull.size:.1f} sd"


def incomplete(group: Group, count: int) -> Iterator[str]:
    """Say which terms fewer than `count` results have."""
    partly = [name for name, entry in group.terms.items() if len(group.members) - entry.missing < count]
    if partly:
        yield f"Not in every library, which the other estimates depend on: {listed(partly)}."


def comparison_record(comparison: Comparison, kind: Comparing) -> dict[str, Any]:
    """Values of a comparison's ``result.json``, SI."""
    groups, *alone = kind.keys
    return {
        "imubayes": imubayes.__version__,
        "results": [
            {"label": label, "file": str(file.path), "sha256": file.sha256, "study": file.study}
            for label, file in zip(LETTERS, comparison.files, strict=False)
        ],
        "level": LEVEL,
        "comparisons": comparison.tests,
        "threshold": comparison.threshold,
        **kind.more(comparison),
        groups: [_group_record(group) for group in comparison.groups],
        "alone": [dict(zip(("result", *alone), item, strict=True)) for item in comparison.alone],
    }


def _group_record(group: Group) -> dict[str, Any]:
    """What is published of a group; its record has the keys of what may be there."""
    told = {
        "typical": not differing(group.entries),
        "terms": [_entry_record(term) for term in group.terms.values()],
        "noise": [_entry_record(noise) for noise in group.noise.values()],
        "scenes": [_group_record(scene) for scene in group.scenes],
    }
    return {**group.record, **{key: entries for key, entries in told.items() if key in group.record}}


def _entry_record(entry: Entry) -> dict[str, Any]:
    """Values, and the largest difference of each kind; nulls where there is none."""
    pulls = {
        what: {
            "difference_over_sd": pull and pull.size,
            "between": pull and list(pull.pair),
            "differs": pull and pull.beyond,
        }
        for what, pull in entry.pulls.items()
    }
    return {**entry.record, **pulls.pop("", {}), **pulls}
