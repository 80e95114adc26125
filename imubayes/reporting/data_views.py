"""The runs and files of a study, and tables measured elsewhere, as blocks of its report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from imubayes.reporting.blocks import Block, Prose, Section, Table, strong
from imubayes.reporting.rounding import duration, minus, pretty
from imubayes.reporting.rows import range_texts
from imubayes.selection.verdicts import listed

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from imubayes.campaign.study import Appendix, SensorResult, StudyResult
    from imubayes.inference.summary import RunSummary
    from imubayes.sensors.terms import Kind

HEAD = ("run", "procedure", "samples", "duration", "interval", "ranges", "checks and notes")


def data_section(result: StudyResult) -> Section:
    """Runs of every component, once where components share them, and the files they are read from."""
    sharing: dict[tuple[int, ...], list[SensorResult]] = {}
    for sensor in result.sensors:
        sharing.setdefault(tuple(map(id, sensor.runs)), []).append(sensor)
    files = Section("Files", [Prose([_file(source) for source in _sources(result)])])
    return Section("The data", [*map(_runs, sharing.values()), files], "runs")


def _runs(sensors: Sequence[SensorResult]) -> Section:
    """Runs that some components share."""
    title = f"Runs of {listed([sensor.id for sensor in sensors])}"
    rows = [_run(run, sensors[0].kind) for run in sensors[0].runs]
    return Section(title, [Table(title, HEAD, rows, "ttnnntw")])


def _run(run: RunSummary, kind: Kind) -> tuple[str, ...]:
    ranges = [
        f"{channel} {minus(low)} to {minus(high)} {pretty(unit)}"
        for channel, low, high, unit in range_texts(run, kind)
    ]
    stills = f"{len(run.stills)} stills. " if run.stills else ""
    times = (duration(run.duration), duration(run.sampling or run.interval))
    notes = f"{stills}{'; '.join(run.source.notes) or 'nothing to note'}"
    return (run.name, run.procedure, f"{run.samples:,}", *times, Markup("<br>").join(ranges), notes)


def _file(source: dict[str, Any]) -> Markup:
    """A file, its hash, and what is taken from it."""
    text = strong(source["file"])
    if source["sha256"]:
        text += Markup(', SHA-256 <code class="hash">{}</code>').format(source["sha256"])
    columns = [
        f"{column} as {channel}{f' [{unit}]' if unit else ''}" for column, channel, unit in source["columns"]
    ]
    return text + (Markup("<br>{}").format(", ".join(columns)) if columns else "")


def _sources(result: StudyResult) -> tuple[dict[str, Any], ...]:
    """Each file once, with the columns that all components take from it."""
    files: dict[tuple[str, str], dict[str, Any]] = {}
    for source in (run.source for sensor in result.sensors for run in sensor.runs):
        entry = {"file": source.file, "sha256": source.sha256, "columns": {}}
        files.setdefault((source.file, source.sha256), entry)["columns"] |= dict.fromkeys(source.columns)
    return tuple(files.values())


def appendix_section(tables: Sequence[Appendix]) -> Section:
    """Tables measured elsewhere."""
    return Section("Appendices", [Section(one.title, [*_appendix(one)]) for one in tables], "appendices")


def _appendix(one: Appendix) -> Iterator[Block]:
    yield Prose(one.note)
    columns = ["n" if all(map(_is_numeric, cells)) else "t" for cells in zip(*one.rows, strict=True)]
    yield Table(one.title, one.header, one.rows, "".join(["t", *columns[1:]]))
    if one.command:
        yield Prose("Made by", "note")
        yield Prose(one.command, "pre")


def _is_numeric(text: str) -> bool:
    """Whether a cell from elsewhere holds a number, to be aligned on the right.

    Examples
    --------
    >>> _is_numeric("12,000"), _is_numeric("3.1 s"), _is_numeric("full")
    (True, True, False)
    """
    return text.strip().lstrip("+-−<>~ ")[:1].isdigit()
