"""Make the tables of keys in docs/study.md and docs/plan.md, and docs/study.schema.json.

Run it by ``python docs/update_study.py`` where imubayes is installed. It prints nothing. The first table of
keys under a heading that is a table of a study (``### `[sampling]` ``) is replaced, and so is every table
whose header names a part of a result (``| `terms[]` | value | meaning |``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imubayes.reporting.result.file import result_schema
from imubayes.study.schema.document import SHAPES, study_schema

DOCS = Path(__file__).resolve().parent
PAGES = ("study.md", "plan.md")
HEADER = "| key | value | default | meaning | example |\n|---|---|---|---|---|\n"
SORTS = {
    "string": "text",
    "integer": "integer",
    "number": "number",
    "boolean": "true or false",
    "object": "table",
}
MANY = {"text": "texts", "table": "tables", "integer": "integers", "number": "numbers"}
RESULTS = {
    "result.json": "SensorsResult",
    "sensors[]": "Sensor",
    "terms[]": "Term",
    "mcmc": "Mcmc",
    "extras[]": "Extra",
    "scenes[]": "Scene",
    "scenes[].terms[]": "TermInScene",
    "cases[]": "Case",
    "recovered[]": "RecoveredErrors",
    "sessions[]": "Sessions",
    "population[]": "Population",
    "population[].terms[]": "PopulationTerm",
    "result.json of lots": "LotsResult",
    "lots": "Lots",
    "classes[]": "Class",
    "classes[].terms[]": "ClassTerm",
    "methods[] of lots": "Agreement",
    "units[]": "Unit",
    "scenes[] of lots": "ClassInScene",
    "scenes[].terms[] of lots": "ClassTermInScene",
    "result.json of a fleet": "FleetResult",
    "fleet": "Fleet",
    "fleet.terms[]": "FleetTerm",
    "result.json of a plan": "PlanResult",
    "plan": "Plan",
    "plan.terms[]": "PlannedTerm",
    "plans[]": "PlanFound",
    "result.json of hours": "HoursResult",
    "hours": "Hours",
    "hours.classes[]": "ClassHours",
    "hours.classes[].terms[]": "TermHours",
    "result.json of a trade": "TradeResult",
    "rungs[]": "Rung",
    "scores[]": "RungScore",
    "components[]": "Component",
    "components[].rungs[]": "ComponentRung",
}
"""Parts of a result that have a table of their own, by its header."""


def main() -> None:
    """Write the schema and the pages."""
    for name, text in made().items():
        (DOCS / name).write_text(text, encoding="utf-8")


def made() -> dict[str, str]:
    """Texts of the files, by their names."""
    schema = study_schema()
    tables = dict(keyed(schema["$defs"]))
    parts = result_schema()["$defs"]
    pages = {
        name: published(filled((DOCS / name).read_text(encoding="utf-8"), tables), parts) for name in PAGES
    }
    return {"study.schema.json": lines_of(schema) + "\n", **pages}


def lines_of(value: Any, depth: int = 4, indent: str = "\n") -> str:
    """JSON with a line for each key of a table of a study."""
    if not depth or not isinstance(value, dict) or not value:
        return json.dumps(value, ensure_ascii=False)
    inner = f"{indent} "
    keys = [f"{json.dumps(key)}: {lines_of(one, depth - 1, inner)}" for key, one in value.items()]
    return f"{{{inner}{f',{inner}'.join(keys)}{indent}}}"


def keyed(shapes: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Heading of each table of a study, and its keys as Markdown."""
    for name, shape in shapes.items():
        heading = re.match(r"``(.*?)``", SHAPES[name].__doc__)
        if heading:
            yield (
                heading[1],
                HEADER + "".join(row(key, one, shape) for key, one in shape["properties"].items()),
            )


def filled(page: str, tables: dict[str, str]) -> str:
    """Page with its tables of keys made again."""
    parts = re.split(r"(^#+ .*\n)", page, flags=re.M)
    for k in range(1, len(parts), 2):
        table = tables.get(parts[k].strip("#` \n"))
        if table:
            parts[k + 1] = re.sub(
                rf"{re.escape(HEADER)}(\|.*\n)*", lambda _, table=table: table, parts[k + 1], count=1
            )
    return "".join(parts)


def published(page: str, parts: dict[str, Any]) -> str:
    """Page with its tables of a result's keys made again."""
    for header, name in RESULTS.items():
        head = f"| `{header}` | value | meaning |\n|---|---|---|\n"
        rows = "".join(
            f"| `{key}` | {sort(one)} | {one['description']} |\n"
            for key, one in parts[name]["properties"].items()
        )
        page = re.sub(rf"{re.escape(head)}(\|.*\n)*", lambda _, made=head + rows: made, page)
    return page


def row(key: str, one: dict[str, Any], shape: dict[str, Any]) -> str:
    """One key: what it takes, what it is without it, what it means."""
    default = "needed" if key in shape.get("required", ()) else usual(one)
    example = f"`{key} = {toml(one['examples'][0])}`" if "examples" in one else ""
    return f"| `{key}` | {sort(one)} | {default} | {one.get('description', '')} | {example} |\n"


def usual(one: dict[str, Any]) -> str:
    """Default in words, or as it would stand in the file."""
    return one.get("usual") or (f"`{toml(one['default'])}`" if "default" in one else "none")


def sort(one: dict[str, Any]) -> str:
    """What a value may be, in words.

    Examples
    --------
    >>> sort({"type": "integer", "minimum": 1}), sort({"type": "array", "items": {"type": "string"}})
    ('integer, 1 or more', 'list of texts')
    """
    if "anyOf" in one:  # what may be null says so by its meaning
        ways = [way for way in one["anyOf"] if way != {"type": "null"}]
        return " or ".join(dict.fromkeys(sort(way).partition(",")[0] for way in ways))
    if one.get("type") == "array":
        items = sort(one["prefixItems"][0] if "prefixItems" in one else one.get("items", {}))
        size = f"{one['minItems']} " if "minItems" in one else ""
        named = MANY.get(items) or items.replace("quantity", "quantities").replace("list of", "lists of", 1)
        return f"list of {size}{named}"
    if "format" in one:
        return one["format"]
    words = SORTS[one.get("type", "object" if "$ref" in one else "string")]
    if "minimum" in one:
        return f"{words}, {one['minimum']} or more"
    return f"{words} above {one['exclusiveMinimum']}" if "exclusiveMinimum" in one else words


def toml(value: Any) -> str:
    """Value as it stands in a study.

    Examples
    --------
    >>> toml({"at": 1, "dwell": "1 min"})
    '{ at = 1, dwell = "1 min" }'
    """
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {toml(one)}' for key, one in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(toml(one) for one in value)}]"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    main()
