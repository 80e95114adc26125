"""How far a verdict hangs on the prior: inclusion over prior widths, and a g-prior as a second opinion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """Inclusion of the candidates under other priors.

    Attributes
    ----------
    names : candidates, p of them.
    widths : (w,) factors on every prior sd.
    inclusion : (w, p) at each width.
    g_prior : (p,) inclusion under the hyper-g prior; NaN where a column depends on others, which a g-prior
        cannot have.
    left_out : candidates that the g-prior could not have, because they depend on others.
    swing : names of the candidates whose verdict changes between the widths.
    """

    names: tuple[str, ...]
    widths: FloatArray
    inclusion: FloatArray
    g_prior: FloatArray
    left_out: tuple[str, ...]
    swing: tuple[str, ...]
