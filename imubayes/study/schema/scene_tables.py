"""``[[scene]]`` tables become missions, ``[[appendix]]`` tables what a CSV file holds."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Literal, cast, get_args

from imubayes.campaign import Appendix, Mission
from imubayes.errors import StudyError
from imubayes.rig.recordings import OUTPUT_UNIT
from imubayes.scenes import ANGLES, BODY, QUATERNION, Scene, read_scene
from imubayes.scenes.propagation import BUDGET_UNITS, Budget, Quantity
from imubayes.scenes.trajectories import MANNERS, drawn, scene_named
from imubayes.sensors.terms import Kind
from imubayes.study.schema.run_tables import columns_of, located
from imubayes.study.schema.shapes import (
    Place,
    Table,
    Text,
    Texts,
    arguments,
    hint,
    holds,
    key,
    quantity,
    shape,
    shaped,
    table_of,
)
from imubayes.study.schema.tables import Columns
from imubayes.units import Key, NumberLimits, Seconds, quantities

CHANNELS = ("t", *(f"{what}_{axis}" for what in ("f", "w", "dw") for axis in BODY), "T", *ANGLES, *QUATERNION)
"""Channels of a log."""

DRAWS = 3
"""Draws of a catalogue scene where the study doesn't say how many."""

LONGEST = 200
"""Rows of a table that a report can show; a longer one is data."""

_BUDGETS = {
    "type": "object",
    "properties": {name: quantities(BUDGET_UNITS.get(name, "output")) for name in get_args(Quantity)},
    "additionalProperties": False,
    "minProperties": 1,
    "maxProperties": 1,
}


APPENDIX = table_of(
    Appendix,
    "AppendixTable",
    "[[appendix]]",
    needed="file",
    more={
        "file": Annotated[
            Text, Key("CSV, UTF-8, commas: a line of headings and at most 200 rows", "speed.csv")
        ]
    },
)


@shape
class SceneTable:
    """``[[scene]]``."""

    name: Text | None = key(
        "catalogue scene; with `scene` or `file`, what to call it. In a class-level study each scene has"
        " another",
        "quadrotor",
        None,
        "needed, or `file`",
    )
    scene: Text | None = key(
        "catalogue scene, where `name` is another: so that one scene can stand twice, with the same motion"
        " and another budget",
        "helicopter",
        None,
        "`name`",
    )
    file: Text | None = key(
        "log of `t` and any of `f_i f_j f_k w_i w_j w_k dw_i dw_j dw_k T`, along the case axes x, y, z, in"
        " any format of a run. Forces are specific forces: at rest +g upwards. Attitude comes from `roll"
        " pitch yaw` or `q_w q_x q_y q_z`; without them it is followed from the rate",
        "flight.csv",
        None,
    )
    columns: Columns = key(
        "as `[sensor.run.columns]`, with `file` only", {"f_k": "az [g]"}, dict, "the file's own"
    )
    ignore: Texts = key("as in `[[sensor.run]]`, with `file` only", ["f_0"], [])
    duration: Seconds | None = key(
        "of the mission; the motion of a shorter record is repeated, its temperature runs on (of a log:"
        " stays)",
        "10 min",
        None,
        "the record's; of a catalogue scene the middle of its range",
    )
    draws: Annotated[int, NumberLimits(ge=1, le=20)] | None = key(
        "of a catalogue scene: how often it is generated, each time with other phases; the largest error of"
        " all counts, of the output the rms over all",
        5,
        None,
        f"{DRAWS}; a log is one",
    )
    budget: Annotated[Table, holds(_BUDGETS)] = key(
        "what the error may come to, one quantity: `output` (rms, in the unit of one kind of sensor, and"
        " only for this kind), `attitude`, `velocity` or `position` (largest over the mission)",
        {"position": "100 m"},
    )
    axis: Literal["x", "y", "z"] = key(
        "case axis that a sensor's input axis lies along; the components of a triad have their own", "z", "x"
    )
    free_flight: bool | None = key(
        "the navigator keeps no local level, so that errors are not held by gravity (Schuler); true for"
        " `gun_projectile`, `reentry_spin` and `spacecraft`",
        True,
        None,
        "by the scene",
    )


def scenes_of(
    tables: Sequence[object], place: Place, seed: int, kinds: Collection[Kind]
) -> tuple[Mission, ...]:
    """Check the scenes of a study, and read or generate them; an output's budget is of one kind.

    The seed decides a trajectory with the catalogue's scene, whatever other scenes there are, and by whatever
    name the study calls it.
    """
    missions = list[Mission]()
    for k, raw in enumerate(tables):
        here = place.at(k)
        table = shaped(SceneTable, raw, here)
        budget, kind = _budget(table, kinds, here.at("budget"))
        scene = _generated(table, seed, here) if table.file is None else _logged(table, here)
        missions.append(Mission(table.name or scene.name, scene, budget, table.axis, kind))
    return tuple(missions)


def _generated(table: SceneTable, seed: int, place: Place) -> Scene:
    """Trajectory of a scene of the catalogue: `scene` says of which, or `name` alone."""
    key, of = ("name", table.name) if table.scene is None else ("scene", table.scene)
    if of is None:
        raise place.error("expected the name of a catalogue scene, or the file of a log, came neither")
    if table.columns or table.ignore:
        raise place.at("columns").error("a scene of the catalogue has no file: leave it out, or give one")
    with place.at(key).blamed():
        ranges = scene_named(of)
    of_scene = (seed, zlib.crc32(ranges.id.encode()))
    seeds = [of_scene, *((*of_scene, k) for k in range(1, table.draws or DRAWS))]
    return drawn(ranges, seeds, duration=table.duration)


def _logged(table: SceneTable, place: Place) -> Scene:
    if table.scene is not None:
        raise place.at("scene").error("a log is no scene of the catalogue: leave out this or the file")
    if table.draws is not None:
        raise place.at("draws").error("a log is not drawn again: leave out this or the file")
    columns = columns_of(table.columns, CHANNELS, "", place.at("columns"))
    with place.at("file").blamed():
        path, name = located(table.file or "", place), table.name or ""
        return read_scene(path, name=name, columns=columns, duration=table.duration, ignore=table.ignore)


def _budget(table: SceneTable, kinds: Collection[Kind], place: Place) -> tuple[Budget, Kind | None]:
    """Read the budget, and the kind that it is for; None where it is for both."""
    known = list(get_args(Quantity))
    for asked in table.budget:
        if asked not in known:
            raise place.at(asked).error(f"is nothing that a budget can be of: {hint(asked, known)}")
    if len(table.budget) != 1:
        came = ", ".join(table.budget) or "none"
        raise place.error(
            f'expected one of {", ".join(known)}, such as {{ position = "100 m" }}, came {came}'
        )
    ((asked, text),) = cast("dict[Quantity, object]", table.budget).items()
    manner = MANNERS.get((table.scene or table.name or "").replace("-", "_"))
    free = table.free_flight  # no local level is kept: as the study says, or as the catalogue's scene does
    if free is None:
        free = table.file is None and manner is not None and manner.rest == 0.0
    if asked != "output":
        limit = quantity(text, BUDGET_UNITS[asked], place.at(asked), positive=True)
        return Budget(asked, limit, not free), None
    wrong: list[StudyError] = []
    for kind in sorted(set(kinds)):  # its unit says of which
        try:
            limit = quantity(text, OUTPUT_UNIT[kind], place.at(asked), positive=True)
            return Budget("output", limit, not free), kind
        except StudyError as error:
            wrong.append(error)
    raise wrong[0]


def appendix(raw: object, place: Place) -> Appendix:
    """Check one table from elsewhere and read its file."""
    given, here = arguments(APPENDIX, raw, place), place.at("file")
    file = given.pop("file")
    lines = _lines(located(file, place), file, here)
    if len(lines) < 2:
        raise here.error(f"{file}: expected a line of headings and at least one row")
    if len(lines) - 1 > LONGEST:
        raise here.error(
            f"{file}: has {len(lines) - 1} rows: expected at most {LONGEST}; give a summary of it"
        )
    (_, header), *rows = lines
    for number, row in rows:
        if len(row) != len(header):
            raise here.error(
                f"{file}, line {number}: expected {len(header)} fields, as many as headings, came {len(row)}"
            )
    return Appendix(**given, header=header, rows=tuple(row for _, row in rows))


def _lines(path: Path, shown: str, place: Place) -> list[tuple[int, tuple[str, ...]]]:
    """Lines of a CSV file that hold something: their numbers and fields."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True, skipinitialspace=True)
            return [(reader.line_num, tuple(map(str.strip, row))) for row in reader if any(row)]
    except UnicodeDecodeError:
        raise place.error(f"{shown}: is not a text in UTF-8: expected a CSV file") from None
    except (FileNotFoundError, ValueError):
        raise place.error(f"{shown}: there is no such file (looked for {path})") from None
    except IsADirectoryError:
        raise place.error(f"{shown}: is a directory: expected a CSV file") from None
    except OSError as error:
        raise place.error(f"{shown}: cannot be read ({error.strerror}): check its permissions") from None
    except csv.Error as error:
        raise place.error(f"{shown}: is not a CSV file: {error}") from None
