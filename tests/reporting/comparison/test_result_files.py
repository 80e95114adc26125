"""Results read back."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from imubayes.errors import DataError
from imubayes.reporting.comparison.result_files import ResultFile, sensors_of
from imubayes.reporting.result.file import written
from imubayes.reporting.results import result_json


def read_result(path: Path) -> ResultFile:
    return sensors_of(written(path))


def test_values_are_those_that_were_written(make_study, make_sensor, tmp_path):
    result = make_study(make_sensor("A"), make_sensor("B"))
    (tmp_path / "result.json").write_text(result_json(result))
    read = read_result(tmp_path)
    assert read == read_result(tmp_path / "result.json")
    assert [one.id for one in read.components] == ["A", "B"] and read.file.study == result.study.title
    for term in result.sensors[0].selection.terms:
        found = read.components[0].terms[term.name]
        assert (found.full_mean, found.full_sd) == (term.full_mean, term.full_sd)
        assert (found.unit, found.printed_unit, found.verdict) == (term.unit, term.printed, term.verdict)
    for run in result.sensors[0].runs:
        for letter, value, sd in zip(
            "NBK", (run.noise.N, run.noise.B, run.noise.K), run.noise_sd, strict=True
        ):
            estimate = read.components[0].noise[run.name, letter]
            assert (estimate.value, estimate.log_sd) == (value, sd)


def test_sampled_noise_has_the_mean_and_sd_of_its_draws(make_study, make_sampled, tmp_path):
    result = make_study(make_sampled())
    (tmp_path / "result.json").write_text(result_json(result))
    (component,) = read_result(tmp_path).components
    posterior = json.loads(result_json(result))["sensors"][0]["noise_posterior"]
    for (run, letter), found in component.noise.items():
        said = posterior[run][letter]
        # a log-normal of this mean and log sd has the sd that the draws have
        assert found.value * math.sqrt(math.expm1(found.log_sd**2)) == pytest.approx(said["sd"], rel=1e-10)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{", "not JSON"),
        ("[1]", "lacks the key 'imubayes'"),
        ("{}", "lacks the key 'imubayes'"),
        (json.dumps({"imubayes": "1", "lots": []}), "another kind of study"),
        (
            json.dumps({"imubayes": "1", "sensors": ["A"]}),
            "study: the key .*imubayes 1 wrote it.* run",
        ),
    ],
)
def test_file_that_is_no_result_is_refused_with_the_reason(content, why, tmp_path):
    file = tmp_path / "other.json"
    file.write_text(content)
    with pytest.raises(DataError, match=why) as error:
        read_result(file)
    assert str(file) in str(error.value)


def test_folder_without_a_result_is_refused(tmp_path):
    with pytest.raises(DataError, match="there is no such file"):
        read_result(tmp_path)
    (tmp_path / "result.json").write_bytes(b"\xff\xfe")
    with pytest.raises(DataError, match="not JSON"):
        read_result(tmp_path)
