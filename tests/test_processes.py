import os

from imubayes.processes import shared


def whoami(number: int) -> tuple[int, int]:
    return number, os.getpid()


def test_results_come_in_the_order_of_the_jobs_from_other_processes():
    told: list[str] = []
    jobs = [(k,) for k in range(5)]
    found = shared(whoami, jobs, 2, things="numbers", progress=told.append)
    assert [number for number, _ in found] == list(range(5))
    assert os.getpid() not in {process for _, process in found}
    assert told[-1] == "5 of 5 numbers, about 0 min left"


def test_one_process_is_this_one():
    assert shared(whoami, [(7,)], 1, things="numbers") == [(7, os.getpid())]
