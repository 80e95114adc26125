import gc

import numpy as np
import pytest

from imubayes.ladder.trade.memory import STATUS, with_peak

MB = 1e6


@pytest.mark.skipif(not STATUS.exists(), reason="needs /proc")
def test_the_peak_is_what_an_array_takes_though_it_is_freed():
    def work() -> float:
        return float(np.ones(int(64 * MB / 8)).sum())

    gc.collect()  # what other tests left is not given back while this one measures
    with_peak(lambda: np.ones(int(200 * MB / 8)).sum())  # a larger peak before does not count
    found, taken = with_peak(work)
    assert found == 64 * MB / 8
    assert 60 * MB < taken < 80 * MB
