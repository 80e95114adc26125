import subprocess
import sys

import pytest

from imubayes.ladder.trade.memory import STATUS

ALONE = """
import numpy as np
from imubayes.ladder.trade.memory import with_peak

with_peak(lambda: np.ones(25_000_000).sum())  # a larger peak before does not count
print(*with_peak(lambda: float(np.ones(8_000_000).sum())))
"""
"""In a process of its own: what other tests left is given back at any time."""


@pytest.mark.skipif(not STATUS.exists(), reason="needs /proc")
def test_the_peak_is_what_an_array_takes_though_it_is_freed():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
    found, taken = map(float, done.stdout.split())
    assert found == 8e6
    assert 60e6 < taken < 80e6
