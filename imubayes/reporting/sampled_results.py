"""Plain values for ``result.json`` of what comes beside the exact posterior: chains, test bench, sessions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.reporting.evidence import exact_evidence

if TYPE_CHECKING:
    from imubayes.campaign.study import Distrusted, ExtraPosterior, SensorResult
    from imubayes.inference.mcmc.chains import Chains
    from imubayes.inference.sessions import Repeatability


def mcmc_block(sensor: SensorResult) -> dict[str, Any]:
    """How the draws came about, and how well the chains mixed."""
    if sensor.chains:
        return _of_chains(sensor.chains) | {"log_evidence": _evidence(sensor, sensor.chains)}
    m = len(sensor.draws)
    return {
        "sampler": "exact",
        "draws": m,
        "ess_min": float(m),
        "rhat_max": 1.0,
        "acceptance": 1.0,
        "seconds": sensor.seconds,
        "converged": True,
        "text": "independent draws from the exact posterior: there is nothing to accept or to mix",
        "tau_max": 1.0,
        "steps": m,
        "walkers": 1,
        "ensembles": 1,
        "worst": None,
        "interpolation_error": 0.0,
        "log_evidence": None,
    }


def _of_chains(chains: Chains) -> dict[str, Any]:
    found = chains.diagnostics
    return {
        "sampler": chains.sampler,
        "draws": int(np.prod(chains.theta.shape[:2])),
        "ess_min": float(np.min(found.ess)),
        "rhat_max": float(np.max(found.rhat)),
        "acceptance": found.acceptance,
        "seconds": found.seconds,
        "converged": bool(found.converged),
        "text": found.text,
        "tau_max": float(np.max(found.tau)),
        "steps": found.steps,
        "walkers": found.walkers,
        "ensembles": found.ensembles,
        "worst": found.parameters[int(np.argmin(found.ess))],
        "interpolation_error": chains.interpolation_error,
    }


def _evidence(sensor: SensorResult, chains: Chains) -> dict[str, float | None]:
    """Evidence of the full library by bridge sampling; ``exact`` is that at the estimated noise."""
    value, sd = chains.log_evidence
    return {"value": value, "sd": sd, "exact": exact_evidence(sensor)}


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


def noise_posterior(chains: Chains | None) -> dict[str, Any]:
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


def _moments(draws: FloatArray) -> dict[str, float]:
    low, high = np.quantile(draws, (0.05, 0.95)).tolist()
    return {"mean": float(draws.mean()), "sd": float(draws.std(ddof=1)), "q05": low, "q95": high}


def extra_entry(entry: ExtraPosterior) -> dict[str, Any]:
    """A column that is no term, with its prior and its posterior."""
    extra = entry.extra
    return {
        "name": extra.name,
        "kind": extra.kind,
        "unit": extra.unit,
        "prior_sd": extra.sd,
        "mean": entry.mean,
        "sd": entry.sd,
        "confounded_with": list(entry.partners),
        "text": extra.text,
        "printed_unit": extra.printed,
    }


def distrusted_entry(dwell: Distrusted) -> dict[str, Any]:
    """A dwell that is more likely contaminated than not."""
    return {
        "run": dwell.run,
        "start": dwell.start,
        "stop": dwell.stop,
        "probability": dwell.probability,
        "offset": dwell.offset,
        "sd": dwell.sd,
    }


def session_entry(found: Repeatability) -> dict[str, Any]:
    """One parameter in several sessions; null where a unit lacks a session."""
    mean, q05, q95 = found.between
    return {
        "parameter": found.parameter,
        "unit": found.unit,
        "printed_unit": found.printed,
        "units": list(found.units),
        "sessions": list(found.sessions),
        "mean": found.mean,
        "sd": found.sd,
        "pulls": found.pulls,
        "p_value": found.p_value,
        "level": found.level,
        "between": {"mean": mean, "q05": q05, "q95": q95},
        "exceeds": bool(found.exceeds),
        "shared": found.shared,
    }
