"""The report: one HTML file that opens offline, and all results written at once or not at all."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from imubayes.errors import InputError
from imubayes.reporting.case_views import MOST_DRAWN, case_views
from imubayes.reporting.case_words import held_together
from imubayes.reporting.population_views import class_views
from imubayes.reporting.posterior import write_posterior, written_draws
from imubayes.reporting.results import command, result_json, versions
from imubayes.reporting.rounding import duration, minus, pretty, probability, superscript
from imubayes.reporting.rows import MARKS, shortened
from imubayes.reporting.session_views import session_view
from imubayes.reporting.views import MANY, overview, run_groups, sensor_views, sources

if TYPE_CHECKING:
    from imubayes.campaign.study import StudyResult


def write_results(result: StudyResult, out: Path) -> tuple[Path, ...]:
    """Write ``report.html``, ``result.json`` and ``posterior.nc``.

    They are written beside `out` first and moved when all are complete, so nothing half-written is ever
    seen; earlier results in `out` are replaced, other files there are left alone.

    Parameters
    ----------
    out : folder, created with its parents.

    Returns
    -------
    paths of the files.

    Raises
    ------
    InputError : if the folder cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as folder:
            parts = _parts(result, Path(folder))
            out.mkdir(exist_ok=True)
            return tuple(part.replace(out / part.name) for part in parts)
    except OSError as problem:
        raise InputError(
            f"{out}: the results cannot be written there ({problem.strerror or problem}): "
            "expected a folder that can be written; choose another with --out"
        ) from None


def _parts(result: StudyResult, folder: Path) -> tuple[Path, ...]:
    """Write every file into a folder of its own; only then is the first one moved."""
    report, values, draws = folder / "report.html", folder / "result.json", folder / "posterior.nc"
    report.write_text(report_html(result), encoding="utf-8")
    values.write_text(result_json(result), encoding="utf-8")
    write_posterior(result, draws)
    return report, values, draws


def report_html(result: StudyResult) -> str:
    """Text of the report; names that come from files are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("imubayes", "reporting"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "pretty": pretty,
        "raised": superscript,
        "minus": lambda text: minus(str(text)),
        "chance": probability,
        "short": shortened,
        "amount": duration,
        "numeric": _is_numeric,
        "plain": lambda value: f"{value:.7g}",
    }
    cases = case_views(result)
    return environment.get_template("report.html.j2").render(
        study=result.study,
        views=sensor_views(result),
        marks={verdict: mark[0] for verdict, mark in MARKS.items()},
        run_groups=run_groups(result),
        sources=sources(result),
        versions=versions(),
        command=command(result.study),
        overview=overview(result) if len(result.sensors) > 1 else (),
        many=len(result.sensors) > MANY,
        sessions=session_view(result),
        classes=class_views(result),
        cases=cases,
        held=held_together(cases) if len(cases) > MOST_DRAWN else (),
        draws=written_draws(result),
    )


def _is_numeric(text: str) -> bool:
    """Whether a cell from elsewhere holds a number, to be aligned on the right.

    Examples
    --------
    >>> _is_numeric("12,000"), _is_numeric("3.1 s"), _is_numeric("full")
    (True, True, False)
    """
    return text.strip().lstrip("+-−<>~ ")[:1].isdigit()
