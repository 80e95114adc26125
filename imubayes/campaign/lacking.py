"""What bench and library lack, where the data show it: what stands beside the terms then, and its size."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce

import numpy as np

from imubayes.algebra.factor import add
from imubayes.campaign.prepared import Doubt, Prepared, summarized, with_extras
from imubayes.campaign.study import SensorSpec
from imubayes.errors import ConvergenceError, UnobservableError
from imubayes.inference.dwells import dwells_of
from imubayes.inference.lack_of_fit import Beside, functions_of, varies
from imubayes.inference.linear import residuals
from imubayes.inference.misfit import Misfit, find_misfit
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.inference.prior import ScalePrior
from imubayes.inference.reproducibility import FEWEST, SHOWN, WIDTH, odds_of, scatter_of
from imubayes.inference.residuals import check_runs
from imubayes.inference.whitened import whitened_factor
from imubayes.progress import Progress
from imubayes.rig.bench import effective
from imubayes.rig.filtering import dwell_means
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import OUTPUT_UNIT, RunSpec
from imubayes.rig.reference import KINDS, errors_of
from imubayes.selection.decision import loose_fit
from imubayes.sensors.noise import NoiseRule

HIDDEN = 30.0
"""Typical size of what the library lacks over what it leaves of that: powers take the place of most of it."""

NOT_TOLD = (ConvergenceError, UnobservableError, np.linalg.LinAlgError)
"""What ends a search for sizes that the dwells do not tell."""

ALONE = "radius"
"""Error of a machine that looks like a scale factor: there is one arm, so that nothing repeats its error."""

SPARE = 8
"""Dwells beyond the columns that a run excites from which their scatter is told."""


def absorbing(spec: SensorSpec, found: Prepared, prior: ScalePrior, tell: Progress, doubt: Doubt) -> Prepared:
    """Problem with what nobody stated of the bench, and what the library lacks, where the data show it.

    Dwells are then what counts: their scatter is the noise.
    """
    means, found = tuple(dwell_means(run) for run in found.runs), _examined(found, doubt)
    mounts = _of_mounts(spec, found, means)
    if (
        not spec.estimated
        and (found.fits or not spec.bench_stated)
        and not _shows(found, spec, means, mounts)
    ):
        mounts = {}
    # steps so coarse that nothing moves say no scatter
    still = any(np.ptp(run.output) == 0.0 for run in means)
    if still or (not mounts and found.fits):
        return found
    tell("what the bench and the library lack")
    bench = {"reference": {**stated(spec), **mounts}, "estimated": frozenset(mounts)}
    wider = replace(spec, runs=_scattering(spec, found, means, mounts), **bench)
    made = left = found
    with suppress(*NOT_TOLD):  # what is lacking looks like far too large turns
        made = summarized(wider, means, prior, tell, scattering=True)
        made = left = made if found.fits else _examined(made, doubt)
    if left.misfit and not left.fits:
        beside = _functions(found, means, spec, left.misfit)
        with suppress(*NOT_TOLD):
            made = summarized(wider, means, prior, tell, beside=beside, scattering=True)
    if made is found:
        if spec.estimated:
            raise ConvergenceError(
                f"sensor '{spec.id}': how far mounts differ ({', '.join(mounts)}) cannot be told from this"
                " test: state its size in reference, a quantity",
                mounts,
            )
        return found
    scatter = tuple(
        one for pair in zip(found.summary.runs, made.summary.runs, strict=True) if (one := scatter_of(*pair))
    )
    more = len(made.summary.extras) > len(found.summary.extras)
    told = {"source": found.source, "distrusted": found.distrusted, "scatter": scatter}
    return replace(made, absorbed=found.misfit if more and not found.fits else None, **told)


def _scattering(
    spec: SensorSpec, found: Prepared, means: Sequence[Run], mounts: Mapping[str, float]
) -> tuple[RunSpec, ...]:
    """Runs whose noise is what their dwells scatter by, or that of their samples where dwells are too few."""
    noise: dict[str, NoiseRule] = {}
    for run, one in zip(means, found.summary.runs, strict=True):
        turned = len(errors_of([run], mounts)) if effective([run], mounts) else 0
        columns = int(np.sum(one.reach[: len(spec.library.names)] > 0.0)) + turned
        if run.samples < columns + SPARE:
            noise[run.name] = NoiseRule("fixed", one.noise)
        elif one.noise_run != one.name:  # another run's samples say nothing of its dwells
            noise[run.name] = NoiseRule()
    return tuple(replace(one, noise=noise.get(one.name, one.noise)) for one in spec.runs)


def _functions(found: Prepared, runs: Sequence[Run], spec: SensorSpec, misfit: Misfit) -> Beside:
    """Functions for what the library lacks: of the own input in each run, and of what shows it."""
    named, own = {run.name: run for run in runs}, spec.library.own
    of = dict.fromkeys((*((name, own) for name in named), *((one.run, one.input) for one in misfit.found)))
    told = [(name, channel) for name, channel in of if varies(named[name], channel)]
    return functions_of(runs, told, spec.library, OUTPUT_UNIT[spec.kind], HIDDEN * _scatter(found))


def _examined(found: Prepared, doubt: Doubt) -> Prepared:
    """The same with what residuals say that the library lacks, and their tests by run."""
    channels, (share, seed) = [run.inputs.channels for run in found.runs], doubt
    rng, (theta, cov) = np.random.default_rng(seed), loose_fit(found.summary, found.prior)
    misfit = find_misfit(found.rows, channels, found.summary, found.prior.sd, rng=rng, share=share)
    checks = check_runs(found.rows, theta, found.summary.runs, cov=cov, share=share)
    return replace(found, misfit=misfit, checks=checks)


def _of_mounts(spec: SensorSpec, found: Prepared, means: Sequence[Run]) -> dict[str, float]:
    """Typical size of the rotation from mount to mount, where nobody stated it and mounts can tell it."""
    if spec.estimated:
        return {name: size for name, size in spec.reference.items() if name in spec.estimated}
    if "fixture" in stated(spec) or any(run.stream for run in means) or not effective(means, ["fixture"]):
        return {}
    if len({(error.run, error.mount) for error in errors_of(means, ["fixture"])}) < FEWEST:
        return {}
    return {"fixture": KINDS["fixture"].default or 0.0}


def _shows(found: Prepared, spec: SensorSpec, means: Sequence[Run], mounts: Mapping[str, float]) -> bool:
    """Whether dwells are likelier with rotations from mount to mount than without; of no other errors."""
    if not mounts or spec.bench_stated:
        return False
    there, more = found.summary.extras, extras_for(means, mounts, sensor=spec.kind)
    theta, nu = np.split(loose_fit(found.summary, found.prior)[0], [len(spec.library.names)])
    rows = rows_with(means, spec.library, (*there, *more), theta, np.append(nu, np.zeros(len(more))))
    pairs = zip(rows, found.summary.runs, strict=True)
    factor = reduce(add, (whitened_factor(part, run.noise)[0] for part, run in pairs))
    return odds_of(factor, with_extras(found.prior, more).sd, more, "fixture") > SHOWN


def _scatter(found: Prepared) -> float:
    """Rms of what the library leaves of the dwells, SI."""
    theta = loose_fit(found.summary, found.prior)[0]
    left = [residuals(dwells_of(rows).means, theta) for rows in found.rows]
    return math.sqrt(float(np.mean(np.concatenate(left) ** 2)))


def stated(spec: SensorSpec) -> dict[str, float]:
    """Errors of the bench whose prior sd the study states, SI."""
    return {kind: size for kind, size in spec.reference.items() if kind not in spec.estimated}


def unstated(spec: SensorSpec, runs: Sequence[Run]) -> dict[str, float]:
    """Prior sd, SI, of the arm's radius for an accelerometer whose study says nothing of its bench.

    Its size is log-normal about the catalogue's typical one, as that of all errors which nobody stated; no
    data tell it, so that its rms stands for it.
    """
    whirled = [run for run in runs if run.procedure in KINDS[ALONE].procedures]
    told = all(any(name.startswith("w_") for name in run.inputs.channels) for run in whirled)
    if spec.kind != "accelerometer" or spec.bench_stated or spec.reference or not told:
        return {}
    size = (KINDS[ALONE].default or 0.0) * math.exp(WIDTH**2)
    return dict.fromkeys(effective(whirled, [ALONE]), size)
