"""`imubayes export` as a person meets it."""

from __future__ import annotations

from imubayes.cli import ExportFormat
from imubayes.reporting.export import FORMATS


def test_the_command_line_offers_every_format():
    assert {one.value for one in ExportFormat} == set(FORMATS)


def test_a_wrong_result_ends_with_2_and_leaves_nothing(command, tmp_path):
    (tmp_path / "result.json").write_text("{}")
    ended = command("export", tmp_path / "result.json", "--to", "json", "--out", tmp_path / "out")
    assert ended.code == 2 and "is no result of 'imubayes run'" in ended.err
    assert not (tmp_path / "out").exists()
