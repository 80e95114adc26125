"""The noise processes of a run, ready to print: a row a process, a figure, and words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from imubayes.reporting.blocks import (
    Block,
    Figure,
    Prose,
    Section,
    Table,
    Text,
    bar,
    joined,
    quiet,
    shape,
    strong,
    verdict,
)
from imubayes.reporting.fit_figures import allan_panel
from imubayes.reporting.result.entries import Allan, Process, Processes
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import (
    NOISE_SI,
    NOISE_UNITS,
    OUTPUT_SI,
    OUTPUT_UNIT,
    Measured,
    below,
    in_unit,
    measured,
    per_unit,
    pretty,
    signed,
)
from imubayes.selection.verdicts import listed
from imubayes.sensors.noise_processes import NAMES

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.allan_fit import AllanFit
    from imubayes.selection.noise_choice import NoiseChoice, ProcessSize
    from imubayes.selection.noise_found import NoiseFound
    from imubayes.sensors.terms import Kind

_FURTHER = {
    "accelerometer": {"Q": ("m/s", "m/s"), "R": ("ug/h", "m/s^2/s")},
    "gyroscope": {"Q": ("arcsec", "rad"), "R": ("deg/h/h", "rad/s^2")},
}
"""Printed unit and SI unit of quantization and ramp."""


HEAD = ("", "process", "inclusion", "size ± sd", "unit", "by the Allan fit", "found from", "verdict")

NOTE = (
    "Every set of processes beside white noise is weighed by the evidence of the run, with the library’s"
    " terms projected out; sizes are averaged over the sets that hold the process. A process that is not"
    " shown has the size that it stays below with 95 %, were it there. Found from: the size that a run of"
    " this length would find with 95 %."
)

ALLAN = (
    "Dots: overlapping Allan deviation, its band holding 90 %; dashes: each process; line: all of them,"
    " at the medians of the best set. The Allan fit is a second route, generalized least squares on the"
    " logarithm of the Allan variance with the correlation between averaging times."
)

GLANCE = (
    "Noise processes that each run shows, with their sizes, and the verdict on the others: N white noise,"
    " B bias instability, K random walk, Q quantization, R ramp, G Gauss-Markov process."
)

SYMBOLS = ("N", "B", "K", "Q", "R", "G")


def process_units(kind: Kind) -> dict[str, tuple[str, str]]:
    """Printed unit and SI unit of each size.

    Examples
    --------
    >>> process_units("gyroscope")["N"]
    ('deg/sqrt(h)', 'rad/s/sqrt(Hz)')
    """
    usual = dict(zip("NBK", zip(NOISE_UNITS[kind], NOISE_SI[kind], strict=True), strict=True))
    return usual | _FURTHER[kind] | {"G": (OUTPUT_UNIT[kind], OUTPUT_SI[kind]), "tau": ("s", "s")}


def process_blocks(sensor: SensorResult, key: str, *, drawn: bool) -> Iterator[Block]:
    """Noise processes of the runs of a component that were asked for them."""
    for k, found in enumerate(sensor.processes):
        title, rows = f"Noise processes of {found.choice.run}", list(_rows(found, sensor.kind))
        said = [Prose(said_of(found, sensor.kind)), Table(title, HEAD, rows, "ttnntnnt")]
        panel = allan_panel(found, sensor.kind, f"{key}n{k}") if drawn and found.curve else None
        yield Section(title, [*said, *([Figure([panel])] if panel else [])])
    if sensor.processes:
        yield Prose(f"{NOTE} {ALLAN}" if drawn else NOTE, "note")


def process_answers(sensor: SensorResult) -> Iterator[Prose]:
    """Noise processes of each run, for the top of the page."""
    for found in sensor.processes:
        title = f"Noise of {sensor.id}, {found.choice.run}."
        yield Prose(joined(strong(title), said_of(found, sensor.kind)), "answer")


def said_of(found: NoiseFound, kind: Kind) -> str:
    """What a run shows, with the real signs."""
    return pretty(process_sentence(found.choice, kind).replace("+-", "±"))


def glance_table(sensors: Sequence[SensorResult]) -> Table:
    """Noise processes of many runs side by side."""
    rows = [
        (sensor.id, found.choice.run, *(_told(found, symbol, sensor.kind) for symbol in SYMBOLS))
        for sensor in sensors
        for found in sensor.processes
    ]
    return Table("Noise processes by component", ("noise of", "run", *SYMBOLS), rows, "t", GLANCE)


def _told(found: NoiseFound, symbol: str, kind: Kind) -> str:
    """Size of a process that a run shows, else its verdict."""
    for size in found.choice.sizes:
        if size.name == symbol:
            return in_unit(_size(size, kind)) if size.verdict == "needed" else shape(size.verdict)
    return ""


def process_sentence(choice: NoiseChoice, kind: Kind) -> str:
    """What a run shows of its noise processes, in words and numbers."""
    needed = ["N", *choice.identified]
    told = listed(f"{NAMES[name]} {name} = {size_text(choice.size(name), kind)}" for name in needed)
    words = [f"The run shows {told}."]
    words += [f"It shows one of {listed(group)}, and cannot say which." for group in _groups(choice)]
    for word, text in _WORDS.items():
        names = [s.name for s in choice.sizes if s.verdict == word and s.name != "tau"]
        if names:
            words.append(f"{text}: {', '.join(names)}.")
    return " ".join(words)


def _groups(choice: NoiseChoice) -> list[list[str]]:
    """Groups of which the run shows one, without those that hold a smaller one."""
    every = {
        frozenset((size.name, *size.confounded_with))
        for size in choice.sizes
        if size.verdict == "inseparable" and size.name != "tau"
    }
    return sorted(sorted(group) for group in every if not any(other < group for other in every))


_WORDS = {
    "not needed": "Not there",
    "undecided": "Undecided",
    "unresolved": "Too small for this run to tell",
}


def size_text(size: ProcessSize, kind: Kind) -> str:
    """Mean and sd in the units people use."""
    return str(_size(size, kind))


def _rows(found: NoiseFound, kind: Kind) -> Iterator[tuple[Text, ...]]:
    units = process_units(kind)
    for size in found.choice.sizes:
        is_tau = size.name == "tau"
        if is_tau and not found.choice.noise.G > 0.0:
            continue
        unit, si = units[size.name]
        scale = per_unit(unit, si)
        shown = size.verdict == "needed" or is_tau
        limit, seen = (signed(below(x / scale, unit)) for x in (size.limit95, size.detection_limit))
        yield (
            "Tc" if is_tau else size.name,
            "its time constant" if is_tau else NAMES[size.name],
            "" if is_tau or size.name == "N" else bar(size.inclusion),
            signed(_size(size, kind)) if shown else quiet(f"below {limit}"),
            pretty(unit),
            signed(_allan(found.fit, size.name, scale, unit)),
            quiet("" if math.isnan(size.detection_limit) else seen),
            "" if is_tau else verdict(size.verdict, reason=size.reason),
        )


def _size(size: ProcessSize, kind: Kind) -> Measured:
    unit, si = process_units(kind)[size.name]
    scale = per_unit(unit, si)
    return measured(size.mean / scale, size.sd / scale, unit)


def _allan(fit: AllanFit | None, name: str, scale: float, unit: str) -> Measured | None:
    if fit is None or name not in fit.names:
        return None
    k = fit.names.index(name)
    value, sd = fit.values[k] / scale, fit.log_sd[k]
    return measured(value, value * sd, unit) if sd < 1.0 else None


def published_processes(sensor: SensorResult) -> dict[str, Processes]:
    """Publish the noise processes of the runs that were asked for them."""
    return {found.choice.run: _published(found, sensor.kind) for found in sensor.processes}


def _published(found: NoiseFound, kind: Kind) -> Processes:
    choice, fit, units = found.choice, found.fit, process_units(kind)
    by_name = {
        size.name: published(Process, size, printed_unit=units[size.name][0], unit=units[size.name][1])
        for size in choice.sizes
    }
    return published(
        Processes,
        choice,
        identified=("N", *choice.identified),
        prior_source=choice.prior,
        processes=by_name,
        sets=[{"processes": ("N", *names), "probability": p} for names, p in choice.sets[:10]],
        allan=fit
        and published(
            Allan,
            fit,
            values=dict(zip(fit.names, fit.values, strict=True)),
            log_sd=dict(zip(fit.names, fit.log_sd, strict=True)),
        ),
    )
