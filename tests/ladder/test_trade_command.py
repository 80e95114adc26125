import json

import pytest


@pytest.mark.slow
def test_the_command_writes_a_report_of_processes_of_their_own(command, study, tmp_path):
    options = {"--rungs": "means,plug-in", "--repeats": "6", "--limit": "10 min", "--out": tmp_path / "out"}
    ended = command("trade", study, *(str(part) for pair in options.items() for part in pair))
    assert ended.code == 0 and "Take " in ended.out
    values = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [one["rung"] for one in values["rungs"]] == ["means", "plug-in"]
    assert [one["repeats"] for one in values["scores"]] == [6, 6]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--rungs", "means,best"), "rung 'best' is not known"),
        (("--limit", "5 kg"), "--limit"),
        (("--only", "ACC-2"), "did you mean 'ACC-1'?"),
        (("--repeats", "-1"), "-1 repeats"),
    ],
)
def test_what_cannot_be_traded_is_said_and_nothing_is_written(command, study, tmp_path, options, said):
    out = tmp_path / "out"
    ended = command("trade", study, "--out", out, *options)
    assert ended.code == 2 and said in ended.err
    assert not out.exists()
