"""Results in a notebook: they show themselves, and become data frames, figures and ArviZ's data.

`ib.run` and `ib.select` give results whose classes stand below this room; `imubayes` has them equipped with
what follows when one of these names is first used::

    result                    # the first screen and the tables of terms
    result.to_dataframe()     # a row for each term, SI
    result.plot.terms()       # a figure of matplotlib
    result.to_arviz()         # draws of the posterior and the prior
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from imubayes.campaign import SensorResult
from imubayes.errors import InputError
from imubayes.selection.decision import Selection
from imubayes.selection.verdicts import UNSEEN, listed
from imubayes.study import StudyResult

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.figure import Figure
    from pandas import DataFrame

    from imubayes.reporting.blocks import Block
    from imubayes.selection.verdicts import TermVerdict

STYLE = (
    "<style>.imubayes svg{max-width:100%;height:auto;font-size:11px}"
    ".imubayes .bar{display:inline-block;width:100px;height:14px}.imubayes .bar .back{fill:#eceef1}"
    ".imubayes .bar .fill{fill:#0072B2;opacity:.55}"
    ".imubayes .bar :is(path,.hollow){stroke:currentColor;fill:none}"
    ".imubayes .said{fill:none;pointer-events:all}.imubayes .panel{margin:0}</style>"
)
"""Of what a notebook has no style for."""

COLUMNS = (
    "name", "symbol", "group", "verdict", "inclusion", "mean", "sd", "q05", "q95", "limit95", "unit",
    "full_mean", "full_sd", "prior_sd", "effect", "strain", "reason",
)  # fmt: skip
"""Of a data frame: attributes of a verdict; numbers are SI."""


@dataclass(frozen=True, slots=True)
class Plots:
    """Figures of a result by matplotlib; of one component, whose id is needed where there are several."""

    sensors: tuple[SensorResult, ...]

    def terms(self) -> Figure:
        """Every term of every component with its value and verdict."""
        from imubayes.reporting import canvas
        from imubayes.reporting.first_screen import first_panel

        return canvas.plotted(first_panel(self.sensors, "terms"))

    def inclusion(self, sensor: str = "") -> Figure:
        """Inclusion of every term with its range over prior widths."""
        return self._drawn("inclusion", sensor)

    def models(self, sensor: str = "") -> Figure:
        """The best models beside each other."""
        return self._drawn("best_models", sensor)

    def size(self, sensor: str = "") -> Figure:
        """Evidence of all models of a size."""
        return self._drawn("model_size", sensor)

    def posterior(self, sensor: str = "") -> Figure:
        """Posterior beside the prior of every term that is kept."""
        return self._drawn("posterior", sensor)

    def _drawn(self, name: str, sensor: str) -> Figure:
        """Draw one of the report's figures of a component."""
        from imubayes.reporting import canvas, figures

        sensors = [component for component in self.sensors if sensor in ("", component.id)]
        if len(sensors) != 1:
            ids = listed([component.id for component in self.sensors])
            raise InputError(f"sensor '{sensor}': expected the id of one of the result's components: {ids}")
        if (panel := getattr(figures, name)(sensors[0], name)) is None:
            raise InputError(f"{sensors[0].id}: no term is kept, so that there is no posterior to draw")
        return canvas.plotted(panel)


def equip() -> None:
    """Give the classes of results what this module says."""
    own: dict[type, dict[str, Any]] = {
        StudyResult: {
            "_repr_html_": lambda self: _html(_study_blocks(self)),
            "to_dataframe": lambda self: _frame(
                (sensor.id, sensor.selection.terms) for sensor in self.sensors
            ),
            "to_arviz": _arviz,
            "plot": property(lambda self: Plots(self.sensors)),
        },
        SensorResult: {
            "_repr_html_": lambda self: _html(_selection_blocks(self.selection)),
            "to_dataframe": lambda self: _frame([(self.id, self.selection.terms)]),
            "plot": property(lambda self: Plots((self,))),
        },
        Selection: {
            "_repr_html_": lambda self: _html(_selection_blocks(self)),
            "to_dataframe": lambda self: _frame([("", self.terms)]),
        },
    }
    for kind, more in own.items():
        for name, what in more.items():
            setattr(kind, name, what)


def _html(blocks: Sequence[Block]) -> str:
    from imubayes.reporting.blocks import environment

    shown = environment().get_template("blocks.html.j2").module.blocks(blocks, 4)  # type: ignore[attr-defined]
    return f'{STYLE}<div class="imubayes">{shown}</div>'


def _study_blocks(result: StudyResult) -> list[Block]:
    from imubayes.reporting.blocks import Figure as Drawn
    from imubayes.reporting.blocks import Prose
    from imubayes.reporting.document import report_page
    from imubayes.reporting.views import shown_sensors, term_blocks

    page = report_page(result)
    tables = [next(term_blocks(view)) for view in shown_sensors(result) if view.figures]
    drawn = [Drawn(block.panels) for block in page.first if isinstance(block, Drawn)]
    return [page.first[0], Prose(page.status), *drawn, *tables]


def _selection_blocks(selection: Selection) -> list[Block]:
    from imubayes.reporting.blocks import Table, bar, verdict
    from imubayes.reporting.rounding import minus, sized

    rows = []
    for term in selection.terms:
        shown = str(sized(term, term.mean, term.sd)) if term.verdict in ("needed", "undecided") else ""
        drawn = bar(term.inclusion, *term.inclusion_range, seen=term.verdict not in UNSEEN)
        rows.append((term.name, minus(term.symbol), shown, drawn, verdict(term.verdict, reason=term.reason)))
    return [Table("Verdicts", ("term", "symbol", "value", "inclusion", "verdict"), rows, "ttnnt")]


def _frame(sensors: Iterable[tuple[str, Sequence[TermVerdict]]]) -> DataFrame:
    """A row for each term; of several components with the id of each."""
    from pandas import DataFrame

    rows = [
        {"sensor": name, **{key: getattr(term, key) for key in COLUMNS}}
        for name, terms in sensors
        for term in terms
    ]
    frame = DataFrame(rows).rename(columns={"name": "term"})
    return frame if any(frame.sensor) else frame.drop(columns="sensor")


def _arviz(result: StudyResult) -> Any:
    """Draws as ArviZ has them: its `InferenceData`, or from its version 1 on xarray's `DataTree`."""
    import arviz
    from xarray import Dataset, DataTree

    from imubayes.reporting.posterior import posterior_groups

    groups: dict[str, Any] = {name: Dataset(*group) for name, group in posterior_groups(result)}
    if "InferenceData" in vars(arviz):  # asked for it, a later one warns
        return arviz.InferenceData(**groups)
    return DataTree.from_dict({f"/{name}": group for name, group in groups.items()})
