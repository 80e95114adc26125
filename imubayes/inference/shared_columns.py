"""Columns that the components of a triad have in common, made and whitened once for all of them.

Along the case axes the libraries of x, y and z are the same products of inputs in another order: what is
b2 of one is c_jj and c_kk of the others. Three slide libraries are 28 distinct products where three
accelerometers have 60 columns, and 25 where three gyroscopes have 51. Components whose noise is the same
are right-hand sides of one factor,
``QR([products, y_x, y_y, y_z])``: that of a component is the factor of its columns of R.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import factor as algebra
from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor
from imubayes.inference.linear import CHUNK, Linear
from imubayes.inference.whiten import whiten
from imubayes.rig.inputs import Run
from imubayes.sensors.imu import case_channel, kind_of
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Factor as Input
from imubayes.sensors.terms import Kind, Library, Term, columns, tied


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Rows of components of one kind in one run.

    Attributes
    ----------
    products : the distinct products of inputs, along the case axes.
    which : of each component, the column (p,) of each of its terms.
    libraries : of each component, whose ties add columns up.
    channels : (n,) inputs along the case axes.
    rows : of each component.
    known : factor of all products and responses, by the noise that whitened them.
    """

    products: Library
    which: Mapping[str, NDArray[np.intp]]
    libraries: Mapping[str, Library]
    channels: Mapping[str, FloatArray]
    rows: Mapping[str, Linear]
    known: dict[Noise, tuple[FloatArray, dict[str, FloatArray], float]] = field(default_factory=dict)

    def columns(self, start: int, stop: int) -> FloatArray:
        """Products in some rows: (rows, m)."""
        part = {name: values[start:stop] for name, values in self.channels.items()}
        return columns(self.products, part, stop - start)

    def of(self, component: str, products: FloatArray) -> FloatArray:
        """Columns (rows, p) of a component's terms, of those of all products."""
        return tied(self.libraries[component], products[:, self.which[component]])

    def factor_of(self, component: str, noise: Noise) -> tuple[Factor, FloatArray]:
        """Factor of a component's whitened rows, and the largest size (p,) of each of its columns."""
        if noise not in self.known:
            self.known[noise] = self._whitened(noise)
        R, reach, log_det = self.known[noise]
        rows = self.rows[component]
        response = R[:, len(self.products.terms) + list(self.rows).index(component)]
        made = algebra.triangular((np.column_stack((self.of(component, R), response)),), len(rows.names) + 1)
        return Factor(rows.names, made, len(rows), log_det), reach[component]

    def _whitened(self, noise: Noise) -> tuple[FloatArray, dict[str, FloatArray], float]:
        """Factor of products and responses, largest size of all columns, log determinant of the noise."""
        first, m = next(iter(self.rows.values())), len(self.products.terms)
        n, reach = len(first), {name: np.zeros(len(own)) for name, own in self.which.items()}
        table = np.empty((n, m + len(self.rows)))
        for a in range(0, n, CHUNK):
            b = min(a + CHUNK, n)
            table[a:b, :m] = self.columns(a, b)
            for name, largest in reach.items():
                np.maximum(largest, np.abs(self.of(name, table[a:b])).max(axis=0), out=largest)
        for k, rows in enumerate(self.rows.values()):
            table[:, m + k] = rows.y
        _, d = whiten(noise, first.rows, table)
        blocks = (table[i:j] for i, j in algebra.row_blocks(n))
        return algebra.triangular(blocks, table.shape[1]), reach, float(np.sum(np.log(d)))


def shared_rows(runs: Sequence[Run], libraries: Mapping[str, Library]) -> dict[str, list[Linear]]:
    """Rows of each component in each run: output minus own input on the columns of its library.

    Parameters
    ----------
    runs : of one IMU.
    libraries : candidate terms by component, alike for all of a kind.
    """
    found: dict[str, list[Linear]] = {name: [] for name in libraries}
    kinds: dict[Kind, list[str]] = {}
    for name in libraries:
        kinds.setdefault(kind_of(name), []).append(name)
    for kind, names in kinds.items():
        products, which = products_of(kind, {name: libraries[name] for name in names})
        for run in runs:
            for name, rows in _together(run, libraries, products, which).items():
                found[name].append(rows)
    return found


def _together(
    run: Run, libraries: Mapping[str, Library], products: Library, which: Mapping[str, NDArray[np.intp]]
) -> dict[str, Linear]:
    """Rows of the components of one kind in a run."""
    rows: dict[str, Linear] = {}
    whole = Together(products, which, libraries, run.inputs.channels, rows)
    for name in which:
        rows[name] = _rows(run, name, libraries[name], whole)
    return rows


def _rows(run: Run, name: str, lib: Library, whole: Together) -> Linear:
    one = run.component(name)
    return Linear(
        name=run.name,
        procedure=run.procedure,
        names=tuple(f"{name}.{term}" for term in lib.names),
        t=run.inputs.t,
        duration=run.inputs.durations,
        interval=run.inputs.interval,
        y=one.output - one.inputs.channels.get(lib.own, 0.0),
        columns=lambda start, stop: whole.of(name, whole.columns(start, stop)),
        shared=lambda noise: whole.factor_of(name, noise),
    )


def products_of(kind: Kind, libraries: Mapping[str, Library]) -> tuple[Library, dict[str, NDArray[np.intp]]]:
    """Distinct products of inputs along the case axes, and which of them (p,) each component's terms are.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer")
    >>> products, which = products_of("accelerometer", {"ax": lib, "ay": lib, "az": lib})
    >>> len(products.terms), sum(map(len, which.values()))
    (28, 60)
    """
    places: dict[tuple[Input, ...], int] = {}
    which = {
        name: np.array([places.setdefault(_along_case(name, term), len(places)) for term in lib.terms])
        for name, lib in libraries.items()
    }
    terms = tuple(Term(str(k), factors, "", "", "") for factors, k in places.items())
    return Library(kind, terms), which


def _along_case(component: str, term: Term) -> tuple[Input, ...]:
    """Factors of a term along the case axes, in an order that does not depend on the component."""
    turned = (Input(case_channel(component, f.channel), f.power, f.signed) for f in term.factors)
    return tuple(sorted(turned, key=lambda f: (f.channel, f.power, f.signed)))
