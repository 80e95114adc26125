"""What is said of a study or a catalogue that is wrong, to the letter (`tests/references/messages`).

A golden file has a line for each change that makes its study wrong, ``old => new`` or ``old += the next
line``, and what is said of it below.
"""

from pathlib import Path

import pytest
from small_studies import FLEET, IMU, LOTS, RUN, SENSOR, SIMULATED

from imubayes.errors import InputError
from imubayes.planning.proposal import propose
from imubayes.sensors.catalogue_file import read_catalogue
from imubayes.study.schema import read, read_plan, read_runs

GOLDEN = Path(__file__).parents[1] / "references" / "messages"

STUDY = f"[study]\nseed = 1\n{SENSOR}{RUN}"
SCENE = f'{STUDY}[[scene]]\nname = "quadrotor"\nbudget = {{ position = "100 m" }}\n'
SESSIONS = "".join(
    STUDY[STUDY.index("[[sensor]]") :].replace('"A"', f'"{k}"\nunit = "U"\nsession = "{k}"') for k in (1, 2)
)
APPENDIX = f'{STUDY}[[appendix]]\ntitle = "T"\nfile = "good.csv"\n'
KNOWN = IMU.replace("free-", "").replace('file = "run.csv"\ngravity = "9.81 m/s^2"\n', SIMULATED)
PLAN = f"""{STUDY[: STUDY.index("[[sensor.run]]")]}
[plan]
time = "45 min"
needed = ["b0", "b1", "m_j"]
[[plan.run]]
name = "tumble"
procedure = "tumble"
candidates = {{ angles = 24, planes = 3 }}
dwell = ["60 s"]
rate = "0.5 Hz"
settle = "2 s"
"""
HAND = PLAN.replace('"b0", "b1", "m_j"', "").replace('"tumble"', '"free-tumble"').replace("0.5 Hz", "100 Hz")
HAND = HAND.replace("angles = 24, planes = 3", "attitudes = 18").replace("accelerometer", "imu")
FOLDERS, FILES = FLEET.replace("12", '"lot/*"'), FLEET.replace("12", '"flat/*"').replace(SIMULATED, "")

STUDIES = {
    "study": STUDY,
    "sessions": SESSIONS,
    "appendix": APPENDIX,
    "scene": SCENE,
    "imu": IMU,
    "known": KNOWN,
    "lots": LOTS,
    "fleet": FLEET,
    "fleet in folders": FOLDERS,
    "fleet in files": FILES,
    "plan": PLAN,
    "plan in the hand": HAND,
    "catalogue": '[gyroscope.own]\nlike = "fog_tactical"\n',
}
"""Studies, and a catalogue, that are right, by the golden file that says what makes each wrong."""

OUTPUTS = "ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
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
    "still.csv": "t [s],f_i [g]\n0,1\n0,1\n",
    "nothing.csv": "t [s],f_i [g]\n0,1\n1,nan\n",
    "unitless.csv": "t [s],f_i\n0,1\n1,1\n",
    "clockless.csv": "f_i [g]\n1\n1\n",
    "rate.csv": f"t [s],{OUTPUTS[33:]}\n0.5,1,2,3\n1.5,2,3,4\n2.5,3,4,5\n",
    "own.toml": "[accelerometer.mine]\nlike = 'none'\n",
    "roll.csv": "t [s],f_k [g],roll [deg]\n7,1,0\n8,1,0\n9,1,0\n",
    "zeros.csv": "t [s],f_k [g],q_w,q_x,q_y,q_z\n7,1,1,0,0,0\n8,1,0,0,0,0\n9,1,1,0,0,0\n",
    **{
        f"{name}.csv": f"t [s],{header}\n"
        + "".join(f"{k}{f',{k}' * (header.count(',') + 1)}\n" for k in range(3))
        for name, header in {
            "along": f"f_i [m/s^2],{OUTPUTS}",
            "inputless": OUTPUTS,
            "ay": f"f_x [m/s^2],{OUTPUTS.replace('ay', 'a2')}",
            "bare": f"f_x,{OUTPUTS}",
            "turned": f"f_x [deg/s],{OUTPUTS}",
            "force": OUTPUTS[:32],
        }.items()
    },
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


@pytest.mark.parametrize("name", STUDIES)
def test_wrong_study_is_refused_in_these_words(name, tmp_path, golden, monkeypatch):
    monkeypatch.setenv("IMUBAYES_DATA", str(tmp_path / "nowhere"))
    for file, content in BESIDE.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    text = (GOLDEN / f"{name}.txt").read_text(encoding="utf-8")
    said = []
    for line in (one for one in text.splitlines() if not one.startswith("    ")):
        (tmp_path / "study.toml").write_text(_changed(STUDIES[name], line), encoding="utf-8")
        try:
            if name == "catalogue":
                read_catalogue(tmp_path / "study.toml")
            elif "plan" in name:
                propose(read_plan(tmp_path / "study.toml"))
            else:
                read(tmp_path / "study.toml")
                read_runs(tmp_path / "study.toml")
        except InputError as error:
            said.append(f"{line}\n    {error}".replace(f"{tmp_path}/", ""))
        else:
            pytest.fail(f"not refused: {line}")
    golden(f"messages/{name}.txt", "\n".join(said) + "\n")
