"""The ``[fleet]`` table becomes a `FleetStudy`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic.dataclasses import dataclass as shape

from imubayes.campaign.study import SensorSpec
from imubayes.population.parts import FleetStudy, Unit, recorded_units, simulated_units
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.rig.runs import plan_run
from imubayes.sensors.catalogue import sensor
from imubayes.sensors.sensor_class import SensorClass
from imubayes.study.schema.measured import STRICT, Count, Holds, Text, key
from imubayes.study.schema.run_tables import located
from imubayes.study.schema.sensor_tables import own_classes, sensor_spec
from imubayes.study.schema.shapes import Place, shaped, shown
from imubayes.study.schema.tables import (
    CAMPAIGN,
    ESTIMATED,
    FixedNoiseTable,
    HeaderTable,
    Kind,
    LibraryOf,
    PriorOf,
    ReferenceOf,
    Runs,
    StudyFile,
)

FEWEST = 2
"""Units below which nothing can be said of a population."""

WANTED = (
    'expected a number of simulated units, such as 1000, or a pattern of folders or files, such as "data/*"'
)


@shape(config=STRICT, frozen=True, kw_only=True)
class FleetTable:
    """``[fleet]``."""

    kind: Kind = key("`accelerometer` or `gyroscope`", "accelerometer")
    class_: Text = key("class of the catalogue, or of the study's own", "mems_tactical", alias="class")
    units: Annotated[Any, Holds({"type": "integer", "minimum": 2}, {"type": "string"})] = key(
        "number of simulated units, 2 or more; or a pattern of folders (or files, where no folder matches),"
        ' each a unit named by it, such as `units = "lot7/*"`',
        1000,
    )
    part: Count = key("units that are done, and kept, together", 20, 8)
    processes: Count = key("of this machine that share the work; with `--scheduler` the workers do", 8, 2)
    library: LibraryOf = key("candidate terms, as `[sensor.library]`", {"powers": 2}, dict, "its defaults")
    reference: ReferenceOf = key(
        "errors of the test bench, as `[sensor.reference]`; of simulated units drawn anew for each",
        {"gravity": True},
        dict,
    )
    noise: Annotated[Any, Holds(ESTIMATED, FixedNoiseTable)] = key(
        "of every unit, as in `[[sensor]]`", "white", None, '`"estimate"`'
    )
    prior: PriorOf = key("of every unit, as in `[[sensor]]`", {"b2": "100 ug/g^2"}, dict, "the class's")
    robust: bool = key("dwells of every unit that outliers have contaminated are left out", True, False)
    run: Runs = key(
        "the campaign, as `[[sensor.run]]`: with `simulate`, or with a `file` in each unit's folder",
        CAMPAIGN,
        list,
        "needed",
    )


def fleet_study(tables: StudyFile, path: Path, text: str) -> FleetStudy:
    """Check a study of a fleet.

    Parameters
    ----------
    tables : of the file.
    path, text : of the file.

    Raises
    ------
    StudyError : naming the key.
    """
    place = Place(str(path))
    header = shaped(HeaderTable, tables.study, place.at("study"))
    here = place.at("fleet")
    table = shaped(FleetTable, tables.fleet, here)
    if header.method not in ("auto", "exact"):
        raise place.at("study").at("method").error("a study of a fleet is exact: leave it out")
    own = own_classes(header.catalogue, path.parent, place.at("study").at("catalogue"))
    with here.at("class").blamed():
        entry = sensor(table.class_, kind=table.kind, catalogue=own)
    units = _units(table, path.parent, here.at("units"))
    return FleetStudy(
        title=header.title or path.stem,
        seed=header.seed,
        spec=_campaign(table, units, own, here),
        sensor_class=entry,
        units=units,
        part=table.part,
        processes=table.processes,
        path=path,
        text=text,
    )


def _units(table: FleetTable, folder: Path, place: Place) -> tuple[Unit, ...]:
    asked = table.units
    if isinstance(asked, int) and not isinstance(asked, bool):
        if asked < FEWEST:
            raise place.error(f"expected {FEWEST} units or more, came {asked}")
        return simulated_units(table.class_, asked)
    if not isinstance(asked, str) or not asked:
        raise place.error(f"{WANTED}, came {shown(asked)}")
    names, places = _matching(located(asked, folder).absolute())
    if len(places) < FEWEST:
        raise place.error(
            f"'{asked}' matches {len(places)} folders or files: expected {FEWEST} units or more"
        )
    return recorded_units(names, places)


def _matching(pattern: Path) -> tuple[list[str], list[Path]]:
    """Folders that match a pattern, or files where none does; their names start where the pattern does."""
    fixed = next(
        (k for k, part in enumerate(pattern.parts) if re.search(r"[*?\[]", part)), len(pattern.parts) - 1
    )
    base = Path(*pattern.parts[:fixed])
    found = sorted(
        one for one in base.glob(str(Path(*pattern.parts[fixed:]))) if not one.name.startswith(".")
    )
    chosen = [one for one in found if one.is_dir()] or found
    names = [one.relative_to(base).as_posix() for one in chosen]
    bare = [
        one if place.is_dir() else str(Path(one).with_suffix(""))
        for one, place in zip(names, chosen, strict=True)
    ]
    return bare if len(set(bare)) == len(bare) else names, chosen


def _campaign(
    table: FleetTable, units: Sequence[Unit], catalogue: Sequence[SensorClass], place: Place
) -> SensorSpec:
    """Check the test campaign as that of the first unit: it is the same for all."""
    first = units[0].place
    in_files = first is not None and not first.is_dir()
    raw = {
        "id": units[0].name,
        "kind": table.kind,
        "class": table.class_,
        "library": table.library,
        "reference": table.reference,
        "prior": table.prior,
        "noise": table.noise,
        "robust": table.robust,
        "run": _in_file(table.run, units[0], place.at("run")) if in_files else table.run,
    }
    spec = sensor_spec(raw, first or Path(), place, catalogue=catalogue)
    _check_runs(spec, simulated=first is None, place=place.at("run"))
    return replace(spec, runs=tuple(replace(run, shown="") for run in spec.runs)) if in_files else spec


def _in_file(runs: Sequence[Any], unit: Unit, place: Place) -> list[Any]:
    """Give the only run of units that are files its file."""
    if len(runs) != 1:
        raise place.error(
            f"units are files, such as {unit.name}: expected one run, came {len(runs)}; with several runs "
            "a unit is a folder"
        )
    if "file" in runs[0]:
        raise place.at(0).at("file").error(f"units are files, such as {unit.name}: leave it out")
    return [{**runs[0], "file": str(unit.place)}]


def _check_runs(spec: SensorSpec, *, simulated: bool, place: Place) -> None:
    for k, run in enumerate(spec.runs):
        if run.procedure == FREE_TUMBLE:
            raise (
                place.at(k)
                .at("procedure")
                .error("a unit of a fleet is one component: expected a procedure with known inputs")
            )
        if simulated and run.simulate is None:
            raise place.at(k).error("a number of units are simulated: expected simulate, not a file")
        if not simulated and run.simulate is not None:
            raise place.at(k).error("units are recorded: expected a file in each unit's folder, not simulate")
        with place.at(k).at("simulate").blamed():
            _ = plan_run(run) if simulated else None
