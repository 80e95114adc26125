"""Pieces come back in order; processes that share the cores already take one thread each."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest
from numba.core import config

from imubayes.selection.spaces import pieces, threads


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("available", [1, 2, 4])
def test_pieces_come_back_in_their_order(monkeypatch, count, available):
    monkeypatch.setattr(config, "NUMBA_NUM_THREADS", available)
    assert pieces(lambda k: 10 * k, count) == [10 * k for k in range(count)]


def test_an_error_in_a_piece_is_raised(monkeypatch):
    monkeypatch.setattr(config, "NUMBA_NUM_THREADS", 2)
    with pytest.raises(ZeroDivisionError):
        pieces(lambda k: 1 // (k - 2), 4)


def test_a_process_of_a_pool_takes_one_thread(monkeypatch):
    monkeypatch.setattr(config, "NUMBA_NUM_THREADS", 2)
    assert threads() == 2
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(threads).result() == 1
