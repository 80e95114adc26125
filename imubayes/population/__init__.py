"""Many units: lots that are drawn, fleets that were recorded, and the processes that share them.

Each is tested as if it were unknown; here stand how, and what is kept of it (`Record`). The bench's errors
are drawn anew for each simulated unit, normal with the sds that the study states, and they act on what the
rig applied, not on what it says. The analysis allows for them under the same sds.

A unit gives the same record to the last digit wherever it is analysed: its random numbers come from the
study's seed and its own number (recorded: its name) alone, and linear algebra is left to one thread.
"""

from __future__ import annotations

import hashlib
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, noise_scale, reorder, with_prior_rows
from imubayes.campaign import SensorSpec
from imubayes.campaign.preparation import prepare, runs_of
from imubayes.campaign.prepared import Prepared
from imubayes.errors import ConvergenceError, ImubayesError
from imubayes.inference.mcmc import at_found_noise
from imubayes.inference.mcmc.ensembles import Limits
from imubayes.inference.mcmc.run import Sampled, sample
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Summary
from imubayes.population.levels import without_own
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate_runs
from imubayes.selection.decision import Selection, posterior_draws, select
from imubayes.selection.panel import Votes, begun, panel_of, with_chains
from imubayes.sensors import SensorClass
from imubayes.sensors.lots import Lot
from imubayes.work import silent

_ONE_AT_A_TIME = threading.Lock()
"""Threads of a worker take turns: a limit on the threads of linear algebra holds for the whole process."""

STEPS = 120
"""Steps of the 128 walkers or more of a unit's chains; reports state the R-hat that they reach."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What is kept of a unit; arrays are in the order of the library, SI.

    Attributes
    ----------
    mean, sd : (p,) model-averaged.
    full_mean, full_sd : (p,) under the full library, without the term's own prior.
    inclusion : (p,) posterior probability of each term.
    noise : N, B, K that was found, averaged over runs.
    samples : rows used.
    R : (p + 1, p + 1) triangular factor of the terms and the response, whitened with the noise that was
        found; the errors of the bench are integrated out.
    truth : (p,) coefficients of a simulated unit; NaN for a recorded one.
    draws : (m, p) model-averaged posterior draws, for scenes; none where no scene asks.
    votes : of the other methods beside the decision; None where they were not asked.
    rhat : largest split R-hat of the chains among them; NaN without chains.
    scale : of the rows' scatter, over the noise that was found.
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
    draws: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    votes: Votes | None = None
    rhat: float = math.nan
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Broken:
    """A unit that has no record, and why."""

    number: int
    name: str
    error: str


@dataclass(frozen=True, slots=True)
class Unit:
    """One of many units, by its number from 0 and its name.

    `place` is the folder of a recorded unit's files, or its only file; `lot` that of a drawn one, with this
    unit alone.
    """

    number: int
    name: str
    place: Path | None = None
    lot: Lot | None = None


def alone(lot: Lot, place: int) -> Lot:
    """One unit of a lot, as a lot."""
    return replace(lot, theta=lot.theta[place : place + 1], noise=(lot.noise[place],))


def record_of(
    unit: Unit,
    spec: SensorSpec,
    seed: Sequence[int],
    *,
    draws: int = 0,
    methods: bool = False,
    chains: bool = False,
) -> Record:
    """Test a unit, and analyse it; the noise is held as it was found.

    `spec` is that of any such unit, `seed` the unit's own. So many `draws` of the posterior are kept;
    `methods` and `chains` say whether the other methods are asked, too, and whether chains are one of them.
    It is an `InputError` if a file of the unit cannot be used, a `StudyError` if the options of a run make no
    run, and a `ConvergenceError` if the errors of the bench do not settle.
    """
    spec, runs, truth = _tested(unit, replace(spec, id=unit.name), seed)
    seed = (*seed, 1)
    rng = np.random.default_rng(seed)
    ready = prepare(spec, runs, silent, rng)
    selection = select(ready.summary, ready.prior, noises=(at_found_noise(ready.summary, ready.prior),))
    factor, scale = of_terms(ready.summary, ready.prior), noise_scale(ready.summary.factor, ready.prior.sd)
    places = [factor.names.index(name) for name in selection.carriers]
    value, variance = without_own(factor.R / scale, ready.prior.sd[: factor.p])
    asked, rhat = _votes(ready, selection, [*seed, 1], chains=chains) if methods else (None, math.nan)
    summaries = ready.summary.runs
    N, B, K = np.mean([(run.noise.N, run.noise.B, run.noise.K) for run in summaries], axis=0).tolist()
    return Record(
        number=unit.number,
        name=unit.name,
        mean=np.array([term.mean for term in selection.terms]),
        sd=np.array([term.sd for term in selection.terms]),
        full_mean=value[places],
        full_sd=np.sqrt(variance[places]),
        inclusion=np.array([term.inclusion for term in selection.terms]),
        verdicts=tuple(term.verdict for term in selection.terms),
        noise=(N, B, K),
        samples=sum(run.samples for run in summaries),
        R=factor.R,
        scale=scale,
        truth=truth,
        draws=posterior_draws(selection, draws, rng) if draws else np.zeros((0, 0)),
        votes=asked,
        rhat=rhat,
    )


def _tested(
    unit: Unit, spec: SensorSpec, seed: Sequence[int]
) -> tuple[SensorSpec, Sequence[Run], FloatArray]:
    """Spec of a unit, its runs, simulated or read, and its coefficients (p,): NaN of a recorded one."""
    if unit.lot is not None:
        spec = replace(spec, truth=unit.lot.truth(0))
        runs = simulate_unit(spec, unit.lot, 0, np.random.default_rng([*seed, 0]))
        return spec, runs, unit.lot.theta[0]
    files = [(run, run_file(run, unit)) for run in spec.runs]
    spec = replace(spec, runs=tuple(replace(run, file=file, shown=str(file)) for run, file in files))
    return spec, runs_of(spec, seed[0], 0), np.full(len(spec.library.terms), np.nan)


def _votes(
    ready: Prepared, selection: Selection, seed: Sequence[int], *, chains: bool
) -> tuple[Votes, float]:
    """Votes of the other methods, no campaign resampled, and R-hat of the chains among them."""
    asked = begun(ready.summary, ready.prior, ready.rows, rng=np.random.default_rng(seed), resamples=0)
    votes = panel_of(asked, selection).votes
    if not chains:
        return votes, math.nan
    first = int(np.random.SeedSequence(seed).generate_state(1)[0])
    limits = Limits(seed=first, steps=STEPS, time_limit=math.inf)
    try:
        sampled = sample(ready.summary, ready.rows, ready.prior.sd, limits=limits)
    except ConvergenceError as unfinished:  # they are taken as they are after their steps
        if not isinstance(sampled := unfinished.estimate, Sampled):
            return votes, math.nan
    return with_chains(votes, selection, sampled.chains), float(np.max(sampled.chains.diagnostics.rhat))


def of_terms(summary: Summary, prior: ScalePrior) -> Factor:
    """Factor of the terms alone, at the noise that was found.

    With the rows of their prior stacked under it, and their columns first, what the errors of the bench do is
    in the rows above those of the terms: these alone have the terms' likelihood with the errors integrated
    out.
    """
    whitened = at_found_noise(summary, prior).factor
    terms = len(summary.names) - len(summary.extras)
    rows = np.where(np.arange(whitened.p) < terms, 0.0, 1.0 / prior.sd)
    whole = replace(whitened, R=with_prior_rows(whitened.R, rows))
    sorted_ = reorder(whole, (*summary.names[terms:], *summary.names[:terms]))
    extras = whitened.p - terms
    return Factor(sorted_.names[extras:], sorted_.R[extras:, extras:], whitened.n, whitened.log_det)


def simulate_unit(spec: SensorSpec, lot: Lot, number: int, rng: np.random.Generator) -> tuple[Run, ...]:
    """Runs of one unit of a lot on a bench with errors, with the inputs that the rig says.

    `spec` says its runs, its truth, and the sd of each kind of error of the bench; `rng` draws these errors,
    then the noise.
    """
    noise, given = lot.noise[number], (spec.runs, lot.sensor_class, spec.library)
    return simulate_runs(*given, truth=spec.truth, rng=rng, bench=spec.reference, noise=noise)[0]


@dataclass(frozen=True, slots=True, eq=False)
class FleetStudy:
    """A study of a fleet, as its file says.

    `spec` is that of every unit: class, library, campaign, errors of the bench. Units are worked off, and
    kept, in parts of `part`; `processes` of this machine share the work where no scheduler does.
    """

    title: str
    seed: int
    spec: SensorSpec
    sensor_class: SensorClass
    units: tuple[Unit, ...]
    part: int
    processes: int
    path: Path
    text: str

    @property
    def simulated(self) -> bool:
        """Whether the units are drawn at random."""
        return self.units[0].place is None


def parts_of(study: FleetStudy, lot: Lot | None) -> tuple[tuple[Unit, ...], ...]:
    """Divide a fleet, of a lot where it is simulated, into parts by the numbers of its units."""
    units = study.units
    if lot is not None:
        units = tuple(replace(unit, lot=alone(lot, unit.number)) for unit in units)
    return tuple(units[first : first + study.part] for first in range(0, len(units), study.part))


def simulated_units(class_id: str, count: int) -> tuple[Unit, ...]:
    """Units without files, by class and number.

    Examples
    --------
    >>> [unit.name for unit in simulated_units("mems_tactical", 10)][-1]
    'mems_tactical-10'
    """
    digits = len(str(count))
    return tuple(Unit(number, f"{class_id}-{number + 1:0{digits}}") for number in range(count))


def part_found(study: FleetStudy, part: Sequence[Unit]) -> tuple[Record | Broken, ...]:
    """Analyse units in their order; the study's list of units is not used."""
    from threadpoolctl import threadpool_limits

    def record(unit: Unit) -> Record | Broken:
        try:
            return unit_record(study, unit)
        except ImubayesError as error:
            return Broken(unit.number, unit.name, str(error))
        except Exception as error:  # noqa: BLE001  # our fault in one unit must not cost the other thousand
            fault = f"{type(error).__name__}: {error}; this is a fault of imubayes, please report it"
            return Broken(unit.number, unit.name, fault)

    with _ONE_AT_A_TIME, threadpool_limits(1):
        return tuple(map(record, part))


def unit_record(study: FleetStudy, unit: Unit) -> Record:
    """Test a unit of a fleet, and analyse it (`record_of`).

    The random stream of a recorded one hangs on its name, as others may be added before it.
    """
    stream = 1, unit.number
    if unit.place is not None:
        stream = 2, int.from_bytes(hashlib.sha256(unit.name.encode()).digest()[:8])
    return record_of(unit, study.spec, (study.seed, *stream))


def run_file(run: RunSpec, unit: Unit) -> Path:
    """Path of a run of a recorded unit.

    Examples
    --------
    >>> run_file(RunSpec("tumble", "tumble", shown="t.csv"), Unit(0, "A1", Path("data/A1"))).as_posix()
    'data/A1/t.csv'
    """
    place = unit.place or Path(unit.name)
    return place / run.shown if run.shown else place
