"""Tables of a study file: the keys of each, what a value of each may be, and what it means.

Each key is described once, here or where its value is used: `docs/study.md`, `docs/plan.md` and the JSON
Schema are made of it.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from imubayes.campaign import NoiseQuestion, Sampling
from imubayes.ladder import Method
from imubayes.rig.plans import normal_gravity
from imubayes.rig.recordings import Procedure
from imubayes.rig.sequences import Dwell
from imubayes.rig.simulate import PROFILES
from imubayes.sensors.terms import library
from imubayes.study.schema.shapes import Several, Table, Text, Texts, holds, key, shape, table_of
from imubayes.units import Acceleration, Angle, Hertz, Key, NumberLimits, Positive, Rate, Seconds, quantities

_TEXT = {"type": "string"}
_TABLE = {"type": "object"}
ESTIMATED = {"enum": ["estimate", "white"]}


def by_kind(half: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a table with a value for each kind of component."""
    return {
        "type": "object",
        "properties": {"accelerometer": half, "gyroscope": half},
        "additionalProperties": False,
    }


SAMPLING = table_of(Sampling, "SamplingTable", "[sampling]")
NOISE = table_of(NoiseQuestion, "NoiseTable", "[noise]")
LIBRARY = table_of(library, "LibraryTable", "[sensor.library]")
SITE = table_of(normal_gravity, "SiteTable", "gravity")
STEP = table_of(Dwell, "StepOptions", "steps", within=True)

_STEPPED = ("tumble", "positions", "free-tumble", "rate-table", "centrifuge")
"""Profiles whose dwells can be given one by one."""

_STEPS = {
    "steps": Annotated[
        tuple[STEP, ...],
        Key("the dwells in an order and with times of their own, see `steps`", [{"at": 1, "dwell": "1 min"}]),
    ]
}


@cache
def simulated(profile: str) -> type:
    """Shape of the options of a profile that can be simulated: the arguments of its function."""
    return table_of(
        PROFILES[profile],
        f"{profile}-options",
        profile,
        needed="positions" if profile == "positions" else "",  # it alone tells of a standard set
        more=_STEPS if profile in _STEPPED else None,
    )


CALLED = {"positions": "tumble", "vibration": "other"}
"""What a study calls the profiles that have no procedure of their own."""


def _column_name(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int) or value == "":
        raise ValueError("expected a column's name, or its number counted from 0")
    return value


@shape
class HeaderTable:
    """``[study]``."""

    title: str = key("heading of the report", "ACC-07 acceptance", "", "name of the file")
    seed: Annotated[int, NumberLimits(ge=0)] = key(
        "of simulated runs, of generated scenes and of posterior draws", 1, 0
    )
    catalogue: Text | None = key(
        "TOML file of [own classes](#own-classes), for the `class` of a sensor", "own.toml", None
    )
    method: Method = key(
        "[how the posterior is computed](#how-the-posterior-is-computed): a method of the ladder, or the one"
        " that is right for each sensor, as the report says",
        "collapsed",
        "auto",
    )


@shape
class DecisionTable:
    """``[decision]``."""

    false_keep: Positive = key(
        "cost of a term kept that is zero; only its ratio to `false_drop` counts", 1.0, 1.0
    )
    false_drop: Positive = key("cost of a term dropped that is not zero", 4.0, 1.0)
    hierarchy: bool = key(
        "a term may only be in a model that has what it modifies: `b3` calls for `b1`, `b1p` for `b1`,"
        " `b0*T2` for `b0*T`",
        True,
        False,
    )
    compare: bool = key(
        "run the other methods too (criteria, sparse regression, other priors), beside the decision",
        False,
        True,
    )


@shape
class SectionTable:
    """``sections``: one of those of a run of a whole IMU or of one triad."""

    rows: Annotated[tuple[int, int], Several] = key(
        "first row, and the row after the last, counted from 0", [540, 1271]
    )
    up: Literal["x", "-x", "y", "-y", "z", "-z", ""] = key(
        "of `ferraris`: the case axis that points up, `x`, `-x`, `y`, `-y`, `z` or `-z`",
        "-x",
        "",
        "needed by `ferraris`, else refused",
    )
    turn: Annotated[Angle | None, holds(quantities("rad"))] = key(
        "of `ferraris`: angle of the turn, right-handed about the axis that points up",
        "-360 deg",
        None,
        "at rest",
    )
    rate: Annotated[Rate | None, holds(quantities("rad/s"))] = key(
        "of gyroscopes in a `free-tumble`: the rate of the table, which is constant; its sign is the sense,"
        " and no direction in the case is known",
        "-100 deg/s",
        None,
        "needed there, else refused",
    )


@shape
class ColumnTable:
    """``[sensor.run.columns]``: a channel of it."""

    column: Annotated[Any, AfterValidator(_column_name), holds(_TEXT, {"type": "integer"})] = key(
        "name in the file, with or without its unit; number counted from 0; `raw[:,0,3]` for a column of an"
        " array",
        "adc",
        None,
        "the channel's name",
    )
    unit: Text | None = key(
        "unit of the file's numbers; one that does not measure the channel, like `count` or `V`, needs a"
        " `scale`",
        "g",
        None,
        "the one in the header",
    )
    scale: Annotated[Text | None, holds(quantities("channel's unit per `unit`"))] = key(
        "needs `unit`", "2.4e-3 m/s^2/count", None, "that of `unit`"
    )
    offset: Annotated[Text | None, holds(quantities("like `unit`"))] = key(
        "subtracted first; needs `unit`", "33124 count", None, "0"
    )
    wraps: Annotated[Text | None, holds(quantities("like `unit`"))] = key(
        "of `t` only: where the clock starts again from its lowest value, so that each step counts modulo"
        " it; a step must be shorter than it. Needs `unit`",
        "4294967296 count",
        None,
    )
    rate: Annotated[Hertz | None, holds(quantities("Hz"))] = key(
        "of `t` only, alone: of a file without a clock, whose rows come at a constant rate", "100 Hz", None
    )


Columns = Annotated[Table, holds(_TEXT, {"type": "integer"}, ColumnTable, {"type": "array"}, many="name")]


@shape
class FixedNoiseTable:
    """``noise`` that is given, or another run's."""

    N: Annotated[Any, holds(quantities("output/sqrt(Hz)"))] = key(
        "white noise: velocity or angle random walk; two-sided, so a one-sided noise density over sqrt(2)",
        "60 ug/sqrt(Hz)",
        None,
        "needed",
    )
    B: Annotated[Any, holds(quantities("output"))] = key(
        "bias instability: the Allan deviation's floor over 0.664", "40 ug", None, "0"
    )
    K: Annotated[Any, holds(quantities("output/sqrt(s)"))] = key(
        "random walk of the output", "0.3 ug/sqrt(s)", None, "0"
    )
    run: Annotated[Any, holds(_TEXT)] = key(
        "alone: a run of the sensor with a noise of its own, such as a static log", "log", None, "-"
    )


@shape
class StillsTable:
    """``stills``: what is rest in the hand."""

    window: Annotated[Seconds | None, holds(quantities("s"))] = key(
        "over which rest is told from motion", "0.5 s", None, '`"1 s"`'
    )
    threshold: Annotated[Acceleration | None, holds(quantities("m/s^2"))] = key(
        "standard deviation of the force (root of the sum over its axes) in a window, below which it is rest",
        "0.1 m/s^2",
        None,
        "from the record",
    )


@shape
class RunTable:
    """``[[sensor.run]]``."""

    name: Text = key("name in the report, unique in the sensor", "tumble")
    procedure: Procedure = key(
        "`tumble`, `centrifuge`, `rate-table`, `oscillation`, `thermal`, `static`, `other`: inputs are"
        " known. `free-tumble`: held in many positions by hand, only gravity is known; an accelerometer"
        " triad or an IMU, and no other procedure in the same sensor; of gyroscopes alone, turned in many"
        " positions at known rates. `ferraris`: known positions and turns"
        " of an IMU or of its gyroscopes alone, or known positions of a triad",
        "centrifuge",
    )
    file: Text | None = key(
        "recording; `$IMUBAYES_DATA/...` is in the folder that this variable names; where it is not set, in"
        " `../../shared/data` from the study",
        "tumble.csv",
        None,
    )
    columns: Columns = key("`[sensor.run.columns]`", {"output": "adc [g]"}, dict, "the file's own")
    dwell: Annotated[Seconds | None, holds(quantities("s"))] = key(
        "of a [table of means](#a-table-of-means): how long each row was averaged",
        "60 s",
        None,
        "column `dwell`, else rows are samples",
    )
    ignore: Texts = key(
        "columns of the file that are no channel, though their names are nearly those of one that the file"
        " does not have",
        ["f_q"],
        [],
    )
    gravity: Annotated[Any, holds(quantities("m/s^2"), SITE)] = key(
        "local gravity, or the place",
        "9.8123 m/s^2",
        None,
        "needed by a recorded `free-tumble` (but of gyroscopes alone) or `ferraris`, else refused",
    )
    noise: Annotated[Any, holds(ESTIMATED, FixedNoiseTable, by_kind(_TABLE))] = key(
        "[noise](#noise) of this run", {"run": "log"}, None, "the sensor's"
    )
    simulate: Annotated[Table | None, holds(*(f"{profile}-options" for profile in PROFILES))] = key(
        "makes the run in place of a file, see [simulate](#simulate)", {"angles": 12}, None
    )
    source: str = key(
        "where a public file comes from, for the message when it is missing",
        "github.com/Kyle-ak/imu_tk (BSD)",
        "",
    )
    gyroscope_file: Text | None = key(
        "of an IMU whose gyroscopes have a file of their own, with the same time stamps", "gyro.csv", None
    )
    stills: Annotated[Table | None, holds(StillsTable)] = key(
        "of a `free-tumble`: [what is rest](#stills)", {"window": "0.5 s"}, None
    )
    sections: Annotated[list[Table], holds(SectionTable, many="list")] = key(
        "[positions and turns](#sections)",
        [{"rows": [0, 500], "up": "x"}],
        list,
        "needed by `ferraris`, and by gyroscopes alone in a `free-tumble`, else refused",
    )


Runs = Annotated[list[Table], holds(RunTable, many="list")]
LibraryOf = Annotated[Table, holds(LIBRARY)]
PriorOf = Annotated[Table, holds(quantities("like the term"), _TABLE, many="name")]
ReferenceOf = Annotated[Table, holds("ReferenceTable")]
CAMPAIGN = [{"name": "A", "procedure": "tumble", "simulate": {"angles": 12}}]


@shape
class SensorTable:
    """``[[sensor]]``."""

    id: Text = key("name in the report, unique", "ACC-07")
    kind: Literal["accelerometer", "gyroscope", "imu"] = key(
        "`accelerometer`, `gyroscope`, or `imu` for [six components in one case](#a-whole-imu)",
        "accelerometer",
    )
    class_: Annotated[Text | Table | None, holds(_TEXT, by_kind(_TEXT))] = key(
        "class of the catalogue (`imubayes catalogue`): gives the priors of coefficients and noise. Without"
        " one, each term alone may move the output by its whole range, and the noise prior is vague;"
        " simulated runs, free tumbles and whole IMUs need one. Of an IMU also one for each kind,"
        ' `{ accelerometer = "...", gyroscope = "..." }`',
        "mems_tactical",
        None,
        alias="class",
    )
    library: Annotated[Table, holds(LIBRARY, by_kind(_TABLE))] = key(
        "candidate terms, `[sensor.library]`", {"powers": 2}, dict, "its defaults"
    )
    noise: Annotated[Any, holds(ESTIMATED, FixedNoiseTable, by_kind(_TABLE))] = key(
        "[noise](#noise) of the runs that have no `noise` of their own", "white", None, '`"estimate"`'
    )
    prior: PriorOf = key(
        "prior sd of terms, in place of the class's (`imubayes catalogue CLASS` lists these, with units):"
        " what this lot may have",
        {"b0": "100 mg", "m_j": "20 mrad"},
        dict,
        "from the class",
    )
    truth: PriorOf = key(
        "coefficients of *simulated* runs; the analysis does not see them. A term that is not named is zero;"
        " terms outside the library are allowed. Of an IMU by component, `ax.b0`. Empty: a unit is drawn"
        " from the class",
        {"b0": "1.5 mg", "b2": "42 ug/g^2"},
        dict,
        "drawn from the class",
    )
    reference: ReferenceOf = key(
        "[errors of the test bench](#sensorreference) that are allowed for", {"gravity": True}, dict
    )
    bench: Literal["exact", "drawn"] | None = key(
        "`exact`: no error of the bench is in doubt but those of `reference`. Of *simulated* runs `drawn`"
        " makes them on a bench whose errors are drawn once from `reference`; the inputs of the runs do not"
        " say so. Where nothing is said of a bench, simulated runs are made on an exact one, of which the"
        " analysis [does not know](#what-bench-and-library-lack)",
        "exact",
        None,
        "nothing is said",
    )
    robust: bool = key(
        "lets single dwells be contaminated (a knock, a wrong position, a spike): they lose their weight,"
        " and the report lists them; of a test in the hand a still that was touched. Not for `ferraris`",
        True,
        False,
    )
    accept_prior_conflict: bool = key(
        "takes a recorded output that is 50 prior sds or more from its class, or looks like one with a wrong"
        " unit, sign or axis, which is refused else",
        True,
        False,
    )
    unit: Text | None = key(
        "the physical unit, where several sensors of the study are sessions of one; they need the same kind"
        " and library. The report then compares the sessions; of four units of a class or more it says what"
        " they have in common",
        "ACC-07",
        None,
    )
    session: Text | None = key(
        "which session of the `unit`; both or neither, and each pair once", "Monday", None
    )
    run: Runs = key(
        "one `[[sensor.run]]` for each recording",
        [{"name": "A", "procedure": "static", "file": "a.csv"}],
        list,
        "needed",
    )


@shape
class StudyFile:
    """A study file."""

    study: Annotated[Table, holds(HeaderTable)] = Field(default_factory=dict)
    sampling: Annotated[Table, holds(SAMPLING)] = Field(default_factory=dict)
    decision: Annotated[Table, holds(DecisionTable)] = Field(default_factory=dict)
    noise: Annotated[Table, holds(NOISE)] = Field(default_factory=dict)
    sensor: Annotated[list[Table], holds(SensorTable, many="list")] = Field(default_factory=list)
    lots: Annotated[Table | None, holds("LotsTable")] = None
    fleet: Annotated[Table | None, holds("FleetTable")] = None
    plan: Annotated[Table | None, holds("PlanTable")] = None
    scene: Annotated[list[Table], holds("SceneTable", many="list")] = Field(default_factory=list)
    appendix: Annotated[list[Table], holds("AppendixTable", many="list")] = Field(default_factory=list)
