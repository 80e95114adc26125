"""Who waits is told what goes on."""

import time

from imubayes.cli.console import waiting


def test_long_work_says_what_it_does_and_what_would_be_quicker_where_stderr_is_a_file(capfd):
    with waiting(often=0.05) as told:
        told("ACC-07: noise")
        told.quicker('--budget "30 s" would answer')
        time.sleep(0.3)
    lines = capfd.readouterr().err.splitlines()
    assert lines[0] == 'imubayes: after 50 ms: ACC-07: noise; --budget "30 s" would answer'
    assert 3 <= len(lines) <= 6


def test_short_work_says_nothing_where_stderr_is_a_file(capfd):
    with waiting() as told:
        told("ACC-07: noise")
    assert capfd.readouterr().err == ""
