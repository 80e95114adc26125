"""`imubayes export` as a person meets it."""

from __future__ import annotations

from exported_results import write_imu

from imubayes.cli import ExportFormat
from imubayes.reporting.export import FORMATS


def test_the_command_line_offers_every_format():
    assert {one.value for one in ExportFormat} == set(FORMATS)


def test_files_are_written_and_named(command, tmp_path):
    out = tmp_path / "flight"
    ended = command("export", write_imu(tmp_path), "--to", "c", "--out", out)
    assert ended.code == 0 and "u_1_compensation.h" in ended.out
    assert {file.name for file in out.iterdir()} == {
        f"u_1_compensation{precision}.{ending}" for precision in ("", "_f32") for ending in "ch"
    }


def test_a_wrong_result_ends_with_2_and_leaves_nothing(command, tmp_path):
    (tmp_path / "result.json").write_text("{}")
    ended = command("export", tmp_path / "result.json", "--to", "json", "--out", tmp_path / "out")
    assert ended.code == 2 and "is no result of 'imubayes run'" in ended.err
    assert not (tmp_path / "out").exists()
