"""One ``[[sensor.run]]`` table becomes a `RunSpec`."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from imubayes import units
from imubayes.rig.columns import ColumnSpec, channel_unit
from imubayes.rig.inputs import DWELL, RunSection
from imubayes.rig.plans import normal_gravity
from imubayes.rig.recordings import (
    CASES,
    FERRARIS,
    FREE_TUMBLE,
    IMU_CHANNELS,
    KNOWN_IMU_CHANNELS,
    OUTPUT_UNIT,
    RUN_CHANNELS,
    TRIADS,
    RunSpec,
)
from imubayes.rig.simulate import PROFILES
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import Kind
from imubayes.study.schema import tables
from imubayes.study.schema.shapes import Place, arguments, hint, quantity, shaped, shown

DATA_VARIABLE = "IMUBAYES_DATA"
"""Environment variable that names the folder of public data; a file may start with ``$IMUBAYES_DATA/``."""

DATA_DEFAULT = Path("../shared/data")
"""Folder of public data where the variable is not set, relative to the folder that holds ``studies/``."""

_COUNTABLE = 2.0**53
"""Whole numbers beyond this one have gaps in double precision."""


def run_spec(raw: object, kind: Kind, place: Place, *, imu: bool = False) -> RunSpec:
    """Check one run of a sensor."""
    run = shaped(tables.RunTable, raw, place)
    turntable = run.procedure == FREE_TUMBLE and kind == "gyroscope" and not imu
    if turntable and run.simulate is not None:
        raise place.at("procedure").error(
            'is simulated with accelerometers: expected kind = "accelerometer" or "imu", or another procedure'
        )
    _check_imu(run, place, imu=imu, turntable=turntable)
    if (run.file is None) == (run.simulate is None):
        raise place.error(
            f"expected either file or simulate, came {'neither' if run.file is None else 'both'}"
        )
    there = place.at("sections")
    return RunSpec(
        name=run.name,
        procedure=run.procedure,
        file=None if run.file is None else located(run.file, place),
        shown=run.file or "",
        columns=_columns(run, kind, place.at("columns"), imu=imu),
        gravity=_local_gravity(run, place.at("gravity"), needed=run.procedure in CASES and not turntable),
        noise=noise_rule(run.noise, kind, place.at("noise")),
        simulate=None if run.simulate is None else _simulation(run, place),
        origin=run.source,
        gyroscope_file=None if run.gyroscope_file is None else located(run.gyroscope_file, place),
        gyroscope_shown=run.gyroscope_file or "",
        ignore=run.ignore,
        **_resting(run, place.at("stills"), turntable=turntable),
        dwell=run.dwell or 0.0,
        sections=tuple(_section(own, there.at(k), turntable=turntable) for k, own in enumerate(run.sections)),
    )


def _check_imu(run: tables.RunTable, place: Place, *, imu: bool, turntable: bool) -> None:
    if not imu and run.gyroscope_file is not None:
        raise place.at("gyroscope_file").error('expected it beside kind = "imu" only: leave it out')
    if turntable and not run.sections:
        raise place.at("sections").error(
            "expected when gyroscopes alone were turned, and how fast, in ten directions or more, such as"
            ' [{ rows = [0, 3000], rate = "100 deg/s" }, { rows = [3500, 6500], rate = "-100 deg/s" }]'
        )
    if not turntable and (run.procedure == FERRARIS) != bool(run.sections):
        raise place.at("sections").error(
            "expected the positions and turns of a run of procedure 'ferraris', and no other, such as"
            ' [{ rows = [0, 500], up = "x" }, { rows = [900, 1200], up = "x", turn = "360 deg" }]'
        )


def _resting(run: tables.RunTable, place: Place, *, turntable: bool) -> dict[str, float]:
    if run.stills is None:
        return {}
    if run.procedure != FREE_TUMBLE or turntable:
        raise place.error("only accelerometers in a free-tumble have stills to look for: leave it out")
    return {
        f"still_{name}": value for name, value in arguments(tables.StillsTable, run.stills, place).items()
    }


def _section(raw: object, place: Place, *, turntable: bool) -> RunSection:
    table = shaped(tables.SectionTable, raw, place)
    needed, given = ("rate", table.rate) if turntable else ("up", table.up)
    if not given and given != 0.0:
        raise place.at(needed).error(
            'the key is missing: expected the rate of the table, such as "-100 deg/s"'
            if turntable
            else "the key is missing: expected the case axis that points up, such as -x"
        )
    others = ("up", "turn") if turntable else ("rate",)
    if strange := [name for name in others if getattr(table, name) not in (None, "")]:
        raise place.at(strange[0]).error(
            "of gyroscopes alone in a free-tumble no direction is known: expected rate alone"
            if turntable
            else 'is of kind = "gyroscope" in a free-tumble: leave it out, and give the angle as turn'
        )
    if turntable and not table.rate:
        raise place.at("rate").error("expected a rate that is not zero")
    return RunSection(*table.rows, table.up, table.turn or 0.0, table.rate or 0.0)


def noise_rule(raw: object, kind: Kind, place: Place) -> NoiseRule:
    """Read ``"estimate"``, ``"white"``, ``{ N = ..., B = ..., K = ... }`` or ``{ run = "static" }``."""
    if raw is None or raw == "estimate":
        return NoiseRule()
    if raw == "white":
        return NoiseRule("white")
    if not isinstance(raw, dict) or not raw:
        wanted = '"estimate", "white", { N = "...", B = "...", K = "..." } or { run = "..." }'
        raise place.error(f"expected {wanted}, came {shown(raw)}")
    if raw.keys() == {"run"}:
        return NoiseRule("fixed", like=str(raw["run"]))
    shaped(tables.FixedNoiseTable, raw, place)
    unit = OUTPUT_UNIT[kind]
    likes = {"N": f"{unit}/sqrt(Hz)", "B": unit, "K": f"{unit}/sqrt(s)"}
    N, B, K = (quantity(raw[key], like, place.at(key)) if key in raw else 0.0 for key, like in likes.items())
    if not N > 0.0 or min(B, K) < 0.0:
        raise place.error("expected white noise N above zero, and neither B nor K below zero")
    return NoiseRule("fixed", Noise(N, B, K))


def located(file: str, place: Place) -> Path:
    """Path of a study's file: absolute, in the folder of public data, or relative to the study."""
    variable, slash, rest = file.partition("/")
    if variable == f"${DATA_VARIABLE}" and slash:
        data = os.environ.get(DATA_VARIABLE)
        return (Path(data) if data else (place.folder.resolve().parent / DATA_DEFAULT).resolve()) / rest
    return place.folder / file


def _columns(run: tables.RunTable, kind: Kind, place: Place, *, imu: bool) -> dict[str, ColumnSpec]:
    if run.simulate is not None and run.dwell:
        raise place.error("a simulated run is no table of means: leave 'dwell' out of it")
    if run.simulate is not None and (run.columns or run.ignore):
        raise place.error("a simulated run has no file whose columns could differ: leave it out")
    if imu:
        known = IMU_CHANNELS if run.procedure in CASES else KNOWN_IMU_CHANNELS
        for channel in run.columns:  # each component has other axes i, j, k
            if channel in RUN_CHANNELS and channel not in known and channel != "output":
                raise place.at(channel).error(
                    "is along an axis of a component: the inputs of a whole IMU are along the axes of the"
                    " case, f_x f_y f_z, w_x w_y w_z, dw_x dw_y dw_z"
                )
    else:
        known = ("t", *TRIADS[kind], DWELL) if run.procedure in CASES else RUN_CHANNELS
    return columns_of(run.columns, known, OUTPUT_UNIT[kind], place)


def columns_of(
    raw: Mapping[str, Any], known: Collection[str], output_unit: str, place: Place
) -> dict[str, ColumnSpec]:
    """Check the table of columns of a file: where it has a channel under another name, unit or scale."""
    columns = {}
    for channel, entry in raw.items():
        here = place.at(channel)
        if channel not in known:
            raise here.error(f"is not a channel of this file: {hint(channel, list(known))}")
        columns[channel] = _channel(entry, channel, channel_unit(channel, output_unit), here)
    return columns


def _channel(entry: object, channel: str, like: str, place: Place) -> ColumnSpec:
    """Check what the study says of a channel: a column, its table, or those that add up to a clock."""
    if isinstance(entry, list) and channel == "t" and len(entry) > 1:
        return ColumnSpec(parts=tuple(_channel(part, "t", like, place.at(k)) for k, part in enumerate(entry)))
    table = shaped(tables.ColumnTable, entry if isinstance(entry, dict) else {"column": entry}, place)
    for name, does in (("wraps", "wraps around"), ("rate", "comes at a rate")):
        if getattr(table, name) and channel != "t":
            raise place.at(name).error(f"only the clock, channel t, {does}: leave it out")
    if table.rate is None:
        return _column(table, like, place)
    if table.column is not None or table.unit is not None:
        raise place.at("rate").error("is of a file without a clock: expected it alone")
    return ColumnSpec(rate=table.rate)


def _column(table: tables.ColumnTable, like: str, place: Place) -> ColumnSpec:
    """Scale (SI per file unit), offset and wrap (in file units) of a column, from quantities with units."""
    if table.unit is None:
        if table.scale or table.offset or table.wraps:
            raise place.error(
                'scale, offset and wraps need the unit of the file\'s numbers, such as unit = "count"'
            )
        return ColumnSpec(table.column)
    with place.at("unit").blamed():
        size = units.factor(table.unit, table.unit if table.scale else like)
    scale = offset = wraps = None
    if table.scale is not None:
        scale = size * quantity(table.scale, f"{like}/({table.unit})", place.at("scale"))
        if scale == 0.0:
            raise place.at("scale").error("expected a scale that is not zero")
    if table.offset is not None:
        offset = quantity(table.offset, table.unit, place.at("offset")) / size
    if table.wraps is not None:
        wraps = quantity(table.wraps, table.unit, place.at("wraps"), positive=True) / size
        if wraps > _COUNTABLE:
            raise place.at("wraps").error(
                f"expected at most 2^53 of the file's unit, came {shown(table.wraps)}"
            )
        if math.isclose(wraps, round(wraps), rel_tol=1e-14):  # it lost its last bit on the way from SI
            wraps = float(round(wraps))
    return ColumnSpec(table.column, table.unit, scale, offset, wraps)


def _local_gravity(run: tables.RunTable, place: Place, *, needed: bool) -> float | None:
    if not needed:
        if run.gravity is not None:
            raise place.error(
                "gyroscopes that are turned in unknown directions need no gravity: leave it out"
                if run.procedure in CASES
                else f"only {' and '.join(CASES)} runs need it: leave it out, and give the inputs in the file"
            )
        return None
    if run.simulate is not None:
        if run.gravity is not None:
            raise place.error("is of a recorded run: expected it among the keys of simulate")
        return None
    if run.gravity is None:
        wanted = '"9.81 m/s^2" or { latitude = "45 deg", height = "100 m" }'
        raise place.error(f"the key is missing: a {run.procedure} run needs {wanted}")
    if isinstance(run.gravity, dict):
        return normal_gravity(**arguments(tables.SITE, run.gravity, place))
    return quantity(run.gravity, "m/s^2", place, positive=True)


def _simulation(run: tables.RunTable, place: Place) -> dict[str, object]:
    profile = run.procedure
    if profile == tables.CALLED["positions"] and "positions" in (run.simulate or {}):
        profile = "positions"  # a tumble with these is a standard set
    elif profile == tables.CALLED["vibration"]:
        profile = "vibration"
    if profile not in PROFILES:
        known = ", ".join(dict.fromkeys(tables.CALLED.get(profile, profile) for profile in PROFILES))
        raise place.at("procedure").error(f"'{run.procedure}' cannot be simulated: expected one of {known}")
    return {"profile": profile, **arguments(tables.simulated(profile), run.simulate, place.at("simulate"))}
