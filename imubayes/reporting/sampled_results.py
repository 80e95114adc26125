"""What comes beside the exact posterior, as it is published: chains and errors of the test bench."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.evidence import exact_evidence
from imubayes.reporting.result.entries import Extra, Mcmc
from imubayes.reporting.result.values import published

if TYPE_CHECKING:
    from imubayes.campaign.study import ExtraPosterior, SensorResult
    from imubayes.inference.mcmc.chains import Chains
    from imubayes.reporting.result.entries import Moments


def published_chains(sensor: SensorResult) -> Mcmc:
    """How the draws came about, and how well the chains mixed."""
    if sensor.chains:
        return _of_chains(sensor, sensor.chains)
    m = len(sensor.draws)
    return Mcmc(
        sampler="exact",
        draws=m,
        ess_min=m,
        rhat_max=1.0,
        acceptance=1.0,
        seconds=sensor.seconds,
        converged=True,
        text="independent draws from the exact posterior: there is nothing to accept or to mix",
        tau_max=1.0,
        steps=m,
        walkers=1,
        ensembles=1,
        worst=None,
        interpolation_error=0.0,
        log_evidence=None,
    )


def _of_chains(sensor: SensorResult, chains: Chains) -> Mcmc:
    """Of Markov chains; the evidence is of the full library, ``exact`` at the estimated noise."""
    found, (value, sd) = chains.diagnostics, chains.log_evidence
    return published(
        Mcmc,
        found,
        sampler=chains.sampler,
        draws=int(np.prod(chains.theta.shape[:2])),
        ess_min=np.min(found.ess),
        rhat_max=np.max(found.rhat),
        tau_max=np.max(found.tau),
        worst=found.parameters[int(np.argmin(found.ess))],
        interpolation_error=chains.interpolation_error,
        log_evidence={"value": value, "sd": sd, "exact": exact_evidence(sensor)},
    )


def column_moments(sensor: SensorResult) -> dict[str, tuple[float, float]]:
    """Mean and sd of each of the component's terms by its chains, under the full library; empty if exact."""
    if sensor.chains is None:
        return {}
    place = {name: j for j, name in enumerate(sensor.chains.names)}
    theta = sensor.chains.theta.reshape(-1, len(place))
    own = zip(sensor.selection.columns, sensor.selection.terms, strict=True)
    return {
        term.name: (float(theta[:, place[column]].mean()), float(theta[:, place[column]].std(ddof=1)))
        for column, term in own
        if column in place
    }


def noise_posterior(chains: Chains | None) -> dict[str, dict[str, Moments]]:
    """Posterior of N, B, K of each run that has a noise of its own; empty without chains."""
    if chains is None:
        return {}
    return {
        run: {
            letter: _moments(chains.noise[:, :, g, parameter].ravel())
            for parameter, letter in enumerate("NBK")
        }
        for g, run in enumerate(chains.runs)
    }


def _moments(draws: FloatArray) -> Moments:
    low, high = np.quantile(draws, (0.05, 0.95)).tolist()
    return {"mean": float(draws.mean()), "sd": float(draws.std(ddof=1)), "q05": low, "q95": high}


def published_extra(entry: ExtraPosterior) -> Extra:
    """A column that is no term, with its prior and its posterior."""
    return published(
        Extra,
        entry.extra,
        prior_sd=entry.extra.sd,
        mean=entry.mean,
        sd=entry.sd,
        confounded_with=entry.partners,
        printed_unit=entry.extra.printed,
    )
