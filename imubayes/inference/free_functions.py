"""Free functions of a run's inputs: what the output could depend on, were the library not there.

They are looked at one by one (`looks_at`). Where residuals show that something is missing, each run has
beside the library a random function of an input: Gaussian, with unit variance times s^2, correlated over half
of its range. It stands for whatever smooth dependence there is (a power that is missing, an error of a
level), and the terms that it could explain are as uncertain as it leaves them. Its covariance over the levels
of a run is kept to a part in a million by a few columns, and the data tell its size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference.linear import Extra, Linear, averages_of, block_edges, blocks_of, means_of, once
from imubayes.inference.summary import RunSummary, noticed
from imubayes.rig.bench import LACK
from imubayes.rig.inputs import Inputs, Part, Run
from imubayes.sensors.terms import HIGHEST_POWER, InputPower, Library, Term, columns, library
from imubayes.sensors.terms import column as regressor

BLOCKS = 400
"""Blocks that a run is averaged to: enough to follow an input, few enough to judge the noise many times."""

KNOTS = 9
"""Knots of a free function: more than the library's powers can bend."""

SLIGHT = 0.1
"""Effect in a run, in sds of its noise, below which a column of the library takes nothing from a function: a
table turns the horizontal rate of the Earth through each dwell, which bends as any function of its rate."""

LEVELS = 10
"""An input that takes at most so many values has a free value at each."""

TURN = 0.01
"""Share of its range by which an input must turn back to be falling, or rising."""

PLAYS = (0.03, 0.1, 0.2, 0.4)
"""Plays that hysteresis is made of (Prandtl and Ishlinskii), as shares of the input's range."""

ROUNDING = 1e-9
"""Relative spread of an input below which it does not vary."""

CLOSE = 1e-3
"""Share of its range below which two knots of an input are one."""

TIME = "t"
"""Input of a dependence on time."""

HYSTERESIS = "hysteresis of "
"""How the input of a dependence begins that differs between the branches."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A free function of one input of a run, over m blocks of it.

    `columns` (m, q) span the function, which must add to the library and to what is `beside` it, (m, r); x
    (m,) is the input, SI, and `branch` (m,) its direction.
    """

    run: RunSummary
    input: str
    blocks: Linear
    beside: FloatArray
    columns: FloatArray
    x: FloatArray
    branch: FloatArray


def looks_at(
    rows: Linear, channels: Mapping[str, FloatArray], run: RunSummary, own: str, sds: Mapping[str, float]
) -> Iterator[Look]:
    """Give the free functions of every input that varies, and of time, in the order of the channels.

    The channels are (n,), SI. The component's `own` input may have hysteresis as temperature may. Columns
    that do nothing in the run by their prior `sds` are left out of it.
    """
    blocks, edges = _looked_at(rows, sds), block_edges(rows.t, rows.interval, BLOCKS)
    flat = np.zeros(len(blocks.y))
    for name, values in {**channels, TIME: rows.t}.items():
        knots = _knots(values)
        if len(knots) < 2:
            continue

        def functions(
            start: int, stop: int, values: FloatArray = values, knots: FloatArray = knots
        ) -> FloatArray:
            # piecewise linear, one at its own knot and zero at the others; the input's sign; and the input
            x = values[start:stop]
            hats = [np.interp(x, knots, peak) for peak in np.eye(len(knots))]
            return np.column_stack((*hats, *([np.sign(x)] if knots[0] < 0.0 < knots[-1] else []), x))

        # averages over the blocks of functions, which are not the functions of its averages
        means = means_of(rows, edges, functions)
        free, x = means[:, :-1], means[:, -1]
        yield Look(run, name, blocks, free[:, :0], free, x, flat)
        if name in ("T", own):
            ahead = np.column_stack([_lag(x, share * float(np.ptp(x))) for share in (TURN, *PLAYS)])
            branch = np.sign(ahead[:, 0])
            if np.ptp(branch) == 2.0:
                yield Look(run, f"{HYSTERESIS}{name}", blocks, free, ahead[:, 1:], x, branch)


def terms_at(
    rows: Linear, channels: Mapping[str, FloatArray], run: RunSummary, lib: Library, sds: Mapping[str, float]
) -> Iterator[Look]:
    """Give terms beyond those of the rows, one by one, as functions in a run."""
    edges, flat = block_edges(rows.t, rows.interval, BLOCKS), np.zeros(0)

    def made(start: int, stop: int) -> FloatArray:
        inputs = {name: values[start:stop] for name, values in channels.items()}
        return columns(lib, inputs, stop - start)

    means, blocks = means_of(rows, edges, made), _looked_at(rows, sds)
    for k, term in enumerate(lib.terms):
        yield Look(run, term.name, blocks, means[:, :0], means[:, k : k + 1], flat, flat)


def _looked_at(rows: Linear, sds: Mapping[str, float]) -> Linear:
    return once(rows, ("looked at", *sds.values()), lambda: noticed(blocks_of(rows, BLOCKS), sds, SLIGHT))


def lacked(lib: Library) -> Library:
    """Terms of the model equation that a library lacks: of more powers, and all of the extended set."""

    def order(channel: str) -> int:
        powers = (f.power for term in lib.terms for f in term.factors if f.channel == channel)
        return min(max(powers, default=0) + POWERS, HIGHEST_POWER)

    most = order(lib.own)
    every = library(lib.kind, powers=most, asymmetry=most, set="extended", temperature=order("T"))
    return replace(every, terms=tuple(term for term in every.terms if term.name not in lib.names))


def of_own_input(term: Term, own: str) -> bool:
    """Whether a term is a power of the own input."""
    return [factor.channel for factor in term.factors] == [own]


def _knots(values: FloatArray) -> FloatArray:
    """Knots of a free function of a channel; a single one where it does not vary."""
    width = float(np.ptp(values))
    if not width > ROUNDING * float(np.max(np.abs(values))):
        return values[:1]
    levels = np.unique(np.round((values - values.min()) / width, 6)) * width + values.min()
    knots = levels if len(levels) <= LEVELS else np.quantile(values, np.linspace(0.0, 1.0, KNOTS))
    if knots[0] < 0.0 < knots[-1]:
        knots = np.sort(np.append(knots, 0.0))
    return knots[np.append(True, np.diff(knots) > CLOSE * width)]


def _lag(x: FloatArray, play: float) -> FloatArray:
    """How far an input (m,) is ahead of what it drags along with a play to either side, SI."""
    ahead, dragged = np.empty(len(x)), float(x[0])
    for k, value in enumerate(x.tolist()):
        dragged = min(max(dragged, value - play), value + play)
        ahead[k] = value - dragged
    return ahead


LENGTH = 1.0
"""Length over which a function is correlated, in half ranges of the input."""

POINTS = 24
"""Most levels of an input that a function is made at; between more of them it is interpolated."""

KEPT = 1e-8
"""Share of the largest variance below which a direction of a function is left out."""

POWERS = 2
"""Powers of an input beyond the library's highest that are looked at by themselves."""

FEWEST_LEVELS = 3
"""Levels of an input below which a function of it says nothing."""


FINE = 10_000
"""Levels of an input that are told apart, from its middle to either end."""


Columns = Callable[[Inputs], FloatArray]
"""Gives columns (n, k) of the n rows that have these inputs."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """What stands beside the library and the errors of the bench: k extras, and their columns by run."""

    extras: tuple[Extra, ...]
    columns: Mapping[str, Columns]

    def scaled(self, sizes: Mapping[str, float]) -> Beside:
        """The same with prior sds by the kinds of the columns."""
        return replace(self, extras=tuple(replace(extra, sd=sizes[extra.kind]) for extra in self.extras))

    def of(self, component: str) -> Beside:
        """The same of a component in a case, in whose name the columns end."""
        named = (replace(extra, name=f"{extra.name}.{component}") for extra in self.extras)
        return replace(self, extras=tuple(named))

    def added(self, run: Run, rows: Linear) -> Linear:
        """Rows of a run with these columns after their own; of a stream they are averaged in a pass, once."""
        if not self.extras:
            return rows
        p, k, own, first = len(rows.names), len(self.extras), rows.columns, rows.fill
        made = self.columns.get(run.name, partial(_none, k))
        wider = replace(rows, names=(*rows.names, *(extra.name for extra in self.extras)))
        if run.stream is None or first is None or rows.reach is None:
            inputs = run.inputs
            return replace(
                wider, columns=lambda a, b: np.column_stack((own(a, b), made(inputs.kept(slice(a, b)))))
            )

        def write(part: Part, inside: slice, table: FloatArray) -> None:
            table[:, :k] = made(part.inputs.kept(inside))

        def fill(part: Part, inside: slice, table: FloatArray) -> None:
            first(part, inside, table)
            table[:, p + k] = table[:, p]
            write(part, inside, table[:, p:])

        means, reach = averages_of(run.stream, made, write, k)
        return replace(
            wider,
            columns=lambda a, b: np.column_stack((own(a, b), means[a:b])),
            fill=fill,
            reach=np.append(rows.reach, reach),
        )


def _none(k: int, inputs: Inputs) -> FloatArray:
    return np.zeros((len(inputs), k))


NOTHING = Beside((), {})
"""Nothing beside the library and the bench."""


def functions_of(
    runs: Sequence[Run],
    of: Sequence[tuple[str, str]],
    lib: Library,
    unit: str,
    sd: float,
    terms: Sequence[Term] = (),
) -> Beside:
    """Functions of inputs of runs, and `terms` of all runs that the library lacks.

    Each function is `of` a run and an input that has enough levels there. Those of one input are of one size
    where the input is largest, of this sd in SI of the output, and in other runs smaller as it is. Of the own
    input the next powers after those of the library, of either symmetry, stand beside them; they, and the
    terms, are each of one size in all runs.
    """
    named = {run.name: run for run in runs}
    told = {at: table for at in of if (table := _table(named[at[0]], at[1])) is not None}
    values = {(name, channel): values_of(named[name], channel) for name, channel in told}
    most = {channel: max(np.ptp(u) for (_, c), u in values.items() if c == channel) for _, channel in told}
    made: list[tuple[str, str, int, dict[str, Columns]]] = []
    for (name, channel), table in told.items():
        u = values[name, channel]
        share = float(np.ptp(u) / most[channel])
        column = partial(_looked_up, share * table, channel, (float(u.min()), float(u.max())))
        made.append((f"{name}.{channel}", channel, table.shape[1], {name: column}))
    own = {name: u for (name, channel), u in values.items() if channel == lib.own}
    both = {-1.0, 1.0} <= {sign for u in own.values() for sign in np.sign(u).tolist()}
    powers = [term for term in lacked(lib).terms if own and of_own_input(term, lib.own)]
    powers = [term for term in powers if both or not term.factors[0].signed]
    for term, where in [(term, own) for term in powers] + [(term, named) for term in terms]:
        largest = max(float(np.max(np.abs(regressor(term, run.extremes)))) for run in runs)
        kind = "*".join(_power(factor) for factor in term.factors)
        made.append((term.name, kind, 1, dict.fromkeys(where, partial(_of_term, term, largest))))
    said, every = "function of {} that is not there", [one[:2] for one in made for _ in range(one[2])]
    extras = tuple(
        Extra(f"{LACK}_{k}.{place}", f"{LACK}.{kind}", sd, unit, unit, said.format(kind))
        for k, (place, kind) in enumerate(every)
    )

    def beside(name: str, inputs: Inputs) -> FloatArray:
        return np.column_stack([by_run.get(name, partial(_none, k))(inputs) for *_, k, by_run in made])

    return Beside(extras, {name: partial(beside, name) for by_run in made for name in by_run[3]})


def values_of(run: Run, channel: str) -> FloatArray:
    """Values of an input of a run, or times, among which are the largest and the smallest."""
    return run.inputs.t if channel == TIME else run.extremes.get(channel, np.zeros(1))


def _values(inputs: Inputs, channel: str) -> FloatArray:
    return inputs.t if channel == TIME else inputs.channels.get(channel, np.zeros(len(inputs)))


def _power(factor: InputPower) -> str:
    plain = factor.power == 1 and not factor.signed
    return factor.channel if plain else f"{factor.channel}^{factor.power}{'p' if factor.signed else ''}"


def _of_term(term: Term, largest: float, inputs: Inputs) -> FloatArray:
    return np.broadcast_to(regressor(term, inputs.channels) / largest, len(inputs))


def _looked_up(table: FloatArray, channel: str, ends: tuple[float, float], inputs: Inputs) -> FloatArray:
    return table[_levels(channel, ends, inputs)]


def _levels(channel: str, ends: tuple[float, float], inputs: Inputs) -> NDArray[np.int64]:
    """Number (n,) of the level that each row is at; blocks of rows may end before the rows do."""
    low, high = ends
    x = (2.0 * _values(inputs, channel) - low - high) / (high - low)
    return FINE + np.rint(FINE * np.clip(x, -1.0, 1.0)).astype(np.int64)


def _table(run: Run, channel: str) -> FloatArray | None:
    """Random function of an input, of unit variance: k columns at its levels (2 `FINE` + 1, k).

    None where a run has too few levels of it.
    """
    seen, x = values_of(run, channel), np.arange(-FINE, FINE + 1) / FINE
    ends = float(seen.min()), float(seen.max())
    met = np.zeros(0, dtype=np.int64)
    for part in run.parts("levels of the inputs") if ends[0] < ends[1] else ():
        met = np.union1d(met, _levels(channel, ends, part.inputs))
        if len(met) > POINTS:
            break
    if len(met) < FEWEST_LEVELS:
        return None
    points = x[met] if len(met) <= POINTS else np.linspace(-1.0, 1.0, POINTS)

    def kernel(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.exp(-0.5 * ((a[:, None] - b[None, :]) / LENGTH) ** 2)

    size, way = np.linalg.eigh(kernel(points, points))
    kept = size > KEPT * size[-1]
    return kernel(x, points) @ (way[:, kept] / np.sqrt(size[kept]))
