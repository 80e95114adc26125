"""The tables ``[lots]`` and ``[fleet]``, of many units, become a `LotStudy` and a `FleetStudy`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from imubayes.campaign import Mission, SensorSpec
from imubayes.population import FleetStudy, Unit, simulated_units
from imubayes.population.lots import Against, LotStudy
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.rig.simulate import plan_run
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import coupled, sensor
from imubayes.sensors.catalogue_file import campaign_of
from imubayes.sensors.terms import Kind
from imubayes.study.schema.run_tables import located
from imubayes.study.schema.scene_tables import scenes_of
from imubayes.study.schema.sensor_tables import headed, sensor_spec
from imubayes.study.schema.shapes import (
    Names,
    Place,
    Text,
    arguments,
    hint,
    holds,
    key,
    shape,
    shaped,
    shown,
    table_of,
    unique,
)
from imubayes.study.schema.tables import (
    CAMPAIGN,
    ESTIMATED,
    FixedNoiseTable,
    LibraryOf,
    PriorOf,
    ReferenceOf,
    Runs,
    StudyFile,
)
from imubayes.units import Count, NumberLimits

FEWEST = 2
"""Units below which nothing can be said of a population."""

WANTED = (
    'expected a number of simulated units, such as 1000, or a pattern of folders or files, such as "data/*"'
)

AGAINST = table_of(Against, "AgainstTable", "[lots.asks]")


@shape
class UnitsTable:
    """Keys that lots and a fleet have in common."""

    kind: Kind = key("`accelerometer` or `gyroscope`", "accelerometer")
    processes: Count = key(
        "of this machine that share the work; of a fleet with `--scheduler` the workers do", 4, 2
    )
    library: LibraryOf = key("candidate terms, as `[sensor.library]`", {"powers": 2}, dict, "its defaults")
    reference: ReferenceOf = key(
        "errors of the test bench, as `[sensor.reference]`: of simulated units drawn anew for each, and"
        " allowed for in its analysis",
        {"gravity": True},
        dict,
    )
    run: Runs = key(
        "the campaign, as `[[sensor.run]]`: with `simulate`, or of a fleet with a `file` in each unit's"
        " folder",
        CAMPAIGN,
        list,
        "needed",
    )


@shape
class LotsTable(UnitsTable):
    """``[lots]``."""

    classes: Names = key(
        "classes of the catalogue (`imubayes catalogue`), in the order of the report",
        ["mems_tactical", "strategic_piga"],
    )
    units: Annotated[int, NumberLimits(ge=2)] = key("simulated of each lot", 10, 8)
    lots: Count = key("drawn of each class, each with magnitudes of its own within the class", 3, 1)
    campaign: Literal["same", "class"] = key(
        "`same`: all classes go through `[[lots.run]]`. `class`: each goes through the test that fits it, on"
        " a bench as its laboratories have (`imubayes catalogue CLASS` shows it), in place of `[[lots.run]]`"
        " and `[lots.reference]`",
        "class",
        "same",
    )
    methods: Annotated[int, NumberLimits(ge=0)] = key(
        "units of each lot about which the other methods are asked, too, up to `units`, and 0 for none:"
        " criteria, predictive scores and sparse regressions (some 10 s of compute a unit), and chains about"
        " the first unit of each class (a minute or two)",
        1,
        0,
    )
    basic: bool = key(
        "say too what the basic triad of 12 parameters would leave, by class and scene", True, False
    )
    asks: Annotated[Any, holds({"enum": ["classes", "scenes", "triad"]}, AGAINST)] = key(
        "what the report answers first, as its title asks: what each class needs (`classes`), what each"
        " scene requires (`scenes`), whether the basic triad is enough (`triad`), or what some classes need"
        " and others do not (a table `[lots.asks]`)",
        "classes",
        "classes",
    )


@shape
class FleetTable(UnitsTable):
    """``[fleet]``."""

    class_: Text = key("class of the catalogue, or of the study's own", "mems_tactical", alias="class")
    units: Annotated[Any, holds({"type": "integer", "minimum": 2}, {"type": "string"})] = key(
        "number of simulated units, 2 or more; or a pattern of folders (or files, where no folder matches),"
        ' each a unit named by it, such as `units = "lot7/*"`',
        1000,
    )
    part: Count = key("units that are done, and kept, together", 20, 8)
    noise: Annotated[Any, holds(ESTIMATED, FixedNoiseTable)] = key(
        "of every unit, as in `[[sensor]]`", "white", None, '`"estimate"`'
    )
    prior: PriorOf = key("of every unit, as in `[[sensor]]`", {"b2": "100 ug/g^2"}, dict, "the class's")
    robust: bool = key("dwells of every unit that outliers have contaminated are left out", True, False)


def lot_study(tables: StudyFile, place: Place, text: str) -> LotStudy:
    """Check a class-level study."""
    about, header, own = headed(tables, place, text, "a class-level study")
    here, there = place.at("lots"), place.at("scene")
    table = shaped(LotsTable, tables.lots, here)
    entries = _classes(table, own, here.at("classes"))
    if table.methods > table.units:
        raise here.at("methods").error(
            f"expected at most the {table.units} units of a lot (units), came {table.methods}"
        )
    specs = [_lot_campaign(table, entry, own, here) for entry in entries]
    for k, run in enumerate(specs[0].runs):
        if run.simulate is None:
            raise here.at("run", k).error("units of a lot are simulated: expected simulate, not a file")
    lib = replace(specs[0].library, technology="", ties=())
    missions = scenes_of(tables.scene, there, header.seed, {table.kind})
    unique([mission.name for mission in missions], "name", there)
    return LotStudy(
        **about,
        kind=table.kind,
        specs=tuple(
            replace(spec, library=coupled(lib, entry)) for spec, entry in zip(specs, entries, strict=True)
        ),
        units=table.units,
        lots=table.lots,
        library=lib,
        missions=missions,
        basic=table.basic,
        processes=table.processes,
        asks=_asks(table, missions, here.at("asks")),
        methods=table.methods,
    )


def _lot_campaign(
    table: LotsTable, entry: SensorClass, own: Sequence[SensorClass], place: Place
) -> SensorSpec:
    """Test campaign of a class: the study's, or the one that fits the class."""
    if table.campaign == "same":
        return _campaign(table, entry.id, own, place)
    for name in ("run", "reference"):
        if getattr(table, name):
            raise place.at(name).error("comes with each class's campaign (campaign = 'class'): leave it out")
    with place.at("classes").blamed():
        fits = campaign_of(entry)
    return _campaign(table, entry.id, own, place, run=fits["run"], reference=fits["reference"])


def fleet_study(tables: StudyFile, place: Place, text: str) -> FleetStudy:
    """Check a study of a fleet."""
    about, _, own = headed(tables, place, text, "a study of a fleet")
    here = place.at("fleet")
    table = shaped(FleetTable, tables.fleet, here)
    with here.at("class").blamed():
        entry = sensor(table.class_, kind=table.kind, catalogue=own)
    units = _units(table, here.at("units"))
    return FleetStudy(
        **about,
        spec=_fleet_campaign(table, units, own, here),
        sensor_class=entry,
        units=units,
        part=table.part,
        processes=table.processes,
    )


def _campaign(
    table: UnitsTable, class_id: str, own: Sequence[SensorClass], place: Place, **other: Any
) -> SensorSpec:
    """Check the test campaign as that of a sensor of one class: it is the same for all units."""
    raw = {"id": class_id, "kind": table.kind, "class": class_id}
    raw |= {"library": table.library, "reference": table.reference, "run": table.run}
    return sensor_spec(raw | other, place, own)


def _classes(table: LotsTable, own: Sequence[SensorClass], place: Place) -> tuple[SensorClass, ...]:
    classes = list[SensorClass]()
    if not table.classes:
        raise place.error("expected the id of at least one class ('imubayes catalogue' lists them)")
    for k, name in enumerate(table.classes):
        if name in table.classes[:k]:
            raise place.at(k).error(f"'{name}' is there already: expected each class once")
        with place.at(k).blamed():
            classes.append(sensor(name, kind=table.kind, catalogue=own))
    return tuple(classes)


def _asks(
    table: LotsTable, scenes: Sequence[Mission], place: Place
) -> Literal["classes", "scenes", "triad"] | Against:
    """What the report answers first, which the study must give an answer to."""
    if isinstance(table.asks, dict):
        asked = Against(**arguments(AGAINST, table.asks, place))
        for group, names in (("needed_by", asked.needed_by), ("not_by", asked.not_by)):
            if not names:
                raise place.at(group).error("expected at least one of the study's classes")
            for k, name in enumerate(names):
                if name not in table.classes:
                    raise place.at(group, k).error(
                        f"'{name}' is not among the classes: {hint(name, table.classes)}"
                    )
        if both := sorted(set(asked.needed_by) & set(asked.not_by)):
            raise place.error(f"'{both[0]}' is in needed_by and in not_by: expected it in one of them")
        return asked
    if table.asks not in ("classes", "scenes", "triad"):
        raise place.error(
            "expected 'classes', 'scenes', 'triad' or { needed_by = [...], not_by = [...] }, came"
            f" {table.asks!r}"
        )
    if table.asks == "scenes" and not scenes:
        raise place.error("'scenes' asks what each scene requires: expected at least one [[scene]]")
    if table.asks == "triad" and not (scenes and table.basic):
        raise place.error(
            "'triad' asks where the basic triad is enough: expected basic = true, and at least one [[scene]]"
        )
    return table.asks


def _units(table: FleetTable, place: Place) -> tuple[Unit, ...]:
    asked = table.units
    if isinstance(asked, int) and not isinstance(asked, bool):
        if asked < FEWEST:
            raise place.error(f"expected {FEWEST} units or more, came {asked}")
        return simulated_units(table.class_, asked)
    if not isinstance(asked, str) or not asked:
        raise place.error(f"{WANTED}, came {shown(asked)}")
    parts = located(asked, place).absolute().parts
    fixed = next((k for k, part in enumerate(parts) if re.search(r"[*?\[]", part)), len(parts) - 1)
    base, pattern = Path(*parts[:fixed]), str(Path(*parts[fixed:]))
    places = sorted(path for path in base.glob(pattern) if not path.name.startswith("."))
    places = [path for path in places if path.is_dir()] or places
    if len(places) < FEWEST:
        raise place.error(
            f"'{asked}' matches {len(places)} folders or files: expected {FEWEST} units or more"
        )
    names = [path.relative_to(base) for path in places]  # they start where the pattern does
    bare = [name if path.is_dir() else name.with_suffix("") for name, path in zip(names, places, strict=True)]
    names = bare if len(set(bare)) == len(bare) else names
    return tuple(Unit(k, name.as_posix(), places[k]) for k, name in enumerate(names))


def _fleet_campaign(
    table: FleetTable, units: Sequence[Unit], own: Sequence[SensorClass], place: Place
) -> SensorSpec:
    """Check the test campaign as that of the first unit: it is the same for all."""
    first, runs = units[0].place, table.run
    in_files = first is not None and not first.is_dir()
    if in_files:
        here = place.at("run")
        if len(runs) != 1:
            raise here.error(
                f"units are files, such as {units[0].name}: expected one run, came {len(runs)}; with several"
                " runs a unit is a folder"
            )
        if "file" in runs[0]:
            raise here.at(0, "file").error(f"units are files, such as {units[0].name}: leave it out")
        runs = [{**runs[0], "file": str(first)}]
    other = {"prior": table.prior, "noise": table.noise, "robust": table.robust, "run": runs}
    there = replace(place, base=first)
    spec = _campaign(table, table.class_, own, there, id=units[0].name, **other)
    _check_runs(spec, simulated=first is None, place=place.at("run"))
    return replace(spec, runs=tuple(replace(run, shown="") for run in spec.runs)) if in_files else spec


def _check_runs(spec: SensorSpec, *, simulated: bool, place: Place) -> None:
    for k, run in enumerate(spec.runs):
        if run.procedure == FREE_TUMBLE:
            raise place.at(k, "procedure").error(
                "a unit of a fleet is one component: expected a procedure with known inputs"
            )
        if simulated and run.simulate is None:
            raise place.at(k).error("a number of units are simulated: expected simulate, not a file")
        if not simulated and run.simulate is not None:
            raise place.at(k).error("units are recorded: expected a file in each unit's folder, not simulate")
        with place.at(k, "simulate").blamed():
            _ = plan_run(run) if simulated else None
