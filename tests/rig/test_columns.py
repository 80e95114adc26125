"""A clock that wraps around tells the time of one that does not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_files import csv_of

from imubayes.errors import DataError
from imubayes.rig import streams
from imubayes.rig.columns import ColumnSpec, resolve, unwrapped
from imubayes.rig.formats import FileTable
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_imu_run, read_run
from imubayes.scenes import read_scene


def _unwrapped(raw: np.ndarray, wraps: float):
    table = FileTable("clock.npz", ("t [count]",), (raw,), ordered=False)
    specs = {"t": ColumnSpec(scale=1.0, wraps=wraps)}
    column = resolve(table, specs, required=("t",), optional=(), output_unit="m/s^2")["t"]
    return unwrapped(table, column)


@given(
    st.sampled_from([np.uint8, np.uint16, np.int16, np.uint32, np.int32]),
    st.integers(0, 2**31),
    st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=60),
)
def test_counter_that_overflows_counts_on_exactly(sort, start, steps):
    wraps = 2 ** (8 * np.dtype(sort).itemsize)
    whole = start + np.cumsum([0, *(step % wraps for step in steps)], dtype=np.int64)
    column, turns = _unwrapped(whole.astype(sort), float(wraps))
    # a cast to the shorter type is the overflow itself; what it kept of the start is where the clock starts
    offset = int(whole[0]) - int(whole[:1].astype(sort)[0])
    np.testing.assert_array_equal(column.raw, whole - offset)
    low = np.iinfo(sort).min
    assert turns == (int(whole[-1]) - offset - low) // wraps


@given(st.floats(0.01, 59.9), st.integers(2, 300))
def test_seconds_of_the_minute_become_time(step, n):
    time = step * np.arange(n)
    column, turns = _unwrapped(np.mod(time, 60.0), 60.0)
    # a last bit of the time may fall to either side of a wrap, where the second of the minute is 0 or 60
    np.testing.assert_allclose(column.raw, time, rtol=1e-13, atol=1e-10)
    assert turns == pytest.approx(time[-1] // 60.0, abs=1)


def test_wraps_are_noted_and_the_time_is_strictly_increasing(tmp_path):
    ticks = 4294000000 + 64000 * np.arange(200000, dtype=np.int64)
    np.savez(tmp_path / "run.npz", ticks=ticks.astype(np.uint32), output=np.sin(np.arange(200000.0)))
    columns = {
        "t": ColumnSpec("ticks", "count", scale=1.0 / 64e6, wraps=2.0**32),
        "output": ColumnSpec("output", "m/s^2"),
    }
    run = read_run(RunSpec("log", "static", tmp_path / "run.npz", columns=columns), "accelerometer")
    np.testing.assert_array_equal(run.inputs.t, ticks * (1.0 / 64e6))
    assert "the clock wrapped around 3 times" in run.source.notes


def table_of(folder, *names):
    rows = np.random.default_rng(1).standard_normal((200, len(names)))
    rows[:, 0] = np.arange(200)
    return csv_of(folder, ",".join(names), rows)


def a_run(path, **said):
    return read_run(RunSpec("a", "tumble", path, "a.csv", **said), "accelerometer")


def an_imu(path, **said):
    return read_imu_run(RunSpec("a", "tumble", path, "a.csv", **said))


OUTPUT = ("t [s]", "f_i [m/s^2]", "output [m/s^2]")
CASE = ("t [s]", "f_x [m/s^2]", *(f"a{c} [g]" for c in "xyz"), *(f"g{c} [deg/s]" for c in "xyz"))


@pytest.mark.parametrize(
    ("reader", "names", "strange", "meant", "held"),
    [
        (a_run, OUTPUT, "f_q [m/s^2]", "f_j", 1000),
        (a_run, OUTPUT, "F_K [m/s^2]", "f_k", 1000),
        (a_run, OUTPUT, "omega_j [deg/s]", "w_j", 1000),
        (a_run, OUTPUT, "dw_ii [deg/s^2]", "dw_i", 1000),
        (a_run, OUTPUT, "mounts", "mount", 1000),
        (a_run, OUTPUT, "f_q [m/s^2]", "f_j", 100),
        (an_imu, CASE, "f_u [m/s^2]", "f_y", 1000),
        (read_scene, OUTPUT[:2], "f_q [m/s^2]", "f_j", 1000),
    ],
)
def test_column_that_is_nearly_a_missing_channel_is_refused_until_the_study_says_what_it_is(
    reader, names, strange, meant, held, tmp_path, monkeypatch
):
    monkeypatch.setattr(streams, "STREAMED", held)
    path = table_of(tmp_path, *names, strange)
    bare = strange.partition(" ")[0]
    with pytest.raises(DataError, match=rf"column '{bare}.*did you mean '{meant}'.*ignore = \[\"{bare}"):
        reader(path)
    reader(path, ignore=(bare,))
    reader(path, ignore=(strange,))
    if meant != "mount":
        reader(path, columns={meant: ColumnSpec(strange)})


def test_a_column_that_measures_something_else_is_meant_for_no_channel(tmp_path):
    for column in ("f_s [Hz]", "f_0 [K]"):
        assert a_run(table_of(tmp_path, *OUTPUT, column)).inputs.channels.keys() == {"f_i"}
    for column in ("f_q [count]", "f_q [V]"):
        with pytest.raises(DataError, match="did you mean 'f_j'"):
            a_run(table_of(tmp_path, *OUTPUT, column))
