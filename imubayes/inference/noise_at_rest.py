"""What each component of a case said at rest, as rows that its noise is judged by.

In a still nothing but the noise changes. How the case lies there is known to no better than the noise, if at
all (a free tumble has |f| = g, a hand against a table a degree), so each still has a mean of its own in an
accelerometer's rows, and takes with it what drifts from still to still. The gyroscopes hardly depend on how
the case lies: their rows have the columns of their terms, and drift from still to still counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.case import Case, own_rows
from imubayes.inference.linear import Linear
from imubayes.inference.stills import Stills, find_stills, means_of, rows_of
from imubayes.inference.triad import Triad
from imubayes.rig.inputs import CaseRun, ImuRun, KnownRun, TriadRun, durations


def rows_at_rest(runs: Sequence[CaseRun], case: Case) -> dict[str, tuple[Linear, ...]]:
    """All samples of the stills: of each component, by its name, a `Linear` for each run.

    Where inputs are known no still is looked for: all rows of a component, with its own columns.

    Parameters
    ----------
    runs : of the case.
    case : solved, for the directions of its stills and its libraries.
    """
    partly = [run for run in runs if not isinstance(run, KnownRun)]
    if not partly:
        return {one.name: own_rows(case, one) for one in case.components}
    found: dict[str, list[Linear]] = {one.name: [] for one in case.components}
    for run in partly:
        stills, force = _known(run) if isinstance(run, ImuRun) and run.sections else _found(run, case)
        for name, rows in _of_run(run, stills, force, case):
            found[name].append(rows)
    return {name: tuple(rows) for name, rows in found.items()}


def _known(run: ImuRun) -> tuple[Stills, FloatArray]:
    """Positions that the study gives, and the specific force (k, 3) in each."""
    at_rest = sorted((one for one in run.sections if one.angle == 0.0), key=lambda one: one.start)
    force = run.gravity * np.array([one.direction for one in at_rest])
    return tuple((one.start, one.stop) for one in at_rest), force


def _found(run: TriadRun | ImuRun, case: Case) -> tuple[Stills, FloatArray]:
    """Stills of a free tumble, and the specific force (k, 3) by the calibrated accelerometers."""
    triad_run = run.accelerometers if isinstance(run, ImuRun) else run
    stills = find_stills(triad_run)
    return stills, case.triads[0].compensate(means_of(triad_run.output, stills))


def _of_run(
    run: TriadRun | ImuRun, stills: Stills, force: FloatArray, case: Case
) -> Iterator[tuple[str, Linear]]:
    """Rows of every component of one run."""
    own = np.eye(len(stills))
    output = run.force if isinstance(run, ImuRun) else run.output
    for c, name in enumerate(case.triads[0].components):
        columns = tuple(f"still {k + 1}" for k in range(len(stills)))
        yield name, _rows(run, (name, output[:, c]), stills, columns, own)
    if isinstance(run, ImuRun):
        for c, (name, columns, X) in enumerate(_gyroscope_columns(case.triads[1], force)):
            yield name, _rows(run, (name, run.rate[:, c]), stills, columns, X)


def _gyroscope_columns(triad: Triad, force: FloatArray) -> Iterator[tuple[str, tuple[str, ...], FloatArray]]:
    """Name, terms and columns (k, p) at rest of each gyroscope."""
    regressors = triad.regressors(np.zeros_like(force), force)
    for name, lib, X in zip(triad.components, triad.libraries, regressors, strict=True):
        yield name, lib.names, X


def _rows(
    run: TriadRun | ImuRun,
    said: tuple[str, FloatArray],
    stills: Stills,
    columns: tuple[str, ...],
    X: FloatArray,
) -> Linear:
    """Rows of a component: its name and output (n,), and its columns (k, p) in each still."""
    index, still = rows_of(stills)
    name, output = said
    return Linear(
        name=f"{run.name} ({name} at rest)",
        procedure=run.procedure,
        names=columns,
        t=run.t[index],
        duration=durations(run.t[index], run.interval),
        interval=run.interval,
        y=output[index],
        columns=_taken(X, still),
    )


def _taken(X: FloatArray, still: NDArray[np.int64]) -> Callable[[int, int], FloatArray]:
    return lambda start, stop: X[still[start:stop]]
