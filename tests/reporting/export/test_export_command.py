"""`imubayes export` as a person meets it."""

from __future__ import annotations

import sys

import pytest
from exported_results import write_imu

from imubayes.cli import ExportFormat, main
from imubayes.reporting.export import FORMATS


def run(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["imubayes", "export", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_the_command_line_offers_every_format():
    assert {one.value for one in ExportFormat} == set(FORMATS)


def test_files_are_written_and_named(tmp_path, monkeypatch, capsys):
    out = tmp_path / "flight"
    assert run(monkeypatch, write_imu(tmp_path), "--to", "c", "--out", out) == 0
    assert {file.name for file in out.iterdir()} == {
        f"u_1_compensation{precision}.{ending}" for precision in ("", "_f32") for ending in "ch"
    }
    assert "u_1_compensation.h" in capsys.readouterr().out


def test_a_wrong_result_ends_with_2_and_leaves_nothing(tmp_path, monkeypatch, capsys):
    (tmp_path / "result.json").write_text("{}")
    assert run(monkeypatch, tmp_path / "result.json", "--to", "json", "--out", tmp_path / "out") == 2
    assert "is no result of 'imubayes run'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
