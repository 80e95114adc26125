"""Stills of a simulated hand tumble, whose true ends are known."""

from dataclasses import replace

import numpy as np
import pytest

from imubayes.errors import UnobservableError
from imubayes.inference.stills import WINDOW, find_stills, with_stills
from imubayes.rig.inputs import Inputs, Run
from imubayes.sensors.noise import Noise

QUIET = Noise(6e-4, 1e-4, 0.0)


def assert_found(tumble):
    """Every hold is found once, within it, and no more than half a window shorter at either end."""
    found = find_stills(tumble.run)
    assert len(found) == len(tumble.held)
    for (a, b), (start, stop) in zip(found, tumble.held, strict=True):
        assert start <= a < b <= stop
        assert a - start <= 0.5 * WINDOW / tumble.run.interval + 1
        assert stop - b <= 0.5 * WINDOW / tumble.run.interval + 1


@pytest.mark.parametrize(
    ("hold", "loud", "seed"), [(2.5, 1.0, 1), (8.0, 1.0, 1), (3.0, 0.1, 3), (3.0, 10.0, 5)]
)
def test_stills_of_any_hand_are_found_whatever_the_noise(hand_tumble, hold, loud, seed):
    assert_found(hand_tumble(hold=hold, noise=Noise(loud * QUIET.N, loud * QUIET.B, 0.0), seed=seed))


def test_a_slow_turn_about_gravity_is_no_rest_where_gyroscopes_see_it(hand_tumble):
    """The force stays what it was: only the rates tell."""
    tumble = hand_tumble(hold=8.0)
    run, (start, stop) = tumble.run, tumble.held[3]
    rng = np.random.default_rng(1)
    rate = 5e-3 * rng.normal(size=run.output.shape)
    for a, b in zip(
        [0, *(b for _, b in tumble.held)], [*(a for a, _ in tumble.held), len(run.t)], strict=True
    ):
        rate[a:b] += 1.0
    middle = (start + stop) // 2
    rate[middle:stop, 2] += 0.05 * np.sin(2.0 * np.pi * run.t[middle:stop])
    assert_found(tumble)
    found = find_stills(replace(run, output=np.hstack((run.output, rate))))
    assert len(found) == len(tumble.held)
    # a window that holds a part of the swing is no rest, and half a window is trimmed before it
    assert found[3][1] <= middle + 0.5 * WINDOW / run.interval
    others = [k for k in range(len(found)) if k != 3]
    usual = find_stills(run)
    assert all(abs(found[k][1] - usual[k][1]) * run.interval <= 0.5 * WINDOW for k in others)


@pytest.mark.parametrize(("tremor", "swing"), [(0.01, 0.003), (0.02, 0.01), (0.1, 0.03)])
def test_stills_in_the_hand_are_found_after_a_long_rest_on_the_table(hand_tumble, tremor, swing):
    """A trembling hand is far from the table's rest, and as far from motion."""
    tumble = hand_tumble(stills=12)
    rng = np.random.default_rng(3)
    n, (_, table) = len(tumble.run.t), tumble.held[0]
    shaken = np.linalg.norm(np.diff(tumble.run.output, axis=0, prepend=tumble.run.output[:1]), axis=1) > 0.05
    rate = 1.0 * shaken[:, None] * np.ones(3) + 1e-3 * rng.standard_normal((n, 3))
    free = np.arange(n)[:, None] >= table
    level = np.exp(0.3 * rng.standard_normal(12))
    free = free * np.repeat(level, np.diff([0, *(stop for _, stop in tumble.held[:-1]), n]))[:, None]
    force = tumble.run.output + tremor * free * rng.standard_normal((n, 3))
    rate += swing * free * rng.standard_normal((n, 3))
    long = np.tile(np.arange(table), 10)  # the first position is a minute on the table
    order = np.concatenate((long, np.arange(n)))
    run = replace(
        tumble.run,
        inputs=Inputs(tumble.run.interval * np.arange(len(order)), {}, tumble.run.interval),
        output=np.hstack((force, rate))[order],
    )
    found = find_stills(run)
    assert len(found) == len(tumble.held)
    for (_, b), (_, stop) in zip(found, tumble.held, strict=True):
        assert abs(b - len(long) - stop) * run.interval <= 0.5 * WINDOW + 0.1


def test_stills_are_listed_with_what_was_none_and_set_by_the_study(hand_tumble):
    tumble = hand_tumble(stills=12, hold=2.5)
    start, stop = tumble.held[4]
    shaken = tumble.run.output.copy()
    middle = (start + stop) // 2
    shaken[middle - 2 : middle + 2] += 3.0  # halves of 1.25 s, trimmed to less than 1 s
    run = with_stills(replace(tumble.run, output=shaken), WINDOW, 0.0)
    assert len(run.stills) == 11 and run.source.notes[0].startswith("stills: 11 where the force varies")
    assert run.source.notes[1].startswith("no stills, because shorter than 1 s: ")
    narrow = with_stills(replace(tumble.run, output=shaken), 0.2, 0.05)
    assert len(narrow.stills) == 13 and "less than 0.05 m/s^2 within 0.2 s" in narrow.source.notes[0]


def test_coarse_counts_that_do_not_change_at_rest_are_rest(hand_tumble):
    tumble = hand_tumble()
    coarse = 0.05 * np.rint(tumble.run.output / 0.05)  # 8 sd of the noise
    run = replace(tumble.run, output=coarse)
    assert_found(tumble._replace(run=run))


def test_scale_offset_and_rotation_of_the_output_change_no_still(hand_tumble):
    run = hand_tumble().run
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    counts = replace(run, output=400.0 * run.output @ turn + 32768.0)
    assert find_stills(counts) == find_stills(run)


@pytest.mark.parametrize(
    ("force", "said"),
    [
        pytest.param(np.ones((250, 3)), "too short", id="too short"),
        pytest.param(
            9.81 * np.random.default_rng(1).normal(size=(6000, 3)), "no stills that differ", id="in motion"
        ),
        pytest.param(
            9.81 + 1e-3 * np.random.default_rng(1).normal(size=(6000, 3)),
            "no stills that differ",
            id="at rest",
        ),
        pytest.param(np.full((6000, 3), 9.81), "no stills that differ", id="constant"),
    ],
)
def test_a_record_that_lacks_rest_or_motion_is_refused(force, said):
    run = Run("a", "free-tumble", Inputs(0.01 * np.arange(len(force)), {}, 0.01), force, gravity=9.81)
    with pytest.raises(UnobservableError, match=said):
        find_stills(run)


def test_stills_of_less_than_a_second_are_refused(hand_tumble):
    with pytest.raises(UnobservableError, match="hold each position for longer"):
        find_stills(hand_tumble(hold=1.5).run)
