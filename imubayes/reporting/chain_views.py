"""What the report shows of the chains, of the test bench and of dwells that are not trusted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from imubayes.reporting import chain_figures
from imubayes.reporting.blocks import Block, Figure, Prose, Section, Table, quiet
from imubayes.reporting.chain_words import changes, diagnoses
from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    in_unit,
    measured,
    minus,
    per_unit,
    pretty,
    signed,
)
from imubayes.reporting.rows import bench_label, label, shortened
from imubayes.sensors.imu import COMPONENTS

if TYPE_CHECKING:
    from imubayes.campaign.study import ExtraPosterior, SensorResult

MOST_BENCH = 24
"""Errors of the test bench that a report lists: those that the data say most of."""

MOST_DWELLS = 40
"""Dwells that a report lists, worst first."""

MOST_PARTNERS = 3
"""Confounded terms that a row names."""

MOST_NOISES, MOST_NOISES_OF_MANY = 4, 1
"""Noise parameters that are traced: of one or two components, and of each of more."""

CORNER_OF_MANY = 3
"""Columns of the corner figure of each of more than two components."""


TRACES = (
    "Above: draws of each ensemble, a colour an ensemble, of the noise parameters whose ensembles are"
    " farthest apart and of the coefficients with the fewest effective draws; ensembles that agree cover"
    " the same band. Below them: how the draws of an ensemble rank among all draws; bars of one height"
    " are ensembles that agree, a slope or a hump is one that does not; the grey band is ± 2 sd of"
    " chance."
)

CORNER = (
    "Under the full library. Blue holds half of the draws, grey 90 %; a narrow slanted ridge is a pair"
    " that the test sees mostly in one combination."
)

BENCH = (
    "Each is in every model under its own prior, so that what it may do to the coefficients is in their"
    " error bars. Where the sd after the test is that before it, the test says nothing of it."
)

DWELLS = (
    "Each is more likely contaminated than not, by a knock, a wrong position or a spike; the fit goes on"
    " without it."
)


def chain_sections(sensor: SensorResult, key: str, sensors: int) -> Iterator[Section]:
    """Chains of a component; nothing for the exact method.

    Parameters
    ----------
    key : identifier of the component in the page.
    sensors : how many components have figures; 0 where this one has none.
    """
    chains = sensor.chains
    if chains is None:
        return
    few = sensors <= 2
    noises = MOST_NOISES if few else MOST_NOISES_OF_MANY
    shown = chain_figures.watched(sensor, chains, noises) if sensors else ()
    rows = [(line.name, minus(line.value), quiet(line.meaning)) for line in diagnoses(sensor, chains)]
    blocks: list[Block] = [Table(f"Diagnostics of the chains of {sensor.id}", (), rows, "ttw")]
    if shown:
        blocks.append(Figure([chain_figures.trace(one, f"{key}w{n}") for n, one in enumerate(shown)]))
        blocks.append(Figure([chain_figures.ranks(one, f"{key}v{n}") for n, one in enumerate(shown)], TRACES))
    most = chain_figures.CORNER if few else CORNER_OF_MANY
    corner = chain_figures.corner(sensor, chains, f"{key}x", most) if sensors else None
    if corner:
        blocks.append(Figure([corner], CORNER, wide=f"Strongest ties of {sensor.id}"))
    yield Section("The chains", blocks)


def bench_sections(sensor: SensorResult) -> Iterator[Section]:
    """Errors of the test bench in printed units; of many, those that the data narrow most."""
    bench = own_errors(sensor)
    told = sorted(bench, key=lambda entry: entry.sd / entry.extra.sd)[:MOST_BENCH]
    shown = [entry for entry in bench if any(entry is one for one in told)]
    labels = {term.name: label(term) for term in sensor.selection.terms}
    labels |= {entry.extra.name: bench_label(entry.extra) for entry in sensor.extras}
    left = len(bench) - len(shown)
    more = f" {left} more, of which the test says less, are in result.json." if left else ""
    if shown:
        head = ("error", "± sd before", "value ± sd after", "unit", "confounded with")
        rows = [_bench_row(entry, labels) for entry in shown]
        table = Table(f"Errors of the test bench of {sensor.id}", head, rows, "wnntw", f"{BENCH}{more}")
        yield Section("Errors of the test bench", [table])


def own_errors(sensor: SensorResult) -> list[ExtraPosterior]:
    """Errors of the test bench without those of other components of the case, which end in their names."""
    own = sensor.id.rpartition(".")[2]
    if own not in COMPONENTS:
        return list(sensor.extras)
    places = [(entry, entry.extra.name.rpartition(".")[2]) for entry in sensor.extras]
    return [entry for entry, place in places if place not in COMPONENTS or place == own]


def _bench_row(entry: ExtraPosterior, labels: dict[str, str]) -> tuple[str, ...]:
    extra = entry.extra
    unit = per_unit(extra.printed, extra.unit)
    prior = signed(measured(extra.sd / unit, 0.0, extra.printed))
    value = signed(measured(entry.mean / unit, entry.sd / unit, extra.printed))
    partners = tuple(dict.fromkeys(labels.get(name, name) for name in entry.partners))
    return (extra.text, f"± {prior}", value, pretty(extra.printed), minus(shortened(partners, MOST_PARTNERS)))


def dwell_sections(sensor: SensorResult) -> Iterator[Section]:
    """Dwells that are not trusted, in printed units."""
    unit = OUTPUT_UNIT[sensor.kind]
    size = per_unit(unit, OUTPUT_SI[sensor.kind])
    rows = [
        (
            dwell.run,
            f"{dwell.start:.6g}",
            f"{dwell.stop:.6g}",
            "> 99.9 %" if dwell.probability > 0.999 else f"{100.0 * dwell.probability:.1f} %",
            in_unit(measured(dwell.offset / size, dwell.sd / size, unit)),
        )
        for dwell in sensor.distrusted[:MOST_DWELLS]
    ]
    left = len(sensor.distrusted) - len(rows)
    more = f" {left} more are in result.json." if left else ""
    if rows:
        head = ("run", "from, s", "to, s", "contaminated with", "off by")
        table = Table(f"Dwells of {sensor.id} that are not trusted", head, rows, "tn", f"{DWELLS}{more}")
        yield Section("Dwells that are not trusted", [table])


def change_sections(sensor: SensorResult) -> Iterator[Section]:
    """Effect of the uncertain noise on inclusion; nothing without averages."""
    said, found = changes(sensor)
    if said:
        moved = [minus(f"{one.averaged - one.plug_in:+.3f}") for one in found]
        sizes = [(one.term, f"{one.plug_in:.3f}", f"{one.averaged:.3f}") for one in found]
        rows = [(*size, by) for size, by in zip(sizes, moved, strict=True)]
        head = ("term", "at the estimated noise", "averaged over the noise", "change")
        table = [Table(f"Inclusion of {sensor.id} with uncertain noise", head, rows)] if rows else []
        yield Section("Inclusion with uncertain noise", [Prose(said), *table])
