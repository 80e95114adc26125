"""Files of classes: what a user's own catalogue may say, and how it is refused."""

import math
import re
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path

import pytest

from imubayes.errors import StudyError, TermError
from imubayes.sensors.catalogue import classes, prior_sd, sensor
from imubayes.sensors.catalogue_file import read_catalogue
from imubayes.sensors.terms import library

G = 9.80665
GRADES = files("imubayes.sensors").joinpath("grades.toml").read_text(encoding="utf-8")
ULPS = 1e-14
"""A few multiplications of conversion factors."""

every_class = pytest.mark.parametrize("entry", classes(), ids=lambda entry: f"{entry.kind}-{entry.id}")

SCREENED = """
[accelerometer.screened]
like = "mems_tactical"
grade = "tactical, screened"
quoted = { datasheet = ["K0", "N.high"] }
[accelerometer.screened.source]
datasheet = "acceptance tests of 40 units"
[accelerometer.screened.coefficients]
K0 = [0.2, 0.6, 1.5, "mg"]
"""


def _file(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_own_class_states_only_what_it_changes(tmp_path):
    (own,) = read_catalogue(_file(tmp_path, SCREENED))
    base = sensor("mems_tactical", kind="accelerometer")
    assert own.coefficients["K0"] == pytest.approx([0.2e-3 * G, 0.6e-3 * G, 1.5e-3 * G], rel=ULPS)
    assert {**own.coefficients, "K0": ()} == {**base.coefficients, "K0": ()}
    assert (own.noise, own.technology, own.examples) == (base.noise, base.technology, base.examples)
    assert own.grade == "tactical, screened"
    assert own.origins["K0"] == ("datasheet",) * 3
    assert own.origins["N"] == ("order_of_magnitude", "order_of_magnitude", "datasheet")
    assert {**own.origins, "K0": (), "N": ()} == {**base.origins, "K0": (), "N": ()}
    assert "acceptance tests of 40 units" in own.source
    assert "as mems_tactical: STIM300" in own.source


def test_a_figure_that_is_stated_anew_is_no_longer_what_the_old_source_said(tmp_path):
    text = SCREENED.replace('quoted = { datasheet = ["K0", "N.high"] }', "")
    (own,) = read_catalogue(_file(tmp_path, text))
    assert own.origins["K0"] == ("order_of_magnitude",) * 3
    assert own.origins["N"][2] == "second_hand"


def test_own_class_is_known_where_its_catalogue_is_given_and_nowhere_else(tmp_path):
    own = read_catalogue(_file(tmp_path, SCREENED))
    assert sensor("screened", kind="accelerometer", catalogue=own) is own[0]
    assert classes("accelerometer", catalogue=own) == (*classes("accelerometer"), own[0])
    assert classes("gyroscope", catalogue=own) == classes("gyroscope")
    sd, origin = prior_sd(own[0], library("accelerometer").terms[0])
    assert sd == pytest.approx(0.6e-3 * G, rel=ULPS)
    assert origin == "the typical K0"
    with pytest.raises(TermError, match="'screened' is not in the catalogue"):
        sensor("screened", kind="accelerometer")


def test_a_floor_is_0_664_of_the_coefficient_and_takes_the_place_of_the_one_that_was_inherited(tmp_path):
    text = SCREENED + "".join(
        f'[accelerometer.{key}]\nlike = "screened"\nnoise = {{ {key} = [10, 20, 40, "ug"] }}\n'
        for key in ("B", "floor")
    )
    _, by_coefficient, by_floor = read_catalogue(_file(tmp_path, text))
    for B, floor in zip(by_coefficient.noise["B"], by_floor.noise["B"], strict=True):
        assert B / floor == pytest.approx(math.sqrt(2.0 * math.log(2.0) / math.pi), rel=1e-12)
    assert by_coefficient.noise["B"][1] == pytest.approx(20e-6 * G, rel=ULPS)


@pytest.mark.parametrize("own", ["", 'floor = [1, 2, 3, "ug"]\nB = [1, 2, 3, "ug"]\n'])
def test_bias_instability_is_stated_once_as_floor_or_as_coefficient(tmp_path, own):
    block = GRADES[GRADES.index("[accelerometer.mems_tactical]") : GRADES.index("[accelerometer.vba_quartz]")]
    block = re.sub(r"(?m)^floor = .*\n", own, block).replace("mems_tactical", "mine")
    block = block.replace(', "floor.low"', "")
    with pytest.raises(StudyError, match=r"mine\.noise: (neither B nor floor|B and floor): expected one of"):
        read_catalogue(_file(tmp_path, block))


@every_class
def test_a_class_of_the_catalogue_reads_the_same_from_a_file_of_its_own(entry, tmp_path):
    head = f"[{entry.kind}.{entry.id}"
    blocks = [
        f"[{block}" for block in GRADES.split("\n[") if f"[{block}".startswith((f"{head}]", f"{head}."))
    ]
    own = "\n".join(blocks).replace(head, f"[{entry.kind}.own")
    (read,) = read_catalogue(_file(tmp_path, own))
    told = asdict(read)
    assert {**told, "id": entry.id, "campaign": entry.campaign} == asdict(entry)


def test_catalogue_that_is_not_there_or_no_toml_is_refused_by_name(tmp_path):
    with pytest.raises(StudyError, match=r"none.toml: cannot be read .*: check the path"):
        read_catalogue(tmp_path / "none.toml")
    with pytest.raises(StudyError, match=r"own.toml: is not TOML"):
        read_catalogue(_file(tmp_path, "[gyroscope.own"))


def test_incomplete_class_without_a_model_is_told_every_figure_that_it_lacks(tmp_path):
    block = GRADES[GRADES.index("[gyroscope.mech_dtg]") : GRADES.index("[gyroscope.mech_rate_spring]")]
    lines = [line for line in block.splitlines() if not line.startswith(("g1 =", "T1 ="))]
    own = "\n".join(lines).replace("gyroscope.mech_dtg", "gyroscope.own")
    with pytest.raises(
        StudyError, match=r"gyroscope.own.coefficients: there is no g1, T1: state it, or say like"
    ):
        read_catalogue(_file(tmp_path, own))
