"""A sensor's runs as a linear Gaussian problem: factor, priors, noise rules, and errors of the test bench."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from imubayes.campaign.study import SensorSpec
from imubayes.errors import ConvergenceError, StudyError
from imubayes.inference.lack_of_fit import NOTHING, Beside
from imubayes.inference.linear import Extra, Linear, linear_of, reach_of, swing_of
from imubayes.inference.mcmc.chains import at_found_noise
from imubayes.inference.misfit import Misfit
from imubayes.inference.nuisances import solve
from imubayes.inference.prior import ScalePrior, class_sd, weak_sd
from imubayes.inference.reproducibility import FEWEST, Spread, spreads
from imubayes.inference.residuals import ResidualCheck
from imubayes.inference.robust import Distrusted
from imubayes.inference.summary import Summary, rules_among, summarize
from imubayes.inference.triad import triad_of
from imubayes.progress import Progress
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import FREE_TUMBLE
from imubayes.sensors.noise import NoiseRule
from imubayes.sensors.terms import Library

SETTLED = 0.05
"""Change of ln of an estimated sd that is none: its own uncertainty is larger."""

ROUNDS = 20
"""Most rounds in which estimated sds must settle; they take two or three."""


class Doubt(NamedTuple):
    """How it is asked what the library lacks: share of the tests' level, and seed of predictive draws."""

    share: int
    seed: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Runs as a linear Gaussian problem: factor, rows, prior of every column, and where it comes from.

    Attributes
    ----------
    spreads : sds that the data tell of errors of the bench and of what the library lacks.
    scatter : of dwells beyond the noise of their samples.
    misfit, checks : what residuals say that the library does not contain, and their tests by run, where that
        was asked of these rows.
    absorbed : what they said before something stood beside the library; None where nothing does.
    """

    runs: Sequence[Run]
    summary: Summary
    rows: Sequence[Linear]
    prior: ScalePrior
    source: str
    distrusted: tuple[Distrusted, ...] = ()
    spreads: tuple[Spread, ...] = ()
    scatter: tuple[Spread, ...] = ()
    misfit: Misfit | None = None
    checks: tuple[ResidualCheck, ...] = ()
    absorbed: Misfit | None = None

    @property
    def fits(self) -> bool:
        """Whether residuals, where they were asked, are what the noise leaves."""
        return not (self.misfit and self.misfit.found) and all(check.fits for check in self.checks)


def summarized(
    spec: SensorSpec,
    runs: Sequence[Run],
    prior: ScalePrior,
    tell: Progress,
    kinds: Mapping[str, float] | None = None,
    *,
    beside: Beside = NOTHING,
    scattering: bool = False,
) -> Prepared:
    """Factor of the runs, with the errors of the bench that the study allows for, or `kinds` of them.

    With `beside` the model has further columns. Rows may scatter as they will where that is `scattering`:
    the class says what samples do.
    """
    rules, sensor = rules_of(spec, runs), None if scattering else spec.sensor_class
    wanted = dict(spec.reference if kinds is None else kinds)
    if not wanted and not beside.extras:
        rows = tuple(linear_of(run, spec.library) for run in runs)
        summary = summarize(runs, spec.library, sensor=sensor, rules=rules, rows=rows)
        return Prepared(tuple(runs), summary, rows, prior, "")
    if wanted:
        tell("errors of the test bench")
    typical = {kind: size for kind, size in wanted.items() if kind in spec.estimated}
    typical |= {extra.kind: extra.sd for extra in beside.extras}
    sizes = {**wanted, **typical}
    for _ in range(ROUNDS):
        bench = {kind: sizes[kind] for kind in wanted}
        given: dict[str, Any] = {"sensor": sensor, "rules": rules, "beside": beside.scaled(sizes)}
        summary, rows = solve(runs, spec.library, prior.sd, bench, **given)
        few = {kind for kind in wanted if sum(extra.kind == kind for extra in summary.extras) < FEWEST}
        for kind in few & typical.keys():
            raise StudyError(
                f"sensor '{spec.id}': reference: {kind} is to be estimated from fewer than {FEWEST} mounts:"
                " expected its size, a quantity"
            )
        whole = with_extras(prior, summary.extras)
        told = spreads(at_found_noise(summary, whole).factor, whole.sd, summary.extras, typical)
        before, sizes = sizes, {**sizes, **{one.kind: one.mean for one in told}}
        if all(abs(math.log(sizes[kind] / before[kind])) < SETTLED for kind in typical):
            return Prepared(tuple(runs), summary, rows, whole, "", spreads=told)
    raise ConvergenceError(
        f"sensor '{spec.id}': how far mounts differ ({', '.join(typical)}) did not settle in {ROUNDS} rounds:"
        " state its size in reference, a quantity",
        wanted,
    )


def with_extras(prior: ScalePrior, extras: Sequence[Extra]) -> ScalePrior:
    """Prior of the terms and, after them, of what is none."""
    return ScalePrior([*prior.sd, *(extra.sd for extra in extras)])


def rules_of(spec: SensorSpec, runs: Sequence[Run]) -> dict[str, NoiseRule]:
    """Noise rules of the study; a run whose noise was to be that of a run left out has its own."""
    return rules_among({s.name: s.noise for s in spec.runs}, {run.name for run in runs})


def component_prior(spec: SensorSpec, runs: Sequence[Run]) -> tuple[ScalePrior, str]:
    """Physical prior of a component, and where it comes from in words."""
    if spec.sensor_class:
        return _overridden(class_sd(spec.sensor_class, spec.library), spec, [spec.library])
    swing = max(swing_of(run, spec.library) for run in runs)
    reach = np.max([reach_of(linear_of(run, spec.library)) for run in runs], axis=0)
    return _overridden(weak_sd(reach, swing), spec, [spec.library])


def triad_prior(spec: SensorSpec) -> tuple[ScalePrior, str]:
    """Physical prior of the terms of all three components, and where it comes from in words.

    Raises
    ------
    StudyError : if the study names no class.
    """
    libraries = triad_of(spec.library, referenced=referenced(spec)).libraries
    if spec.sensor_class is None:
        raise StudyError(
            f"sensor '{spec.id}': several components in one case need a class, which gives their priors:"
            ' add class = "..." (imubayes catalogue lists them)'
        )
    return _overridden(
        np.concatenate([class_sd(spec.sensor_class, lib) for lib in libraries]), spec, libraries
    )


def _overridden(sd: np.ndarray, spec: SensorSpec, libraries: Sequence[Library]) -> tuple[ScalePrior, str]:
    """Prior with the study's own sds in place of the class's."""
    names = [name for lib in libraries for name in lib.names]
    values = [spec.prior.get(name, usual) for name, usual in zip(names, sd.tolist(), strict=True)]
    given = [name for name in dict.fromkeys(names) if name in spec.prior]
    source = (
        f"typical magnitudes of class {spec.sensor_class.id}"
        if spec.sensor_class
        else "no class is named: each term alone may move the output by its whole range"
    )
    return ScalePrior(values), f"{source}; {', '.join(given)} from the study" if given else source


def referenced(spec: SensorSpec) -> bool:
    """Whether a triad's directions are known, and not only the size of gravity or of a table's rate.

    In the hand the gyroscopes of a whole IMU know them by its accelerometers.
    """
    by_others = spec.kind == "gyroscope" and not spec.runs[0].turntable
    return spec.runs[0].procedure != FREE_TUMBLE or by_others
