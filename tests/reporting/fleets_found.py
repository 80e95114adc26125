"""A small, complete result of a fleet: records made by hand, put together as those of a study are."""

from dataclasses import replace

import numpy as np
from fleet_studies import fleet
from lot_studies import record

from imubayes.population import Broken
from imubayes.population.fleet import FleetResult, lot_of, together

BROKEN = Broken(7, "A<8>", "A8/tumble.csv, line 3: is no number")


def fleet_result(title: str = "Ten <b>units</b>") -> FleetResult:
    """Ten units: bias and scale needed, m_j not, the rest open; one is off in b0, one in N, one unread."""
    study = fleet(10, title=title, part=8, processes=2, text="[fleet]")
    lot = lot_of(study)
    assert lot is not None
    p = len(lot.sd)
    sd = np.where(np.arange(p) < 3, 0.3, 3.0) * lot.sd
    said = {
        "verdicts": ("needed", "needed", "not needed", *["inseparable"] * (p - 3)),
        "inclusion": np.linspace(1.0, 0.0, p),
    }
    units = []
    for k, truth in enumerate(lot.theta):
        moved = truth + 40.0 * lot.sd * ((np.arange(p) == 0) & (k == 1))
        noise = (6e-4 * (1.0 + 0.02 * k) * (2.0 if k == 2 else 1.0), 3e-4, 3e-6)
        known = {"full_mean": moved, "full_sd": sd, "mean": moved, "sd": sd, "noise": noise, "samples": 137}
        units.append(record(truth, number=k, name=f"u{k}", **said, **known))
    found = together((*units[:7], BROKEN, *units[8:]), study, lot)
    few = {"worst": found.worst[:3], "farthest": found.farthest[:3]}
    return replace(found, **few, engine="2 processes of this machine", seconds=12.0)
