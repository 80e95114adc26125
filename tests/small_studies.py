"""Small studies that are right, shared by tests of what a file says."""

from pathlib import Path

from imubayes.study.schema import read

SENSOR = """
[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_tactical"
"""
RUN = """
[[sensor.run]]
name = "tumble"
procedure = "tumble"
file = "run.csv"
"""
SIMULATED = 'simulate = { angles = 4, planes = 2, dwell = "4 s", rate = "1 Hz" }\n'
IMU = """
[[sensor]]
id = "A"
kind = "imu"
class = { accelerometer = "mems_industrial", gyroscope = "mems_consumer" }
[sensor.library.gyroscope]
powers = 1
set = "extended"
[sensor.prior.gyroscope]
g_i = "300 deg/h/g"
[[sensor.run]]
name = "hand"
procedure = "free-tumble"
file = "run.csv"
gravity = "9.81 m/s^2"
"""
LOTS = f"""
[study]
seed = 4
[lots]
kind = "gyroscope"
classes = ["mems_tactical", "fog_navigation"]
units = 3
[lots.library]
powers = 2
asymmetry = -1
[[lots.run]]
name = "tumble"
procedure = "tumble"
{SIMULATED}
[[scene]]
name = "helicopter"
budget = {{ attitude = "1 deg" }}
"""
FLEET = f"""
[study]
seed = 4
[fleet]
kind = "accelerometer"
class = "mems_tactical"
units = 12
[fleet.library]
powers = 2
asymmetry = -1
[fleet.reference]
gravity = "1e-5 m/s^2"
[[fleet.run]]
name = "tumble"
procedure = "tumble"
{SIMULATED}
"""


def written(folder: Path, text: str, name: str = "study.toml") -> Path:
    """Write a study into a folder."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def study_of(folder: Path, text: str, name: str = "study.toml"):
    """What a study's file becomes."""
    return read(written(folder, text, name))[1]
