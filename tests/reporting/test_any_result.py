"""Every figure is drawn from any result: nothing, one sample, numbers without end, verdicts of one kind."""

import inspect
import math
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from fleets_found import fleet_result
from hypothesis import given, settings
from hypothesis import strategies as st
from lots_found import lot_result
from pages_made import hours_found, plan_found
from results_found import judged_result, recovered
from scenes_found import a_history, a_relevance
from tool_results import made_extremes, made_quality, made_ranks, made_speed
from trades_found import traded

import imubayes.reporting
import studies
from imubayes.inference.allan import AllanCurve
from imubayes.population.needs import VERDICTS
from imubayes.reporting import (
    canvas,
    case_views,
    figures,
    first_screen,
    fleet_page,
    hours_page,
    lots_figures,
    noise_views,
    plan_page,
    scene_words,
    trade_figures,
)
from imubayes.reporting.canvas import (
    SERIES,
    VERDICT_COLOURS,
    WARNING,
    Axes,
    Drawing,
    draw,
    plain_logs,
    rows_of,
)
from imubayes.sensors.terms import library
from studies.decision_quality import figures as quality_figures
from studies.extremes import figures as extremes_figures
from studies.ranks.page import rank_panel
from studies.speed import figures as speed_figures

Panels = Iterable[Drawing | None]

ALIKE = (0.0, -1.0, 1e-200, 1e200, math.inf, math.nan)
"""What may stand in the place of all numbers of a result."""

NUMBERS = (*ALIKE, 1.0, -math.inf)
"""What may stand in the place of any of them."""


def _noise() -> SimpleNamespace:
    tau = np.geomspace(1.0, 300.0, 12)
    shares = {symbol: tau**slope for symbol, slope in zip("NBK", (-0.5, 0.0, 0.5), strict=True)}
    total = np.sqrt(sum(share**2 for share in shares.values()))
    return SimpleNamespace(curve=AllanCurve(tau, 1.1 * total, 0.9 * total, 1.3 * total, shares, total))


def _traded() -> SimpleNamespace:
    found = traded()
    told = ("places", "floor", "best", "front", "place")
    return SimpleNamespace(**{name: getattr(found, name) for name in told})


def _of_choice(sensor: Any) -> Iterator[Drawing | None]:
    for paint in (figures.inclusion, figures.model_size, figures.best_models, figures.posterior):
        yield paint(sensor, paint.__name__)
    yield first_screen.first_panel([sensor], "first")


def _of_fit(sensor: Any) -> Iterator[Drawing | None]:
    for n, one in enumerate(sensor.misfit.dependences):
        yield figures.dependence(one, sensor.kind, f"m{n}")
    for check in sensor.checks:
        yield figures.over_time(check, "t")
        yield figures.autocorrelation(check, "c")
        yield figures.allan(check, sensor.kind, "l")


def _of_lots(result: Any) -> Iterator[Drawing | None]:
    yield lots_figures.slide(result, "a")
    yield lots_figures.scene_matrix(result, 0, "b")


def _of_quality(quality: Any) -> Iterator[Drawing | None]:
    told = quality.scores
    yield quality_figures.treatments_panel(quality.treated, "t")
    for paint in ("drops_panel", "cost_panel", "ratio_panel", "calibration_panel"):
        yield getattr(quality_figures, paint)(told, paint)


def _of_speed(speed: Any) -> Iterator[Drawing | None]:
    yield speed_figures.peers_panel(speed.contests)
    yield from (speed_figures.contest_panel(found, "c") for found in speed.contests)
    yield from (speed_figures.front_panel(found, "f") for found in speed.contests if found.subject == "trade")
    yield from (speed_figures.law_panel(law, "l") for law in speed.laws)


def _of_fleet(result: Any) -> Panels:
    pulls = [fleet_page.pull_panel(result, one.name, pulls, "u") for one, pulls in result.farthest]
    return (fleet_page.verdict_panel(result, "v"), *pulls)


FIGURES: dict[str, tuple[Callable[[], Any], Callable[[Any], Panels]]] = {
    "case": (recovered, lambda one: (case_views.recovered(one, "r"),)),
    "digits": (made_extremes, lambda found: (extremes_figures.digits_panel(found.outcomes, "x"),)),
    "choice": (judged_result, _of_choice),
    "fit": (judged_result, _of_fit),
    "fleet": (fleet_result, _of_fleet),
    "hours": (hours_found, lambda found: (hours_page.all_classes(found, "a"),)),
    "lots": (lot_result, _of_lots),
    "noise": (_noise, lambda found: (noise_views.allan_panel(found, "gyroscope", "n"),)),
    "plan": (plan_found, lambda found: (plan_page.predicted_panel(found, "p"),)),
    "quality": (cache(made_quality), _of_quality),
    "ranks": (made_ranks, lambda found: (rank_panel(found, "b0", "r"),)),
    "scene": (a_relevance, lambda found: (scene_words.scene_path(found, "m", 1.0, "p"),)),
    "history": (a_history, lambda found: scene_words.scene_histories(found, "h")),
    "speed": (made_speed, _of_speed),
    "trade": (_traded, lambda found: (trade_figures.trade_panel(found),)),
}
"""An example of what each family of figures shows, and how it is drawn."""


EXTENDED = {
    f"{name} of an extended {kind}": (
        lambda kind=kind: judged_result(lib=library(kind, set="extended", temperature=1)),
        FIGURES[name][1],
    )
    for name in ("choice", "fit")
    for kind in ("accelerometer", "gyroscope")
}


@pytest.mark.parametrize("name", [*FIGURES, *EXTENDED])
def test_figure_is_small_vector_svg_with_words_for_those_who_cannot_see_it(name):
    make, paint = (FIGURES | EXTENDED)[name]
    for panel in filter(None, paint(make())):
        root = ElementTree.fromstring(panel.svg)
        assert root.get("role") == "img" and len(root.get("aria-label", "")) > 20 and panel.title
        assert not [*root.iter("image"), *root.iter("style")] and list(root.iter("text"))
        assert len(panel.svg) < 30_000
        ids = re.findall(r'\bid="([^"]+)"', panel.svg)
        assert set(re.findall(r"url\(#([\w.-]+)", panel.svg)) <= set(ids) and len(ids) == len(set(ids))


ASKED = ("study", "trade", "ladder", "costs", "budget", "sensor_class", "draws", "prior_draws")
"""What was asked is as it was."""

POSITIVE = (
    "seconds", "whole_seconds", "fastest", "widths", "sizes", "strength", "tau", "prior_sd", "at_one", "best",
)  # fmt: skip
SHARES = ("inclusion", "inclusion_range", "keeps", "correct")
FINITE = ("by_size",)
"""Names of numbers that are finite and above zero, from 0 to 1, or finite, whatever is measured."""


Numbers = Callable[[np.ndarray], np.ndarray]


def changed(value: Any, numbers: Numbers, name: str = "") -> Any:
    """The same result with other numbers; counts, names and shapes stay."""
    if isinstance(value, float):
        return possible(name, numbers(np.array(value))).item()
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return possible(name, numbers(value))
    if isinstance(value, tuple) and type(value) is tuple:
        return tuple(changed(one, numbers, name) for one in value)
    if isinstance(value, dict):
        return {key: changed(one, numbers, name) for key, one in value.items()}
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**{key: changed(one, numbers, key) for key, one in vars(value).items()})
    if is_dataclass(value) and not isinstance(value, type):
        found = [f.name for f in fields(value) if f.name not in ASKED]
        return replace(value, **{name: changed(getattr(value, name), numbers, name) for name in found})
    return value


def possible(name: str, values: np.ndarray) -> np.ndarray:
    """What can stand under a name instead of some numbers."""
    if name in POSITIVE:
        size = np.abs(values)
        return np.where((size > 0.0) & (size < math.inf), size, 1.0)
    if name in SHARES:
        return np.clip(values, 0.0, 1.0)
    return np.where(np.isfinite(values), values, 0.0) if name in FINITE else values


def drawn(name: str, numbers: Numbers) -> None:
    make, paint = FIGURES[name]
    with np.errstate(all="ignore"):
        shown(paint(changed(make(), numbers)))


def shown(panels: Panels) -> None:
    for panel in panels:
        if panel is not None:
            assert ElementTree.fromstring(panel.svg).get("role") == "img"
            assert panel.title


SCALED: dict[str, Callable[[Axes], object]] = {
    "linear": lambda axes: axes.set(xlabel="x", ylabel="y", xlim=(-1.234, 5.0), ylim=(2e-9, -3e-9)),
    "large": lambda axes: axes.set(xlabel="x", xlim=(-3e9, 7e9)),
    "log": lambda axes: (axes.set(xlim=(0.02, 700.0), ylim=(3.0, 8.0), ylabel="y"), plain_logs(axes)),
    "rows": lambda axes: rows_of(axes, ["short", "a long name", "−1"]),
    "named": lambda axes: (
        axes.set_xticks([0.2, 0.8, 1.7], ["left", "right", "beyond"]),
        axes.tick_params(axis="x", labelrotation=90, length=0),
        axes.set(xlabel="x", xlim=(0.0, 1.0)),
    ),
}


@pytest.mark.parametrize("scaled", SCALED)
def test_ticks_and_titles_stand_where_matplotlib_has_them(scaled, monkeypatch):
    def words() -> list[tuple[str, list[float]]]:
        root = ElementTree.fromstring(draw(SCALED[scaled], title="", alt="", key="k").svg)
        places = (
            (one.text, " ".join(one.get(key, "") for key in ("x", "y", "transform"))) for one in root.iter()
        )
        return sorted(
            (text, [float(size) for size in re.findall(r"-?\d[\d.]*", at)]) for text, at in places if text
        )

    own = words()
    monkeypatch.delattr(canvas._AnyAxes, "draw")
    assert len(own) > 3 and [text for text, _ in own] == [text for text, _ in words()]
    for (_, at), (_, at_own) in zip(words(), own, strict=True):
        np.testing.assert_allclose(at_own, at, atol=0.02)


@pytest.mark.parametrize("number", ALIKE)
@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_drawn_where_all_numbers_are_the_same(name, number):
    drawn(name, lambda old: np.full(old.shape, number))


@settings(max_examples=2)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 1.0))
@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_drawn_from_any_mixture_of_numbers(name, seed, share):
    rng = np.random.default_rng(seed)
    drawn(name, lambda old: np.where(rng.random(old.shape) < share, rng.choice(NUMBERS, old.shape), old))


def cut(value: Any, count: int) -> Any:
    """The same result with its first `count` samples only."""
    if isinstance(value, np.ndarray):
        return value[:count]
    if isinstance(value, dict):
        return {key: cut(one, count) for key, one in value.items()}
    found = {f.name: getattr(value, f.name) for f in fields(value)}
    return replace(value, **{k: cut(v, count) for k, v in found.items() if isinstance(v, np.ndarray | dict)})


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_samples_are_drawn(count):
    sensor = judged_result()
    shown(_of_fit(replace(sensor, checks=tuple(cut(check, count) for check in sensor.checks))))
    if count:
        noisy = SimpleNamespace(curve=cut(_noise().curve, count))
        shown((noise_views.allan_panel(noisy, "gyroscope", "n"),))
        shown((figures.dependence(cut(sensor.misfit.dependences[0], count), sensor.kind, "m"),))
        shown((case_views.recovered(recovered(count=count), "r"),))
        shown((extremes_figures.digits_panel(made_extremes().outcomes[:count], "x"),))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_verdicts_of_one_kind_are_drawn(verdict):
    judged, fleet = judged_result(), fleet_result()
    terms = tuple(replace(term, verdict=verdict) for term in judged.selection.terms)
    judged = replace(judged, selection=replace(judged.selection, terms=terms))
    shown(_of_choice(judged))
    counts = np.zeros_like(fleet.counts)
    counts[VERDICTS.index(verdict)] = fleet.units
    shown(_of_fleet(replace(fleet, counts=counts)))


def test_a_singular_rung_is_called_so_and_not_drawn() -> None:
    """Its height would leave no room for all others."""
    drawn, left = (trade_figures.trade_panel(traded(first=first)).svg for first in (1.1, 1e17))
    assert ">means<" in drawn and ">means<" not in left
    assert "singular at most" in left


def test_no_figure_is_missing_here():
    """Every public function that draws is named in this file."""
    told = Path(__file__).read_text()
    for found in (
        *pkgutil.walk_packages(imubayes.reporting.__path__, "imubayes.reporting."),
        *pkgutil.walk_packages(studies.__path__, "studies."),
    ):
        module = import_module(found.name)
        if "figures" in found.name or (hasattr(module, "draw") and not found.name.endswith(".canvas")):
            assert found.name.rpartition(".")[2] in told
            for name, function in inspect.getmembers(module, inspect.isfunction):
                own = function.__module__ == found.name and not name.startswith("_")
                if own and "Panel" in str(function.__annotations__.get("return")):
                    assert re.search(rf"\b{name}\b", told), f"{found.name}.{name}"


def test_one_colour_has_one_meaning() -> None:
    """What is undecided, cannot be told, or calls for attention has a colour that nothing else has."""
    kept = {VERDICT_COLOURS["undecided"], VERDICT_COLOURS["inseparable"], WARNING}
    assert len(kept) == 3
    assert kept.isdisjoint(SERIES) and kept.isdisjoint(noise_views.COLOURS.values())
    assert len(quality_figures.LABELLED) < len(SERIES)


def test_small_number_beside_an_axis_is_drawn_as_it_is() -> None:
    """Coordinates are shortened to hundredths of a pixel, texts are not."""
    panel = draw(lambda axes: axes.set_xticks([0.001, 0.125]), title="", alt="", key="a")
    assert ">0.001</text>" in panel.svg and ">0.125</text>" in panel.svg
