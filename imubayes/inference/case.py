"""Several components in one case, as one linear problem that each of them is judged on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from imubayes.algebra.arrays import FloatArray
from imubayes.inference.linear import Linear, narrowed
from imubayes.inference.norm_only import FreeTumble
from imubayes.inference.prior import ScalePrior
from imubayes.inference.summary import Rules, Summary
from imubayes.inference.triad import Triad
from imubayes.inference.triad_angles import Angle
from imubayes.rig.inputs import Facts
from imubayes.sensors.catalogue import SensorClass
from imubayes.sensors.terms import Library


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """What is asked of the triad of one kind.

    Attributes
    ----------
    library : candidate terms of a component.
    prior : of the triad's terms, in the order of `triad.triad_of(library).names`.
    sensor : class whose noise prior steers the estimate of the noise.
    rules : how the noise is known, by run.
    reference : sd in SI of each error of the bench that is allowed for, where inputs are known.
    """

    library: Library
    prior: ScalePrior
    sensor: SensorClass | None = None
    rules: Rules | None = None
    reference: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """One component of a case.

    Attributes
    ----------
    name : ``ax`` ... ``gz``.
    library : its terms, which the summary has under ``<name>.<term>``.
    facts : what its inputs have in common.
    parts : indices of the summary's runs that the component takes part in.
    """

    name: str
    library: Library
    facts: Facts
    parts: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Components of a case after their runs are summarized.

    Attributes
    ----------
    summary : one factor over the terms of all components, then the extras.
    rows : of each of the summary's runs.
    components : in the order of the columns.
    triads : accelerometers, and gyroscopes where there are some, at the coefficients of the full library.
    residuals : (n,) of each of the summary's runs, SI.
    inputs : channels (n,) of each of the summary's runs, for the figures and the search for what is missing.
    angles : how the axes of triads lie, where directions were known.
    """

    summary: Summary
    rows: tuple[Linear, ...]
    components: tuple[Component, ...]
    triads: tuple[Triad, ...]
    residuals: tuple[FloatArray, ...]
    inputs: tuple[dict[str, FloatArray], ...]
    angles: tuple[Angle, ...] = ()


def tumble_case(found: FreeTumble) -> Case:
    """Three accelerometers, of a free tumble."""
    every = tuple(range(len(found.summary.runs)))
    parts = dict.fromkeys(found.triad.components, every)
    return Case(
        summary=found.summary,
        rows=found.rows,
        components=components_of(found.triad, found.summary.facts, parts),
        triads=(found.triad,),
        residuals=tuple(left for left, _, _ in found.residuals),
        inputs=tuple(along("f", force) for _, _, force in found.residuals),
    )


def own_rows(case: Case, component: Component) -> tuple[Linear, ...]:
    """Rows of a component with the columns of its own terms and of the extras: those of others are zero."""
    extras = {extra.name for extra in case.summary.extras}
    names = case.summary.names
    own = [k for k, name in enumerate(names) if name in extras or name.startswith(f"{component.name}.")]
    return tuple(narrowed(case.rows[k], own) for k in component.parts)


def along(quantity: str, values: FloatArray) -> dict[str, FloatArray]:
    """Channels (n,) of vectors (n, 3) along the case axes."""
    return {f"{quantity}_{axis}": values[:, k] for k, axis in enumerate("ijk")}


def components_of(triad: Triad, facts: Facts, parts: dict[str, tuple[int, ...]]) -> tuple[Component, ...]:
    """Components of a triad, with the runs that each takes part in."""
    named = zip(triad.components, triad.libraries, strict=True)
    return tuple(Component(name, lib, facts, parts[name]) for name, lib in named)
