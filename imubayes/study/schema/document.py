"""JSON Schema of a study file: editors complete and check studies by it, and docs/ is made of it."""

from __future__ import annotations

from types import ModuleType
from typing import Annotated, Any

from pydantic import TypeAdapter
from pydantic.dataclasses import is_pydantic_dataclass

from imubayes.rig.bench import KINDS, OFFSET
from imubayes.rig.simulate import PROFILES
from imubayes.study.schema import plan_tables, scene_tables, shapes, tables, unit_tables
from imubayes.study.schema.sensor_tables import ESTIMATE
from imubayes.study.schema.shapes import holds
from imubayes.units import factor, quantities

_EACH = {
    "bench": "the same in all runs",
    "machine": "one for each procedure",
    "run": "another in each run",
    "mount": "another in each mount",
}
"""What a kind of error is one error of, in words."""


def _reference() -> type:
    """Shape of ``[sensor.reference]``: the kinds of errors, with the sizes that the catalogue has."""
    kinds, values = dict[str, Any](), dict[str, Any]()
    for kind in KINDS.values():
        text = quantities("like the output" if kind.name == OFFSET else kind.unit)
        ways = [text, {"type": "boolean"}, *([tables.by_kind(text)] if kind.name == OFFSET else [])]
        ways += [{"enum": [ESTIMATE]}] if kind.each == "mount" else []
        size = kind.default and f"{kind.default / factor(kind.printed, kind.unit):g} {kind.printed}"
        kinds[kind.name] = Annotated[Any, holds(*ways)]
        meaning = f"{kind.text}, {_EACH[kind.each]}"
        values[kind.name] = shapes.key(
            meaning, size or f"1 {kind.printed}", None, f'`"{size}"`' if size else "none"
        )
    made = {"__annotations__": kinds, "__doc__": "``[sensor.reference]``.", **values}
    return shapes.shape(type("ReferenceTable", (), made))


def _shapes(*modules: ModuleType) -> list[type]:
    return [kind for module in modules for kind in vars(module).values() if is_pydantic_dataclass(kind)]


SHAPES: dict[str, Any] = {
    shape.__name__: shape
    for shape in (
        *_shapes(tables),
        *map(tables.simulated, PROFILES),
        _reference(),
        *_shapes(unit_tables, plan_tables, scene_tables),
    )
    if shape is not unit_tables.UnitsTable
}
"""Tables of a study file, by the name of their shape."""


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file; ``usual`` is a default in words, ``quantity (s)`` a text with a unit."""
    defined = {name: _tidy(TypeAdapter(shape).json_schema()) for name, shape in SHAPES.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **defined.pop(tables.StudyFile.__name__),
        "$defs": defined,
    }


def _tidy(value: Any) -> Any:
    """Leave out what TOML has not (null), and what only repeats a key; refer to tables by their shapes."""
    if isinstance(value, list):
        return [_tidy(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    if ways := [way for way in value.pop("anyOf", []) if way != {"type": "null"}]:
        value = {**value, "anyOf": ways} if len(ways) > 1 else {**ways[0], **value}
    if isinstance(value.get("table"), str):
        value["$ref"] = f"#/$defs/{value.pop('table')}"
    empty = "default" in value and value["default"] in (None, "", [], {})
    left_out = {"$defs", "default" if empty else "", "title" if isinstance(value.get("title"), str) else ""}
    return {key: _tidy(entry) for key, entry in value.items() if key not in left_out}
