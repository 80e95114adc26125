"""Studies of a tumble to be planned, shared by tests."""

from pathlib import Path

from imubayes.study.schema import read_plan

TUMBLE = """
[study]
title = "Before the test"
seed = 3
[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_tactical"
[sensor.library]
powers = 2
asymmetry = -1
[sensor.reference]
gravity = true
fixture = "5 arcsec"
[plan]
time = "45 min"
needed = ["b0", "b1", "m_j", "m_k", "c_ij", "c_ik", "c_jk"]
units = 2
[[plan.run]]
name = "tumble"
procedure = "tumble"
candidates = { angles = 24, planes = 3 }
dwell = ["60 s"]
rate = "0.5 Hz"
settle = "10 s"
mount = "5 min"
setup = "10 min"
"""
"""Three quarters of an hour with a dividing head."""

SMALL = TUMBLE.replace("angles = 24, planes = 3", "angles = 12, planes = 2")
SMALL = SMALL.replace(', "m_k", "c_ij", "c_ik", "c_jk"', "")
"""Of fewer positions, for fewer terms."""


def written(folder: Path, text: str) -> Path:
    """Write a study into a folder."""
    file = folder / "study.toml"
    file.write_text(text, encoding="utf-8")
    return file


def plan_of(folder: Path, text: str):
    """What a study's file asks to be planned."""
    return read_plan(written(folder, text))
