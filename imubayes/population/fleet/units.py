"""One unit of a fleet: its runs read or simulated, its terms decided, and the small record that is kept.

A unit gives the same record to the last digit wherever it is analysed: its random numbers come from the
study's seed and its own number (recorded: its name) alone, and linear algebra is left to one thread.
"""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.algebra.factor import Factor, reorder, with_prior_rows
from imubayes.campaign.preparation import Prepared, prepare, runs_of
from imubayes.errors import ImubayesError
from imubayes.inference.at_noise import at_found_noise
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.population.fleet.plan import FleetStudy, Part, Unit
from imubayes.population.lots.units import simulate_unit
from imubayes.rig.inputs import Run
from imubayes.rig.runs import RunSpec
from imubayes.selection.decision import Selection, loose_fit, select

_ONE_AT_A_TIME = threading.Lock()
"""Threads of a worker take turns: a limit on the threads of linear algebra holds for the whole process."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What is kept of a unit; arrays are in the order of the library, SI.

    Attributes
    ----------
    number, name : of the unit.
    mean, sd : (p,) model-averaged.
    full_mean, full_sd : (p,) under the full library and a prior so wide that it only holds what the data
        leave open.
    inclusion : (p,) posterior probability of each term.
    verdicts : of each term.
    noise : N, B, K that was found, averaged over runs.
    samples : rows used.
    R : (p + 1, p + 1) triangular factor of the terms and the response, whitened with the noise that was
        found; the errors of the bench are integrated out.
    truth : (p,) coefficients of a simulated unit; NaN for a recorded one.
    """

    number: int
    name: str
    mean: FloatArray
    sd: FloatArray
    full_mean: FloatArray
    full_sd: FloatArray
    inclusion: FloatArray
    verdicts: tuple[str, ...]
    noise: tuple[float, float, float]
    samples: int
    R: FloatArray
    truth: FloatArray


@dataclass(frozen=True, slots=True)
class Broken:
    """A unit that has no record, and why."""

    number: int
    name: str
    error: str


@dataclass(frozen=True, slots=True, eq=False)
class PartFound:
    """Records of a part's units, and the units that have none, each in the order of the units."""

    index: int
    records: tuple[Record, ...]
    broken: tuple[Broken, ...]


def part_found(study: FleetStudy, part: Part) -> PartFound:
    """Analyse the units of a part.

    Parameters
    ----------
    study : says the campaign; its list of units is not used.
    part : of the fleet.
    """
    from threadpoolctl import threadpool_limits

    with _ONE_AT_A_TIME, threadpool_limits(1):
        found = [_unit_found(study, part.only([k])) for k in range(len(part.units))]
    return PartFound(
        part.index,
        tuple(one for one in found if isinstance(one, Record)),
        tuple(one for one in found if isinstance(one, Broken)),
    )


def _unit_found(study: FleetStudy, alone: Part) -> Record | Broken:
    (unit,) = alone.units
    try:
        return record_of(study, alone)
    except ImubayesError as error:
        return Broken(unit.number, unit.name, str(error))
    except Exception as error:  # noqa: BLE001  # our fault in one unit must not cost the other thousand
        fault = f"{type(error).__name__}: {error}"
        return Broken(unit.number, unit.name, f"{fault}; this is a fault of imubayes, please report it")


def record_of(study: FleetStudy, alone: Part) -> Record:
    """Test and analyse one unit.

    Parameters
    ----------
    study : says the campaign.
    alone : part of this unit only.

    Raises
    ------
    InputError : if a file of the unit cannot be used.
    ConvergenceError : if the errors of the bench do not settle.
    """
    (unit,) = alone.units
    spec, seed = replace(study.spec, id=unit.name), (study.seed, *_stream(unit))
    if alone.lot is None:
        spec = replace(spec, runs=tuple(_recorded(run, unit) for run in spec.runs))
        runs = tuple(run for run in runs_of(spec, study.seed, 0) if isinstance(run, Run))
        truth = np.full(len(spec.library.terms), np.nan)
    else:
        spec, truth = replace(spec, truth=alone.lot.truth(0)), alone.lot.theta[0]
        runs = simulate_unit(spec, alone.lot, 0, np.random.default_rng([*seed, 0]))
    ready = prepare(spec, runs, lambda message: None, np.random.default_rng([*seed, 1]))
    selection = select(ready.summary, ready.prior, noises=(at_found_noise(ready.summary, ready.prior),))
    return _record(unit, ready, selection, truth)


def _record(unit: Unit, ready: Prepared, selection: Selection, truth: FloatArray) -> Record:
    p = len(selection.terms)
    mean, cov = loose_fit(ready.summary, ready.prior)
    mean_noise = np.mean([(run.noise.N, run.noise.B, run.noise.K) for run in ready.summary.runs], axis=0)
    N, B, K = mean_noise.tolist()
    return Record(
        number=unit.number,
        name=unit.name,
        mean=np.array([term.mean for term in selection.terms]),
        sd=np.array([term.sd for term in selection.terms]),
        full_mean=mean[:p],
        full_sd=np.sqrt(np.diagonal(cov)[:p]),
        inclusion=np.array([term.inclusion for term in selection.terms]),
        verdicts=tuple(term.verdict for term in selection.terms),
        noise=(N, B, K),
        samples=sum(run.samples for run in ready.summary.runs),
        R=of_terms(ready.summary, ready.prior).R,
        truth=truth,
    )


def of_terms(summary: Summary, prior: ScalePrior) -> Factor:
    """Factor of the terms alone, at the noise that was found.

    With the rows of their prior stacked under it, and their columns first, what the errors of the bench do is
    in the rows above those of the terms: these alone have the terms' likelihood with the errors integrated
    out.
    """
    found = at_found_noise(summary, prior).factor
    terms = len(summary.names) - len(summary.extras)
    rows = np.where(np.arange(found.p) < terms, 0.0, 1.0 / prior.sd)
    whole = replace(found, R=with_prior_rows(found.R, rows))
    sorted_ = reorder(whole, (*summary.names[terms:], *summary.names[:terms]))
    extras = found.p - terms
    return Factor(sorted_.names[extras:], sorted_.R[extras:, extras:], found.n, found.log_det)


def _stream(unit: Unit) -> tuple[int, int]:
    """Random stream of a unit: a recorded one's hangs on its name, as others may be added before it."""
    if unit.place is None:
        return 1, unit.number
    return 2, int.from_bytes(hashlib.sha256(unit.name.encode()).digest()[:8])


def _recorded(run: RunSpec, unit: Unit) -> RunSpec:
    """Run of a unit: in its folder, or in its only file."""
    file = run_file(run, unit)
    return replace(run, file=file, shown=str(file))


def run_file(run: RunSpec, unit: Unit) -> Path:
    """Path of a run of a recorded unit.

    Examples
    --------
    >>> run_file(RunSpec("tumble", "tumble", shown="t.csv"), Unit(0, "A1", Path("data/A1"))).as_posix()
    'data/A1/t.csv'
    """
    place = unit.place or Path(unit.name)
    return place / run.shown if run.shown else place
