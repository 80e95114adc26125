"""Running, stopping and resuming of ensembles, on a density whose moments are known."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from imubayes.errors import InputError
from imubayes.inference.mcmc.ensembles import Limits, Target, run_ensembles

SD = np.array([1.0, 3.0, 0.1])


def target_of(*moves):
    def independent(coords, random):
        new = 1.2 * SD * random.standard_normal(coords.shape)
        quadratic = lambda x: -0.5 * np.sum((x / (1.2 * SD)) ** 2, axis=1)  # noqa: E731
        return new, quadratic(coords) - quadratic(new)

    return Target(
        names=("a", "b", "c"),
        log_prob=lambda x: -0.5 * np.sum((x / SD) ** 2, axis=1),
        moves=moves or ((independent, 0.7), (None, 0.3)),
        start=lambda rng, size: SD * rng.standard_normal((size, 3)),
        readable=lambda x: x,
    )


def test_ensembles_stop_by_themselves_with_the_right_moments():
    done = run_ensembles(target_of(), Limits(seed=1))
    assert done.found.converged
    assert done.found.ess.min() >= 1000.0
    assert done.found.rhat.max() < 1.01
    x = np.concatenate([chain.reshape(-1, 3) for chain in done.chains])
    error = SD / np.sqrt(done.found.ess)
    assert np.all(np.abs(x.mean(axis=0)) < 4.0 * error)
    np.testing.assert_allclose(x.std(axis=0) / SD, 1.0, atol=4.0 / np.sqrt(done.found.ess.min()))


def test_walkers_move_by_those_of_their_own_ensemble_alone():
    # those of each ensemble lie on an axis of their own, which differences of theirs do not leave
    def start(rng, size):
        return np.repeat(np.eye(4), size // 4, axis=0) * rng.uniform(-1.0, 1.0, (size, 1))

    flat = Target(
        names=("a", "b", "c", "d"),
        log_prob=lambda x: np.where(np.abs(x).max(axis=1) < 2.0, 0.0, -np.inf),
        moves=((None, 1.0),),
        start=start,
        readable=lambda x: x,
    )
    done = run_ensembles(flat, Limits(seed=1, steps=50))
    for k, chain in enumerate(done.chains):
        assert np.ptp(chain[:, :, k], axis=0).min() > 0.0
        assert not np.delete(chain, k, axis=2).any()


def test_resumed_chain_is_the_chain_that_was_not_interrupted(tmp_path):
    whole = run_ensembles(target_of(), Limits(seed=1, ess=20_000.0))
    file = tmp_path / "chains" / "a.h5"
    first = run_ensembles(target_of(), Limits(seed=1, checkpoint=file))
    assert len(first.chains[0]) < len(whole.chains[0])
    again = run_ensembles(target_of(), Limits(seed=1, ess=20_000.0, checkpoint=file, resume=True))
    for k in range(4):
        np.testing.assert_array_equal(again.chains[k], whole.chains[k])
    assert again.found.seconds > first.found.seconds
    assert [path.name for path in file.parent.iterdir()] == ["a.h5"]


def test_new_run_without_resume_starts_anew(tmp_path):
    limits = Limits(seed=1, checkpoint=tmp_path / "a.h5")
    first, second = (run_ensembles(target_of(), limits) for _ in range(2))
    np.testing.assert_array_equal(first.chains[0], second.chains[0])


@pytest.mark.parametrize("change", [{"fingerprint": "another"}, {"walkers": 40}, {"ensembles": 5}])
def test_checkpoint_of_another_problem_is_refused(tmp_path, change):
    limits = Limits(seed=1, checkpoint=tmp_path / "a.h5")
    run_ensembles(target_of(), limits)
    before = (tmp_path / "a.h5").read_bytes()
    with pytest.raises(InputError, match="another study, seed or method"):
        run_ensembles(target_of(), replace(limits, resume=True, **change))
    assert (tmp_path / "a.h5").read_bytes() == before


def test_missing_and_damaged_checkpoints_are_errors_that_name_the_file(tmp_path):
    file = tmp_path / "a.h5"
    with pytest.raises(InputError, match=r"a\.h5: there is no checkpoint to resume"):
        run_ensembles(target_of(), Limits(checkpoint=file, resume=True))
    file.write_bytes(b"not a chain")
    with pytest.raises(InputError, match=r"a\.h5: is not a checkpoint that can be read"):
        run_ensembles(target_of(), Limits(checkpoint=file, resume=True))


SCRIPT = """
import sys, time
sys.path.insert(0, sys.argv[1])
from dataclasses import replace
from pathlib import Path
from test_ensembles import target_of
from imubayes.inference.mcmc import ensembles
from imubayes.inference.mcmc.ensembles import Limits, run_ensembles
file = Path(sys.argv[2])
target = target_of()
slow = lambda x: (time.sleep(0.012), target.log_prob(x))[1]
ensembles.EVERY = 0.2
limits = Limits(seed=5, ess=float(sys.argv[3]), checkpoint=file, resume=file.exists())
run_ensembles(replace(target, log_prob=slow), limits)
"""


@pytest.mark.parametrize("wanted", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_again_and_again_the_chain_is_the_one_that_was_not(tmp_path, wanted):
    file, rng, ess = tmp_path / "a.h5", np.random.default_rng(8), 2_000.0 * wanted
    command = [sys.executable, "-c", SCRIPT, str(Path(__file__).parent), str(file), str(ess)]
    kills = 0
    while kills < wanted:
        process = subprocess.Popen(command)
        deadline = time.monotonic() + 60.0
        before = file.stat().st_mtime_ns if file.exists() else 0
        while time.monotonic() < deadline and process.poll() is None:
            # let it come to a checkpoint at least, then kill it at a random moment
            if file.exists() and file.stat().st_mtime_ns != before:
                time.sleep(float(rng.uniform(0.0, 0.4)))
                process.kill()
                break
            time.sleep(0.005)
        assert process.wait() in (0, -9)
        if process.returncode == 0:
            break
        kills += 1
        with h5py.File(file) as readable:
            assert {len(group["chain"]) for group in readable.values()} == {len(readable["ensemble_0/chain"])}
    subprocess.run(command, check=True, timeout=120)
    assert kills == wanted
    whole = run_ensembles(target_of(), Limits(seed=5, ess=ess))
    with h5py.File(file) as readable:
        steps = len(whole.chains[0])
        for k in range(4):
            np.testing.assert_array_equal(readable[f"ensemble_{k}/chain"][-steps:], whole.chains[k])


def test_walkers_that_stand_still_are_stopped_with_the_reason():
    def astray(coords, random):
        return 100.0 + random.standard_normal(coords.shape), np.zeros(len(coords))

    done = run_ensembles(target_of((astray, 1.0)), Limits(seed=1, time_limit=600.0))
    assert not done.found.converged and done.found.seconds < 60.0
    assert "the walkers stand still: 0.0% of the proposals are accepted" in done.found.text


def test_steps_that_are_long_end_with_the_time_and_are_those_of_a_longer_chain():
    whole, target = run_ensembles(target_of(), Limits(seed=1, steps=50)), target_of()

    def slowly(coords):
        time.sleep(0.02)
        return target.log_prob(coords)

    cut = run_ensembles(replace(target, log_prob=slowly), Limits(seed=1, time_limit=0.2))
    steps = len(cut.chains[0])
    assert 4 <= steps < 20 and not cut.found.converged
    # a tenth of a chain is dropped at its start: of 50 steps 5, of those of less than 20 one at most
    one = int(0.1 * (steps + int(0.1 * (steps + 1))))
    np.testing.assert_array_equal(cut.chains[0][5 - one :], whole.chains[0][: steps - 5 + one])


def test_chains_far_too_slow_for_their_time_are_stopped_with_the_reason():
    done = run_ensembles(target_of(), Limits(seed=1, ess=1e9, time_limit=4.0))
    assert not done.found.converged and 1.0 < done.found.seconds < 3.0
    assert "more than four times the limit of 4 s" in done.found.text
