"""Units that were tested in several sessions: what a study's results say of their repeatability."""

from __future__ import annotations

from collections.abc import Sequence

from imubayes.campaign.study import SensorResult, SensorSpec
from imubayes.inference.sessions import Repeatability, SessionEstimate, repeatability


def between_sessions(
    results: Sequence[tuple[SensorSpec, Sequence[SensorResult]]],
) -> tuple[Repeatability, ...]:
    """Compare the units that were tested in several sessions."""
    estimates = [
        SessionEstimate(
            unit=spec.unit,
            session=spec.session,
            component=result.id.removeprefix(spec.id).removeprefix("."),
            term=term.name,
            si=term.unit,
            printed=term.printed,
            mean=term.full_mean,
            sd=term.full_sd,
            prior_sd=term.prior_sd,
        )
        for spec, components in results
        if spec.unit
        for result in components
        for term in result.selection.terms
    ]
    return repeatability(estimates)
