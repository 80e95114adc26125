"""The rung of one noise: every submodel, with the noise of each run as it was estimated."""

from __future__ import annotations

from imubayes.campaign.preparation import Prepared
from imubayes.inference.at_noise import at_found_noise
from imubayes.ladder.answer import Answer, answer_of
from imubayes.ladder.problem import Ground, prepared
from imubayes.selection.decision import select


def plug_in(ground: Ground) -> Answer:
    """Weigh every submodel at the noise that was estimated."""
    ready, problem = prepared(ground), ground.problem
    ground.tell("every model at the estimated noise")
    selection = select(
        ready.summary,
        ready.prior,
        noises=(at_found_noise(ready.summary, ready.prior),),
        costs=problem.costs,
        hierarchical=problem.hierarchical,
    )
    return answer_of("plug-in", selection, noise_of(ready))


def noise_of(ready: Prepared) -> tuple[tuple[float, float, float], ...]:
    """(N, B, K) of each run as it was estimated."""
    return tuple((run.noise.N, run.noise.B, run.noise.K) for run in ready.summary.runs)
