"""What is said of a study that is wrong, to the letter (`tests/references/messages`)."""

import pytest

from imubayes.errors import InputError
from imubayes.study.schema import read, read_runs

SENSOR = """
[study]
seed = 1
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
STUDY = SENSOR + RUN
SIMULATED = 'simulate = { angles = 4, planes = 2, dwell = "4 s", rate = "1 Hz" }\n'
SCENE = f'{STUDY}[[scene]]\nname = "quadrotor"\nbudget = {{ position = "100 m" }}\n'
SESSIONS = "".join(
    STUDY[STUDY.index("[[sensor]]") :].replace('"A"', f'"{k}"\nunit = "U"\nsession = "{k}"') for k in (1, 2)
)
APPENDIX = f'{STUDY}[[appendix]]\ntitle = "T"\nfile = "good.csv"\n'
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
KNOWN = IMU.replace("free-", "").replace('file = "run.csv"\ngravity = "9.81 m/s^2"\n', SIMULATED)
LOTS = f"""
[study]
seed = 4
[lots]
kind = "gyroscope"
classes = ["mems_tactical", "fog_navigation"]
units = 3
[lots.library]
powers = 2
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
[[fleet.run]]
name = "tumble"
procedure = "tumble"
{SIMULATED}
"""
FOLDERS, FILES = FLEET.replace("12", '"lot/*"'), FLEET.replace("12", '"flat/*"').replace(SIMULATED, "")

WRONG = {
    "study": (STUDY, r"""
seed => sed
[study] => [flight]
file = => flie =
"A" => "A
[[sensor.run]] => [sensor.run]
[[sensor.run]]\nname = "tumble"\nprocedure = "tumble"\nfile = "run.csv" =>
name = "tumble" =>
seed = 1 => seed = "one"
seed = 1 => method = "gibbs"
"accelerometer" => "magnetometer"
"accelerometer" => "imu"
mems_tactical => mems_tactial
mems_tactical => mech_dtg
procedure = "tumble" => procedure = "tumbling"
"run.csv" += [[sensor]]\nid = "B"\nkind = "accelerometer"
"run.csv" += [[sensor.run]]\nname = "tumble"\nprocedure = "tumble"\nfile = "run.csv"
"run.csv" += [[sensor.run]]\nname = "free"\nprocedure = "free-tumble"\ngravity = "1 g"\nfile = "run.csv"
mems_tactical" += [sensor.library]\npowers = -3
mems_tactical" += [sensor.library]\nset = "full"
mems_tactical" += [sensor.library]\ntemperature = 1\ntemperature_of = ["K0"]
"run.csv" += noise = { run = "log" }
"run.csv" += noise = { run = "tumble" }
"run.csv" += noise = { N = 60.0 }
"run.csv" += noise = { N = "60 ug" }
"run.csv" += noise = { N = "-1 ug/sqrt(Hz)" }
"run.csv" += columns = { output = { unit = "furlong" } }
"run.csv" += columns = { f_i = { unit = "deg/h" } }
"run.csv" += columns = { fi = "f_i" }
"run.csv" += columns = { output = { scale = "2 m/s^2/count" } }
"run.csv" += columns = { output = { unit = "count", scale = "0 m/s^2/count" } }
"run.csv" += columns = { t = { wraps = "60 s" } }
"run.csv" += columns = { t = { unit = "ms", wraps = "60 m" } }
"run.csv" += columns = { t = { unit = "ms", wraps = 60 } }
"run.csv" += columns = { t = { unit = "ms", wraps = "0 ms" } }
"run.csv" += columns = { t = { unit = "ns", wraps = "1e10 s" } }
"run.csv" += columns = { output = { unit = "g", wraps = "9 g" } }
"run.csv" += columns = { t = { unit = "s", wraps = "10 s" } }
"run.csv" += simulate = { angles = 4 }
file = "run.csv" =>
file = "run.csv" => simulate = { dwell = "0 s" }
file = "run.csv" => simulate = { dwell = "1e999 s" }
file = "run.csv" => simulate = { dwel = "1 s" }
file = "run.csv" => simulate = { planes = 7 }
file = "run.csv" => simulate = { positions = 5 }
file = "run.csv" => simulate = { positions = 6, angles = 4 }
file = "run.csv" => simulate = { steps = [{ at = -1, dwell = "1 s" }] }
file = "run.csv" => simulate = { steps = [{ at = 1, dwell = "1 s" }], settle = "1 s" }
file = "run.csv" => ignore = ["f_q"]\nsimulate = { dwell = "5 s" }
"tumble"\nfile = "run.csv" => "other"\nsimulate = {}
"tumble"\nfile = "run.csv" => "other"\nsimulate = { levels = ["1 g"], band = ["20 Hz"] }
"tumble"\nfile = "run.csv" => "free-tumble"\ngravity = "1 g"\nsimulate = {}
class = "mems_tactical" => && file = "run.csv" => simulate = {}
mems_tactical" += truth = { K2 = "3 ug/g^2" }
mems_tactical" += truth = { b2 = "3 ug" }
mems_tactical" += truth = { b2 = "3 ug/g^2" }
mems_tactical" += prior = { b9 = "1 ug" }
mems_tactical" += prior = { b0 = "0 ug" }
procedure = "tumble" => procedure = "free-tumble"
procedure = "tumble" => procedure = "free-tumble"\ngravity = "9.81 m"
procedure = "tumble" => procedure = "free-tumble"\ngravity = { latitude = "45 deg" }
"tumble"\nfile => "free-tumble"\ngravity = "1 g"\nfile && mems_tactical" += reference = { fixture = true }
mems_tactical" += reference = { gravty = true }
mems_tactical" += reference = { gravity = 1e-6 }
mems_tactical" += reference = { gravity = "0 ug" }
mems_tactical" += reference = { gravity = "1 arcsec" }
mems_tactical" += reference = { latency = true }
mems_tactical" += reference = { turn_on = true }
mems_tactical" += bench = "drawn"
mems_tactical" += robust = "yes"
mems_tactical" += unit = "U"
mems_tactical" += session = "1"
seed = 1 += [sampling]\nes = 9
seed = 1 += [sampling]\ness = 0
seed = 1 += [sampling]\ness = inf
seed = 1 += [sampling]\ness = "many"
seed = 1 += [sampling]\ntime_limit = 600
seed = 1 += [sampling]\ntime_limit = "-1 min"
seed = 1 += [sampling]\ntime_limit = "10 m"
seed = 1 += [decision]\nfalse_keep = 0
seed = 1 += [noise]\nidentify = "some"
seed = 1 += [noise]\ncandidates = ["X"]
seed = 1 += [noise]\nprocess = 1
seed = 1 += catalogue = "none.toml"
seed = 1 += catalogue = "own.toml"
run.csv => rum.csv
file = "run.csv" => file = "$IMUBAYES_DATA/x/y.mat"\nsource = "someone/somewhere (BSD)"
"""),
    "sessions": (SESSIONS, r"""
session = "2" => session = "1"
session = "2" => session = "2"\nlibrary = { powers = 2 }
id = "2" => id = "1"
"""),
    "appendix": (APPENDIX, r"""
title = "T" =>
file = "good.csv" =>
"good.csv" += notes = ""
good.csv => none.csv
good.csv => empty.csv
good.csv => headings.csv
good.csv => long.csv
good.csv => ragged.csv
good.csv => binary.csv
good.csv => quotation.csv
good.csv => .
"""),
    "scene": (SCENE, r"""
budget = { position = "100 m" } =>
name = "quadrotor" =>
quadrotor => quadroter
"quadrotor" += scene = "quadroter"
"quadrotor" += scene = "marine"\nfile = "f.csv"
position => positoin
100 m => 100 s
100 m => 0 m
position = "100 m" => output = "1 deg/h"
 } => , velocity = "1 m/s" }
"quadrotor" += duration = "0 s"
"quadrotor" += axis = "w"
"quadrotor" += columns = { t = "time" }
"quadrotor" += file = "none.csv"
"quadrotor" += file = "flight.csv"
"quadrotor" += file = "f.csv"\ncolumns = { output = "a" }
"""),
    "imu": (IMU, r"""
library.gyroscope => library
powers = 1 => powrs = 1
, gyroscope = "mems_consumer" } =>  }
gyroscope = "mems_consumer" => gyroscope = "mems"
free-tumble => tumble
free-tumble => ferraris
gravity = "9.81 m/s^2" =>
g_i = "300 => g_x = "300
"A" += robust = true && free-tumble => ferraris && 9.81 m/s^2" += sections = [{ rows = [0, 9], up = "x" }]
id = "A" += reference = { fixture = true }
kind = "imu" => kind = "accelerometer"
"""),
    "known": (KNOWN, rf"""
"imu" += truth = {{ b0 = "1 mg" }}
"imu" += truth = {{ ax.b9x = "1 mg" }}
"imu" += reference = {{ turn_on = "1 mg" }}
"imu" += bench = "drawn"
procedure = "tumble" => procedure = "free-tumble"\ngravity = "9.81 m/s^2"
{SIMULATED.strip()} => file = "run.csv"\ncolumns = {{ f_i = 3 }}
{SIMULATED.strip()} => file = "run.csv"\nsections = [{{ rows = [0, 5], up = "x" }}]
"""),
    "lots": (LOTS, r"""
units = 3 => units = 1
units = 3 => unit = 3
"fog_navigation"] => "fog_navigatio"]
"fog_navigation"] => "mems_tactical"]
["mems_tactical", "fog_navigation"] => []
kind = "gyroscope" => kind = "accelerometer"
kind = "gyroscope" => kind = "imu"
powers = 2 => powers = 99
procedure = "tumble" => procedure = "tumbl"
simulate = { => file = "a.csv"\n# {
seed = 4 += [sampling]\ness = 5
seed = 4 => method = "full"
name = "helicopter" => name = "helicoptre"
attitude => atitude
units = 3 => asks = "triads"
units = 3 => asks = "triad"
units = 3 => asks = { needed_by = ["mems_tactical"] }
units = 3 => asks = { needed_by = ["mems_tactical"], not_by = [] }
units = 3 => asks = { needed_by = ["mems_tactica"], not_by = ["fog_navigation"] }
units = 3 => asks = { needed_by = ["fog_navigation"], not_by = ["fog_navigation"] }
units = 3 => asks = "scenes" && [[scene]]\nname = "helicopter"\nbudget = { attitude = "1 deg" } =>
[[scene]] => [[scene]]\nname = "helicopter"\nbudget = { velocity = "1 m/s" }\n[[scene]]
"""),
    "fleet": (FLEET, rf"""
units = 12 => units = 1
units = 12 => units = 1.5
units = 12 => units = true
units = 12 => units = "none/*"
units = 12 =>
"mems_tactical" => "mems_tacticl"
[fleet.library] => [fleet.libary]
{SIMULATED.strip()} => file = "t.csv"
angles = 4 => angles = 0
planes = 2 => planes = 9
seed = 4 += method = "full"
seed = 4 += [sampling]\ness = 10.0
procedure = "tumble" =>
"""),
    "fleet in folders": (FOLDERS, rf"""
seed = 4 => seed = 5
{SIMULATED.strip()} =>
"tumble"\n{SIMULATED.strip()} => "free-tumble"\nfile = "t.csv"\ngravity = "1 g"
"""),
    "fleet in files": (FILES, r"""
procedure = "tumble" += file = "t.csv"
procedure = "tumble" += [[fleet.run]]\nname = "two"\nprocedure = "tumble"
"""),
}  # fmt: skip
"""By name: a study, and what makes it wrong, a line each: ``old => new``, or ``old += the next line``."""

BESIDE = {
    "run.csv": "t [s],output [m/s^2],f_i [g],f_j [g]\n"
    + "".join(f"{0.5 * k},{9.8 - 0.1 * k * k},{1 - 0.01 * k},{0.02 * k}\n" for k in range(40)),
    "good.csv": "a,b\n1,2\n",
    "empty.csv": "",
    "headings.csv": "a,b\n\n",
    "long.csv": "a,b\n" + "1,2\n" * 201,
    "ragged.csv": "a,b\n1,2\n1\n",
    "binary.csv": b"\xff\xfe\x00",
    "quotation.csv": 'a\n"1\n',
    "flight.csv": "t [s],T [degC]\n0,1\n1,1\n",
    "own.toml": "[accelerometer.mine]\nlike = 'none'\n",
    **dict.fromkeys(("lot/A/t.csv", "lot/B/t.csv", "flat/A.csv", "flat/B.csv"), "t [s]\n"),
}


def _changed(text, line):
    for edit in line.replace("\\n", "\n").split(" && "):
        old, replaces, new = edit.partition(" =>")
        if not replaces:
            old, _, added = edit.partition(" += ")
            new = f"{old}\n{added}"
        assert old in text, line
        text = text.replace(old, new.removeprefix(" ") if replaces else new, 1)
    return text


@pytest.mark.parametrize("name", WRONG)
def test_wrong_study_is_refused_in_these_words(name, tmp_path, golden, monkeypatch):
    monkeypatch.setenv("IMUBAYES_DATA", str(tmp_path / "nowhere"))
    for file, content in BESIDE.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    text, lines = WRONG[name]
    said = []
    for line in lines.strip("\n").splitlines():
        (tmp_path / "study.toml").write_text(_changed(text, line), encoding="utf-8")
        try:
            read(tmp_path / "study.toml")
            read_runs(tmp_path / "study.toml")
        except InputError as error:
            said.append(f"{line}\n    {error}".replace(f"{tmp_path}/", ""))
        else:
            pytest.fail(f"not refused: {line}")
    golden(f"messages/{name}.txt", "\n".join(said) + "\n")
