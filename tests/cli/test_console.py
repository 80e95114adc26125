"""Who waits is told what goes on."""

import io
import re
import sys
import time
from threading import active_count

import pytest

from imubayes.cli.console import CLEAR, Waiting, complete, waiting
from imubayes.errors import InputError
from imubayes.work import part_of


def test_long_work_says_what_it_does_and_what_would_be_quicker_where_stderr_is_a_file(monkeypatch):
    # what is captured loses a line that is written while it is read
    monkeypatch.setattr(sys, "stderr", file := io.StringIO())
    late = time.monotonic() + 30.0
    with waiting(often=0.05) as told:
        told("ACC-07: noise")
        told.quicker('add --budget "30 s"')
        while file.getvalue().count("\n") < 4 and time.monotonic() < late:
            time.sleep(0.05)
    first, instead, *others = file.getvalue().splitlines()
    assert re.fullmatch(r"imubayes: after [\d.]+ m?s: ACC-07: noise", first)
    assert instead == 'imubayes: add --budget "30 s"'
    assert 2 <= len(others) <= 5
    assert not any("--budget" in line for line in others)


def test_short_work_says_nothing_where_stderr_is_a_file(capfd):
    with waiting() as told:
        told("ACC-07: noise")
    assert capfd.readouterr().err == ""


def test_who_waits_is_told_by_a_thread_of_which_there_is_none_before_something_is_told():
    """A process with one thread can be forked."""
    before = active_count()
    with waiting() as told:
        assert active_count() == before
        told("ACC-07: noise")
        told("ACC-07: chains")
        assert active_count() == before + 1
    assert active_count() == before


def test_counted_work_shows_a_bar_and_what_is_left_of_it_from_where_the_count_began():
    told = Waiting()
    told.start -= 100.0
    told("reading")
    told("units", 0.0)
    told.since -= 30.0
    told("units", 0.25)
    assert told.line() == "after 100 s: [#####---------------] 25%, about 90 s left; units"
    told("units", 1e-7)
    assert told.line() == "after 100 s: units"  # not a million hours
    told("of another kind", 0.1)
    assert told.since > told.start + 99.0  # the count began anew
    told("the end of it", 1.0)
    assert told.line() == "after 100 s: [####################] 100%, less than 1 s left; the end of it"


def test_a_terminal_sees_the_line_grow_older_while_nothing_is_told(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("imubayes.cli.console.BLINK", 0.02)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    with waiting() as told:
        told("half of it", 0.5)
        time.sleep(0.2)
    seen = terminal.getvalue().split(CLEAR)
    assert len([line for line in seen if "] 50%, less than 1 s left; half of it" in line]) > 3
    assert seen[-1] == ""


def test_work_in_parts_tells_the_share_of_the_whole():
    told = []
    tell = part_of(lambda *said: told.append(said), 2, 4, "C: ")
    tell("noise")
    tell("chains", 0.5)
    part_of(lambda *said: told.append(said), 0, 1)("noise")
    assert told == [("C: noise", 0.5), ("C: chains", 0.625), ("noise", None)]


def test_pages_of_an_earlier_report_go_with_it_and_nothing_else_does(tmp_path):
    def write(*pages):
        with complete(tmp_path / "out") as part:
            links = "".join(f'<a href="{name}">' for name in pages)
            for name, text in {"report.html": links, **dict.fromkeys(pages, "page")}.items():
                (part / name).write_text(text, encoding="utf-8")

    write("1-a.html", "2-b.html")
    for other in ("3-mine.html", "notes.txt"):
        (tmp_path / "out" / other).touch()
    write("1-b.html", "2-b.html")
    found = {file.name for file in (tmp_path / "out").iterdir()}
    assert found == {"report.html", "1-b.html", "2-b.html", "3-mine.html", "notes.txt"}
    with pytest.raises(InputError), complete(tmp_path / "out"):
        raise OSError("no room")
    assert {file.name for file in (tmp_path / "out").iterdir()} == found
