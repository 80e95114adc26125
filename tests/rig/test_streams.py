"""Files read a part at a time against the same files read as a whole."""

import pickle

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv
from pyarrow import parquet as pq

from imubayes.errors import DataError
from imubayes.inference.linear import linear_of, reach_of, swing_of
from imubayes.rig import formats, streams, texts
from imubayes.rig.checks import SATURATED
from imubayes.rig.columns import ColumnSpec
from imubayes.rig.inputs import RunSection, durations, joined_parts
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.sensors.terms import columns, library

N, INTERVAL, TABLE = 20_000, 0.01, 700
LIB = library("accelerometer")


@pytest.fixture(autouse=True)
def small_tables(monkeypatch):
    """Let files of a few thousand rows be long ones."""
    monkeypatch.setattr(streams, "STREAMED", 1000)
    monkeypatch.setattr(formats, "ROWS", TABLE)
    monkeypatch.setattr(texts, "TEXT_BLOCK", 1 << 16)


def recording(n=N):
    """Columns of a run with a long and a short gap, and two inputs."""
    rng = np.random.default_rng(5)
    t = 3.0 + INTERVAL * np.arange(n)
    t[n // 3 :] += 100.0
    t[n // 2 :] += 0.03
    f = 9.8 * np.cos(0.3 * np.floor(t))
    w = rng.normal(size=n)
    return {
        "t [s]": t,
        "f_i [g]": f / 9.80665,
        "w_i [deg/s]": w,
        "output [m/s^2]": f + 1e-3 * rng.normal(size=n),
    }


def parquet(table, folder):
    pq.write_table(pa.table(table), folder / "run.parquet", row_group_size=3000)
    return folder / "run.parquet"


def text(table, folder):
    csv.write_csv(pa.table(table), folder / "run.csv")
    return folder / "run.csv"


def hdf5(table, folder):
    with h5py.File(folder / "run.h5", "w") as file:
        for label, values in table.items():
            name, _, unit = label.partition(" [")
            file.create_dataset(f"log/{name}", data=values).attrs["unit"] = unit.rstrip("]")
    return folder / "run.h5"


FORMATS = {"parquet": parquet, "text": text, "hdf5": hdf5}


def both(path, specs=None, read=read_run):
    """A run as a whole, and a part at a time."""
    spec = RunSpec("r", "other", file=path, shown="run", columns=specs or {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(streams, "STREAMED", 10**9)
        whole = read(spec, "accelerometer")
    return whole, read(spec, "accelerometer")


def joined(run):
    """All rows of a stream: time, averaging time, output, channels."""
    parts = list(run.stream.parts("reading"))
    assert len(parts) > 3
    rows = joined_parts(parts)
    return rows.t, rows.inputs.durations, rows.output, rows.inputs.channels


def refused(spec, kind):
    with pytest.raises(DataError) as raised:
        read_run(spec, kind)
    return str(raised.value)


@pytest.mark.parametrize("form", FORMATS)
def test_the_parts_of_a_file_are_the_rows_of_the_whole(form, tmp_path):
    whole, run = both(FORMATS[form](recording(), tmp_path))
    t, lasting, output, channels = joined(run)
    assert run.samples == N == len(whole.inputs)
    assert np.array_equal(t, whole.inputs.t)
    assert np.array_equal(output, whole.output)
    assert channels.keys() == whole.inputs.channels.keys()
    assert all(np.array_equal(channels[name], whole.inputs.channels[name]) for name in channels)
    # the median step of the first table and that of all rows differ by the rounding of the time stamps
    assert np.allclose(lasting, durations(whole.inputs.t, whole.inputs.interval), rtol=1e-9, atol=0.0)
    assert whole.source.notes == run.source.notes[:-1]


@pytest.mark.parametrize("form", FORMATS)
def test_averages_are_those_of_the_rows_and_never_reach_across_a_long_gap(form, tmp_path):
    whole, run = both(FORMATS[form](recording(), tmp_path))
    stream = run.stream
    first = np.cumsum(stream.counts) - stream.counts
    X = columns(LIB, whole.inputs.channels, N)
    assert stream.counts.sum() == N
    assert N // 3 in first
    size = np.abs(X).max(axis=0)
    rows = linear_of(run, LIB)
    off = np.add.reduceat(X, first, axis=0) / stream.counts[:, None] - rows.X
    assert np.all(np.abs(off) <= 1e-13 * size)
    assert np.array_equal(reach_of(rows), size)
    assert run.inputs.t == pytest.approx(np.add.reduceat(whole.inputs.t, first) / stream.counts, rel=1e-14)
    assert swing_of(run, LIB) == pytest.approx(
        np.abs(whole.output - whole.inputs.channels["f_i"]).max(), rel=1e-15
    )


def test_a_stretch_at_full_rate_has_no_gap(tmp_path):
    whole, run = both(parquet(recording(), tmp_path))
    stretch = run.stream.stretch
    inside = slice(stretch.first, stretch.first + len(stretch))
    assert np.array_equal(stretch.output, whole.output[inside])
    assert np.diff(stretch.t).max() < 1.5 * INTERVAL
    assert len(stretch.output) == N // 2


def test_scale_offset_and_a_clock_in_whole_nanoseconds_since_an_epoch_are_kept(tmp_path):
    table = recording()
    epoch = 1_700_000_000_123_456_789
    clock = epoch + np.rint(1e9 * table.pop("t [s]")).astype(np.int64)
    counts = np.rint(table.pop("output [m/s^2]") / 1e-4).astype(np.int32) + 1000
    for form in (parquet, text):
        specs = {
            "t": ColumnSpec("stamp", "ns"),
            "output": ColumnSpec("adc", "count", scale=1e-4, offset=1000.0),
        }
        whole, run = both(form({"stamp": clock, "adc": counts, "note": clock % 7, **table}, tmp_path), specs)
        t, _, output, _ = joined(run)
        assert np.array_equal(t, whole.inputs.t)
        assert t[0] == 0.0
        assert np.array_equal(output, whole.output)


def test_a_clock_that_wraps_around_counts_on_across_parts(tmp_path):
    table = recording()
    ticks = np.rint(1e4 * table.pop("t [s]")).astype(np.int64)
    specs = {"t": ColumnSpec("ticks", "s", scale=1e-4, wraps=1_050_000.0)}
    whole, run = both(parquet({"ticks": ticks % 1_050_000, **table}, tmp_path), specs)
    assert ticks.max() > 2 * 1_050_000
    assert np.array_equal(joined(run)[0], whole.inputs.t)


def test_a_clock_that_begins_with_whole_numbers_may_go_on_with_fractions(tmp_path):
    t = np.arange(N) + np.where(np.arange(N) < N // 2, 0.0, 5.25)
    path = text({**recording(), "t [s]": t}, tmp_path)
    assert path.read_text().splitlines()[2].startswith("1,")
    whole, run = both(path)
    assert np.array_equal(joined(run)[0], whole.inputs.t)


def with_entry(name, row, value):
    table = recording()
    table[name][row] = value
    return table


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("name", "row", "value"),
    [
        ("f_i [g]", 13_000, np.nan),
        ("output [m/s^2]", 19_999, np.inf),
        ("t [s]", 17 * TABLE, 0.0),
        ("t [s]", 15_001, np.nan),
    ],
)
def test_what_no_run_can_hold_is_refused_as_in_memory_with_its_place(form, name, row, value, tmp_path):
    whole, part = both(FORMATS[form](with_entry(name, row, value), tmp_path), read=refused)
    assert part == whole
    assert str(row) in part or str(row + 2) in part


@pytest.mark.parametrize("damage", ["word", "ragged"])
def test_a_damaged_line_of_a_text_is_named(damage, tmp_path):
    path = text(recording(), tmp_path)
    lines = path.read_text().splitlines()
    fields = lines[15_000].split(",")
    fields = [*fields[:-1], "n/a"] if damage == "word" else fields[:-1]
    lines[15_000] = ",".join(fields)
    path.write_text("\n".join(lines) + "\n")
    whole, part = both(path, read=refused)
    assert "line 15001" in part
    assert part == whole


def test_the_rate_of_a_recorded_temperature_is_that_of_the_whole_run(tmp_path):
    table = recording()
    t = table["t [s]"]
    table["T [K]"] = 300.0 + 10.0 * np.sin(2.0 * np.pi * t / 400.0)
    table["T_2 [K]"] = table["T [K]"] + 0.5
    whole, run = both(parquet(table, tmp_path))
    rate = joined(run)[3]["dT"]
    np.testing.assert_allclose(joined(run)[3]["gT"], 0.5, atol=1e-9)
    usual = np.sqrt(np.mean(whole.inputs.channels["dT"] ** 2))
    # both are parabolas through windows that a regressor's noise below 1/20 chose
    assert np.sqrt(np.mean((rate - whole.inputs.channels["dT"]) ** 2)) < 0.05 * usual


def test_another_process_reads_the_same_rows(tmp_path):
    run = read_run(RunSpec("r", "other", file=parquet(recording(), tmp_path)), "accelerometer")
    sent = pickle.loads(pickle.dumps(run))
    for part, other in zip(run.stream.parts("reading"), sent.stream.parts("reading"), strict=True):
        np.testing.assert_array_equal(part.t, other.t)
        np.testing.assert_array_equal(part.output, other.output)


def test_a_component_of_gyroscopes_alone_is_its_column_of_a_long_file(tmp_path):
    values = np.random.default_rng(1).normal(size=(3, 4000))
    rates = {f"g{axis} [rad/s]": one for axis, one in zip("xyz", values, strict=True)}
    path = text({"t [s]": INTERVAL * np.arange(4000), **rates}, tmp_path)
    spec = RunSpec("r", "free-tumble", file=path, sections=(RunSection(0, 500, rate=1.0),))
    run = read_run(spec, "gyroscope").component("gz")
    assert np.array_equal(joined(run)[2], rates["gz [rad/s]"])
    assert np.array_equal(run.stretch.output, rates["gz [rad/s]"])


@pytest.mark.parametrize("written", [parquet, text, hdf5])
def test_saturated_samples_of_a_long_file_are_those_of_the_whole(written, tmp_path):
    table = recording()
    table["output [m/s^2]"] = np.minimum(table["output [m/s^2]"], 7.0)
    whole, part = both(written(table, tmp_path))
    assert whole.stream is None and part.samples == whole.samples < N
    rows = list(part.stream.parts("rows"))
    np.testing.assert_array_equal(np.concatenate([one.output for one in rows]), whole.output)
    np.testing.assert_array_equal(np.concatenate([one.t for one in rows]), whole.inputs.t)
    assert [one.first for one in rows] == [0, *np.cumsum([len(one) for one in rows])[:-1]]
    of = [[note for note in run.source.notes if SATURATED in note or "gaps" in note] for run in (part, whole)]
    assert len(of[0]) == 2 and of[0] == of[1]
