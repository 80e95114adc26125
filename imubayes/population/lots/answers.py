"""What a lot of units says of its class: values that the stages of a class-level study exchange."""

from __future__ import annotations

from dataclasses import dataclass

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.intervals import Share
from imubayes.population.lots.plan import LotStudy
from imubayes.sensors.sensor_class import SensorClass


@dataclass(frozen=True, slots=True, eq=False)
class UnitFound:
    """One unit of a lot: its truth, and what its test campaign says.

    Attributes
    ----------
    class_id, number : of the unit.
    truth : (p,) coefficients, SI, in the order of the library.
    mean, cov : (p,) and (p, p) of the coefficients under the full library and a prior so wide that it only
        holds what the data leave open.
    average, sd : (p,) model-averaged.
    inclusion : (p,) posterior probability of each term.
    verdicts : of each term.
    draws : (m, p) model-averaged posterior draws, for scenes.
    noise : N, B, K that was found, averaged over runs, SI.
    """

    class_id: str
    number: int
    truth: FloatArray
    mean: FloatArray
    cov: FloatArray
    average: FloatArray
    sd: FloatArray
    inclusion: FloatArray
    verdicts: tuple[str, ...]
    draws: FloatArray
    noise: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PopulationTerm:
    """One term over the units of a class, SI.

    Attributes
    ----------
    name : of the term.
    needed : share of the units in which it is needed.
    open : share of the units whose test cannot tell, or leaves it undecided.
    mean, spread : of the population: a hierarchical posterior over units.
    true_mean, true_spread : of the lot that was simulated.
    """

    name: str
    needed: Share
    open: float
    mean: Share
    spread: Share
    true_mean: float
    true_spread: float


@dataclass(frozen=True, slots=True)
class MissionTerm:
    """One term of a class in one scene.

    Attributes
    ----------
    name : of the term.
    rms : median over units of its rms effect on the output, SI.
    share : median over units of its share of the budget, and the 5 % and 95 % quantiles over units.
    required : share of the units whose smallest model for the scene has it, shown by the test or not.
    true_share : median over units of the share of the budget of the simulated truth.
    """

    name: str
    rms: float
    share: Share
    required: float
    true_share: float


@dataclass(frozen=True, slots=True, eq=False)
class MissionFound:
    """A class in one scene.

    Attributes
    ----------
    mission : name of the scene.
    terms : every term of the library.
    order : number of terms that a unit's own smallest model has: median and 90 % range over units.
    within : share of the units for which a model within the budget was found.
    noise_share : noise's share of the budget, median over units.
    basic_share : median share of the budget that a triad of twelve parameters leaves; NaN where not asked.
    """

    mission: str
    terms: tuple[MissionTerm, ...]
    order: Share
    within: float
    noise_share: float
    basic_share: float


@dataclass(frozen=True, slots=True, eq=False)
class ClassFound:
    """What the units of a class say of it.

    Attributes
    ----------
    sensor_class : which.
    units : one by one.
    terms : of the population.
    order : number of needed terms a unit, median and 90 % range over units.
    missions : by scene.
    """

    sensor_class: SensorClass
    units: tuple[UnitFound, ...]
    terms: tuple[PopulationTerm, ...]
    order: Share
    missions: tuple[MissionFound, ...]


@dataclass(frozen=True, slots=True)
class Coverage:
    """How many of the truths their 90 % intervals hold.

    Attributes
    ----------
    held, of : count of them, and of all.
    share : of the truths that are held, with its 90 % interval.
    """

    held: int
    of: int
    share: Share


@dataclass(frozen=True, slots=True)
class Check:
    """The class-level answers against the simulated truth.

    Attributes
    ----------
    precision, recall : of "required in this scene by this class", over all terms, classes and scenes.
    cells : how many of these the tests tell, and how many of them are truly required.
    population_mean, population_spread : what the 90 % intervals hold of the lots' means and spreads.
    untold : cells beside these, which the tests cannot tell.
    """

    precision: Share
    recall: Share
    cells: tuple[int, int]
    population_mean: Coverage
    population_spread: Coverage
    untold: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class LotResult:
    """Result of a class-level study."""

    study: LotStudy
    classes: tuple[ClassFound, ...]
    check: Check
    seconds: float
