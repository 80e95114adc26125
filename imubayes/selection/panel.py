"""Every other method on one component, run as its own authors would run it, beside the decision."""

from __future__ import annotations

from dataclasses import dataclass

from imubayes.selection.criteria import Criterion
from imubayes.selection.reduced import Reduced
from imubayes.selection.sensitivity import Sensitivity
from imubayes.selection.sindy import Sparse
from imubayes.selection.votes import Votes


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """What the other methods say of one component.

    Attributes
    ----------
    criteria : information criteria and predictive scores.
    sindy : sparse regressions.
    sensitivity : inclusion under other priors.
    votes : all of them beside the decision.
    reduced : the smallest model that predicts the test as well as the posterior does.
    """

    criteria: tuple[Criterion, ...]
    sindy: tuple[Sparse, ...]
    sensitivity: Sensitivity
    votes: Votes
    reduced: Reduced
