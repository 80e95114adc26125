"""What the report shows of a scene, and what ``result.json`` keeps of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from markupsafe import Markup

from imubayes.reporting.blocks import Figure, Prose, Section, Table, quiet
from imubayes.reporting.result.entries import Scene, TermInScene
from imubayes.reporting.result.values import published
from imubayes.reporting.rounding import (
    OUTPUT_SI,
    OUTPUT_UNIT,
    in_unit,
    measured,
    minus,
    per_unit,
    pretty,
    share,
)
from imubayes.reporting.scene_figures import SIGNS, path, quadrants
from imubayes.reporting.scene_words import amount, limit, printed_unit, scene_sentences

if TYPE_CHECKING:
    from imubayes.scenes.relevance import Relevance, TermRelevance

CAPTION = (
    "Right of the pale line a term takes a tenth of the budget or more, right of the dashed one all of it;"
    " above the middle it is more likely there than not. Terms that are there stand at the median of their"
    " share, the others at the share that they stay below with 95 %. Names of the scene's model are dark."
)

ASSUMED = (
    "straight and level, one axis, heading fixed; the error is looked at over the whole mission, and the"
    " terms that are kept are compensated with their posterior means"
)


HEAD = (
    "term", "symbol", "inclusion", "rms effect", "error", "of the budget", "90 % interval", "could take",
    "model", "inclusion and relevance",
)  # fmt: skip

CROSSES = (
    "Triangles and crosses above the middle are terms that the test cannot tell: their inclusion is the"
    " prior's."
)


def scene_section(found: Relevance, sensor: str, symbols: Mapping[str, str], key: str) -> Section:
    """What a scene requires of a component.

    Parameters
    ----------
    found : what the scene requires of a component.
    sensor : id of the component.
    symbols : IEEE symbol of each term.
    key : identifier of ASCII letters and digits, unique in the page.
    """
    ranked = sorted(found.terms, key=lambda term: (-max(term.share[1], term.possible), term.name))
    rows = [_row(found, term, symbols.get(term.name, "-")) for term in ranked]
    table = Table(f"{sensor} in {found.scene}", HEAD, rows, "ttnnnnnntt", _note(found))
    said = Prose(pretty(" ".join(scene_sentences(found, sensor))))
    panels = (quadrants(found, f"{key}a"), path(found, f"{key}b"))
    return Section(found.scene, [said, table, Figure(panels, f"{CAPTION} {CROSSES}")])


def _note(found: Relevance) -> str:
    """Budget, what is left of it and by what, and what the numbers rest on."""
    whole, left_out = (pretty(amount(found, value)) for value in (found.uncompensated[0], found.left_out[0]))
    calibrated, left = (pretty(limit(found, value)) for value in (found.calibrated[1], found.left[1]))
    n, b, k = (pretty(amount(found, value)) for value in found.noise)
    assumed = ASSUMED if found.budget.quantity != "output" else "rms over the rows of the scene"
    notes = f" The scene: {'; '.join(found.notes)}." if found.notes else ""
    return (
        f"Budget {pretty(amount(found, found.budget.limit))}. Without compensation {whole}; with every term"
        f" kept at most {calibrated}, with this model at most {left} (95 %), of which the terms left out take"
        f" {left_out}. Noise (one sd): N {n}, B {b}, K {k}. Assumed: {assumed}.{notes} “Could take”: at the"
        " size that the term, were it there, stays below with 95 %."
    )


def _row(found: Relevance, term: TermRelevance, symbol: str) -> tuple[str, ...]:
    output, (unit, size) = OUTPUT_UNIT[found.kind], printed_unit(found)
    low, half, high = (share(value) for value in term.share)
    return (
        term.name,
        "" if symbol == "-" else minus(symbol),
        f"{term.inclusion:.3f}",
        in_unit(measured(term.rms / per_unit(output, OUTPUT_SI[found.kind]), 0.0, output)),
        in_unit(measured(term.effect / size, 0.0, unit)),
        half,
        quiet(low if low == high else f"{low} to {high}"),
        quiet(share(term.possible)),
        "✓ kept" if term.kept else "left out",
        Markup('<span aria-hidden="true">{}</span> {}').format(SIGNS[term.quadrant], term.quadrant),
    )


def published_scene(found: Relevance, sensor: str) -> Scene:
    """Publish what a scene requires of a component."""
    return published(
        Scene,
        found,
        name=found.scene,
        sensor=sensor,
        within_budget=found.met,
        terms=tuple(map(_published_term, found.terms)),
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
