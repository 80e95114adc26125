"""What the report shows of a scene, and what ``result.json`` keeps of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imubayes.reporting.canvas import Panel
from imubayes.reporting.result.entries import Budget
from imubayes.reporting.result.sensors import Scene, TermInScene
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import OUTPUT_SI, OUTPUT_UNIT, Measured, measured, per_unit, pretty, share
from imubayes.reporting.scene_figures import SIGNS, path, quadrants
from imubayes.reporting.scene_words import amount, limit, printed_unit, scene_sentences

if TYPE_CHECKING:
    from imubayes.selection.relevance import Relevance, TermRelevance

CAPTION = (
    "Right of the pale line a term takes a tenth of the budget or more, right of the dashed one all of it;"
    " above the middle it is more likely there than not. Terms that are there stand at the median of their"
    " share, the others at the share that they stay below with 95 %. Names of the scene's model are dark."
)

ASSUMED = (
    "straight and level, one axis, heading fixed; the error is looked at over the whole mission, and the"
    " terms that are kept are compensated with their posterior means"
)


@dataclass(frozen=True, slots=True)
class SceneRow:
    """One term of the table.

    Attributes
    ----------
    name, symbol : of the term.
    inclusion : posterior probability.
    rms : effect on the output.
    effect : median effect on what is budgeted.
    share, low, high : of the budget, median and 90 % interval, as text.
    possible : share at the limit with 95 %, as text.
    kept : whether the scene's model has it.
    quadrant, sign : what inclusion and relevance say together, and its shape.
    """

    name: str
    symbol: str
    inclusion: float
    rms: Measured
    effect: Measured
    share: str
    low: str
    high: str
    possible: str
    kept: bool
    quadrant: str
    sign: str


@dataclass(frozen=True, slots=True)
class SceneView:
    """A scene's section for one component.

    Attributes
    ----------
    scene, sensor : of what.
    sentences : the finding.
    rows : the table, what costs most first.
    panels : inclusion against relevance, and error against the size of the model.
    caption : how to read the first panel.
    budget, left, left_out, calibrated, uncompensated : errors as text.
    noise : what N, B and K come to, as text.
    assumed : what the numbers rest on.
    notes : how the scene was made.
    """

    scene: str
    sensor: str
    sentences: tuple[str, ...]
    rows: tuple[SceneRow, ...]
    panels: tuple[Panel, ...]
    caption: str
    budget: str
    left: str
    left_out: str
    calibrated: str
    uncompensated: str
    noise: tuple[str, str, str]
    assumed: str
    notes: tuple[str, ...]


def scene_view(found: Relevance, sensor: str, symbols: Mapping[str, str], key: str) -> SceneView:
    """Prepare a scene's section.

    Parameters
    ----------
    found : what the scene requires of a component.
    sensor : id of the component.
    symbols : IEEE symbol of each term.
    key : identifier of ASCII letters and digits, unique in the page.
    """
    ranked = sorted(found.terms, key=lambda term: (-max(term.share[1], term.possible), term.name))
    panels = (quadrants(found, f"{key}a"), path(found, f"{key}b"))
    noise = tuple(pretty(amount(found, value)) for value in found.noise)
    return SceneView(
        scene=found.scene,
        sensor=sensor,
        sentences=tuple(pretty(text) for text in scene_sentences(found, sensor)),
        rows=tuple(_row(found, term, symbols.get(term.name, "-")) for term in ranked),
        panels=panels,
        caption=CAPTION,
        budget=pretty(amount(found, found.budget.limit)),
        left=pretty(limit(found, found.left[1])),
        left_out=pretty(amount(found, found.left_out[0])),
        calibrated=pretty(limit(found, found.calibrated[1])),
        uncompensated=pretty(amount(found, found.uncompensated[0])),
        noise=(noise[0], noise[1], noise[2]),
        assumed=ASSUMED if found.budget.quantity != "output" else "rms over the rows of the scene",
        notes=found.notes,
    )


def _row(found: Relevance, term: TermRelevance, symbol: str) -> SceneRow:
    output, (unit, size) = OUTPUT_UNIT[found.kind], printed_unit(found)
    low, half, high = (share(value) for value in term.share)
    return SceneRow(
        name=term.name,
        symbol=symbol,
        inclusion=term.inclusion,
        rms=measured(term.rms / per_unit(output, OUTPUT_SI[found.kind]), 0.0, output),
        effect=measured(term.effect / size, 0.0, unit),
        share=half,
        low=low,
        high=high,
        possible=share(term.possible),
        kept=term.kept,
        quadrant=term.quadrant,
        sign=SIGNS[term.quadrant],
    )


def published_scene(found: Relevance, sensor: str) -> Scene:
    """Publish what a scene requires of a component."""
    sizes = {
        name: dict(zip(("median", "q95"), getattr(found, name), strict=True))
        for name in ("left_out", "left", "calibrated", "uncompensated")
    }
    return published(
        Scene,
        found,
        name=found.scene,
        sensor=sensor,
        budget=published(Budget, found.budget),
        within_budget=found.met,
        terms=tuple(map(_published_term, found.terms)),
        path=[{"terms": n, "dropped": name, "error": error} for n, name, error in found.path],
        noise=dict(zip("NBK", found.noise, strict=True)),
        **sizes,
    )


def _published_term(term: TermRelevance) -> TermInScene:
    low, half, high = term.share
    return published(
        TermInScene,
        term,
        share_of_budget=half,
        share_q05=low,
        share_q95=high,
        share_at_limit95=term.possible,
        share_unknown=term.unknown,
    )
