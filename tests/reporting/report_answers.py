"""Answers of a report and its result, worked out again from the verdicts that they rest on."""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

from page_reading import Block

Found = dict[str, Any]

VERDICTS = ("needed", "not needed", "undecided", "inseparable", "unresolved", "untested")
LISTED = r"([\w*]+(?:(?:, | and )[\w*]+)*)"


def names(text: str) -> list[str]:
    """Names of a list in a sentence, in order; none of 'no term'."""
    return sorted(set(re.split(r", | and ", text)) - {"no term", "none", ""})


def wrong_sensors(blocks: list[Block], result: Found) -> Iterator[str]:
    """Counts and lists of needed terms that are not those of the components' verdicts."""
    counts = Counter(term["verdict"] for one in result["sensors"] for term in one["terms"])
    for block in blocks:
        if block.anchor == "first":
            for count, verdict in re.findall(rf"(\d+) ({'|'.join(VERDICTS)}) [·(]", block.text):
                if counts[verdict] != int(count):
                    yield f"{count} {verdict}: {counts}"
        for one in result["sensors"]:
            needs = sorted(term["name"] for term in one["terms"] if term["verdict"] == "needed")
            who, of = rf"(?:^|: |\. ){re.escape(one['id'])}", len(one["terms"])
            first = re.findall(rf"{who} needs {LISTED} of (\d+) terms?\.", block.text)
            head = rf"{who} \(\w+, class [^)]*\): (\d+) of (\d+) terms? (?:is|are) needed(?:: {LISTED})?\."
            told = [(len(names(said)), int(total), names(said)) for said, total in first]
            told += [(int(n), int(total), names(said)) for n, total, said in re.findall(head, block.text)]
            if any(said != (len(needs), of, needs) for said in told):
                yield f"{block.text}: {one['id']} needs {needs} of {of}"


def wrong_lots(result: Found) -> Iterator[str]:
    """Answers of a class-level result that its units' verdicts do not give: of a class, and in a scene."""
    terms, told = result["lots"]["terms"], {}
    for one in result["lots"]["classes"]:
        found = {name: _answer(one, k) for k, name in enumerate(terms)}
        told[one["id"]] = found
        if found != {term["name"]: term["answer"] for term in one["terms"]}:
            yield f"{one['id']}: {found}"
        for answer in ("needed", "not needed", "cannot tell"):
            if one[answer.replace(" ", "_")] != [name for name in terms if found[name] == answer]:
                yield f"{one['id']}: {answer}: {found}"
    for scene in result["scenes"]:
        own = {one["name"]: _inside(told[scene["sensor"]][one["name"]], one) for one in scene["terms"]}
        for key, answer in (
            ("model", "needed"),
            ("would_matter", "would matter"),
            ("cannot_tell", "cannot tell"),
        ):
            if scene[key] != [name for name in own if own[name] == answer]:
                yield f"{scene['sensor']} in {scene['name']}: {key}: {own}"


def _answer(one: Found, k: int) -> str:
    """Of a class on its k-th term: what most units say; where half see nothing, what all say together."""
    said = [unit["verdicts"][k] for unit in one["units"]]
    needed, idle = said.count("needed"), said.count("not needed")
    if 2 * (needed + idle) <= len(said):
        pooled = one["terms"][k].get("pooled", {"inclusion": 0.0})
        together = pooled["inclusion"] >= 0.95 and pooled["share"]["value"] >= 0.5
        return "needed" if together else "cannot tell"
    return "needed" if needed >= idle else "not needed"


def _inside(told: str, one: Found) -> str:
    """Answer on a term in a scene, from that of the class."""
    wanted = one["required"] >= 0.5
    if told == "needed":
        return "needed" if wanted else "not needed"
    return "would matter" if wanted or (told == "cannot tell" and one["share_of_budget"] >= 0.1) else told
