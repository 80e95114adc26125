"""Numbers of a page, held against those that its result has of what it names."""

import math
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

from page_reading import NUMBER, Block, drawn, sentences, tree, written

from imubayes.reporting.lots_words import class_name, slug
from imubayes.reporting.method_views import METHODS, called
from imubayes.reporting.rounding import NOISE, OUTPUT_SI, OUTPUT_UNIT, noise_unit, per_unit

NAMED_BY = ("id", "name", "parameter", "rung", "treatment", "method", "family")
"""Keys under which a part of a result has its name: the first of them that is there."""

UNNAMED = frozenset({"runs", "residuals", "dependences", "plans", "extras"})
"""Parts whose numbers a page tells without their names."""

BULK = frozenset({"units", "errors", "covariance", "pulls", "provenance", "machine", "steps", "calibration"})
"""Parts that no sentence is of."""

Names = frozenset[str]
Units = tuple[float, ...]


class Grounds:
    """Numbers of a result by what they are of, in SI and in the units in which a page prints them.

    Lengths of lists, counts of each verdict, sums, and distances from the largest of a list are numbers too.
    """

    def __init__(self, result: dict[str, Any]) -> None:
        self._all: dict[Names, set[float]] = {}
        self._known = {*METHODS, *NOISE["accelerometer"], *_named(result)}
        self._walk(result, frozenset(), (1.0,), "")
        self._sizes = {names: sorted(sizes) for names, sizes in self._all.items()}
        self._forms = {name: _forms_of(name) for names in self._sizes for name in names}
        self._places = _places(result)
        alone = [one for key in ("sensors", "scores") for one in result.get(key, ())]
        self._alone = " ".join(map(_name, alone)) if len(alone) == 1 else ""

    def names(self, block: Block) -> Names:
        """What a text is of: what it names, and what its section does."""
        over = [one for one in self._places if f"{block.anchor}-".startswith(f"{one}-")]
        place = self._places[max(over, key=len)] if over else ""
        text = f"{block.text} {place} {self._alone}".lower()
        return frozenset(
            name
            for name, forms in self._forms.items()
            if any(
                form in text and re.search(rf"(?<![\w*-]){re.escape(form)}(?![\w*-])", text) for form in forms
            )
        )

    def hold(self, names: Names, value: float, half: float) -> bool:
        """Whether the result has a number, within half of its last digit, of what has these names."""
        off = 1.02 * half + 1e-9 * abs(value)
        for of, sizes in self._sizes.items():
            k = bisect_left(sizes, abs(value) - off) if of <= names else len(sizes)
            if k < len(sizes) and sizes[k] <= abs(value) + off:
                return True
        return False

    def _walk(self, node: Any, names: Names, units: Units, key: str) -> Counter[tuple[str, Any]]:
        """Keep the numbers of a part; returns how often each word stands in it under each key."""
        told: Counter[tuple[str, Any]] = Counter()
        if isinstance(node, str | bool):
            return Counter({(key, node): 1})
        if isinstance(node, dict):
            own = names if key in UNNAMED else names | _own(node)
            units = _printed(node, units)
            for name, one in node.items():
                if name in self._known:
                    told += self._walk(one, own | {name}, _of_noise(name, units), key)
                elif name not in BULK:
                    told += self._walk(one, own, units, name)
                elif isinstance(one, list):
                    self._put(own, len(one))
            names = own
        elif isinstance(node, list):
            for one in node:
                told += self._walk(one, names, units, key)
            self._put(names, len(node))
            numbers = [one for one in node if isinstance(one, float | int)]
            self._put(names, math.fsum(numbers), *(one - max(numbers) for one in numbers))
        elif node is not None:
            self._put(names, *(node / unit for unit in units))
        self._put(names, *told.values())
        return told

    def _put(self, names: Names, *values: float) -> None:
        self._all.setdefault(names, set()).update(abs(one) for one in values if math.isfinite(one))


def _name(node: dict[str, Any]) -> str:
    return next((node[by] for by in NAMED_BY if isinstance(node.get(by), str)), "")


def _own(node: dict[str, Any]) -> Names:
    """Names of a part: of a scene, also the sensor that flies it; the decision is what a page is of."""
    return frozenset({name, node.get("sensor", "")} if (name := _name(node)) else ()) - {"", "decision"}


def _named(node: Any, key: str = "") -> Iterator[str]:
    if isinstance(node, dict):
        yield from () if key in UNNAMED else _own(node)
        for name, one in node.items():
            yield from () if name in BULK else _named(one, name)
    elif isinstance(node, list):
        for one in node:
            yield from _named(one, key)


def _printed(node: dict[str, Any], units: Units) -> Units:
    """SI values of the units of a part's numbers on a page; of a term also its prior's sd, and the needed."""
    if node.get("kind") in OUTPUT_UNIT:
        units = (1.0, per_unit(OUTPUT_UNIT[node["kind"]], OUTPUT_SI[node["kind"]]))
    if "printed_unit" in node and "unit" in node:
        units = (1.0, per_unit(node["printed_unit"], node["unit"]))
    return (*units, *(node[key] for key in ("prior_sd", "needed_sd") if node.get(key)))


def _of_noise(name: str, units: Units) -> Units:
    """SI values of the units of a noise process, of either kind of sensor."""
    found = [noise_unit(name, kind)[1] for kind, processes in NOISE.items() if name in processes]
    return (1.0, *found) if found else units


def _forms_of(name: str) -> set[str]:
    """A name as a page may write it."""
    forms = (name, name.replace("_", " "), class_name(SimpleNamespace(id=name)), called(name))
    return {form.lower() for form in forms}


def _places(result: dict[str, Any]) -> dict[str, str]:
    """What the sections of a page are of, by their anchors."""
    found = {f"s{k}": one["id"] for k, one in enumerate(result.get("sensors", ()), start=1)}
    found |= {f"case{k}": _name(one) for k, one in enumerate(result.get("cases", ()), start=1)}
    found |= {f"treatment-{k}": one["treatment"] for k, one in enumerate(result.get("treated", ()))}
    for scene in result.get("scenes", ()) if "lots" in result else ():
        owner, name = scene["sensor"], scene["name"]
        found |= {slug("class", owner): owner, slug("scene", name): name}
        found[slug("class", owner, name)] = f"{owner} {name}"
    return found


MADE = ("repeat", "runs", "appendices")
"""Sections on how a page was made."""

LEVELS = ("90", "95", "0.95", "0.05")
"""Numbers that say how to read a page."""


def explained(html: str, grounds: Grounds, said: Callable[[str], str] = str) -> float:
    """Share of a page's numbers, of two digits or more, that its result has of what the text is of.

    Parameters
    ----------
    said : what each number is read as.
    """
    page, found = tree(html), []
    for block in (*sentences(page), *drawn(page)):
        names = grounds.names(block)
        for number in NUMBER.finditer(block.text) if block.anchor not in MADE else ():
            digits = re.sub(r"e.*|\D", "", number[0]).strip("0")
            named = re.search(r"[A-Za-z]-?$", block.text[: number.start()])  # the unit A-12
            if len(digits) > 1 and number[0] not in LEVELS and not named:
                (value, half), *_ = written(said(number[0]) + block.text[number.end() :][:8])
                found.append(grounds.hold(names, value, half))
    return sum(found) / len(found)
