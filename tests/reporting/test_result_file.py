"""The published result: written and read by one adapter."""

import json
from pathlib import Path

import jsonschema
import pytest

from imubayes.errors import DataError
from imubayes.reporting.result.entries import SensorsResult
from imubayes.reporting.result.file import TAGS, adapter, read, result_schema, result_text, written

REPORTS = Path(__file__).parents[2] / "reports"
COMMITTED = [
    path.parent.name
    for path in sorted(REPORTS.glob("*/result.json"))
    if set(TAGS.values()) & json.loads(path.read_text(encoding="utf-8")).keys()
]


@pytest.mark.parametrize("report", COMMITTED)
def test_committed_result_is_written_as_it_was_read(report):
    text = (REPORTS / report / "result.json").read_text(encoding="utf-8")
    assert result_text(adapter().validate_python(json.loads(text))) == text


@pytest.fixture(scope="module")
def schema():
    found = result_schema()
    jsonschema.Draft202012Validator.check_schema(found)
    return found


@pytest.mark.parametrize(
    "report",
    ["quickstart", "imu_tactical", "fleet", "accelerometer_grades", "plan_tactical", "trade_mems_vs_fog"],
)
def test_committed_result_keeps_to_the_schema(report, schema):
    raw = json.loads((REPORTS / report / "result.json").read_text(encoding="utf-8"))
    (tag,) = set(TAGS.values()) & raw.keys()
    one = next(way for way in schema["oneOf"] if tag in schema["$defs"][way["$ref"][8:]]["properties"])
    jsonschema.Draft202012Validator({**schema, "oneOf": [one]}).validate(raw)


def _edited(edit):
    raw = json.loads((REPORTS / "quickstart" / "result.json").read_text(encoding="utf-8"))
    edit(raw)
    return json.dumps(raw).encode()


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (_edited(lambda raw: raw["sensors"][0].pop("terms")), r"sensors\[0\]\.terms: the key is missing"),
        (_edited(lambda raw: raw["sensors"][0]["terms"][2].update(mean="1")),
         r"sensors\[0\]\.terms\[2\]\.mean: expected a number or null, came '1'"),
        (_edited(lambda raw: raw["sensors"][0].update(kind="compass")),
         r"sensors\[0\]\.kind: expected 'accelerometer' or 'gyroscope', came 'compass'"),
        (b"{", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[1]", "lacks the key 'imubayes'"),
        (b"{}", "lacks the key 'imubayes'"),
        (b'{"imubayes": "1", "lots": []}', "another kind of study"),
        (b'{"imubayes": "1", "sensors": ["A"]}', "study: the key .*imubayes 1 wrote it.* run"),
        (None, "there is no such file"),
    ],
)  # fmt: skip
def test_file_that_is_no_result_is_refused_with_file_key_and_reason(content, why, tmp_path):
    if content is not None:
        (tmp_path / "result.json").write_bytes(content)
    with pytest.raises(DataError, match=why) as error:
        read(written(tmp_path), SensorsResult, "sensors")
    assert str(tmp_path / "result.json") in str(error.value)
