"""The `[noise]` table of a study."""

import pytest

from imubayes.errors import StudyError
from imubayes.study.schema import read_study

STUDY = """
[[sensor]]
id = "A"
kind = "gyroscope"
class = "mems_consumer"
[[sensor.run]]
name = "quiet"
procedure = "static"
simulate = { duration = "60 s", rate = "10 Hz" }
"""


def read(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return read_study(path)


def test_quiet_logs_are_asked_for_every_process_unless_the_study_says_otherwise(tmp_path):
    assert read(tmp_path, STUDY).noise.identify == "static"
    asked = read(tmp_path, '[noise]\nidentify = "all"\ncandidates = ["B", "K"]\n' + STUDY).noise
    assert (asked.identify, asked.candidates) == ("all", ("B", "K"))


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ('identify = "some"', "noise.identify"),
        ('candidates = ["X"]', "noise.candidates"),
        ("process = 1", "unknown key"),
    ],
)
def test_what_the_table_cannot_say_is_refused_by_its_key(tmp_path, table, told):
    with pytest.raises(StudyError, match=told):
        read(tmp_path, f"[noise]\n{table}\n{STUDY}")
