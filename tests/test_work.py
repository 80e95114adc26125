import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from imubayes import work
from imubayes.work import ONE_THREAD, Lost, as_done, beside, shared


def killed(number: int, victims: tuple[int, ...], log: str, once: bool) -> int:
    """Square a number; the process of a victim is killed, always or only the first time."""
    with Path(log).open("a") as stream:
        stream.write(f"{number}\n")
    if number in victims and not (once and _tries(log, number) > 1):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)  # a pool that is never without results does not see that a process has died
    return number * number


def _tries(log: str, number: int) -> int:
    return Path(log).read_text().split().count(str(number))


def whoami(number: int) -> tuple[int, int, int]:
    """Number, process, and the threads that linear algebra has there."""
    import scipy.linalg  # noqa: F401  # loads its own library
    from threadpoolctl import threadpool_info

    threads = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
    return number, os.getpid(), max(threads)


def test_results_come_in_the_order_of_the_jobs_from_other_processes_of_one_thread(monkeypatch):
    """Even where a library is loaded after the process has begun; two cores are needed to see it."""
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    told: list[tuple] = []
    jobs = [(k,) for k in range(5)]
    found = shared(whoami, jobs, 2, things="numbers", progress=lambda *said: told.append(said))
    assert [number for number, _, _ in found] == list(range(5))
    assert os.getpid() not in {process for _, process, _ in found}
    assert {threads for _, _, threads in found} == {1}
    assert told[-1] == ("5 of 5 numbers", 1.0)


def test_job_whose_process_is_killed_is_done_again_and_one_that_ends_it_twice_is_lost(tmp_path):
    log, n = str(tmp_path / "log"), 20
    found = dict(as_done(killed, [(k, (2, 15), log, k == 15) for k in range(n)], 2))
    assert found == {k: Lost() if k == 2 else k * k for k in range(n)}
    # two processes have two jobs each, done or waiting, when either is killed
    assert sum(_tries(log, k) - 1 for k in range(n)) <= 2 * 4
    assert _tries(log, 2) == _tries(log, 15) == 2


def test_processes_that_all_end_at_once_are_an_error_and_no_endless_loop(tmp_path, monkeypatch):
    monkeypatch.setattr(work, "HOPELESS", 2)
    log = str(tmp_path / "log")
    with pytest.raises(ChildProcessError, match="as soon as they start"):
        list(as_done(killed, [(k, (0, 1, 2, 3, 4, 5), log, False) for k in range(6)], 2))


def test_error_of_a_job_is_that_of_the_whole():
    with pytest.raises(ZeroDivisionError):
        shared(divmod, [(1, 1), (1, 0)], 2, things="divisions")


def dies_elsewhere(parent: int) -> int:
    """Give this process, if it is the parent; any other is killed."""
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return parent


@pytest.mark.parametrize("cores", [1, 2])
def test_job_beside_is_done_elsewhere_on_two_cores_and_where_that_ends_or_on_one_here(monkeypatch, cores):
    monkeypatch.setattr(work, "cores", lambda: cores)
    own = os.getpid()
    with beside() as begin:
        first, fails, wrong = begin(whoami, 1), begin(dies_elsewhere, own), begin(divmod, 1, 0)
        assert (first()[1] == own) == (cores == 1)
        assert fails() == own
        with pytest.raises(ZeroDivisionError):
            wrong()
        assert begin(whoami, 2)()[0] == 2


def endless(folder: str, number: int) -> None:
    """Say who works, and go on for much longer than the test waits."""
    (Path(folder) / f"{number}.pid").write_text(str(os.getpid()))
    time.sleep(120.0)


seen: list[str] = []
"""What has happened in this process, or in that which it is a fork of."""


def history() -> list[str]:
    return seen


PARTED = """
import sys
from threading import Event, Thread
import test_work
from imubayes import work

if __name__ == "__main__":
    work.cores = lambda: 2
    test_work.seen.append("loaded")
    if sys.argv[1] == "2":
        Thread(target=Event().wait, daemon=True).start()
    with work.beside() as begin:
        print(*begin(test_work.history)(), flush=True)
"""


@pytest.mark.skipif(not work.THREADS.exists(), reason="only Linux tells of all threads of a process")
@pytest.mark.parametrize(("threads", "has"), [("1", ["loaded"]), ("2", [])])
def test_process_beside_has_what_is_loaded_unless_a_thread_might_hold_a_lock_of_it(threads, has, tmp_path):
    parent = _started(tmp_path, PARTED, threads, stdout=subprocess.PIPE, text=True)
    assert parent.communicate(timeout=60.0)[0].split() == has


def two_endless(folder: str, forked: bool) -> None:
    """Have two jobs that do not end: in two processes, or here and in a fork of this one."""
    if not forked:
        shared(endless, [(folder, 0), (folder, 1)], 2, things="jobs")
        return
    work.cores = lambda: 2
    with beside() as begin:
        begin(endless, folder, 0)
        endless(folder, 1)


PARENT = """
from test_work import two_endless

if __name__ == "__main__":
    two_endless({folder!r}, {forked})
"""


def _started(folder: Path, program: str, *arguments: str, **options) -> subprocess.Popen:
    """Start a program that shares out jobs of this module."""
    script = folder / "parent.py"
    script.write_text(program)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(Path(__file__).parent), *sys.path))}
    return subprocess.Popen([sys.executable, str(script), *arguments], env=environment, **options)


def _lives(process: int) -> bool:
    try:
        # a zombie that nobody has waited for yet does not work any more
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads the state of processes from /proc")
@pytest.mark.parametrize("forked", [False, True])
def test_processes_end_with_a_parent_that_is_killed_in_mid_job(forked, tmp_path):
    parent = _started(tmp_path, PARENT.format(folder=str(tmp_path), forked=forked))
    workers = [int(_written(tmp_path / f"{number}.pid")) for number in range(2)]
    workers = [worker for worker in workers if worker != parent.pid]
    assert all(_lives(worker) for worker in workers)
    parent.kill()
    parent.wait()
    _until(lambda: not any(_lives(worker) for worker in workers))


INTERRUPTED = """
import signal
import sys
import time
from pathlib import Path

from test_work import two_endless

if __name__ == "__mp_main__" and {starting}:
    Path({folder!r}, "starts.pid").write_text("1")
    time.sleep(2.0)

if __name__ == "__main__":
    # in a shell's background job interrupts are ignored from the start
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        two_endless({folder!r}, {forked})
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="a terminal interrupts a group of processes")
@pytest.mark.parametrize(("when", "forked"), [("starts", False), ("1", False), ("0", True)])
def test_interrupt_is_the_parents_alone_whether_processes_start_or_work(tmp_path, when, forked):
    script = INTERRUPTED.format(folder=str(tmp_path), starting=when == "starts", forked=forked)
    parent = _started(tmp_path, script, stderr=subprocess.PIPE, text=True, start_new_session=True)
    _written(tmp_path / f"{when}.pid")
    os.killpg(parent.pid, signal.SIGINT)
    # the jobs in flight take two minutes: nobody waits for them
    _, said = parent.communicate(timeout=60.0)
    assert (parent.returncode, said) == (130, "")


def _written(file: Path) -> str:
    _until(lambda: file.exists() and file.read_text())
    return file.read_text()


def _until(holds) -> None:
    end = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < end, "waited for a minute"
        time.sleep(0.05)
