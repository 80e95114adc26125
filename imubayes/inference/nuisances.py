"""Errors of the test bench as further columns of the linear model.

With the coefficients theta and the errors nu of the bench the output is::

    F(theta, nu) = own(u(nu)) + X(u(nu)) theta + offset(nu) + noise

where u(nu) is what the rig applied in truth. Linearised where the posterior is, it is a row of an ordinary
linear model: the library's columns at u(nu), beside them the derivatives dF/dnu, each under its own prior.
So rows, noise, factor and selection are those of every other test, and what an error of the bench hides
shows up as a column that cannot be told from it.

A rotation of arcminutes in the fixture shortens an input by half its square. What is seen of it is in u(nu);
what is not, as a misalignment hides it, or nothing shows it at all, is an unknown of its own, whose mean is
taken off (`hidden`).

The sign of an input is that of the nominal one: where the rig says that the input axis is horizontal an
asymmetry stays on its jump, whichever way an arcsecond would push it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import noise_scale, posterior_root, row_blocks
from imubayes.inference.free_functions import NOTHING, Beside
from imubayes.inference.linear import Extra, Linear, blocks_of, linear_of, streamed
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.settle import Pace, Round, settle
from imubayes.inference.summary import Rules, Summary, summarize
from imubayes.rig.bench import (
    OFFSET,
    SHORTENING,
    SHORTEST,
    TILT,
    Bench,
    Error,
    Errors,
    bench_of,
    errors_of,
    for_sensor,
    kind_of,
    refuse_idle,
)
from imubayes.rig.bench import Kind as BenchKind
from imubayes.rig.inputs import Part, Run, Stream
from imubayes.rig.plans import Plan
from imubayes.rig.runs import averaged_parts
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.terms import Kind, Library, columns

PACE = Pace("errors of the test bench", judged=range(2), settled=1e-3, rounds=3, downhill=True)
"""The rows of the first round may be off by the sensor's own errors, so that two judge the noise."""

ROOM = 3.0
"""Prior sd of a tilt over that of the misalignment: so wide that it hardly tells the one from the other."""

UNSEEN = 0.5
"""Share of its prior variance from which a rotation is not seen. It is then linearised at zero, where what it
does is seen least."""

MANY = 10_000
"""Rows from which it pays to settle on block averages first."""


def extras_for(
    runs: Sequence[Run], kinds: Mapping[str, float], *, sensor: Kind = "accelerometer"
) -> tuple[Extra, ...]:
    """Columns for the errors of the bench in the runs of a component, which is a kind of `sensor`.

    `kinds` has the prior sd in SI of each kind of error, by its key in `imubayes.rig.bench.KINDS`.
    It is a `TermError` if a kind is not known, and an `UnobservableError` if it applies to none of the runs.
    """
    refuse_idle(runs, kinds)
    return tuple(
        Extra.of(error.name, for_sensor(kind_of(name), sensor), sd, error.text)
        for name, sd in kinds.items()
        for error in errors_of(runs, [name])
    )


def rows_with(
    runs: Sequence[Run],
    lib: Library,
    extras: Sequence[Extra],
    theta: FloatArray,
    nu: FloatArray,
    *,
    leaning: FloatArray | None = None,
) -> tuple[Linear, ...]:
    """Rows of the runs of a component on a bench with errors, linearised at `theta` (p,) and `nu` (q,), SI.

    They have the columns of the library and then of the extras (see `extras_for`). The response is such that
    a linear fit gives coefficients and errors, not corrections of those that it started from. A tilt turns
    the axes of the coefficients `leaning` (p,), by default `theta`. It is a `DataError` if an error needs
    what a run does not tell (see `bench_of`).
    """
    kinds = dict.fromkeys(extra.kind for extra in extras)
    known = {error.name: error for error in errors_of(runs, kinds)}
    errors = tuple(known[extra.name] for extra in extras)
    held = {extra.name: extra.held for extra in extras if extra.held is not None}
    place = Linearisation(lib, errors, theta, nu, theta if leaning is None else leaning, held)
    return tuple(tangent(run, place) for run in runs)


def solve(
    runs: Sequence[Run],
    lib: Library,
    prior_sd: FloatArray,
    kinds: Mapping[str, float],
    *,
    sensor: SensorClass | None = None,
    rules: Rules | None = None,
    beside: Beside = NOTHING,
) -> tuple[Summary, tuple[Linear, ...]]:
    """Summarize the runs of a component on a bench with errors, relinearised until that settles.

    Prior sds, SI, are those of the terms, (p,), and of each kind of error of the bench; further columns may
    stand `beside`, after those of the errors. The rows are those where that settled. It is a
    `ConvergenceError`, which carries coefficients and errors so far, if it does not.
    """
    extras = extras_for(runs, {**kinds, **tilt_of(lib, prior_sd, kinds)}, sensor=lib.kind)
    if not extras:  # linear as they are
        rows = tuple(beside.added(run, linear_of(run, lib)) for run in runs)
        return summarize(runs, lib, sensor=sensor, rules=rules, rows=rows, extras=beside.extras), rows
    p = len(prior_sd)

    def sds(extras: Sequence[Extra]) -> FloatArray:
        return np.concatenate((prior_sd, [extra.sd for extra in (*extras, *beside.extras)]))

    def at(
        extras: tuple[Extra, ...],
        taken: Taken,
        place: FloatArray,
        noise: Sequence[NoiseEstimate],
        leaning: FloatArray | None,
    ) -> Round:
        q, lean = p + len(extras), None if leaning is None else leaning[:p]
        parts = rows_with(runs, lib, extras, place[:p], place[p:q], leaning=lean)
        rows = tuple(taken(beside.added(*pair)) for pair in zip(runs, parts, strict=True))
        every = (*extras, *beside.extras)
        summary = summarize(runs, lib, sensor=sensor, rules=rules, rows=rows, extras=every, known=noise)
        found = [run.found for run in summary.runs]
        return Round(place, summary, rows, found, noise_scale(summary.factor, sds(extras)))

    if shortens(extras):
        sd = sds(extras)
        flat = at(extras, averages, np.zeros(len(sd)), (), None)
        root = posterior_root(flat.summary.factor, sd, flat.scale)[1][p : p + len(extras)]
        extras = shortened(runs, extras, np.sum(root**2, axis=1))
    settled = settled_rows(partial(at, extras), sds(extras), runs)
    return settled.summary, settled.rows


def shortens(extras: Iterable[Extra]) -> bool:
    """Whether rotations of the case are so large that somebody notices what they shorten inputs by."""
    return sum({extra.kind: extra.sd**2 for extra in extras if extra.kind in SHORTENING}.values()) > SHORTEST


def shortened(runs: Sequence[Run | Plan], extras: Sequence[Extra], left: FloatArray) -> tuple[Extra, ...]:
    """Errors of a component's bench, and what rotations that its test does not see shorten its own input by.

    They come as `extras_for` has them; `left` (q,) is what the test leaves of the variance of each, SI.
    """
    kinds = dict.fromkeys(extra.kind for extra in extras)
    named = zip(extras, errors_of(runs, kinds), left.tolist(), strict=True)
    every, variance = list[Extra](), dict[tuple[str, int, str, int | None], float]()
    for extra, error, v in named:
        variance[error.kind, error.part, error.run, error.mount] = v
        unseen = error.kind in SHORTENING and v > UNSEEN * extra.sd**2
        every.append(replace(extra, held=0.0) if unseen else extra)
    for rotation, kind in SHORTENING.items():
        for error in errors_of(runs, [kind.name]):
            v = [variance.get((rotation, axis, error.run, error.mount), 0.0) for axis in (1, 2)]
            every += shortening(error.name, kind, [v], error.text)
    return tuple(every)


def shortening(
    name: str, kind: BenchKind, variances: Sequence[Sequence[float]], text: str
) -> tuple[Extra, ...]:
    """Column for what rotations about the two axes across an input take of it; none where nobody notices it.

    Of a rotation with the variance v half its square has the mean v / 2 and the variance v^2 / 2. Those
    (m, 2) of several places have one column for all.
    """
    v = np.array(variances)
    mean, sd = 0.5 * np.mean(v.sum(axis=1)), np.sqrt(0.5 * np.mean(np.sum(v**2, axis=1)))
    return (Extra.of(name, kind, float(sd), text, held=float(mean)),) if sd > SHORTEST else ()


def tilt_of(lib: Library, prior_sd: FloatArray, kinds: Collection[str]) -> dict[str, float]:
    """Prior sd of the tilt that comes with a rotation in the fixture, where there is one among the kinds."""
    sizes = [sd for name, sd in zip(lib.names, prior_sd.tolist(), strict=True) if name in ("m_j", "m_k")]
    return {TILT.name: ROOM * max(sizes)} if sizes and SHORTENING.keys() & set(kinds) else {}


Taken = Callable[[Linear], Linear]
"""Which rows are taken of a run's: all of them, or averages."""


def all_rows(rows: Linear) -> Linear:
    """Take all rows."""
    return rows


def averages(rows: Linear) -> Linear:
    """Take averages over blocks."""
    return replace(blocks_of(rows), stream=None)


def settled_rows(at: Callable[..., Round], sd: FloatArray, runs: Sequence[Run]) -> Round:
    """Linearise the rows that are taken of a component's runs, on a bench with errors, where that settles.

    But for its first argument, what is taken, `at` is as `settle` has it; `sd` (p + q,) are prior sds of
    coefficients and errors, SI. Of many rows averages find the place, and all rows have the last word.
    """
    start = np.zeros(len(sd))
    if sum(run.samples for run in runs) > MANY:
        start = settle(partial(at, averages), sd, PACE, start).place
    return settle(partial(at, all_rows), sd, PACE, start)


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Where rows are linearised: coefficients theta (p,), and errors nu (q,) of the bench, SI.

    A tilt turns the axes of the coefficients `leaning` (p,), but for terms that are linear in an input: of
    these it only makes others of their kind, which are there as they are. Errors that are `held`, by name,
    are allowances to first order from these sizes on.
    """

    lib: Library
    errors: tuple[Error, ...]
    theta: FloatArray
    nu: FloatArray
    leaning: FloatArray
    held: Mapping[str, float]

    def sizes(self, bench: Bench) -> dict[str, FloatArray]:
        """Size of each kind of error in each mount of a run."""
        named = zip(self.errors, self.nu.tolist(), strict=True)
        return bench.sizes(self.errors, [self.held.get(error.name, value) for error, value in named])

    def parts(self, bench: Bench, start: int, stop: int) -> FloatArray:
        """Own input, columns of the library, derivatives by the errors in some rows: (rows, 1 + p + q)."""
        own, X = self._model(bench, self.sizes(bench), start, stop)
        slopes, place, directions = np.zeros((stop - start, len(self.errors))), bench.place[start:stop], {}
        for k, error in enumerate(self.errors):
            if error.applies(bench.run):
                way = error.kind, error.part
                if way not in directions:
                    directions[way] = self._slope(bench, way, start, stop)
                inside = 1.0 if error.mount is None else place == bench.mounts.index(error.mount)
                slopes[:, k] = directions[way] * inside
        return np.column_stack((own, X, slopes))

    def _model(self, bench: Bench, sizes: Errors, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Own input (rows,) and the library's columns (rows, p) for errors of these sizes."""
        seen = channels = bench.channels(sizes, start, stop)
        if TILT.name in sizes and sizes[TILT.name].any():
            # the tilt of the axes that the coefficients refer to turns what they see
            turned = np.pad(sizes[TILT.name], ((0, 0), (1, 0)))
            leant = {**sizes, "fixture_common": sizes.get("fixture_common", 0.0) + turned}
            seen = bench.channels(leant, start, stop)
        said = {name: values[start:stop] for name, values in bench.run.inputs.channels.items()}
        X = columns(self.lib, seen, stop - start, said=said)
        return np.broadcast_to(channels.get(self.lib.own, 0.0), stop - start), X

    def _slope(self, bench: Bench, way: tuple[str, int], start: int, stop: int) -> FloatArray | float:
        """Derivative (rows,) by one part of a kind of error, in all mounts at once."""
        kind, part = way
        if kind == OFFSET:
            return 1.0
        step = kind_of(kind).step * (bench.run.inputs.interval if kind == "latency" else 1.0)
        theta, ends = self.theta, []
        if kind == TILT.name:
            theta = np.where([term.linear for term in self.lib.terms], 0.0, self.leaning)
        for change in (step, -step):
            sizes = self.sizes(bench)
            sizes[kind][:, part] += change
            own, X = self._model(bench, sizes, start, stop)
            ends.append(own + X @ theta)
        return (ends[0] - ends[1]) / (2.0 * step)


MOST_HELD = 10_000_000
"""Numbers of a run's columns that are held at a time; longer ones are made a part of the run at a time."""


def tangent(run: Run, place: Linearisation) -> Linear:
    """Rows of a run with known inputs, linearised as in `rows_with`."""
    # an offset is linear as it is, and a tilt by what it is there for: an allowance to first order
    loose = [error.kind in (OFFSET, TILT.name) or error.name in place.held for error in place.errors]
    kept = np.where(loose, 0.0, place.nu)
    place = replace(place, nu=kept)
    if run.stream is not None:
        return _streamed(run, run.stream, place)
    parts = _parts(run, place)
    plain, y = linear_of(run, place.lib), run.output.copy()
    for a, b in row_blocks(len(y)):
        part = parts(a, b)
        y[a:b] += part[:, 1 + len(place.theta) :] @ kept - part[:, 0]
    return replace(
        plain,
        names=(*plain.names, *(error.name for error in place.errors)),
        y=y,
        columns=lambda start, stop: parts(start, stop)[:, 1:],
    )


def _streamed(run: Run, stream: Stream, place: Linearisation) -> Linear:
    """Averages of the linearised rows over the blocks of a run that is read a part at a time: one pass."""
    p, bench = len(place.theta), bench_of(run, {error.kind for error in place.errors})
    # by a latency rows look beyond themselves
    late = [abs(nu) for error, nu in zip(place.errors, place.nu, strict=True) if error.kind == "latency"]
    seen = replace(stream, margin=max(late) + stream.interval if late else 0.0)

    def fill(part: Part, inside: slice, table: FloatArray) -> None:
        few = part.around(inside, seen.margin) if seen.margin else part.some(inside)
        rows = _parts(replace(run, inputs=few.inputs), place, bench)(few.own.start, few.own.stop)
        width = rows.shape[1]
        table[:, : width - 1] = rows[:, 1:]
        table[:, width - 1] = part.output[inside] + rows[:, 1 + p :] @ place.nu - rows[:, 0]

    names = (*place.lib.names, *(error.name for error in place.errors))
    return streamed(run, seen, names, averaged_parts(seen, fill, len(names) + 1), fill)


def _parts(run: Run, place: Linearisation, bench: Bench | None = None) -> Callable[[int, int], FloatArray]:
    """Give the parts at a place for rows from start to stop; of rows of a longer run with its `bench`.

    While the inputs stand still, as they do in a dwell, all rows are alike: one is made for all of them.
    """
    kinds = {error.kind for error in place.errors}

    def made(rows: Run) -> Callable[[int, int], FloatArray]:
        return partial(place.parts, bench_of(rows, kinds) if bench is None else bench.of(rows.inputs))

    inputs, new = run.inputs, np.full(len(run.inputs), "latency" in kinds)
    new[0] = True
    for values in (*inputs.channels.values(), *(() if inputs.mount is None else (inputs.mount,))):
        new[1:] |= np.diff(values) != 0
    firsts = np.flatnonzero(new)
    if len(firsts) * (1 + len(place.theta) + len(place.nu)) > MOST_HELD:
        return made(run)
    held = made(replace(run, inputs=inputs.kept(firsts)))(0, len(firsts))
    of_row = np.repeat(np.arange(len(firsts)), np.diff(np.append(firsts, len(inputs))))
    return lambda start, stop: held[of_row[start:stop]]
