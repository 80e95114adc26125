"""Fleets on the command line."""

import json

from fleet_studies import STUDY, recorded

FILES = ["report.html", "result.json", "slide.png", "slide.svg", "units"]
SMALL = STUDY.replace('units = "units/*"\npart = 3', "units = 5\nprocesses = 1").replace(
    'file = "tumble.csv"', 'simulate = { angles = 6, planes = 1, dwell = "4 s", rate = "1 Hz" }'
)


def test_one_unit_that_cannot_be_read_is_named_and_the_exit_code_is_0(command, tmp_path):
    study = recorded(tmp_path)
    (tmp_path / "units" / "A2" / "tumble.csv").write_text("t [s],output [m/s^2]\n0,rubbish\n")
    study.path.write_text(study.text.replace("part = 3", "part = 3\nprocesses = 1"))
    out = tmp_path / "out"
    ended = command("run", study.path, "--out", out)
    assert ended.code == 0 and "1 unit of 5 could not be read: A2: " in ended.words
    (broken,) = json.loads((out / "result.json").read_text())["fleet"]["broken"]
    assert (broken["name"], "A2/tumble.csv" in broken["error"]) == ("A2", True)
    assert sorted(file.name for file in out.iterdir() if not file.name[0].isdigit()) == FILES


def test_interrupt_is_said_in_one_line_and_resume_goes_on(command, tmp_path, monkeypatch):
    path, out, done = tmp_path / "fleet.toml", tmp_path / "out", list[str]()
    path.write_text(SMALL.replace("units = 5", "units = 5\npart = 2"))

    def once(self, doing, share=None, /):
        if share is not None and " units" in doing:
            done.append(doing)
            if len(done) == 1:
                raise KeyboardInterrupt

    monkeypatch.setattr("imubayes.cli.console.Waiting.__call__", once)
    message = "imubayes: interrupted: the same command with --resume goes on, and keeps what is finished\n"
    assert command("run", path, "--out", out) == (130, "", message)
    assert [file.name for file in out.iterdir()] == ["units.part"]
    ended = command("run", path, "--out", out, "--resume")
    assert ended.code == 0 and "2 units were there already" in ended.words
    assert sorted(file.name for file in out.iterdir() if not file.name[0].isdigit()) == FILES
