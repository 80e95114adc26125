"""The noise processes of a run, ready to print: a row a process, a figure, and words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.campaign import SensorResult
from imubayes.inference import SIDE
from imubayes.inference.allan import AllanCurve
from imubayes.inference.summary import RunSummary
from imubayes.reporting import blocks, rounding
from imubayes.reporting.canvas import ACCENT, INK, PALE, SERIES, Axes, Drawing, Room, draw, plain_logs
from imubayes.reporting.result import Allan, Process, Processes, published
from imubayes.reporting.rows import noise_cells, noise_draws
from imubayes.selection.noise_choice import NoiseChoice, ProcessSize
from imubayes.selection.verdicts import UNSEEN, listed
from imubayes.sensors.noise import NAMES
from imubayes.sensors.terms import Kind

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

SIZES = (
    "N is two-sided: a data sheet's one-sided noise density is √2 N. Ranges hold 90 % of the prior,"
    " centred on the class's typical value; a data sheet's bias instability is often the lowest Allan"
    " deviation, 0.664 B. A process that the data do not show has the limit that it stays below with 95"
    " %."
)

COLOURS = dict(zip(NAMES, (*SERIES[1:], *SERIES[1:]), strict=True))
"""Colour of each noise process; its symbol stands at its line."""

ROOM = 3.0
"""Factor below the lowest dot down to which noise processes are drawn."""

LETTER = 14.0
"""px of a process's symbol, and of the room around it."""


def noise_blocks(sensor: SensorResult, key: str, *, drawn: bool) -> Iterator[blocks.Block]:
    """N, B and K of each run; a run whose processes are told has its sizes there."""
    weighed = {noise.run for noise in sensor.processes}
    runs = [run for run in sensor.runs if run.name not in weighed]
    if runs:
        rows = [tuple(_noise_cells(run, sensor)) for run in runs]
        units = [(name, rounding.pretty(rounding.NOISE[sensor.kind][name][0])) for name in "NBK"]
        head = [text for name, unit in units for text in (f"{name}, {unit}", blocks.Both("class", None))]
        yield blocks.Table(f"Noise of {sensor.id}", ("run", "known by", *head), rows, "ttntntnt")
    if drawn:
        yield blocks.Prose(blocks.Both(SIZES, None), "note")
    for k, noise in enumerate(sensor.processes):
        title, rows = f"Noise processes of {noise.run}", list(_rows(noise, sensor))
        said = [blocks.Prose(process_sentence(noise, sensor)), blocks.Table(title, HEAD, rows, "ttnntnnt")]
        panel = allan_panel(noise, sensor.kind, f"{key}n{k}") if drawn else None
        yield blocks.Section(title, [*said, *([blocks.Figure([panel])] if panel else [])])
    if sensor.processes:
        yield blocks.Prose(blocks.Both(f"{NOTE} {ALLAN}" if drawn else NOTE, None), "note")


def _noise_cells(run: RunSummary, sensor: SensorResult) -> Iterator[str]:
    """N, B and K of a run, each with the class's range that holds 90 % where there is a class."""
    yield run.name
    yield run.found.origin if noise_draws(run, sensor.chains) is None else "chains"
    for k, (cell, limit) in enumerate(noise_cells(run, sensor.kind, sensor.chains)):
        yield f"{'below ' if limit else ''}{rounding.signed(cell)}"
        median, sd = run.found.prior.get("NBK"[k], (math.nan, 0.0))
        size = rounding.noise_unit("NBK"[k], sensor.kind)[1]
        ends = (str(rounding.measured(median * math.exp(z * sd), 0.0, size=size)) for z in (-SIDE, SIDE))
        yield blocks.quiet(" to ".join(ends) if run.found.prior else "")


def allan_panel(noise: NoiseChoice, kind: Kind, key: str) -> Drawing | None:
    """Draw the Allan deviation with its 90 % band, the fitted curve and the share of each process."""
    curve = noise.curve
    if curve is None:
        return None
    inside = float(((curve.low <= curve.fitted) & (curve.fitted <= curve.high)).mean())
    name, unit = rounding.output_unit(kind)
    lowest = int(curve.deviation.argmin())
    least = f"{curve.deviation[lowest] / unit:.3g} {rounding.pretty(name)} at {curve.tau[lowest]:.3g} s"
    return draw(
        lambda axes: _paint_processes(axes, curve, unit, rounding.pretty(name)),
        title=f"Lowest {least}; {rounding.percent(inside)} of the fitted curve within the 90 % band",
        alt=f"Allan deviation against averaging time with {', '.join(curve.shares)}; lowest {least}",
        key=key,
        room=Room(height=280, right=18),
    )


def _paint_processes(axes: Axes, curve: AllanCurve, unit: float, name: str) -> None:
    axes.fill_between(curve.tau, curve.low / unit, curve.high / unit, color=PALE, linewidth=0.0)
    floor = float(curve.deviation.min()) / unit / ROOM
    ends = dict[str, FloatArray]()
    for symbol, share in curve.shares.items():
        shown = share / unit >= floor
        if not shown.any():
            continue
        tau, values = curve.tau[shown], share[shown] / unit
        axes.plot(tau, values, color=COLOURS[symbol], linewidth=1.2, linestyle=(0, (5, 2)))
        order = [0, -1] if values[0] < values[-1] or symbol == "B" else [-1, 0]
        ends[symbol] = np.column_stack([tau[order], values[order]])
    axes.plot(curve.tau, curve.fitted / unit, color=ACCENT, linewidth=1.6)
    axes.plot(curve.tau, curve.deviation / unit, "o", color=INK, markersize=3)
    axes.set(xscale="log", yscale="log", xlabel="averaging time, s", ylabel=f"Allan deviation, {name}")
    plain_logs(axes)
    taken = np.empty((0, 2))  # px
    for symbol, two in ends.items():
        px = axes.transData.transform(two)
        free = [k for k in (0, 1) if not (np.abs(taken - px[k]) < LETTER).all(axis=1).any()]
        end = free[0] if free else 0
        taken = np.vstack([taken, px[end]])
        x, y = two[end].tolist()
        axes.text(x, y, symbol, color=INK, va="bottom", ha="center")


def about_noise(sensor: SensorResult) -> bool:
    """Whether the noise processes of a component are all that was asked: every run is at rest."""
    return bool(sensor.processes) and all(run.procedure == "static" for run in sensor.runs)


def glance_table(sensors: Sequence[SensorResult]) -> blocks.Table:
    """Noise processes of many runs side by side."""
    rows = []
    for sensor in sensors:
        for noise in sensor.processes:
            told = {
                name: rounding.in_unit(size_text(size, sensor.kind))
                if size.verdict == "needed"
                else blocks.shape(size.verdict)
                for name, size in decided_sizes(noise, sensor).items()
            }
            rows.append((sensor.id, noise.run, *(told.get(symbol, "") for symbol in NAMES)))
    return blocks.Table("Noise processes by component", ("noise of", "run", *NAMES), rows, "t", GLANCE)


def decided_sizes(choice: NoiseChoice, sensor: SensorResult) -> dict[str, ProcessSize]:
    """Sizes of a run's processes: N, B and K are those that its coefficients were decided by, where drawn."""
    sizes = {size.name: size for size in choice.sizes}
    every = (noise_draws(run, sensor.chains) for run in sensor.runs if run.name == choice.run)
    draws = next(every, None)
    if draws is not None:
        told = zip("NBK", draws.mean(axis=0).tolist(), draws.std(axis=0, ddof=1).tolist(), strict=True)
        sizes |= {name: replace(sizes[name], mean=mean, sd=sd) for name, mean, sd in told if name in sizes}
    return sizes


def process_sentence(choice: NoiseChoice, sensor: SensorResult) -> str:
    """What a run shows of its noise processes, in words and numbers."""
    sizes = decided_sizes(choice, sensor)
    needed = ["N", *choice.identified]
    told = listed(f"{NAMES[name]} {name} = {size_text(sizes[name], sensor.kind)}" for name in needed)
    words = [f"The run shows {told}."]
    mixed = [size for size in choice.sizes if size.verdict == "inseparable" and size.name != "tau"]
    groups = {frozenset((size.name, *size.confounded_with)) for size in mixed}
    least = sorted(sorted(group) for group in groups if not any(other < group for other in groups))
    words += [f"It shows one of {listed(group)}, and cannot say which." for group in least]
    for word, text in _WORDS.items():
        names = [s.name for s in choice.sizes if s.verdict == word and s.name != "tau"]
        if names:
            words.append(f"{text}: {', '.join(names)}.")
    return " ".join(words)


_WORDS = {"not needed": "Not there", "undecided": "Undecided", "unresolved": "Too small for this run to tell"}


def _rows(noise: NoiseChoice, sensor: SensorResult) -> Iterator[tuple[blocks.Text, ...]]:
    kind = sensor.kind
    for name, size in decided_sizes(noise, sensor).items():
        is_tau = name == "tau"
        if is_tau and name not in noise.noise:
            continue
        unit, allan = rounding.noise_unit(name, kind), None
        if noise.fit and name in noise.fit.names:
            k = noise.fit.names.index(name)
            value, sd = noise.fit.values[k], noise.fit.log_sd[k]
            allan = rounding.measured(value, value * sd, *unit) if sd < 1.0 else None
        shown = size.verdict == "needed" or is_tau
        limit, seen = (
            rounding.signed(rounding.below(x, *unit)) for x in (size.limit95, size.detection_limit)
        )
        yield (
            "Tc" if is_tau else name,
            "its time constant" if is_tau else NAMES[name],
            "" if is_tau or name == "N" else blocks.bar(size.inclusion, seen=size.verdict not in UNSEEN),
            rounding.signed(size_text(size, kind)) if shown else blocks.quiet(f"below {limit}"),
            rounding.pretty(unit[0]),
            rounding.signed(allan),
            blocks.quiet("" if math.isnan(size.detection_limit) else seen),
            "" if is_tau else blocks.verdict(size.verdict, reason=size.reason),
        )


def size_text(size: ProcessSize, kind: Kind) -> rounding.Rounded:
    """Size of a process in its unit."""
    return rounding.measured(size.mean, size.sd, *rounding.noise_unit(size.name, kind))


def published_processes(sensor: SensorResult) -> dict[str, Processes]:
    """Publish the noise processes of the runs that were asked for them."""
    told, units = dict[str, Processes](), rounding.NOISE[sensor.kind]
    for noise in sensor.processes:
        allan, sizes = None, dict[str, Process]()
        if fit := noise.fit:
            values, sds = (dict(zip(fit.names, x, strict=True)) for x in (fit.values, fit.log_sd))
            allan = published(Allan, fit, values=values, log_sd=sds)
        for size in noise.sizes:
            printed, unit = units[size.name]
            sizes[size.name] = published(Process, size, printed_unit=printed, unit=unit)
        told[noise.run] = published(
            Processes,
            noise,
            identified=("N", *noise.identified),
            prior_source=noise.prior,
            processes=sizes,
            sets=[{"processes": ("N", *names), "probability": p} for names, p in noise.sets[:10]],
            allan=allan,
        )
    return told
