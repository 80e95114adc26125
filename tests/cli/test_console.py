"""Who waits is told what goes on."""

import time

from imubayes.cli.console import waiting


def test_long_work_says_what_it_does_and_what_would_be_quicker_where_stderr_is_a_file(capfd):
    with waiting(often=0.05) as told:
        told("ACC-07: noise")
        told.quicker('add --budget "30 s"')
        time.sleep(0.3)
    first, instead, *others = capfd.readouterr().err.splitlines()
    assert (first, instead) == ("imubayes: after 50 ms: ACC-07: noise", 'imubayes: add --budget "30 s"')
    assert 2 <= len(others) <= 5 and not any("--budget" in line for line in others)


def test_short_work_says_nothing_where_stderr_is_a_file(capfd):
    with waiting() as told:
        told("ACC-07: noise")
    assert capfd.readouterr().err == ""
