"""``[[scene]]`` tables become missions: what the sensors will see, and what their error may come to."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from imubayes.campaign.study import Mission
from imubayes.errors import StudyError
from imubayes.rig.runs import OUTPUT_UNIT
from imubayes.rig.scene_ranges import scene_named
from imubayes.rig.scenes import BODY, Scene, read_scene
from imubayes.rig.trajectories import MANNERS, generated
from imubayes.selection.kernels import BUDGET_UNITS, Budget, Quantity
from imubayes.sensors.terms import Kind
from imubayes.study.schema.run_tables import columns_of, located
from imubayes.study.schema.shapes import Place, hint, quantity, shaped
from imubayes.study.schema.tables import SceneTable

CHANNELS = ("t", *(f"{what}_{axis}" for what in ("f", "w", "dw") for axis in BODY), "T")
"""Channels of a log."""


def scenes_of(
    tables: Sequence[object], folder: Path, place: Place, seed: int, kinds: Collection[Kind]
) -> tuple[Mission, ...]:
    """Check the scenes of a study, and read or generate them.

    Parameters
    ----------
    tables : one for each scene.
    folder : of the study's file.
    place : of the list, for errors.
    seed : of the study. With the catalogue's scene it decides a trajectory, whatever other scenes there are,
        and by whatever name the study calls it.
    kinds : of the study's sensors: a budget of the output has the unit of one kind.

    Raises
    ------
    StudyError : naming the key.
    """
    return tuple(_mission(raw, folder, place.at(k), seed, kinds) for k, raw in enumerate(tables))


def _mission(raw: object, folder: Path, place: Place, seed: int, kinds: Collection[Kind]) -> Mission:
    table = shaped(SceneTable, raw, place)
    budget, kind = _budget(table, kinds, place.at("budget"))
    scene = _generated(table, seed, place) if table.file is None else _logged(table, folder, place)
    return Mission(table.name or scene.name, scene, budget, table.axis, kind)


def _generated(table: SceneTable, seed: int, place: Place) -> Scene:
    """Trajectory of a scene of the catalogue: `scene` says of which, or `name` alone."""
    key, of = ("name", table.name) if table.scene is None else ("scene", table.scene)
    if of is None:
        raise place.error("expected the name of a catalogue scene, or the file of a log, came neither")
    if table.columns or table.ignore:
        raise place.at("columns").error("a scene of the catalogue has no file: leave it out, or give one")
    with place.at(key).blamed():
        ranges = scene_named(of)
    rng = np.random.default_rng([seed, zlib.crc32(ranges.id.encode())])
    return generated(ranges, rng, duration=table.duration)


def _logged(table: SceneTable, folder: Path, place: Place) -> Scene:
    """Scene from a log."""
    if table.scene is not None:
        raise place.at("scene").error("a log is no scene of the catalogue: leave out this or the file")
    file = table.file or ""
    columns = columns_of(table.columns, CHANNELS, "", place.at("columns"))
    with place.at("file").blamed():
        path = located(file, folder)
        name, lasting = table.name or "", table.duration
        return read_scene(path, name=name, columns=columns, duration=lasting, ignore=table.ignore)


def _budget(table: SceneTable, kinds: Collection[Kind], place: Place) -> tuple[Budget, Kind | None]:
    """Read the budget, and the kind that it is for; None where it is for both."""
    known = list(get_args(Quantity))
    for key in table.budget:
        if key not in known:
            raise place.at(key).error(f"is nothing that a budget can be of: {hint(key, known)}")
    if len(table.budget) != 1:
        came = ", ".join(table.budget) or "none"
        raise place.error(
            f'expected one of {", ".join(known)}, such as {{ position = "100 m" }}, came {came}'
        )
    ((key, text),) = table.budget.items()
    schuler = not _is_free(table)
    if key == "output":
        kind, limit = _output(text, kinds, place.at(key))
        return Budget("output", limit, schuler), kind
    quantity_of: Quantity = next(name for name in get_args(Quantity) if name == key)
    return Budget(
        quantity_of, quantity(text, BUDGET_UNITS[quantity_of], place.at(key), positive=True), schuler
    ), None


def _output(text: Any, kinds: Collection[Kind], place: Place) -> tuple[Kind, float]:
    """Limit of an error of the output, and the kind of the study's sensors that its unit is of."""
    wrong: list[StudyError] = []
    for kind in sorted(set(kinds)):
        try:
            return kind, quantity(text, OUTPUT_UNIT[kind], place, positive=True)
        except StudyError as error:
            wrong.append(error)
    raise wrong[0]


def _is_free(table: SceneTable) -> bool:
    """Whether the vehicle keeps no local level: as the study says, or as the scene of the catalogue does."""
    if table.free_flight is not None:
        return table.free_flight
    manner = MANNERS.get((table.scene or table.name or "").replace("-", "_"))
    return table.file is None and manner is not None and manner.rest == 0.0
