"""Components of a study, as blocks of its report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from markupsafe import Markup

from imubayes.campaign import SensorResult
from imubayes.reporting import blocks, chain_views, figures
from imubayes.reporting.fit_views import check_blocks, dwell_sections, misfit_sections, residual_blocks
from imubayes.reporting.method_views import methods_sections
from imubayes.reporting.noise_views import about_noise, noise_blocks, process_sentence
from imubayes.reporting.posterior import written_draws
from imubayes.reporting.rounding import in_unit, minus, models_text, on_output, pretty, probable, ten
from imubayes.reporting.rows import (
    confounded_sentences,
    fit_scale,
    labels,
    noise_floor,
    off_floor,
    own_groups,
    shortened,
    term_size,
)
from imubayes.reporting.scene_words import scene_section, scene_sentences
from imubayes.reporting.standard_views import standard_section, standards
from imubayes.scenes.relevance import Relevance
from imubayes.selection.models import Models
from imubayes.selection.verdicts import UNSEEN, TermVerdict, listed
from imubayes.sensors.terms import Kind
from imubayes.study import StudyResult
from imubayes.units import counted

MANY = 12
"""Components whose figures and answers a report holds; of more, each answer stands with its component, and
figures are drawn of `MOST_DRAWN` only."""

MOST_DRAWN = 3
"""Components of many that have figures: those whose rows fit worst."""

BRIEF = ("terms", "tell", "noise", "scene")
"""Parts of a component's section that a terminal shows."""

TERMS_HEAD = (
    "term", "symbol", "value", "± sd", "unit", "inclusion", "verdict", blocks.Both("largest effect", None),
    blocks.Both("confounded with", None),
)  # fmt: skip

VALUES = (
    " ± one standard deviation; a term that is not needed has the limit that its size, were it in the"
    " model, stays below with 95 %. The bar is the probability that the term is in the model, its whisker"
    " the range over prior widths from a third to three times; it is hollow where that is the prior's."
)

CHOICE = (
    "Left: bars are inclusion probabilities, black whiskers their range over prior widths, shapes the"
    f" verdicts ({blocks.LEGEND}). Then the best models side by side, each as wide as it is probable: a"
    " filled cell is a term that the model holds, blue where the models disagree. Then the evidence of all"
    " models of a size."
)

POSTERIOR = (
    "Blue: mean and ± 2 sd of the posterior, in sds of the prior; grey: ± 2 sd of the prior. The nearer a"
    " term's line is to a dot, the more the test tells of it."
)


@dataclass(frozen=True, slots=True)
class Shown:
    """A component of a study, and how much of it a report shows.

    Attributes
    ----------
    anchor : id of its section, and key of its figures.
    figures : how many components have figures; 0 where this one has none.
    twin : an earlier component that has the same residuals; None where there is none.
    """

    result: StudyResult
    sensor: SensorResult
    anchor: str
    figures: int
    twin: Shown | None


def shown_sensors(result: StudyResult) -> tuple[Shown, ...]:
    """Every component with how much is shown of it."""
    drawn = _drawn(result.sensors)
    first: dict[tuple[int, ...], Shown] = {}
    shown = []
    for k, sensor in enumerate(result.sensors):
        rows, figured = tuple(map(id, sensor.checks)), len(drawn) if k in drawn else 0
        earlier = first.get(rows) if rows and figured else None
        twin = earlier if earlier and earlier.figures else None
        shown.append(Shown(result, sensor, f"s{k + 1}", figured, twin))
        first.setdefault(rows, shown[-1])
    return tuple(shown)


def sensor_section(view: Shown, *, listed: bool) -> blocks.Section:
    """Section of a component; `listed` is whether the contents lead to its parts."""
    sensor = view.sensor
    at = " at draws of the noise" if sensor.chains else ""
    kind = f"class {sensor.class_id}" if sensor.class_id else "no class given"
    sub = (
        f"{sensor.kind}, {kind}; {counted(sensor.samples, 'sample')} in {counted(len(sensor.runs), 'run')};"
        f" {_weighed(sensor.selection.models, f'weighed{at} in {sensor.seconds:.1f} s')}"
    )
    required = [relevance for owner, relevance in view.result.scenes if owner == sensor.id]
    title = "What the scene requires" if len(required) == 1 else "What the scenes require"
    parts = (
        ("The terms", "terms", "terms", term_blocks(view)),
        ("What this test cannot tell, and what would", "tell", "what the test cannot tell", _open(view)),
        ("Is the calibration good?", "fit", "fit", _fit(view)),
        ("How sure is the choice?", "choice", "choice", _choice(view)),
        ("Posterior", "posterior", "posterior", _posterior(view)),
        ("Noise", "noise", "noise", noise_blocks(sensor, view.anchor, drawn=bool(view.figures))),
        *([(title, "scene", "scene", _required(view, required))] if required else []),
    )
    sections = [
        blocks.Section(
            title, list(told), f"{view.anchor}-{name}", listed=short if listed else "", brief=name in BRIEF
        )
        for title, name, short, told in parts
    ]
    own = [blocks.answer(chain_views.component_answer(sensor), doubtful=is_doubtful(sensor))]
    told = [
        blocks.Prose(
            blocks.joined(
                blocks.strong(f"Noise of {sensor.id}, {noise.run}."), process_sentence(noise, sensor)
            ),
            "answer",
        )
        for noise in sensor.processes
    ]
    first = [*told, *own] if about_noise(sensor) else [*own, *told]
    return blocks.Section(sensor.id, [*first, *sections], view.anchor, sub, brief=True)


def _weighed(models: Models, how: str) -> str:
    """Say how many models were weighed and how, and what that leaves out."""
    if models.n_models == 1 << len(models.candidates.names):
        return f"all {models_text(models.n_models)} models {how}"
    of = f"{models.n_models:,} of {models_text(1 << len(models.candidates.names))} models {how}"
    if math.isnan(models.error):
        return f"{of}, picked by the method: how probable the others are is not known"
    if math.isnan(models.missing):
        return f"{of}, drawn by a walk over them: inclusions are right to {models.error:.1g} (1 sd)"
    return f"{of}, searched for: the others carry at most {models.missing:.0e} of the probability"


def _drawn(sensors: Sequence[SensorResult]) -> set[int]:
    """Components that have figures: all of a few; of many the worst ones, no two of the same rows."""
    if len(sensors) <= MANY:
        return set(range(len(sensors)))
    rows = {tuple(map(id, sensor.checks)): k for k, sensor in reversed(list(enumerate(sensors)))}
    worst = sorted(
        rows.values(), key=lambda k: (not is_doubtful(sensors[k]), -off_floor(fit_scale(sensors[k])))
    )
    return set(worst[:MOST_DRAWN])


def is_doubtful(sensor: SensorResult) -> bool:
    """Whether a run does not fit, the library misses something, or chains have not converged."""
    return sensor.conditional or bool(chain_views.unconverged_sentence(sensor))


def term_blocks(view: Shown) -> Iterator[blocks.Block]:
    """Table of a component's terms, then its compensation, and other standards' symbols."""
    sensor = view.sensor
    terms = [term for term in sensor.selection.terms if term.verdict != "untested"]
    numbers = [(size.value, size.sd) for size in map(term_size, terms) if size] or [("", "")]
    places = ([len(text.partition(".")[2]) for text in column] for column in zip(*numbers, strict=True))
    digits = [*map(max, places)]
    known, lines = labels(sensor), list[blocks.Row]()
    for group, part in groupby(terms, key=lambda term: term.group):
        lines += [
            blocks.Row((group,)),
            *(blocks.Row(_term_cells(term, sensor.kind, known, digits)) for term in part),
        ]
    models, drawn = "the models", sensor.selection.models.drawn
    if drawn:
        models = f"{drawn:,} models drawn from those that count (right to about 0.02 sd)"
    averaged = f"Values are averaged over {models},{VALUES}"
    floor = (
        " The largest effect over the test stands beside a noise floor of"
        f" {in_unit(noise_floor(sensor))}, the lowest Allan deviation that the noise allows."
    )
    note = f"{averaged}{floor}" if view.figures else floor.strip()
    doubt = ", conditional" if sensor.conditional else ""
    head = [f"{word}{doubt}" if word == "verdict" else word for word in TERMS_HEAD]
    yield blocks.Table(f"Terms of {sensor.id}", head, lines, "ttnntntnt", note)
    if sensor.calibration:
        yield _compensation(sensor)
    if view.figures:
        equations = standards(view.result.study, sensor)
        yield from (standard_section(name, told, sensor) for name, told in equations.items())


def _term_cells(
    term: TermVerdict, kind: Kind, known: Mapping[str, str], digits: Sequence[int]
) -> tuple[blocks.Text, ...]:
    names = dict.fromkeys(known.get(name, name) for name in term.confounded_with)
    partners, limit = minus(shortened(tuple(names), 4)), term.verdict == "not needed"
    shared, effect = term.verdict == "inseparable", ""
    cells: tuple[str, str, str] = (blocks.quiet(f"with {partners}" if shared else "as the prior"), "", "")
    if size := term_size(term):
        value, power = _aligned(size.value, digits[0]), size.exponent
        unit = f"{f'{ten(power)} ' if power else ''}{pretty(size.unit)}"
        told = blocks.quiet(Markup("below {}").format(value)) if limit else value
        cells = (told, _aligned(size.sd, digits[1]) if size.sd else "", unit)
        effect = "" if limit else in_unit(on_output(abs(term.effect), kind))
    return (
        term.name,
        "" if term.symbol == "-" else minus(term.symbol),
        *cells,
        blocks.bar(term.inclusion, *term.inclusion_range, seen=term.verdict not in UNSEEN),
        blocks.verdict(term.verdict, reason=term.reason),
        effect,
        "" if shared else partners,
    )


def _aligned(text: str, digits: int) -> Markup:
    """Number whose decimal point stands below those of others with at most so many decimals."""
    whole, _, part = minus(text).partition(".")
    span = Markup('{}<span class="f" style="width:{}ch">{}</span>')
    return span.format(whole, digits + 0.4 if digits else 0, f".{part}" if part else "")


def _compensation(sensor: SensorResult) -> blocks.Section:
    calibration: Mapping[str, Any] = sensor.calibration or {}
    units = {"scale": "SI per unit of the file", "bias": "units of the file"}
    rows = [
        (name, minus(f"{calibration[name]:.7g}"), unit) for name, unit in units.items() if name in calibration
    ]
    angles = calibration.get("nonorthogonality", {})
    rows += [(name, minus(f"{angle:.6f}"), "rad") for name, angle in angles.items()]
    table = blocks.Table(f"Compensation of {sensor.id}", (), rows, "tnt")
    return blocks.Section(
        "Compensation of this component", [table, blocks.Prose(calibration.get("convention", ""))]
    )


def _open(view: Shown) -> Iterator[blocks.Block]:
    sensor = view.sensor
    extras = [entry.extra for entry in sensor.extras]
    confounded = confounded_sentences(own_groups(sensor.selection), sensor.selection.terms, extras)
    reasons: dict[tuple[str, str], list[str]] = {}
    for word in ("undecided", "unresolved", "untested"):  # the groups say it better for what is inseparable
        for term in sensor.selection.terms:
            if term.verdict == word:
                reasons.setdefault((word, term.reason), []).append(term.name)
    if not confounded and not reasons:
        yield blocks.Prose("Every term has its yes or no.")
    told = Markup("{}: <strong>{}</strong>. {}")
    words = [
        told.format(blocks.verdict(word).page, ", ".join(names), reason)
        for (word, reason), names in reasons.items()
    ]
    some = [
        f"At least one of {listed(terms)} is in the model with probability {probable(chance)}."
        for terms, chance in dict.fromkeys(sensor.selection.groups)
    ]
    yield from (blocks.Prose(said, "list") for said in (confounded, words, some))
    yield from chain_views.bench_sections(sensor)


def _fit(view: Shown) -> Iterator[blocks.Block]:
    sensor = view.sensor
    yield from check_blocks(sensor, drawn=bool(view.figures))
    if view.twin is not None:
        said = Markup(
            "The rows of a reference-free tumble belong to all its components: the figures stand with {}."
        )
        yield blocks.Prose(said.format(blocks.link(view.twin.sensor.id, f"{view.twin.anchor}-fit")), "note")
    elif view.figures:
        yield from residual_blocks(sensor, view.anchor, view.figures)
    yield from misfit_sections(sensor, view.anchor, drawn=bool(view.figures) and view.twin is None)
    yield from dwell_sections(sensor)


def _choice(view: Shown) -> Iterator[blocks.Block]:
    sensor, key = view.sensor, view.anchor
    keep, model = sensor.selection.costs.keep, ", ".join(sensor.selection.model) or "none"
    half = "one half" if keep == 0.5 else f"{keep:.2f}"
    yield blocks.Prose(
        f"Priors: {sensor.prior_source}. Excited terms with an inclusion of {half} or more: {model}."
    )
    if view.figures:
        panels = (
            figures.inclusion(sensor, f"{key}a"),
            figures.best_models(sensor, f"{key}b"),
            figures.model_size(sensor, f"{key}c"),
        )
        yield blocks.Figure(panels, CHOICE)
    if sensor.panel:
        yield from methods_sections(sensor, sensor.panel, drawn=bool(view.figures))
    yield from chain_views.change_sections(sensor)


def _posterior(view: Shown) -> Iterator[blocks.Block]:
    sensor, key, draws = view.sensor, view.anchor, written_draws(view.result)
    if view.figures:
        panel = figures.posterior(sensor, f"{key}p")
        yield blocks.Figure([panel], POSTERIOR) if panel else blocks.Prose("No term is kept.")
    yield from chain_views.chain_sections(sensor)
    said = "independent draws from the exact posterior"
    if sensor.chains:
        said = "draws of the full library, and as many averaged over the models,"
    yield blocks.Prose(f"{draws:,} {said} are in posterior.nc.", "note")


def _required(view: Shown, scenes: Sequence[Relevance]) -> Iterator[blocks.Block]:
    if not view.figures:
        yield blocks.Prose([" ".join(scene_sentences(scene, view.sensor.id)) for scene in scenes], "list")
        return
    symbols = {term.name: term.symbol for term in view.sensor.selection.terms}
    for k, relevance in enumerate(scenes):
        yield scene_section(relevance, view.sensor.id, symbols, f"{view.anchor}w{k}")
