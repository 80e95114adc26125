"""What the report shows of the chains, of the test bench and of dwells that are not trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.reporting import chain_figures
from imubayes.reporting.chain_words import Change, Diagnosis, changes, diagnoses
from imubayes.reporting.rounding import OUTPUT_SI, OUTPUT_UNIT, Measured, measured, per_unit
from imubayes.reporting.rows import bench_label, label
from imubayes.sensors.imu import COMPONENTS

if TYPE_CHECKING:
    from imubayes.campaign.study import Distrusted, ExtraPosterior, SensorResult
    from imubayes.reporting.canvas import Panel
    from imubayes.sensors.terms import Kind

MOST_BENCH = 24
"""Errors of the test bench that a report lists: those that the data say most of."""

MOST_DWELLS = 40
"""Dwells that a report lists, worst first."""

MOST_NOISES, MOST_NOISES_OF_MANY = 4, 1
"""Noise parameters that are traced: of one or two components, and of each of more."""

CORNER_OF_MANY = 3
"""Columns of the corner figure of each of more than two components."""


@dataclass(frozen=True, slots=True)
class ChainView:
    """Chains of one component.

    Attributes
    ----------
    diagnoses : the table of diagnostics.
    traces, ranks : a figure each for what is watched.
    corner : the columns that are tied; None where nothing varies.
    """

    diagnoses: tuple[Diagnosis, ...]
    traces: tuple[Panel, ...]
    ranks: tuple[Panel, ...]
    corner: Panel | None


def chain_view(sensor: SensorResult, key: str, sensors: int) -> ChainView | None:
    """Prepare the chains of a component; None for the exact method.

    Parameters
    ----------
    key : identifier of the component in the page.
    sensors : how many components have figures; 0 where this one has none.
    """
    chains = sensor.chains
    if chains is None:
        return None
    few = sensors <= 2
    noises = MOST_NOISES if few else MOST_NOISES_OF_MANY
    shown = chain_figures.watched(sensor, chains, noises) if sensors else ()
    most = chain_figures.CORNER if few else CORNER_OF_MANY
    return ChainView(
        diagnoses=diagnoses(sensor, chains),
        traces=tuple(chain_figures.trace(one, f"{key}w{n}") for n, one in enumerate(shown)),
        ranks=tuple(chain_figures.ranks(one, f"{key}v{n}") for n, one in enumerate(shown)),
        corner=chain_figures.corner(sensor, chains, f"{key}x", most) if sensors else None,
    )


@dataclass(frozen=True, slots=True)
class BenchRow:
    """An error of the test bench as it is printed: in words, prior sd, value, what it is confounded with."""

    text: str
    prior: Measured
    value: Measured
    partners: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BenchView:
    """Errors of the test bench that are allowed for, and how many more there are."""

    rows: tuple[BenchRow, ...]
    left_out: int


def bench_view(sensor: SensorResult) -> BenchView:
    """Errors of the test bench in printed units; of many, those that the data narrow most."""
    bench = own_errors(sensor)
    told = sorted(bench, key=lambda entry: entry.sd / entry.extra.sd)[:MOST_BENCH]
    shown = [entry for entry in bench if any(entry is one for one in told)]
    labels = {term.name: label(term) for term in sensor.selection.terms}
    labels |= {entry.extra.name: bench_label(entry.extra) for entry in sensor.extras}
    return BenchView(tuple(_bench_row(entry, labels) for entry in shown), len(bench) - len(shown))


def own_errors(sensor: SensorResult) -> list[ExtraPosterior]:
    """Errors of the test bench without those of other components of the case, which end in their names."""
    own = sensor.id.rpartition(".")[2]
    if own not in COMPONENTS:
        return list(sensor.extras)
    places = [(entry, entry.extra.name.rpartition(".")[2]) for entry in sensor.extras]
    return [entry for entry, place in places if place not in COMPONENTS or place == own]


def _bench_row(entry: ExtraPosterior, labels: dict[str, str]) -> BenchRow:
    extra = entry.extra
    unit = per_unit(extra.printed, extra.unit)
    return BenchRow(
        extra.text,
        measured(extra.sd / unit, 0.0, extra.printed),
        measured(entry.mean / unit, entry.sd / unit, extra.printed),
        tuple(dict.fromkeys(labels.get(name, name) for name in entry.partners)),
    )


@dataclass(frozen=True, slots=True)
class DwellRow:
    """A dwell that is not trusted: where it is, how probably, and how far its mean is off."""

    run: str
    start: float
    stop: float
    probability: float
    offset: Measured


def dwell_rows(distrusted: Sequence[Distrusted], kind: Kind) -> tuple[DwellRow, ...]:
    """Dwells that are not trusted, in printed units."""
    unit = per_unit(OUTPUT_UNIT[kind], OUTPUT_SI[kind])
    return tuple(
        DwellRow(
            dwell.run,
            dwell.start,
            dwell.stop,
            dwell.probability,
            measured(dwell.offset / unit, dwell.sd / unit, OUTPUT_UNIT[kind]),
        )
        for dwell in distrusted[:MOST_DWELLS]
    )


@dataclass(frozen=True, slots=True)
class SampledView:
    """What a component's section shows beside the exact posterior.

    Attributes
    ----------
    chains : None for the exact method.
    bench : errors of the test bench.
    dwells, more_dwells : dwells that are not trusted, and how many more there are.
    changed, changes : effect of the uncertain noise on inclusion; the sentence is empty without averages.
    """

    chains: ChainView | None
    bench: BenchView
    dwells: tuple[DwellRow, ...]
    more_dwells: int
    changed: str
    changes: tuple[Change, ...]


def sampled_view(sensor: SensorResult, key: str, sensors: int) -> SampledView:
    """Prepare what a component has beside the exact posterior."""
    changed, rows = changes(sensor)
    dwells = dwell_rows(sensor.distrusted, sensor.kind)
    return SampledView(
        chains=chain_view(sensor, key, sensors),
        bench=bench_view(sensor),
        dwells=dwells,
        more_dwells=len(sensor.distrusted) - len(dwells),
        changed=changed,
        changes=rows,
    )
