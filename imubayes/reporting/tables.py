"""The results in a terminal: the verdict table, and what a test can tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, Group
from rich.text import Text

from imubayes.reporting.blocks import Both, Prose, Section, Table, terminal
from imubayes.reporting.chain_views import choice_sentences, method_sentence, unconverged_sentence
from imubayes.reporting.fit_views import CONDITIONAL, fit_sentence, temperature_sentence
from imubayes.reporting.method_views import unasked_sentences
from imubayes.reporting.noise_views import process_sentence
from imubayes.reporting.population_views import class_sentences
from imubayes.reporting.rows import (
    MARKS,
    bench_label,
    noise_cells,
    noise_origin,
    own_groups,
    shortened,
    term_rows,
)
from imubayes.reporting.scene_words import case_sentences, scene_sentences
from imubayes.reporting.session_views import session_sentence
from imubayes.reporting.words import (
    confounded_sentences,
    findings,
    sensor_groups,
    strain_sentence,
    weighed_text,
)
from imubayes.rig.filtering import MEANS
from imubayes.rig.recordings import ABSENT
from imubayes.selection.verdicts import listed
from imubayes.sensors.equations.standards import symbols
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.campaign.study import SensorCheck, SensorResult, StudyResult
    from imubayes.inference.linear import Extra
    from imubayes.inference.observability import Observability
    from imubayes.sensors.terms import Library

MOST_RUNS = 6
"""Noise lines before the rest is left to the report."""


MOST_GROUPS = 3
"""Groups of confounded terms whose numbers a verdict carries."""

MOST_PARTNERS = 3
"""Confounded terms that a row names."""


@dataclass(frozen=True, slots=True)
class _Verdict:
    """A verdict as shape, word and colour; ASCII where the terminal has no more."""

    word: str
    suffix: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        shape, plain, style = MARKS.get(self.word, ("·", ".", ""))
        yield Text(f"{plain if options.ascii_only else shape} {self.word}{self.suffix}", style=style)


def terminal_summary(result: StudyResult) -> Group:
    """Verdict table of each sensor, with groups, noise and fit, sessions and scenes, for a console.

    It fits 80 columns; without a terminal it is plain text.
    """
    sections = [_sensor(sensor) for sensor in result.sensors]
    if result.sessions:
        sections.append(Section("between sessions", [Prose(session_sentence(result.sessions))]))
    for found in result.classes:
        said = Prose(" ".join(class_sentences(found)))
        sections.append(Section(f"units of {found.class_id}, {found.kind}s", [said]))
    if result.scenes:
        told = [scene_sentences(found, sensor)[0] for sensor, found in result.scenes]
        told += [case_sentences(found, name)[0] for name, found in result.case_scenes]
        sections.append(Section("scenes", [Prose(told)]))
    return terminal(sections)


def _sensor(sensor: SensorResult) -> Section:
    how = sensor.method
    if sensor.chains is not None:
        found = sensor.chains.diagnostics
        how = f"{sensor.chains.sampler}, ESS {found.ess.min():,.0f}, R-hat {found.rhat.max():.3f}"
    data = (
        f"{counted(sensor.samples, 'sample')} in {counted(len(sensor.runs), 'run')};"
        f" {how}, {weighed_text(sensor.selection.models)}, {sensor.seconds:.1f} s"
    )
    told = (
        temperature_sentence(sensor).replace("µ", "u").replace("−", "-"),  # as the table beside it
        *findings(sensor),
        *sensor_groups(sensor, own_groups(sensor.selection), numbered=True),
        *(unasked_sentences(sensor.panel.unasked) if sensor.panel else ()),
        *_noise(sensor),
        *(
            f"{run.name}: {note}"
            for run in sensor.runs
            for note in run.source.notes
            if MEANS in note or ABSENT in note
        ),
    )
    blocks = (
        Prose((data, method_sentence(sensor), *choice_sentences(sensor.choice)), "note"),
        _term_table(sensor),
        Prose((unconverged_sentence(sensor), strain_sentence(sensor)), "warning"),
        Prose(told),
        Prose(fit_sentence(sensor), "" if all(check.fits for check in sensor.checks) else "warning"),
        Prose(CONDITIONAL if sensor.conditional else "", "warning"),
    )
    return Section(sensor.id, blocks, sub=f"{sensor.kind}, {sensor.class_id or 'no class'}")


def _noise(sensor: SensorResult) -> Iterator[str]:
    # one value each: what is estimated apart from the processes of a run would be a second one
    told_below = () if sensor.chains else {found.choice.run for found in sensor.processes}
    for run in (run for run in sensor.runs[:MOST_RUNS] if run.name not in told_below):
        cells = zip("NBK", noise_cells(run, sensor.kind, sensor.chains), strict=True)
        told = ", ".join(f"{name} {'below ' if limit else ''}{cell}" for name, (cell, limit) in cells)
        yield f"noise, {run.name}: {told} ({noise_origin(run, sensor.chains)})"
    if len(sensor.runs) > MOST_RUNS:
        yield f"noise of {len(sensor.runs) - MOST_RUNS} more runs: in the report"
    for found in sensor.processes[:MOST_RUNS]:
        yield f"{found.choice.run}: {process_sentence(found.choice, sensor)}"


def _term_table(sensor: SensorResult) -> Table:
    rows, lines = term_rows(sensor), []
    width = max((len(row.size.value) for row in rows if row.size and row.kind == "value"), default=0)
    groups = own_groups(sensor.selection)
    for row in rows:
        verdict, value = row.verdict, Both("", Text(row.text, style="dim"))
        if row.kind == "value" and row.size:  # values end at the same place: their +- stand below each other
            value = row.text.rjust(len(row.text) + width - len(row.size.value))
        numbers = [str(n) for n, group in enumerate(groups, 1) if verdict.name in group.terms]
        more = [f"+{len(numbers) - MOST_GROUPS}"] if len(numbers) > MOST_GROUPS else []
        told = f" [{','.join([*numbers[:MOST_GROUPS], *more])}]" if numbers else ""
        cells = verdict.name, verdict.symbol, value, f"{verdict.inclusion:.3f}"
        lines.append((*cells, Both("", _Verdict(verdict.verdict, told))))
    last = "verdict, conditional" if sensor.conditional else "verdict"
    return Table("", ("term", "symbol", "value +- sd", "inclusion", last), lines, "fftnf")


def terminal_check(check: SensorCheck) -> Group:
    """Say what the test can tell of each term before anything is fitted, for a rich console.

    The last part of the id names the component where the observability is a triad's (``ax.b0``, ...).
    """
    sensor_id, observability, lib, extras = check.id, check.observability, check.library, check.extras
    columns = _columns(sensor_id, observability, lib)
    kinds, spelt, rows = {extra.name: bench_label(extra) for extra in extras}, symbols(lib), []
    for term, (column, j) in zip(lib.terms, columns.items(), strict=True):
        partners = tuple(
            dict.fromkeys(
                kinds.get(name, _local(name, columns, lib)) for name in observability.partners(column)
            )
        )
        rows.append(
            (
                term.name,
                spelt[term.name],
                "yes" if observability.tested[j] else Both("", Text("no", style="bold magenta")),
                _ratio(observability.ratio[j]),
                _ratio(observability.alone[j]),
                _inflation(float(observability.vif[j])),
                shortened(partners, MOST_PARTNERS),
            )
        )
    head = ("term", "symbol", "excited", "sd / prior sd", "if alone", "inflation", "confounded with")
    words = (*_check_words(observability, columns, lib, extras), *check.notes)
    sub = f"{lib.kind}: what this test tells of {counted(len(lib.terms), 'term')}"
    return terminal([Section(sensor_id, [Table("", head, rows, "fffnnnf"), Prose(words)], sub=sub)])


def _columns(sensor_id: str, observability: Observability, lib: Library) -> dict[str, int]:
    """Columns of the component's own terms and their places, in the order of its library."""
    component = sensor_id.rpartition(".")[2]
    place = {name: j for j, name in enumerate(observability.names)}
    names = [own if (own := f"{component}.{name}") in place else name for name in lib.names]
    return {name: place[name] for name in names}


def _local(name: str, columns: dict[str, int], lib: Library) -> str:
    return dict(zip(columns, lib.names, strict=True)).get(name, name)


def _check_words(
    observability: Observability, columns: dict[str, int], lib: Library, extras: Sequence[Extra]
) -> Iterator[str]:
    untested = [_local(name, columns, lib) for name, j in columns.items() if not observability.tested[j]]
    groups = [
        replace(group, terms=tuple(_local(name, columns, lib) for name in group.terms))
        for group in observability.groups
        if not columns.keys().isdisjoint(group.terms)
    ]
    if untested:
        yield f"No run excites {listed(untested)}."
    yield from confounded_sentences(groups, (), extras)
    if not untested and not groups:
        yield "Every term is excited and separable."


def _ratio(ratio: float) -> str:
    return "-" if not math.isfinite(ratio) else f"{ratio:.3f}" if ratio >= 0.0005 else "<0.001"


def _inflation(vif: float) -> str:
    if not math.isfinite(vif):
        return "-"
    return f"{vif:.1f}" if vif < 1000.0 else f"{vif:.0e}".replace("e+0", "e").replace("e+", "e")
