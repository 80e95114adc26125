"""A study that is begun from a recording: its columns are guessed, and what it cannot tell is asked for.

What is guessed stands in the file with the reason beside it. What nobody but the user knows is `ASKED` (a
study that still has one does not load, and the message lists them) or a comment that begins with ``ask:``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import DataError, InputError
from imubayes.inference.stills import find_stills
from imubayes.rig.columns import channel_unit, nearly
from imubayes.rig.formats import FileTable, bare, bracketed, read_table, rows_in, tables_of
from imubayes.rig.inputs import DWELL, MOUNT, SCATTER
from imubayes.rig.recordings import FREE_TUMBLE, IMU_CHANNELS, INPUTS, KNOWN_IMU_CHANNELS, RUN_CHANNELS
from imubayes.rig.runs import read_run
from imubayes.rig.streams import STREAMED
from imubayes.rig.texts import Wanted
from imubayes.sensors.imu import ACCELEROMETERS, CASE_CHANNELS, GYROSCOPES
from imubayes.study.schema import ASKED, toml_value
from imubayes.study.schema.run_tables import run_spec
from imubayes.study.schema.shapes import Place
from imubayes.units import STANDARD_GRAVITY, factor, measures

ACCELEROMETER = {"a", "acc", "accel", "accelerometer", "accelerometers", "acceleration", "force"}
GYROSCOPE = {"g", "w", "gyr", "gyro", "gyroscope", "gyroscopes", "gyros", "omega", "rate", "angular"}
CLOCK = {"t", "time", "times", "timestamp", "stamp", "clock", "clk", "ticks", "sec", "seconds"}
COUNTER = {"samples", "sample", "index", "row", "line", "count", "packet"}
TEMPERATURE = {"temp", "temperature"}
"""Words of columns' names, in lower case."""

SUFFIXES = {
    "s": "s", "ms": "ms", "us": "us", "ns": "ns", "mg": "mg", "dps": "deg/s", "degc": "degC",
}  # fmt: skip
"""Units that people write at the end of a name."""

GRAVITIES = {"g": 1.0, "m/s^2": STANDARD_GRAVITY, "mg": 1000.0}
"""Length of a triad's output at rest, by unit."""

ALIKE = 0.1
"""Relative difference of a length from gravity's within which its unit is guessed."""

RATES = (0.5, 20_000.0)
"""Hz: samples a second of a recording whose clock has no unit."""

FASTEST = 35.0
"""rad/s, 2000 deg/s: the range of most gyroscopes. Rates beyond it are in deg/s."""

WINDOWS, TURNED, STEADY = 100, 0.3, 30.0
"""Windows of a record; and the spread of their means of a case that is turned: over the length of the force,
and of counts and rates over the scatter within."""

WARMED = 5.0
"""K: range of temperature of a run in a chamber."""

KELVINS = 200.0
"""Temperature beyond which it is absolute."""

CENTRIFUGED = 1.2
"""g: inputs beyond gravity."""

SCALE = f', scale = "{ASKED}"'
"""What a column of counts lacks."""

OTHERS = (*CASE_CHANNELS, MOUNT, DWELL, SCATTER)
"""Channels beside the inputs along a component's axes."""


CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")
"""What a comment must not hold."""


@dataclass(frozen=True, slots=True)
class Guess:
    """A column of a file as a channel: its address and unit, what else is said of it, and why."""

    column: str | int
    unit: str = ""
    more: str = ""
    why: str = ""

    def of(self, unit: str, why: str, more: str = "") -> Guess:
        """Add the unit, and why it is that."""
        return replace(self, unit=unit, why=f"{self.why}{why}", more=more)

    def line(self, channel: str) -> str:
        """Write it as a line of ``[sensor.run.columns]``."""
        column = self.column if isinstance(self.column, int) else toml_value(self.column)
        unit = f", unit = {toml_value(self.unit)}" if self.unit else ""
        return f"{channel} = {{ column = {column}{unit}{self.more} }}   # {self.why}"


def drafted(recording: Path, folder: Path) -> str:
    """Write a study of a recording, which is to be in a folder.

    It is a `DataError` if the file cannot be read, or no column of it is known by its name.
    """
    table = _first_rows(recording, folder)
    guesses = {**_named(table), **_unnamed(table, recording.stem)}
    outputs = [name for name in ("output", *ACCELEROMETERS, *GYROSCOPES) if name in guesses]
    if not outputs:
        raise DataError(
            f"{recording}: no column is known by its name as an output: the file has {table.names()};"
            " name them t, ax ay az, gx gy gz, or output beside the inputs f_i ..., or write a study by hand"
        )
    moved = _moved(table, guesses)
    guesses = {name: _with_unit(table, name, guess, guesses, moved) for name, guess in guesses.items()}
    head = [
        f"# Begun by 'imubayes init' from {recording.name}. What is guessed says from what: look at it.",
        f'# What cannot be guessed is "{ASKED}", or a comment with "ask:". All keys are in docs/study.md.',
        "# 'imubayes check' then says what the run can tell.",
        "[study]",
        f"title = {toml_value(recording.stem)}",
        "seed = 1",
        "# ask: [[scene]] for what the sensor will meet, [decision] for what a wrong verdict costs",
    ]
    counters = [name for name in table.columns if COUNTER & set(re.findall("[a-z]+", name.lower()))]
    beside = f"; '{counters[0]}' counts rows" if counters else ""
    clock = Guess("", why=f"ask: samples a second: the file has no clock{beside}")
    clock = guesses.pop("t", clock)
    used = {str(guess.column).partition("[:")[0] for guess in (clock, *guesses.values())}
    left = [name for name in table.columns if name not in used]
    if "output" in outputs or any(name[:2] in ("f_", "w_") for name in guesses):
        sensors = _in_known_inputs(table, clock, guesses, left)
    elif moved and len(outputs) in (3, 6):
        sensors = _in_the_hand(recording, table, clock, {name: guesses[name] for name in outputs})
    else:
        sensors = _at_rest(table, clock, guesses, outputs)
    unused = [f"# not used: {', '.join(left)}"] if left else []
    return CONTROL.sub(" ", "\n".join([*head, *sensors, *unused])) + "\n"


def _first_rows(recording: Path, folder: Path) -> FileTable:
    """All of a short file, the first rows of a long one, under the name that a study in a folder gives it."""
    if not recording.is_file():
        raise DataError(f"{recording}: is no file: expected a recording")
    file, folder = recording.resolve(), folder.resolve()
    shown = str(file.relative_to(folder) if file.is_relative_to(folder) else file)
    long = rows_in(recording) > STREAMED
    table = next(tables_of(recording, shown, Wanted())) if long else read_table(recording, shown)
    if min(len(values) for values in table.arrays) < 2:
        raise DataError(f"{recording}: has one row: expected samples")
    return table


def _named(table: FileTable) -> dict[str, Guess]:
    """Channels whose columns are known by their names; of two columns the first, of a matrix x, y, z."""
    names: dict[str, str] = {}
    for column, values in zip(table.columns, table.arrays, strict=True):
        if values.ndim == 1:
            names[column] = bare(column)
        elif values.ndim == 2 and values.shape[1] == 3:
            names |= {f"{column}[:,{k}]": f"{column}.{axis}" for k, axis in enumerate("xyz")}
    guesses: dict[str, Guess] = {}
    for address, name in names.items():
        channel, why = _channel(name)
        if channel in guesses:
            guesses[channel] = replace(guesses[channel], why=f"{guesses[channel].why}; '{address}' fits too")
        elif channel:
            guesses[channel] = Guess(address, why=why)
    return guesses


def _channel(name: str) -> tuple[str, str]:
    """Channel that a column's name means, and how that was found; empty if it means none.

    Examples
    --------
    >>> [_channel(name)[0] for name in ("imu.acc.x", "gyroZ", "Time", "mag_x", "f_i", "T")]
    ['ax', 'gz', 't', '', 'f_i', 'T']
    """
    if name in {*RUN_CHANNELS, *IMU_CHANNELS, *KNOWN_IMU_CHANNELS}:
        return name, "the channel's own name"
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name)]
    words = words[:-1] if words and words[-1] in SUFFIXES and len(words) > 1 else words
    why = f"guessed from the name '{name}'"
    if CLOCK & set(words):
        return "t", why
    if TEMPERATURE & set(words):
        return "T", why
    axis, first = (words[-1], words[:-1]) if words and words[-1] in "xyz" else ("", words)
    if not axis and words and words[-1][-1:] in "xyz":
        axis, first = words[-1][-1], [*words[:-1], words[-1][:-1]]
    kinds = ("a" * bool(ACCELEROMETER & set(first))) + ("g" * bool(GYROSCOPE & set(first)))
    return (f"{kinds}{axis}", why) if axis and len(kinds) == 1 else ("", "")


def _unnamed(table: FileTable, stem: str) -> dict[str, Guess]:
    """Channels of columns that have numbers only: a clock that goes up, then a triad, or two."""
    if table.columns not in (tuple("0123"), tuple("0123456")):
        return {}
    if not np.all(np.diff(_values(table, 0, "t")) > 0.0):
        return {}
    words = set(re.findall(r"[a-z]+", stem.lower()))
    why = "guessed from the order: the file names no column"
    names = [*ACCELEROMETERS, *GYROSCOPES]
    if len(table.columns) == 4:
        gyroscopes = bool(GYROSCOPE & words)
        if not gyroscopes and not ACCELEROMETER & words:
            return {}
        names = names[3:] if gyroscopes else names[:3]
        why += f", and from '{stem}', the file's"
    return {name: Guess(k, why=why) for k, name in enumerate(["t", *names])}


def _values(table: FileTable, column: str | int, channel: str) -> FloatArray:
    values = table.locate(column, channel)[1]
    return values.astype(np.int64).astype(float) if values.dtype.kind == "m" else values.astype(float)


def _rows(table: FileTable, guesses: Mapping[str, Guess], names: Sequence[str]) -> FloatArray:
    """Rows of some channels in which all are finite."""
    values = np.column_stack([_values(table, guesses[name].column, name) for name in names])
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < 2:
        raise DataError(f"{table.file}: {', '.join(names)} hold no numbers: expected samples")
    return values


def _with_unit(
    table: FileTable, channel: str, guess: Guess, guesses: Mapping[str, Guess], moved: bool
) -> Guess:
    """Say the unit of a column: from its header, its name's end, or its numbers."""
    like = channel_unit(channel, "m/s^2" if channel[0] == "a" else "rad/s")
    name, values = table.locate(guess.column, channel)
    if not like or values.dtype.kind == "m":
        return guess
    unit = bracketed(name) or SUFFIXES.get(re.split(r"[^a-z]", name.lower())[-1], "")
    likes = ("m/s^2", "rad/s") if channel == "output" else (like,)
    if unit and any(measures(unit, like) for like in likes):
        return guess.of(unit, ", unit from the header")
    if channel == "t":
        t = values.astype(float)
        step = float(np.median(np.diff(t)))
        if np.any(t != np.round(t)):
            return guess.of("s", f", unit from steps of {step:.4g}")
        sizes = {unit: 1.0 / (step * factor(unit, "s")) for unit in ("s", "ms", "us", "ns") if step > 0.0}
        fits = {
            unit: f"{rate:,.4g} Hz in {unit}" for unit, rate in sizes.items() if RATES[0] <= rate <= RATES[1]
        }
        if len(fits) != 1:
            return guess.of(
                ASKED, f"; ask: the unit, {', '.join(fits.values()) or f'its steps are {step:g}'}"
            )
        return guess.of(next(iter(fits)), f", unit from its steps: {', '.join(fits.values())}")
    if channel in ("T", "T_2"):
        cold = np.nanmedian(values.astype(float)) < KELVINS
        return guess.of("degC" if cold else "K", ", unit from its size")
    if channel in ACCELEROMETERS or channel in GYROSCOPES:
        return _triad_unit(table, guess, guesses, channel[0], moved=moved)
    return guess.of(ASKED, f"; ask: the unit, such as {like}")


def _triad_unit(
    table: FileTable, guess: Guess, guesses: Mapping[str, Guess], kind: str, *, moved: bool
) -> Guess:
    """Unit of a triad: by gravity, or by rates that no gyroscope reaches in rad/s."""
    names = [f"{kind}{axis}" for axis in "xyz" if f"{kind}{axis}" in guesses]
    values = _rows(table, guesses, names)
    length = float(np.median(np.linalg.norm(values, axis=1)))
    if np.all(values == np.round(values)):
        usual = (
            f"{1.0 / length:.2g} g/count if |f| at rest is 1 g and zero is 0"
            if length
            else "of the data sheet"
        )
        example = usual if kind == "a" else "1/131 deg/s/count"
        return guess.of("count", f"; whole numbers: counts; ask: the scale, such as {example}", SCALE)
    if kind == "a":
        for unit, gravity in GRAVITIES.items():
            if len(names) == 3 and abs(length / gravity - 1.0) < ALIKE:
                return guess.of(unit, f", unit from the median length {length:.4g}")
    elif (fastest := float(np.abs(values).max())) > FASTEST:
        return guess.of("deg/s", f", unit from rates up to {fastest:.4g}")
    elif moved:
        return guess.of("rad/s", f", unit from rates up to {fastest:.4g} of a case that turns")
    return guess.of(ASKED, f"; ask: the unit, {'g or m/s^2' if kind == 'a' else 'deg/s or rad/s'}")


def _moved(table: FileTable, guesses: Mapping[str, Guess]) -> bool:
    """Tell whether a case was turned: by the direction of the force, or of rates by what changes slowly."""
    for triad in (ACCELEROMETERS, GYROSCOPES):
        if all(name in guesses for name in triad):
            values = _rows(table, guesses, triad)
            parts = np.array_split(values, min(WINDOWS, max(len(values) // 20, 1)))
            means = np.array([part.mean(axis=0) for part in parts])
            scatter = np.median([part.std(axis=0) for part in parts], axis=0)
            if triad == ACCELEROMETERS and np.any(values != np.round(values)):
                scatter = TURNED / STEADY * np.linalg.norm(means, axis=1).mean()
            return bool(np.any(np.ptp(means, axis=0) > STEADY * scatter))
    return False


def _in_known_inputs(
    table: FileTable, clock: Guess, guesses: Mapping[str, Guess], left: Sequence[str]
) -> Iterator[str]:
    """A component whose inputs are in the file, or a whole IMU."""
    kind, outputs = "imu", (*ACCELEROMETERS, *GYROSCOPES)
    if "output" in guesses:
        unit, outputs = guesses["output"].unit, ("output",)
        kind = "gyroscope" if measures(unit, "rad/s") else ASKED
        kind = "accelerometer" if measures(unit, "m/s^2") else kind
    kept = {name: guess for name, guess in guesses.items() if name in (*outputs, *INPUTS, *OTHERS)}
    missing = [name for name in RUN_CHANNELS if name not in kept]
    mistaken = [bare(name) for name in left if nearly(bare(name), missing)]
    asked = "nearly names of channels; ask: are they?"
    more = [f"ignore = {toml_value(mistaken)}   # {asked}"] if mistaken else []
    procedure, why = _procedure(table, kept, kind)
    yield from _sensor(Path(table.file).stem, kind, needs_class=kind == "imu")
    yield from _run(table, procedure, why, clock, kept, more)


def _at_rest(
    table: FileTable, clock: Guess, guesses: Mapping[str, Guess], outputs: Sequence[str]
) -> Iterator[str]:
    """Each component of a case at rest by itself: gravity is taken off the one that is upright."""
    thermometer = {name: guess for name, guess in guesses.items() if name == "T"}
    for name in outputs:
        kind = "accelerometer" if name in ACCELEROMETERS else "gyroscope"
        output, level = guesses[name], float(np.median(_rows(table, guesses, [name])))
        gravity = GRAVITIES.get(output.unit, np.inf)
        if abs(abs(level) / gravity - 1.0) <= ALIKE:
            why = f"; 1 g taken off, guessed from a median of {level:.4g}"
            offset = toml_value(f"{np.copysign(gravity, level):.6g} {output.unit}")
            output = output.of(output.unit, why, f", offset = {offset}")
        kept = {"output": output, **thermometer}
        procedure, why = _procedure(table, kept, kind)
        yield from _sensor(name, kind, needs_class=False)
        yield from _run(table, procedure, why, clock, kept)


def _procedure(table: FileTable, kept: Mapping[str, Guess], kind: str) -> tuple[str, str]:
    """Procedure of known inputs, and what it was guessed from."""
    inputs = [name for name in kept if name in (*INPUTS, *CASE_CHANNELS)]
    values = {name: _values(table, kept[name].column, name) for name in inputs}
    varied = {name for name, column in values.items() if np.ptp(column) > 0.0}
    forces = [
        float(np.abs(values[name]).max()) * factor(kept[name].unit, "m/s^2") / STANDARD_GRAVITY
        for name in inputs
        if name[0] == "f" and measures(kept[name].unit, "m/s^2")
    ]
    why = f"guessed from the inputs that change: {', '.join(sorted(varied)) or 'none'}"
    if max(forces, default=0.0) > CENTRIFUGED:
        return "centrifuge", f"{why}, and forces up to {max(forces):.3g} g"
    if any(name.startswith("w_") for name in varied) and kind != "accelerometer":
        return "rate-table", why
    if any(name.startswith("f_") for name in varied):
        return "tumble", why
    if "T" in varied and np.ptp(values["T"]) > WARMED:
        return "thermal", f"{why}, by {np.ptp(values['T']):.3g} K"
    return ("other" if varied - {"T"} else "static"), why


def _in_the_hand(
    recording: Path, table: FileTable, clock: Guess, guesses: Mapping[str, Guess]
) -> Iterator[str]:
    """A triad, or two, that was turned while nothing but gravity, or the rate of a table, was known."""
    kind = "imu" if len(guesses) == 6 else "accelerometer" if "ax" in guesses else "gyroscope"
    yield from _sensor(recording.stem, kind, needs_class=True)
    if kind == "gyroscope":
        why = "guessed: the rates change, and the file has no input"
        asked = 'ask: when the table turned, how fast: [{ rows = [500, 1500], rate = "60 deg/s" }, ...]'
        more = [f"sections = {toml_value(ASKED)}   # {asked}"]
    else:
        why = f"guessed: the direction of the force changes{_stills(recording, clock, guesses)}"
        place = '{ latitude = "45.4 deg", height = "12 m" }'
        more = [
            f'gravity = "9.80665 m/s^2"   # guessed: standard; ask: {place}',
            '# ask: were the faces that were up known? Then procedure = "ferraris" and',
            '# sections = [{ rows = [0, 500], up = "x" }, ...]',
        ]
    yield from _run(table, FREE_TUMBLE, why, clock, guesses, more)


def _stills(recording: Path, clock: Guess, guesses: Mapping[str, Guess]) -> str:
    """Say how many stills a record has, or why that cannot be told; nothing where a unit is asked for."""
    columns = {"t": clock, **{name: guesses[name] for name in ACCELEROMETERS}}
    if any(guess.column == "" or guess.more or guess.unit == ASKED for guess in columns.values()):
        return ""
    said = {
        name: {"column": guess.column} | ({"unit": guess.unit} if guess.unit else {})
        for name, guess in columns.items()
    }
    raw = {"name": "hand", "procedure": FREE_TUMBLE, "file": str(recording.resolve()), "columns": said}
    raw["gravity"] = f"{STANDARD_GRAVITY} m/s^2"
    try:
        run = read_run(run_spec(raw, "accelerometer", Place("")), "accelerometer")
        return f", in {len(find_stills(run))} stills"
    except InputError as error:
        return f"; {error}"


def _sensor(name: str, kind: str, *, needs_class: bool) -> Iterator[str]:
    yield from ("", "[[sensor]]", f"id = {toml_value(name)}")
    yield f"kind = {toml_value(kind)}{'   # ask: accelerometer or gyroscope' if kind == ASKED else ''}"
    asked = "ask: technology and grade, as 'imubayes catalogue' lists them"
    if needs_class:
        yield f"class = {toml_value(ASKED)}   # {asked}"
    else:
        yield f'# class = "mems_tactical"   # {asked}; without one priors are vague'
    yield "# ask: library = { powers = 2 } for other candidates, reference = { ... } for errors of the bench"


def _run(
    table: FileTable,
    procedure: str,
    why: str,
    clock: Guess,
    kept: Mapping[str, Guess],
    more: Sequence[str] = (),
) -> Iterator[str]:
    yield from ("", "[[sensor.run]]", f"name = {toml_value(Path(table.file).stem)}")
    yield f"procedure = {toml_value(procedure)}   # {why}"
    yield f"file = {toml_value(table.file)}"
    yield from more
    yield from ("", "[sensor.run.columns]")
    yield clock.line("t") if clock.column != "" else f"t = {{ rate = {toml_value(ASKED)} }}   # {clock.why}"
    yield from (guess.line(channel) for channel, guess in kept.items())
