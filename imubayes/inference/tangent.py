"""Rows of a run that are linearised at given coefficients and errors of the test bench.

The sign of an input is that of the nominal one: where the rig says that the input axis is horizontal an
asymmetry stays on its jump, whichever way an arcsecond would push it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.linear import CHUNK, Linear, linear_of
from imubayes.rig.bench import Bench, Errors, bench_of
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.reference import OFFSET, TILT, Error, kind_of
from imubayes.sensors.terms import Library, columns

MOST_HELD = 10_000_000
"""Numbers of a run's columns that are held at a time; longer ones are made a part of the run at a time."""


def tangent(
    run: Run,
    lib: Library,
    errors: tuple[Error, ...],
    theta: FloatArray,
    nu: FloatArray,
    *,
    leaning: FloatArray | None = None,
) -> Linear:
    """Rows of a run, linearised.

    Parameters
    ----------
    run : with known inputs.
    lib : candidate terms.
    errors : of the test bench.
    theta, nu : (p,) coefficients and (q,) errors to linearise at, SI.
    leaning : (p,) coefficients whose axes a tilt turns; by default `theta`.
    """
    # an offset is linear as it is, and a tilt by what it is there for: an allowance to first order
    kept = np.where([error.kind in (OFFSET, TILT.name) for error in errors], 0.0, nu)
    place = _Place(lib, errors, theta, kept, theta if leaning is None else leaning)
    parts = _parts(run, place)
    plain, y = linear_of(run, lib), run.output.copy()
    for a in range(0, len(y), CHUNK):
        b = min(a + CHUNK, len(y))
        part = parts(a, b)
        y[a:b] += part[:, 1 + len(theta) :] @ kept - part[:, 0]
    return replace(
        plain,
        names=(*plain.names, *(error.name for error in errors)),
        y=y,
        columns=lambda start, stop: parts(start, stop)[:, 1:],
    )


def _parts(run: Run, place: _Place) -> Callable[[int, int], FloatArray]:
    """Give the parts of `_Rows` for rows from start to stop.

    While the inputs stand still, as they do in a dwell, all rows are alike: one is made for all of them.
    """
    kinds = {error.kind for error in place.errors}
    firsts = np.arange(len(run.inputs)) if "latency" in kinds else _firsts(run.inputs)
    if len(firsts) * (1 + len(place.theta) + len(place.nu)) > MOST_HELD:
        return _Rows(bench_of(run, kinds), place).parts
    inputs = run.inputs
    channels = {name: values[firsts] for name, values in inputs.channels.items()}
    mount = None if inputs.mount is None else inputs.mount[firsts]
    few = replace(run, inputs=Inputs(inputs.t[firsts], channels, inputs.interval, mount))
    held = _Rows(bench_of(few, kinds), place).parts(0, len(firsts))
    of_row = np.repeat(np.arange(len(firsts)), np.diff(np.append(firsts, len(inputs))))
    return lambda start, stop: held[of_row[start:stop]]


def _firsts(inputs: Inputs) -> NDArray[np.intp]:
    """Rows in which an input or the mount is not what it was in the row before."""
    new = np.zeros(len(inputs), dtype=bool)
    new[0] = True
    for values in (*inputs.channels.values(), *(() if inputs.mount is None else (inputs.mount,))):
        new[1:] |= np.diff(values) != 0
    return np.flatnonzero(new)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where rows are linearised: coefficients theta and leaning (p,) (see `tangent`), errors nu (q,), SI."""

    lib: Library
    errors: tuple[Error, ...]
    theta: FloatArray
    nu: FloatArray
    leaning: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows of a run on a bench, linearised at a place."""

    bench: Bench
    at: _Place

    def parts(self, start: int, stop: int) -> FloatArray:
        """Own input, columns of the library, derivatives by the errors in some rows: (rows, 1 + p + q)."""
        own, X = self._model(self.bench.sizes(self.at.errors, self.at.nu), start, stop)
        return np.column_stack((own, X, self._slopes(start, stop)))

    def _model(self, sizes: Errors, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Own input (rows,) and the library's columns (rows, p) for errors of these sizes."""
        channels = self.bench.channels(sizes, start, stop)
        leant = _leant(sizes)
        seen = channels if leant is sizes else self.bench.channels(leant, start, stop)
        said = {name: values[start:stop] for name, values in self.bench.run.inputs.channels.items()}
        X = columns(self.at.lib, seen, stop - start)
        for k, term in enumerate(self.at.lib.terms):
            for name in (f.channel for f in term.factors if f.signed and f.channel in seen):
                X[:, k] *= np.sign(said.get(name, 0.0)) * np.sign(seen[name])
        return np.broadcast_to(channels.get(self.at.lib.own, 0.0), stop - start), X

    def _slopes(self, start: int, stop: int) -> FloatArray:
        """Derivatives (rows, q) of the output by the errors."""
        out = np.zeros((stop - start, len(self.at.errors)))
        place, directions = self.bench.place[start:stop], {}
        for k, error in enumerate(self.at.errors):
            if error.applies(self.bench.run):
                way = error.kind, error.part
                if way not in directions:
                    directions[way] = self._slope(*way, start, stop)
                inside = 1.0 if error.mount is None else place == self.bench.mounts.index(error.mount)
                out[:, k] = directions[way] * inside
        return out

    def _slope(self, kind: str, part: int, start: int, stop: int) -> FloatArray | float:
        """Derivative (rows,) by one part of a kind of error, in all mounts at once."""
        if kind == OFFSET:
            return 1.0
        step = kind_of(kind).step * (self.bench.run.inputs.interval if kind == "latency" else 1.0)
        theta = self.at.leaning if kind == TILT.name else self.at.theta
        ends = []
        for change in (step, -step):
            sizes = self.bench.sizes(self.at.errors, self.at.nu)
            sizes[kind][:, part] += change
            own, X = self._model(sizes, start, stop)
            ends.append(own + X @ theta)
        return (ends[0] - ends[1]) / (2.0 * step)


def _leant(sizes: Errors) -> Errors:
    """Errors with the tilt of the axes that the coefficients refer to, which turns what they see."""
    if TILT.name not in sizes or not sizes[TILT.name].any():
        return sizes
    turned = np.zeros((len(sizes[TILT.name]), 3))
    turned[:, 1:] = sizes[TILT.name]
    return {**sizes, "fixture_common": sizes.get("fixture_common", 0.0) + turned}
