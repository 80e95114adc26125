"""Test procedures as functions that return what the rig applies."""

from imubayes.rig.plans import EARTH_RATE, Plan
from imubayes.rig.rotations import centrifuge, oscillation, rate_table
from imubayes.rig.shaking import vibration
from imubayes.rig.tumbles import positions, static, tumble

__all__ = [
    "EARTH_RATE",
    "Plan",
    "centrifuge",
    "oscillation",
    "positions",
    "rate_table",
    "static",
    "tumble",
    "vibration",
]
