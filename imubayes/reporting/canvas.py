"""A figure as small inline SVG: the only module that knows matplotlib.

Text stays text, the page's own font is used, nothing is rasterised, and the same data give the same bytes.
"""

from __future__ import annotations

import io
import json
import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import compress
from textwrap import wrap
from typing import Any, Literal, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.ticker import (
    FixedFormatter,
    FixedLocator,
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    NullLocator,
)

from imubayes.algebra import FloatArray
from imubayes.reporting.inline import inline

INK = "#20242a"
GREY = "#7d838c"
SOFT = "#5c636d"
PALE = "#d5d9df"
ACCENT = "#0072B2"
WARNING = "#D55E00"
VERDICT_COLOURS = {
    "needed": ACCENT,
    "not needed": GREY,
    "undecided": "#E69F00",
    "inseparable": "#CC79A7",
    "unresolved": "#CC79A7",
    "untested": GREY,
}
"""Okabe and Ito's colours, which people with any colour vision tell apart; a shape goes with each."""

SERIES = (ACCENT, "#009E73", "#56B4E9", INK)
"""Colours of ensembles or sessions beside each other. Orange is left to what is undecided, vermilion to
limits and to what calls for attention, purple to what cannot be told."""

SHADES = ("#eceef1", "#cfe3f1", "#9ccbe6", "#3d92c4", ACCENT)
"""Of tiles, from little to much: the darker the more, in grey print too."""

WIDTH = 350
"""px: panels flow beside each other on a desk, and one fits the width of a telephone."""

SLIDE, MARGIN, HEAD, FOOT = (1100, 619), 16, 102, 30
"""px of a slide, 16 to 9; of its margins; of the answer above its picture; and of the source below."""

LETTERS = 124
"""Letters of a line of a slide's answer."""

TICK, PAD = 3.0, 3.5
"""px of a tick, and from there to its label."""

Box = tuple[float, float, float, float]
"""Left, top, width and height in px."""

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "imubayes",
    "path.simplify": False,
    "text.parse_math": False,
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 11,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "axes.formatter.limits": (-3, 5),
    "axes.formatter.useoffset": False,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.size": TICK,
    "ytick.major.size": TICK,
}


class Room(NamedTuple):
    """px of a panel, and around its axes for tick labels and axis titles."""

    width: int = WIDTH
    height: int = 180
    left: int = 46
    right: int = 10
    top: int = 6
    bottom: int = 38


USUAL = Room()
"""Of a panel that asks for no other."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawn figure: the finding as its title, safe inline SVG, and what draws it again in its room."""

    title: str
    svg: str
    paint: Callable[[Axes], None]
    room: Room


def draw(
    paint: Callable[[Axes], None],
    *,
    title: str,
    alt: str,
    key: str,
    room: Room = USUAL,
    said: Sequence[tuple[Box, str]] = (),
) -> Drawing:
    """Draw one panel.

    Parameters
    ----------
    paint : draws on the axes it is given.
    alt : what the panel shows, for people who cannot see it. It may hold names from files: it is escaped.
    key : identifier of ASCII letters and digits, unique in the page; keeps the panels' inner ids apart.
    said : boxes in px from the left upper end, and what each says where a pointer rests.
    """
    figure = _figure(paint, room)
    svg = _bytes(figure, "svg", transparent=True).decode()
    box = f'viewBox="0 0 {room.width} {room.height}" width="{room.width}" height="{room.height}"'
    about = f'role="img" aria-label="{escape(alt)}"{_scales(figure.axes[0], room.height)}'
    hovers = "".join(
        f'<rect x="{x:.4g}" y="{y:.4g}" width="{w:.4g}" height="{h:.4g}" class="said">'
        f"<title>{escape(text)}</title></rect>"
        for (x, y, w, h), text in said
    )
    return Drawing(title, f"<svg {box} {about}>{inline(svg, key)}{hovers}</svg>", paint, room)


def _scales(axes: Axes, height: int) -> str:
    """Attribute by which a page's script says what a place in the figure stands for; empty without axes.

    JSON: left, top, width and height of the axes in px; then of x and of y null where it has no ticks, or
    its title, whether it is a logarithm, both ends, and (place, name) of ticks that are no numbers.
    """
    told: list[list[Any] | None] = []
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        ticks = axis.get_majorticklocs()
        words = axis.get_major_formatter().format_ticks(ticks.tolist())
        named = isinstance(axis.get_major_locator(), FixedLocator) and any(map(_LETTERS.search, words))
        names = list(zip(ticks, words, strict=True)) if named else []
        limits = (float(f"{end:.5g}") for end in ends)
        about = [axis.get_label_text(), axis.get_scale() == "log", *limits, names]
        told.append(about if len(ticks) and axis.get_visible() else None)
    if not axes.axison or not any(told):
        return ""
    x, y, w, h = axes.get_window_extent().bounds
    box = [round(edge, 1) for edge in (x, height - y - h, w, h)]
    text = json.dumps([box, *told], ensure_ascii=False, separators=(",", ":"), default=float)
    return f' data-scales="{escape(text)}"'


_LETTERS = re.compile(r"[^\W\d_]")


def plotted(panel: Drawing) -> Figure:
    """Draw a panel as a figure of matplotlib, which shows itself in a notebook."""
    with matplotlib.rc_context(_STYLE), np.errstate(all="ignore"):
        figure = _figure(panel.paint, panel.room)
        figure.suptitle(panel.title, size=9, weight="bold", y=1.0, va="bottom", wrap=True)
        return figure


def _figure(
    paint: Callable[[Axes], None],
    room: Room,
    size: tuple[float, float] | None = None,
    at: tuple[float, float] = (0.0, 0.0),
) -> Figure:
    """Draw axes in their room, which begins somewhere in a figure that may be larger; all in px."""
    wide, high = size or room[:2]
    box = ((at[0] + room.left) / wide, (at[1] + room.bottom) / high)
    inside = (room.width - room.left - room.right) / wide, (room.height - room.top - room.bottom) / high
    with matplotlib.rc_context(_STYLE), np.errstate(all="ignore"):
        figure = Figure(figsize=(wide / 72.0, high / 72.0), dpi=72)
        paint(figure.add_axes((*box, *inside), axes_class=_AnyAxes))
    return figure


def slides(panel: Drawing, heading: str, source: str) -> dict[str, bytes]:
    """Draw a panel as a slide, ``svg`` and ``png``, under what it answers and above where it is from.

    All is in px of the panel: what it has is drawn as on the page, and then is larger. The PNG is as wide as
    two slides.
    """
    width, height, *_ = panel.room
    free = SLIDE[0] - 2.0 * MARGIN, SLIDE[1] - HEAD - FOOT
    scale = min(free[0] / width, free[1] / height)
    wide, high = SLIDE[0] / scale, SLIDE[1] / scale
    at = (wide - width) / 2.0, FOOT / scale + (free[1] / scale - height) / 2.0
    edge, line = MARGIN / SLIDE[0], 1.0 / SLIDE[1]
    said = "\n".join(wrap(heading, LETTERS)[:4])

    figure = _figure(panel.paint, panel.room, (wide, high), at)
    with matplotlib.rc_context(_STYLE):
        figure.text(edge, 1.0 - 12 * line, said, va="top", size=15 / scale, weight="bold", linespacing=1.25)
        figure.text(edge, 8 * line, source, va="bottom", size=10 / scale, color=SOFT)
    return {
        "svg": _bytes(figure, "svg"),
        "png": _bytes(figure, "png", dpi=(2 * SLIDE[0] + 0.01) / (wide / 72.0)),
    }


def _bytes(figure: Figure, form: str, **options: Any) -> bytes:
    """Bytes of a file of a figure, the same whenever it is drawn."""
    names = ("Date", "Creator", "Format", "Type") if form == "svg" else ("Software",)
    with matplotlib.rc_context(_STYLE), np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # names in letters that browsers have
        buffer = io.BytesIO()
        figure.savefig(buffer, format=form, metadata=dict.fromkeys(names), **options)
        return buffer.getvalue()


class _AnyAxes(Axes):
    """Axes that take the numbers of any result, so that no figure has to look at its own before it sets them.

    A limit that is not finite, or not positive on a log axis, stays where the data put it; limits that are
    the same are moved apart; and an axis on which nothing is positive stays linear.
    """

    def draw(self, renderer: Any) -> None:
        shown = [axis for axis in (self.xaxis, self.yaxis) if self.axison and axis.get_visible()]
        for axis in shown:
            self._draw_ticks(axis, renderer)
            axis.set_visible(False)
        super().draw(renderer)
        for axis in shown:
            axis.set_visible(True)

    def _draw_ticks(self, axis: Axis, renderer: Any) -> None:
        """Draw ticks as one path, their labels as one text that moves, and the title; all is in pixels.

        Ticks of matplotlib are five artists each, and took most of the time of a figure.
        """
        along, places, form = int(axis is self.yaxis), axis.get_majorticklocs(), axis.get_major_formatter()
        names, about, point = (
            form.format_ticks(places.tolist()),
            axis.get_tick_params(),
            self.figure.dpi / 72.0,
        )
        at = np.tile([self.get_xlim()[0], self.get_ylim()[0]], (len(places), 1))
        at[:, along] = places
        at = self.transData.transform(at)
        inside = (self.bbox.min[along] - 0.01 <= at[:, along]) & (at[:, along] <= self.bbox.max[along] + 0.01)
        down = np.eye(2)[1 - along] * point
        ends = at[inside] - down * (long := about.get("length", TICK))
        marks = np.stack([at[inside], ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2)
        label = Text(color=INK, size=11, parse_math=False, rotation=about.get("rotation", 0.0))
        label.set(ha="right" if along else "center", va="center_baseline" if along else "top")
        for artist in (mark := Line2D(*marks.T, color=GREY, linewidth=0.8, solid_capstyle="butt"), label):
            artist.set_figure(self.figure)
        if long:
            mark.draw(renderer)
        taken, measured = [float(self.bbox.min[1 - along])], bool(axis.get_label_text() or form.get_offset())
        for spot, name in zip(ends - PAD * down, compress(names, inside), strict=True):
            label.set(text=name, position=spot)
            label.draw(renderer)
            if measured:
                taken.append(label.get_window_extent(renderer).min[1 - along])
        beside = min(taken) - axis.labelpad * point
        axis.label.set_position((beside, 0.5) if along else (0.5, beside))
        above = float(self.bbox.ymax) + 3.0 * point
        axis.offsetText.set_position((0.0, above) if along else (1.0, min(taken) - 3.0 * point))
        axis.offsetText.set_text(form.get_offset())
        axis.label.draw(renderer)
        axis.offsetText.draw(renderer)

    def set_xlim(self, left: Any = None, right: Any = None, **options: Any) -> tuple[float, float]:
        ends = (left, right) if right is not None or np.isscalar(left) or left is None else left
        return super().set_xlim(*_possible(ends, self.get_xlim(), self.get_xscale()), **options)

    def set_ylim(self, bottom: Any = None, top: Any = None, **options: Any) -> tuple[float, float]:
        ends = (bottom, top) if top is not None or np.isscalar(bottom) or bottom is None else bottom
        return super().set_ylim(*_possible(ends, self.get_ylim(), self.get_yscale()), **options)

    def set_xscale(self, value: Any, **options: Any) -> None:
        least = self.dataLim.minposx if self.get_autoscalex_on() else min(self.get_xlim())
        super().set_xscale(value if value != "log" or 0.0 < least < math.inf else "linear", **options)

    def set_yscale(self, value: Any, **options: Any) -> None:
        least = self.dataLim.minposy if self.get_autoscaley_on() else min(self.get_ylim())
        super().set_yscale(value if value != "log" or 0.0 < least < math.inf else "linear", **options)


def _possible(ends: Any, now: tuple[float, float], scale: str) -> tuple[float, float]:
    """Limits that an axis can have, as near to `ends` as may be; `now` it has others."""
    lowest = 0.0 if scale == "log" else -math.inf
    low, high = (
        float(end) if end is not None and lowest < end < math.inf else old
        for end, old in zip(ends, now, strict=True)
    )
    if low != high:
        return low, high
    return (low / 2.0, 2.0 * low) if scale == "log" else (low - (abs(low) or 1.0), low + (abs(low) or 1.0))


def dots(axes: Axes, x: FloatArray, y: FloatArray, color: str = GREY, size: float = 2.4) -> None:
    """Draw points as one path of round caps: a third of the bytes of markers."""
    sticks(axes, x, y, y, color, size, ends="round")


def sticks(
    axes: Axes,
    x: FloatArray,
    low: FloatArray,
    high: FloatArray,
    color: str = GREY,
    size: float = 1.5,
    ends: Literal["butt", "round"] = "butt",
) -> None:
    """Draw vertical sticks as one path."""
    gap = np.full(len(x), np.nan)
    along, up = (np.column_stack([*pair, gap]).ravel() for pair in ((x, x), (low, high)))
    axes.plot(along, up, color=color, linewidth=size, solid_capstyle=ends)


def areas(axes: Axes, boxes: Sequence[Box], color: str, **style: Any) -> None:
    """Fill boxes (left, right, bottom, top) as one path."""
    around = [(0, 2), (1, 2), (1, 3), (0, 3), (0, 2)]
    corners = np.array([[*((box[x], box[y]) for x, y in around), (np.nan, np.nan)] for box in boxes])
    if len(corners):
        axes.fill(*corners.reshape(-1, 2).T, **{"facecolor": color, "linewidth": 0.0, **style})


def tile(axes: Axes, box: Box, text: str = "", *, ink: str = INK, size: float = 12, **style: Any) -> None:
    """Draw a box with a text in its middle."""
    x, y, w, h = box
    axes.add_artist(Rectangle((x + 1, y + 1), w - 2, h - 2, **{"linewidth": 0.0, **style}))
    axes.text(x + w / 2, y + h / 2, text, ha="center", va="center", size=size, color=ink)


def few_ticks(axes: Axes, x: int = 4, y: int = 4, *, counts: bool = False) -> None:
    """Keep at most `x` and `y` intervals between ticks; whole numbers only along x where it counts."""
    axes.xaxis.set_major_locator(MaxNLocator(x, integer=counts))
    axes.yaxis.set_major_locator(MaxNLocator(y))


def rows_of(axes: Axes, names: Sequence[str]) -> None:
    """Give each row its name, from the top down."""
    axes.yaxis.set_major_locator(FixedLocator(range(len(names))))
    axes.yaxis.set_major_formatter(FixedFormatter(names))
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def plain_logs(axes: Axes) -> None:
    """Label log axes with plain numbers: at 1, 10, 100 over many decades, at 1, 2, 5 over few."""
    log_scale(axes, "x")
    log_scale(axes, "y")


def log_scale(axes: Axes, which: str, numbers: int = 12) -> None:
    """Give one axis a log scale with at most so many plain numbers; none where nothing on it is positive."""
    axis, limits = (axes.xaxis, axes.get_xlim) if which == "x" else (axes.yaxis, axes.get_ylim)
    axes.set(**{f"{which}scale": "log"})
    if axis.get_scale() != "log":
        axis.set_major_locator(MaxNLocator(4))
        return
    low, high = limits()
    steps = (1.0,) if high > 300.0 * low else (1.0, 3.0) if high > 10.0 * low else (1.0, 2.0, 3.0, 5.0, 7.0)
    axis.set_major_locator(LogLocator(subs=steps, numticks=numbers))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def time_unit(duration: float) -> tuple[str, float]:
    """Unit in which a duration in s is shown, and how many s it has."""
    return ("s", 1.0) if duration < 600.0 else ("min", 60.0) if duration < 36000.0 else ("h", 3600.0)
