"""The noise processes of a run, ready to print: a row a process, a figure, and words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from imubayes.reporting.noise_figures import allan_panel
from imubayes.reporting.result.entries import Allan
from imubayes.reporting.result.sensors import Process, Processes
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import (
    NOISE_SI,
    NOISE_UNITS,
    OUTPUT_SI,
    OUTPUT_UNIT,
    Measured,
    below,
    measured,
    per_unit,
)
from imubayes.selection.verdicts import listed
from imubayes.sensors.noise_processes import NAMES

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorResult
    from imubayes.inference.allan_fit import AllanFit
    from imubayes.reporting.canvas import Panel
    from imubayes.selection.noise_choice import NoiseChoice, ProcessSize
    from imubayes.selection.noise_found import NoiseFound
    from imubayes.sensors.terms import Kind

_FURTHER = {
    "accelerometer": {"Q": ("m/s", "m/s"), "R": ("ug/h", "m/s^2/s")},
    "gyroscope": {"Q": ("arcsec", "rad"), "R": ("deg/h/h", "rad/s^2")},
}
"""Printed unit and SI unit of quantization and ramp."""


@dataclass(frozen=True, slots=True)
class ProcessRow:
    """A process as it is printed.

    Attributes
    ----------
    symbol, name, verdict, reason : of the process.
    inclusion : probability that it is there.
    size : mean and sd where it is there, or the limit that it stays below with 95 %.
    is_limit : which of the two.
    allan : by the fit of the Allan variance; None where it was not fitted.
    detection : size from which the run would find it with 95 %; None for white noise.
    """

    symbol: str
    name: str
    verdict: str
    reason: str
    inclusion: float
    size: Measured
    is_limit: bool
    allan: Measured | None
    detection: Measured | None

    @property
    def bar(self) -> dict[str, Any]:
        """What the bar of the inclusion shows."""
        return {"inclusion": self.inclusion, "inclusion_range": (self.inclusion, self.inclusion)}


@dataclass(frozen=True, slots=True)
class ProcessView:
    """Noise processes of one run.

    Attributes
    ----------
    run, sentence : its name, and what was found in words.
    rows : a process each.
    panel : the Allan deviation; None where it is not drawn.
    """

    run: str
    sentence: str
    rows: tuple[ProcessRow, ...]
    panel: Panel | None


def process_units(kind: Kind) -> dict[str, tuple[str, str]]:
    """Printed unit and SI unit of each size.

    Examples
    --------
    >>> process_units("gyroscope")["N"]
    ('deg/sqrt(h)', 'rad/s/sqrt(Hz)')
    """
    usual = dict(zip("NBK", zip(NOISE_UNITS[kind], NOISE_SI[kind], strict=True), strict=True))
    return usual | _FURTHER[kind] | {"G": (OUTPUT_UNIT[kind], OUTPUT_SI[kind]), "tau": ("s", "s")}


def process_views(sensor: SensorResult, key: str, *, drawn: bool) -> tuple[ProcessView, ...]:
    """Noise processes of the runs of a component that were asked for them."""
    return tuple(
        ProcessView(
            run=found.choice.run,
            sentence=process_sentence(found.choice, sensor.kind).replace("+-", "±"),
            rows=tuple(_rows(found, sensor.kind)),
            panel=allan_panel(found, sensor.kind, f"{key}n{k}") if drawn and found.curve else None,
        )
        for k, found in enumerate(sensor.processes)
    )


def process_sentence(choice: NoiseChoice, kind: Kind) -> str:
    """What a run shows of its noise processes, in words and numbers."""
    needed = ["N", *choice.identified]
    told = listed(f"{NAMES[name]} {name} = {size_text(choice.size(name), kind)}" for name in needed)
    words = [f"The run shows {told}."]
    words += [f"It shows one of {listed(group)}, and cannot say which." for group in _groups(choice)]
    for verdict, text in _WORDS.items():
        names = [s.name for s in choice.sizes if s.verdict == verdict and s.name != "tau"]
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
    unit, si = process_units(kind)[size.name]
    scale = per_unit(unit, si)
    return str(measured(size.mean / scale, size.sd / scale, unit))


def _rows(found: NoiseFound, kind: Kind) -> Iterator[ProcessRow]:
    units = process_units(kind)
    has_tau = found.choice.noise.G > 0.0
    for size in found.choice.sizes:
        if size.name == "tau" and not has_tau:
            continue
        unit, si = units[size.name]
        scale = per_unit(unit, si)
        shown = size.verdict == "needed" or size.name == "tau"
        yield ProcessRow(
            symbol="Tc" if size.name == "tau" else size.name,
            name="its time constant" if size.name == "tau" else NAMES[size.name],
            verdict=size.verdict,
            reason=size.reason,
            inclusion=size.inclusion,
            size=_size(size, scale, unit) if shown else below(size.limit95 / scale, unit),
            is_limit=not shown,
            allan=_allan(found.fit, size.name, scale, unit),
            detection=None if math.isnan(size.detection_limit) else below(size.detection_limit / scale, unit),
        )


def _size(size: ProcessSize, scale: float, unit: str) -> Measured:
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
